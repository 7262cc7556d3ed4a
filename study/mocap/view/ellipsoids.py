"""Error ellipsoids of joints: their half axes, and the factor by which they are drawn larger."""

import numpy as np
from scipy.stats import chi2

from study.mocap.skeleton.scene import Scene
from study.sphere.types import Bools, Floats

LEVEL = 0.95
"""Probability that an ellipsoid contains its joint, if the standard errors are right."""
_FACTORS = (1, 2, 3, 5, 10, 20, 30, 50, 100)
_SIZE, _LONGEST = 0.045, 0.4
"""Largest half axis, as drawn, of the median ellipsoid, and of the longest; metres."""


def surface(known: int) -> float:
    """Distance from centre to surface in standard errors, for a joint that is known in this many directions."""
    return float(np.sqrt(chi2.ppf(LEVEL, known))) if known else 0.0


def half_axes(scene: Scene) -> Floats:
    """Half axes of the ellipsoids (joints, 3), metres; zero in a direction without a standard error."""
    known = ~np.isnan(scene.errors)
    factors = np.array([surface(int(row.sum())) for row in known])
    half: Floats = np.where(known, scene.errors, 0.0) * factors[:, None]
    return half


def exaggeration(scene: Scene) -> int:
    """The factor by which ellipsoids are drawn larger, so that they are visible."""
    longest = half_axes(scene).max(axis=1)
    longest = longest[longest > 0.0]
    if not len(longest):
        return 1
    most = min(_SIZE / np.median(longest), _LONGEST / longest.max())
    return max([factor for factor in _FACTORS if factor <= most], default=1)


def hinges(scene: Scene) -> Bools:
    """True for joints that are known across an axis, but not along it (joints,)."""
    found: Bools = np.isnan(scene.errors[:, 2]) & ~np.isnan(scene.errors[:, 0])
    return found
