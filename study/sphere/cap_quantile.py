"""Heights on a cap from shares of its area, by one short series per dimension d ≥ 4.

Let A(θ) = ∫₀^θ sin^(d-2), a cap's area up to a factor, and z = (A(θ)/A(π/2))^(2/(d-1)). Near the pole both z and the
height t = 1 - cos θ go like θ², and t/z is analytic in z up to where the sphere closes, at z = 2^(2/(d-1)): on the
pole's hemisphere, z ≤ 1, its Chebyshev series converges geometrically. So t keeps its relative accuracy, a few rounding
errors, at any angle. Beyond the equator the same gives 2 - t from the area that is left to the opposite pole.

Source: for the series and their convergence, Trefethen, Approximation Theory and Approximation Practice (2013), ch. 8.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from study.sphere.jit import CHUNK, compiled, fill
from study.sphere.types import Floats


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
