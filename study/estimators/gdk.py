"""The Delogne-Kása family: ĉ = x̄ + ½ (C - ηI)⁻¹ S, one rule for η per member.

Kåsa's fit minimises the algebraic distance (paper eq. 1) and has a closed form in the first moments of the data. Its
bias comes from one term alone: noise adds Σ to the sample covariance C (eq. 10) while S stays unbiased (eq. 12, exact
at every n). Subtracting the noise again removes the bias. All members share the formulas below and differ in what
they subtract.
"""

import numpy as np
from numpy.typing import NDArray

from study.estimators.fit import Fit, Samples, Status, blank
from study.sphere.linalg import eigenbasis
from study.sphere.moments import Moments

Floats = NDArray[np.float64]


def gdke(samples: Samples) -> Fit:
    """Generalised Delogne-Kása: nothing is subtracted (η = 0).

    Fast, and biased towards the centroid by (C₀ + Σ)⁻¹Σ(c₀ - μ̄) however many samples there are.

    Source: paper eqs 2-6; Kåsa 1976.
    """
    moments = samples.moments
    offset = _offset(*samples.spectrum, moments.third_central)
    trace = np.trace(moments.covariance, axis1=1, axis2=2)
    fit = _fit(moments, samples.spectrum[0], offset, trace)
    fit.noise_variance[:] = residual_noise(moments, offset)
    return fit


def ugdk(samples: Samples) -> Fit:
    """Unbiased GDK: the known noise is subtracted (η = σ², or the whole Σ).

    Where C - Σ̂ is not positive definite the paper's formula still gives a number; it is returned as it is, with the
    status that says so and the condition ρ ≥ 1.

    Source: paper eqs 15-21.
    """
    if samples.noise is None:
        raise ValueError("ugdk subtracts the noise and needs to be told it: pass noise=σ or a covariance")
    moments, noise = samples.moments, np.asarray(samples.noise)
    d = moments.mean.shape[1]
    values, vectors = samples.spectrum
    if noise.ndim == 0:
        remaining, trace_noise = values - noise**2, d * noise**2
        condition = noise**2 / values[:, 0]
    else:
        condition = _spectral_radius(noise, values, vectors)
        remaining, vectors = eigenbasis(moments.covariance - noise)
        trace_noise = np.trace(noise)
    offset = _offset(remaining, vectors, moments.third_central)
    trace = np.trace(moments.covariance, axis1=1, axis2=2) - trace_noise
    fit = _fit(moments, values, offset, trace)
    fit.noise_variance[:] = trace_noise / d
    fit.condition[:] = condition
    fit.status[(fit.status == Status.OK) & ~(remaining[:, 0] > 0.0)] = Status.NOT_POSITIVE_DEFINITE
    return fit


def residual_noise(moments: Moments, offset: Floats) -> Floats:
    """Noise variance σ² (b,) that explains the algebraic residuals of a sphere about x̄ + offset.

    The residual f = |x - c|² - r² has variance 4r²σ² + 2dσ⁴ about the true centre (theory §5.2), of which a fit of
    d + 1 parameters leaves the share (n - d - 1)/n. Below σ ≈ 1e-8 r rounding of the moments is all it sees.
    """
    n, d = moments.count, offset.shape[1]
    m2 = np.trace(moments.second, axis1=1, axis2=2) / n
    third, second = moments.third / n[:, None], moments.second / n[:, None, None]
    with np.errstate(all="ignore"):  # degenerate sets have a status of their own
        variance = (
            moments.fourth / n - m2**2
            - 4.0 * np.einsum("bi,bi->b", offset, third)
            + 4.0 * np.einsum("bi,bij,bj->b", offset, second, offset)
        )  # fmt: skip
        return noise_of_residuals(variance, m2 + np.einsum("bi,bi->b", offset, offset), n, d)


def noise_of_residuals(variance: Floats, radius_squared: Floats, count: Floats, dimension: int) -> Floats:
    """Solve 2dσ⁴ + 4r²σ² = Var f for σ² (b,), and allow for the d + 1 fitted parameters; NaN at n = d + 1."""
    spare = np.where(count > dimension + 1, count - dimension - 1, np.nan)
    variance = np.maximum(variance, 0.0)
    root = np.sqrt(4.0 * radius_squared**2 + 2.0 * dimension * variance)
    return np.asarray(variance / (2.0 * radius_squared + root) * count / spare)


def _offset(values: Floats, vectors: Floats, third: Floats) -> Floats:
    """½ (C - Σ̂)⁻¹ S (b, d), given the eigenbasis of C - Σ̂: paper eqs 2 and 17."""
    along = np.einsum("bji,bj->bi", vectors, third)
    with np.errstate(all="ignore"):  # a singular C has a status of its own
        return np.asarray(0.5 * np.einsum("bij,bj->bi", vectors, along / values))


def _fit(moments: Moments, values: Floats, offset: Floats, trace: Floats) -> Fit:
    """Centre and radius (paper eqs 3, 18, 21) with the statuses that follow from C; ``trace`` is Tr(C - Σ̂)."""
    n, d = moments.count, offset.shape[1]
    fit = blank(*offset.shape)
    fit.center[:] = moments.mean + offset
    square = (n - 1.0) / n * trace + np.einsum("bi,bi->b", offset, offset)
    fit.radius[:] = np.sqrt(np.where(square >= 0.0, square, np.nan))
    flat = ~(values[:, 0] > d * np.finfo(float).eps * values[:, -1])
    fit.status[flat] = Status.SINGULAR
    fit.status[~np.isfinite(moments.fourth)] = Status.NOT_FINITE
    lost = fit.status != Status.OK
    fit.center[lost], fit.radius[lost] = np.nan, np.nan
    return fit


def _spectral_radius(noise: Floats, values: Floats, vectors: Floats) -> Floats:
    """ρ(Σ̂C⁻¹) (b,): the largest eigenvalue of Λ^-½ Vᵀ Σ̂ V Λ^-½, which is symmetric."""
    with np.errstate(all="ignore"):
        scaled = vectors / np.sqrt(values)[:, None, :]
        similar = np.einsum("bji,jk,bkl->bil", scaled, noise, scaled)
    return eigenbasis(similar)[0][:, -1]
