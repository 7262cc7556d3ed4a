"""Attainable bound: the least covariance of a regular estimator that knows neither the directions nor the noise.

The Cramér-Rao bound holds for directions u that are fixed parameters, as many as there are samples; where noise hides
much of a cap, no estimator reaches it. Here the directions follow a law G that is unknown, and so is σ. In units of the
radius, with y = (x - c)/r, the scores given u are

    centre: (y - u)/σ²,   radius: (u·y - 1)/σ²,   σ²: |y - u|²/2σ⁴ - d/2σ²,

and given y alone they are E[·|y]. If G is perturbed by the factor 1 + a(u), the score of the perturbation is
E[a(u)|y]. The efficient scores are the scores projected onto the orthogonal complement of all E[a(u)|y]. The inverse of
their covariance is the bound.

A sample of a cap is a mixture over its directions, which gives its density and the mean of a(u) given the sample. A
sample is y = u + σz, its direction u uniform by area on the cap. Everything is a function of its distance R = |y| and
its angle α to the axis, times a harmonic of the azimuth, of order 0 (axial) or 1 (lateral). With θ the angle of u,
integrals over the azimuth are Bessel functions of κ = R sin α sin θ/σ².

Source: Bickel, Klaassen, Ritov & Wellner 1993, §4.5, for mixtures with an unknown law.
"""

from __future__ import annotations

import math
import operator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from study.arrays import Floats
from study.fits.points.cap import cap_moments
from study.fits.points.noise import variance

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


def _positions(cap: Cap, nodes: int) -> Positions:
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

    ``weighted`` are the kernels at θ times the probabilities, the lateral ones also times sin θ. The last
    function is a point mass on the rim: the score of a moving cap has such a part, and polynomials approach it slowly.
    """
    x = 1.0 - 2.0 * (np.sin(0.5 * theta) / math.sin(0.5 * cap.half_angle)) ** 2
    table = np.polynomial.legendre.legvander(x, degree)
    axial, lateral = (np.einsum("nmt,mtk->nmk", kernel, table, optimize=True) for kernel in weighted)
    at_rim, beside = kernels(cap, y, np.asarray(cap.half_angle))
    lateral = np.concatenate([lateral, beside * math.sin(cap.half_angle)], axis=-1)
    return Orders(np.concatenate([axial, at_rim], axis=-1), lateral)


def derivatives(cap: Cap, y: Positions, terms: int) -> Orders:
    """E[a(u)|y] times the density of y, a the k-th derivative by height of a point mass at the pole (n, m, terms).

    If the noise is large beside the cap, the family of polynomials is numerically dependent. This one is not, however
    small its values are.
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


_NODES = 48
"""Nodes of a rule of Gauss and Legendre; with 64 the bounds agree to 1e-6."""
_CLEAR = 1e-4
"""Noise below this share of the half-angle gives the Cramér-Rao bound: the variance of `als`, which does not know the
directions either, exceeds it by a share of 3e-8 d² at most."""
_HIDDEN = 0.8
"""Noise above this multiple of the half-angle needs the family of derivatives."""
_GONE = 1e3
"""With noise above this multiple of the half-angle only rounding would be left in the numbers."""
_LEAST_ANGLE = 1e-60
"""Half-angle in radians, above which no fourth power vanishes."""
_RANK = 1e-14
"""Singular values of E[a(u)|y] below this share of the largest are rounding."""
_LOST = 1e-7
"""Efficient scores below this share of the scores have lost the digits that are promised."""

_MOST_DIMENSIONS = 1000
"""Most dimensions of a bound, whose matrix grows with their square: 8 MB."""


def attainable_bound(angle: float = 45.0, noise: float = 0.3, dimension: int = 3) -> Floats:
    """Attainable bound to the covariance of (centre, radius), for one sample on a cap of the unit sphere.

    For N samples divide it by N; for a sphere of radius r give σ/r, and multiply it by r². It is the least asymptotic
    covariance of estimators that know neither the law of the directions nor σ. It is never below the Cramér-Rao bound
    (`study.crlb`), and tends to it as the noise falls.

    Args:
        angle: half-angle of the cap in degrees, 0 < φ ≤ 180; directions are uniform by area on it.
        noise: standard deviation σ of each coordinate, in units of the radius.
        dimension: d ≥ 2.

    Returns:
        Bound (d+1, d+1): the centre along the axis, the centre across it, the radius. Its relative error is below
        1e-4, tested in up to 20 dimensions.

    Raises:
        ValueError: if an argument is out of range, or noise hides the cap so far that float64 cannot hold the bound.
        TypeError: if an argument is not one number.

    Examples:
        The least standard errors that 100 samples on a cap of 45° allow:

        >>> import numpy as np, study
        >>> np.sqrt(np.diag(study.attainable_bound(45, noise=0.1)) / 100).round(4)
        array([0.1365, 0.0285, 0.0285, 0.117 ])
    """
    phi, sigma, d = one_number("angle", angle), one_number("noise", noise), bound_dimension(dimension)
    if not 0.0 < phi <= 180.0:
        raise ValueError(f"angle = {phi!r}: give the half-angle of the cap in degrees, above 0 and at most 180")
    variance(sigma)
    return _cached(Cap(math.radians(phi), sigma, d)).copy()


def bound_dimension(dimension: int) -> int:
    """Check that a dimension is one for which there is a bound."""
    if operator.index(dimension) < 2:
        raise ValueError(f"dimension = {dimension!r:.40}: a sphere needs at least 2")
    if dimension > _MOST_DIMENSIONS:
        raise ValueError(f"dimension = {dimension!r:.40}: a bound is known for {_MOST_DIMENSIONS:,} at most")
    return operator.index(dimension)


