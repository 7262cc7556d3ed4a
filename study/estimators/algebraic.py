"""Members of the family that find the noise in the points themselves: η is the root of one equation.

With centred moments of weight 1/n, every classical algebraic fit is ĉ = x̄ + ½ (C - ηI)⁻¹ s with η the smallest root of

    g(η) = m₄ - m₂² - 4ηm₂ + ϰη² - sᵀ(C - ηI)⁻¹s                                               (theory 5.1)

and one constant ϰ each. g falls strictly on [0, λ_min), from g(0) = Var f ≥ 0 to -∞: the root is unique and C - ηI is
always positive definite. For ϰ = 2d the equation says that the variance of the algebraic residuals f equals its
theoretical value 4r²η + 2dη²: UGDK that measures its own noise.
"""

import math

import numpy as np

from study.estimators.estimates import Estimates
from study.estimators.kasa import every, member
from study.estimators.samples import Samples
from study.estimators.status import Status
from study.sphere.jit import compiled
from study.sphere.regression import Regression, Spectrum
from study.sphere.types import Bools, Floats

_EPS = 2.0**-52
_MAX_STEPS = 200
_FULLER = (2.0, 7.0)
"""Fuller's constant α where the points determine the curvature well, and where they do not."""
_SEEN = 5.0
"""Wald statistic of the curvature at which α is halfway: noise on a plane exceeds it once in forty times."""
_THREE_SIGMA = 0.0027
"""Share of a Gaussian beyond three standard deviations on both sides."""


@compiled
def smallest_root(values: Floats, cross: Floats, mean: Floats, square: float, spread: float, kappa: float) -> float:
    """Root η of g in [0, λ_min) by Newton's method inside a bracket.

    About any origin o, with y = x - o (theory 8.2),

        g(η) = Var |y|² - 4η mean |y|² + ϰη² - Σ (q_k - 2ηȳ_k)²/(λ_k - η)

    over the eigen-directions k of C; a direction without components takes no part. ``square`` is the mean of |y|²,
    ``spread`` the variance. Written from g(0), so that a small root is not lost in large terms.
    """
    d = values.size
    start, top, extent = spread, math.inf, 0.0
    for k in range(d):
        extent += values[k]
        if cross[k] != 0.0 or mean[k] != 0.0:
            start -= cross[k] * cross[k] / values[k]
            top = min(top, values[k])
    if not (start > 0.0 and top > 0.0):
        return 0.0
    low, high, eta = 0.0, min(top, start / (2.0 * extent)), 0.0
    for _ in range(_MAX_STEPS):
        value, slope = start - 4.0 * square * eta + kappa * eta * eta, 2.0 * kappa * eta - 4.0 * square
        for k in range(d):
            q, y = cross[k], mean[k]
            if q != 0.0 or y != 0.0:
                rest = values[k] - eta
                p = q - 2.0 * eta * y
                value -= eta * (q * q - 4.0 * values[k] * y * (q - eta * y)) / (values[k] * rest)
                slope -= p * (p - 4.0 * y * rest) / (rest * rest)
        if value > 0.0:
            low = eta
        else:
            high = eta
        step = -value / slope
        following = eta + step
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - eta) <= 4.0 * _EPS * following:
            return following
        eta = following
    return eta


@compiled
def _solve_all(regression: Regression, spectrum: Spectrum, kappa: float, kept: Bools, eta: Floats) -> None:
    """The root for each set, found in units of its own size, so that no power of the points' unit overflows."""
    values, cross, mean = spectrum.along[0], spectrum.along[1], spectrum.along[2]
    numbers = regression.numbers
    b, d = values.shape
    extent, q, y = np.empty(d), np.empty(d), np.empty(d)
    for t in range(b):
        n = numbers[0, t]
        unit, weight = numbers[3, t] + numbers[2, t], (n - 1.0) / n
        root = math.sqrt(unit)
        for k in range(d):
            extent[k] = values[t, k] * weight / unit
            q[k] = cross[t, k] * weight / (unit * root) if kept[t, k] else 0.0
            y[k] = mean[t, k] / root if kept[t, k] else 0.0
        spread = numbers[1, t] / unit / unit
        eta[t] = smallest_root(extent, q, y, 1.0, spread, kappa) * unit / weight


