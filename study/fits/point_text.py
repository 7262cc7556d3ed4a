"""Contents of a point file, a regular file or standard input, up to a size that memory can hold.

The columns of a table that hold coordinates: those that the user names, those called x, y and z, or all of three.

Points from text: a row per point, with the row and column of a value that is no number.
"""

import codecs
import csv
import os
import re
import stat
import sys
import zipfile
from collections.abc import Sequence
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from study.arrays import Floats, angles, coordinate_places, length_unit
from study.text import did_you_mean

STDIN = "-"
_MOST_BYTES = 1_000_000_000
"""Most that is read from standard input or unpacked, whose length cannot be known beforehand."""


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


def unpacked_names(path: Path, file: BinaryIO) -> list[str]:
    """Names of the files in a ZIP archive, which is then at its beginning.

    Raises:
        PointFileError: if it is damaged, or unpacks to more than memory should hold.
    """
    try:
        members = zipfile.ZipFile(file).infolist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError):
        raise PointFileError(f"{path}: a ZIP archive that cannot be read") from None
    if sum(member.file_size for member in members) > _MOST_BYTES:
        raise PointFileError(f"{path}: unpacks to more than {_MOST_BYTES:,} bytes; save its points as .npy or text")
    file.seek(0)
    return [member.filename for member in members]


def optional(module: str, path: Path, what: str, way_out: str) -> Any:
    """Import a library that reads a format and is not among those always installed.

    Raises:
        PointFileError: if it is not there, with the command that installs it, and another way.
    """
    try:
        return import_module(module)
    except ImportError:
        raise PointFileError(
            f"{path}: {what}, for which {module} is not installed: pip install 'sphere-fit-study[points]', or {way_out}"
        ) from None


Columns = tuple[Floats, list[str], list[str]]
"""Points (n, d), the names of their columns, and those of the columns left out."""
MOST_DIMENSIONS = 20
_USUAL = 3
"""Most columns that are coordinates without a word of the user or the header."""


class Wanted(NamedTuple):
    """The coordinates that a user asks for.

    Attributes:
        columns: names or numbers, from 1, of the columns; None for x, y and z where there are such names, else all.
        dimension: number of coordinates; None for two or three, or as many as there are ``columns``.
    """

    columns: Sequence[str] | None = None
    dimension: int | None = None

    def places(self, path: Path, names: list[str], *, named: bool) -> list[int]:
        """Indices of the columns that hold coordinates.

        Args:
            path: the file, for messages.
            names: of all its columns.
            named: the file has a header, so that names mean something.

        Raises:
            PointFileError: if a column is not there, or given twice, or not the only one of its name; or if the names
                do not tell which of more than three columns are meant.
        """
        if self.columns is not None:
            places = [_column(path, names, column.strip()) for column in self.columns]
            if self.dimension not in (None, len(places)):
                raise PointFileError(f"{path}: --dimension {self.dimension}, but --columns has {len(places)}")
        else:
            places = self._unasked(path, names, coordinate_places(names) if named else [])
        for place in places:
            if places.count(place) > 1:
                raise PointFileError(f"{path}: column {names[place]} is given twice")
            if [names[i] for i in places].count(names[place]) > 1:
                raise PointFileError(f"{path}: two columns are called {names[place]!r}")
        if len(places) > MOST_DIMENSIONS:
            raise PointFileError(
                f"{path}: {len(places)} columns; points may have {MOST_DIMENSIONS} coordinates at most"
            )
        return places

    def _unasked(self, path: Path, names: list[str], by_name: list[int]) -> list[int]:
        """The columns by their names and number."""
        count, every = len(names), list(range(len(names)))
        if self.dimension is not None:
            if self.dimension == len(by_name):
                return by_name
            if self.dimension == count:
                return every
            raise PointFileError(
                f"{path}: {count} columns, --dimension {self.dimension}: name the {self.dimension} with --columns"
            )
        if by_name:
            return by_name
        if pair := angles(names):
            raise PointFileError(
                f"{path}: columns {' and '.join(pair)} are angles, not lengths: convert them to x, y, z, or to "
                "easting, northing, height"
            )
        if count > _USUAL:
            whole = f", or fit all with --dimension {count}" if count <= MOST_DIMENSIONS else ""
            raise PointFileError(
                f"{path}: {count} columns, and no names say which are x, y and z: choose, as with "
                f"--columns 1,2,3{whole}"
            )
        return every


def others(names: list[str], chosen: list[int]) -> list[str]:
    """Names of the columns that are not chosen."""
    return [name for place, name in enumerate(names) if place not in chosen]


def _column(path: Path, names: list[str], column: str) -> int:
    """Index of a column by its name or number."""
    if names.count(column) > 1:
        raise PointFileError(f"{path}: two columns are called {column!r}; give the number of one")
    if column in names:
        return names.index(column)
    if column.isdecimal() and 1 <= int(column) <= len(names):
        return int(column) - 1
    raise PointFileError(f"{path}: no column {column!r}; {did_you_mean(column, names)} (or 1 to {len(names)})")


_Row = tuple[int, str]
"""Number of a line, from 1, and its text."""
_COMMENTS = ("#", "//", "%")
_MOST_PREAMBLE = 50

_MISSING = {"", "na", "null", "none", "n/a", "-"}
"""Cells without a number, besides nan, which is a float."""
_BLANKS = " "
_SPREADSHEET = re.compile('"?sep=.?"?')
"""First line by which a spreadsheet names the delimiter."""


def read_text(path: Path, file: BinaryIO, wanted: Wanted) -> Columns:
    """Read a table: points (n, d), the names of their columns, and those of the columns left out."""
    data = file.read()
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))  # "Unicode text" of a spreadsheet
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        raise PointFileError(
            f"{path}: neither UTF-8 text nor a format that is read here; save it as UTF-8 text with columns x, y, z"
        ) from None
    return read_lines(path, text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), wanted)


