"""Points from a file or from standard input, in the formats of scanners, spreadsheets and programs."""

import csv
import os
import stat
import sys
import zipfile
from collections.abc import Callable, Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeVar

import numpy as np

from study.arrays import Floats
from study.fits.points import point_formats
from study.fits.points.point_formats import Columns, PointFileError, Wanted, damage_in, read_text

Other = TypeVar("Other")
Reader = Callable[[BinaryIO, Wanted], Columns]
_READERS: dict[str, Reader] = {
    ".pts": partial(read_text, pts=True),
    **dict.fromkeys([".npy", ".npz"], point_formats.read_numpy),
    **dict.fromkeys([".parquet", ".pq"], point_formats.read_parquet),
    ".ply": point_formats.read_ply,
    ".pcd": point_formats.read_pcd,
    ".obj": point_formats.read_obj,
    ".stl": point_formats.read_stl,
    **dict.fromkeys([".las", ".laz"], point_formats.read_las),
    **dict.fromkeys([".xlsx", ".xlsm"], point_formats.read_workbook),
}
"""Readers of the formats that are not any table of text."""
STDIN = "-"
_MOST_BYTES = 1_000_000_000
"""Most that is read from standard input or unpacked, whose length cannot be known beforehand."""
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
    **dict.fromkeys([".gltf", ".glb"], ("a glTF scene", _MESH)),
    ".fbx": ("an FBX scene", _MESH),
    ".3mf": ("a 3MF mesh", _MESH),
    **dict.fromkeys([".step", ".stp"], ("a STEP model", _MESH)),
    **dict.fromkeys([".iges", ".igs"], ("an IGES model", _MESH)),
    ".dxf": ("a DXF drawing", _MESH),
    ".dwg": ("a DWG drawing", _MESH),
    **dict.fromkeys([".vtk", ".vtp"], ("a VTK file", _MESH)),
    **dict.fromkeys([".c3d", ".trc", ".bvh"], ("a motion recording", _MOTION)),
    ".xls": ("an Excel workbook that is old or has a password", "save it as .xlsx without one, or as CSV"),
    ".ods": ("an OpenDocument spreadsheet", "save it as .xlsx or CSV"),
    ".mat": ("a MATLAB file", "save the points with writematrix(points, 'points.csv')"),
    **dict.fromkeys([".h5", ".hdf5"], ("an HDF5 file", "save its points as .npy or CSV")),
    ".json": ("a JSON file", "save its points as CSV"),
    ".pkl": ("a Python pickle", "save its points with numpy.save"),
    **dict.fromkeys([".gz", ".7z"], ("a compressed file", "unpack it")),
    ".zip": ("a ZIP archive", "unpack it"),
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

    `study.fit` takes it in place of an array of points, with its noise.

    Examples:
        >>> import study
        >>> rows = "x,y,sigma", "1,0,.1", "0,1,.1", "-1,0,.1", "0,-1,.2"
        >>> with open("four.csv", "w") as file:
        ...     print(*rows, sep=chr(10), file=file)
        >>> table = study.read_points("four.csv")
        >>> table.names, table.noise.tolist()
        (['x', 'y'], [0.1, 0.1, 0.1, 0.2])
        >>> study.fit(table).center.round(1) + 0.0
        array([0., 0.])
    """

    points: Floats
    names: list[str]
    left: list[str]
    noise: Floats | None = None

    def noise_or(self, other: Other) -> Other | Floats:
        """The noise to fit with: the file's, where columns have it, else another."""
        return other if self.noise is None else self.noise


def read_points(
    path: str | Path, columns: str | Sequence[str | int] | None = None, dimension: int | None = None
) -> PointTable:
    """Read points from a file, as `study fit` does. A message on a bad value gives its row and column.

    Args:
        path: text with one point per row (delimiter comma, semicolon, tab, bar or blanks; with or without a header,
            and a row of units below it; lines that start with #, // or % are comments), ``.npy`` of shape (n, d) or
            ``.npz``, ``.parquet``, ``.ply``, ``.pcd``, ``.obj``, ``.stl``, ``.pts``; with the extra ``points``
            ``.xlsx``, ``.las`` and ``.laz``; ``-`` for standard input. Empty cells and NaN are missing. The decimal
            mark may be a comma if the delimiter is not.
        columns: names or numbers, from 1, of the columns that hold coordinates: ``["x", "y"]``, ``[1, 2, 3]`` or, as
            the command takes them, ``"x,y"``. If None, the columns called x, y and z in a header (or x and y; see
            `coordinate_places`), else all of two or three. The other columns may hold anything.
        dimension: number of coordinates, where all columns are coordinates, of which there are more than three.

    Returns:
        The points (n, d), the names of their columns and of those left out, and the noise, if columns called sigma, or
        sx, sy and sz, have it.

    Raises:
        PointFileError: a `ValueError`, with the row and column at fault; or with the format's name and a way out, if
            it is not read. What it calls --columns and --dimension are the arguments here.
        TypeError: if the path is none.

    Examples:
        >>> import os, tempfile, study
        >>> path = os.path.join(tempfile.mkdtemp(), "points.csv")
        >>> with open(path, "w") as file:
        ...     for row in ("time,x,y,sigma", "0,1,0,.1", "1,0,1,.1", "2,-1,0,.2", "3,0,-1,.2"):
        ...         print(row, file=file)
        >>> table = study.read_points(path)
        >>> table.points.shape, table.names, table.left, table.noise
        ((4, 2), ['x', 'y'], ['time'], array([0.1, 0.1, 0.2, 0.2]))
        >>> study.fit(table, "mle").center.round(6) + 0.0
        array([0., 0.])
    """
    if not isinstance(path, str | Path):
        raise TypeError(f"path = {path!r:.60}: expected the name of a file; study.fit takes points themselves")
    path = Path(path)
    if isinstance(columns, str):
        columns = columns.split(",")
    wanted = Wanted(None if columns is None else [str(column) for column in columns], dimension)
    try:
        with _opened(path) as file, np.errstate(all="ignore"):  # damaged numbers
            return _read(file, path.suffix.lower(), wanted)
    except OSError as error:
        raise PointFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    except csv.Error as error:
        raise PointFileError(f"{path}: not a table of numbers: {error}") from None
    except PointFileError as error:
        raise PointFileError(f"{path}: {error}") from None


