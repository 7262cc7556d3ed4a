"""Points from an Excel workbook."""

import zipfile
from pathlib import Path
from typing import BinaryIO

from study.analysis.points.coordinates import Columns, Wanted
from study.analysis.points.source import PointFileError, optional
from study.analysis.points.text import read_lines


def read_workbook(path: Path, file: BinaryIO, wanted: Wanted) -> Columns:
    """Read the sheet that was last open in a workbook, with the library openpyxl, as if it were text.

    Rows are counted as the spreadsheet counts them; empty columns do not count.
    """
    openpyxl = optional("openpyxl", path, "an Excel workbook", "save the sheet as CSV")
    try:
        book = openpyxl.load_workbook(file, data_only=True)
        rows = [[_text(cell) for cell in row] for row in book.active.iter_rows(min_row=1, values_only=True)]
    except (zipfile.BadZipFile, KeyError, ValueError, TypeError, AttributeError, SyntaxError, OSError):
        raise PointFileError(f"{path}: not an Excel workbook that can be read") from None
    filled = [i for i in range(max(map(len, rows), default=0)) if any(row[i] for row in rows)]
    return read_lines(path, ["\t".join(row[i] or " " for i in filled) for row in rows], wanted)


def _text(cell: object) -> str:
    """A cell as text without tabs and quotes, which would make two of it."""
    return "" if cell is None else " ".join(str(cell).replace('"', " ").split())
