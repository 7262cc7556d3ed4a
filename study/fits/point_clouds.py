"""Points from a NumPy array or a parquet file.

Points from files of point clouds and meshes: PLY, OBJ, STL and PCD, in text or binary, LAS and LAZ.

Of a mesh the vertices are read, each once.

Source: Turk 1994 (PLY), Wavefront (OBJ), 3D Systems 1989 (STL), Point Cloud Library (PCD 0.7), ASPRS 2019 (LAS 1.4).

Points from an Excel workbook.
"""

import ast
import json
import re
import zipfile
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from study.arrays import coordinate_places
from study.fits.point_text import Columns, PointFileError, Wanted, optional, others, read_lines, size

if TYPE_CHECKING:
    import pyarrow as pa


_POINTS = ["points", "xyz", "vertices"]
"""Names that an archive's array of points may have among others."""


def read_numpy(path: Path, file: BinaryIO, wanted: Wanted) -> Columns:
    """Read an array of shape (n, d), whose columns are called by their numbers; or an archive of arrays."""
    try:
        _assert_whole(path, file)
        array = np.load(file, allow_pickle=False)
        names: list[str] = []
        if not isinstance(array, np.ndarray):
            names, array = _member(path, dict(array))
    except (ValueError, EOFError, zipfile.BadZipFile):
        raise PointFileError(f"{path}: not a NumPy array of numbers") from None
    if array.ndim != 2 or array.dtype.kind not in "fiu" or 0 in array.shape:
        raise PointFileError(f"{path}: expected numbers of shape (n, d), found {array.dtype}, shape {array.shape}")
    chosen = wanted.places(path, names or [str(i + 1) for i in range(array.shape[1])], named=bool(names))
    names = names or [str(i + 1) for i in range(array.shape[1])]
    return array[:, chosen].astype(float), [names[i] for i in chosen], others(names, chosen)


def _member(path: Path, arrays: dict[str, Any]) -> tuple[list[str], Any]:
    """The array of points in an archive, or its arrays x, y, z, … as columns with their names."""
    flat = [name for name, array in arrays.items() if array.ndim == 1]
    if coordinate_places(flat) and len({arrays[name].shape for name in flat}) == 1:
        return flat, np.column_stack([arrays[name] for name in flat])
    tables = [name for name, array in arrays.items() if array.ndim == 2]
    points = tables if len(tables) == 1 else [name for name in _POINTS if name in tables]
    if len(points) != 1:
        held = ", ".join(arrays) or "nothing"
        raise PointFileError(f"{path}: an archive of {held}: save its points alone, or call them points")
    return [], arrays[points[0]]


def _assert_whole(path: Path, file: BinaryIO) -> None:
    """Raise if the header claims more than the file holds, before memory is taken for it."""
    length = size(file)
    if file.read(6) == b"\x93NUMPY":
        wide = file.read(2)[:1] != b"\x01"
        header = file.read(int.from_bytes(file.read(4 if wide else 2), "little"))
        try:
            fields = ast.literal_eval(header.decode("utf-8" if wide else "latin-1"))
            claimed = prod(fields["shape"]) * np.dtype(fields["descr"]).itemsize
        except (SyntaxError, ValueError, TypeError, KeyError, MemoryError, RecursionError):
            raise PointFileError(f"{path}: not a NumPy array of numbers: its header cannot be read") from None
        if claimed > length - file.tell() and not np.dtype(fields["descr"]).hasobject:
            raise PointFileError(
                f"{path}: not a NumPy array of numbers: its header claims shape {fields['shape']}, the file is shorter"
            )
    file.seek(0)


def read_parquet(path: Path, file: BinaryIO, wanted: Wanted) -> Columns:
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
    chosen = wanted.places(path, names, named=True)
    values = [table.column(numeric[i]).cast(pa.float64(), safe=False).to_numpy() for i in chosen]
    return np.stack(values, axis=1), [names[i] for i in chosen], others(names, chosen)


