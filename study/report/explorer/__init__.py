"""The explorer: chart and table of every row of the runs' summaries, within the page.

The numbers travel in the page as compressed columns (`packed`). The scripts beside this file unpack and show them;
Observable Plot, bundled with its licence, draws.
"""

from study.report.explorer.section import explorer_section

__all__ = ["explorer_section"]
