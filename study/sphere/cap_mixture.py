"""Noisy samples of a spherical cap as a mixture over their directions: densities, and means of a(u) given a sample.

A sample is y = u + σz, its direction u uniform by area on the cap. Everything is a function of its distance R = |y| and
its angle α to the axis, times a harmonic of the azimuth, of order 0 (axial) or 1 (lateral). With θ the angle of u,
integrals over the azimuth are Bessel functions of κ = R sin α sin θ/σ².
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from study.sphere.types import Floats

_REACH = 8.0
"""Standard deviations of noise beyond which there is no sample: exp(-8²/2) = 1e-14."""


class Cap(NamedTuple):
    """A cap of the unit sphere and the noise: half-angle in radians, σ, d."""

    half_angle: float
    noise: float
    dimension: int


class Positions(NamedTuple):
    """Places of a sample: at a distance 1 + ``excess`` (n, 1), at an ``angle`` (m,) to the axis, with volumes (n, m).

    The volumes are those of all azimuths, times the constant of the density of the noise.
    """

    excess: Floats
    angle: Floats
    volume: Floats


class Orders(NamedTuple):
    """Functions of a sample, of azimuthal order 0 and 1: these are multiplied by the cosine of the azimuth."""

    axial: Floats
    lateral: Floats


@lru_cache(maxsize=16)
def unit_rule(nodes: int) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss and Legendre between -1 and 1; they take as long as what they are used for."""
    return tuple(map(np.asarray, scipy.special.roots_legendre(nodes)))  # type: ignore[return-value]


def rule(low: Floats | float, high: Floats | float, nodes: int) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss and Legendre between bounds; new last axis."""
    x, w = unit_rule(nodes)
    half = 0.5 * np.subtract(high, low)[..., None]
    return np.asarray(half * x + 0.5 * np.add(high, low)[..., None]), np.asarray(half * w)


def _spread(noise: float) -> float:
    """Angle by which noise may move a sample along the sphere."""
    return math.asin(_REACH * noise) if _REACH * noise < 1.0 else math.pi


def positions(cap: Cap, nodes: int) -> Positions:
    """Nodes where a sample may lie. In the angle they come in panels, which end at the rim and at the noise's reach."""
    half_angle, noise, d = cap
    spread = _spread(noise)
    excess, width = rule(max(-1.0, -_REACH * noise), (_REACH + math.sqrt(d)) * noise, nodes)
    edges = np.unique([0.0, max(0.0, half_angle - spread), half_angle, min(math.pi, half_angle + spread)])
    angle, breadth = (part.ravel() for part in rule(edges[:-1], edges[1:], nodes))
    constant = math.log(2.0) + 0.5 * (d - 1) * math.log(math.pi) - math.lgamma(0.5 * (d - 1))
    constant -= 0.5 * d * math.log(2.0 * math.pi * noise**2)
    with np.errstate(under="ignore"):
        radial = width * np.exp((d - 1) * np.log1p(excess) + constant)
        return Positions(excess[:, None], angle, radial[:, None] * breadth * np.sin(angle) ** (d - 2))


def directions(cap: Cap, angle: Floats, nodes: int) -> tuple[Floats, Floats]:
    """Angles θ of the directions that matter to samples at the given angles, and their probabilities (m, nodes)."""
    half_angle, noise, d = cap
    reach = 1.2 * _spread(noise)
    low = np.maximum(0.0, np.minimum(angle, half_angle) - reach)
    theta, width = rule(low, np.minimum(half_angle, angle + reach), nodes)
    widest = math.sin(min(half_angle, 0.5 * math.pi))  # in units of it, high powers do not vanish
    whole, measure = rule(0.0, half_angle, nodes)
    total = measure @ (np.sin(whole) / widest) ** (d - 2)
    return theta, width * (np.sin(theta) / widest) ** (d - 2) / total


def _azimuth(kappa: Floats, d: int) -> Orders:
    """Mean of exp(κ(w - 1)), plain and times w, w being the cosine of the azimuth."""
    if d == 2:  # w is a sign
        return Orders(0.5 + 0.5 * np.exp(-2.0 * kappa), -0.5 * np.expm1(-2.0 * kappa))
    if d == 3:
        return Orders(scipy.special.i0e(kappa), scipy.special.i1e(kappa))
    order = 0.5 * (d - 3)
    return Orders(_bessel(order, kappa), kappa / (d - 1) * _bessel(order + 1.0, kappa))


