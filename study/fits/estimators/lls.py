"""Linear least squares: the (d + 1)-column system |y|² = β₀ + βᵀy by orthogonal factorisation.

In exact arithmetic this is Kåsa's fit, `gdke` (theory 0.1); it differs in its rounding errors. The columns are
(1, y₁ … y_d) with y relative to a point near the data, so that a distant origin costs no digits; the reflection
of the first column then is the centring. Rows are appended to the triangle R some at a time, so one pass suffices.

Linear least squares as textbooks and programs of the paper's time had it, to explain the paper's LLS outliers.

The paper's LLS came from Numerical Recipes, whose least-squares routine zeroes singular values below a tolerance
times the largest - 1e-5 in the routine, 1e-6 in the book's text. On a small cap the smallest singular value carries
the centre's distance; cutting it puts the answer on the sphere or half way to it (theory §4): `lls_nr`, `lls_nr_raw`.

A program in C of the time might have used single precision. Sums of third powers leave its range, 3.4e38, where the
points are some 1e12 units apart, so that outliers at the largest noise need not be a flaw of the method: `lls_single`.

These are for the study of the paper; on data use `lls`.

Incremental GDK, `igdk`: the paper's recurrences for x̄, C, S and C⁻¹, one sample at a time in constant memory (a
rank-one update, so no new inverse is needed). Its answer is GDKE's with its bias: with C - Σ the update is no longer of
rank one. `study.Incremental` keeps the moments instead.
"""

import math
from typing import NamedTuple

import numpy as np

from study.arrays import Floats, Ints
from study.fits.estimators.closed_forms import noise_of_residuals, residual_noise
from study.fits.loops.jit import (
    CHUNK,
    PointSets,
    Sums,
    View,
    aligned,
    at,
    compiled,
    compiled_as_written,
    dot,
    extent,
    fill,
    near,
    readable,
    squared,
    total,
    window,
    zeros,
)
from study.fits.loops.linalg import eigenbasis
from study.fits.points.moments import Moments
from study.fits.points.samples import Estimates, Samples, Status, blank, remove

_EPS = 2.0**-52
_AT_ONCE = 2 * CHUNK
"""Rows that are appended at once: more in a loop cost less, as long as they stay in a first-level cache."""


def lls(samples: Samples) -> Estimates:
    """Linear least squares by Householder reflections, with no cut of small singular values.

    Source: paper §4.4.
    """
    b, d, _ = samples.shape
    fit, residual, scatter = blank(b, d), np.empty(b), np.empty((b, d, d))
    _fit_all(readable(samples.x), fit, residual, scatter, zeros(d))
    values, _ = eigenbasis(scatter)
    fit.status[~(values[:, 0] > d * _EPS * values[:, -1])] = Status.SINGULAR  # the rule of `gdke`
    fit.status[~np.isfinite(residual)] = Status.NOT_FINITE
    return remove(fit, fit.status != Status.OK)


@compiled
def _take(column: Floats, pivot: Floats, share: float) -> float:
    """Subtract a share of the pivot from a column, in place, and return the column's squared length."""
    square = 0.0
    for k in range(column.size):
        value = column[k] - share * pivot[k]
        column[k] = value
        square += value * value
    return square


@compiled
def _take_beside(column: Floats, pivot: Floats, share: float, other: Floats) -> float:
    """Do the same, but return the product with another column. In a function of its own the compiler makes it fast."""
    product = 0.0
    for k in range(column.size):
        value = column[k] - share * pivot[k]
        column[k] = value
        product += value * other[k]
    return product


