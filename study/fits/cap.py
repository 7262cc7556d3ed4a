"""Directions uniform by area on a spherical cap, in any dimension d ≥ 2.

A direction is u = (1 - t, √(t(2 - t)) w): its height t = 1 - cos θ below the pole, and a unit vector w across the
axis. The height comes from one uniform number through the inverse of its distribution; w is a sign in two dimensions,
a point of the circle by its angle in three, and a normalised vector of d - 1 normals in more. Heights stand in
for cosines, so no digit is lost at tiny angles: 1 - cos φ is formed as 2 sin²(φ/2), never by subtraction.

Heights on a cap from shares of its area, by one short series per dimension d ≥ 4.

Let A(θ) = ∫₀^θ sin^(d-2), a cap's area up to a factor, and z = (A(θ)/A(π/2))^(2/(d-1)). Near the pole both z and the
height t = 1 - cos θ go like θ², and t/z is analytic in z up to where the sphere closes, at z = 2^(2/(d-1)): on the
pole's hemisphere, z ≤ 1, its Chebyshev series converges geometrically. So t keeps its relative accuracy, a few rounding
errors, at any angle. Beyond the equator the same gives 2 - t from the area that is left to the opposite pole.

Source: for the series and their convergence, Trefethen, Approximation Theory and Approximation Practice (2013), ch. 8.

Moments of directions uniform by area on a spherical cap: their mean and variances, along the axis and across it.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from study.arrays import Floats, Words
from study.fits.jit import CHUNK, aligned, compiled, compiled_as_written, fill, fma
from study.fits.random import LANES, fill_words, from_one, put_back, spare, to_normals, to_uniform


class CapLaw(NamedTuple):
    """Distribution of heights on a cap, as `to_heights` needs it.

    Attributes:
        edge: z at the cap's edge.
        beyond: area of the rest of the sphere over the cap's, or 1 if that is less.
        binades: 2^(2e/(d-1)) by the bits of an exponent e (1024,).
        mantissas: Chebyshev series of (1 + z)^(2/(d-1)).
        ratios: Chebyshev series of t/z.
    """

    edge: float
    beyond: float
    binades: Floats
    mantissas: Floats
    ratios: Floats


_MANTISSA, _ONE, _52 = np.uint64(2**52 - 1), np.uint64(0x3FF0000000000000), np.uint64(52)


def _series(function: Callable[[Floats], Floats], singularity: float) -> Floats:
    """Chebyshev coefficients, in 2z - 1 and an even number of them, of a function analytic on 0 ≤ z ≤ 1.

    The place of its nearest singularity, on the real line, gives the number of terms after which 2⁻⁵³ is left.
    """
    count = 2 * math.ceil(0.5 * 53.0 * math.log(2.0) / math.acosh(abs(2.0 * singularity - 1.0)) + 0.5)
    z = np.cos(0.5 * math.pi * (np.arange(count) + 0.5) / count) ** 2
    series: Floats = scipy.fft.dct(function(z)) / count
    series[0] *= 0.5
    return series


@lru_cache
def _rule(dimension: int) -> tuple[Floats, Floats]:
    """Nodes on (0, 1) and weights that integrate sin^(d-2) over any cap up to the hemisphere to rounding."""
    nodes, weights = scipy.special.roots_legendre(32 + dimension)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def _radius(theta: float | Floats, dimension: int) -> Floats:
    """A(θ)^(1/(d-1)) for 0 ≤ θ ≤ π/2: nearly proportional to θ, so it does not underflow in many dimensions."""
    nodes, weights = _rule(dimension)
    sines = nodes * np.sinc(np.multiply.outer(theta / math.pi, nodes))  # over θ
    return theta * (sines ** (dimension - 2) @ weights) ** (1.0 / (dimension - 1))


@lru_cache
def _tables(dimension: int) -> tuple[Floats, Floats, Floats]:
    """Tables of one dimension: ``binades``, ``mantissas`` and ``ratios`` of a `CapLaw`."""
    d, power = dimension, 2.0 / (dimension - 1)

    def ratio(z: Floats) -> Floats:
        goal = np.sqrt(z) * _radius(0.5 * math.pi, d)
        theta = goal * (d - 1) ** (1.0 / (d - 1))
        for _ in range(12):  # Newton's method, from the left: the radius is concave. In 200 dimensions it takes 9
            radius = _radius(theta, d)
            theta += (goal - radius) * (d - 1) * (radius / np.sin(theta)) ** (d - 2)
        heights: Floats = 2.0 * np.sin(0.5 * theta) ** 2
        return heights / z

    doublings, rest = np.divmod(2 * (np.arange(1024) - 1023), d - 1)  # whole ones are exact
    binades: Floats = np.ldexp(2.0 ** (rest / (d - 1)), doublings)
    binades[0] = 0.0  # of zero
    return binades, _series(lambda z: (1.0 + z) ** power, -1.0), _series(ratio, 2.0**power)


@lru_cache(maxsize=1024)
def cap_law(half_angle: float, dimension: int) -> CapLaw:
    """Distribution of heights on a cap.

    Args:
        half_angle: φ in radians, 0 < φ ≤ π.
        dimension: d ≥ 4.
    """
    near = _radius(min(half_angle, math.pi - half_angle), dimension) / _radius(0.5 * math.pi, dimension)
    if half_angle <= 0.5 * math.pi:
        return CapLaw(float(near**2), 1.0, *_tables(dimension))
    rest = near ** (dimension - 1)
    return CapLaw(float((2.0 - rest) ** (2.0 / (dimension - 1))), float(rest / (2.0 - rest)), *_tables(dimension))


@compiled
def _sum(series: Floats, z: Floats, b: Floats, c: Floats) -> None:
    """Evaluate a Chebyshev series at 2z - 1, into b, by Clenshaw's recurrence, two steps at a time; c is scratch."""
    fill(b, 0.0)
    fill(c, 0.0)
    for j in range(series.size - 1, 0, -2):
        for k in range(z.size):
            x = 4.0 * z[k] - 2.0
            c[k] = series[j] + x * b[k] - c[k]
            b[k] = series[j - 1] + x * c[k] - b[k]
    for k in range(z.size):
        b[k] -= (2.0 * z[k] - 1.0) * c[k]


