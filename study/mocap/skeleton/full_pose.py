"""Least-squares poses of a segment in the frames that show enough of its markers, about its joint where it is known.

Two markers and the joint, or three markers without it, fix the rotation, by Kabsch's fit about the joint instead of
the centroid. A marker that is far from its place in the segment, such as a swapped one, is rejected and the rest are
fitted again. Time is proportional to the number of markers.

Source: paper §10 (second phase); theory §1.2.
"""

import math
from typing import NamedTuple

import numpy as np

from study.mocap.geometry.kabsch import best_rotation, centroids, cross_sums
from study.sphere.jit import compiled
from study.sphere.types import Bools, Floats


class PivotPath(NamedTuple):
    """The joint that a segment rotates about.

    Attributes:
        local: its place in the segment's axes (3,), metres.
        world: its place in the world (3, frames), metres; NaN where it is not known.
    """

    local: Floats
    world: Floats


class SegmentPath(NamedTuple):
    """Poses of a segment, as they are fitted and completed.

    Attributes:
        rotation: R (3, 3, frames), NaN where unknown.
        origin: o (3, frames), metres, NaN where unknown.
        fitted: frames in which enough markers are used to fit the pose (frames,).
        used: samples used (m, frames).
        square: mean square distance of these from their places (frames,), m²; NaN in frames that are not fitted.
    """

    rotation: Floats
    origin: Floats
    fitted: Bools
    used: Bools
    square: Floats


def fit_full_poses(places: Floats, limits: Floats, x: Floats, pivot: PivotPath) -> SegmentPath:
    """Fit a segment's poses in the frames that show enough of its markers.

    Args:
        places: of its markers in its axes (m, 3), metres.
        limits: largest distance of each from there (m,), metres.
        x: the markers in the world (m, 3, frames), metres; NaN where missing.
        pivot: its joint.
    """
    n = x.shape[2]
    path = SegmentPath(
        rotation=np.full((3, 3, n), np.nan),
        origin=np.full((3, n), np.nan),
        fitted=np.zeros(n, dtype=np.bool_),
        used=~np.isnan(x[:, 0]),
        square=np.full(n, np.nan),
    )
    _fit_full_poses(places, limits, x, pivot, path)
    return path


@compiled
def _count(used: Bools, t: int) -> int:
    count = 0
    for k in range(used.shape[0]):
        if used[k, t]:
            count += 1
    return count


@compiled
def _fit_full_poses(places: Floats, limits: Floats, x: Floats, pivot: PivotPath, path: SegmentPath) -> None:
    """Compiled part of `fit_full_poses`."""
    pin, at = pivot
    rotation, origin, fitted, used, square = path
    m, n = used.shape
    cross, scratch, vectors, r = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for t in range(n):
        pinned = at[0, t] == at[0, t]
        fitted[t] = False
        for k in range(m):  # the distance from the joint does not depend on the rotation
            if pinned and used[k, t]:
                wanted = away = 0.0
                for i in range(3):
                    wanted += (places[k, i] - pin[i]) ** 2
                    away += (x[k, i, t] - at[i, t]) ** 2
                if abs(math.sqrt(away) - math.sqrt(wanted)) > limits[k]:
                    used[k, t] = False
        least = 2 if pinned else 3
        count = _count(used, t)
        while count >= least:
            a, b = (pin[0], pin[1], pin[2]), (at[0, t], at[1, t], at[2, t])
            if not pinned:
                _, a, b = centroids(places, x, used, t)
            cross_sums(places, x, used, t, a, b, cross)
            if not best_rotation(cross, scratch, vectors, r):
                break
            o0 = b[0] - r[0, 0] * a[0] - r[0, 1] * a[1] - r[0, 2] * a[2]
            o1 = b[1] - r[1, 0] * a[0] - r[1, 1] * a[1] - r[1, 2] * a[2]
            o2 = b[2] - r[2, 0] * a[0] - r[2, 1] * a[1] - r[2, 2] * a[2]
            worst, which, total = 0.0, -1, 0.0
            for k in range(m):
                if used[k, t]:
                    p0, p1, p2 = places[k, 0], places[k, 1], places[k, 2]
                    f0 = x[k, 0, t] - o0 - r[0, 0] * p0 - r[0, 1] * p1 - r[0, 2] * p2
                    f1 = x[k, 1, t] - o1 - r[1, 0] * p0 - r[1, 1] * p1 - r[1, 2] * p2
                    f2 = x[k, 2, t] - o2 - r[2, 0] * p0 - r[2, 1] * p1 - r[2, 2] * p2
                    far = f0 * f0 + f1 * f1 + f2 * f2
                    total += far
                    if far > worst * limits[k] ** 2:
                        worst, which = far / limits[k] ** 2, k
            if worst > 1.0:
                used[which, t] = False
                count -= 1
                continue
            fitted[t] = True
            square[t] = total / count
            origin[0, t], origin[1, t], origin[2, t] = o0, o1, o2
            for i in range(3):
                for j in range(3):
                    rotation[i, j, t] = r[i, j]
            break