@compiled
def _append(triangle: Floats, rows: Floats, m: int, products: Floats) -> None:
    """Append m rows, given by columns (q, m), to an upper triangle (q, q) in place, by Householder reflections.

    ``products`` holds the scalar products of the first column with all of them, and those of the next are formed
    while a reflection is applied.
    """
    q = triangle.shape[0]
    for i in range(q):
        pivot = rows[i, :m]
        norm = math.sqrt(squared(triangle[i, i]) + products[i])
        if norm == 0.0:  # not if it is NaN, which then spreads
            for j in range(i + 1, q):
                products[j] = dot(rows[i + 1, :m], rows[j, :m])
            continue
        head = triangle[i, i] + norm if triangle[i, i] >= 0.0 else triangle[i, i] - norm
        scale = 1.0 / (norm * abs(head))
        triangle[i, i] = -norm if head > 0.0 else norm
        for j in range(i + 1, q):
            share = scale * (triangle[i, j] * head + products[j])
            triangle[i, j] -= share * head
            following = rows[i + 1, :m]
            if j == i + 1:
                products[j] = _take(following, pivot, share)
            else:
                products[j] = _take_beside(rows[j, :m], pivot, share, following)


@compiled
def _solve(triangle: Floats, beta: Floats, scatter: Floats) -> None:
    """Back substitution for β (d + 1,), and the scatter of the centred columns y₁ … y_d (d, d)."""
    d = scatter.shape[0]
    for i in range(d):
        for j in range(d):
            scatter[i, j] = 0.0
            for k in range(min(i, j) + 1):
                scatter[i, j] += triangle[k + 1, i + 1] * triangle[k + 1, j + 1]
    for i in range(d, -1, -1):
        beta[i] = triangle[i, d + 1]
        for j in range(i + 1, d + 1):
            beta[i] -= triangle[i, j] * beta[j]
        beta[i] /= triangle[i, i]


@compiled_as_written
def _columns(view: View, m: int, origin: Sums, rows: Floats) -> None:
    """Write columns y₁ … y_d and |y|² of m samples, y = x - origin, after the first of ones."""
    d = len(origin)
    for k in range(m):
        square = 0.0
        for i in range(d):
            y = at(view, i, k) - origin[i]
            rows[i + 1, k] = y
            square += y * y
        rows[d + 1, k] = square


@compiled
def _fit_all(x: PointSets, fit: Estimates, residual: Floats, scatter: Floats, zero: Sums) -> None:
    """Solve each point set of a batch (b, d, n), about a point near it: the mean of its first samples.

    It fills in ``fit``, the mean square ``residual`` of the algebraic equations (b,), and ``scatter`` (b, d, d), which
    says whether the points span all dimensions. ``zero`` is d sums at zero.
    """
    b, d, n = extent(x)
    q = d + 2
    rows, copy = aligned(q * _AT_ONCE).reshape((q, _AT_ONCE)), np.empty((1, d, _AT_ONCE))
    products, beta, triangle = np.empty(q), np.empty(d + 1), np.empty((q, q))
    fill(rows[0], 1.0)
    for t in range(b):
        triangle[:] = 0.0
        origin = near(x, t, n, copy, zero)
        for start in range(0, n, _AT_ONCE):
            m = min(_AT_ONCE, n - start)
            view = window(x, t, start, m, copy, zero)
            _columns(view, m, origin, rows)
            products[0] = float(m)
            for j in range(1, q):
                products[j] = total(rows[j, :m])
            _append(triangle, rows, m, products)
        _solve(triangle, beta, scatter[t])
        residual[t] = squared(triangle[d + 1, d + 1]) / n
        for i in range(d):
            fit.center[t, i] = origin[i] + 0.5 * beta[i + 1]
        radius_squared = beta[0]
        for i in range(d):  # apart from what is stored: the rule of `study.fits.loops.jit`
            radius_squared += squared(0.5 * beta[i + 1])
        fit.radius[t] = math.sqrt(radius_squared) if radius_squared >= 0.0 else math.nan
        fit.noise_variance[t] = noise_of_residuals(residual[t], radius_squared, float(n), d)


def lls_nr(samples: Samples) -> Estimates:
    """Centred design, singular values cut below 1e-5 of the largest: where it cuts, the answer lies on the sphere.

    Source: paper §4.4; Press et al. 1992, §15.4.
    """
    return _cut(samples, 1e-5, samples.moments.mean)


