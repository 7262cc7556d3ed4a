"""Maximum likelihood: geometric least squares, minimising F(c) = Σ(Rᵢ - R̄)² over the centre, Rᵢ = |xᵢ - c|.

Newton's method with the exact Hessian, from GDKE's or Taubin's answer: 1-8 passes over the data where Gauss-Newton
takes 7-78. Never from UGDK's, which can lie anywhere. The steps are in `newton.py`, the sums they need here. Sets that
share their draws go on side by side, pass by pass, because these are formed from what is in a cache then.

Source: paper §4.3 and Shakarji 1998, which minimise the same function by Levenberg-Marquardt.
"""

import math
from typing import Any

import numpy as np

from study.estimators.algebraic import root
from study.estimators.fit import Fit, Samples, blank
from study.estimators.kasa import member
from study.estimators.newton import ON, SEARCH, advance, begin
from study.sphere.jit import CHUNK, compiled, fill, fresh, put, zeros
from study.sphere.layouts import BLOCK, abreast, at, extent, window

_CLEAR = 0.3
"""Noise below this share of the points' least variance leaves no doubt where to begin."""


@compiled
def _pass(
    x: Any, t: int, start: int, m: int, origin: Any, center: Any, radius: float, rows: Any, sums: Any,
    zero: Any, square: Any,
) -> None:  # fmt: skip
    """Add a block of samples to the sums for a trial centre, which is taken from ``origin``.

    They are Σ(R-r), Σ(R-r)², Σ(R-r)e, Σe and, in its lower triangle, Σeeᵀ/R, whose trace is Σ1/R.
    """
    d = len(zero)
    near, away, e, pull, mean, curve = fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(square)
    for i in range(d):
        near, away = put(near, i, origin[i]), put(away, i, center[i])
    excess = squares = 0.0
    for part in range(start, start + m, CHUNK):
        count = min(CHUNK, start + m - part)
        view = window(x, t, part, count, rows, zero)
        for k in range(count):
            distance = 1e-300  # a sample may lie at the centre
            for i in range(d):
                e = put(e, i, (at(view, i, k) - near[i]) - away[i])
                distance += e[i] * e[i]
            distance = math.sqrt(distance)
            over = 1.0 / distance
            residual = distance - radius
            excess += residual
            squares += residual * residual
            for i in range(d):
                e = put(e, i, e[i] * over)
                mean = put(mean, i, mean[i] + e[i])
                pull = put(pull, i, pull[i] + e[i] * residual)
                weighted = e[i] * over
                for j in range(i + 1):
                    curve = put(curve, i * d + j, curve[i * d + j] + weighted * e[j])
    sums[0] += excess
    sums[1] += squares
    for i in range(d):
        sums[2 + i] += pull[i]
        sums[2 + d + i] += mean[i]
    for i in range(d * d):
        sums[2 + 2 * d + i] += curve[i]


@compiled
def _fit_all(
    x: Any, group: int, origin: Any, spread: Any, least: Any, offset: Any, center: Any, radius: Any, noise: Any,
    iterations: Any, status: Any, zero: Any, square: Any,
) -> None:  # fmt: skip
    """Minimise F for each set of a batch from ``offset``, which receives the centres, both taken from ``origin``.

    ``spread`` is the mean of |x - origin|², ``least`` the smallest eigenvalue of C.
    """
    b, d, n = extent(x)
    rows, search, going = np.empty((1, d, CHUNK)), np.empty(group, SEARCH), np.empty(group, np.bool_)
    sums, result = np.empty((group, 2 + 2 * d + d * d)), np.empty((group, 3))
    trial, step, descent = np.empty((group, d)), np.empty((group, d)), np.empty(d)
    matrix, vectors = np.empty((d, d)), np.empty((d, d))
    for head in range(0, b, group):
        left = 0
        for g in range(group):
            result[g, 0] = result[g, 1] = math.nan
            result[g, 2] = 0.0
            going[g] = status[head + g] == 0
            if going[g]:
                left += 1
                t, plane = head + g, (n - 1.0) * least[head + g]
                begin(search[g], spread[t], plane, offset[t], trial[g])
        while left > 0:
            for g in range(group):
                fill(sums[g], 0.0)
            for start in range(0, n, BLOCK):
                m = min(BLOCK, n - start)
                for g in range(group):
                    if going[g]:
                        t, about = head + g, search[g].radius
                        _pass(x, t, start, m, origin[t], trial[g], about, rows, sums[g], zero, square)
            for g in range(group):
                if going[g]:
                    t = head + g
                    found = advance(
                        search[g], n, sums[g], offset[t], trial[g], step[g], result[g], descent, matrix, vectors
                    )
                    if found != ON:
                        status[t], going[g] = found, False
                        left -= 1
        for g in range(group):
            t = head + g
            for i in range(d):
                center[t, i] = origin[t, i] + offset[t, i]
            radius[t], iterations[t] = result[g, 0], int(result[g, 2])
            value = max(result[g, 1], 0.0) if result[g, 1] == result[g, 1] else math.nan  # rounding can take F below 0
            noise[t] = value / (n - d - 1) if n > d + 1 else math.nan


def mle(samples: Samples) -> Fit:
    """Maximum likelihood (geometric least squares) by Newton's method with a bound.

    Isotropic noise is assumed whatever ``samples.noise`` says; the noise level itself does not enter the centre. The
    noise variance is Σ(R - r)²/(n - d - 1).

    Source: paper §4.3; Shakarji 1998.
    """
    return minimum_from(samples, 1.0)


def minimum_from(samples: Samples, share: float) -> Fit:
    """The minimum of F that Newton's method finds from x̄ + share · (ĉ - x̄).

    ĉ is Taubin's answer where the noise is clearly below the points' extent, which saves a pass or two, and GDKE's,
    which does not run away, where it is not.
    """
    b, d, _ = samples.shape
    regression = samples.regression
    eta = root(regression, 0.0)
    least = regression.spectrum.values[:, 0]
    clear = eta < _CLEAR * least
    start = member(regression, np.where(clear, eta, 0.0), 0.0)
    fit = blank(b, d)
    fit.status[:] = start.status
    offset = share * (start.center - regression.origin)
    _fit_all(
        samples.rows, abreast(samples.source), regression.origin, regression.square, least, offset,
        fit.center, fit.radius, fit.noise_variance, fit.iterations, fit.status, zeros(d), zeros(d, d),
    )  # fmt: skip
    return fit
