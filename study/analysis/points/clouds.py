"""Points from files of point clouds and meshes: PLY, OBJ, STL and PCD, in text or binary, LAS and LAZ.

Of a mesh the vertices are read, each once.

Source: Turk 1994 (PLY), Wavefront (OBJ), 3D Systems 1989 (STL), Point Cloud Library (PCD 0.7), ASPRS 2019 (LAS 1.4).
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from study.analysis.points.coordinates import Columns, Wanted, others
from study.analysis.points.source import PointFileError, optional, size

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
