"""Formats of point files: tables of text, arrays and tables of programs, point clouds, meshes, workbooks.

A table of text has a row per point; a message gives the row and column of a value that is no number. PLY, OBJ, STL and
PCD may be text or binary. Of a mesh the vertices are read, each once.

The columns that hold coordinates are those that the user names, those called x, y and z, or all of three. A message
here does not name the file, which `study.fits.points.point_files` does.

Source: Turk 1994 (PLY), Wavefront (OBJ), 3D Systems 1989 (STL), Point Cloud Library (PCD 0.7), ASPRS 2019 (LAS 1.4).
"""

import ast
import codecs
import contextlib
import csv
import io
import json
import os
import re
import struct
import subprocess
import sys
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from importlib import import_module
from math import prod
from typing import IO, TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from study.arrays import Floats, angles, coordinate_places, has_angle, length_unit, unit_in
from study.text import did_you_mean

if TYPE_CHECKING:
    import pyarrow as pa


class PointFileError(ValueError):
    """A point file that cannot be read; the message says where and why."""


def _optional(module: str, what: str, way_out: str) -> Any:
    """Import a library that reads a format and is not among those always installed.

    Raises:
        PointFileError: if it is not there, with the command that installs it, and another way.
    """
    try:
        return import_module(module)
    except ImportError:
        remedy = f"pip install 'sphere-fit-study[points]', or {way_out}"
        raise PointFileError(f"{what}, for which {module} is not installed: {remedy}") from None


@contextlib.contextmanager
def damage_in(what: str) -> Iterator[None]:
    """Turn whatever a library raises for a damaged file into one line, and leave out its warnings."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except PointFileError:
        raise
    except Exception as error:
        raise PointFileError(f"not {what} that can be read: {' '.join(str(error).split())[:120]}") from None


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

    def places(self, names: list[str], *, named: bool = True) -> list[int]:
        """Indices of the columns that hold coordinates.

        Args:
            names: of all columns of the file.
            named: the file has a header, so that names mean something.

        Raises:
            PointFileError: if a column is not there, or given twice, or not the only one of its name; or if the names
                do not tell which of more than three columns are meant.
        """
        if self.columns is not None:
            places = [_column(names, column.strip()) for column in self.columns]
            if self.dimension not in (None, len(places)):
                raise PointFileError(f"--dimension {self.dimension}, but --columns has {len(places)}")
        else:
            places = self._unasked(names, coordinate_places(names) if named else [])
        for place in places:
            if places.count(place) > 1:
                raise PointFileError(f"column {names[place]} is given twice")
            if [names[i] for i in places].count(names[place]) > 1:
                raise PointFileError(f"two columns are called {names[place]!r}")
        if len(places) > MOST_DIMENSIONS:
            raise PointFileError(f"{len(places)} columns; points may have {MOST_DIMENSIONS} coordinates at most")
        return places

    def _unasked(self, names: list[str], by_name: list[int]) -> list[int]:
        """The columns by their names and number."""
        count, d = len(names), self.dimension
        if d is not None and d not in (count, len(by_name)):
            raise PointFileError(f"{count} columns, --dimension {d}: name the {d} with --columns")
        if d is None and (turned := [name for name in ([names[i] for i in by_name] or names) if has_angle(name)]):
            remedy = "convert them to lengths, or name the columns with --columns"
            raise PointFileError(f"column {turned[0]!r} holds angles, not lengths: {remedy}")
        if by_name and d in (None, len(by_name)):
            return by_name
        if d is None and (pair := angles(names)):
            remedy = "convert them to x, y, z, or to easting, northing, height"
            raise PointFileError(f"columns {' and '.join(pair)} are angles, not lengths: {remedy}")
        if d is None and count > _USUAL:
            whole = f", or fit all with --dimension {count}" if count <= MOST_DIMENSIONS else ""
            choice = f"choose, as with --columns 1,2,3{whole}"
            raise PointFileError(f"{count} columns, and no names say which are x, y and z: {choice}")
        return list(range(count))


def _column(names: list[str], column: str) -> int:
    """Index of a column by its name or number."""
    if names.count(column) > 1:
        raise PointFileError(f"two columns are called {column!r}; give the number of one")
    if column in names:
        return names.index(column)
    if column.isdecimal() and 1 <= int(column) <= len(names):
        return int(column) - 1
    raise PointFileError(f"no column {column!r}; {did_you_mean(column, names)} (or 1 to {len(names)})")


def _chosen(names: list[str], places: list[int], points: Any) -> Columns:
    """Points, with the names of their columns and of the others."""
    return points, [names[i] for i in places], [name for i, name in enumerate(names) if i not in places]


_Row = tuple[int, str]
"""Number of a line, from 1, and its text."""
_COMMENTS = ("#", "//", "%")
_ERROR = re.compile(r"\s*#([¡¿]?[^\W_a-z]+(/[^\W_a-z]+)?[!?]|N/?[ADV])(?=[\s;,|]|$)")
"""A spreadsheet's error in a first cell, such as #DIV/0!, #¡VALOR! or #N/A: a missing number, and no comment."""
_MINUS = "\N{MINUS SIGN}"
"""The sign that typeset text has where a program writes a hyphen."""
_MOST_PREAMBLE = 50
_PTS_NAMES = {3: [*"xyz"], 4: [*"xyz", "intensity"], 6: [*"xyz", "red", "green", "blue"]}
_PTS_NAMES[7] = [*_PTS_NAMES[4], "red", "green", "blue"]
"""Names of the columns of a PTS file, which has no header, by their number."""

