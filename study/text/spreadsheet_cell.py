"""Cells of CSV files that a spreadsheet takes for text, whatever a file or a marker is called."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def inert_frame(frame: "pd.DataFrame") -> "pd.DataFrame":
    """A data frame whose titles and texts are `inert`, to be written as CSV."""
    frame = frame.rename(columns=inert)
    words = [place for place, kind in enumerate(frame.dtypes) if kind.kind == "O"]
    return frame.assign(**{str(frame.columns[i]): frame.iloc[:, i].map(inert) for i in words}) if words else frame


def inert(cell: object) -> object:
    """A cell that no spreadsheet computes: a text that begins like a formula gets an apostrophe in front.

    Numbers stay, and so does a text of one character.

    Source: OWASP, "CSV Injection".
    """
    return f"'{cell}" if isinstance(cell, str) and len(cell) > 1 and cell.startswith(_FORMULA) else cell
