"""Poses of a segment over time: least squares in the frames that show enough of its markers, completed in the others.

Two markers and the joint, or three markers without it, fix the rotation, by Kabsch's fit about the joint instead of the
centroid. A marker that is far from its place in the segment, such as a swapped one, is rejected and the rest are fitted
again. Time is proportional to the number of markers.

In a frame with too few markers, those that are left show a direction. The segment is rotated from its expected pose by
the shortest arc that takes the expected direction to the one seen; the rotation about that direction is the expected
one.

Source: paper §10 (second phase); theory §1.2.
"""

import math
from typing import NamedTuple

import numpy as np

from study.arrays import Bools, Floats
from study.fits.jit import compiled
from study.recordings.rigid import best_rotation, centroids, cross_sums


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


def fit_full_poses(places: Floats, limits: Floats, x: Floats, local: Floats, world: Floats) -> SegmentPath:
    """Fit a segment's poses in the frames that show enough of its markers.

    Args:
        places: of its markers in its axes (m, 3), metres.
        limits: largest distance of each from there (m,), metres.
        x: the markers in the world (m, 3, frames), metres; NaN where missing.
        local: the place of its joint in its axes (3,), metres.
        world: the place of its joint in the world (3, frames), metres; NaN where it is not known.
    """
    n = x.shape[2]
    path = SegmentPath(
        rotation=np.full((3, 3, n), np.nan),
        origin=np.full((3, n), np.nan),
        fitted=np.zeros(n, dtype=np.bool_),
        used=~np.isnan(x[:, 0]),
        square=np.full(n, np.nan),
    )
    _fit_full_poses(places, limits, x, local, world, path)
    return path


@compiled
def _count(used: Bools, t: int) -> int:
    count = 0
    for k in range(used.shape[0]):
        if used[k, t]:
            count += 1
    return count


@compiled
def _fit_full_poses(places: Floats, limits: Floats, x: Floats, pin: Floats, at: Floats, path: SegmentPath) -> None:
    """Compiled part of `fit_full_poses`."""
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


_HALF_TURN = -0.999999
"""Cosine of the arc below which its plane is undefined, so that the expected rotation is kept."""


@compiled
def _rotate_by_arc(u: Floats, v: Floats, r: Floats) -> None:
    """Rotate r (3, 3), in place, by the shortest arc that takes the direction u (3,) to v (3,)."""
    uu = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    vv = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if not (uu > 0.0 and vv > 0.0):
        return
    c = (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) / (uu * vv)
    if c < _HALF_TURN:
        return
    w0 = (u[1] * v[2] - u[2] * v[1]) / (uu * vv)
    w1 = (u[2] * v[0] - u[0] * v[2]) / (uu * vv)
    w2 = (u[0] * v[1] - u[1] * v[0]) / (uu * vv)
    h = 1.0 / (1.0 + c)
    for j in range(3):
        a, b, d = r[0, j], r[1, j], r[2, j]
        along = h * (w0 * a + w1 * b + w2 * d)
        r[0, j] = c * a + w1 * d - w2 * b + along * w0
        r[1, j] = c * b + w2 * a - w0 * d + along * w1
        r[2, j] = c * d + w0 * b - w1 * a + along * w2


def complete_poses(places: Floats, x: Floats, local: Floats, world: Floats, expected: Floats) -> tuple[Floats, Floats]:
    """Complete a segment's poses in frames that show too few of its markers.

    Args:
        places: of its markers in its axes (m, 3), metres.
        x: the markers in the world (m, 3, w), metres; NaN where missing.
        local: the place of its joint in its axes (3,), metres.
        world: the place of its joint in the world (3, w), metres; NaN where it is not known. Without a joint, the first
            marker takes its place.
        expected: rotations that are expected (3, 3, w).

    Returns:
        Rotations (3, 3, w) and origins (3, w); NaN where neither a joint nor a marker is seen.
    """
    rotation, origin = np.array(expected), np.full(world.shape, np.nan)
    _complete_poses(places, x, local, world, rotation, origin)
    return rotation, origin


@compiled
def _complete_poses(places: Floats, x: Floats, pin: Floats, at: Floats, rotation: Floats, origin: Floats) -> None:
    """Compiled part of `complete_poses`: rotates the expected rotations in place."""
    u, v, a, b, r = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    for t in range(x.shape[2]):
        pinned, count = at[0, t] == at[0, t], 0
        for i in range(3):
            a[i], b[i], u[i], v[i] = pin[i], at[i, t], 0.0, 0.0
            for j in range(3):
                r[i, j] = rotation[i, j, t]
        for k in range(x.shape[0]):
            if x[k, 0, t] == x[k, 0, t]:
                count += 1
                if count == 1 and not pinned:
                    for i in range(3):
                        a[i], b[i] = places[k, i], x[k, i, t]
                for i in range(3):
                    v[i] += x[k, i, t] - b[i]
                    u[i] += (
                        r[i, 0] * (places[k, 0] - a[0])
                        + r[i, 1] * (places[k, 1] - a[1])
                        + r[i, 2] * (places[k, 2] - a[2])
                    )
        if count > 0:
            _rotate_by_arc(u, v, r)
        for i in range(3):
            if pinned or count > 0:
                origin[i, t] = b[i] - r[i, 0] * a[0] - r[i, 1] * a[1] - r[i, 2] * a[2]
            for j in range(3):
                rotation[i, j, t] = r[i, j]
