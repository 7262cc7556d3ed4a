"""One HTML page about runs: everything that their tables say, in one file that needs nothing else.

To add a section, write a function from `Material` to `Section`s and a line in `study.report.page.SECTIONS`.
"""

from study.report.page import render, save
from study.report.speed import read_bench

__all__ = ["read_bench", "render", "save"]
