"""Fisher information and Cramér-Rao bound of a sphere's centre and radius.

The functional model: each sample lies at c + r u plus Gaussian noise of covariance Σ, its direction u fixed and
unknown. Eliminating the directions leaves the information along the normals (theory (3.1))

    J = Σᵢ wᵢ wᵢᵀ / (uᵢᵀ Σ uᵢ),   w = (u, 1),   CRLB(c, r) = J⁻¹,

which bounds unbiased estimators. J is inverted through the centred directions, because Σ w wᵀ of a small cap is
singular to rounding while the scatter about the mean direction is not.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from study.arrays import Bools, Floats, real_array
from study.fits.loops.jit import CHUNK, Sums, View, at, compiled, fresh, put, total, window, zeros
from study.fits.loops.linalg import eigenbasis
from study.fits.points.noise import is_per_point, point_noise, unit_covariance

_FLAT = 4 * 2.0**-52
"""Least eigenvalue of K over the largest, per dimension, up to which it is rounding: the bound is infinite."""

_UNIT = 2e-6
"""Largest difference of the squared length of a unit vector from 1."""


@compiled
def _sums(view: View, weights: Floats, middle: Sums, square: Sums) -> tuple[Sums, Sums]:
    """Σωy and the lower triangle of Σωyyᵀ, y = u - middle, of as many samples of a set as there are weights."""
    d = len(middle)
    y, first, second = fresh(middle), fresh(middle), fresh(square)
    for i in range(d):
        first = put(first, i, 0.0)
    for k in range(weights.size):
        for i in range(d):
            y = put(y, i, at(view, i, k) - middle[i])
        for i in range(d):
            weighted = weights[k] * y[i]
            first = put(first, i, first[i] + weighted)
            for j in range(i + 1):
                second = put(second, i * d + j, second[i * d + j] + weighted * y[j])
    return first, second


@compiled
def scatter_all(
    directions: Floats, weights: Floats, sums: Floats, mean: Floats, scatter: Floats, zero: Sums, square: Sums
) -> None:
    """Sums of `weighted_scatter` in one pass, about the mean of the first samples with weight: sums about 0 cancel."""
    b, d, n = directions.shape
    rows = np.empty((1, d, CHUNK))
    for t in range(b):
        weight, begun = weights[t % len(weights)], 0
        part = weight[: min(CHUNK, n)]
        while begun + CHUNK < n and weight.size == n and not total(part) > 0.0:  # outliers, or missing
            begun += CHUNK
            part = weight[begun : min(begun + CHUNK, n)]
        view = window(directions, t, begun, part.size, rows, zero)
        middle, _ = _sums(view, part, zero, square)
        whole = total(part)
        for i in range(d):
            middle = put(middle, i, middle[i] / whole)
        whole, first, second = 0.0, fresh(zero), fresh(square)
        for start in range(0, n, CHUNK):
            place = start % weight.size
            part = weight[place : place + min(CHUNK, n - start)]
            view = window(directions, t, start, part.size, rows, zero)
            more, squares = _sums(view, part, middle, square)
            whole += total(part)
            for i in range(d):
                first = put(first, i, first[i] + more[i])
            for i in range(d * d):
                second = put(second, i, second[i] + squares[i])
        sums[t] = whole
        for i in range(d):
            mean[t, i] = middle[i] + first[i] / whole
            for j in range(i + 1):
                scatter[t, i, j] = scatter[t, j, i] = second[i * d + j] - first[i] * first[j] / whole


def weighted_scatter(directions: Floats, weights: Floats) -> tuple[Floats, Floats, Floats]:
    """Σω, ū = Σωu/Σω and Σω(u-ū)(u-ū)ᵀ for a batch of directions (b, d, n) and weights (b, n), or (1, n) for all.

    Weights (1, CHUNK), or (b, CHUNK), are those of each chunk of samples: equal weights need no row of their own.
    """
    b, d, _ = directions.shape
    sums, mean, scatter = np.empty(b), np.empty((b, d)), np.empty((b, d, d))
    scatter_all(np.ascontiguousarray(directions), weights, sums, mean, scatter, zeros(d), zeros(d, d))
    return sums, mean, scatter


@compiled
def _invert(sums: Floats, mean: Floats, values: Floats, vectors: Floats, bound: Floats) -> None:
    """Block inversion of J, given the eigenbasis of the scatter K, where that is regular."""
    b, d = mean.shape
    for t in range(b):
        if not values[t, 0] > d * _FLAT * values[t, d - 1]:
            continue
        radius = 1.0 / sums[t]
        for i in range(d):
            across = 0.0
            for j in range(d):
                inverse = 0.0
                for k in range(d):
                    inverse += vectors[t, i, k] * vectors[t, j, k] / values[t, k]
                bound[t, i, j] = inverse
                across += inverse * mean[t, j]
            bound[t, i, d] = bound[t, d, i] = -across
            radius += across * mean[t, i]
        bound[t, d, d] = radius


def bound_from_scatter(sums: Floats, mean: Floats, scatter: Floats) -> Floats:
    """Invert J from its centred form: the bound (b, d+1, d+1), infinite where the directions leave c undetermined.

    With K = Σω(u-ū)(u-ū)ᵀ, block inversion gives K⁻¹ for the centre, -K⁻¹ū between, 1/Σω + ūᵀK⁻¹ū for the radius.
    """
    b, d = mean.shape
    bound = np.full((b, d + 1, d + 1), np.inf)
    _invert(sums, mean, *eigenbasis(scatter), bound)
    return bound


def crlb(directions: ArrayLike, noise: ArrayLike) -> Floats:
    """Cramér-Rao lower bound to the covariance of an unbiased estimate of (centre, radius).

    It treats the directions as known, and does not depend on the radius. `study.attainable_bound` does not treat them
    as known.

    Args:
        directions: unit vectors (…, n, d) from the centre to the true positions, d ≥ 2; leading axes are a batch.
            Those with a NaN, or masked, are missing.
        noise: standard deviation σ of each coordinate, in the unit in which the bound is wanted, or the covariance Σ
            (d, d) of a sample, unit squared. Where samples differ: σ of each (n,), of each coordinate of each (n, d),
            or the covariance of each (n, d, d), with the leading axes of the directions or none.

    Returns:
        Bound (…, d+1, d+1), unit squared; infinite where the directions do not determine the centre.

    Raises:
        TypeError: if the directions or the noise are not real numbers.
        ValueError: if the shape or the noise cannot be used, or a direction is not of length 1. The message says which
            and why.

    Examples:
        >>> import study
        >>> bound = study.crlb([[1, 0], [0, 1], [-1, 0], [0, -1]], noise=0.1)
        >>> bound.diagonal().round(6)
        array([0.005 , 0.005 , 0.0025])

    Source: paper §4.2; the elimination of the directions is theory (3.1).
    """
    u = real_array(directions, "directions").astype(float, copy=False)
    if u.ndim < 2 or u.shape[-1] < 2:
        raise ValueError(f"directions have shape {u.shape}: expected (…, n, d) with d ≥ 2")
    *lead, n, d = u.shape
    present = np.logical_not(np.isnan(u).any(axis=-1))
    _assert_unit(u, present)
    if n == 0:
        return np.full((*lead, d + 1, d + 1), np.inf)
    sets = math.prod(lead)
    if is_per_point(np.shape(noise), n, d):
        covariance, unit = _unit_covariances(noise, (*lead, n), d)
        present &= np.isfinite(covariance).all(axis=(-1, -2))
        covariance = covariance.reshape(sets, n, d, d)
    else:
        covariance, unit = unit_covariance(noise, d)
    u, present = np.where(present[..., None], u, 0.0).reshape(sets, n, d), present.reshape(sets, n)
    with np.errstate(divide="ignore", invalid="ignore"):  # a set may have no direction at all
        weights = np.where(present, normal_weights(u, covariance), 0.0)
    sums, mean, scatter = weighted_scatter(u.swapaxes(1, 2), weights)
    return np.asarray(bound_from_scatter(sums, mean, scatter) * unit).reshape(*lead, d + 1, d + 1)


def _assert_unit(directions: Floats, present: Bools) -> None:
    """Raise a ValueError if a direction (…, n, d) that is present is not of length 1."""
    with np.errstate(all="ignore"):
        square = np.einsum("...i,...i->...", directions, directions)
        wrong = present & ~(np.abs(square - 1.0) <= _UNIT)
    if wrong.any():
        place = tuple(int(i) for i in np.argwhere(wrong)[0])
        where, length = ", ".join(map(str, place)), float(np.sqrt(square[place]))
        remedy = "divide each vector from the centre by its length"
        raise ValueError(f"directions[{where}] has length {length:.6g}: expected unit vectors; {remedy}")


def normal_weights(directions: Floats, covariance: Floats) -> Floats:
    """Information of each sample along its own direction, 1/(uᵀΣu): (…, n) for directions (…, n, d).

    ``covariance`` is that of all samples (d, d), or of each (…, n, d, d).
    """
    return np.asarray(1.0 / np.einsum("...i,...ij,...j->...", directions, covariance, directions))


def _unit_covariances(noise: ArrayLike, shape: tuple[int, ...], d: int) -> tuple[Floats, float]:
    """Covariances (…, n, d, d) of size 1 of samples of a shape (…, n), NaN where one has none, and their unit."""
    full = point_noise(real_array(noise, "noise").astype(float), (*shape, d), "directions")
    full = full[..., None, None] * np.eye(d) if full.ndim == 2 else full
    full = np.where(np.einsum("bnii->bn", full)[..., None, None] > 0.0, full, np.nan).reshape(*shape, d, d)
    unit = float(np.ldexp(1.0, np.frexp(np.nanmax(np.einsum("...ii->...", full)))[1]))
    return full / unit, unit
