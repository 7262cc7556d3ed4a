"""Points from a NumPy array or a parquet file."""

import ast
import json
import zipfile
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from study.analysis.points.coordinates import Columns, Wanted, others
from study.analysis.points.source import PointFileError, size
from study.text.coordinate_names import coordinate_places

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
    found = tables if len(tables) == 1 else [name for name in _POINTS if name in tables]
    if len(found) != 1:
        held = ", ".join(arrays) or "nothing"
        raise PointFileError(f"{path}: an archive of {held}: save its points alone, or call them points")
    return [], arrays[found[0]]


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
