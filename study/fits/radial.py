"""Mean lengths of a noisy radius: expectations of functions of R = |y|, y ~ N(r u, σ²I), for any dimension d ≥ 2.

Noise lengthens a radius on average and shortens the mean of its direction e = y/R. All the means that corrected
estimating equations need follow from two of them, both positive,

    P = E 1/R    and    Q = E (e·u)/R²,

by Stein's identity, with s = σ²:

    E e·u = rP - sQ,    E R = r E e·u + (d-1) s P,    E R e·u = r,    E R² e·u = r E R + s E e·u.    (theory 9.1)

P and Q are sums of positive terms where the noise is large, and a series in 1/t = 2σ²/r² where it is small, which
gives differences such as E R - r without cancellation down to σ = 0.
"""

import math
from typing import NamedTuple

from study.arrays import Floats
from study.fits.jit import compiled

_FAR = 40.0
"""Least t = r²/2σ² for the series in 1/t: its terms fall below e⁻ᵗ before they rise again."""
_EPS = 2.0**-53
_MOST_TERMS = 200


class RadialMeans(NamedTuple):
    """Means of a noisy radius and their derivatives by the radius r and the noise variance s = σ².

    Attributes:
        lengthening: E R - r.
        shortening: E e·u - 1, the derivative of E R by r less one.
        variance: Var R.
        excess01: λ₀₁ - r with λ₀₁ = r / E e·u, the radius at which E (R - λ) e = 0.
        excess12: λ₁₂ - r with λ₁₂ = E R² e·u / r, the radius at which E (R - λ) R e = 0.
        mean_by_s: ∂E R/∂s.
        variance_by_r: ∂Var R/∂r.
        variance_by_s: ∂Var R/∂s.
        excess01_by_r: ∂λ₀₁/∂r - 1.
        excess01_by_s: ∂λ₀₁/∂s.
        excess12_by_r: ∂λ₁₂/∂r - 1.
        excess12_by_s: ∂λ₁₂/∂s.
    """

    lengthening: float
    shortening: float
    variance: float
    excess01: float
    excess12: float
    mean_by_s: float
    variance_by_r: float
    variance_by_s: float
    excess01_by_r: float
    excess01_by_s: float
    excess12_by_r: float
    excess12_by_s: float


@compiled
def _far_less_one(a: float, d: int, inverse: float) -> float:
    """Σ_{k≥1} (a)_k ((3-d)/2)_k / k! t⁻ᵏ, ended where its terms vanish, given 1/t."""
    term, total, least = 1.0, 0.0, math.inf
    for k in range(_MOST_TERMS):
        term *= (a + k) * (0.5 * (3 - d) + k) / (k + 1.0) * inverse
        if abs(term) <= _EPS * abs(total) or (abs(term) >= least and abs(term) < _EPS):
            break
        least = abs(term)
        total += term
    return total


@compiled
def _near(a: float, b: float, t: float) -> float:
    """e⁻ᵗ ₁F₁(b-a; b; t) for b > a: all terms are positive."""
    term = total = math.exp(-t)
    for k in range(10 * _MOST_TERMS):
        term *= (b - a + k) / (b + k) * t / (k + 1.0)
        total += term
        if term <= _EPS * total:
            break
    return total


@compiled
def radial_means(radius: float, variance: float, dimension: int) -> RadialMeans:
    """Means of a noisy radius.

    Args:
        radius: r > 0.
        variance: s = σ² ≥ 0 of each coordinate, in the unit of r squared.
        dimension: d ≥ 2.
    """
    r, s, d = radius, variance, dimension
    inverse = 2.0 * s / (r * r)
    if inverse * _FAR < 1.0:
        one, three = _far_less_one(0.5, d, inverse), _far_less_one(1.5, d, inverse)
        p, q = (1.0 + one) / r, (1.0 + three) / (r * r)
        shortening = one - s * q
    else:
        t, sigma = 1.0 / inverse, math.sqrt(s)
        scale = math.exp(math.lgamma(0.5 * (d - 1)) - math.lgamma(0.5 * d)) * math.sqrt(0.5)
        p = scale * _near(0.5, 0.5 * d, t) / sigma
        q = scale * (r / d) * _near(1.5, 0.5 * d + 1.0, t) / (s * sigma)
        shortening = r * p - s * q - 1.0
    direction = 1.0 + shortening
    lengthening = r * shortening + (d - 1) * s * p
    mean = r + lengthening
    spread = d * s - lengthening * (2.0 * r + lengthening)
    mean_by_s = 0.5 * (d - 1) * p
    by_r, by_s = (d - 1) * s * q / r, -0.5 * (d - 1) * q
    return RadialMeans(
        lengthening,
        shortening,
        spread,
        -r * shortening / direction,
        lengthening + s * direction / r,
        mean_by_s,
        -2.0 * (r * shortening + lengthening * direction),
        d - 2.0 * mean * mean_by_s,
        -shortening / direction - r * by_r / (direction * direction),
        -r * by_s / (direction * direction),
        shortening + s * by_r / r - s * direction / (r * r),
        mean_by_s + direction / r + s * by_s / r,
    )


@compiled
def angle_means(concentration: Floats, dimension: int, density: Floats, cosine: Floats) -> None:
    """Means of the angle between a noisy sample and its direction, given the sample's radius R.

    The angle has a von Mises-Fisher law whose concentration is κ = Rr/σ², by the density of y ~ N(r u, σ²I).

    Args:
        concentration: κ > 0 (b, k).
        dimension: d ≥ 2.
        density: receives √κ e^-κ I_ν(κ), ν = d/2 - 1 (b, k).
        cosine: receives E[e·u | R] = I_{ν+1}(κ) / I_ν(κ) (b, k).
    """
    d, order = dimension, 0.5 * dimension - 1.0
    scale = math.exp(-math.lgamma(order + 1.0) - order * math.log(2.0))
    for t in range(concentration.shape[0]):
        for k in range(concentration.shape[1]):
            kappa = concentration[t, k]
            inverse = 0.5 / kappa
            if inverse * _FAR < 1.0:
                density[t, k] = (1.0 + _far_less_one(0.5 * (d - 1), d, inverse)) / math.sqrt(2.0 * math.pi)
                higher = 1.0 + _far_less_one(0.5 * (d + 1), d + 2, inverse)
                cosine[t, k] = higher / (density[t, k] * math.sqrt(2.0 * math.pi))
            else:
                here = _near(0.5 * (d - 1), d - 1.0, 2.0 * kappa)
                density[t, k] = scale * kappa ** (order + 0.5) * here
                cosine[t, k] = kappa / d * _near(0.5 * (d + 1), d + 1.0, 2.0 * kappa) / here
