"""Which points of a skeleton are joined by lines, from which joints are fixed in which segment."""

from collections.abc import Sequence

import numpy as np

from study.sphere.types import Floats


def links(fixed: Sequence[Sequence[int]], points: Floats, sides: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Lines that show segments as bones.

    Two joints in one segment make a bone and three a triangle, as in a pelvis. Of four or more, as in a chest, one is
    linked with all others: the one nearest to them, of those on neither side of the body if there are any.

    Args:
        fixed: for each segment the numbers of the joints, and ends of limbs, that are fixed in it.
        points: where they all are (points, 3, frames), metres.
        sides: of each point, "left", "right" or "".

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
    """Sum of the median distances of each point to the others; one that is never known is far."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    distance[np.isnan(distance).all(axis=2)] = 1e3
    return [float(total) for total in np.nanmedian(distance, axis=2).sum(axis=1)]


def side(name: str) -> str:
    """Which side of the body a point is on, as its name says: "left", "right" or "" if it does not."""
    words = name.lower().replace("-", "_").replace(" ", "_").split("_")
    return next((word for word in ("left", "right") if word in words), "")