def lls_nr_raw(samples: Samples) -> Estimates:
    """Design in the coordinates as they are given, singular values cut below 1e-6 of the largest.

    Source: paper §4.4; Press et al. 1992, §2.6.
    """
    return _cut(samples, 1e-6, np.zeros_like(samples.moments.mean))


def lls_single(samples: Samples) -> Estimates:
    """Normal equations of |y|² = β₀ + βᵀy for the centred points y, in single precision throughout.

    The points are centred in double precision, so that a distant origin, which normal equations do not forgive
    either, plays no part. Where a sum overflows the status is not finite. In single precision a cap below a tenth of a
    degree is a plane.

    Source: paper §4.4; Press et al. 1992, §15.4.
    """
    b, d, n = samples.shape
    fit = blank(b, d)
    with np.errstate(all="ignore"):  # sets that overflow, or span no volume, have a status of their own
        y = (samples.x - samples.moments.mean[:, :, None]).astype(np.float32, order="C")  # one order of adding
        square = np.einsum("bin,bin->bn", y, y)
        matrix, right = np.empty((b, d + 1, d + 1), dtype=np.float32), np.empty((b, d + 1), dtype=np.float32)
        matrix[:, :d, :d] = np.einsum("bin,bjn->bij", y, y)
        matrix[:, :d, d] = matrix[:, d, :d] = y.sum(axis=2)
        matrix[:, d, d] = n
        right[:, :d], right[:, d] = np.einsum("bin,bn->bi", y, square), square.sum(axis=1)
        finite = np.asarray(np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(right).all(axis=1))
        extent = np.linalg.eigvalsh(np.where(finite[:, None, None], matrix[:, :d, :d], np.float32(0.0)))
        regular = np.asarray(extent[:, 0] > d * np.finfo(np.float32).eps * extent[:, -1])
        matrix = np.where(regular[:, None, None], matrix, np.eye(d + 1, dtype=np.float32))
        beta = np.linalg.solve(matrix, right[..., None])
        offset = 0.5 * beta[:, :d, 0].astype(float)
        squared = beta[:, d, 0] + np.einsum("bi,bi->b", offset, offset)
        fit.radius[:] = np.sqrt(np.where(squared >= 0.0, squared, np.nan))
    fit.center[:] = samples.moments.mean + offset
    fit.noise_variance[:] = residual_noise(samples.regression, offset)
    fit.status[~regular] = Status.SINGULAR
    fit.status[~finite] = Status.NOT_FINITE
    return remove(fit, fit.status != Status.OK)


def _cut(samples: Samples, tolerance: float, origin: Floats) -> Estimates:
    """Least-norm solution of the system |x|² = (x, 1) β with the small singular values left out."""
    b, d, n = samples.shape
    fit = blank(b, d)
    finite = np.isfinite(samples.moments.fourth)
    with np.errstate(all="ignore"):
        y = np.subtract(samples.x, origin[:, :, None], order="C")  # one order of adding
        x = np.where(finite[:, None, None], y, 0.0).swapaxes(1, 2)
        design = np.concatenate([x, np.ones((b, n, 1))], axis=2)
        left, values, right = np.linalg.svd(design, full_matrices=False)
        inverse = np.where(values > tolerance * values[:, :1], 1.0 / values, 0.0)
        square = np.einsum("bnd,bnd->bn", x, x)
        beta = np.einsum("bkj,bk->bj", right, inverse * np.einsum("bnk,bn->bk", left, square))
        offset = 0.5 * beta[:, :d]
        squared = beta[:, d] + np.einsum("bi,bi->b", offset, offset)
        fit.radius[:] = np.sqrt(np.where(squared >= 0.0, squared, np.nan))
        fit.center[:] = origin + offset
        fit.noise_variance[:] = residual_noise(samples.regression, fit.center - samples.moments.mean)
    fit.status[~finite] = Status.NOT_FINITE
    return remove(fit, ~finite)


class Running(NamedTuple):
    """State of the recurrences: x̄ (b, d), C (b, d, d) and S (b, d) in weights of 1/(n - 1), and C⁻¹ (b, d, d)."""

    mean: Floats
    covariance: Floats
    third: Floats
    inverse: Floats


