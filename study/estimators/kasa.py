"""The Delogne-Kása family: ĉ = x̄ + ½ (C - ηI)⁻¹ S, with a rule for η that defines the member.

Kåsa's fit minimises the algebraic distance (paper eq. 1) and has a closed form in the first moments of the data. Its
bias comes from one term alone: noise adds Σ to the sample covariance C (eq. 10) while S stays unbiased (eq. 12, exact
at every n). Subtracting the noise again removes the bias. All members share the formulas below and differ in what
they subtract: here nothing (GDKE) or the known noise (UGDK); in `algebraic.py`, noise found in the points themselves.

About an origin o that is not the centroid, with y = x - o and q = Cov(y, |y|²), the same fit is

    ĉ - o = (C - ηI)⁻¹ (½q - ηȳ),      r̂² = mean |y|² - 2 (ĉ - o)·ȳ + |ĉ - o|² + wη,               (theory 8.1)

with w = 0 for GDKE and -d for UGDK.
"""

import math

import numpy as np

from study.estimators.estimates import Estimates, blank
from study.estimators.samples import Samples
from study.estimators.status import Status
from study.sphere.jit import compiled
from study.sphere.linalg import eigenbasis
from study.sphere.regression import Regression, Spectrum
from study.sphere.types import Bools, Floats

_EPS = 2.0**-52


def gdke(samples: Samples) -> Estimates:
    """Generalised Delogne-Kása estimator: nothing is subtracted (η = 0).

    Fast, and biased towards the centroid by (C₀ + Σ)⁻¹Σ(c₀ - μ̄) however many samples there are.

    Source: paper eqs 2-6; Kåsa 1976.
    """
    return member(samples, np.zeros(samples.shape[0]), 0.0)


def ugdk(samples: Samples) -> Estimates:
    """Unbiased GDK: the known noise is subtracted (η = σ², or the whole Σ).

    Where C - Σ̂ is not positive definite the paper's formula still gives a number. It is returned unchanged, with the
    status that says so and the condition ρ ≥ 1.

    Raises:
        ValueError: if the samples come without a noise.

    Source: paper eqs 15-21.
    """
    if samples.noise is None:
        raise ValueError("ugdk subtracts the known noise: pass noise=σ or a covariance, or use als, which finds it")
    b, d, _ = samples.shape
    noise = np.asarray(samples.noise)
    if noise.ndim == 2:
        return subtracting(samples, np.broadcast_to(noise, (b, d, d)))
    fit = member(samples, np.zeros(b) + noise**2, -float(d))
    return _with_noise(fit, np.zeros(b) + noise**2)


def member(samples: Samples, eta: Floats, radius_weight: float | Floats, kept: Bools | None = None) -> Estimates:
    """The family's fit for a given η.

    Args:
        samples: the batch.
        eta: η, which is subtracted from C, per set (b,); 0 where nothing is.
        radius_weight: w: the radius is r̂² = (n-1)/n (Tr C + wη) + |ĉ - x̄|².
        kept: eigen-directions of C that take part (b, d), all if None; along the others the centre is the centroid's.

    Returns:
        The fit, its noise variance estimated from the residuals.
    """
    spectrum = samples.spectrum
    b, d, _ = spectrum.axes.shape
    fit, weight = blank(b, d), np.zeros(b) + radius_weight
    kept = every(b, d) if kept is None else kept
    _member(samples.regression, spectrum, eta, weight, kept, fit)
    return fit


def every(batch: int, dimension: int) -> Bools:
    """All eigen-directions of C take part."""
    kept = np.empty((batch, dimension), dtype=np.bool_)
    kept.fill(True)  # np.ones takes 0.8 µs more, of the 36 of one small fit
    return kept


def subtracting(samples: Samples, noise: Floats) -> Estimates:
    """The family's fit with a covariance Σ̂ (b, d, d) of each set's own subtracted from C."""
    r, spectrum = samples.regression, samples.spectrum
    b, d = r.mean.shape
    remaining, basis = eigenbasis(r.covariance - noise)
    right = r.cross - 2.0 * np.einsum("bij,bj->bi", noise, r.mean)
    with np.errstate(all="ignore"):
        right = np.einsum("bji,bj->bi", basis, right)
    offset, fit, kept = np.empty((b, d)), blank(b, d), every(b, d)
    _offsets(Spectrum(np.stack([remaining, right, np.zeros((b, d))]), basis), np.zeros(b), kept, offset)
    fit.condition[:] = _spectral_radius(noise, spectrum)
    trace = np.trace(noise, axis1=1, axis2=2)
    _conclude(r, spectrum, offset, -(r.n - 1.0) / r.n * trace, kept, fit)
    return _with_noise(fit, trace / d)


def _with_noise(fit: Estimates, variance: Floats) -> Estimates:
    """Put a known noise variance (b,) in place of that of the residuals, where there is a sphere."""
    known = (fit.status != Status.SINGULAR) & (fit.status != Status.NOT_FINITE)
    fit.noise_variance[known] = variance[known]
    return fit


def residual_noise(regression: Regression, offset: Floats) -> Floats:
    """Noise variance σ² (b,) that explains the algebraic residuals f = |x - c|² - r² of a sphere about o + offset.

    Below σ ≈ 1e-8 r it shows nothing but the rounding of the moments.
    """
    noise, scratch = np.empty(len(offset)), np.empty(len(offset))
    _residuals(regression, offset, scratch, noise)
    return noise


