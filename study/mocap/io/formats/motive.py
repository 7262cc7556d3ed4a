"""Read the CSV export of OptiTrack's Motive: a line of keys and values, lines of headers, then rows.

Above each column stand its type (Marker, Rigid Body, Rigid Body Marker, Bone, Bone Marker), its name, its ID, in newer
versions its parent, then what it holds (Rotation, Position, Mean Marker Error, Marker Quality), then the axis.
Source: OptiTrack documentation, "Data Export: CSV", format versions 1.2 to 1.25.
"""

import csv
import re
from typing import NamedTuple

import numpy as np

from study.mocap.io.assembly import FileContents
from study.mocap.io.formats.rows import Rows, as_points, with_all_frames
from study.mocap.io.recording import RecordingError

KEY = "Format Version"
_FIRST = 20
"""Lines in which the headers must be."""
_FEWEST = 4
"""Fewest lines above that of the axes: keys, types, names, contents."""
_MEASURED = ("marker",)
_SOLVED = ("rigid body marker", "bone marker", "marker constraint")
_UNLABELED = re.compile(r"unlabell?ed\b", re.I)
_NUMBERED = re.compile(r"(.*\S)\s*:\s*(marker\s*\d+)$", re.I)


def read_motive(lines: list[str]) -> FileContents:
    """Read the markers of an export of Motive.

    Measured markers are taken; where there are none, those of the solved rigid bodies and skeletons, with a note, for
    they keep their distances whatever the skin does. Markers without a label are left out. A marker that has no name
    of its own, as in ``Thigh:Marker 001``, keeps that of its asset: ``Thigh Marker 001``.

    Raises:
        RecordingError: one line, without the file's name: no markers, no line of axes.
    """
    table = list(csv.reader(lines[:_FIRST]))
    axes = next((i for i, row in enumerate(table) if row and row[0].strip().lower() == "frame"), 0)
    columns = _columns(table, axes)
    chosen = [each for each in columns if each.kind in _MEASURED and not _UNLABELED.match(each.name)]
    unlabelled = sum(each.kind in _MEASURED for each in columns) - len(chosen)
    notes = [f"{unlabelled} markers without a label are left out"] * (unlabelled > 0)
    if not chosen and (chosen := [each for each in columns if each.kind in _SOLVED]):
        notes.append("its markers are those of solved rigid bodies, not the measured ones: export Markers, too")
    if not chosen:
        found = ", ".join(sorted({each.kind for each in columns})) or "no positions"
        raise RecordingError(f"no labelled markers in it, but {found}; export it from Motive with Markers")
    end = max(i for i, line in enumerate(lines, start=1) if line.strip())
    numbers = Rows(lines[axes + 1 : end], axes + 2, ",").numbers(len(table[axes]))
    numbers, lacking = with_all_frames(numbers[:, 0], numbers, axes + 2)
    places = [each.place + axis for each in chosen for axis in range(3)]
    keys = [cell.strip().lower() for cell in table[0]]
    given = dict(zip(keys[::2], table[0][1::2], strict=False))
    return FileContents(
        labels=[_label(each.name) for each in chosen],
        points=as_points(np.ascontiguousarray(numbers[:, places])),
        rate=_rate(given),
        unit=given.get("length units") or None,
        notes=(*notes, *lacking),
    )


class _Position(NamedTuple):
    """Three columns with a position: the number of the first, the type of what is there, and its name."""

    place: int
    kind: str
    name: str


def _columns(table: list[list[str]], axes: int) -> list[_Position]:
    """The positions in a file, by its lines of headers; ``axes`` is the number of the last of them."""
    titles = {row[1].strip().lower(): row for row in table[1:axes] if len(row) > 1 and row[1].strip()}
    if axes < _FEWEST or not {"type", "name"} <= titles.keys():
        raise RecordingError("no lines Type, Name and Frame above the rows; export it from Motive with its header")
    width = len(table[axes])
    kinds, names, holds = (
        [cell.strip() for cell in [*row, *[""] * width][:width]]
        for row in (titles["type"], titles["name"], table[axes - 1])
    )
    axis = [cell.strip().lower() for cell in table[axes]]
    return [
        _Position(i, kinds[i].lower(), names[i])
        for i in range(2, width - 2)
        if axis[i : i + 3] == ["x", "y", "z"] and holds[i].lower() == "position"
    ]


def _label(name: str) -> str:
    """A marker's label; where it is only a number within its asset, the asset's name belongs to it."""
    found = _NUMBERED.match(name)
    return f"{found[1]} {found[2]}" if found else name


def _rate(given: dict[str, str]) -> float | None:
    """Frames per second of the export, or of the capture; None if neither is given."""
    for key in ("export frame rate", "capture frame rate"):
        try:
            return float(given[key])
        except (KeyError, ValueError):
            continue
    return None
