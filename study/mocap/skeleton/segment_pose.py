"""A segment turned onto what is seen of it, frame by frame: about its joint where that is known, else freely.

Two markers beside the joint, or three without it, fix the turn: Kabsch's least squares, about the joint instead of the
centroid. A marker that is far from where the body has it - swapped, or another's - is left out, and the rest fitted
anew. With fewer markers only a direction is seen: the segment is turned from where it is expected to be by the
shortest arc, and its twist is inherited. Time is proportional to the number of markers.

Source: paper §10 (second phase); theory §1.2.
"""

import math
from typing import Any

import numpy as np

from study.mocap.geometry.kabsch import centroids, cross_sums, turn
from study.sphere.jit import compiled
from study.sphere.types import Bools, Floats, Ints


@compiled
def _count(used: Any, t: int) -> int:
    count = 0
    for k in range(used.shape[0]):
        if used[k, t]:
            count += 1
    return count


@compiled
def _follow(
    places: Any, limits: Any, x: Any, used: Any, pin: Any, at: Any, rotation: Any, origin: Any, full: Any, square: Any
) -> None:
    """Turns of a segment in the frames that show it fully; see `follow`."""
    m, n = used.shape
    cross, room, vectors, r = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for t in range(n):
        pinned = at[0, t] == at[0, t]
        full[t] = False
        for k in range(m):  # the distance from the joint does not depend on the turn
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
            if not turn(cross, room, vectors, r):
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
            full[t] = True
            square[t] = total / count
            origin[0, t], origin[1, t], origin[2, t] = o0, o1, o2
            for i in range(3):
                for j in range(3):
                    rotation[i, j, t] = r[i, j]
            break


def follow(
    places: Floats, limits: Floats, x: Floats, pin: Floats, at: Floats
) -> tuple[Floats, Floats, Bools, Bools, Floats]:
    """Turns and places of a segment in the frames that show it fully.

    Args:
        places: of its markers in its axes (m, 3), metres.
        limits: how far each may be from there (m,), metres.
        x: where they were seen (m, 3, frames), NaN where not.
        pin: the joint in its axes (3,).
        at: where that is (3, frames), NaN where it is not known.

    Returns:
        Rotation (3, 3, frames) and origin (3, frames), NaN where too little is seen; where they are known (frames,);
        which samples were used (m, frames); mean square distance of these from where they should be (frames,), m².
    """
    n = x.shape[2]
    rotation, origin, square = np.full((3, 3, n), np.nan), np.full((3, n), np.nan), np.full(n, np.nan)
    used, full = ~np.isnan(x[:, 0]), np.zeros(n, dtype=np.bool_)
    _follow(places, limits, x, used, pin, at, rotation, origin, full, square)
    return rotation, origin, full, used, square


@compiled
def _arc(u: Any, v: Any, r: Any) -> None:
    """Turn r (3, 3), in place, by the shortest arc that takes the direction u (3,) to v (3,)."""
    uu = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    vv = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if not (uu > 0.0 and vv > 0.0):
        return
    c = (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) / (uu * vv)
    if c < -0.999999:  # any half turn would do: the expected place says nothing
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


@compiled
def _point(
    places: Any,
    x: Any,
    used: Any,
    pin: Any,
    at: Any,
    wanted: Any,
    expected: Any,
    start: Any,
    rotation: Any,
    origin: Any,
) -> None:
    """Turns of a segment in frames that show it in part, or not at all; see `point`."""
    m = used.shape[0]
    u, v, a, b, r = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    for w in range(len(wanted)):
        t = wanted[w]
        pinned, count = at[0, t] == at[0, t], 0
        for i in range(3):
            a[i], b[i] = pin[i], at[i, t]
            for j in range(3):
                r[i, j] = expected[i, j, w]
        for k in range(m):
            if used[k, t]:
                count += 1
                if count == 1:
                    for i in range(3):  # without a joint, the first marker stands for it
                        a[i], b[i] = (pin[i], at[i, t]) if pinned else (places[k, i], x[k, i, t])
                        v[i] = 0.0
                        u[i] = 0.0
                for i in range(3):
                    v[i] += x[k, i, t] - b[i]
                    u[i] += (
                        r[i, 0] * (places[k, 0] - a[0])
                        + r[i, 1] * (places[k, 1] - a[1])
                        + r[i, 2] * (places[k, 2] - a[2])
                    )
        if count > 0:
            _arc(u, v, r)
        for i in range(3):
            if pinned or count > 0:
                origin[i, t] = b[i] - r[i, 0] * a[0] - r[i, 1] * a[1] - r[i, 2] * a[2]
            else:
                origin[i, t] = start[i, w]
            for j in range(3):
                rotation[i, j, t] = r[i, j]


def point(
    places: Floats, x: Floats, used: Bools, pin: Floats, at: Floats, wanted: Ints, expected: Floats,
    start: Floats, rotation: Floats, origin: Floats,
) -> None:  # fmt: skip
    """Complete a segment's turns and places, in place, in frames that show it in part, or not at all.

    Args:
        places: of its markers in its axes (m, 3), metres.
        x: where they were seen (m, 3, frames).
        used: which of these count (m, frames).
        pin: the joint in its axes (3,).
        at: where that is (3, frames), NaN where it is not known.
        wanted: numbers of the frames to complete (w,).
        expected: how it would be turned there if nothing were seen (3, 3, w).
        start: where its origin would be (3, w), if it had no joint either.
        rotation: what is completed (3, 3, frames).
        origin: the same (3, frames).
    """
    _point(places, x, used, pin, at, wanted, expected, start, rotation, origin)
