"""How far joints are outside the markers' convex hull: markers are on the body, and joints are in it.

But a knee or an elbow with one marker, on its outer side, is outside the hull by up to its thickness where it is the
outermost of the body: true ones of synthetic bodies by 2-3 cm in one frame of twenty, by 4 at most. So being outside is
stated for every joint, and held against one only where no body would be.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from study.sphere.types import Floats

_THICK = 0.05
"""Metres: a limb's thickness."""
_MOSTLY = 0.95
_FRAMES = 300
"""Frames that are looked at, of those that show all markers, and..."""
_LEAST = 20
"""...how few of them say nothing."""


@dataclass(frozen=True)
class Outside:
    """Where a joint is against the markers' hull.

    Attributes:
        share: of the frames in which it is outside; NaN if too few frames show all markers.
        far: how far outside it is in 95 % of the frames at most, metres; negative inside.
    """

    share: float
    far: float

    @property
    def words(self) -> str:
        """Why to doubt the joint; "" if there is no need."""
        if not self.far > _THICK:
            return ""
        return f"outside the markers' hull in {self.share:.0%} of the frames, by up to {1000 * self.far:.0f} mm"


def outside(places: Floats, centers: Floats) -> list[Outside]:
    """How far each joint is outside the hull of the markers, on frames spread over those that show all of them.

    Without a marker the hull is smaller than the body; markers that are never seen are left out.

    Args:
        places: of markers (markers, 3, frames), metres, NaN where not seen.
        centers: of joints (joints, 3, frames), metres, NaN where not known.

    Returns:
        For each joint; distances are to the planes of the hull's facets, so at least as large in truth.
    """
    seen = ~np.isnan(places[:, 0])
    there = seen.any(axis=1)
    whole = np.flatnonzero(seen[there].all(axis=0)) if there.any() else np.zeros(0, dtype=int)
    part = whole[np.unique(np.linspace(0, len(whole) - 1, min(len(whole), _FRAMES)).astype(int))]
    distances = np.array([_distances(places[there, :, t], centers[:, :, t]) for t in part]).reshape(-1, len(centers))
    return [_summed(row[~np.isnan(row)]) for row in distances.T]


def _distances(markers: Floats, joints: Floats) -> Floats:
    """Distances of joints (joints, 3) from the farthest facet's plane of the markers' hull; NaN if they have none."""
    try:
        planes = ConvexHull(markers).equations
    except QhullError:  # fewer than four markers, or all in one plane
        return np.full(len(joints), np.nan)
    return np.asarray((joints @ planes[:, :3].T + planes[:, 3]).max(axis=1))


def _summed(distances: Floats) -> Outside:
    if len(distances) < _LEAST:
        return Outside(float("nan"), float("nan"))
    return Outside(float((distances > 0.0).mean()), float(np.quantile(distances, _MOSTLY)))
