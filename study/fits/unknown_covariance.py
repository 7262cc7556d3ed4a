"""UGDK with the whole noise covariance estimated from the points: the question that the paper leaves open.

About the centre, v = x - c and f = |v|² - mean |v|². For Gaussian noise of covariance Σ the moments of f² v vᵀ obey

    E f²vvᵀ - E f² Σ - 8ΣPΣ - 8Σ³ - 8(PΣ² + Σ²P) = 4 Q : Σ + 2 tr(Σ²) P,      P = E vvᵀ - Σ = r² E uuᵀ,
    Q = E vvvv - sym₆(P, Σ) - sym₃(Σ, Σ) = r⁴ E uuuu,                                              (theory §5.4)

linear in Σ up to small terms, which come from the step before. A step solves them for Σ, projects it on positive
semidefinite matrices, and computes the centre again; a dozen steps start from `als`. On small caps the noise across the
axis is not observed; a little of the isotropic answer is mixed in for it, and the centre does not need it.
"""

import numpy as np

from study.arrays import Bools, Floats
from study.fits.closed_forms import als, subtracting
from study.fits.jit import CHUNK, compiled, dot, fill, total
from study.fits.samples import Estimates, Samples, Status

_ROUNDS = 12
_RIDGE = 1e-4


def ugdk_cov(samples: Samples) -> Estimates:
    """UGDK with Σ̂ estimated from the points, which need Gaussian noise of one covariance.

    It is worth its cost where the noise is markedly anisotropic and the points are many. With isotropic noise it
    estimates more than it needs: on a 20° cap with n = 1000 its median error is 1.4 times that of `als` at σ = .0056 r
    and 2.7 times at .018 r; on 90° and more the two are alike up to σ = .1 r. Above σ ≈ .2 r the equations can lead to
    a wrong Σ̂, which no status shows.

    Source: theory §5.4.
    """
    start = als(samples)
    d = samples.shape[1]
    usable: Bools = np.asarray(np.isfinite(start.center).all(axis=1))
    isotropic = np.where(usable, start.noise_variance, 0.0)
    isotropic = np.where(np.isfinite(isotropic), isotropic, 0.0)[:, None, None] * np.eye(d)
    noise, center = isotropic.copy(), np.where(usable[:, None], start.center, 0.0)
    # in units of the points' spread: sixth powers of raw coordinates may not be finite
    with np.errstate(all="ignore"):
        scale = np.sqrt(np.trace(samples.moments.covariance, axis1=1, axis2=2))
    scale = np.where(usable, scale, 1.0)[:, None, None]
    # in one memory layout: a quotient would have the points', which determines the order of adding
    x = np.ascontiguousarray(np.where(usable[:, None, None], samples.x, 0.0) / scale)
    fit = start
    for step in range(1, _ROUNDS + 1):
        unit = _covariance(x, center / scale[:, :, 0], noise / scale**2, isotropic / scale**2)
        noise = unit * scale**2
        fit = subtracting(samples, noise)
        good = (fit.status == Status.OK)[:, None]
        center = np.where(good, fit.center, center)
        noise = np.where(good[:, :, None], noise, isotropic)
        fit.iterations[:] = step
    fit.status[~usable] = start.status[~usable]
    fit.noise_variance[np.isnan(start.noise_variance)] = np.nan
    return fit


