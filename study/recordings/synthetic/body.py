"""An articulated body: fifteen rigid segments, the joints between them, and the markers of a set on them.

Its measures and axes are described in ``body.toml``. Sides differ in a few markers that are placed unevenly.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from study.arrays import Floats

Triple = tuple[float, float, float]
Interval = tuple[float, float]
MARKER_SETS = ("cmu41", "rizzoli")
"""Marker sets that the body can wear: 41 markers all over, or the landmarks of trunk and legs."""
_UNEVEN = {"RUPA": -0.110, "RFRM": -0.085, "RTHI": -0.110, "RSHN": -0.150}
"""z of the right side's markers that differ from the left's, in heights."""


@dataclass(frozen=True)
class BodyPart:
    """A segment, its markers, and the joint to its parent; lengths in heights of the body."""

    name: str
    parent: str | None
    joint: str | None
    at: Triple
    """The joint in the parent's axes."""
    ranges: tuple[Interval, Interval, Interval]
    """Range of motion: least and greatest angle about y, x and z, degrees, in this order, about the rotated axes."""
    markers: dict[str, Triple]
    """Each marker in the segment's axes."""
    axis: Triple | None = None
    """Axis of a hinge in the parent's axes; the angle about y is the angle about it, and the other two do not count."""

    @property
    def kind(self) -> str:
        """Ball or hinge."""
        return "ball" if self.axis is None else "hinge"


@cache
def body(markerset: str = "cmu41") -> tuple[BodyPart, ...]:
    """All segments with the markers of one of `MARKER_SETS`, parents before children."""
    tables = tomllib.loads(Path(__file__).with_name("body.toml").read_text(encoding="utf-8"))
    parts = [_part(name, table, markerset) for name, table in tables.items()]
    return (*parts, *(_mirrored(part) for part in parts if part.name.startswith("left_")))


def _part(name: str, table: Mapping[str, Any], markerset: str) -> BodyPart:
    """The segment of a table of ``body.toml``."""
    markers = {label: tuple(place) for label, place in table.get(markerset, {}).items()}
    axis = tuple(table["axis"]) if "axis" in table else None
    about_y, about_x, about_z = map(tuple, table["ranges"])
    at = tuple(table.get("at", (0, 0, 0)))
    return BodyPart(name, table.get("parent"), table.get("joint"), at, (about_y, about_x, about_z), markers, axis)


def _mirrored(part: BodyPart) -> BodyPart:
    """The segment of the right side: rotations about x and z change their sign, as do those components of an axis."""

    def name(text: str | None) -> str | None:
        return text and text.replace("left_", "right_")

    def flip(place: Triple) -> Triple:
        return place[0], -place[1], place[2]

    markers = {}
    for label, place in part.markers.items():
        right = "R" + label[1:]
        x, y, z = flip(place)
        markers[right] = (x, y, _UNEVEN.get(right, z))
    about_y, *others = part.ranges
    about_x, about_z = ((-high, -low) for low, high in others)
    axis = part.axis and (-part.axis[0], part.axis[1], -part.axis[2])
    joint, parent = name(part.joint), name(part.parent)
    return BodyPart(str(name(part.name)), parent, joint, flip(part.at), (about_y, about_x, about_z), markers, axis)


PARTS = body()
"""All segments with the 41 markers of CMU's set, parents before children."""
MARKERS: tuple[str, ...] = tuple(label for part in PARTS for label in part.markers)
JOINTS: tuple[str, ...] = tuple(part.joint for part in PARTS if part.joint)


def unit(axis: Triple) -> Floats:
    """A direction as a unit vector (3,)."""
    vector = np.array(axis, dtype=np.float64)
    length: float = np.linalg.norm(vector).item()
    return vector / length


def nearest_pairs(parts: tuple[BodyPart, ...] = PARTS) -> list[tuple[str, str]]:
    """Each marker with the one nearest to it on the standing body, each pair once; these get swapped."""
    origins: dict[str | None, Floats] = {None: np.zeros(3)}
    for part in parts:
        origins[part.name] = origins[part.parent] + np.array(part.at)
    labels = [label for part in parts for label in part.markers]
    places = np.array([origins[part.name] + np.array(at) for part in parts for at in part.markers.values()])
    distance = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    pairs = {tuple(sorted((i, int(j)))) for i, j in enumerate(distance.argmin(axis=1))}
    return [(labels[i], labels[j]) for i, j in sorted(pairs)]
