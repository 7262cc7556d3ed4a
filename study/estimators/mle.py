"""Maximum likelihood: geometric least squares, minimising F(c) = Σ(Rᵢ - R̄)² over the centre, Rᵢ = |xᵢ - c|.

Newton's method with the exact Hessian, from GDKE's or Taubin's answer: 1-8 passes over the data where Gauss-Newton
takes 7-78. Never from UGDK's, which can lie anywhere. With e = (x - c)/R and r = R̄,

    ½∇F = -Σ(R - r)e,    ½∇²F = Σ[(1 - r/R) I + (r/R) eeᵀ] - n ē ēᵀ,

and where that is not positive definite its eigenvalues are replaced by their absolute values. A step is at most the
current radius long and is halved until F falls. On a small cap the infimum can lie at infinity, where the sphere is
a plane: the centre is stopped at a bound, and the status says so.

Source: paper §4.3 and Shakarji 1998, which minimise the same function by Levenberg-Marquardt.
"""

import math
from typing import Any

import numpy as np

from study.estimators.fit import Fit, Samples, Status, blank
from study.estimators.gdk import member
from study.estimators.roots import root
from study.sphere.compiled import CHUNK, compiled, dot, fresh, put, window, zeros
from study.sphere.linalg import cholesky_solve, diagonalise

_MAX_ITERATIONS = 100
_MAX_HALVINGS = 40
_TOLERANCE = 1e-9
"""A Newton step below this share of the radius ends the iteration: the next one would be its square."""
_CLEAR = 0.3
"""Noise below this share of the points' least variance leaves no doubt where to begin."""
_SHORT, _SURE = 1e-2, 1e-10
"""So does a step this short, beside the one before it and the radius, if it lets expect a next one this short ..."""
_THIRD = 1e-8
"""... and what is of third order in it is this short beside F."""
_EPS = 2.0**-52
_LEVEL = 0.01
"""Where rounding ends the iteration although Newton's step is above this share of the radius, F has levelled off on the
way to a plane: it no longer tells centres apart that differ."""
_FAR = 1e-5
"""An iteration that does not end beyond this share of the bound is on its way to it."""
_CANCELLED = 1e4
"""F is formed about the last radius. Where a long step leaves less than this share of the sum, it is formed again."""
_FLAT = 1e-15
"""Least curvature, per sample, that a step is divided by."""
_BOUND = 1e8
"""Largest distance from the centroid, in units of the points' spread √Tr C: so flat a sphere is a plane in float64."""


@compiled
def _pass(x: Any, t: int, origin: Any, center: Any, radius: float, rows: Any, zero: Any, square: Any) -> Any:
    """One pass over a point set for a trial centre, which is taken from ``origin``.

    Returns Σ(R-r), Σ(R-r)², Σ(R-r)e, Σe and, in its lower triangle, Σeeᵀ/R, whose trace is Σ1/R.
    """
    d, n = len(zero), x.shape[2]
    near, away, e, pull, mean, curve = fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(square)
    for i in range(d):
        near, away = put(near, i, origin[i]), put(away, i, center[i])
    excess = squares = 0.0
    for start in range(0, n, CHUNK):
        m = min(CHUNK, n - start)
        y, s, first = window(x, t, start, m, rows, zero)
        for k in range(m):
            distance = 1e-300  # a sample may lie at the centre
            for i in range(d):
                e = put(e, i, (y[s, i, first + np.uintp(k)] - near[i]) - away[i])
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
    return excess, squares, pull, mean, curve


@compiled
def _trace(square: Any, d: int) -> float:
    result = 0.0
    for i in range(d):
        result += square[i * d + i]
    return result


@compiled
def _half_hessian(n: int, radius: float, mean: Any, curve: Any, matrix: Any) -> None:
    """½∇²F from the sums of a pass."""
    d, inverse = len(mean), _trace(curve, len(mean))
    for i in range(d):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = radius * curve[i * d + j] - mean[i] * mean[j] / n
        matrix[i, i] += n - radius * inverse


