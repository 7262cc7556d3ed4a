"""Maximum likelihood: geometric least squares, minimising F(c) = Σ(Rᵢ - R̄)² over the centre, Rᵢ = |xᵢ - c|.

Newton's method with the exact Hessian, from GDKE's answer: 3-8 passes over the data where Gauss-Newton takes 7-78.
Never from UGDK's, which can lie anywhere. With e = (x - c)/R and r = R̄,

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
from study.estimators.gdk import gdke
from study.sphere.compiled import CHUNK, compiled, dot, fill, total
from study.sphere.linalg import cholesky_solve, diagonalise

_MAX_ITERATIONS = 100
_MAX_HALVINGS = 40
_TOLERANCE = 1e-9
"""A Newton step below this share of the radius ends the iteration: the next one would be its square."""
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
def _pass(x: Any, center: Any, radius: float, sums: Any, pull: Any, mean: Any, curve: Any, rows: Any) -> None:
    """One pass over a point set (d, n) for a trial centre.

    sums = Σ(R-r), Σ(R-r)², Σ1/R;  pull = Σ(R-r)e;  mean = Σe;  curve = Σeeᵀ/R.
    """
    d, n = x.shape
    sums[:] = 0.0
    pull[:] = 0.0
    mean[:] = 0.0
    curve[:] = 0.0
    for start in range(0, n, CHUNK):
        m = min(CHUNK, n - start)
        excess, inverse, weighted = rows[d, :m], rows[d + 1, :m], rows[d + 2, :m]
        fill(excess, 0.0)
        for i in range(d):
            e, xi, ci = rows[i, :m], x[i, start : start + m], center[i]
            for k in range(m):
                e[k] = xi[k] - ci
                excess[k] += e[k] * e[k]
        for k in range(m):
            distance = math.sqrt(excess[k] + 1e-300)  # a sample may lie at the centre
            inverse[k] = 1.0 / distance
            excess[k] = distance - radius
        sums[0] += total(excess)
        sums[1] += dot(excess, excess)
        sums[2] += total(inverse)
        for i in range(d):
            e = rows[i, :m]
            for k in range(m):
                e[k] *= inverse[k]
            mean[i] += total(e)
            pull[i] += dot(e, excess)
            for k in range(m):
                weighted[k] = e[k] * inverse[k]
            for j in range(i + 1):
                curve[i, j] += dot(weighted, rows[j, :m])
    for i in range(d):
        for j in range(i):
            curve[j, i] = curve[i, j]


@compiled
def _half_hessian(n: int, radius: float, inverse: float, mean: Any, curve: Any, matrix: Any) -> None:
    """½∇²F from the sums of a pass."""
    d = mean.size
    for i in range(d):
        for j in range(d):
            matrix[i, j] = radius * curve[i, j] - mean[i] * mean[j] / n
        matrix[i, i] += n - radius * inverse


@compiled
def _minimise(x: Any, a: Any, bound: float, result: Any) -> int:
    """Minimise F for one point set (d, n) about its centroid; ``a`` is the start and receives the centre.

    ``result`` receives the radius, F and the number of steps.
    """
    d, n = x.shape
    rows = np.empty((d + 3, CHUNK))
    sums, pull, mean = np.empty(3), np.empty(d), np.empty(d)
    curve, matrix, vectors = np.empty((d, d)), np.empty((d, d)), np.empty((d, d))
    step, descent, trial = np.empty(d), np.empty(d), a.copy()
    square = 0.0
    for i in range(d):
        xi, ai = x[i], a[i]
        for k in range(n):
            square += (xi[k] - ai) ** 2
    radius = math.sqrt(square / n)  # GDKE's own, eq. 3: a reference that keeps R - r small
    best, before, halvings, steps, wanted, size = math.inf, radius, 0, 0, 0.0, 0.0
    while True:
        _pass(x, trial, radius, sums, pull, mean, curve, rows)
        value = sums[1] - sums[0] * sums[0] / n
        if sums[0] * sums[0] > _CANCELLED * n * value:
            radius += sums[0] / n
            _pass(x, trial, radius, sums, pull, mean, curve, rows)
            value = sums[1] - sums[0] * sums[0] / n
        if value <= best:
            best, halvings = value, 0
            a[:] = trial
            before = radius + sums[0] / n  # R̄, the radius that belongs to this centre
            result[0], result[1], result[2] = before, best, float(steps)
            if steps >= _MAX_ITERATIONS:
                return Status.AT_BOUND if size > (_FAR * bound) ** 2 else Status.NOT_CONVERGED
            steps += 1
            for i in range(d):
                descent[i] = pull[i] - (before - radius) * mean[i]  # Σ(R - R̄)e, from Σ(R - r)e
            _half_hessian(n, before, sums[2], mean, curve, matrix)
            step[:] = descent
            if not cholesky_solve(matrix, step):
                _half_hessian(n, before, sums[2], mean, curve, matrix)
                diagonalise(matrix, vectors)
                step[:] = 0.0
                for j in range(d):
                    along = dot(vectors[:, j], descent) / max(abs(matrix[j, j]), _FLAT * n)
                    for i in range(d):
                        step[i] += along * vectors[i, j]
        elif halvings == 0 and value <= best + 2.0 * _EPS * radius * math.sqrt(n * best):
            a[:] = trial  # rounding no longer lets F tell two centres apart: this one is a Newton step further
            result[0], result[1], result[2] = radius + sums[0] / n, value, float(steps)
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
            for i in range(d):
                step[i] *= before / length
        for i in range(d):
            trial[i] = a[i] + step[i]
            size += trial[i] * trial[i]
            along += step[i] * mean[i]
        radius = before
        if length <= _TOLERANCE * before:
            if halvings == 0:  # R̄ moves by -ē·δ, to second order in a step this short
                a[:] = trial
                result[0] -= along / n
            result[2] = float(steps)
            return Status.AT_BOUND if wanted > _LEVEL * before else Status.OK
        if size > bound * bound:
            return Status.AT_BOUND


@compiled
def _fit_all(x: Any, mean: Any, offset: Any, bound: Any, status: Any, results: Any) -> None:
    b, d, n = x.shape
    y = np.empty((d, n))
    for t in range(b):
        if status[t] != 0:
            continue
        for i in range(d):
            yi, xi, middle = y[i], x[t, i], mean[t, i]
            for k in range(n):
                yi[k] = xi[k] - middle
        status[t] = _minimise(y, offset[t], bound[t], results[t])


def mle(samples: Samples) -> Fit:
    """Maximum likelihood (geometric least squares) by Newton's method with a bound.

    Isotropic noise is assumed whatever ``samples.noise`` says; the noise level itself does not enter the centre. The
    noise variance is Σ(R - r)²/(n - d - 1).

    Source: paper §4.3; Shakarji 1998.
    """
    return minimum_from(samples, 1.0)


def minimum_from(samples: Samples, share: float) -> Fit:
    """The minimum of F that Newton's method finds from x̄ + share · (ĉ - x̄), where ĉ is GDKE's answer."""
    b, d, n = samples.shape
    start, moments = gdke(samples), samples.moments
    fit = blank(b, d)
    fit.status[:] = start.status
    offset, results = share * (start.center - moments.mean), np.full((b, 3), np.nan)
    bound = _BOUND * np.sqrt(np.trace(moments.second, axis1=1, axis2=2) / n)
    _fit_all(samples.x, moments.mean, offset, bound, fit.status, results)
    fit.center[:] = moments.mean + offset
    fit.radius[:] = results[:, 0]
    least = np.maximum(results[:, 1], 0.0)  # rounding can take F below 0 where the points lie on a sphere
    fit.noise_variance[:] = least / (n - d - 1) if n > d + 1 else np.nan
    fit.iterations[:] = np.nan_to_num(results[:, 2])
    return fit
