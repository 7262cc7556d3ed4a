"""The equations of one centre and of the size of the noise, from the moments of several markers.

    ĉ = A⁻¹ b,  A = Σ w_p (C_p - η F̄_p),  b = Σ w_p [(C_p - η F̄_p) x̄_p + ½ (s_p - η (2 mean F z + mean Tr(F) z)_p)]

is MGDK (paper eq. 22, corrected) with noise of covariance ηF, which is known but for its size η. The size is where the
variance of the residuals is what such noise gives (theory §5.5). For a hinge all of it is done in a plane, for each
marker in its own.
"""

import math
from typing import NamedTuple

import numpy as np

from study.estimators.common_center import add_marker
from study.mocap.geometry.generalised_eigen import diagonalise_pair
from study.mocap.joints.marker_moments import squared_noise
from study.sphere.jit import compiled, dot
from study.sphere.types import Floats

TINY = 1e-13
"""Share of the markers' extent below which an extent is rounding."""
_ROUNDS = 4
_HALVINGS = 45
"""Halvings of the interval in which η lies: to 3·10⁻¹⁴ of it."""


class StackedMoments(NamedTuple):
    """Moments of M markers, as in `MarkerMoments`, each stacked along a first axis.

    Attributes:
        n: number of samples (M,).
        mean, c, s: x̄ (M, 3), second moment C (M, 3, 3) and third moment s (M, 3) of z = x - x̄.
        f, fz, trace_z, zfz: means of F (M, 3, 3), F z (M, 3), Tr(F) z (M, 3) and zᵀFz (M,).
        variance: variance of |z|² (M,).
        shift, tilt, pivot: parts of the noise that `squared_noise` needs (M, 3, 3), (M, 3, 3), (M, 3).
    """

    n: Floats
    mean: Floats
    c: Floats
    s: Floats
    f: Floats
    fz: Floats
    trace_z: Floats
    zfz: Floats
    variance: Floats
    shift: Floats
    tilt: Floats
    pivot: Floats


class _Totals(NamedTuple):
    """Weighted sums over markers.

    Attributes:
        origin: weighted mean of the centroids (3,), about which the sums are taken.
        c, f: Σ w C and Σ w F (3, 3).
        right: right-hand side b, what noise of size 1 takes off it, and Σ w (F m + mean F z) (3, 3).
    """

    origin: Floats
    c: Floats
    f: Floats
    right: Floats


@compiled
def _reweight(moments: StackedMoments, within: Floats, center: Floats, w: Floats) -> float:
    """Put the weights n/r̂² into ``w``, of radii without noise taken off; returns the largest relative change."""
    n, mean, c = moments.n, moments.mean, moments.c
    change, most = 0.0, 0.0
    for p in range(len(n)):
        square = 0.0
        for i in range(3):
            offset = 0.0
            for j in range(3):
                square += within[i, j] * c[p, i, j]
                offset += within[i, j] * (center[j] - mean[p, j])
            square += offset * offset
        before = w[p]
        w[p] = n[p] / max(square, 1e-300)
        change, most = max(change, abs(w[p] - before)), max(most, w[p])
    return change / most


@compiled
def _add_up(moments: StackedMoments, w: Floats, within: Floats, totals: _Totals) -> tuple[float, float]:
    """Put the weighted sums over markers, within a subspace, into ``totals``.

    Returns the variance of the residuals about the origin, and the sum of vᵀFv there, both weighted.
    """
    mean, c, s, f, fz, trace_z = moments.mean, moments.c, moments.s, moments.f, moments.fz, moments.trace_z
    zfz, variance = moments.zfz, moments.variance
    origin, total, noise, right = totals
    m, rest = np.empty(3), np.empty(3)
    weight, spread, vfv = 0.0, 0.0, 0.0
    for i in range(3):
        origin[i] = 0.0
        for j in range(3):
            right[i, j], total[i, j], noise[i, j] = 0.0, 0.0, 0.0
    for p in range(len(w)):
        weight += w[p]
        for i in range(3):
            origin[i] += w[p] * mean[p, i]
    for i in range(3):
        origin[i] /= weight
    for p in range(len(w)):
        for i in range(3):
            m[i] = 0.0
            for j in range(3):
                m[i] += within[i, j] * (mean[p, j] - origin[j])
        spread += w[p] * variance[p]
        vfv += w[p] * zfz[p]
        for i in range(3):
            cm = c[p, i, 0] * m[0] + c[p, i, 1] * m[1] + c[p, i, 2] * m[2]
            fm = f[p, i, 0] * m[0] + f[p, i, 1] * m[1] + f[p, i, 2] * m[2]
            spread += w[p] * m[i] * (4.0 * s[p, i] + 4.0 * cm)
            vfv += w[p] * m[i] * (2.0 * fz[p, i] + fm)
            right[2, i] += w[p] * (fm + fz[p, i])
            rest[i] = 2.0 * fz[p, i] + trace_z[p, i]
        add_marker(w[p], c[p], m, s[p], total, right[0])
        add_marker(w[p], f[p], m, rest, noise, right[1])
    return spread, vfv