_MISSING = {"", "na", "null", "none", "n/a", "-"}
"""Cells without a number, besides nan, which is a float."""
_BLANKS = " "
_SPREADSHEET = re.compile('"?sep=.?"?')
"""First line by which a spreadsheet names the delimiter."""


def read_text(file: BinaryIO, wanted: Wanted, pts: bool = False) -> Columns:
    """Read a table, in which each scan begins with its number of points, and may lack a header, if it is a PTS file."""
    data = file.read()
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))  # "Unicode text" of a spreadsheet
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        remedy = "save it as UTF-8 text with columns x, y, z"
        raise PointFileError(f"neither UTF-8 text nor a format that is read here; {remedy}") from None
    lines = text.replace("\r\n", "\n").replace("\r", "\n").replace(_MINUS, "-").split("\n")
    return _read_rows([(n, row) for n, row in enumerate(lines, 1) if not _is_comment(row)], lines, wanted, pts)


def _is_comment(row: str) -> bool:
    return row.lstrip().startswith(_COMMENTS) and not _ERROR.match(row)


def _read_rows(rows: list[_Row], lines: list[str], wanted: Wanted, pts: bool = False) -> Columns:
    """Read a table from its rows, and the lines among which they are: comments above the rows may have names."""
    rows = [(n, row) for n, row in rows if row.strip()]
    if rows and _SPREADSHEET.fullmatch(rows[0][1].strip()):
        rows = rows[1:]
    if not rows:
        raise PointFileError("empty: no row with a number in it")
    rows = _without_counts(rows, everywhere=pts)
    delimiter = _delimiter([row for _, row in rows[1:21] or rows])
    if delimiter != _BLANKS and all(row.rstrip(_BLANKS).endswith(delimiter) for _, row in rows):
        rows = [(n, row.rstrip(_BLANKS).removesuffix(delimiter)) for n, row in rows]  # no column of nothing
        if not any(row.strip() for _, row in rows):
            raise PointFileError("empty: no row with a number in it")
    rows = rows[_preamble(rows, delimiter) :]
    names = [str(i + 1) for i in range(len(_cells(rows[0][1], delimiter)))]
    header = _header(_cells(rows[0][1], delimiter), delimiter)
    if header:
        names = [cell or number for cell, number in zip(header, names, strict=True)]
        rows = rows[1:]
    else:
        header = _commented(lines[: rows[0][0] - 1], delimiter, len(names)) or (
            _PTS_NAMES.get(len(names), []) if pts else []
        )
        names = header or names
    if not rows:
        raise PointFileError("a header and no row")
    if not header and len(rows) > 1 and len(second := _cells(rows[1][1], delimiter)) != len(names):
        raise _uneven(rows[1][0], second, names, delimiter)  # before it is asked which columns are meant
    chosen = wanted.places(names, named=bool(header))
    if header:
        _one_unit({unit_in(names[i]) for i in chosen}, "the header")
        if _has_units(*rows[0], delimiter, chosen):
            rows = rows[1:]
    if (plain := _plain([row for _, row in rows], delimiter, len(names), chosen)) is not None:
        return _chosen(names, chosen, plain)
    comma = delimiter != "," and any(
        "," in cell for _, row in rows if "," in row for i, cell in enumerate(_cells(row, delimiter)) if i in chosen
    )
    values = []
    for number, row in rows:
        cells = _cells(row, delimiter)
        if len(cells) != len(names):
            raise _uneven(number, cells, names, delimiter)
        for i in chosen:
            value = _number(cells[i], comma)
            if value is None:
                why = "; decimals are commas in this file" if _number(cells[i], False) is not None else ""
                cell = cells[i].strip()[:40]
                raise PointFileError(f"row {number}, column {i + 1}: {cell!r} is not a number{why}")
            values.append(value)
    return _chosen(names, chosen, np.array(values).reshape(len(rows), len(chosen)))


