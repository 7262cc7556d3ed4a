"""Maximum likelihood: geometric least squares, minimising F(c) = Σ(Rᵢ - R̄)² over the centre, Rᵢ = |xᵢ - c|.

Newton's method with the exact Hessian, from GDKE's or Taubin's answer: 1-8 passes over the data where Gauss-Newton
takes 7-78. Never from UGDK's, which can lie anywhere. `newton.py` has the steps, this file the sums that they need.
Sets that are formed from the same draws proceed side by side, pass by pass, while the draws are in a cache.

F falls off on both sides of the points: besides the minimum on the side of the sphere there may be one on the other
side, or only a slope to infinity, where the sphere is a plane (a status says so). `mle_centroid` and `mle_mirror`
start elsewhere, to show whether there are other minima, and better ones; on data use `mle`. Its answers are bad exactly
where one of these has a much better one, or none has.

Source: paper §4.3 and Shakarji 1998, which minimise the same function by Levenberg-Marquardt.
"""

import math
from typing import NamedTuple

import numpy as np

from study.estimators.algebraic import root
from study.estimators.estimates import Estimates, blank
from study.estimators.geometric.newton import ON, STATE, Room, Search, advance, begin
from study.estimators.kasa import member
from study.estimators.samples import Samples
from study.sphere.jit import CHUNK, Sums, compiled, fill, fresh, put, zeros
from study.sphere.layouts import BLOCK, PointSets, SampleBlock, Scratch, abreast, at, extent, window
from study.sphere.types import Floats

_CLEAR = 0.3
"""Noise below this share of the points' least variance leaves no doubt where to begin."""


class Start(NamedTuple):
    """Starting values of a batch.

    Attributes:
        origin: point near each set (b, d).
        spread: mean of |x - origin|² (b,).
        values: eigenvalues of C (b, d), ascending.
        offset: centre relative to the origin (b, d); receives the best centre.
    """

    origin: Floats
    spread: Floats
    values: Floats
    offset: Floats


def mle(samples: Samples) -> Estimates:
    """Maximum likelihood (geometric least squares) by Newton's method with a bound.

    Isotropic noise is assumed whatever ``samples.noise`` is; the noise level does not enter the centre. The noise
    variance is Σ(R - r)²/(n - d - 1).

    Source: paper §4.3; Shakarji 1998.
    """
    return _minimum_from(samples, 1.0)


def mle_centroid(samples: Samples) -> Estimates:
    """`mle` from the centroid of the points, between the two sides.

    Source: paper §4.1, which explains MLE's outliers by multiple solutions.
    """
    return _minimum_from(samples, 0.0)


def mle_mirror(samples: Samples) -> Estimates:
    """`mle` from the wrong side of the points: GDKE's answer reflected through their centroid.

    Source: paper §4.1, which explains MLE's outliers by multiple solutions.
    """
    return _minimum_from(samples, -1.0)


def _minimum_from(samples: Samples, share: float) -> Estimates:
    """The minimum of F that Newton's method finds from x̄ + share · (ĉ - x̄).

    ĉ is Taubin's answer where the noise is clearly below the points' extent, which saves a pass or two, and GDKE's,
    which does not run away, where it is not.
    """
    regression, values = samples.regression, samples.spectrum.values
    b, d = values.shape
    eta = root(samples, 0.0)
    clear = eta < _CLEAR * values[:, 0]
    first = member(samples, np.where(clear, eta, 0.0), 0.0)
    fit = blank(b, d)
    fit.status[:] = first.status
    start = Start(regression.origin, regression.square, values, share * (first.center - regression.origin))
    _fit_all(samples.rows, abreast(samples.source), start, fit, zeros(d), zeros(d, d))
    return fit


@compiled
def _pass(block: SampleBlock, origin: Floats, center: Floats, radius: float, sums: Floats, scratch: Scratch) -> None:
    """Add a block of samples to the sums for a trial centre, which is relative to ``origin``.

    They are Σ(R-r), Σ(R-r)², Σ(R-r)e, Σe and, in its lower triangle, Σeeᵀ/R, whose trace is Σ1/R.
    """
    x, t, start, m = block
    rows, zero, square = scratch
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
def _fit_all(x: PointSets, group: int, start: Start, fit: Estimates, zero: Sums, square: Sums) -> None:
    """Minimise F for each set of a batch whose status is ok; ``group`` sets share their draws, see `abreast`.

    ``zero`` and ``square`` are d and d² sums at zero.
    """
    b, d, n = extent(x)
    scratch = Scratch(np.empty((1, d, CHUNK)), zero, square)
    room = Room(np.empty(d), np.empty((d, d)), np.empty((d, d)))
    state, going, sums = np.empty(group, STATE), np.empty(group, np.bool_), np.empty((group, 2 + 2 * d + d * d))
    trial, step, result = np.empty((group, d)), np.empty((group, d)), np.empty((group, 3))
    for head in range(0, b, group):
        left = 0
        for g in range(group):
            t = head + g
            result[g, 0] = result[g, 1] = math.nan
            result[g, 2] = 0.0
            going[g] = fit.status[t] == 0
            if going[g]:
                left += 1
                search = Search(state[g], start.offset[t], trial[g], step[g], result[g])
                begin(search, start.spread[t], (n - 1.0) * start.values[t, 0])
        while left > 0:
            for g in range(group):
                fill(sums[g], 0.0)
            for begun in range(0, n, BLOCK):
                for g in range(group):
                    if going[g]:
                        block = SampleBlock(x, head + g, begun, min(BLOCK, n - begun))
                        _pass(block, start.origin[head + g], trial[g], state[g].radius, sums[g], scratch)
            for g in range(group):
                if going[g]:
                    t = head + g
                    search = Search(state[g], start.offset[t], trial[g], step[g], result[g])
                    status = advance(search, n, sums[g], room)
                    if status != ON:
                        fit.status[t], going[g] = status, False
                        left -= 1
        for g in range(group):
            t = head + g
            for i in range(d):
                fit.center[t, i] = start.origin[t, i] + start.offset[t, i]
            fit.radius[t], fit.iterations[t] = result[g, 0], int(result[g, 2])
            value = max(result[g, 1], 0.0) if result[g, 1] == result[g, 1] else math.nan  # rounding can take F below 0
            fit.noise_variance[t] = value / (n - d - 1) if n > d + 1 else math.nan
