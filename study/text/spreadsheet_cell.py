"""Cells of CSV files that a spreadsheet takes for text, whatever a file or a marker is called."""

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def inert(cell: object) -> object:
    """A cell that no spreadsheet computes: a text that begins like a formula gets an apostrophe in front.

    Numbers stay, and so does a text of one character.

    Source: OWASP, "CSV Injection".
    """
    return f"'{cell}" if isinstance(cell, str) and len(cell) > 1 and cell.startswith(_FORMULA) else cell