def root(samples: Samples, kappa: float, kept: Bools | None = None) -> Floats:
    """Root η of (5.1) for each set, in units of the sample covariance C (b,).

    Args:
        samples: the batch.
        kappa: the constant ϰ.
        kept: eigen-directions of C that take part (b, d); all, if None.
    """
    spectrum = samples.spectrum
    b, d, _ = spectrum.axes.shape
    eta = np.empty(b)
    kept = every(b, d) if kept is None else kept
    _solve_all(samples.regression, spectrum, kappa, kept, eta)
    return eta


def taubin(samples: Samples) -> Estimates:
    """Taubin's fit (ϰ = 0): the gradient-weighted algebraic fit. Its errors have shorter tails than those of `als`.

    Source: Taubin 1991; as a member of the family, theory table 5.1.
    """
    return member(samples, root(samples, 0.0), 0.0)


def pratt(samples: Samples) -> Estimates:
    """Pratt's fit (ϰ = -4).

    Source: Pratt 1987; as a member of the family, theory table 5.1.
    """
    return member(samples, root(samples, -4.0), 2.0)


def hyper(samples: Samples) -> Estimates:
    """The hyperaccurate fit (ϰ = -d²), without essential bias.

    Source: Al-Sharadqah & Chernov 2009; Kanatani & Rangarajan 2011.
    """
    d = samples.shape[1]
    return member(samples, root(samples, -float(d * d)), -float(d))


def als(samples: Samples) -> Estimates:
    """Adjusted least squares with unknown noise (ϰ = 2d): UGDK that measures σ² in the same points.

    It does better than UGDK does with the true σ: the realised noise along the cap's axis differs from σ² by chance,
    the residuals show by how much, and subtracting the realised noise removes that error. The noise variance is
    unbiased, nη/(n - d - 1) in weights of 1/n. Where the extent left after the subtraction is within two standard
    errors of zero, the status says that the centre is unreliable.

    Source: Kukush, Markovsky & Van Huffel 2004, specialised to spheres; theory §5.
    """
    d = samples.shape[1]
    eta = root(samples, 2.0 * d)
    fit = member(samples, eta, -float(d))
    fit.status[(fit.status == Status.OK) & ~_significant(samples, eta, 2.0)[:, 0]] = Status.INSIGNIFICANT
    return fit


def fuller(samples: Samples) -> Estimates:
    """`als` with Fuller's modification: η(1 - α/N) is subtracted instead of η, α from 2 to 7.

    It changes the centre by O(1/N) of its error and bounds it: `als` has errors with a 1/x tail, this has none. The
    status is that of `als`.

    Source: Fuller 1987 §2.5; theory §9.3, (9.4).
    """
    eta = root(samples, 2.0 * samples.shape[1])
    return shrunk(samples, eta, fuller_constant(samples))


def fuller_constant(samples: Samples) -> Floats:
    """Fuller's α for each set (b,).

    The least mean square error needs more of his term where the points hardly determine the curvature, and none where
    they do.

    Source: theory (9.4).
    """
    alpha = np.empty(len(samples.regression.n))
    _constants(samples.regression, samples.spectrum, alpha)
    return alpha


@compiled
def _constants(regression: Regression, spectrum: Spectrum, alpha: Floats) -> None:
    few, many = _FULLER
    for t in range(alpha.size):
        alpha[t] = few + (many - few) / (1.0 + (_wald_of_curvature(regression, spectrum, t) / _SEEN) ** 2)


@compiled
def _wald_of_curvature(regression: Regression, spectrum: Spectrum, t: int) -> float:
    """Wald statistic W of the curvature across the least extent (theory 9.4), from set t of a batch.

    It tests whether |y|², regressed on y = x - x̄, depends on y along the least eigen-direction of C. By chance alone it
    is about 1, as where noise hides the curvature of a cap; it is infinite where the regression leaves no residuals.
    """
    values, cross, mean = spectrum.along[0, t], spectrum.along[1, t], spectrum.along[2, t]
    n, size, left = regression.numbers[0, t], math.sqrt(regression.numbers[1, t]), 1.0
    for k in range(values.size):
        if values[k] > 0.0:
            # A correlation first: squares of covariances would overflow in large units.
            correlation = cross[k] / (math.sqrt(values[k]) * size)
            left -= correlation * correlation * (n - 1.0) / n
    least = (cross[0] - 2.0 * values[0] * mean[0]) / (math.sqrt(values[0]) * size)
    if not left > 0.0:
        return math.inf
    return (n - 1.0) * least * least / left if least == least else 0.0