def one_number(name: str, value: float) -> float:
    """Check that an argument is one number."""
    if np.ndim(value) != 0:
        raise TypeError(f"{name} has shape {np.shape(value)}: give one number")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{name} = {value!r:.40}…: must be below 1.8e308") from None
    except (TypeError, ValueError):
        raise TypeError(f"{name} = {value!r:.40}: give one number") from None


@lru_cache(maxsize=4096)
def _cached(cap: Cap) -> Floats:
    clear = cap.noise < _CLEAR * cap.half_angle and cap.half_angle > _LEAST_ANGLE
    return cramer_rao(cap) if clear else by_quadrature(cap)


def cramer_rao(cap: Cap) -> Floats:
    """Cramér-Rao bound for one sample on a cap (theory (3.2))."""
    mean, along, across = cap_moments(cap.half_angle, cap.dimension)
    return cap.noise**2 * _assemble(cap.dimension, 1.0 / along, -mean / along, 1.0 + mean * mean / along, 1.0 / across)


def _assemble(d: int, axis: float, between: float, radius: float, across: float) -> Floats:
    """Symmetric matrix (d+1, d+1) of the centre, axis first, and the radius."""
    bound = np.diag([axis, *[across] * (d - 1), radius])
    bound[0, -1] = bound[-1, 0] = between
    return bound


def by_quadrature(cap: Cap, nodes: int = _NODES) -> Floats:
    """Attainable bound by quadrature; more nodes go with a richer family of functions a(u).

    Raises:
        ValueError: if rounding leaves fewer digits than are promised.
    """
    half_angle, noise, d = cap
    words = "so far that float64 cannot hold the attainable bound: give less noise or a larger angle"
    lost = ValueError(f"noise = {noise!r} hides a cap of {math.degrees(half_angle):g}° {words}")
    if not (noise < _GONE * half_angle and half_angle > _LEAST_ANGLE):
        raise lost
    y = _positions(cap, nodes)
    theta, share = directions(cap, y.angle, nodes)
    axial, lateral = kernels(cap, y, theta)
    weighted = Orders(axial * share, lateral * share * np.sin(theta))
    density = weighted.axial.sum(axis=-1)
    # functions come multiplied by the density: times this root they are orthogonal where they are uncorrelated
    root = np.sqrt(np.divide(y.volume, density, out=np.zeros_like(density), where=density > 1e-290))
    if noise < _HIDDEN * half_angle:
        family = polynomials(cap, y, theta, weighted, nodes // 2 - 4)
    else:
        family = Orders(*(_to_unit_size(part, root) for part in derivatives(cap, y, nodes // 3)))
    along, across = _scores(cap, y, theta, weighted)
    axis, least = _efficient(family.axial, along, root)
    side, other = _efficient(family.lateral, across, root)
    if not min(least, other) > _LOST:
        raise lost
    inverse = np.linalg.inv(axis)
    (a, b), (_, c) = (inverse @ inverse.T)[:2, :2]  # of c - r along the axis and of r, σ² being unknown
    return noise**2 * _assemble(d, a, b - a, a - 2.0 * b + c, (d - 1) / side[0, 0] ** 2)


def _scores(cap: Cap, y: Positions, theta: Floats, weighted: Orders) -> tuple[list[Floats], list[Floats]]:
    """Scores given y times the density: of c - r along the axis, r and σ²; and of c across the axis.

    In units of 1/σ and 1/σ². The score of c - r has a formula of its own: on a small cap the
    difference of the two scores would cancel.
    """
    noise, angle, distance, (axial, lateral) = cap.noise, y.angle, 1.0 + y.excess, weighted
    density = axial.sum(axis=-1)
    height = (axial * 2.0 * np.sin(0.5 * theta) ** 2).sum(axis=-1)
    tilt = (axial * 2.0 * np.sin(0.5 * (angle[:, None] - theta)) ** 2).sum(axis=-1)
    turn = (axial * np.sin(theta) - lateral).sum(axis=-1) * np.sin(angle)
    short = distance * (tilt + turn)  # R - u·y
    difference = (height + short - 2.0 * distance * np.sin(0.5 * angle) ** 2 * density) / noise
    radius = (y.excess * density - short) / noise
    variance = (y.excess**2 * density + 2.0 * short) / (2.0 * noise**2) - 0.5 * cap.dimension * density
    across = (distance * np.sin(angle) * density - lateral.sum(axis=-1)) / noise
    return [difference, radius, variance], [across]


def _to_unit_size(family: Floats, root: Floats) -> Floats:
    """Bring each function of a family to mean square 1."""
    size = np.linalg.norm(family * root[..., None], axis=(0, 1))
    return np.asarray(family / np.maximum(size, np.finfo(float).tiny))


def _efficient(family: Floats, scores: list[Floats], root: Floats) -> tuple[Floats, float]:
    """Project scores on the complement of a family: triangular root of their covariance, and their least share."""
    basis = (family * root[..., None]).reshape(-1, family.shape[-1])
    left, values, _ = np.linalg.svd(basis, full_matrices=False)
    left = left[:, values > _RANK * values[0]]
    rest = whole = np.stack([(score * root).ravel() for score in scores], axis=1)
    for _ in range(2):  # the second time removes what rounding left
        rest = rest - left @ (left.T @ rest)
    triangle = np.linalg.qr(rest)[1]
    share = np.linalg.svd(triangle / np.linalg.norm(whole, axis=0), compute_uv=False)
    return triangle, float(share[-1])
