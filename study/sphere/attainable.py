"""Attainable bound: the least covariance of a regular estimator that knows neither the directions nor the noise.

The Cramér-Rao bound holds for directions u that are fixed parameters, as many as there are samples; where noise hides
much of a cap, no estimator reaches it. Here the directions follow a law G that is unknown, and so is σ. In units of the
radius, with y = (x - c)/r, the scores given u are

    centre: (y - u)/σ²,   radius: (u·y - 1)/σ²,   σ²: |y - u|²/2σ⁴ - d/2σ²,

and given y alone they are E[·|y]. A change of the law by a factor 1 + a(u) adds E[a(u)|y] to the score. The scores are
efficient when they are projected on the complement of all E[a(u)|y]; the inverse of their covariance is the bound.

Source: Bickel, Klaassen, Ritov & Wellner 1993, §4.5, for mixtures with an unknown law.
"""

import math
import operator
from functools import lru_cache

import numpy as np

from study.sphere.cap_mixture import Cap, Orders, Positions, derivatives, directions, kernels, polynomials, positions
from study.sphere.cap_moments import cap_moments
from study.sphere.types import Floats

_NODES = 48
"""Nodes of a rule of Gauss and Legendre; with 64 the bounds agree to 1e-6."""
_CLEAR = 1e-4
"""Noise below this share of the half-angle gives the Cramér-Rao bound: ALS, which knows as little, is as near as
3e-8 d²."""
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
    """
    phi, sigma, d = _number("angle", angle), _number("noise", noise), operator.index(dimension)
    if not 0.0 < phi <= 180.0:
        raise ValueError(f"angle = {phi!r}: give the half-angle of the cap in degrees, above 0 and at most 180")
    if not (sigma > 0.0 and 0.0 < sigma * sigma < math.inf):
        raise ValueError(f"noise = {sigma!r}: a standard deviation must be positive and finite, and so must its square")
    if d < 2:
        raise ValueError(f"dimension = {d!r}: a sphere needs at least 2")
    return _cached(Cap(math.radians(phi), sigma, d)).copy()


def _number(name: str, value: float) -> float:
    """Check that an argument is one number."""
    if np.ndim(value) != 0:
        raise TypeError(f"{name} has shape {np.shape(value)}: give one number")
    return float(value)


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
    lost = ValueError(
        f"noise = {noise!r} hides a cap of {math.degrees(half_angle):g}° so far that float64 cannot hold the "
        f"attainable bound: give less noise or a larger angle"
    )
    if not (noise < _GONE * half_angle and half_angle > _LEAST_ANGLE):
        raise lost
    y = positions(cap, nodes)
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

    In units of 1/σ and 1/σ². The difference c - r is formed without the subtraction, which a small cap would not bear.
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
