"""Points from a file or from standard input: CSV, TSV or other text, NPY, parquet."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from study.analysis.points.binary import MAGIC, read_numpy, read_parquet
from study.analysis.points.source import STDIN, PointFileError, opened
from study.analysis.points.text import read_text
from study.sphere.types import Floats


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
