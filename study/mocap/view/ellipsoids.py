"""Error ellipsoids of joints as they are drawn: how long, and by which factor they are exaggerated."""

import numpy as np
from scipy.stats import chi2

from study.mocap.skeleton.scene import Scene
from study.sphere.types import Bools, Floats

LEVEL = 0.95
"""How often an ellipsoid holds its joint, if the standard errors are right."""
FACTORS = (1, 2, 3, 5, 10, 20, 30, 50, 100)
_SIZE, _LONGEST = 0.045, 0.4
"""Metres: what a typical ellipsoid's half axis, and the longest, is made no longer than by exaggeration."""


def reach(known: int) -> float:
    """Standard errors from centre to surface, for a joint known in so many directions."""
    return float(np.sqrt(chi2.ppf(LEVEL, known))) if known else 0.0


def half_axes(scene: Scene) -> Floats:
    """Half axes of the ellipsoids (joints, 3), metres; zero along a direction that is not known."""
    known = ~np.isnan(scene.errors)
    reaches = np.array([reach(int(row.sum())) for row in known])
    half: Floats = np.where(known, scene.errors, 0.0) * reaches[:, None]
    return half


def exaggeration(scene: Scene) -> int:
    """The factor by which ellipsoids are drawn larger, so that they are seen."""
    longest = half_axes(scene).max(axis=1)
    longest = longest[longest > 0.0]
    if not len(longest):
        return 1
    most = min(_SIZE / np.median(longest), _LONGEST / longest.max())
    return max([factor for factor in FACTORS if factor <= most], default=1)


def hinges(scene: Scene) -> Bools:
    """Joints that are known across an axis alone (joints,)."""
    found: Bools = np.isnan(scene.errors[:, 2]) & ~np.isnan(scene.errors[:, 0])
    return found
