"""Bones of a skeleton: the lines between its joints and ends of limbs, from the segments that they are fixed in."""

import re
from collections.abc import Sequence

import numpy as np

from study.sphere.types import Floats


def bones(fixed: Sequence[Sequence[int]], points: Floats, sides: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Choose the lines that show segments as bones.

    Two points in one segment make a bone and three a triangle, as in a pelvis. Of four or more, as in a chest, one is
    linked with all others: the one nearest to them, of those on neither side of the body if there are any.

    Args:
        fixed: for each segment, the numbers of the joints and ends of limbs that are fixed in it.
        points: their places (points, 3, frames), metres.
        sides: side of each point, "left", "right" or "".

    Returns:
        Pairs of numbers, each once.
    """
    found: dict[tuple[int, int], None] = {}
    for group in fixed:
        pairs = [(i, j) for place, i in enumerate(group) for j in group[place + 1 :]]
        if len(group) > 3:
            total = dict(zip(group, _distances(points[list(group)]), strict=True))
            middle = min(group, key=lambda i: (sides[i] != "", total[i]))
            pairs = [(middle, other) for other in group if other != middle]
        found |= dict.fromkeys(pairs)
    return tuple(found)


def _distances(points: Floats) -> list[float]:
    """Sum of the median distances of each point to the others, metres; large for one that is never known."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    distance[np.isnan(distance).all(axis=2)] = 1e3
    return [float(total) for total in np.nanmedian(distance, axis=2).sum(axis=1)]


def side(name: str) -> str:
    """Side of the body that a point's name shows: "left", "right", or "" if it shows none."""
    words = name.lower().replace("-", "_").replace(" ", "_").split("_")
    return next((word for word in ("left", "right") if word in words), "")


def mirrored(name: str) -> str:
    """A joint's name on the other side of the body, with its capitals; the same if it tells no side."""
    own = side(name)
    return re.sub(rf"(?<![^_ -])({own})(?![^_ -])", _other_side, name, flags=re.IGNORECASE) if own else name


def _other_side(word: re.Match[str]) -> str:
    found = word[0]
    other = "right" if found.lower() == "left" else "left"
    return other.upper() if found.isupper() else other.capitalize() if found[0].isupper() else other
