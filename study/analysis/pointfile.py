"""Points from a file: CSV, TSV or other text, NPY, parquet. A message on a bad value gives its row and column."""

import csv
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from study.sphere.types import Floats
from study.text.nearest import did_you_mean

_MISSING = {"", "na", "null", "none", "n/a", "-"}
"""Cells without a number, besides nan, which is a float."""
_BLANKS = " "


class PointFileError(Exception):
    """A point file that cannot be read; the message says where and why."""


def read_points(path: Path, columns: Sequence[str] | None = None) -> tuple[Floats, list[str]]:
    """Read points from a file.

    Args:
        path: text with one point per row (delimiter comma, semicolon, tab, bar or blanks; with or without a header;
            lines that start with # are comments), ``.npy`` of shape (n, d), or ``.parquet``. Empty cells and NaN are
            missing. The decimal mark may be a comma if the delimiter is not.
        columns: names or numbers, from 1, of the columns that hold coordinates; all columns if None. The other columns
            may hold anything.

    Returns:
        Points (n, d) and the names of their columns.

    Raises:
        PointFileError: with the row and column at fault.
    """
    try:
        match path.suffix.lower():
            case ".npy":
                points, names = _numpy(path, columns)
            case ".parquet" | ".pq":
                points, names = _parquet(path, columns)
            case _:
                points, names = _text(path, columns)
    except OSError as error:
        raise PointFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    d = points.shape[1]
    if d < 2:
        raise PointFileError(f"{path}: 1 column ({names[0]}); a point needs at least 2 coordinates")
    missing = np.isnan(points)
    if len(points) and missing.all(axis=0).any():
        raise PointFileError(f"{path}: column {names[int(missing.all(axis=0).argmax())]} has no number in it")
    complete = int(np.isfinite(points).all(axis=1).sum())
    if complete < d + 1:
        raise PointFileError(f"{path}: {complete} points of {d} coordinates; a sphere needs at least {d + 1}")
    return points, names


def _chosen(path: Path, names: list[str], columns: Sequence[str] | None) -> list[int]:
    """Indices of the columns that hold coordinates."""
    places = list(range(len(names))) if columns is None else [_column(path, names, c.strip()) for c in columns]
    for place in places:
        if places.count(place) > 1:
            raise PointFileError(f"{path}: column {names[place]} is given twice")
        if [names[i] for i in places].count(names[place]) > 1:
            raise PointFileError(f"{path}: two columns are called {names[place]!r}")
    return places


def _column(path: Path, names: list[str], column: str) -> int:
    if names.count(column) > 1:
        raise PointFileError(f"{path}: two columns are called {column!r}; give the number of one")
    if column in names:
        return names.index(column)
    if column.isdecimal() and 1 <= int(column) <= len(names):
        return int(column) - 1
    raise PointFileError(f"{path}: no column {column!r}; {did_you_mean(column, names)} (or 1 to {len(names)})")


def _numpy(path: Path, columns: Sequence[str] | None) -> tuple[Floats, list[str]]:
    try:
        with open(path, "rb") as file:
            array = np.load(file, allow_pickle=False)
            if not isinstance(array, np.ndarray):
                raise PointFileError(f"{path}: expected numbers of shape (n, d), found an archive")
    except (ValueError, EOFError, zipfile.BadZipFile):
        raise PointFileError(f"{path}: not a NumPy array of numbers") from None
    if array.ndim != 2 or array.dtype.kind not in "fiu" or 0 in array.shape:
        raise PointFileError(f"{path}: expected numbers of shape (n, d), found {array.dtype}, shape {array.shape}")
    names = [str(i + 1) for i in range(array.shape[1])]
    chosen = _chosen(path, names, columns)
    return array[:, chosen].astype(float), [names[i] for i in chosen]


def _parquet(path: Path, columns: Sequence[str] | None) -> tuple[Floats, list[str]]:
    try:
        with open(path, "rb") as file:
            table = pq.ParquetFile(file).read()
    except pa.ArrowInvalid as error:
        raise PointFileError(f"{path}: not a parquet file: {str(error).splitlines()[0]}") from None
    index = (table.schema.pandas_metadata or {}).get("index_columns", [])  # labels of rows are not coordinates
    numeric = [
        i
        for i, field in enumerate(table.schema)
        if (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)) and field.name not in index
    ]
    if not numeric or not table.num_rows:
        raise PointFileError(f"{path}: no numeric column, or no row")
    names = [table.schema.field(i).name for i in numeric]
    chosen = _chosen(path, names, columns)
    values = [table.column(numeric[i]).cast(pa.float64(), safe=False).to_numpy() for i in chosen]
    return np.stack(values, axis=1), [names[i] for i in chosen]


def _text(path: Path, columns: Sequence[str] | None) -> tuple[Floats, list[str]]:
    try:
        lines = path.read_text(encoding="utf-8-sig").split("\n")
    except UnicodeDecodeError:
        raise PointFileError(f"{path}: neither UTF-8 text nor .npy nor .parquet") from None
    rows = [(n, row) for n, row in enumerate(lines, 1) if row.strip() and not row.lstrip().startswith("#")]
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
    chosen = _chosen(path, names, columns)
    if chosen == list(range(len(names))):
        plain = _plain([row for _, row in rows], delimiter)
        if plain is not None and plain.shape[1] == len(names):
            return plain, names
    comma = delimiter != "," and any(
        "," in cell for _, row in rows if "," in row for i, cell in enumerate(_cells(row, delimiter)) if i in chosen
    )
    values = []
    for number, row in rows:
        cells = _cells(row, delimiter)
        if len(cells) != len(names):
            found = f"{len(cells)} column{'s' * (len(cells) != 1)}"
            raise PointFileError(f"{path}: row {number} has {found}, the first has {len(names)}")
        for i in chosen:
            value = _number(cells[i], comma)
            if value is None:
                why = "; decimals are commas in this file" if _number(cells[i], False) is not None else ""
                cell = cells[i].strip()[:40]
                raise PointFileError(f"{path}: row {number}, column {i + 1}: {cell!r} is not a number{why}")
            values.append(value)
    return np.array(values).reshape(len(rows), len(chosen)), [names[i] for i in chosen]


def _plain(rows: list[str], delimiter: str) -> Floats | None:
    """Rows of plain numbers, read at once; None if anything else is in them, which the slow way then locates."""
    try:
        return np.loadtxt(rows, delimiter=None if delimiter == _BLANKS else delimiter, comments=None, ndmin=2)
    except ValueError:
        return None


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