def _covariance(x: Floats, center: Floats, noise: Floats, isotropic: Floats) -> Floats:
    """One step: Σ̂ (b, d, d) from the moments about a centre and the Σ̂ before."""
    b, d, n = x.shape
    m = d * (d + 1) // 2
    sums, weighted_sums, products = np.empty((b, m)), np.empty((b, m)), np.empty((b, m, m))
    square = np.empty(b)
    _sums(x, center, sums, weighted_sums, products, square)
    place = np.zeros((d, d), dtype=int)  # place of a pair of coordinates among the d(d+1)/2
    upper = np.triu_indices(d)
    place[upper] = place.T[upper] = np.arange(m)
    second, weighted = sums[:, place] / n, weighted_sums[:, place] / n
    fourth = products[:, place[:, :, None, None], place] / n
    p, noise2 = second - noise, noise @ noise
    known = (
        square[:, None, None] / n * noise
        + 8.0 * noise @ p @ noise
        + 8.0 * noise @ noise2
        + 8.0 * (p @ noise2 + noise2 @ p)
        + 2.0 * np.trace(noise2, axis1=1, axis2=2)[:, None, None] * p
    )
    quartic = fourth - _symmetric_products(p, noise) - _symmetric_products(noise, noise) / 2.0
    # Σ has d(d+1)/2 unknowns; least squares on the symmetric part, pulled a little towards the isotropic answer
    basis = np.zeros((m, d, d))
    basis[np.arange(m), upper[0], upper[1]] = basis[np.arange(m), upper[1], upper[0]] = 1.0
    matrix = 4.0 * np.einsum("bijkl,mkl->bijm", quartic, basis)[:, upper[0], upper[1]]
    right = (weighted - known)[:, upper[0], upper[1]]
    prior = isotropic[:, upper[0], upper[1]]
    scale = _RIDGE * np.trace(matrix, axis1=1, axis2=2)[:, None, None] / m
    normal = matrix + scale * np.eye(m)
    flat = ~(np.abs(np.linalg.det(normal)) > 0.0)
    normal[flat] = np.eye(m)
    solution = np.linalg.solve(normal, (right + scale[:, 0] * prior)[:, :, None])[:, :, 0]
    solution[flat] = prior[flat]
    result = np.einsum("bm,mij->bij", solution, basis)
    values, vectors = np.linalg.eigh(np.where(np.isfinite(result), result, 0.0))
    return np.asarray(np.einsum("bij,bj,bkj->bik", vectors, np.maximum(values, 0.0), vectors))


@compiled
def _sums(x: Floats, center: Floats, sums: Floats, weighted: Floats, products: Floats, square: Floats) -> None:
    """Σp, Σf²p and Σpp' over the pairs p = vᵢvⱼ, i ≤ j, of v = x - c, and Σf²; f is |v|² less its mean."""
    b, d, n = x.shape
    m = sums.shape[1]
    rows = np.empty((m + d + 1, CHUNK))
    for t in range(b):
        sums[t], weighted[t], products[t], square[t] = 0.0, 0.0, 0.0, 0.0
        mean = 0.0
        for i in range(d):
            row, c, total_square = x[t, i], center[t, i], 0.0
            for k in range(n):
                total_square += (row[k] - c) ** 2
            mean += total_square / n
        for start in range(0, n, CHUNK):
            size = min(CHUNK, n - start)
            f2 = rows[m + d, :size]
            fill(f2, -mean)
            for i in range(d):
                v, row, c = rows[m + i, :size], x[t, i, start : start + size], center[t, i]
                for k in range(size):
                    v[k] = row[k] - c
                    f2[k] += v[k] * v[k]
            for k in range(size):
                f2[k] *= f2[k]
            square[t] += total(f2)
            pair = 0
            for i in range(d):
                for j in range(i, d):
                    p, v, w = rows[pair, :size], rows[m + i, :size], rows[m + j, :size]
                    for k in range(size):
                        p[k] = v[k] * w[k]
                    sums[t, pair] += total(p)
                    weighted[t, pair] += dot(p, f2)
                    for other in range(pair + 1):
                        products[t, pair, other] += dot(p, rows[other, :size])
                    pair += 1
        for i in range(m):
            for j in range(i):
                products[t, j, i] = products[t, i, j]


def _symmetric_products(a: Floats, b: Floats) -> Floats:
    """The six products aᵢⱼbₖₗ over the pairings of four indices: for a = b, each of the three pairings twice."""
    first = np.einsum("bij,bkl->bijkl", a, b) + np.einsum("bij,bkl->bijkl", b, a)
    return np.asarray(first + first.transpose(0, 1, 3, 2, 4) + first.transpose(0, 1, 4, 3, 2))