@compiled
def to_heights(row: Floats, law: CapLaw) -> None:
    """Turn uniform numbers, shares of a cap's area, into heights; in place.

    A number m 2^e, 1 ≤ m < 2, is raised to a power by the series of m and the table of e: with the library's power
    the function would take twice as long, and its bits would depend on the library.
    """
    edge, beyond, binades, mantissas, ratios = law
    middle = 0.5 * (1.0 + beyond)
    work = np.empty((4, CHUNK))
    for start in range(0, row.size, CHUNK):
        t = row[start : start + CHUNK]
        z, scale, b, c = work[0, : t.size], work[1, : t.size], work[2, : t.size], work[3, : t.size]
        bits = z.view(np.uint64)
        for k in range(t.size):
            z[k] = 1.0 - t[k]
        for k in range(t.size):  # in a loop of its own: the compiler would add 1 + beyond first, and lose all digits
            z[k] = z[k] + beyond if t[k] > middle else t[k]
        for k in range(t.size):
            scale[k] = edge * binades[bits[k] >> _52]
            bits[k] = (bits[k] & _MANTISSA) | _ONE
        for k in range(t.size):
            z[k] -= 1.0
        _sum(mantissas, z, b, c)
        for k in range(t.size):
            z[k] = scale[k] * b[k]
        _sum(ratios, z, b, c)
        for k in range(t.size):
            height = z[k] * b[k]
            t[k] = 2.0 - height if t[k] > middle else height


_EIGHTH = 0.125 * math.pi
_S3, _S5, _S7, _S9, _S11, _S13 = ((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 7))
_C2, _C4, _C6, _C8, _C10, _C12 = ((-1.0) ** k / math.factorial(2 * k) for k in range(1, 7))
"""Terms of sine and cosine; the next ones are below 3e-17 up to π/8."""
_1, _2, _4 = (np.uint64(k) for k in (1, 2, 4))


