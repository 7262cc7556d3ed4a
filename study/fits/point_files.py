"""Contents of a point file, a regular file or standard input, up to a size that memory can hold.

The columns of a table that hold coordinates: those that the user names, those called x, y and z, or all.

Points from a NumPy array or a parquet file.

Points from text: a row per point, with the row and column of a value that is no number.

Points from a file or from standard input: CSV, TSV or other text, NPY, parquet.
"""

import ast
import csv
import json
import os
import re
import stat
import sys
import zipfile
from collections.abc import Sequence
from io import BytesIO
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np

from study.arrays import Floats
from study.text import did_you_mean

if TYPE_CHECKING:
    import pyarrow as pa


STDIN = "-"
_MOST_BYTES = 1_000_000_000
"""Most that is read from standard input, whose length cannot be known beforehand."""


class PointFileError(Exception):
    """A point file that cannot be read; the message says where and why."""


def opened(path: Path) -> BinaryIO:
    """Open a regular file, or standard input for ``-``, of which all is read.

    Raises:
        PointFileError: if it is something else, such as a pipe, which may never end, or too long.
        OSError: if it cannot be opened.
    """
    if str(path) == STDIN:
        contents = sys.stdin.buffer.read(_MOST_BYTES + 1)
        if len(contents) > _MOST_BYTES:
            raise PointFileError(f"standard input: more than {_MOST_BYTES:,} bytes; store it in a file")
        return BytesIO(contents)
    kind = os.stat(path).st_mode
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):  # to open a folder fails by itself, with the system's words
        raise PointFileError(f"{path}: not a regular file; for a pipe, give - and let it be standard input")
    return open(path, "rb")


def size(file: BinaryIO) -> int:
    """Number of bytes of an open file, which is then at its beginning."""
    length = file.seek(0, os.SEEK_END)
    file.seek(0)
    return length


MOST_DIMENSIONS = 20
_UNITS = "nm|um|µm|μm|mm|cm|dm|m|km|in|inch|inches|ft|feet|px|pixels?|(?:milli|centi|micro|kilo)?met(?:er|re)s?"
_COORDINATE = re.compile(rf"([xyz])(?:\s*[\[({{].*[\])}}]|(?:\s*[_/,.-]\s*|\s+)(?:{_UNITS}))?", re.IGNORECASE)
"""A name such as x, Y, x [mm], X(m), x_mm, x mm, x/mm."""


def coordinates(path: Path, names: list[str], columns: Sequence[str] | None, *, named: bool) -> list[int]:
    """Indices of the columns that hold coordinates.

    Args:
        path: the file, for messages.
        names: of all its columns.
        columns: names or numbers, from 1, of those to take; if None, x, y and z where there are such names, else all.
        named: the file has a header, so that names mean something.

    Raises:
        PointFileError: if a column is not there, or given twice, or not the only one of its name; or if there are too
            many.
    """
    if columns is not None:
        places = [_column(path, names, column.strip()) for column in columns]
    else:
        places = (_by_letter(names) if named else []) or list(range(len(names)))
    for place in places:
        if places.count(place) > 1:
            raise PointFileError(f"{path}: column {names[place]} is given twice")
        if [names[i] for i in places].count(names[place]) > 1:
            raise PointFileError(f"{path}: two columns are called {names[place]!r}")
    if len(places) > MOST_DIMENSIONS:
        raise PointFileError(
            f"{path}: {len(places)} columns; points may have {MOST_DIMENSIONS} coordinates at most: choose them with "
            "--columns"
        )
    return places


def _by_letter(names: list[str]) -> list[int]:
    """Columns called x, y and z, or x and y, in this order; none if those are missing or not the only ones."""
    found: dict[str, list[int]] = {letter: [] for letter in "xyz"}
    for place, name in enumerate(names):
        if match := _COORDINATE.fullmatch(name.strip()):
            found[match[1].lower()].append(place)
    counts = [len(places) for places in found.values()]
    return [places[0] for places in found.values() if places] if counts in ([1, 1, 0], [1, 1, 1]) else []


def _column(path: Path, names: list[str], column: str) -> int:
    """Index of a column by its name or number."""
    if names.count(column) > 1:
        raise PointFileError(f"{path}: two columns are called {column!r}; give the number of one")
    if column in names:
        return names.index(column)
    if column.isdecimal() and 1 <= int(column) <= len(names):
        return int(column) - 1
    raise PointFileError(f"{path}: no column {column!r}; {did_you_mean(column, names)} (or 1 to {len(names)})")


Columns = tuple[Floats, list[str], list[str]]
"""Points (n, d), the names of their columns, and those of the columns left out."""
MAGIC = {b"\x93NUMPY": ".npy", b"PAR1": ".parquet"}
"""First bytes of the files, by which standard input is recognised."""


