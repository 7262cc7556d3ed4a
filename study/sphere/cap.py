"""Directions uniform by area on a spherical cap, in any dimension d ≥ 2.

A direction is u = (1 - t, √(t(2 - t)) w): its height t = 1 - cos θ below the pole, and a unit vector w across the
axis. The height comes from one uniform number through the inverse of its distribution; w is a normalised vector of
d - 1 normals (a sign, where d = 2). Heights are kept instead of cosines, so nothing is lost at tiny angles: 1 - cos φ
is formed as 2 sin²(φ/2), never by subtraction.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from study.sphere.compiled import compiled, fill
from study.sphere.normals import fill_normal, loaded

Floats = NDArray[np.float64]


def heights(uniform: Floats, half_angle: float, dimension: int) -> Floats:
    """Turn uniform numbers into heights t = 1 - cos θ of directions uniform on a cap.

    Args:
        uniform: numbers in [0, 1), any shape.
        half_angle: φ in radians, 0 < φ ≤ π.
        dimension: d ≥ 2.

    Returns:
        Heights in [0, 1 - cos φ], in the shape of ``uniform``. t/2 follows a Beta((d-1)/2, (d-1)/2) law cut off
        at sin²(φ/2); in three dimensions that is uniform (Archimedes).
    """
    if dimension == 2:
        return np.asarray(2.0 * np.sin(0.5 * half_angle * uniform) ** 2)
    top = math.sin(0.5 * half_angle) ** 2
    if dimension == 3:
        return np.asarray(2.0 * top * uniform)
    k = 0.5 * (dimension - 1)
    return np.asarray(2.0 * special.betaincinv(k, k, uniform * special.betainc(k, k, top)))


@compiled
def _turn(height: Any, directions: Any) -> None:
    """Directions (d, n) from their heights (n,) and, in rows 1 to d - 1, normals across the axis; in place.

    Row 0 receives the height t = 1 - u₁ in place of u₁.
    """
    d, n = directions.shape
    scale = directions[0]
    fill(scale, 0.0)
    for i in range(1, d):
        w = directions[i]
        for k in range(n):
            scale[k] += w[k] * w[k]
    for k in range(n):
        scale[k] = math.sqrt(height[k] * (2.0 - height[k]) / scale[k])
    for i in range(1, d):
        w = directions[i]
        for k in range(n):
            w[k] *= scale[k]
    for k in range(n):
        scale[k] = height[k]


@compiled
def draw(state: Any, height: Any, directions: Any, normals: Any) -> None:
    """Draw a block of trials: directions (b, d, n) for given heights (b, n), and standard normals (b, d, n).

    Trial after trial from one stream, whose state (see `study.sphere.normals.state_of`) is moved on, so that a block's
    first trials do not depend on how many follow. Row 0 of the directions receives the height t = 1 - u₁ instead of u₁.
    """
    b, d, _ = directions.shape
    place = loaded(state)
    for trial in range(b):
        for i in range(1, d):
            place = fill_normal(place, directions[trial, i])
        _turn(height[trial], directions[trial])
        for i in range(d):
            place = fill_normal(place, normals[trial, i])
    state[0], state[1], state[2], state[3] = place


def sample_cap(
    rng: np.random.Generator, count: int, half_angle: float, dimension: int = 3, axis: ArrayLike | None = None
) -> Floats:
    """Draw unit vectors uniform by area (by arc length, if d = 2) within an angle of an axis.

    Args:
        rng: the generator to draw from.
        count: number of directions n.
        half_angle: φ in radians, 0 < φ ≤ π.
        dimension: d ≥ 2.
        axis: the cap's pole (d,), of any length; the first coordinate axis by default.

    Returns:
        Directions (n, d).

    Raises:
        ValueError: if the angle, the dimension or the axis is out of range.
    """
    if not 0.0 < half_angle <= math.pi:
        raise ValueError(f"half_angle = {half_angle!r}: give an angle in radians in (0, π]")
    if dimension < 2:
        raise ValueError(f"dimension = {dimension!r}: a sphere needs at least 2")
    t = heights(rng.random(count), half_angle, dimension)
    u = np.empty((dimension, count))
    rng.standard_normal(out=u[1:])
    _turn(t, u)
    u[0] = 1.0 - t
    points: Floats = u.T
    if axis is None:
        return points
    pole = np.asarray(axis, dtype=float)
    length = float(np.linalg.norm(pole))
    if pole.shape != (dimension,) or not (math.isfinite(length) and length > 0.0):
        raise ValueError(f"axis = {axis!r}: give a finite vector of {dimension} components that is not zero")
    # Householder reflection that takes e₁ to the pole; added, not subtracted, where that would cancel
    sign = -1.0 if pole[0] > 0.0 else 1.0
    normal = pole / length
    normal[0] -= sign
    normal /= np.linalg.norm(normal)
    return sign * (points - 2.0 * np.outer(points @ normal, normal))


class CapMoments(NamedTuple):
    """Moments of directions uniform on a cap."""

    mean: float
    along: float
    across: float


def cap_moments(half_angle: float, dimension: int) -> CapMoments:
    """Mean m₁ and variances Kₐ along the axis, Kₚ across it.

    Args:
        half_angle: φ in radians.
        dimension: d ≥ 2.

    They follow from the moments of the height by quadrature, without cancellation at small angles.
    """
    nodes, weights = special.roots_legendre(64)
    theta = 0.5 * half_angle * (nodes + 1.0)
    share = weights * np.sin(theta) ** (dimension - 2)
    share /= share.sum()
    height = 2.0 * np.sin(0.5 * theta) ** 2
    mean = float(share @ height)
    across = float(share @ np.sin(theta) ** 2) / (dimension - 1)
    return CapMoments(1.0 - mean, float(share @ (height - mean) ** 2), across)