def heights(uniform: Floats, half_angle: float, dimension: int) -> Floats:
    """Turn uniform numbers into heights t = 1 - cos θ of directions uniform on a cap; in place.

    Args:
        uniform: numbers in [0, 1), any shape.
        half_angle: φ in radians, 0 < φ ≤ π.
        dimension: d ≥ 2.

    Returns:
        Heights in [0, 1 - cos φ], in the shape of ``uniform``. t/2 follows a Beta((d-1)/2, (d-1)/2) law cut off
        at sin²(φ/2); in three dimensions that is uniform (Archimedes).
    """
    top = math.sin(0.5 * half_angle) ** 2
    if dimension == 2:
        uniform[...] = 2.0 * np.sin(0.5 * half_angle * uniform) ** 2
    elif dimension == 3:
        uniform *= 2.0 * top
    else:
        flat = uniform.ravel()  # a copy, if it is strided
        to_heights(flat, cap_law(half_angle, dimension))
        uniform[...] = flat.reshape(uniform.shape)
    return uniform


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
def _to_unit_length(directions: Floats, trial: int, start: int, length: Floats) -> None:
    """Divide vectors across the axis, in rows 1 to d - 1 of a trial, by their lengths."""
    fill(length, 0.0)
    for i in range(1, directions.shape[1]):
        w = directions[trial, i, start : start + length.size]
        for k in range(w.size):
            length[k] += w[k] * w[k]
    for k in range(length.size):
        length[k] = 1.0 / math.sqrt(length[k])
    for i in range(1, directions.shape[1]):
        w = directions[trial, i, start : start + length.size]
        for k in range(w.size):
            w[k] *= length[k]


@compiled
def _aim(directions: Floats, trial: int, start: int, length: Floats) -> None:
    """Give unit vectors across the axis, in rows 1 to d - 1 of a trial, the lengths that belong to the heights."""
    t = directions[trial, 0, start : start + length.size]
    for k in range(t.size):
        length[k] = math.sqrt(t[k] * (2.0 - t[k]))
    for i in range(1, directions.shape[1]):
        w = directions[trial, i, start : start + length.size]
        for k in range(t.size):
            w[k] *= length[k]


@compiled
def _draw(state: Words, height: float, directions: Floats, normals: Floats) -> None:
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


@compiled
def _aim_all(directions: Floats) -> None:
    """Make directions of heights and vectors of length 1."""
    b, _, n = directions.shape
    length = np.empty(CHUNK)
    for trial in range(b):
        for start in range(0, n, CHUNK):
            _aim(directions, trial, start, length[: min(CHUNK, n - start)])


@compiled
def _to_directions(directions: Floats, law: CapLaw) -> None:
    """Make directions of uniform numbers and vectors of any length."""
    b, _, n = directions.shape
    length = np.empty(CHUNK)
    for trial in range(b):
        for start in range(0, n, CHUNK):
            m = min(CHUNK, n - start)
            to_heights(directions[trial, 0, start : start + m], law)
            _to_unit_length(directions, trial, start, length[:m])
            _aim(directions, trial, start, length[:m])


def draw(state: Words, half_angle: float, directions: Floats, normals: Floats) -> None:
    """Draw a block of trials: directions uniform on a cap, and standard normals.

    Trial after trial, so that a block's first trials do not depend on how many follow.

    Args:
        state: state of the generators, see `study.fits.random`; it is advanced.
        half_angle: φ in radians, 0 < φ ≤ π.
        directions: receives directions (b, d, n) about the first axis, with the height t = 1 - u₁ in place of u₁.
        normals: receives numbers (b, d, n).
    """
    d = directions.shape[1]
    # where heights are uniform, they are formed directly
    _draw(state, float(heights(np.ones(1), half_angle, d)[0]) if d == 3 else 1.0, directions, normals)
    if d == 2:
        heights(directions[:, 0], half_angle, d)
        _aim_all(directions)
    elif d > 3:
        _to_directions(directions, cap_law(half_angle, d))


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
