"""Newton's search for the least F(c) = Σ(Rᵢ - R̄)², Rᵢ = |xᵢ - c|, step by step: the sums of a pass in, a centre out.

With e = (x - c)/R and r = R̄,

    ½∇F = -Σ(R - r)e,    ½∇²F = Σ[(1 - r/R) I + (r/R) eeᵀ] - n ē ēᵀ,

and where that is not positive definite its eigenvalues are replaced by their absolute values. A step is at most the
current radius long and is halved until F falls. On a small cap the infimum can lie at infinity, where the sphere is
a plane: the centre is stopped at a bound, and the status says so, as it does where a far sphere is no better than the
best plane.
"""

import math
from typing import Any

import numpy as np

from study.estimators.fit import Status
from study.sphere.jit import compiled, dot, fill
from study.sphere.linalg import cholesky_solve, diagonalise

_MAX_ITERATIONS = 100
_MAX_HALVINGS = 40
_TOLERANCE = 1e-9
"""A Newton step below this share of the radius ends the iteration: the next one would be its square."""
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

SEARCH = np.dtype(
    [(name, float) for name in ("bound", "plane", "radius", "best", "before", "wanted", "size", "last")]
    + [(name, np.int64) for name in ("steps", "halvings", "again")]
)
"""Where the search for one minimum stands between two passes: ``radius`` is what F is formed about, ``before`` that of
the best centre so far, ``best`` its F, ``plane`` that of the best plane, ``again`` whether F is formed a second time.
"""
ON = -1
"""In place of a status: the search goes on."""


@compiled
def _copy(source: Any, target: Any) -> None:
    """A slice assignment would take the compiler half a second, each."""
    for i in range(source.size):
        target[i] = source[i]


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
def begin(search: Any, spread: float, plane: float, a: Any, trial: Any) -> None:
    """Set out from ``a``, which is taken from the origin; ``spread`` is the mean of |x - origin|²."""
    search.plane = plane
    search.bound = _BOUND * math.sqrt(spread)
    search.radius = search.before = math.sqrt(spread + dot(a, a))  # eq. 3: it keeps R - r small
    search.best = math.inf
    search.wanted = search.size = search.last = 0.0
    search.steps = search.halvings = search.again = 0
    _copy(a, trial)


@compiled
def _ended(search: Any, n: int, value: float) -> int:
    """Status of a search that ends where F has this value: a sphere, unless it is far and no better than a plane."""
    far, doubt = search.size > (_FAR * search.bound) ** 2, 2.0 * _EPS * search.before * math.sqrt(n * max(value, 0.0))
    if search.wanted > _LEVEL * search.before or (far and not value < search.plane - doubt):
        return Status.AT_BOUND
    return Status.OK


@compiled
def advance(
    search: Any, n: int, sums: Any, a: Any, trial: Any, step: Any, result: Any, descent: Any, matrix: Any, vectors: Any
) -> int:
    """Judge a trial centre by the sums of a pass, and choose the next one; a status if there is none.

    ``a`` receives the best centre so far; ``result`` its radius, its F and the number of steps.
    """
    d, excess = a.size, sums[0]
    pull, mean, curve = sums[2 : 2 + d], sums[2 + d : 2 + 2 * d], sums[2 + 2 * d :]
    value = sums[1] - excess * excess / n
    if search.again == 0 and excess * excess > _CANCELLED * n * value:
        search.radius += excess / n
        search.again = 1
        return ON
    search.again = 0
    newton, rise = True, excess / n
    around = search.radius + rise  # R̄, the radius that belongs to this centre
    if value <= search.best:
        search.best, search.before, search.halvings = value, around, 0
        _copy(trial, a)
        result[0], result[1], result[2] = around, value, float(search.steps)
        if search.steps >= _MAX_ITERATIONS:
            return Status.AT_BOUND if search.size > (_FAR * search.bound) ** 2 else Status.NOT_CONVERGED
        search.steps += 1
        for i in range(d):
            descent[i] = pull[i] - rise * mean[i]  # Σ(R - R̄)e, from Σ(R - r)e: not by R̄ - r, which has lost digits
        _half_hessian(n, around, mean, curve, matrix)
        _copy(descent, step)
        if not cholesky_solve(matrix, step):
            newton = False
            _half_hessian(n, around, mean, curve, matrix)
            diagonalise(matrix, vectors)
            fill(step, 0.0)
            for j in range(d):
                along = dot(vectors[:, j], descent) / max(abs(matrix[j, j]), _FLAT * n)
                for i in range(d):
                    step[i] += along * vectors[i, j]
    elif search.halvings == 0 and value <= search.best + 2.0 * _EPS * search.radius * math.sqrt(n * search.best):
        _copy(trial, a)  # rounding no longer lets F tell two centres apart: this one is a Newton step further
        result[0], result[1], result[2] = around, value, float(search.steps)
        return _ended(search, n, value)
    else:
        search.halvings += 1
        if search.halvings > _MAX_HALVINGS:
            return Status.AT_BOUND if search.size > (_FAR * search.bound) ** 2 else Status.NOT_CONVERGED
        for i in range(d):
            step[i] *= 0.5
    before, length = search.before, math.sqrt(dot(step, step))
    if not length < math.inf:
        return Status.NOT_FINITE
    if search.halvings == 0:
        search.wanted = length
    if length > before:
        newton = False
        for i in range(d):
            step[i] *= before / length
    for i in range(d):
        trial[i] = a[i] + step[i]
    search.size, search.radius = dot(trial, trial), before
    full = newton and search.halvings == 0
    following = length * (length / search.last) ** 2  # steps fall off as the squares of those before them
    done = full and length <= _SHORT * min(before, search.last) and following <= _SURE * before
    done = done and n * length**3 <= _THIRD * search.best * before
    search.last = length if full else 0.0
    if done or length <= _TOLERANCE * before:
        if search.halvings == 0:  # what the step changes in R̄ and F, to second order in a step this short
            _copy(trial, a)
            bend = _trace(curve, d) * length * length
            for i in range(d):
                result[1] -= step[i] * descent[i]
                for j in range(d):
                    bend -= step[i] * curve[max(i, j) * d + min(i, j)] * step[j]
            result[0] += (0.5 * bend - dot(step, mean)) / n
        result[2] = float(search.steps)
        return _ended(search, n, search.best)
    return Status.AT_BOUND if search.size > search.bound * search.bound else ON
