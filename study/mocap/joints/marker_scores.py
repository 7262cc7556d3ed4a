"""Scores of a joint's centre: the contribution of each frame to the equations that define the centre and its noise.

The centre's covariance follows from them, for any correlation in time (`long_run_covariance`).
"""

from typing import NamedTuple

import numpy as np

from study.mocap.geometry.pose_noise import PatternNoise, covariance_of_sample
from study.mocap.joints.marker_moments import MarkerMoments
from study.sphere.jit import compiled
from study.sphere.types import Bools, Floats


def add_scores(
    moments: MarkerMoments, size: float, center: Floats, within: Floats, weight: float, scores: Floats
) -> None:
    """Add a marker's part of the estimating functions of (c, η), frame by frame.

    They are ½ z f + η (F (o - z) - ½ Tr F z) for the centre, with o = c - x̄, and f² - 4η vᵀFv + 2η² Tr F² (as in
    `squared_noise`) for the size, with v = z - o and f = |v|² less its mean. Both sum to zero at the solution.

    Args:
        moments: of the marker.
        size: variance η of the noise, in units of what was expected.
        center: c (3,).
        within: projection (3, 3) of o: onto the plane across an axis, or the identity.
        weight: of the marker.
        scores: receives the scores (4, frames).
    """
    offset, squared = within @ (center - moments.mean), moments.squared_noise(center)
    solution = _Solution(size, offset, moments.mean, squared, weight)
    _add_scores(moments.z, moments.used, moments.by_pattern, solution, scores)


class _Solution(NamedTuple):
    """A solution about which scores are computed, for one marker; ``squared`` is its `squared_noise`."""

    size: float
    offset: Floats
    mean: Floats
    squared: float
    weight: float


@compiled
def _add_scores(z: Floats, used: Bools, noise: PatternNoise, solution: _Solution, scores: Floats) -> None:
    """Compiled part of `add_scores`."""
    size, offset, mean, squared, weight = solution
    pattern, centroid = noise.pattern, noise.centroid
    n = z.shape[1]
    level, count = 0.0, 0.0
    for t in range(n):
        if pattern[t] >= 0 and used[t]:
            count += 1.0
            level += (z[0, t] - offset[0]) ** 2 + (z[1, t] - offset[1]) ** 2 + (z[2, t] - offset[2]) ** 2
    level /= count
    f = np.empty((3, 3))
    for t in range(n):
        p = pattern[t]
        if p < 0 or not used[t]:
            continue
        x0, x1, x2 = z[0, t] + mean[0], z[1, t] + mean[1], z[2, t] + mean[2]
        covariance_of_sample(x0 - centroid[p, 0], x1 - centroid[p, 1], x2 - centroid[p, 2], noise, p, f)
        v0, v1, v2 = z[0, t] - offset[0], z[1, t] - offset[1], z[2, t] - offset[2]
        residual = v0 * v0 + v1 * v1 + v2 * v2 - level
        trace, along = f[0, 0] + f[1, 1] + f[2, 2], 0.0
        for i in range(3):
            fv = f[i, 0] * v0 + f[i, 1] * v1 + f[i, 2] * v2
            along += fv * (z[i, t] - offset[i])
            scores[i, t] += weight * (0.5 * z[i, t] * residual - size * (fv + 0.5 * trace * z[i, t]))
        scores[3, t] += weight * (residual * residual - 4.0 * size * along + 2.0 * size * size * squared)
