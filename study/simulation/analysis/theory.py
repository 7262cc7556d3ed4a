"""Errors that theory expects, for directions u uniform on a cap, with mean (m₁, 0, …) and covariance diag(Kₐ, Kₚ, …).

Moments of a cap are those of `fits/points/cap.py`. With the radius as the unit the points' variance along the axis, v,
is Kₐ, and noise is σ/r.
"""

import math
import sys
from functools import lru_cache

import numpy as np
import scipy

from study.arrays import Floats
from study.fits.errors.attainable import Cap, by_quadrature, cramer_rao, unit_rule
from study.fits.points.cap import CapMoments, cap_moments

_NODES = 24
"""Nodes for the attainable bound: it has three digits, eight times as fast as with five."""
_CLEAR = 1e-3
"""Noise below this share of the half-angle leaves the attainable bound at the Cramér-Rao bound, to three digits."""


def gdke_bias(noise: float, moments: CapMoments, noise_shape: Floats) -> float:
    """Length of GDKE's bias for many samples, (C₀ + Σ)⁻¹ Σ (c₀ - μ̄), which points towards the samples.

    Args:
        noise: σ over the radius.
        moments: of the cap.
        noise_shape: covariance of a sample in units of σ² (d, d).

    Returns:
        The length over the radius.
    """
    d = len(noise_shape)
    extent = np.diag([moments.along] + [moments.across] * (d - 1))
    sigma = noise**2 * noise_shape
    to_center = np.zeros(d)
    to_center[0] = -moments.mean
    return float(np.linalg.norm(np.linalg.solve(extent + sigma, sigma @ to_center)))


def gdke_leaves(samples: float, moments: CapMoments) -> float:
    """Noise s* = √(Kₐ/N)/m₁ above which GDKE's bias exceeds its scatter (theory §3).

    It is infinite on the whole sphere, where there is no bias.
    """
    return math.sqrt(moments.along / samples) / moments.mean if moments.mean > 1e-9 else math.inf


def ugdk_leaves(moments: CapMoments) -> float:
    """Noise above which UGDK exceeds the bound, σ² = v/2 (theory §3)."""
    return math.sqrt(moments.along / 2.0)


def kappa(noise: float, samples: float, moments: CapMoments) -> float:
    """κ = (v/σ²) √(N/2): the larger it is, the more certainly C - Σ is positive definite (theory §2.2)."""
    return moments.along / noise**2 * math.sqrt(samples / 2.0)


def noise_at_kappa(value: float, samples: float, moments: CapMoments) -> float:
    """Noise at which κ has this value."""
    return math.sqrt(moments.along * math.sqrt(samples / 2.0) / value)


def ugdk_variance(noise: float, moments: CapMoments, dimension: int) -> float:
    """Variance of UGDK along the axis over the bound's, for many samples and isotropic noise: theory (5.3)."""
    of_noise = (2.0 * dimension + 16.0) / 4.0
    return 1.0 + noise**2 * (of_noise + (1.0 - moments.along + moments.mean**2) / moments.along)


def bound_shares(moments: CapMoments, dimension: int) -> tuple[float, float]:
    """Share of tr CRLB along the axis, and of each coordinate across it, for isotropic noise: theory (3.2)."""
    total = 1.0 / moments.along + (dimension - 1) / moments.across
    return 1.0 / moments.along / total, 1.0 / moments.across / total


@lru_cache(maxsize=4096)
def median_at_bound(moments: CapMoments, dimension: int) -> float:
    """Median error over √tr CRLB of an estimator whose errors are Gaussian at the bound, for isotropic noise.

    It is NaN where a cap is so small that float64 cannot hold its variance along the axis.
    """
    if moments.along < sys.float_info.min:
        return math.nan
    return _median_length(*bound_shares(moments, dimension), dimension)


@lru_cache(maxsize=4096)
def median_attainable(angle: float, noise: float, dimension: int) -> float:
    """Median error over √tr CRLB of an estimator whose errors are Gaussian at the attainable bound.

    Both bounds fall as 1/N, so that their ratio does not depend on N.

    Args:
        angle: half-angle of the cap in degrees.
        noise: σ over the radius, of isotropic Gaussian noise.
        dimension: d.

    Returns:
        The median, to three digits; NaN where noise hides the cap so far that the bound cannot be formed.
    """
    cap = Cap(math.radians(angle), noise, dimension)
    if noise <= _CLEAR * cap.half_angle:
        return median_at_bound(cap_moments(cap.half_angle, dimension), dimension)
    try:
        bound = by_quadrature(cap, _NODES)
    except ValueError:
        return math.nan
    along, across = float(bound[0, 0]), float(bound[1, 1])
    total = along + (dimension - 1) * across
    ratio = math.sqrt(total / float(np.trace(cramer_rao(cap)[:-1, :-1])))
    return ratio * _median_length(along / total, across / total, dimension)


def _median_length(along: float, across: float, dimension: int) -> float:
    """Median length of a normal vector with total variance 1, by its variances along an axis and across it.

    The distribution function of the length is that of the d - 1 coordinates across, averaged over the one along.
    """
    nodes, weights = unit_rule(200)

    def excess(length: float) -> float:
        limit = length / math.sqrt(along)
        z = limit * nodes
        inside = scipy.special.gammainc(0.5 * (dimension - 1), 0.5 * (length**2 - along * z**2) / across)
        return float(limit * np.sum(weights * np.exp(-0.5 * z**2) * inside)) / math.sqrt(2.0 * math.pi) - 0.5

    from scipy.optimize import brentq  # imported here, as it takes as long as the rest of the module

    return float(brentq(excess, 1e-3, 3.0))