def shrunk(samples: Samples, eta: Floats, alpha: Floats) -> Estimates:
    """The fit of `fuller` from the root η (b,) of `als` and Fuller's α (b,)."""
    shrink = np.maximum(1.0 - alpha / samples.regression.n, 0.0)
    fit = member(samples, shrink * eta, -float(samples.shape[1]))
    fit.status[(fit.status == Status.OK) & ~_significant(samples, eta, 2.0)[:, 0]] = Status.INSIGNIFICANT
    return fit


def hinge(samples: Samples) -> Estimates:
    """`als` for points that may lie on an arc or in a plane: a direction without significant extent is dropped.

    Along a dropped direction the centre stays at the centroid, and the status says so. The noise is found in the
    points, or is ``samples.noise`` (σ) if that is given.

    Raises:
        ValueError: if the noise is a covariance.

    Source: theory §1.2; with unknown noise, its rule with the two conditions of `_flat`.
    """
    if np.ndim(samples.noise if samples.noise is not None else 0.0) == 2:
        raise ValueError("hinge compares every direction with one noise level: pass noise=σ, not a covariance, or none")
    b, d, _ = samples.shape
    values = samples.spectrum.values
    kept = values > 8.0 * d * _EPS * values[:, -1:]
    if samples.noise is not None:
        eta = np.zeros(b) + np.square(samples.noise)
        kept &= _significant(samples, eta, 3.0)
    else:
        for k in range(d - 1):  # from the least extent upwards, as long as all before are flat
            kept[:, k] &= ~(_flat(samples, kept, k) & ~kept[:, :k].any(axis=1))
        eta = root(samples, 2.0 * d, kept)
    fit = member(samples, eta, -float(d), kept)
    fine = fit.status == Status.OK
    if samples.noise is not None:
        fit.noise_variance[fine] = eta[fine]
    else:  # a dropped direction takes no degree of freedom
        n = samples.regression.n
        with np.errstate(all="ignore"):
            fit.noise_variance[:] *= (n - d - 1.0) / (n - kept.sum(axis=1) - 1.0)
    weak = ~(_significant(samples, eta, 2.0) | ~kept).all(axis=1)
    fit.status[fine & ~kept.all(axis=1)] = Status.HINGE
    fit.status[fine & weak] = Status.INSIGNIFICANT
    lost = fine & (kept.sum(axis=1) < 2)
    fit.status[lost] = Status.SINGULAR
    for numbers in (fit.center, fit.radius, fit.noise_variance, fit.condition):
        numbers[lost] = np.nan
    return fit


def _flat(samples: Samples, kept: Bools, direction: int) -> Bools:
    """True where an eigen-direction of C holds noise alone, the noise being unknown (b,).

    Two conditions define it. Its eigenvalue is within three standard errors of the noise that the other directions
    show (each of the two has an error of η√(2/n)). And it explains no more of the algebraic residuals than chance: a
    direction is a regressor there, and its F statistic is below the quantile of three standard errors. The second
    condition separates an arc's flat direction from a small cap's axis, which may be as short but carries the
    curvature.
    """
    from scipy.special import fdtri  # imported here, as it takes as long as the rest of the library

    regression = samples.regression
    values, along = samples.spectrum.values, samples.spectrum.cross
    n, d = regression.n, values.shape[1]
    others = kept.copy()
    others[:, direction] = False
    eta = root(samples, 2.0 * d, others)
    spare = n - others.sum(axis=1) - 2.0
    with np.errstate(all="ignore"):
        explained = along**2 / values * ((n - 1.0) / n)[:, None]
        left = regression.variance - np.where(others, explained, 0.0).sum(axis=1) - explained[:, direction]
        limit = fdtri(1, np.maximum(spare, 1.0), 1.0 - _THREE_SIGMA)
        chance = (explained[:, direction] * spare <= limit * np.maximum(left, 0.0)) & (spare > 0.0)
    return np.asarray(chance & (values[:, direction] <= eta * (1.0 + 3.0 * np.sqrt(4.0 / n))))


def _significant(samples: Samples, eta: Floats, errors: float) -> Bools:
    """True where an eigenvalue of C exceeds the noise by so many standard errors of the noise, η√(2/n): (b, d)."""
    n = samples.regression.n
    return np.asarray(samples.spectrum.values - eta[:, None] > errors * (eta * np.sqrt(2.0 / n))[:, None])