@compiled
def _excess(parts: Floats, variance: float, vfv: float, squared: float, size: float) -> float:
    """Variance of the residuals less what noise of this size gives (theory §5.5), summed over markers."""
    for k in range(parts.shape[0]):
        extent, b, b_noise, fz = parts[k, 0], parts[k, 1], parts[k, 2], parts[k, 3]
        a = (b - size * b_noise) / (extent - size)
        variance += 4.0 * a * (extent * a - 2.0 * b)
        vfv += a * (a - 2.0 * fz)
    return variance - 4.0 * size * vfv + 2.0 * size * size * squared


@compiled
def _root(parts: Floats, variance: float, vfv: float, squared: float, high: float) -> float:
    """Find the size at which `_excess` is zero, by halving; 0 if it is negative there, ``high`` if positive there."""
    if not (high > 0.0 and _excess(parts, variance, vfv, squared, 0.0) > 0.0):
        return 0.0
    if _excess(parts, variance, vfv, squared, high) >= 0.0:
        return high
    low = 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if _excess(parts, variance, vfv, squared, middle) > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@compiled
def solve_center(moments: StackedMoments, basis: Floats, given: float, w: Floats, center: Floats) -> float:
    """Solve for the centre and for the size η of the noise, in the subspace that the columns of a basis span.

    Where no size below the smallest generalised eigenvalue of (Σ w C, Σ w F) is enough, η is just below that, and the
    centre is of no use.

    Args:
        moments: of the markers.
        basis: orthonormal columns (3, d).
        given: η, or NaN to find it.
        w: weights (M,), on entry the first ones, on return those that were used.
        center: receives ĉ (3,).

    Returns:
        η.
    """
    d = basis.shape[1]
    within, origin = np.empty((3, 3)), np.empty(3)
    total, noise, right = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    totals = _Totals(origin, total, noise, right)
    of_c, of_f, scratch = np.empty((d, d)), np.empty((d, d)), np.empty((2, d, d))
    extent, vectors = np.empty(d), np.empty((d, d))
    parts, square = np.empty((d, 4)), np.empty(len(moments.n))
    for i in range(3):
        for j in range(3):
            within[i, j] = 0.0
            for k in range(d):
                within[i, j] += basis[i, k] * basis[j, k]
    size = 0.0
    for trial in range(_ROUNDS + 1):  # the first is a start, without noise
        change = _reweight(moments, within, center, w) if trial > 0 else 1.0
        spread, vfv = _add_up(moments, w, within, totals)
        for k in range(d):
            for q in range(d):
                of_c[k, q], of_f[k, q] = 0.0, 0.0
                for i in range(3):
                    for j in range(3):
                        of_c[k, q] += basis[i, k] * total[i, j] * basis[j, q]
                        of_f[k, q] += basis[i, k] * noise[i, j] * basis[j, q]
        # where F is I and C diagonal, everything is a sum of d fractions of the size
        diagonalise_pair(of_c, of_f, scratch, extent, vectors)
        for k in range(d):
            parts[k, 0] = extent[k]
            for r in range(3):
                parts[k, 1 + r] = 0.0
                for q in range(d):
                    for i in range(3):
                        parts[k, 1 + r] += vectors[q, k] * basis[i, q] * right[r, i]
        first = 0  # along the directions before it there is nothing but rounding
        while first < d and not extent[first] > TINY * extent[d - 1]:
            first += 1
        limit = extent[0] * (1.0 - 1e-9)
        if trial > 0 and math.isnan(given):
            squared_noise(center, moments.mean, moments.pivot, moments.shift, moments.tilt, square)
            size = _root(parts[first:], spread, vfv, dot(w, square), limit)
        elif trial > 0:
            size = given
        for i in range(3):
            center[i] = origin[i]
        for k in range(first, d):
            along_k = (parts[k, 1] - size * parts[k, 2]) / (parts[k, 0] - size)
            for q in range(d):
                for i in range(3):
                    center[i] += along_k * vectors[q, k] * basis[i, q]
        if change < 1e-6 or (math.isnan(given) and size > 0.0 and size == limit):
            break  # at the limit the matrix is singular, and further rounds are of no use
    return size
