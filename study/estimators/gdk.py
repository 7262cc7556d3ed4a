"""The Delogne-Kása family: ĉ = x̄ + ½ (C - ηI)⁻¹ S, one rule for η per member.

Kåsa's fit minimises the algebraic distance (paper eq. 1) and has a closed form in the first moments of the data. Its
bias comes from one term alone: noise adds Σ to the sample covariance C (eq. 10) while S stays unbiased (eq. 12, exact
at every n). Subtracting the noise again removes the bias. All members share the formulas below and differ in what
they subtract: here nothing (GDKE) or the known noise (UGDK); in `roots.py`, noise found in the points themselves.
"""

import numpy as np
from numpy.typing import NDArray

from study.estimators.fit import Fit, Samples, Status, blank
from study.sphere.linalg import eigenbasis
from study.sphere.moments import Moments

Floats = NDArray[np.float64]
Kept = NDArray[np.bool_]


def gdke(samples: Samples) -> Fit:
    """Generalised Delogne-Kása: nothing is subtracted (η = 0).

    Fast, and biased towards the centroid by (C₀ + Σ)⁻¹Σ(c₀ - μ̄) however many samples there are.

    Source: paper eqs 2-6; Kåsa 1976.
    """
    return member(samples, np.zeros(samples.shape[0]), 0.0)


def ugdk(samples: Samples) -> Fit:
    """Unbiased GDK: the known noise is subtracted (η = σ², or the whole Σ).

    Where C - Σ̂ is not positive definite the paper's formula still gives a number; it is returned as it is, with the
    status that says so and the condition ρ ≥ 1.

    Source: paper eqs 15-21.
    """
    if samples.noise is None:
        raise ValueError("ugdk subtracts the noise and needs to be told it: pass noise=σ or a covariance")
    b, d, _ = samples.shape
    noise = np.asarray(samples.noise)
    if noise.ndim == 2:
        return subtracting(samples, np.broadcast_to(noise, (b, d, d)))
    fit = member(samples, np.full(b, float(noise) ** 2), -float(d))
    fit.noise_variance[:] = noise**2
    return fit


def member(samples: Samples, eta: Floats, radius_weight: float | Floats, kept: Kept | None = None) -> Fit:
    """The family's fit for a given η.

    Args:
        samples: the batch.
        eta: what is subtracted from C, per set (b,); 0 where nothing is.
        radius_weight: the radius is r̂² = (n-1)/n (Tr C + radius_weight η) + |ĉ - x̄|².
        kept: eigen-directions of C that take part (b, d), all if None; along the others the centre is the centroid's.

    Returns:
        The fit, its noise variance estimated from the residuals.
    """
    values, vectors = samples.spectrum
    moments = samples.moments
    remaining = values - eta[:, None]
    if kept is not None:  # a dropped direction has no say: as if its extent were endless
        remaining, values = np.where(kept, remaining, np.inf), np.where(kept, values, values[:, -1:])
    offset = _offset(remaining, vectors, moments.third_central)
    with np.errstate(all="ignore"):  # degenerate sets have a status of their own
        condition = np.where(eta > 0.0, eta, np.nan) / values.min(axis=1)
    return _fit(moments, values, offset, radius_weight * eta, condition)


def subtracting(samples: Samples, noise: Floats) -> Fit:
    """The family's fit with a covariance Σ̂ (b, d, d) of each set's own subtracted from C."""
    values, vectors = samples.spectrum
    moments = samples.moments
    remaining, basis = eigenbasis(moments.covariance - noise)
    offset = _offset(remaining, basis, moments.third_central)
    trace = np.trace(noise, axis1=1, axis2=2)
    fit = _fit(moments, values, offset, -trace, _spectral_radius(noise, values, vectors))
    known = (fit.status != Status.SINGULAR) & (fit.status != Status.NOT_FINITE)
    fit.noise_variance[known] = trace[known] / offset.shape[1]
    return fit