def _uneven(number: int, cells: list[str], names: list[str], delimiter: str) -> PointFileError:
    """The fault of a row that has more or fewer cells than the first."""
    count = f"{len(cells)} column{'s' * (len(cells) != 1)}"
    twice = delimiter == "," and len(cells) == 2 * len(names)
    why = "; where decimals are commas, columns need semicolons or tabs between them" if twice else ""
    return PointFileError(f"row {number} has {count}, the first has {len(names)}{why}")


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


def _has_units(number: int, row: str, delimiter: str, chosen: list[int]) -> bool:
    """True if a row below the header holds the units of the coordinates, which must be the same."""
    cells = _cells(row, delimiter)
    units = {length_unit(cells[i]) for i in chosen if i < len(cells)}
    _one_unit(units, f"row {number}")
    return "" not in units


def _one_unit(units: set[str], place: str) -> None:
    """Refuse coordinates that have units, and not the same."""
    if "" not in units and len(units) > 1:
        raise PointFileError(f"{place}: coordinates in {' and '.join(sorted(units))}; convert them to one")


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
    return plain if plain.shape == (len(rows), len(chosen)) else None


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


_POINTS = ["points", "xyz", "vertices"]
"""Names that an archive's array of points may have among others."""


def read_numpy(file: BinaryIO, wanted: Wanted) -> Columns:
    """Read an array of shape (n, d), whose columns are called by their numbers; or an archive of arrays."""
    with damage_in("a NumPy array of numbers"):
        length = file.seek(0, os.SEEK_END)
        file.seek(0)
        if file.read(4) == b"PK\x03\x04":
            archive = zipfile.ZipFile(file)
            shapes = [_assert_whole(archive.open(member), member.file_size) for member in archive.infolist()]
            _assert_few(sum(map(prod, shapes)), length)
        else:
            _assert_whole(file, length)
        file.seek(0)
        array = np.load(file, allow_pickle=False)
        names: list[str] = []
        if not isinstance(array, np.ndarray):
            names, array = _member(dict(array))
    if array.ndim != 2 or array.dtype.kind not in "fiu" or 0 in array.shape:
        raise PointFileError(f"expected numbers of shape (n, d), found {array.dtype}, shape {array.shape}")
    named, names = bool(names), names or [str(i + 1) for i in range(array.shape[1])]
    chosen = wanted.places(names, named=named)
    return _chosen(names, chosen, array[:, chosen].astype(float))


def _member(arrays: dict[str, Any]) -> tuple[list[str], Any]:
    """The array of points in an archive, or its arrays x, y, z, … as columns with their names."""
    flat = [name for name, array in arrays.items() if array.ndim == 1]
    if coordinate_places(flat) and len({arrays[name].shape for name in flat}) == 1:
        return flat, np.column_stack([arrays[name] for name in flat])
    tables = [name for name, array in arrays.items() if array.ndim == 2]
    points = tables if len(tables) == 1 else [name for name in _POINTS if name in tables]
    if len(points) != 1:
        held = ", ".join(arrays) or "nothing"
        raise PointFileError(f"an archive of {held}: save its points alone, or call them points")
    return [], arrays[points[0]]


def _assert_whole(file: IO[bytes], length: int) -> tuple[int, ...]:
    """The shape of an array; raises if it claims more than its file of so many bytes holds, before memory is taken."""
    file.seek(0)
    start = file.read(8)
    if start[:6] != b"\x93NUMPY":
        return (0,)
    wide = start[6:7] != b"\x01"
    size = int.from_bytes(file.read(4 if wide else 2), "little")
    if size > length:
        raise PointFileError(f"not a NumPy array of numbers: its header claims {size:,} bytes, the file has {length:,}")
    fields = ast.literal_eval(file.read(size).decode("utf-8" if wide else "latin-1"))
    shape, dtype = fields["shape"], np.dtype(fields["descr"])
    if not all(type(n) is int and n >= 0 for n in shape):  # True is an int
        raise ValueError(f"shape {shape}")
    if prod(shape) * dtype.itemsize > length - size and not dtype.hasobject:
        raise PointFileError(f"not a NumPy array of numbers: its header claims shape {shape}, the file is shorter")
    return tuple(shape)


