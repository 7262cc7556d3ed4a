"""Directions uniform by area on a spherical cap, in any dimension d ≥ 2.

A direction is u = (1 - t, √(t(2 - t)) w): its height t = 1 - cos θ below the pole, and a unit vector w across the
axis. The height comes from one uniform number through the inverse of its distribution; w is a sign in two dimensions,
a point of the circle by its angle in three, and a normalised vector of d - 1 normals in more. Heights stand in
for cosines, so no digit is lost at tiny angles: 1 - cos φ is formed as 2 sin²(φ/2), never by subtraction.

The moments of such directions, their mean and variances along the axis and across it, stand here too.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from study.arrays import Floats, Words
from study.fits.loops.jit import CHUNK, aligned, compiled, compiled_as_written, fma
from study.fits.loops.random import LANES, fill_words, from_one, put_back, spare, to_normals, to_uniform

_EIGHTH = 0.125 * math.pi
_S3, _S5, _S7, _S9, _S11, _S13 = ((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 7))
_C2, _C4, _C6, _C8, _C10, _C12 = ((-1.0) ** k / math.factorial(2 * k) for k in range(1, 7))
"""Terms of sine and cosine; the next ones are below 3e-17 up to π/8."""
_1, _2, _4 = (np.uint64(k) for k in (1, 2, 4))


_FLAT = 1e-280
"""Share of the sphere's area below which a cap is flat; shares of that are still ordinary numbers."""


_PIECES = 4096
"""Pieces of a table of heights: so many keep the spline's error below 2e-13 in up to ten dimensions, 1e-10 in 50."""


def heights(uniform: Floats, half_angle: float, dimension: int) -> Floats:
    """Turn uniform numbers into heights t = 1 - cos θ of directions uniform on a cap; in place.

    Args:
        uniform: numbers in [0, 1), any shape.
        half_angle: φ in radians, 0 < φ ≤ π.
        dimension: d ≥ 2.

    Returns:
        Heights in [0, 1 - cos φ], in the shape of ``uniform``. t/2 follows a Beta((d-1)/2, (d-1)/2) law cut off
        at sin²(φ/2); in three dimensions that is uniform (Archimedes), in more its quantile is interpolated. A cap
        whose share of the sphere is below 1e-280 is taken as flat, which in up to 50 dimensions is right to 1e-12.
    """
    top, a = math.sin(0.5 * half_angle) ** 2, 0.5 * (dimension - 1)
    if dimension == 2:
        uniform[...] = 2.0 * np.sin(0.5 * half_angle * uniform) ** 2
    elif dimension == 3:
        uniform *= 2.0 * top
    elif (share := scipy.special.betainc(a, a, top)) > _FLAT:
        near, far = share * uniform, share * (1.0 - uniform) + scipy.special.betaincc(a, a, top)
        height = _cap_height(np.minimum(near, far), dimension)  # from the nearer pole, to keep digits
        uniform[...] = np.minimum(np.where(near <= far, height, 2.0 - height), 2.0 * top)
    else:
        uniform[...] = 2.0 * top * uniform ** (1.0 / a)
    return uniform


def _cap_height(share: Floats, dimension: int) -> Floats:
    """Height of the cap that has a share ≤ ½ of the sphere's area."""
    q = (2.0 * share) ** (2.0 / (dimension - 1))
    place = q * _PIECES
    piece = np.minimum(place.astype(np.intp), _PIECES - 1)
    place -= piece
    cubic, square, linear, constant = _height_ratios(dimension)
    ratio = cubic[piece]
    for factor in (square, linear, constant):
        ratio *= place
        ratio += factor[piece]
    q *= ratio
    return q


@cache
def _height_ratios(dimension: int) -> Floats:
    """Coefficients (4, pieces) of the spline through t/q, where q = (2 share)^(2/(d-1)), the highest power first.

    q is the height itself on a flat cap, up to a factor, so the ratio is smooth and the height relatively accurate.
    """
    a, q = 0.5 * (dimension - 1), np.linspace(0.0, 1.0, _PIECES + 1)
    share = 0.5 * q**a
    ratio = np.full(q.size, 2.0 * (0.5 * a * scipy.special.beta(a, a)) ** (1.0 / a))  # its limit at the pole
    ratio[share > _FLAT] = 2.0 * scipy.special.betaincinv(a, a, share[share > _FLAT]) / q[share > _FLAT]
    pieces: Floats = scipy.interpolate.CubicSpline(np.arange(q.size), ratio).c
    return pieces


@compiled
def _to_sign(words: Words, row: Floats) -> None:
    """Write -1 or 1, by a bit that uniform numbers do not use."""
    for k in range(row.size):
        row[k] = 1.0 if words[k] & _1 else -1.0


