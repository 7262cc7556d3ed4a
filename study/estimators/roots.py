"""Members of the family that find the noise in the points themselves: η as the root of one equation.

With centred moments of weight 1/n, every classical algebraic fit is ĉ = x̄ + ½ (C - ηI)⁻¹ s with η the smallest root of

    g(η) = m₄ - m₂² - 4ηm₂ + ϰη² - sᵀ(C - ηI)⁻¹s                                               (theory 5.1)

and one constant ϰ each. g falls strictly on [0, λ_min), from g(0) = Var f ≥ 0 to -∞: the root is unique and C - ηI is
always positive definite. For ϰ = 2d the equation says that the variance of the algebraic residuals f equals its
theoretical value 4r²η + 2dη²: UGDK that measures its own noise.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from study.estimators.fit import Fit, Samples, Status
from study.estimators.gdk import Kept, member
from study.sphere.compiled import compiled

Floats = NDArray[np.float64]

_EPS = 2.0**-52
_MAX_STEPS = 200
_THREE_SIGMA = 0.0027
"""Share of a Gaussian beyond three standard deviations on both sides."""


@compiled
def _solve(values: Any, along: Any, m2: float, spread: float, kappa: float) -> float:
    """Root η of g in [0, λ_min) by Newton's method inside a bracket.

    ``values`` are the eigenvalues of C, ``along`` the components of s in the eigenbasis, ``spread`` = m₄ - m₂². A
    direction whose component is 0 takes no part. Written from g(0), so that a small root is not lost in large terms.
    """
    d = values.size
    start, top = spread, math.inf
    for k in range(d):
        if along[k] != 0.0:
            start -= along[k] * along[k] / values[k]
            top = min(top, values[k])
    if not (start > 0.0 and top > 0.0):
        return 0.0
    low, high, eta = 0.0, min(top, start / (2.0 * m2)), 0.0
    for _ in range(_MAX_STEPS):
        value, slope = start - 4.0 * m2 * eta + kappa * eta * eta, 2.0 * kappa * eta - 4.0 * m2
        for k in range(d):
            if along[k] != 0.0:
                rest = values[k] - eta
                value -= eta * along[k] * along[k] / (values[k] * rest)
                slope -= along[k] * along[k] / (rest * rest)
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
def _solve_all(values: Any, along: Any, m2: Any, spread: Any, kappa: float, eta: Any) -> None:
    for t in range(eta.size):
        eta[t] = _solve(values[t], along[t], m2[t], spread[t], kappa)


def root(samples: Samples, kappa: float, kept: Kept | None = None) -> Floats:
    """Root η of (5.1) for each set, in units of the sample covariance C (b,).

    Args:
        samples: the batch.
        kappa: the constant ϰ.
        kept: eigen-directions of C that take part (b, d); all, if None.
    """
    values, vectors = samples.spectrum
    moments = samples.moments
    n = moments.count
    m2 = np.trace(moments.second, axis1=1, axis2=2) / n
    weight = (n - 1.0) / n
    eta = np.empty(len(n))
    with np.errstate(all="ignore"):  # in units of √m₂, so that no power of the points' unit is lost
        along = np.einsum("bji,bj->bi", vectors, moments.third) / (n * m2 * np.sqrt(m2))[:, None]
        scaled = values * (weight / m2)[:, None]
        spread = moments.fourth / n / m2**2 - 1.0
    if kept is not None:
        along = np.where(kept, along, 0.0)
    _solve_all(scaled, along, np.ones(len(n)), spread, kappa, eta)
    with np.errstate(all="ignore"):
        return np.asarray(eta * m2 / weight)


def taubin(samples: Samples) -> Fit:
    """Taubin's fit (ϰ = 0): the gradient-weighted algebraic fit. Its tails are shorter than those of `als`.

    Source: Taubin 1991; as a member of the family, theory table 5.1.
    """
    return member(samples, root(samples, 0.0), 0.0)


def pratt(samples: Samples) -> Fit:
    """Pratt's fit (ϰ = -4).

    Source: Pratt 1987; as a member of the family, theory table 5.1.
    """
    return member(samples, root(samples, -4.0), 2.0)


def hyper(samples: Samples) -> Fit:
    """The hyperaccurate fit (ϰ = -d²), without essential bias.

    Source: Al-Sharadqah & Chernov 2009; Kanatani & Rangarajan 2011.
    """
    d = samples.shape[1]
    return member(samples, root(samples, -float(d * d)), -float(d))


def als(samples: Samples) -> Fit:
    """Adjusted least squares with unknown noise (ϰ = 2d): UGDK that measures σ² in the same points.

    Not knowing σ it does better than UGDK knowing it: the realised noise along the cap's axis differs from σ² by
    chance, the residuals show by how much, and subtracting what was realised removes that error. The noise variance
    is unbiased, nη/(n - d - 1) in weights of 1/n. Where the extent left after the subtraction is within two standard
    errors of nothing, the status says that the centre is unreliable.

    Source: Kukush, Markovsky & Van Huffel 2004, specialised to spheres; theory §5.
    """
    d = samples.shape[1]
    eta = root(samples, 2.0 * d)
    fit = member(samples, eta, -float(d))
    fit.status[(fit.status == Status.OK) & ~_significant(samples, eta, 2.0)[:, 0]] = Status.INSIGNIFICANT
    return fit


def als_guarded(samples: Samples) -> Fit:
    """`als` where it is significant, Taubin's root where it is not: an answer with short tails in every case.

    Source: theory §2.2.
    """
    d = samples.shape[1]
    eta = root(samples, 2.0 * d)
    safe = _significant(samples, eta, 2.0)[:, 0]
    guarded = member(samples, np.where(safe, eta, root(samples, 0.0)), np.where(safe, -float(d), 0.0))
    guarded.status[(guarded.status == Status.OK) & ~safe] = Status.INSIGNIFICANT
    return guarded


def hinge(samples: Samples) -> Fit:
    """`als` for points that may lie on an arc or in a plane: a direction without significant extent is dropped.

    Along a dropped direction the centre stays at the centroid; the status says that one was. The noise is found in
    the points, or as given by ``samples.noise`` (σ).

    Source: theory §1.2; with unknown noise, its rule with the two conditions of `_flat`.
    """
    if isinstance(samples.noise, np.ndarray):
        raise ValueError("hinge drops directions by one noise level: pass noise=σ, or none")
    b, d, _ = samples.shape
    values = samples.spectrum[0]
    kept = values > 8.0 * d * _EPS * values[:, -1:]
    if samples.noise is not None:
        eta = np.full(b, float(samples.noise) ** 2)
        kept &= _significant(samples, eta, 3.0)
    else:
        for k in range(d - 1):  # from the least extent upwards, as long as all below are flat
            kept[:, k] &= ~(_flat(samples, kept, k) & ~kept[:, :k].any(axis=1))
        eta = root(samples, 2.0 * d, kept)
    fit = member(samples, eta, -float(d), kept)
    fine = fit.status == Status.OK
    if samples.noise is not None:
        fit.noise_variance[fine] = eta[fine]
    else:  # a dropped direction takes no degree of freedom
        n = samples.moments.count
        with np.errstate(all="ignore"):
            fit.noise_variance[:] *= (n - d - 1.0) / (n - kept.sum(axis=1) - 1.0)
    weak = ~(_significant(samples, eta, 2.0) | ~kept).all(axis=1)
    fit.status[fine & ~kept.all(axis=1)] = Status.HINGE
    fit.status[fine & weak] = Status.INSIGNIFICANT
    lost = fine & (kept.sum(axis=1) < 2)
    fit.status[lost] = Status.SINGULAR
    fit.center[lost], fit.radius[lost], fit.noise_variance[lost], fit.condition[lost] = np.nan, np.nan, np.nan, np.nan
    return fit


def _flat(samples: Samples, kept: Kept, direction: int) -> Kept:
    """Whether an eigen-direction of C is noise alone, the noise being unknown (b,).

    It is if its eigenvalue is within three standard errors of the noise that the other directions show (each of the
    two has an error of η√(2/n)), and if it explains no more of the algebraic residuals than chance: a direction is a
    regressor there, and its F statistic is below the quantile of three standard errors. The second condition tells an
    arc's flat direction from a small cap's axis, which may be as short but carries the curvature.
    """
    values, vectors = samples.spectrum
    moments = samples.moments
    n, d = moments.count, values.shape[1]
    others = kept.copy()
    others[:, direction] = False
    eta = root(samples, 2.0 * d, others)
    along = np.einsum("bji,bj->bi", vectors, moments.third_central)
    m2 = np.trace(moments.second, axis1=1, axis2=2) / n
    spare = n - others.sum(axis=1) - 2.0
    with np.errstate(all="ignore"):
        explained = along**2 / values * ((n - 1.0) / n)[:, None]
        left = moments.fourth / n - m2**2 - np.where(others, explained, 0.0).sum(axis=1) - explained[:, direction]
        limit = stats.f.isf(_THREE_SIGMA, 1, np.maximum(spare, 1.0))
        chance = (explained[:, direction] * spare <= limit * np.maximum(left, 0.0)) & (spare > 0.0)
    return np.asarray(chance & (values[:, direction] <= eta * (1.0 + 3.0 * np.sqrt(4.0 / n))))


def _significant(samples: Samples, eta: Floats, errors: float) -> Kept:
    """Whether each eigenvalue of C exceeds the noise by so many standard errors of the noise, η√(2/n): (b, d)."""
    n = samples.moments.count
    return np.asarray(samples.spectrum[0] - eta[:, None] > errors * (eta * np.sqrt(2.0 / n))[:, None])