def read_numpy(path: Path, file: BinaryIO, columns: Sequence[str] | None) -> Columns:
    """Read an array of shape (n, d), whose columns are called by their numbers."""
    try:
        _assert_whole(path, file)
        array = np.load(file, allow_pickle=False)
        if not isinstance(array, np.ndarray):
            raise PointFileError(f"{path}: expected numbers of shape (n, d), found an archive")
    except (ValueError, EOFError, zipfile.BadZipFile):
        raise PointFileError(f"{path}: not a NumPy array of numbers") from None
    if array.ndim != 2 or array.dtype.kind not in "fiu" or 0 in array.shape:
        raise PointFileError(f"{path}: expected numbers of shape (n, d), found {array.dtype}, shape {array.shape}")
    names = [str(i + 1) for i in range(array.shape[1])]
    chosen = coordinates(path, names, columns, named=False)
    return array[:, chosen].astype(float), [names[i] for i in chosen], _others(names, chosen)


def _assert_whole(path: Path, file: BinaryIO) -> None:
    """Raise if the header claims more than the file holds, before memory is taken for it."""
    length = size(file)
    if file.read(6) == b"\x93NUMPY":
        wide = file.read(2)[:1] != b"\x01"
        header = file.read(int.from_bytes(file.read(4 if wide else 2), "little"))
        try:
            told = ast.literal_eval(header.decode("utf-8" if wide else "latin-1"))
            claimed = prod(told["shape"]) * np.dtype(told["descr"]).itemsize
        except (SyntaxError, ValueError, TypeError, KeyError, MemoryError, RecursionError):
            raise PointFileError(f"{path}: not a NumPy array of numbers: its header cannot be read") from None
        if claimed > length - file.tell() and not np.dtype(told["descr"]).hasobject:
            raise PointFileError(
                f"{path}: not a NumPy array of numbers: its header claims shape {told['shape']}, the file is shorter"
            )
    file.seek(0)


def read_parquet(path: Path, file: BinaryIO, columns: Sequence[str] | None) -> Columns:
    """Read the numeric columns of a parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.ParquetFile(file).read()
    except pa.ArrowException as error:
        raise PointFileError(f"{path}: not a parquet file: {str(error).splitlines()[0]}") from None
    index = _index_columns(path, table.schema)
    numeric = [
        i
        for i, field in enumerate(table.schema)
        if (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)) and field.name not in index
    ]
    if not numeric or not table.num_rows:
        raise PointFileError(f"{path}: no numeric column, or no row")
    names = [table.schema.field(i).name for i in numeric]
    chosen = coordinates(path, names, columns, named=True)
    values = [table.column(numeric[i]).cast(pa.float64(), safe=False).to_numpy() for i in chosen]
    return np.stack(values, axis=1), [names[i] for i in chosen], _others(names, chosen)


def _index_columns(path: Path, schema: "pa.Schema") -> list[object]:
    """Names of the columns that are labels of a data frame's rows: those are not coordinates."""
    try:
        return list(json.loads((schema.metadata or {}).get(b"pandas", b"{}")).get("index_columns", []))
    except (ValueError, AttributeError, TypeError):
        raise PointFileError(f"{path}: a parquet file whose pandas metadata cannot be read") from None


def _others(names: list[str], chosen: list[int]) -> list[str]:
    return [name for place, name in enumerate(names) if place not in chosen]


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


class PointTable(NamedTuple):
    """Points of a file.

    Attributes:
        points: coordinates (n, d); missing ones are NaN.
        names: of their columns.
        left: names of the columns that were left out.
    """

    points: Floats
    names: list[str]
    left: list[str]


def read_points(path: Path, columns: Sequence[str] | None = None) -> PointTable:
    """Read points from a file. A message on a bad value gives its row and column.

    Args:
        path: text with one point per row (delimiter comma, semicolon, tab, bar or blanks; with or without a header;
            lines that start with # are comments), ``.npy`` of shape (n, d), or ``.parquet``; ``-`` for standard input
            with any of these. Empty cells and NaN are missing. The decimal mark may be a comma if the delimiter is not.
        columns: names or numbers, from 1, of the columns that hold coordinates. If None, the columns called x, y and z
            in a header (or x and y; in capitals, with a unit), else all. The other columns may hold anything.

    Raises:
        PointFileError: with the row and column at fault.
    """
    try:
        with opened(path) as file:
            kind = path.suffix.lower()
            if str(path) == STDIN:
                start = file.read(6)
                file.seek(0)
                kind = next((suffix for magic, suffix in MAGIC.items() if start.startswith(magic)), "")
            match kind:
                case ".npy":
                    table = read_numpy(path, file, columns)
                case ".parquet" | ".pq":
                    table = read_parquet(path, file, columns)
                case _:
                    table = read_text(path, file, columns)
    except OSError as error:
        raise PointFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    except csv.Error as error:
        raise PointFileError(f"{path}: not a table of numbers: {error}") from None
    points, names, left = table
    d = points.shape[1]
    if d < 2:
        raise PointFileError(f"{path}: 1 column ({names[0]}); a point needs at least 2 coordinates")
    missing = np.isnan(points)
    if len(points) and missing.all(axis=0).any():
        raise PointFileError(f"{path}: column {names[int(missing.all(axis=0).argmax())]} has no number in it")
    complete = int(np.isfinite(points).all(axis=1).sum())
    if complete < d + 1:
        raise PointFileError(f"{path}: {complete} points of {d} coordinates; a sphere needs at least {d + 1}")
    return PointTable(points, names, left)