def residual_noise(moments: Moments, offset: Floats) -> Floats:
    """Noise variance σ² (b,) that explains the algebraic residuals f = |x - c|² - r² of a sphere about x̄ + offset.

    Below σ ≈ 1e-8 r rounding of the moments is all that it sees.
    """
    n, d = moments.count, offset.shape[1]
    m2 = np.trace(moments.second, axis1=1, axis2=2) / n
    third, second = moments.third / n[:, None], moments.second / n[:, None, None]
    with np.errstate(all="ignore"):
        variance = (
            moments.fourth / n - m2**2
            - 4.0 * (offset * third).sum(axis=1)
            + 4.0 * (offset * (second * offset[:, None, :]).sum(axis=2)).sum(axis=1)
        )  # fmt: skip
        return noise_of_residuals(variance, m2 + np.einsum("bi,bi->b", offset, offset), n, d)


def noise_of_residuals(variance: Floats, mean_square: Floats, count: Floats, dimension: int) -> Floats:
    """Solve Var f = 4r²σ² + 2dσ⁴ for σ² (b,), with r² = mean |x - c|² - dσ² (theory §5.2).

    A fit of d + 1 parameters leaves the share (n - d - 1)/n of the variance, which is allowed for; NaN at n = d + 1,
    which leaves none.
    """
    spare = np.where(count > dimension + 1, count - dimension - 1, np.nan)
    variance = np.maximum(variance, 0.0)
    root = np.sqrt(np.maximum(4.0 * mean_square**2 - 2.0 * dimension * variance, 0.0))
    return np.asarray(variance / (2.0 * mean_square + root) * count / spare)


def _offset(values: Floats, vectors: Floats, third: Floats) -> Floats:
    """½ (C - Σ̂)⁻¹ S (b, d), given the eigenbasis of C - Σ̂: paper eqs 2 and 17."""
    along = np.einsum("bji,bj->bi", vectors, third)
    with np.errstate(all="ignore"):
        return np.asarray(0.5 * np.einsum("bij,bj->bi", vectors, along / values))


def _fit(moments: Moments, values: Floats, offset: Floats, trace: Floats, condition: Floats) -> Fit:
    """Centre and radius (paper eqs 3, 18, 21) with the statuses that follow from C and ρ.

    ``trace`` is what the radius adds to Tr C: -Tr Σ̂ for UGDK.
    """
    n, d = moments.count, offset.shape[1]
    fit = blank(*offset.shape)
    fit.center[:] = moments.mean + offset
    with np.errstate(all="ignore"):
        square = (n - 1.0) / n * (np.trace(moments.covariance, axis1=1, axis2=2) + trace)
        square += np.einsum("bi,bi->b", offset, offset)
        fit.radius[:] = np.sqrt(np.where(square >= 0.0, square, np.nan))
    fit.noise_variance[:] = residual_noise(moments, offset)
    fit.condition[:] = condition
    fit.status[condition >= 1.0] = Status.NOT_POSITIVE_DEFINITE
    fit.status[~(values[:, 0] > d * np.finfo(float).eps * values[:, -1])] = Status.SINGULAR
    fit.status[~np.isfinite(moments.fourth)] = Status.NOT_FINITE
    lost = (fit.status == Status.SINGULAR) | (fit.status == Status.NOT_FINITE)
    fit.center[lost], fit.radius[lost], fit.noise_variance[lost] = np.nan, np.nan, np.nan
    fit.condition[lost] = np.nan
    return fit


def _spectral_radius(noise: Floats, values: Floats, vectors: Floats) -> Floats:
    """ρ(Σ̂C⁻¹) (b,): the largest eigenvalue of Λ^-½ Vᵀ Σ̂ V Λ^-½, which is symmetric."""
    with np.errstate(all="ignore"):
        scaled = vectors / np.sqrt(values)[:, None, :]
        similar = np.einsum("bji,bjk,bkl->bil", scaled, noise, scaled)
    return eigenbasis(similar)[0][:, -1]
