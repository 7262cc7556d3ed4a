"""Points from text: a row per point, with the row and column of a value that is no number."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from study.analysis.points.coordinates import coordinates
from study.analysis.points.source import PointFileError
from study.sphere.types import Floats

_MISSING = {"", "na", "null", "none", "n/a", "-"}
"""Cells without a number, besides nan, which is a float."""
_BLANKS = " "
_SPREADSHEET = re.compile('"?sep=.?"?')
"""First line by which a spreadsheet names the delimiter."""


def read_text(path: Path, file: BinaryIO, columns: Sequence[str] | None) -> tuple[Floats, list[str], list[str]]:
    """Read a table: points (n, d), the names of their columns, and those of the columns left out."""
    try:
        text = file.read().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise PointFileError(f"{path}: neither UTF-8 text nor .npy nor .parquet; save it as UTF-8") from None
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    rows = [(n, row) for n, row in enumerate(lines, 1) if row.strip() and not row.lstrip().startswith("#")]
    if rows and _SPREADSHEET.fullmatch(rows[0][1].strip()):
        rows = rows[1:]
    if not rows:
        raise PointFileError(f"{path}: empty: no row with a number in it")
    delimiter = _delimiter([row for _, row in rows[1:21] or rows])
    names = [str(i + 1) for i in range(len(_cells(rows[0][1], delimiter)))]
    header = _header(_cells(rows[0][1], delimiter), delimiter)
    if header:
        names = [cell or number for cell, number in zip(header, names, strict=True)]
        rows = rows[1:]
    if not rows:
        raise PointFileError(f"{path}: a header and no row")
    chosen = coordinates(path, names, columns, named=bool(header))
    kept, left = [names[i] for i in chosen], [name for i, name in enumerate(names) if i not in chosen]
    if (plain := _plain([row for _, row in rows], delimiter, len(names), chosen)) is not None:
        return plain, kept, left
    comma = delimiter != "," and any(
        "," in cell for _, row in rows if "," in row for i, cell in enumerate(_cells(row, delimiter)) if i in chosen
    )
    values = []
    for number, row in rows:
        cells = _cells(row, delimiter)
        if len(cells) != len(names):
            found = f"{len(cells)} column{'s' * (len(cells) != 1)}"
            twice = delimiter == "," and len(cells) == 2 * len(names)
            why = "; where decimals are commas, columns need semicolons or tabs between them" if twice else ""
            raise PointFileError(f"{path}: row {number} has {found}, the first has {len(names)}{why}")
        for i in chosen:
            value = _number(cells[i], comma)
            if value is None:
                why = "; decimals are commas in this file" if _number(cells[i], False) is not None else ""
                cell = cells[i].strip()[:40]
                raise PointFileError(f"{path}: row {number}, column {i + 1}: {cell!r} is not a number{why}")
            values.append(value)
    return np.array(values).reshape(len(rows), len(chosen)), kept, left


def _plain(rows: list[str], delimiter: str, width: int, chosen: list[int]) -> Floats | None:
    """Rows of plain numbers, read at once; None if anything else is in them, which the slow way then locates."""
    part = chosen != list(range(width))
    if part and (delimiter == _BLANKS or any(row.count(delimiter) != width - 1 or '"' in row for row in rows)):
        return None  # only all columns show by themselves that each row has as many
    mark = None if delimiter == _BLANKS else delimiter
    try:
        plain = np.loadtxt(rows, delimiter=mark, comments=None, ndmin=2, usecols=chosen if part else None)
    except ValueError:
        return None
    return plain if plain.shape[1] == len(chosen) else None


def _delimiter(rows: list[str]) -> str:
    """The delimiter: tab, semicolon, bar or comma, the first that is in at least half of the rows; else blanks."""
    return next((mark for mark in "\t;|," if 2 * sum(mark in row for row in rows) >= len(rows)), _BLANKS)


def _cells(row: str, delimiter: str) -> list[str]:
    if '"' in row:
        plain = " ".join(row.split()) if delimiter == _BLANKS else row
        return next(csv.reader([plain], delimiter=delimiter, skipinitialspace=True))
    return row.split() if delimiter == _BLANKS else row.split(delimiter)


def _header(cells: list[str], delimiter: str) -> list[str]:
    """The names in a first row; an empty list if the row has a number in it, or only empty cells."""
    numbers = [_number(cell, comma) for cell in cells for comma in {False, delimiter != ","}]
    is_header = None in numbers and all(number is None or np.isnan(number) for number in numbers)
    return [cell.strip() for cell in cells] if is_header else []


def _number(cell: str, comma: bool) -> float | None:
    """The number in a cell; NaN if it is missing, None if it is something else."""
    if comma:
        cell = cell.replace(".", "?").replace(",", ".")
    try:
        return None if "_" in cell else float(cell)  # only Python takes 1_000 for a number
    except ValueError:
        return float("nan") if cell.strip().lower() in _MISSING else None