@compiled
def noise_of_residuals(variance: float, mean_square: float, n: float, dimension: int) -> float:
    """Solve Var f = 4r²σ² + 2dσ⁴ for σ², with r² = mean |x - c|² - dσ² (theory §5.2).

    A fit of d + 1 parameters leaves the share (n - d - 1)/n of the variance, which is corrected for; NaN at n = d + 1,
    which leaves none.
    """
    if not n > dimension + 1:
        return math.nan
    variance = max(variance, 0.0) if variance == variance else math.nan
    root = 4.0 * mean_square * mean_square - 2.0 * dimension * variance
    root = math.sqrt(max(root, 0.0)) if root == root else math.nan
    return variance / (2.0 * mean_square + root) * n / (n - dimension - 1.0)


@compiled
def _offsets(spectrum: Spectrum, eta: Floats, kept: Bools, offset: Floats) -> None:
    """(C - ηI)⁻¹ (½q - ηȳ), paper eqs 2 and 17, from the eigenbasis of C."""
    along, axes = spectrum
    values, cross, mean = along[0], along[1], along[2]
    b, d = values.shape
    for t in range(b):
        for i in range(d):
            offset[t, i] = 0.0
        for k in range(d):
            component = mean[t, k]
            if kept[t, k]:
                component = (0.5 * cross[t, k] - eta[t] * component) / (values[t, k] - eta[t])
            for i in range(d):
                offset[t, i] += axes[t, i, k] * component


@compiled
def _least(values: Floats, kept: Bools, t: int) -> float:
    """The least eigenvalue of C that takes part."""
    for k in range(values.shape[1]):
        if kept[t, k]:
            return values[t, k]  # type: ignore[no-any-return]
    return math.inf


@compiled
def _residuals(regression: Regression, offset: Floats, excess: Floats, noise: Floats) -> None:
    """Mean |x - ĉ|², less the base, and the noise that the variance of |x - ĉ|² shows."""
    numbers, vectors, covariance = regression
    n, variance, square, base = numbers[0], numbers[1], numbers[2], numbers[3]
    mean, cross = vectors[1], vectors[2]
    b, d = offset.shape
    for t in range(b):
        spread, total = variance[t], square[t]
        weight = (n[t] - 1.0) / n[t]
        for i in range(d):
            linear = 0.0
            for j in range(d):
                linear += covariance[t, i, j] * offset[t, j]
            spread += 4.0 * weight * offset[t, i] * (linear - cross[t, i])
            total += offset[t, i] * (offset[t, i] - 2.0 * mean[t, i])
        excess[t] = total
        noise[t] = noise_of_residuals(spread, base[t] + total, n[t], d)


@compiled
def _conclude(
    regression: Regression, spectrum: Spectrum, offset: Floats, radius_term: Floats, kept: Bools, fit: Estimates
) -> None:
    """Fill in the fits whose centre is o + offset (paper eqs 3, 18, 21), with the statuses that follow from C and ρ.

    ``radius_term`` is the difference between the radius squared and the mean of |x - ĉ|². ``fit.condition`` is given.
    """
    origin, variance, base = regression.vectors[0], regression.numbers[1], regression.numbers[3]
    center, radius, noise, condition, status, _ = fit
    values = spectrum.along[0]
    b, d = offset.shape
    excess = np.empty(b)
    _residuals(regression, offset, excess, noise)
    for t in range(b):
        if condition[t] >= 1.0:
            status[t] = Status.NOT_POSITIVE_DEFINITE
        if not _least(values, kept, t) > d * _EPS * values[t, d - 1]:
            status[t] = Status.SINGULAR
        if not abs(variance[t]) < math.inf:
            status[t] = Status.NOT_FINITE
        if status[t] == Status.SINGULAR or status[t] == Status.NOT_FINITE:
            noise[t] = condition[t] = math.nan
            continue
        for i in range(d):
            center[t, i] = origin[t, i] + offset[t, i]
        beyond = excess[t] + radius_term[t]
        total = base[t] + beyond
        if total >= 0.0:
            radius[t] = math.sqrt(total)
            if base[t] > 0.0:  # the error of the radius, without the radius
                radius[t] = beyond / (radius[t] + math.sqrt(base[t]))


@compiled
def _member(
    regression: Regression, spectrum: Spectrum, eta: Floats, weight: Floats, kept: Bools, fit: Estimates
) -> None:
    """Fill in the family's fits for given η, and ρ = η/λ_min."""
    n, values = regression.numbers[0], spectrum.along[0]
    b, d = values.shape
    offset, radius_term = np.empty((b, d)), np.empty(b)
    _offsets(spectrum, eta, kept, offset)
    for t in range(b):
        fit.condition[t] = eta[t] / _least(values, kept, t) if eta[t] > 0.0 else math.nan
        radius_term[t] = (n[t] - 1.0) / n[t] * weight[t] * eta[t]
    _conclude(regression, spectrum, offset, radius_term, kept, fit)


def _spectral_radius(noise: Floats, spectrum: Spectrum) -> Floats:
    """ρ(Σ̂C⁻¹) (b,): the largest eigenvalue of Λ^-½ Vᵀ Σ̂ V Λ^-½, which is symmetric."""
    with np.errstate(all="ignore"):
        scaled = spectrum.axes / np.sqrt(spectrum.values)[:, None, :]
        similar = np.einsum("bji,bjk,bkl->bil", scaled, noise, scaled)
    return eigenbasis(similar)[0][:, -1]