def _opened(path: Path) -> BinaryIO:
    """Open a regular file, or standard input for ``-``, of which all is read.

    Raises:
        PointFileError: if it is something else, such as a pipe, which may never end, or too long.
        OSError: if it cannot be opened.
    """
    if str(path) == STDIN:
        contents = sys.stdin.buffer.read(_MOST_BYTES + 1)
        if len(contents) > _MOST_BYTES:
            raise PointFileError(f"more than {_MOST_BYTES:,} bytes on standard input; store it in a file")
        return BytesIO(contents)
    kind = os.stat(path).st_mode
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):  # to open a folder fails by itself, with the system's words
        raise PointFileError("not a regular file; for a pipe, give - and let it be standard input")
    return open(path, "rb")


def _read(file: BinaryIO, suffix: str, wanted: Wanted) -> PointTable:
    """Read an open file whose name has a suffix."""
    kind = _kind(file, suffix)
    if kind in _REFUSED:
        what, way_out = _REFUSED[kind]
        raise PointFileError(f"{what}, which is not read here: {way_out}")
    reader = _READERS.get(kind, read_text)
    points, names, left = reader(file, wanted)
    noise, columns_of_noise = _noise(file, reader, points.shape[1], left)
    d, missing = points.shape[1], np.isnan(points)
    if d < 2:
        raise PointFileError(f"1 column ({names[0]}); a point needs at least 2 coordinates")
    if len(points) and missing.all(axis=0).any():
        raise PointFileError(f"column {names[int(missing.all(axis=0).argmax())]} has no number in it")
    complete = int(np.isfinite(points).all(axis=1).sum())
    if complete < d + 1:
        raise PointFileError(f"{complete} points of {d} coordinates; a sphere needs at least {d + 1}")
    return PointTable(points, names, [name for name in left if name not in columns_of_noise], noise)


def _noise(file: BinaryIO, reader: Reader, d: int, left: list[str]) -> tuple[Floats | None, list[str]]:
    """Standard deviations in a column called sigma, or in those called sx, sy, sz, and the names of these columns.

    Raises:
        PointFileError: with the row of a point whose standard deviation is not positive and finite.
    """
    wanted = [["sigma"], [f"s{axis}" for axis in "xyz"[:d]]][: 1 + (d <= 3)]
    names = next((names for names in wanted if all(left.count(name) == 1 for name in names)), [])
    if not names:
        return None, []
    file.seek(0)
    noise, _, _ = reader(file, Wanted(names))
    for row, column in np.argwhere(~((noise > 0.0) & (noise < np.inf) | np.isnan(noise))):
        value = f"{names[column]} = {noise[row, column]:g} at point {row + 1}"
        words = "a standard deviation must be positive and finite; an empty cell leaves the point out"
        raise PointFileError(f"{value}: {words}")
    return noise[:, 0] if names == ["sigma"] else noise, names


def _kind(file: BinaryIO, suffix: str) -> str:
    """The suffix that stands for a file's format: by its first bytes, or by its name."""
    start = file.read(8)
    file.seek(0)
    if not start.startswith(b"PK\x03\x04"):
        return next((kind for known, kind in _STARTS.items() if start.startswith(known)), suffix)
    with damage_in("a ZIP archive"):
        members = zipfile.ZipFile(file).infolist()
    if sum(member.file_size for member in members) > _MOST_BYTES:
        raise PointFileError(f"unpacks to more than {_MOST_BYTES:,} bytes; save its points as .npy or text")
    file.seek(0)
    if any(member.filename.startswith("xl/") for member in members):
        return ".xlsx"
    if any(member.filename.endswith(".npy") for member in members):
        return ".npz"
    return suffix if suffix in _REFUSED else ".zip"