@compiled
def _minimise(
    x: Any, t: int, origin: Any, radius: float, a: Any, bound: float, result: Any, rows: Any, zero: Any, square: Any
) -> int:
    """Minimise F for one point set of a batch; ``a`` is the start, from ``origin``, and receives the centre.

    ``radius`` is the start's; ``result`` receives the radius, F and the number of steps.
    """
    d, n = x.shape[1], x.shape[2]
    matrix, vectors = np.empty((d, d)), np.empty((d, d))
    step, descent, trial = np.empty(d), np.empty(d), a.copy()
    best, before, halvings, steps, wanted, size, last = math.inf, radius, 0, 0, 0.0, 0.0, 0.0
    while True:
        excess, squares, pull, mean, curve = _pass(x, t, origin, trial, radius, rows, zero, square)
        value = squares - excess * excess / n
        if excess * excess > _CANCELLED * n * value:
            radius += excess / n
            excess, squares, pull, mean, curve = _pass(x, t, origin, trial, radius, rows, zero, square)
            value = squares - excess * excess / n
        newton = True
        if value <= best:
            best, halvings = value, 0
            a[:] = trial
            before = radius + excess / n  # R̄, the radius that belongs to this centre
            result[0], result[1], result[2] = before, best, float(steps)
            if steps >= _MAX_ITERATIONS:
                return Status.AT_BOUND if size > (_FAR * bound) ** 2 else Status.NOT_CONVERGED
            steps += 1
            for i in range(d):
                descent[i] = pull[i] - (before - radius) * mean[i]  # Σ(R - R̄)e, from Σ(R - r)e
            _half_hessian(n, before, mean, curve, matrix)
            step[:] = descent
            if not cholesky_solve(matrix, step):
                newton = False
                _half_hessian(n, before, mean, curve, matrix)
                diagonalise(matrix, vectors)
                step[:] = 0.0
                for j in range(d):
                    along = dot(vectors[:, j], descent) / max(abs(matrix[j, j]), _FLAT * n)
                    for i in range(d):
                        step[i] += along * vectors[i, j]
        elif halvings == 0 and value <= best + 2.0 * _EPS * radius * math.sqrt(n * best):
            a[:] = trial  # rounding no longer lets F tell two centres apart: this one is a Newton step further
            result[0], result[1], result[2] = radius + excess / n, value, float(steps)
            return Status.AT_BOUND if wanted > _LEVEL * before else Status.OK
        else:
            halvings += 1
            if halvings > _MAX_HALVINGS:
                return Status.AT_BOUND if size > (_FAR * bound) ** 2 else Status.NOT_CONVERGED
            for i in range(d):
                step[i] *= 0.5
        length = along = size = 0.0
        for i in range(d):
            length += step[i] * step[i]
        length = math.sqrt(length)
        if not length < math.inf:
            return Status.NOT_FINITE
        if halvings == 0:
            wanted = length
        if length > before:
            newton = False
            for i in range(d):
                step[i] *= before / length
        for i in range(d):
            trial[i] = a[i] + step[i]
            size += trial[i] * trial[i]
            along += step[i] * mean[i]
        radius = before
        full = newton and halvings == 0
        following = length * (length / last) ** 2  # steps fall off as the squares of those before them
        done = full and length <= _SHORT * min(before, last) and following <= _SURE * before
        done = done and n * length**3 <= _THIRD * best * before
        last = length if full else 0.0
        if done or length <= _TOLERANCE * before:
            if halvings == 0:  # what the step changes in R̄ and F, to second order in a step this short
                a[:] = trial
                bend = _trace(curve, d) * length * length
                for i in range(d):
                    result[1] -= step[i] * descent[i]
                    for j in range(d):
                        bend -= step[i] * curve[max(i, j) * d + min(i, j)] * step[j]
                result[0] += (0.5 * bend - along) / n
            result[2] = float(steps)
            return Status.AT_BOUND if wanted > _LEVEL * before else Status.OK
        if size > bound * bound:
            return Status.AT_BOUND


@compiled
def _fit_all(
    x: Any, mean: Any, radius: Any, offset: Any, bound: Any, status: Any, results: Any, zero: Any, square: Any
) -> None:
    rows = np.empty((1, x.shape[1], CHUNK))
    for t in range(status.size):
        if status[t] == 0:
            status[t] = _minimise(x, t, mean[t], radius[t], offset[t], bound[t], results[t], rows, zero, square)


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
    b, d, n = samples.shape
    regression = samples.regression
    eta = root(regression, 0.0)
    clear = eta < _CLEAR * regression.spectrum[0][:, 0]
    start = member(regression, np.where(clear, eta, 0.0), 0.0)
    fit = blank(b, d)
    fit.status[:] = start.status
    offset, results = share * (start.center - regression.origin), np.full((b, 3), np.nan)
    spread = regression.square
    radius = np.sqrt(spread + np.einsum("bi,bi->b", offset, offset))  # eq. 3: a reference that keeps R - r small
    bound = _BOUND * np.sqrt(spread)
    _fit_all(samples.x, regression.origin, radius, offset, bound, fit.status, results, zeros(d), zeros(d, d))
    fit.center[:] = regression.origin + offset
    fit.radius[:] = results[:, 0]
    least = np.maximum(results[:, 1], 0.0)  # rounding can take F below 0 where the points lie on a sphere
    fit.noise_variance[:] = least / (n - d - 1) if n > d + 1 else np.nan
    fit.iterations[:] = np.nan_to_num(results[:, 2])
    return fit