@compiled
def _recur(point: Floats, n: float, running: Running, delta: Floats, w: Floats) -> None:
    """Add one sample to x̄, C, S and C⁻¹ of n samples of one set, in place (theory §1.1).

    ``delta`` and ``w`` (d,) receive δ = x - x̄ and C⁻¹δ.
    """
    mean, c, s, inverse = running
    d = mean.size
    share, shrink = 1.0 / (n + 1.0), (n - 1.0) / n
    trace = square = dw = 0.0
    for i in range(d):
        delta[i] = point[i] - mean[i]
        square += delta[i] * delta[i]
        trace += c[i, i]
    third = (n - 1.0) * share * share * square
    for i in range(d):
        w[i] = along = 0.0
        for j in range(d):
            w[i] += inverse[i, j] * delta[j]
            along += c[i, j] * delta[j]
        dw += delta[i] * w[i]
        s[i] = shrink * (s[i] - share * (2.0 * along + trace * delta[i])) + third * delta[i]
    scale, grow = 1.0 / ((n * n - 1.0) / n + dw), 1.0 / shrink
    for i in range(d):
        step, correction = share * delta[i], scale * w[i]
        mean[i] += step
        for j in range(i + 1):
            c[i, j] = c[j, i] = shrink * c[i, j] + step * delta[j]
            inverse[i, j] = inverse[j, i] = grow * (inverse[i, j] - correction * w[j])


@compiled
def _stream_all(x: Floats, first: Ints, running: Running) -> None:
    """Run each set of a batch (b, d, n) through the recurrences, from its sample number ``first`` (b,) on."""
    b, d, n = x.shape
    delta, w, point = np.empty(d), np.empty(d), np.empty(d)
    for t in range(b):
        one = Running(running.mean[t], running.covariance[t], running.third[t], running.inverse[t])
        for k in range(first[t], n):
            for i in range(d):
                point[i] = x[t, i, k]
            _recur(point, float(k), one, delta, w)


def igdk(samples: Samples) -> Estimates:
    """Incremental GDK by the paper's recurrences, with GDKE's bias.

    They start on the first d + 5 samples, or on more while those lie in a plane.

    Source: paper eqs 24-25; the recurrences are theory §1.1.
    """
    b, d, n = samples.shape
    first, regular = np.full(b, min(n, d + 5)), np.zeros(b, dtype=np.bool_)
    mean, c, s = np.empty((b, d)), np.empty((b, d, d)), np.empty((b, d))
    waiting = np.arange(b)
    while len(waiting):
        start = Moments.of(samples.x[waiting, :, : first[waiting[0]]])
        mean[waiting], c[waiting] = start.mean, start.covariance
        s[waiting] = start.third / (start.n - 1.0)[:, None]  # paper eq. 6
        values = np.linalg.eigvalsh(np.where(np.isfinite(start.covariance), start.covariance, 0.0))
        regular[waiting] = values[:, 0] > d * np.finfo(float).eps * values[:, -1]
        waiting = waiting[~regular[waiting] & (first[waiting] < n)]  # so far they lie in a plane
        first[waiting] = np.minimum(n, 2 * first[waiting])
    fit = blank(b, d)
    inverse = np.linalg.inv(np.where(regular[:, None, None], c, np.eye(d)))
    _stream_all(samples.x, first, Running(mean, c, s, inverse))
    offset = 0.5 * np.einsum("bij,bj->bi", inverse, s)
    fit.center[:] = mean + offset
    fit.radius[:] = np.sqrt((n - 1.0) / n * np.trace(c, axis1=1, axis2=2) + np.einsum("bi,bi->b", offset, offset))
    fit.noise_variance[:] = residual_noise(samples.regression, fit.center - samples.moments.mean)
    fit.status[~regular] = Status.SINGULAR
    fit.status[~np.isfinite(samples.moments.fourth)] = Status.NOT_FINITE
    return remove(fit, fit.status != Status.OK)