def read_lines(path: Path, lines: list[str], wanted: Wanted) -> Columns:
    """Read a table from its lines, as `read_text` does."""
    rows = [(n, row) for n, row in enumerate(lines, 1) if row.strip() and not row.lstrip().startswith(_COMMENTS)]
    if rows and _SPREADSHEET.fullmatch(rows[0][1].strip()):
        rows = rows[1:]
    if not rows:
        raise PointFileError(f"{path}: empty: no row with a number in it")
    rows = _without_counts(rows, everywhere=path.suffix.lower() == ".pts")
    delimiter = _delimiter([row for _, row in rows[1:21] or rows])
    if delimiter != _BLANKS and all(row.rstrip(_BLANKS).endswith(delimiter) for _, row in rows):
        rows = [(n, row.rstrip(_BLANKS).removesuffix(delimiter)) for n, row in rows]  # no column of nothing
    rows = rows[_preamble(rows, delimiter) :]
    names = [str(i + 1) for i in range(len(_cells(rows[0][1], delimiter)))]
    header = _header(_cells(rows[0][1], delimiter), delimiter)
    if header:
        names = [cell or number for cell, number in zip(header, names, strict=True)]
        rows = rows[1:]
    else:
        header = _commented(lines[: rows[0][0] - 1], delimiter, len(names)) or _names_of_pts(path, len(names))
        names = header or names
    if not rows:
        raise PointFileError(f"{path}: a header and no row")
    if not header and len(rows) > 1 and len(second := _cells(rows[1][1], delimiter)) != len(names):
        raise _uneven(path, rows[1][0], second, names, delimiter)  # before it is asked which columns are meant
    chosen = wanted.places(path, names, named=bool(header))
    if header and _has_units(path, *rows[0], delimiter, chosen):
        rows = rows[1:]
    coordinates, left = [names[i] for i in chosen], others(names, chosen)
    if (plain := _plain([row for _, row in rows], delimiter, len(names), chosen)) is not None:
        return plain, coordinates, left
    comma = delimiter != "," and any(
        "," in cell for _, row in rows if "," in row for i, cell in enumerate(_cells(row, delimiter)) if i in chosen
    )
    values = []
    for number, row in rows:
        cells = _cells(row, delimiter)
        if len(cells) != len(names):
            raise _uneven(path, number, cells, names, delimiter)
        for i in chosen:
            value = _number(cells[i], comma)
            if value is None:
                why = "; decimals are commas in this file" if _number(cells[i], False) is not None else ""
                cell = cells[i].strip()[:40]
                raise PointFileError(f"{path}: row {number}, column {i + 1}: {cell!r} is not a number{why}")
            values.append(value)
    return np.array(values).reshape(len(rows), len(chosen)), coordinates, left


def _uneven(path: Path, number: int, cells: list[str], names: list[str], delimiter: str) -> PointFileError:
    """The fault of a row that has more or fewer cells than the first."""
    count = f"{len(cells)} column{'s' * (len(cells) != 1)}"
    twice = delimiter == "," and len(cells) == 2 * len(names)
    why = "; where decimals are commas, columns need semicolons or tabs between them" if twice else ""
    return PointFileError(f"{path}: row {number} has {count}, the first has {len(names)}{why}")


def _without_counts(rows: list[_Row], *, everywhere: bool) -> list[_Row]:
    """Rows without a first one that holds their number alone; in a PTS file each scan begins with one."""
    if everywhere:
        return [row for row in rows if not row[1].strip().isdecimal()] or rows
    for place in range(min(2, len(rows) - 1)):  # below the header, if there is one
        if rows[place][1].strip() == str(len(rows) - place - 1) and len(rows[place + 1][1].split()) > 1:
            return rows[:place] + rows[place + 1 :]
    return rows


def _preamble(rows: list[_Row], delimiter: str) -> int:
    """Number of rows above a header of coordinates that a program wrote about the measurement; 0 without such a header.

    None of them is a row of numbers.
    """
    for place, (_, row) in enumerate(rows[:_MOST_PREAMBLE]):
        cells = _cells(row, delimiter)
        if _header(cells, delimiter) and coordinate_places(cells):
            return place
        if len(cells) > 1 and all(_number(cell, delimiter != ",") is not None for cell in cells):
            return 0
    return 0


def _commented(lines: list[str], delimiter: str, count: int) -> list[str]:
    """The names in a comment right above the first row, if they are those of coordinates."""
    above = [line.strip() for line in lines if line.strip()][-2:]
    for line in reversed([line for line in above if line.startswith(_COMMENTS)]):  # a count may stand between
        cells = [cell.strip() for cell in _cells(line.lstrip("#%/ "), delimiter)]
        if len(cells) == count and coordinate_places(cells):
            return cells
    return []


def _names_of_pts(path: Path, count: int) -> list[str]:
    """Names of the columns of a PTS file, which has no header: coordinates, then intensity, then a colour."""
    more = {3: [], 4: ["intensity"], 6: ["red", "green", "blue"], 7: ["intensity", "red", "green", "blue"]}.get(count)
    return [] if path.suffix.lower() != ".pts" or more is None else [*"xyz", *more]


def _has_units(path: Path, number: int, row: str, delimiter: str, chosen: list[int]) -> bool:
    """True if a row below the header holds the units of the coordinates, which must be the same."""
    cells = _cells(row, delimiter)
    units = {length_unit(cells[i]) for i in chosen if i < len(cells)}
    if "" not in units and len(units) > 1:
        raise PointFileError(f"{path}: row {number}: coordinates in {' and '.join(sorted(units))}; convert them to one")
    return units != {""} and "" not in units


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