def _bessel(order: float, x: Floats) -> Floats:
    """exp(-x) ₀F₁(; order + 1; x²/4) = Γ(order + 1) (2/x)^order exp(-x) I_order(x)."""
    value, small = np.empty_like(x), x < 30.0 * (1.0 + order)
    near, far = x[small], x[~small]  # to either side, a series and an expansion that lose nothing
    value[small] = scipy.special.hyp0f1(order + 1.0, 0.25 * near * near) * np.exp(-near)
    scale = np.exp(scipy.special.gammaln(order + 1.0) - order * np.log(0.5 * far))
    value[~small] = scale * scipy.special.ive(order, far)
    return value


def kernels(cap: Cap, y: Positions, theta: Floats) -> Orders:
    """exp(-|y - u|²/2σ²) for directions at an angle θ, integrated over the azimuth (n, m, …)."""
    excess, angle = y.excess[..., None], y.angle[:, None]
    kappa = (1.0 + excess) * np.sin(angle) * np.sin(theta) / cap.noise**2
    least = excess**2 + 4.0 * (1.0 + excess) * np.sin(0.5 * (angle - theta)) ** 2  # |y - u|² at equal azimuths
    with np.errstate(under="ignore"):
        gauss = np.exp(-0.5 * least / cap.noise**2)
        axial, lateral = _azimuth(kappa, cap.dimension)
        return Orders(gauss * axial, gauss * lateral)


def polynomials(cap: Cap, y: Positions, theta: Floats, weighted: Orders, degree: int) -> Orders:
    """E[a(u)|y] times the density of y, for Legendre polynomials a in cos θ and for the rim (n, m, degree + 2).

    ``weighted`` are the kernels at θ times the probabilities, the lateral ones also times sin θ. The rim stands for a
    law that lies on it alone: polynomials approach it slowly, and a cap that moves gains and loses at its rim.
    """
    x = 1.0 - 2.0 * (np.sin(0.5 * theta) / math.sin(0.5 * cap.half_angle)) ** 2
    table = np.polynomial.legendre.legvander(x, degree)
    axial, lateral = (np.einsum("nmt,mtk->nmk", kernel, table, optimize=True) for kernel in weighted)
    rim = kernels(cap, y, np.asarray(cap.half_angle))
    return Orders(
        np.concatenate([axial, rim.axial], axis=-1),
        np.concatenate([lateral, rim.lateral * math.sin(cap.half_angle)], axis=-1),
    )


def derivatives(cap: Cap, y: Positions, terms: int) -> Orders:
    """E[a(u)|y] times the density of y, for derivatives a of a unit mass at the pole by its height (n, m, terms).

    Where noise hides the cap, E[a(u)|y] of polynomials lose their digits; these keep them, however small they are.
    """
    unit, noise = 2.0 * math.sin(0.5 * cap.half_angle) ** 2, cap.noise
    distance, angle, c = 1.0 + y.excess, y.angle, 0.5 * (cap.dimension - 1)
    first = -distance * np.cos(angle) * unit / noise**2
    second = (distance * np.sin(angle) / (2.0 * noise**2)) ** 2 * unit
    gauss = np.exp(-0.5 * (y.excess**2 + 4.0 * distance * np.sin(0.5 * angle) ** 2) / noise**2)[..., None]
    axial = gauss * _series(first, second, c, unit, terms)
    lateral = gauss * (distance * np.sin(angle))[..., None] * _series(first, second, c + 1.0, unit, terms)
    return Orders(axial, lateral)


def _series(first: Floats, second: Floats, c: float, unit: float, terms: int) -> Floats:
    """Coefficients of hᵏ, k < terms, in exp(first h) ₀F₁(; c; second h (2 - unit h)); new last axis."""
    powers = [np.zeros_like(second) for _ in range(terms)]
    for j in range(terms):
        factor = second**j / (math.factorial(j) * scipy.special.poch(c, j))
        for i in range(min(j + 1, terms - j)):
            powers[i + j] += factor * math.comb(j, i) * 2.0 ** (j - i) * (-unit) ** i
    exponential = [first**k / math.factorial(k) for k in range(terms)]
    return np.stack([sum(exponential[k - i] * powers[i] for i in range(k + 1)) for k in range(terms)], axis=-1)
