"""Linear least squares: the (d + 1)-column system |y|² = β₀ + βᵀy by orthogonal factorisation.

In exact arithmetic this is Kåsa's fit, `gdke`, to the letter; it differs in what rounding does to it. The columns
are (1, y₁ … y_d) with y taken from a point near the data, so that a distant origin costs no digits; the reflection
of the first column then is the centring. The triangle R is kept by appending the data to it chunk by chunk, so one
pass suffices.
"""

import math
from typing import Any

import numpy as np

from study.estimators.fit import Fit, Samples, Status, blank
from study.estimators.gdk import noise_of_residuals
from study.sphere.compiled import CHUNK, compiled, dot, fill, total
from study.sphere.linalg import diagonalise

_EPS = 2.0**-52


@compiled
def _append(triangle: Any, rows: Any, m: int) -> None:
    """Householder: append m rows, given by columns (q, m), to an upper triangle (q, q) in place."""
    q = triangle.shape[0]
    for i in range(q):
        pivot = rows[i, :m]
        norm = math.sqrt(triangle[i, i] ** 2 + dot(pivot, pivot))
        if norm == 0.0:  # not so if it is not a number, which is to spread
            continue
        head = triangle[i, i] + norm if triangle[i, i] >= 0.0 else triangle[i, i] - norm
        scale = 1.0 / (norm * abs(head))
        triangle[i, i] = -norm if head > 0.0 else norm
        for j in range(i + 1, q):
            column = rows[j, :m]
            projection = scale * (triangle[i, j] * head + dot(pivot, column))
            triangle[i, j] -= projection * head
            for k in range(m):
                column[k] -= projection * pivot[k]


@compiled
def _regular(triangle: Any, scatter: Any, vectors: Any) -> bool:
    """Whether the points span all dimensions: the rule of `gdk`, on the scatter of the centred columns."""
    d = scatter.shape[0]
    for i in range(d):
        for j in range(d):
            scatter[i, j] = 0.0
            for k in range(min(i, j) + 1):
                scatter[i, j] += triangle[k + 1, i + 1] * triangle[k + 1, j + 1]
    diagonalise(scatter, vectors)
    return bool(scatter[0, 0] > d * _EPS * scatter[d - 1, d - 1])


@compiled
def _solve(triangle: Any, beta: Any) -> None:
    """Back substitution for β (d + 1,)."""
    p = beta.size
    for i in range(p - 1, -1, -1):
        beta[i] = triangle[i, p]
        for j in range(i + 1, p):
            beta[i] -= triangle[i, j] * beta[j]
        beta[i] /= triangle[i, i]


@compiled
def _fit_all(x: Any, center: Any, radius_squared: Any, residual: Any, regular: Any) -> None:
    """Solve each point set of a batch (b, d, n)."""
    b, d, n = x.shape
    q = d + 2
    rows, triangle, beta, origin = np.empty((q, CHUNK)), np.empty((q, q)), np.empty(d + 1), np.empty(d)
    scatter, vectors = np.empty((d, d)), np.empty((d, d))
    for t in range(b):
        triangle[:] = 0.0
        for i in range(d):
            near = x[t, i, : min(n, CHUNK)]
            origin[i] = total(near) / near.size
        for start in range(0, n, CHUNK):
            m = min(CHUNK, n - start)
            square = rows[d + 1, :m]
            fill(rows[0, :m], 1.0)
            fill(square, 0.0)
            for i in range(d):
                y, xi, near_i = rows[i + 1, :m], x[t, i, start : start + m], origin[i]
                for k in range(m):
                    y[k] = xi[k] - near_i
                    square[k] += y[k] * y[k]
            _append(triangle, rows, m)
        regular[t] = _regular(triangle, scatter, vectors)
        _solve(triangle, beta)
        residual[t] = triangle[d + 1, d + 1] ** 2 / n
        radius_squared[t] = beta[0]
        for i in range(d):
            half = 0.5 * beta[i + 1]
            center[t, i] = origin[i] + half
            radius_squared[t] += half * half


def lls(samples: Samples) -> Fit:
    """Linear least squares by Householder reflections, with no cut of small singular values.

    Source: paper §4.4.
    """
    b, d, n = samples.shape
    fit = blank(b, d)
    square, residual, regular = np.empty(b), np.empty(b), np.empty(b, dtype=np.bool_)
    _fit_all(samples.x, fit.center, square, residual, regular)
    fit.radius[:] = np.sqrt(np.where(square >= 0.0, square, np.nan))
    with np.errstate(all="ignore"):  # degenerate sets have a status of their own
        fit.noise_variance[:] = noise_of_residuals(residual, square, np.full(b, float(n)), d)
    fit.status[~regular] = Status.SINGULAR
    fit.status[~np.isfinite(residual)] = Status.NOT_FINITE
    lost = fit.status != Status.OK
    fit.center[lost], fit.radius[lost], fit.noise_variance[lost] = np.nan, np.nan, np.nan
    return fit
