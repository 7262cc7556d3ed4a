"""The columns of a table that hold coordinates: those that the user names, those called x, y and z, or all of three."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from study.analysis.points.source import PointFileError
from study.sphere.types import Floats
from study.text.coordinate_names import angles, coordinate_places
from study.text.nearest import did_you_mean

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
