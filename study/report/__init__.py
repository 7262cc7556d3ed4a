"""One HTML page about runs: everything that their tables say, in one file that needs nothing else.

To add a section, write a function from `Material` to `Section`s and a line in `study.report.page.SECTIONS`.
"""