_MOST_NUMBERS = 30_000_000
"""Most coordinates in a short file that packs them: they take 2 GB while they are read."""
_PACKED = 4
"""More coordinates than measured points pack into a byte: LASzip leaves 7 % of 20 bytes a point (Isenburg 2013)."""


def _assert_few(count: int, length: int) -> None:
    """Raise if so many coordinates, which a file of so many bytes packs, are too many for memory."""
    if count > max(_MOST_NUMBERS, _PACKED * length):
        remedy = "leave out copies of points, or save them as .npy"
        raise PointFileError(f"{length:,} bytes pack {count:,} numbers, more than {_MOST_NUMBERS:,}; {remedy}")


def read_parquet(file: BinaryIO, wanted: Wanted) -> Columns:
    """Read the numeric columns of a parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    with damage_in("a parquet file"):
        stored = pq.ParquetFile(file)
        schema, rows = stored.schema_arrow, stored.metadata.num_rows
        index = _index_columns(schema)
        kinds = [pa.types.is_floating(field.type) or pa.types.is_integer(field.type) for field in schema]
        names = [field.name for i, field in enumerate(schema) if kinds[i] and field.name not in index]
        if not names or not rows:
            raise PointFileError("no numeric column, or no row")
        chosen = wanted.places(names)
        _assert_few(rows * len(chosen), file.seek(0, os.SEEK_END))
        table = stored.read(columns=[names[i] for i in chosen])
        values = [table.column(names[i]).cast(pa.float64(), safe=False).to_numpy() for i in chosen]
    return _chosen(names, chosen, np.stack(values, axis=1))


def _index_columns(schema: "pa.Schema") -> list[object]:
    """Names of the columns that are labels of a data frame's rows: those are not coordinates."""
    try:
        return list(json.loads((schema.metadata or {}).get(b"pandas", b"{}")).get("index_columns", []))
    except (ValueError, AttributeError, TypeError):
        raise PointFileError("a parquet file whose pandas metadata cannot be read") from None


