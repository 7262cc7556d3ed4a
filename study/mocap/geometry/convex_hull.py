"""Distances of joints from the convex hull of the markers, which surround the body.

A joint is inside the body, and so, mostly, inside the hull. A knee or an elbow whose only marker is on its outer side
may leave the hull by up to its own thickness where it is the outermost part of the body: the true joints of synthetic
bodies do so by 2-3 cm in one frame of twenty, and by 4 cm at most. So the distance is reported for every joint, and a
joint is doubted only where it is farther out than any body's.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from study.sphere.types import Floats

_THICKNESS = 0.05
"""Metres: thickness of a limb, beyond which a joint is doubted."""
_QUANTILE = 0.95
"""Share of the frames in which a joint is at most as far outside as reported."""
_FRAMES = 300
"""Most frames used, spread over those that show all markers."""
_FEWEST = 20
"""Fewest frames from which a distance is reported."""


@dataclass(frozen=True)
class HullDistance:
    """Distance of a joint from the hull of the markers.

    Attributes:
        share_outside: share of the frames in which the joint is outside; NaN if too few frames show all markers.
        distance: 95 % quantile over frames of the distance outside the hull, metres; negative inside.
    """

    share_outside: float
    distance: float

    @property
    def doubt(self) -> str:
        """Reason to doubt the joint; "" if there is none."""
        if not self.distance > _THICKNESS:
            return ""
        return (
            f"outside the markers' hull in {self.share_outside:.0%} of the frames, by up to "
            f"{1000 * self.distance:.0f} mm"
        )


def hull_distances(markers: Floats, joints: Floats) -> list[HullDistance]:
    """Measure the distance of each joint from the markers' hull, on frames that show all markers.

    A hull without one of its markers is smaller than the body, so other frames are left out. Markers that are missing
    throughout do not count.

    Args:
        markers: their places (markers, 3, frames), metres; NaN where missing.
        joints: their centres (joints, 3, frames), metres; NaN where unknown.

    Returns:
        A distance for each joint. It is measured to the planes of the hull's facets, so it is a lower bound.
    """
    seen = ~np.isnan(markers[:, 0])
    present = seen.any(axis=1)
    whole = np.flatnonzero(seen[present].all(axis=0)) if present.any() else np.zeros(0, dtype=int)
    part = whole[np.unique(np.linspace(0, len(whole) - 1, min(len(whole), _FRAMES)).astype(int))]
    distances = np.array([_plane_distances(markers[present, :, t], joints[:, :, t]) for t in part])
    return [_summary(row[~np.isnan(row)]) for row in distances.reshape(-1, len(joints)).T]


def _plane_distances(markers: Floats, joints: Floats) -> Floats:
    """Signed distances of joints (joints, 3) from the farthest facet's plane of the markers' hull; NaN without one."""
    try:
        planes = ConvexHull(markers).equations
    except QhullError:  # fewer than four markers, or all in one plane
        return np.full(len(joints), np.nan)
    return np.asarray((joints @ planes[:, :3].T + planes[:, 3]).max(axis=1))


def _summary(distances: Floats) -> HullDistance:
    """Summarise the distances of one joint (frames,)."""
    if len(distances) < _FEWEST:
        return HullDistance(float("nan"), float("nan"))
    return HullDistance(float((distances > 0.0).mean()), float(np.quantile(distances, _QUANTILE)))
