"""Points from a file or from standard input, in the formats of scanners, spreadsheets and programs."""

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from study.arrays import Floats
from study.fits.point_clouds import (
    read_las,
    read_numpy,
    read_obj,
    read_parquet,
    read_pcd,
    read_ply,
    read_stl,
    read_workbook,
)
from study.fits.point_text import Columns, PointFileError, Wanted, opened, read_text, unpacked_names

Reader = Callable[[Path, BinaryIO, Wanted], Columns]
_READERS: dict[str, Reader] = {
    ".npy": read_numpy,
    ".npz": read_numpy,
    ".parquet": read_parquet,
    ".pq": read_parquet,
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".obj": read_obj,
    ".stl": read_stl,
    ".las": read_las,
    ".laz": read_las,
    ".xlsx": read_workbook,
    ".xlsm": read_workbook,
}
"""Readers of the formats that are no tables of text."""
_STARTS = {
    b"\x93NUMPY": ".npy",
    b"PAR1": ".parquet",
    b"ply\n": ".ply",
    b"ply\r": ".ply",
    b"# .PCD": ".pcd",
    b"LASF": ".las",
    b"ASTM-E57": ".e57",
    b"\x89HDF": ".h5",
    b"MATLAB 5": ".mat",
    b"\xd0\xcf\x11\xe0": ".xls",
    b"\x1f\x8b": ".gz",
    b"%PDF": ".pdf",
}
"""First bytes of formats, which tell more than a file's name."""
_AS_TEXT = "export it as text with columns x, y, z"
_CLOUD = f"{_AS_TEXT}, or as PLY, for instance with CloudCompare"
_MESH = "export its points as PLY, OBJ or text with columns x, y, z"
_MOTION = "study joint and study joints read recordings"
_REFUSED = {
    ".e57": ("an E57 point cloud", _CLOUD),
    ".ptx": ("a PTX point cloud", _CLOUD),
    ".rcp": ("a ReCap project", _CLOUD),
    ".rcs": ("a ReCap point cloud", _CLOUD),
    ".fls": ("a FARO scan", _CLOUD),
    ".gltf": ("a glTF scene", _MESH),
    ".glb": ("a glTF scene", _MESH),
    ".fbx": ("an FBX scene", _MESH),
    ".3mf": ("a 3MF mesh", _MESH),
    ".step": ("a STEP model", _MESH),
    ".stp": ("a STEP model", _MESH),
    ".iges": ("an IGES model", _MESH),
    ".igs": ("an IGES model", _MESH),
    ".dxf": ("a DXF drawing", _MESH),
    ".dwg": ("a DWG drawing", _MESH),
    ".vtk": ("a VTK file", _MESH),
    ".vtp": ("a VTK file", _MESH),
    ".c3d": ("a motion recording", _MOTION),
    ".trc": ("a motion recording", _MOTION),
    ".bvh": ("a motion recording", _MOTION),
    ".xls": ("an old Excel workbook", "save it as .xlsx or CSV"),
    ".ods": ("an OpenDocument spreadsheet", "save it as .xlsx or CSV"),
    ".mat": ("a MATLAB file", "save the points with writematrix(points, 'points.csv')"),
    ".h5": ("an HDF5 file", "save its points as .npy or CSV"),
    ".hdf5": ("an HDF5 file", "save its points as .npy or CSV"),
    ".json": ("a JSON file", "save its points as CSV"),
    ".pkl": ("a Python pickle", "save its points with numpy.save"),
    ".gz": ("a compressed file", "unpack it"),
    ".zip": ("a ZIP archive", "unpack it"),
    ".7z": ("a compressed file", "unpack it"),
    ".pdf": ("a PDF document", _AS_TEXT),
}
"""Formats that are not read: a name, and a way out."""


class PointTable(NamedTuple):
    """Points of a file.

    Attributes:
        points: coordinates (n, d); missing ones are NaN.
        names: of their columns.
        left: names of the columns that were left out.
        noise: standard deviation of each point (n,), or of each coordinate (n, d); None if no columns have it.
    """

    points: Floats
    names: list[str]
    left: list[str]
    noise: Floats | None = None


def read_points(path: Path, columns: Sequence[str] | None = None, dimension: int | None = None) -> PointTable:
    """Read points from a file. A message on a bad value gives its row and column.

    Args:
        path: text with one point per row (delimiter comma, semicolon, tab, bar or blanks; with or without a header,
            and a row of units below it; lines that start with #, // or % are comments), ``.npy`` of shape (n, d) or
            ``.npz``, ``.parquet``, ``.ply``, ``.pcd``, ``.obj``, ``.stl``, ``.pts``; with the extra ``points``
            ``.xlsx``, ``.las`` and ``.laz``; ``-`` for standard input. Empty cells and NaN are missing. The decimal
            mark may be a comma if the delimiter is not.
        columns: names or numbers, from 1, of the columns that hold coordinates. If None, the columns called x, y and z
            in a header (or x and y; see `coordinate_places`), else all of two or three. The other columns may hold
            anything.
        dimension: number of coordinates, where all columns are coordinates, of which there are more than three.

    Raises:
        PointFileError: with the row and column at fault; or with the format's name and a way out, if it is not read.
    """
    try:
        with opened(path) as file:
            kind = _kind(path, file)
            if kind in _REFUSED:
                what, way_out = _REFUSED[kind]
                raise PointFileError(f"{path}: {what}, which is not read here: {way_out}")
            reader = _READERS.get(kind, read_text)
            table = reader(path, file, Wanted(columns, dimension))
            noise, columns_of_noise = _noise(path, file, reader, table)
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
    return PointTable(points, names, [name for name in left if name not in columns_of_noise], noise)


def _noise(path: Path, file: BinaryIO, reader: Reader, table: Columns) -> tuple[Floats | None, list[str]]:
    """Standard deviations in a column called sigma, or in those called sx, sy, sz, and the names of these columns.

    Raises:
        PointFileError: with the row of a point whose standard deviation is not positive.
    """
    points, _, left = table
    of_axes = [f"s{axis}" for axis in "xyz"[: points.shape[1]]] if points.shape[1] <= 3 else []
    wanted = [["sigma"], of_axes]
    names = next((names for names in wanted if names and all(left.count(name) == 1 for name in names)), [])
    if not names:
        return None, []
    file.seek(0)
    noise, _, _ = reader(path, file, Wanted(names))
    wrong = np.argwhere(~((noise > 0.0) | np.isnan(noise)))
    if len(wrong):
        row, column = wrong[0]
        value = f"{names[column]} = {noise[row, column]:g} at point {row + 1}"
        raise PointFileError(
            f"{path}: {value}: a standard deviation must be positive; an empty cell leaves the point out"
        )
    return noise[:, 0] if names == ["sigma"] else noise, names


def _kind(path: Path, file: BinaryIO) -> str:
    """The suffix that stands for a file's format: by its first bytes, or by its name."""
    start = file.read(8)
    file.seek(0)
    if start.startswith(b"PK\x03\x04"):
        names = unpacked_names(path, file)
        if any(name.startswith("xl/") for name in names):
            return ".xlsx"
        return ".npz" if any(name.endswith(".npy") for name in names) else _of_name(path, ".zip")
    return next((kind for known, kind in _STARTS.items() if start.startswith(known)), path.suffix.lower())


def _of_name(path: Path, otherwise: str) -> str:
    """The suffix of a file's name, if it is that of a format that is refused, else another."""
    return path.suffix.lower() if path.suffix.lower() in _REFUSED else otherwise
