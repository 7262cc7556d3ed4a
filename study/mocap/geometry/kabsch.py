"""Rigid motion of a few points, frame by frame: the rotation and shift that take a template nearest to its markers.

Kabsch's least squares by the two leading singular directions, the third following from right-handedness: markers in a
plane (three always are) are no special case, and a mirror image is never taken for a rotation. Markers not seen in a
frame have no say in it. One frame of four markers takes less than a microsecond, so that a body fits many times over
between two frames of a camera.

Source: Kabsch 1976, 1978; with a pin, the same about a fixed point instead of the centroid.
"""

import math
from typing import Any

import numpy as np

from study.sphere.jit import compiled
from study.sphere.linalg import diagonalise
from study.sphere.types import Bools, Floats

_THIN = 0.03
"""Points whose extent across their line is below this share of that along it leave the turn about the line open."""


@compiled
def turn(cross: Any, square: Any, vectors: Any, rotation: Any) -> bool:
    """Rotation (3, 3) that maximises Tr(RᵀH) for ``cross`` = H = Σ x aᵀ; False, and garbage, if H has rank one.

    ``square`` and ``vectors`` (3, 3) are room to work in.
    """
    for i in range(3):
        for j in range(3):
            square[i, j] = cross[0, i] * cross[0, j] + cross[1, i] * cross[1, j] + cross[2, i] * cross[2, j]
    diagonalise(square, vectors)
    if not square[1, 1] > _THIN**4 * square[2, 2]:  # H has the extents squared, and this is its square
        return False
    a0, a1, a2 = vectors[0, 2], vectors[1, 2], vectors[2, 2]
    b0, b1, b2 = vectors[0, 1], vectors[1, 1], vectors[2, 1]
    p0 = cross[0, 0] * a0 + cross[0, 1] * a1 + cross[0, 2] * a2
    p1 = cross[1, 0] * a0 + cross[1, 1] * a1 + cross[1, 2] * a2
    p2 = cross[2, 0] * a0 + cross[2, 1] * a1 + cross[2, 2] * a2
    size = 1.0 / math.sqrt(p0 * p0 + p1 * p1 + p2 * p2)
    p0, p1, p2 = p0 * size, p1 * size, p2 * size
    q0 = cross[0, 0] * b0 + cross[0, 1] * b1 + cross[0, 2] * b2
    q1 = cross[1, 0] * b0 + cross[1, 1] * b1 + cross[1, 2] * b2
    q2 = cross[2, 0] * b0 + cross[2, 1] * b1 + cross[2, 2] * b2
    along = p0 * q0 + p1 * q1 + p2 * q2
    q0, q1, q2 = q0 - along * p0, q1 - along * p1, q2 - along * p2
    size = 1.0 / math.sqrt(q0 * q0 + q1 * q1 + q2 * q2)
    q0, q1, q2 = q0 * size, q1 * size, q2 * size
    c0, c1, c2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    r0, r1, r2 = p1 * q2 - p2 * q1, p2 * q0 - p0 * q2, p0 * q1 - p1 * q0
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = (
        p0 * a0 + q0 * b0 + r0 * c0, p0 * a1 + q0 * b1 + r0 * c1, p0 * a2 + q0 * b2 + r0 * c2,
    )  # fmt: skip
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = (
        p1 * a0 + q1 * b0 + r1 * c0, p1 * a1 + q1 * b1 + r1 * c1, p1 * a2 + q1 * b2 + r1 * c2,
    )  # fmt: skip
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = (
        p2 * a0 + q2 * b0 + r2 * c0, p2 * a1 + q2 * b1 + r2 * c1, p2 * a2 + q2 * b2 + r2 * c2,
    )  # fmt: skip
    return True


@compiled
def centroids(places: Any, x: Any, used: Any, t: int) -> Any:
    """How many points count in frame t, and the means of their places (m, 3) and of where they are seen (m, 3, n)."""
    count, a0, a1, a2, x0, x1, x2 = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(places.shape[0]):
        if used[k, t]:
            count += 1
            a0, a1, a2 = a0 + places[k, 0], a1 + places[k, 1], a2 + places[k, 2]
            x0, x1, x2 = x0 + x[k, 0, t], x1 + x[k, 1, t], x2 + x[k, 2, t]
    share = 1.0 / max(count, 1)
    return count, (share * a0, share * a1, share * a2), (share * x0, share * x1, share * x2)


