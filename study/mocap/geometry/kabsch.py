"""Kabsch's fit: the rotation and translation that take a rigid template nearest to its points, in every video frame.

The rotation is built from the two leading singular directions; the third follows from right-handedness. So points in
a plane, as three always are, need no special case, and a mirror image is never taken for a rotation. Points that are
missing in a frame do not enter the fit. A frame of four points takes less than a microsecond.

Source: Kabsch 1976, 1978. The cross sums take any fixed point in place of the centroid, for fits about a joint.
"""

import math

import numpy as np

from study.sphere.jit import compiled
from study.sphere.linalg import diagonalise
from study.sphere.types import Bools, Floats

_THIN = 0.03
"""Least extent of points across their main line, as a share of that along it, that fixes the rotation about it."""

Triple = tuple[float, float, float]
"""Three coordinates, as compiled code returns them."""


@compiled
def best_rotation(cross: Floats, square: Floats, vectors: Floats, rotation: Floats) -> bool:
    """Find the rotation (3, 3) that maximises Tr(RᵀH) for ``cross`` = H = Σ x aᵀ.

    ``square`` and ``vectors`` (3, 3) are scratch. Returns False, with ``rotation`` undefined, if H has rank one.
    """
    for i in range(3):
        for j in range(3):
            square[i, j] = cross[0, i] * cross[0, j] + cross[1, i] * cross[1, j] + cross[2, i] * cross[2, j]
    diagonalise(square, vectors)
    if not square[1, 1] > _THIN**4 * square[2, 2]:  # H holds squares of extents, and this is its square
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
    rotation[0, 0] = p0 * a0 + q0 * b0 + r0 * c0
    rotation[0, 1] = p0 * a1 + q0 * b1 + r0 * c1
    rotation[0, 2] = p0 * a2 + q0 * b2 + r0 * c2
    rotation[1, 0] = p1 * a0 + q1 * b0 + r1 * c0
    rotation[1, 1] = p1 * a1 + q1 * b1 + r1 * c1
    rotation[1, 2] = p1 * a2 + q1 * b2 + r1 * c2
    rotation[2, 0] = p2 * a0 + q2 * b0 + r2 * c0
    rotation[2, 1] = p2 * a1 + q2 * b1 + r2 * c1
    rotation[2, 2] = p2 * a2 + q2 * b2 + r2 * c2
    return True


@compiled
def centroids(template: Floats, x: Floats, used: Bools, t: int) -> tuple[int, Triple, Triple]:
    """Count the points used in frame t, and return the means of their template places (m, 3) and of x (m, 3, n)."""
    count, a0, a1, a2, x0, x1, x2 = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(template.shape[0]):
        if used[k, t]:
            count += 1
            a0, a1, a2 = a0 + template[k, 0], a1 + template[k, 1], a2 + template[k, 2]
            x0, x1, x2 = x0 + x[k, 0, t], x1 + x[k, 1, t], x2 + x[k, 2, t]
    share = 1.0 / max(count, 1)
    return count, (share * a0, share * a1, share * a2), (share * x0, share * x1, share * x2)


@compiled
def cross_sums(template: Floats, x: Floats, used: Bools, t: int, a: Triple, b: Triple, cross: Floats) -> None:
    """Put Σ (x - b)(place - a)ᵀ over the points used in frame t into ``cross`` (3, 3)."""
    for i in range(3):
        for j in range(3):
            cross[i, j] = 0.0
    for k in range(template.shape[0]):
        if used[k, t]:
            d0, d1, d2 = template[k, 0] - a[0], template[k, 1] - a[1], template[k, 2] - a[2]
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
def _fit_frame(
    template: Floats, x: Floats, used: Bools, t: int, scratch: Floats, rotation: Floats, origin: Floats
) -> bool:
    """Fit a template (m, 3) to its points x (m, 3, n) in frame t; ``scratch`` is (3, 3, 3).

    Returns False, with ``rotation`` and ``origin`` undefined, if the points used do not fix them.
    """
    cross, square, vectors = scratch[0], scratch[1], scratch[2]
    count, a, b = centroids(template, x, used, t)
    if count < 3:
        return False
    cross_sums(template, x, used, t, a, b, cross)
    if not best_rotation(cross, square, vectors, rotation):
        return False
    for i in range(3):
        origin[i] = b[i] - rotation[i, 0] * a[0] - rotation[i, 1] * a[1] - rotation[i, 2] * a[2]
    return True


@compiled
def _fit_frames(template: Floats, x: Floats, used: Bools, rotations: Floats, origins: Floats, known: Bools) -> None:
    """Fit a template to every frame; see `fit_rigid_motion`."""
    n = x.shape[2]
    scratch, rotation, origin = np.empty((3, 3, 3)), np.empty((3, 3)), np.empty(3)
    for t in range(n):
        known[t] = _fit_frame(template, x, used, t, scratch, rotation, origin)
        for i in range(3):
            origins[i, t] = origin[i] if known[t] else math.nan
            for j in range(3):
                rotations[i, j, t] = rotation[i, j] if known[t] else math.nan


def fit_rigid_motion(template: Floats, x: Floats, used: Bools | None = None) -> tuple[Floats, Floats, Bools]:
    """Fit the pose of a rigid template in every video frame, by least squares.

    Args:
        template: points in the body's own axes (m, 3), metres.
        x: the same points in the world (m, 3, frames), metres; NaN where missing.
        used: samples to use (m, frames); all that are there, if None.

    Returns:
        Rotations R (3, 3, frames) and origins o (3, frames) with x ≈ R a + o, NaN where unknown; and the frames in
        which they are known (frames,), which have three points or more that do not lie on a line.
    """
    present = ~np.isnan(x).any(axis=1)
    n = x.shape[2]
    rotations, origins, known = np.empty((3, 3, n)), np.empty((3, n)), np.empty(n, dtype=np.bool_)
    chosen = present if used is None else present & used
    _fit_frames(np.ascontiguousarray(template), x, np.asarray(chosen), rotations, origins, known)
    return rotations, origins, known