@compiled_as_written
def _circle_point(word: np.uint64) -> tuple[float, float]:
    """A point of the unit circle: half an angle in [0, π/8), its sine and cosine doubled, and three mirrors."""
    half = _EIGHTH * (from_one(word) - 1.0)
    q = half * half
    sine = fma(q, fma(q, fma(q, fma(q, fma(q, _S13, _S11), _S9), _S7), _S5), _S3)
    sine = fma(half * q, sine, half)
    cosine = fma(q, fma(q, fma(q, fma(q, fma(q, _C12, _C10), _C8), _C6), _C4), _C2)
    cosine = fma(q, cosine, 1.0)
    sine, cosine = 2.0 * sine * cosine, fma(-2.0 * sine, sine, 1.0)
    across, along = (sine, cosine) if word & _1 else (cosine, sine)
    return across if word & _2 else -across, along if word & _4 else -along


@compiled_as_written
def _to_cap(words: Words, height: float, t: Floats, x: Floats, y: Floats) -> None:
    """Write directions in three dimensions, from two words each: a uniform number times ``height``, and the rest."""
    for k in range(t.size):
        t[k] = (from_one(words[k]) - 1.0) * height
        length = math.sqrt(t[k] * (2.0 - t[k]))
        across, along = _circle_point(words[t.size + k])
        x[k], y[k] = across * length, along * length


@compiled
def draw_block(state: Words, height: float, directions: Floats, normals: Floats) -> None:
    """Draw the numbers that directions are made of, and normal numbers.

    Row 0 of the directions receives uniform numbers times ``height``, the others vectors across the axis: those of the
    directions in three dimensions, of length 1 in two, and normal numbers in more.
    """
    b, d, n = directions.shape
    per_sample = d + (d - 1 if d < 4 else d)
    words, lane = aligned(per_sample * CHUNK).view(np.uint64), spare(state)
    outside = aligned(CHUNK).view(np.int64)
    for trial in range(b):
        for start in range(0, n, CHUNK):
            m = min(CHUNK, n - start)
            fill_words(state, words[: -(-per_sample * m // LANES) * LANES])
            t, across = directions[trial, 0, start : start + m], directions[trial, 1, start : start + m]
            used = m
            if d == 3:
                _to_cap(words, height, t, across, directions[trial, 2, start : start + m])
                used += m
            else:
                to_uniform(words, t)
            if d == 2:
                _to_sign(words, across)
            elif d > 3:
                for i in range(1, d):
                    lane = to_normals(words[used:], directions[trial, i, start : start + m], lane, outside)
                    used += m
            for i in range(d):
                lane = to_normals(words[used:], normals[trial, i, start : start + m], lane, outside)
                used += m
    put_back(state, lane)


def top(half_angle: float, dimension: int) -> float:
    """The largest height where heights are uniform, so that they are formed directly; 1 where they are not."""
    return float(heights(np.ones(1), half_angle, dimension)[0]) if dimension == 3 else 1.0


def draw(state: Words, half_angle: float, directions: Floats, normals: Floats) -> None:
    """Draw a block of trials: directions uniform on a cap, and standard normals.

    Trial after trial, so that a block's first trials do not depend on how many follow.

    Args:
        state: state of the generators, see `study.fits.loops.random`; it is advanced.
        half_angle: φ in radians, 0 < φ ≤ π.
        directions: receives directions (b, d, n) about the first axis, with the height t = 1 - u₁ in place of u₁.
        normals: receives numbers (b, d, n).
    """
    d = directions.shape[1]
    draw_block(state, top(half_angle, d), directions, normals)
    if d != 3:
        t, across = heights(directions[:, 0], half_angle, d), directions[:, 1:]
        across *= (np.sqrt(t * (2.0 - t)) / np.sqrt((across * across).sum(axis=1)))[:, None]


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
    across = rng.standard_normal((dimension - 1, count))
    across *= np.sqrt(t * (2.0 - t)) / np.linalg.norm(across, axis=0)
    u = np.vstack([1.0 - t, across])
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
    nodes, weights = scipy.special.roots_legendre(64)
    theta = 0.5 * half_angle * (nodes + 1.0)
    widest = math.sin(min(half_angle, 0.5 * math.pi))  # in its power of two, high powers do not vanish
    share = weights * np.ldexp(np.sin(theta), -math.frexp(widest)[1]) ** (dimension - 2)
    share /= share.sum()
    height = 2.0 * np.sin(0.5 * theta) ** 2
    mean = float(share @ height)
    across = float(share @ np.sin(theta) ** 2) / (dimension - 1)
    return CapMoments(1.0 - mean, float(share @ (height - mean) ** 2), across)
