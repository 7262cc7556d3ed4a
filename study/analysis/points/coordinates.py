"""The columns of a table that hold coordinates: those that the user names, those called x, y and z, or all."""

import re
from collections.abc import Sequence
from pathlib import Path

from study.analysis.points.source import PointFileError
from study.text.nearest import did_you_mean

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