_PLY_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_PLY_TYPES |= {"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"}
_PLY_TYPES |= {"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}
_PCD_TYPES = {code.upper(): code for code in ("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8")}
_PLY_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_STL_HEADER, _STL_FACET = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_LONGEST_HEADER = 1000
"""Most lines of a header."""


def read_ply(file: BinaryIO, wanted: Wanted) -> Columns:
    """Read the vertices of a PLY file, in text or binary."""
    kind, element, known, count = "", "", False, 0
    before: list[tuple[int, list[str]]] = []
    fields: list[tuple[str, str]] = []
    for words in _header_lines(file, "end_header"):
        match words:
            case ["format", kind, *_]:
                pass
            case ["element", element, number]:
                known = known or element == "vertex"
                if element == "vertex":
                    count = _whole(number)
                elif not known:
                    before.append((_whole(number), []))
            case ["property", *types, name] if element == "vertex":
                fields.append((name, _PLY_TYPES.get(" ".join(types), "")))
            case ["property", *types, _] if before and not known:
                before[-1][1].append(_PLY_TYPES.get(" ".join(types), ""))
    if not fields or not all(code for _, code in fields):
        raise PointFileError("a PLY file without vertices, or with a property that is no number")
    if kind == "ascii":
        skipped = sum(number for number, _ in before)
        return _from_text(file.read().splitlines()[skipped : skipped + count], fields, wanted, count)
    if kind not in _PLY_ORDERS or not all(all(codes) for _, codes in before):
        raise PointFileError(f"a PLY file of format {kind!r}, or with lists before the vertices; save it as text")
    if len({name for name, _ in fields}) < len(fields):
        raise PointFileError("a PLY file with two properties of one name")
    skipped = sum(number * sum(np.dtype(code).itemsize for code in codes) for number, codes in before)
    dtype = np.dtype([(name, _PLY_ORDERS[kind] + code) for name, code in fields])
    return _from_bytes(file.read()[skipped:], dtype, count, wanted)


def read_pcd(file: BinaryIO, wanted: Wanted) -> Columns:
    """Read a PCD file, in text or binary."""
    header = {words[0]: words[1:] for words in _header_lines(file, "DATA")}
    data = file.read()
    try:
        names, counts = header["FIELDS"], list(map(int, header.get("COUNT", ["1"] * len(header["FIELDS"]))))
        codes = [_PCD_TYPES[kind + width] for kind, width in zip(header["TYPE"], header["SIZE"], strict=True)]
        number = int(header["POINTS"][0] if "POINTS" in header else header["WIDTH"][0])
        if max(counts) < 1:
            raise PointFileError("a PCD file whose fields have no number: COUNT is 0; save it again, with 1 for each")
        if sum(counts) > len(data):  # each number takes a byte or more
            raise PointFileError(f"its header announces {sum(counts):,} numbers a point, {len(data):,} bytes are there")
        fields = [
            (name if many == 1 else f"{name} {i}", code)
            for name, code, many in zip(names, codes, counts, strict=True)
            for i in range(many)
        ]
        places = enumerate(fields)
        dtype = np.dtype([(f"{name} {i}" if name == "_" else name, "<" + code) for i, (name, code) in places])
        (kind,) = header["DATA"]
    except PointFileError:
        raise
    except (KeyError, ValueError, TypeError, IndexError):
        raise PointFileError("a PCD file whose header cannot be read") from None
    if kind == "ascii":
        return _from_text(data.splitlines()[:number], fields, wanted, number)
    if kind != "binary":
        remedy = "save it as text, as with pcl_convert_pcd_ascii_binary IN OUT 0"
        raise PointFileError(f"a PCD file of {kind} data, which is not read here: {remedy}")
    return _from_bytes(data, dtype, number, wanted)


def read_obj(file: BinaryIO, wanted: Wanted) -> Columns:
    """Read the vertices of an OBJ file."""
    lines = [line[2:] for line in file.read().splitlines() if line[:2] in (b"v ", b"v\t")]
    return _from_text(lines, [(name, "f8") for name in "xyz"], wanted, len(lines))


def read_stl(file: BinaryIO, wanted: Wanted) -> Columns:
    """Read the vertices of an STL file, in text or binary, each once."""
    length = file.seek(0, os.SEEK_END)
    file.seek(0)
    facets = int.from_bytes(file.read(_STL_HEADER)[-4:], "little") if length >= _STL_HEADER else -1
    if length == _STL_HEADER + facets * _STL_FACET.itemsize:
        corners = np.frombuffer(file.read(), _STL_FACET)["corners"].reshape(-1, 3).astype(float)
    else:
        file.seek(0)
        lines = [line.split(None, 1)[1] for line in file.read().splitlines() if re.match(rb"\s*vertex\s+\S", line)]
        corners, *_ = _from_text(lines, [(name, "f8") for name in "xyz"], Wanted(list("xyz")), len(lines))
    _, first = np.unique(corners, axis=0, return_index=True)
    return _of_all(list("xyz"), corners[np.sort(first)], wanted)


_UNPACK = """
import io, sys
import laspy
import numpy as np
cloud = laspy.read(io.BytesIO(sys.stdin.buffer.read()))
np.save(sys.stdout.buffer, np.stack([cloud.x, cloud.y, cloud.z], axis=1))
"""
"""Program that unpacks a LAZ file: some damage ends, rather than fails, the process that does it."""


def read_las(file: BinaryIO, wanted: Wanted) -> Columns:
    """Read a LAS or LAZ file, with the library laspy."""
    laspy = _optional("laspy", "a LAS point cloud", "export it as text with columns x, y, z")
    with damage_in("a LAS or LAZ file"):
        if _is_packed(file):
            done = subprocess.run([sys.executable, "-P", "-c", _UNPACK], input=file.read(), capture_output=True)
            if done.returncode:
                raise ValueError("its points cannot be unpacked; it is damaged, or lazrs is not installed")
            points = np.load(io.BytesIO(done.stdout))
        else:
            cloud = laspy.read(file, closefd=False)
            points = np.stack([cloud.x, cloud.y, cloud.z], axis=1)
    return _of_all(list("xyz"), np.asarray(points, dtype=float), wanted)


def _is_packed(file: BinaryIO) -> bool:
    """True for a LAZ file; raises if a header claims more records than its file has bytes for."""
    length = file.seek(0, os.SEEK_END)
    file.seek(0)
    header = file.read(255).ljust(255, b"\0")
    start, variable, kind, size, points = struct.unpack_from("<IIBHI", header, 96)
    packed, extended = bool(kind >> 6 == 2), 0
    if header[25] >= 4:  # LAS 1.4
        extended, points = struct.unpack_from("<IQ", header, 243)
    if max(start, 54 * variable) + 60 * extended + size * points * (not packed) > length:
        words = f"its header claims {points:,} points and {variable + extended:,} records more"
        raise ValueError(f"{words}, and it is shorter")
    if packed:
        _assert_few(3 * points, length)
    file.seek(0)
    return packed


def _header_lines(file: BinaryIO, last: str) -> Iterator[list[str]]:
    """The words of a header's lines, up to the one that begins with a word."""
    for _ in range(_LONGEST_HEADER):
        words = file.readline(_LONGEST_HEADER).decode("latin-1").split()
        if words and not words[0].startswith("#"):
            yield words
        if words[:1] == [last]:
            return
    raise PointFileError(f"a header without a line {last}")


def _from_text(lines: list[bytes], fields: list[tuple[str, str]], wanted: Wanted, count: int) -> Columns:
    """Points from lines of numbers, of which further ones are left out."""
    names = [name for name, _ in fields]
    rows = [line.replace(_MINUS.encode(), b"-").decode("latin-1").split() for line in lines]
    if len(rows) < count or not count:
        raise PointFileError(f"its header announces {count} points, {len(rows)} are there")
    try:
        values = np.array([[float(cell) for cell in row[: len(names)]] for row in rows])
    except ValueError:
        values = np.empty(0)
    if values.shape != (count, len(names)):
        raise PointFileError(f"a row of its points is not {len(names)} numbers ({', '.join(names)[:80]})")
    return _of_all(names, values, wanted)


def _of_all(names: list[str], values: Floats, wanted: Wanted) -> Columns:
    """The coordinates among the columns of values."""
    chosen = wanted.places(names)
    return _chosen(names, chosen, values[:, chosen])


def _from_bytes(data: bytes, dtype: np.dtype[Any], count: int, wanted: Wanted) -> Columns:
    """Points from records."""
    if len(data) < count * dtype.itemsize or count < 1:
        raise PointFileError(f"its header announces {count} points, {len(data) // dtype.itemsize} are there")
    records = np.frombuffer(data, dtype, count)
    names = list(dtype.names or ())
    chosen = wanted.places(names)
    return _chosen(names, chosen, np.stack([records[names[i]].astype(float) for i in chosen], axis=1))


def _whole(number: str) -> int:
    """A number of elements."""
    if not number.isdecimal():
        raise PointFileError(f"{number!r} is not a number of elements")
    return int(number)


_MOST_CELLS = 100_000_000
"""Most cells of a sheet, five columns of as many rows as it may have."""


def read_workbook(file: BinaryIO, wanted: Wanted) -> Columns:
    """Read the sheet that was last open in a workbook, with the library openpyxl, as if it were text without comments.

    Rows are counted as the spreadsheet counts them; empty columns do not count.
    """
    openpyxl = _optional("openpyxl", "an Excel workbook", "save the sheet as CSV")
    rows, count = list[tuple[int, dict[int, str]]](), 0
    with damage_in("an Excel workbook"):
        sheet = openpyxl.load_workbook(file, read_only=True, data_only=True).active
        sheet.reset_dimensions()  # a row then ends with its last cell
        for number, row in enumerate(sheet.iter_rows(values_only=True), 1):
            count += 1 + len(row)
            if count > _MOST_CELLS:
                raise PointFileError(f"more than {_MOST_CELLS:,} cells; save the columns x, y and z alone")
            if row:
                rows.append((number, {i: text for i, cell in enumerate(row) if (text := _text(cell))}))
    filled = sorted({i for _, row in rows for i in row})
    if len(rows) * len(filled) > _MOST_CELLS:
        raise PointFileError(f"{len(rows):,} rows of {len(filled):,} columns; save the columns x, y and z alone")
    return _read_rows([(n, "\t".join(row.get(i, " ") for i in filled)) for n, row in rows], [], wanted)


def _text(cell: object) -> str:
    """A cell as text without tabs and quotes, which would make two of it."""
    return "" if cell is None else " ".join(str(cell).replace('"', " ").replace(_MINUS, "-").split())