def _index_columns(path: Path, schema: "pa.Schema") -> list[object]:
    """Names of the columns that are labels of a data frame's rows: those are not coordinates."""
    try:
        return list(json.loads((schema.metadata or {}).get(b"pandas", b"{}")).get("index_columns", []))
    except (ValueError, AttributeError, TypeError):
        raise PointFileError(f"{path}: a parquet file whose pandas metadata cannot be read") from None


_PLY_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_PLY_TYPES |= {"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"}
_PLY_TYPES |= {"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}
_PLY_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_STL_HEADER, _STL_FACET = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_LONGEST_HEADER = 1000
"""Most lines of a header."""


def read_ply(path: Path, file: BinaryIO, wanted: Wanted) -> Columns:
    """Read the vertices of a PLY file, in text or binary."""
    kind, element, known, count = "", "", False, 0
    before: list[tuple[int, list[str]]] = []
    fields: list[tuple[str, str]] = []
    for words in _header(path, file, "end_header"):
        match words:
            case ["format", kind, *_]:
                pass
            case ["element", element, number]:
                known = known or element == "vertex"
                if element == "vertex":
                    count = _whole(path, number)
                elif not known:
                    before.append((_whole(path, number), []))
            case ["property", *types, name] if element == "vertex":
                fields.append((name, _PLY_TYPES.get(" ".join(types), "")))
            case ["property", *types, _] if before and not known:
                before[-1][1].append(_PLY_TYPES.get(" ".join(types), ""))
    if not fields or not all(code for _, code in fields):
        raise PointFileError(f"{path}: a PLY file without vertices, or with a property that is no number")
    if kind == "ascii":
        skipped = sum(number for number, _ in before)
        return _from_text(path, file.read().splitlines()[skipped : skipped + count], fields, wanted, count)
    if kind not in _PLY_ORDERS or not all(all(codes) for _, codes in before):
        raise PointFileError(
            f"{path}: a PLY file of format {kind!r}, or with lists before the vertices; save it as text"
        )
    skipped = sum(number * sum(np.dtype(code).itemsize for code in codes) for number, codes in before)
    dtype = np.dtype([(name, _PLY_ORDERS[kind] + code) for name, code in _different(path, fields)])
    return _from_bytes(path, file.read()[skipped:], dtype, count, wanted)


def read_pcd(path: Path, file: BinaryIO, wanted: Wanted) -> Columns:
    """Read a PCD file, in text or binary."""
    header = {words[0]: words[1:] for words in _header(path, file, "DATA")}
    try:
        names, counts = header["FIELDS"], list(map(int, header.get("COUNT", ["1"] * len(header["FIELDS"]))))
        codes = [kind.lower() + width for kind, width in zip(header["TYPE"], header["SIZE"], strict=True)]
        number = int(header["POINTS"][0] if "POINTS" in header else header["WIDTH"][0])
        fields = [
            (name if many == 1 else f"{name} {i}", code)
            for name, code, many in zip(names, codes, counts, strict=True)
            for i in range(many)
        ]
        dtype = np.dtype(
            [(f"{name} {i}" if name == "_" else name, "<" + code) for i, (name, code) in enumerate(fields)]
        )
        (kind,) = header["DATA"]
    except (KeyError, ValueError, TypeError, IndexError):
        raise PointFileError(f"{path}: a PCD file whose header cannot be read") from None
    if kind == "ascii":
        return _from_text(path, file.read().splitlines()[:number], fields, wanted, number)
    if kind != "binary":
        raise PointFileError(
            f"{path}: a PCD file of {kind} data, which is not read here: save it as text, as with "
            "pcl_convert_pcd_ascii_binary IN OUT 0"
        )
    return _from_bytes(path, file.read(), dtype, number, wanted)


def read_obj(path: Path, file: BinaryIO, wanted: Wanted) -> Columns:
    """Read the vertices of an OBJ file."""
    lines = [line[2:] for line in file.read().splitlines() if line[:2] in (b"v ", b"v\t")]
    return _from_text(path, lines, [(name, "f8") for name in "xyz"], wanted, len(lines))


def read_stl(path: Path, file: BinaryIO, wanted: Wanted) -> Columns:
    """Read the vertices of an STL file, in text or binary, each once."""
    length = size(file)
    facets = int.from_bytes(file.read(_STL_HEADER)[-4:], "little") if length >= _STL_HEADER else -1
    if length == _STL_HEADER + facets * _STL_FACET.itemsize:
        corners = np.frombuffer(file.read(), _STL_FACET)["corners"].reshape(-1, 3).astype(float)
    else:
        file.seek(0)
        lines = [line.split(None, 1)[1] for line in file.read().splitlines() if re.match(rb"\s*vertex\s+\S", line)]
        corners, *_ = _from_text(path, lines, [(name, "f8") for name in "xyz"], Wanted(list("xyz")), len(lines))
    _, first = np.unique(corners, axis=0, return_index=True)
    return _chosen(path, list("xyz"), corners[np.sort(first)], wanted)


def read_las(path: Path, file: BinaryIO, wanted: Wanted) -> Columns:
    """Read a LAS or LAZ file, with the library laspy."""
    laspy = optional("laspy", path, "a LAS point cloud", "export it as text with columns x, y, z")
    try:
        cloud = laspy.read(file, closefd=False)
        points = np.stack([cloud.x, cloud.y, cloud.z], axis=1)
    except Exception as error:  # whatever a damaged file raises in it
        raise PointFileError(f"{path}: not a LAS or LAZ file that can be read: {str(error)[:80]}") from None
    return _chosen(path, list("xyz"), np.asarray(points, dtype=float), wanted)


def _header(path: Path, file: BinaryIO, last: str) -> Iterator[list[str]]:
    """The words of a header's lines, up to the one that begins with a word."""
    for _ in range(_LONGEST_HEADER):
        words = file.readline(_LONGEST_HEADER).decode("latin-1").split()
        if words and not words[0].startswith("#"):
            yield words
        if words[:1] == [last]:
            return
    raise PointFileError(f"{path}: a header without a line {last}")


def _from_text(path: Path, lines: list[bytes], fields: list[tuple[str, str]], wanted: Wanted, count: int) -> Columns:
    """Points from lines of numbers, of which further ones are left out."""
    names = [name for name, _ in fields]
    rows = [line.decode("latin-1").split() for line in lines]
    if len(rows) < count or not count:
        raise PointFileError(f"{path}: its header announces {count} points, {len(rows)} are there")
    try:
        values = np.array([[float(cell) for cell in row[: len(names)]] for row in rows])
    except ValueError:
        values = np.empty(0)
    if values.shape != (count, len(names)):
        raise PointFileError(f"{path}: a row of its points is not {len(names)} numbers ({', '.join(names)[:80]})")
    return _chosen(path, names, values, wanted)


def _from_bytes(path: Path, data: bytes, dtype: np.dtype[Any], count: int, wanted: Wanted) -> Columns:
    """Points from records."""
    if len(data) < count * dtype.itemsize or count < 1:
        there = len(data) // dtype.itemsize
        raise PointFileError(f"{path}: its header announces {count} points, {there} are there")
    records = np.frombuffer(data, dtype, count)
    names = list(dtype.names or ())
    chosen = wanted.places(path, names, named=True)
    with np.errstate(invalid="ignore"):  # damaged numbers
        points = np.stack([records[names[i]].astype(float) for i in chosen], axis=1)
    return points, [names[i] for i in chosen], others(names, chosen)


def _chosen(path: Path, names: list[str], values: Any, wanted: Wanted) -> Columns:
    """The coordinates among columns."""
    chosen = wanted.places(path, names, named=True)
    return values[:, chosen], [names[i] for i in chosen], others(names, chosen)


def _different(path: Path, fields: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """The fields, if their names differ."""
    if len({name for name, _ in fields}) < len(fields):
        raise PointFileError(f"{path}: a PLY file with two properties of one name")
    return fields


def _whole(path: Path, number: str) -> int:
    """A number of elements."""
    if not number.isdecimal():
        raise PointFileError(f"{path}: {number!r} is not a number of elements")
    return int(number)


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