@compiled
def cross_sums(places: Any, x: Any, used: Any, t: int, a: Any, b: Any, cross: Any) -> None:
    """Sum (x - b)(place - a)ᵀ over the points that count in frame t, into ``cross`` (3, 3)."""
    for i in range(3):
        for j in range(3):
            cross[i, j] = 0.0
    for k in range(places.shape[0]):
        if used[k, t]:
            d0, d1, d2 = places[k, 0] - a[0], places[k, 1] - a[1], places[k, 2] - a[2]
            e0, e1, e2 = x[k, 0, t] - b[0], x[k, 1, t] - b[1], x[k, 2, t] - b[2]
            cross[0, 0] += e0 * d0
            cross[0, 1] += e0 * d1
            cross[0, 2] += e0 * d2
            cross[1, 0] += e1 * d0
            cross[1, 1] += e1 * d1
            cross[1, 2] += e1 * d2
            cross[2, 0] += e2 * d0
            cross[2, 1] += e2 * d1
            cross[2, 2] += e2 * d2


@compiled
def place(template: Any, x: Any, used: Any, t: int, work: Any, rotation: Any, origin: Any) -> bool:
    """Rotation (3, 3) and origin (3,) of a template (m, 3) in frame t of its points x (m, 3, n); False if unknown.

    ``used`` (m, n) says which points count; ``work`` (3, 3, 3) is room to work in.
    """
    cross, square, vectors = work[0], work[1], work[2]
    count, a, b = centroids(template, x, used, t)
    if count < 3:
        return False
    cross_sums(template, x, used, t, a, b, cross)
    if not turn(cross, square, vectors, rotation):
        return False
    for i in range(3):
        origin[i] = b[i] - rotation[i, 0] * a[0] - rotation[i, 1] * a[1] - rotation[i, 2] * a[2]
    return True


@compiled
def _motion(template: Any, x: Any, used: Any, rotations: Any, origins: Any, known: Any) -> None:
    n = x.shape[2]
    work, rotation, origin = np.empty((3, 3, 3)), np.empty((3, 3)), np.empty(3)
    for t in range(n):
        known[t] = place(template, x, used, t, work, rotation, origin)
        for i in range(3):
            origins[i, t] = origin[i] if known[t] else math.nan
            for j in range(3):
                rotations[i, j, t] = rotation[i, j] if known[t] else math.nan


def motion(template: Floats, x: Floats, used: Bools | None = None) -> tuple[Floats, Floats, Bools]:
    """Where a rigid template is in each frame.

    Args:
        template: points in the body's own axes (m, 3), metres.
        x: where they were seen (m, 3, frames), metres; NaN where not.
        used: which of them count (m, frames); all that were seen, if None.

    Returns:
        Rotations (3, 3, frames) and origins (3, frames) with x ≈ R a + o, NaN where unknown; and where they are known
        (frames,): with three points or more that do not lie on a line.
    """
    seen = ~np.isnan(x).any(axis=1)
    n = x.shape[2]
    rotations, origins, known = np.empty((3, 3, n)), np.empty((3, n)), np.empty(n, dtype=np.bool_)
    _motion(np.ascontiguousarray(template), x, seen if used is None else seen & used, rotations, origins, known)
    return rotations, origins, known


def into(rotations: Floats, origins: Floats, x: Floats) -> Floats:
    """Points x (…, 3, frames) in moving axes: y = Rᵀ(x - o), of the same shape."""
    away = x - origins
    columns = [
        rotations[0, i] * away[..., 0, :] + rotations[1, i] * away[..., 1, :] + rotations[2, i] * away[..., 2, :]
        for i in range(3)
    ]
    return np.stack(columns, axis=-2)


def out_of(rotations: Floats, origins: Floats, point: Floats) -> Floats:
    """A point fixed in moving axes (3,) - or one per frame (3, frames) - in the world: R p + o, (3, frames)."""
    p = np.asarray(point)
    return np.asarray(rotations[:, 0] * p[0] + rotations[:, 1] * p[1] + rotations[:, 2] * p[2] + origins)


def nearest_rotation(matrix: Floats) -> Floats:
    """The rotation (3, 3) nearest to a matrix (3, 3): of a sum of rotations, their mean."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt)
