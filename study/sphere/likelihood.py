"""Log-likelihoods of a sphere given points, for many spheres at once, up to a constant.

Geometric: the distances Rᵢ = |xᵢ - c| are normal about r with the noise's σ. Maximum likelihood (paper §4.3)
maximises it. It says nothing about directions, and holds for any cap.

Whole sphere: the density of a point x = c + r u + σ z with u uniform on the whole sphere, integrated over u. With
k = Rr/σ² and ν = d/2 - 1 it is (2πσ²)^(-d/2) exp(-(R - r)²/2σ²) Γ(ν+1) (2/k)^ν e^-k I_ν(k), and in three dimensions
the Bessel function is a sinh. For k ≫ 1 it is the geometric one times (R r)^(-(d-1)/2) per point, which moves the
radius by -(d-1)σ²/2r. It counts it as evidence where no points are, and so is wrong on a cap (theory §6).

Spheres are given as offsets from a reference (c*, r*) near the data's own: R - r is then formed without the
cancellation that would cost all digits where σ ≪ r.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy

from study.sphere.jit import compiled
from study.sphere.types import Floats


class Reference(NamedTuple):
    """A point set relative to a reference sphere.

    Attributes:
        away: points less the reference centre (d, n).
        distance: their lengths (n,).
        excess: distances less the reference radius (n,).
        radius: the reference radius.
    """

    away: Floats
    distance: Floats
    excess: Floats
    radius: float

    @classmethod
    def of(cls, points: Floats, center: Floats, radius: float) -> "Reference":
        """Express points (d, n) relative to a centre (d,) and a radius."""
        away = np.ascontiguousarray(points - center[:, None])
        distance = np.sqrt(np.einsum("dn,dn->n", away, away))
        return cls(away, distance, distance - radius, float(radius))


def geometric(reference: Reference, offsets: Floats, log_noise: Floats) -> Floats:
    """Geometric log-likelihood: -N log σ - Σ(Rᵢ - r)²/2σ².

    Args:
        reference: the points.
        offsets: centre less the reference's, and radius less the reference's (k, d+1).
        log_noise: log σ (k,).

    Returns:
        The log-likelihood of each sphere (k,), up to the same constant.
    """
    squares = np.empty(len(offsets))
    _square_sums(reference, offsets, squares)
    return np.asarray(-0.5 * squares * np.exp(-2.0 * log_noise) - len(reference.distance) * log_noise)


def whole_sphere(reference: Reference, offsets: Floats, log_noise: Floats) -> Floats:
    """Log-likelihood of points that are spread evenly over the whole sphere; arguments as for `geometric`."""
    d, n = reference.away.shape
    residuals = np.empty((len(offsets), n))
    _residuals(reference, offsets, residuals)
    radius = reference.radius + offsets[:, d:]
    precision = np.exp(-2.0 * log_noise)[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):  # spheres without a radius, which the prior rules out
        k = (residuals + radius) * radius * precision
        logs = -0.5 * residuals**2 * precision + _log_spread(k, d)
        return np.asarray(logs.sum(axis=1) - d * n * log_noise)


def _log_spread(k: Floats, dimension: int) -> Floats:
    """Log of e^-k I_ν(k) Γ(ν+1) (2/k)^ν, ν = d/2 - 1; 0 at k = 0."""
    k = np.maximum(k, 1e-20)
    if dimension == 3:
        return np.asarray(np.log(-np.expm1(-2.0 * k) / (2.0 * k)))
    order = 0.5 * dimension - 1.0
    bessel = np.log(scipy.special.ive(order, np.minimum(k, 1e8)))
    large = -0.5 * np.log(2.0 * math.pi * k) + np.log1p((0.125 - 0.5 * order**2) / k)
    return np.asarray(np.where(k > 1e8, large, bessel) + math.lgamma(order + 1.0) + order * np.log(2.0 / k))


@compiled
def _square_sums(reference: Reference, offsets: Floats, squares: Floats) -> None:
    """Σ(Rᵢ - r)² for each offset."""
    k, n = len(offsets), reference.distance.size
    residuals = np.empty((1, n))
    for j in range(k):
        _residuals(reference, offsets[j : j + 1], residuals)
        square, row = 0.0, residuals[0]
        for i in range(n):
            square += row[i] * row[i]
        squares[j] = square


@compiled
def _residuals(reference: Reference, offsets: Floats, residuals: Floats) -> None:
    """Rᵢ - r of each offset (k, n), from |y - δ| - |y| = (|δ|² - 2 y·δ) / (|y - δ| + |y|)."""
    away, distance, excess, _ = reference
    d, n = away.shape
    for j in range(len(offsets)):
        row = residuals[j]
        square = 0.0
        for i in range(d):
            square += offsets[j, i] ** 2
        for m in range(n):
            row[m] = square
        for i in range(d):
            y, twice = away[i], 2.0 * offsets[j, i]
            for m in range(n):
                row[m] -= twice * y[m]
        rise = offsets[j, d]
        for m in range(n):
            reach = distance[m] * distance[m] + row[m]
            row[m] = excess[m] + row[m] / (math.sqrt(max(reach, 0.0)) + distance[m] + 1e-300) - rise
