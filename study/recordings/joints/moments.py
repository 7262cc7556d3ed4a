"""Moments of a marker in a segment's axes, and what the noise of marker and pose adds to them.

UGDK subtracts the covariance of the noise from the moments (paper eqs 10-17). Here each sample has a covariance F of
its own, (*) of `pose_noise`:

    second moment  Σzzᵀ - ΣF,        third moment  Σ|z|²z - Σ(2F + Tr F) z.

The mean of both is exact for any symmetric noise. `center` solves for the joint's centre with these moments.

Scores of a joint's centre: the contribution of each frame to the equations that define the centre and its noise.

The centre's covariance follows from them, for any correlation in time (`long_run_covariance`).

The equations of one centre and of the size of the noise, from the moments of several markers.

    ĉ = A⁻¹ b,  A = Σ w_p (C_p - η F̄_p),  b = Σ w_p [(C_p - η F̄_p) x̄_p + ½ (s_p - η (2 mean F z + mean Tr(F) z)_p)]

is MGDK (paper eq. 22, corrected) with noise of covariance ηF, which is known but for its size η. The size is where the
variance of the residuals is what such noise gives (theory §5.5). For a hinge all of it is done in a plane, for each
marker in its own.

Pooled moments of several markers: the fit of their common centre, and statistics of that fit.

Symbols are those of `solve_center`, which solves the equations; o = c - x̄ is the offset of a centre from a marker's
mean, and v = z - o is a sample as seen from the centre.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from study.arrays import Bools, Floats
from study.fits.jit import compiled, dot
from study.fits.markers import add_marker
from study.recordings.pose_noise import (
    PatternNoise,
    PoseNoise,
    covariance_of_sample,
    diagonalise_pair,
    smallest_generalised_eigenvalue,
)


@dataclass(frozen=True)
class MarkerMoments:
    """Moments of one marker in a segment's axes, and what noise of size 1 adds to them (weights 1/n).

    Attributes:
        count: number of samples n.
        mean: x̄ (3,), metres.
        second, third, fourth: moments of z = x - x̄: mean zzᵀ (3, 3), mean |z|²z (3,), mean |z|⁴.
        noise: mean F (3, 3).
        noise_z: mean F z (3,).
        trace_z: mean Tr(F) z (3,).
        z_noise_z: mean zᵀFz.
        shift, tilt: mean covariances (3, 3) of the noise's translation, the marker's own noise included, m², and of its
            rotation, rad².
        pivot: mean point about which it rotates (3,), metres.
        z: the samples (3, frames), corrected for the mean effects of the noise, less their mean.
        used: samples that count (frames,).
        by_pattern: the noise in each pattern.
    """

    count: float
    mean: Floats
    second: Floats
    third: Floats
    fourth: float
    noise: Floats
    noise_z: Floats
    trace_z: Floats
    z_noise_z: float
    shift: Floats
    tilt: Floats
    pivot: Floats
    z: Floats
    used: Bools
    by_pattern: PatternNoise

    def squared_noise(self, center: Floats) -> float:
        """Half the variance of |noise|² in the residuals about a centre (3,); see `squared_noise`."""
        result = np.empty(1)
        squared_noise(center, self.mean[None], self.pivot[None], self.shift[None], self.tilt[None], result)
        return float(result[0])


@compiled
def squared_noise(center: Floats, mean: Floats, pivot: Floats, shift: Floats, tilt: Floats, result: Floats) -> None:
    """Compute half the variance of |noise|² in the residuals about a centre; for noise by (*) alone that is Tr F².

    A rotation about the pivot does not change the distance from the pivot. So it counts at second order only as far
    as the centre is from the pivot. With d and v the centre and the marker's mean from there, S the shift's and T the
    tilt's covariance, the result is Tr S (S + 2 [d] T [d]ᵀ) + Tr Q², Q = (½ (d vᵀ + v dᵀ) - d·v) T.

    Args:
        center: of the joint (3,).
        mean: of each marker (M, 3).
        pivot: of each marker (M, 3), metres, as in `MarkerMoments`.
        shift: of each (M, 3, 3), m², likewise.
        tilt: of each (M, 3, 3), rad², likewise.
        result: receives the result (M,).
    """
    d, v, turned, q = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for p in range(len(result)):
        along = 0.0
        for i in range(3):
            d[i], v[i] = center[i] - pivot[p, i], mean[p, i] - pivot[p, i]
            along += d[i] * v[i]
        for j in range(3):
            a, b, c = tilt[p, 0, j], tilt[p, 1, j], tilt[p, 2, j]
            turned[0, j], turned[1, j], turned[2, j] = d[1] * c - d[2] * b, d[2] * a - d[0] * c, d[0] * b - d[1] * a
            from_v, from_d = v[0] * a + v[1] * b + v[2] * c, d[0] * a + d[1] * b + d[2] * c
            for i in range(3):
                q[i, j] = 0.5 * (d[i] * from_v + v[i] * from_d) - along * tilt[p, i, j]
        total = 0.0
        for i in range(3):
            a, b, c = turned[i, 0], turned[i, 1], turned[i, 2]
            turned[i, 0], turned[i, 1], turned[i, 2] = d[1] * c - d[2] * b, d[2] * a - d[0] * c, d[0] * b - d[1] * a
            for j in range(3):
                total += shift[p, i, j] * (shift[p, i, j] + 2.0 * turned[i, j]) + q[i, j] * q[j, i]
        result[p] = total


@compiled
def lagged_products(z: Floats, used: Bools, offset: Floats) -> tuple[float, float]:
    """Sums of the products of squared distances from a centre, less their mean: with the next frame, and squares.

    Args:
        z: samples of a marker less their mean (3, frames), metres.
        used: samples that count (frames,).
        offset: of the centre from the mean (3,), metres.

    Returns:
        The sum over pairs of successive frames, as if no pair were missing; and the sum of the squares; m⁴.
    """
    n = z.shape[1]
    count, pairs, level, products, squares, before = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for t in range(n):
        if used[t]:
            count += 1.0
            level += (z[0, t] - offset[0]) ** 2 + (z[1, t] - offset[1]) ** 2 + (z[2, t] - offset[2]) ** 2
    level /= max(count, 1.0)
    for t in range(n):
        if used[t]:
            residual = (z[0, t] - offset[0]) ** 2 + (z[1, t] - offset[1]) ** 2 + (z[2, t] - offset[2]) ** 2 - level
            squares += residual * residual
            if t > 0 and used[t - 1]:
                products += residual * before
                pairs += 1.0
            before = residual
    return products * count / max(pairs, 1.0), squares


def marker_moments(y: Floats, used: Bools, pose: PoseNoise, own: float, size: float) -> MarkerMoments:
    """Compute the moments of a marker.

    Args:
        y: the marker in the segment's axes (3, frames), metres.
        used: samples to use (frames,), in frames whose pose is known.
        pose: noise of the segment's pose.
        own: variance s² of the marker's own noise, m².
        size: variance of the noise in units of what ``pose`` and ``own`` say, to correct for its mean effects.
    """
    noise = pose.of_marker(own, size)
    sums = _Sums(np.empty_like(y), np.zeros(2), np.zeros((2, 3, 3)), np.zeros((4, 3)))
    count = _accumulate(y, used, noise, sums)
    patterns = pose.pattern[used & (pose.pattern >= 0)]
    share = np.bincount(patterns, minlength=len(pose.centroid)) / max(count, 1.0)
    return MarkerMoments(
        count=count,
        mean=sums.vectors[0],
        second=sums.tensors[0],
        third=sums.vectors[1],
        fourth=sums.scalars[0],
        noise=sums.tensors[1],
        noise_z=sums.vectors[2],
        trace_z=sums.vectors[3],
        z_noise_z=sums.scalars[1],
        shift=own * np.eye(3) + np.einsum("k,kij->ij", share, pose.shift),
        tilt=np.einsum("k,kij->ij", share, pose.tilt),
        pivot=share @ pose.centroid,
        z=sums.z,
        used=used,
        by_pattern=noise,
    )


class _Sums(NamedTuple):
    """Results of `_accumulate`.

    Attributes:
        z: corrected coordinates less their mean (3, frames).
        scalars: mean |z|⁴ and zᵀFz.
        tensors: mean zzᵀ and F (2, 3, 3).
        vectors: x̄ and the means of |z|²z, F z, Tr(F) z (4, 3).
    """

    z: Floats
    scalars: Floats
    tensors: Floats
    vectors: Floats


@compiled
def _accumulate(y: Floats, used: Bools, noise: PatternNoise, sums: _Sums) -> float:
    """Compute moments into ``sums``, which start at zero; returns the number of samples."""
    pattern, centroid, grow, back = noise.pattern, noise.centroid, noise.expansion, noise.mean_shift
    z, scalars, tensors, vectors = sums
    n = y.shape[1]
    count, mean = 0.0, vectors[0]
    for t in range(n):
        p = pattern[t]
        if p < 0 or not used[t]:
            continue
        count += 1.0
        v0, v1, v2 = y[0, t] - centroid[p, 0], y[1, t] - centroid[p, 1], y[2, t] - centroid[p, 2]
        for i in range(3):
            z[i, t] = centroid[p, i] + grow[p, i, 0] * v0 + grow[p, i, 1] * v1 + grow[p, i, 2] * v2 - back[p, i]
            mean[i] += z[i, t]
    if count == 0.0:
        return 0.0
    for i in range(3):
        mean[i] /= count
    f, fz = np.empty((3, 3)), np.empty(3)
    for t in range(n):
        p = pattern[t]
        if p < 0 or not used[t]:
            continue
        covariance_of_sample(z[0, t] - centroid[p, 0], z[1, t] - centroid[p, 1], z[2, t] - centroid[p, 2], noise, p, f)
        square, trace, along = 0.0, f[0, 0] + f[1, 1] + f[2, 2], 0.0
        for i in range(3):
            z[i, t] -= mean[i]
            square += z[i, t] * z[i, t]
        for i in range(3):
            fz[i] = f[i, 0] * z[0, t] + f[i, 1] * z[1, t] + f[i, 2] * z[2, t]
            along += fz[i] * z[i, t]
            vectors[1, i] += square * z[i, t]
            vectors[2, i] += fz[i]
            vectors[3, i] += trace * z[i, t]
            for j in range(3):
                tensors[0, i, j] += z[i, t] * z[j, t]
                tensors[1, i, j] += f[i, j]
        scalars[0] += square * square
        scalars[1] += along
    scalars[0], scalars[1] = scalars[0] / count, scalars[1] / count
    for i in range(3):
        for k in range(1, 4):
            vectors[k, i] /= count
        for j in range(3):
            tensors[0, i, j] /= count
            tensors[1, i, j] /= count
    return count


def add_scores(
    moments: MarkerMoments, size: float, center: Floats, within: Floats, weight: float, scores: Floats
) -> None:
    """Add a marker's part of the estimating functions of (c, η), frame by frame.

    They are ½ z f + η (F (o - z) - ½ Tr F z) for the centre, with o = c - x̄, and f² - 4η vᵀFv + 2η² Tr F² (as in
    `squared_noise`) for the size, with v = z - o and f = |v|² less its mean. Both sum to zero at the solution.

    Args:
        moments: of the marker.
        size: variance η of the noise, in units of what was expected.
        center: c (3,).
        within: projection (3, 3) of o: onto the plane across an axis, or the identity.
        weight: of the marker.
        scores: receives the scores (4, frames).
    """
    offset, squared = within @ (center - moments.mean), moments.squared_noise(center)
    solution = _Solution(size, offset, moments.mean, squared, weight)
    _add_scores(moments.z, moments.used, moments.by_pattern, solution, scores)


class _Solution(NamedTuple):
    """A solution about which scores are computed, for one marker; ``squared`` is its `squared_noise`."""

    size: float
    offset: Floats
    mean: Floats
    squared: float
    weight: float


@compiled
def _add_scores(z: Floats, used: Bools, noise: PatternNoise, solution: _Solution, scores: Floats) -> None:
    """Compiled part of `add_scores`."""
    size, offset, mean, squared, weight = solution
    pattern, centroid = noise.pattern, noise.centroid
    n = z.shape[1]
    level, count = 0.0, 0.0
    for t in range(n):
        if pattern[t] >= 0 and used[t]:
            count += 1.0
            level += (z[0, t] - offset[0]) ** 2 + (z[1, t] - offset[1]) ** 2 + (z[2, t] - offset[2]) ** 2
    level /= count
    f = np.empty((3, 3))
    for t in range(n):
        p = pattern[t]
        if p < 0 or not used[t]:
            continue
        x0, x1, x2 = z[0, t] + mean[0], z[1, t] + mean[1], z[2, t] + mean[2]
        covariance_of_sample(x0 - centroid[p, 0], x1 - centroid[p, 1], x2 - centroid[p, 2], noise, p, f)
        v0, v1, v2 = z[0, t] - offset[0], z[1, t] - offset[1], z[2, t] - offset[2]
        residual = v0 * v0 + v1 * v1 + v2 * v2 - level
        trace, along = f[0, 0] + f[1, 1] + f[2, 2], 0.0
        for i in range(3):
            fv = f[i, 0] * v0 + f[i, 1] * v1 + f[i, 2] * v2
            along += fv * (z[i, t] - offset[i])
            scores[i, t] += weight * (0.5 * z[i, t] * residual - size * (fv + 0.5 * trace * z[i, t]))
        scores[3, t] += weight * (residual * residual - 4.0 * size * along + 2.0 * size * size * squared)


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


SHAPE_ERROR = 0.1
"""Relative uncertainty of the noise's variance in one direction: the shape of its covariance is known to this."""


class PooledMoments:
    """Moments of the markers of one joint, with weights, in the subspace that the columns of a basis (3, d) span.

    Attributes:
        markers: moments of each marker.
        present: places of these in the list that they were taken from.
        stacked: their arrays.
        w: weights (M,).
    """

    def __init__(self, markers: Sequence[MarkerMoments], present: list[int]) -> None:
        self.markers, self.present = markers, present
        second = np.array([m.second for m in markers])
        self.stacked = StackedMoments(
            n=np.array([m.count for m in markers]),
            mean=np.array([m.mean for m in markers]),
            c=second,
            s=np.array([m.third for m in markers]),
            f=np.array([m.noise for m in markers]),
            fz=np.array([m.noise_z for m in markers]),
            trace_z=np.array([m.trace_z for m in markers]),
            zfz=np.array([m.z_noise_z for m in markers]),
            variance=np.array([m.fourth for m in markers]) - np.trace(second, axis1=1, axis2=2) ** 2,
            shift=np.array([m.shift for m in markers]),
            tilt=np.array([m.tilt for m in markers]),
            pivot=np.array([m.pivot for m in markers]),
        )
        self.w = self.stacked.n.copy()

    def solve(self, basis: Floats, given: float | None = None) -> tuple[float, Floats]:
        """Solve for the size η of the noise, unless given, and the centre (3,); sets the weights that belong to it."""
        center = np.empty(3)
        size = solve_center(self.stacked, basis, math.nan if given is None else given, self.w, center)
        return size, center

    def reweight(self, center: Floats, basis: Floats) -> None:
        """Set the weights n/r̂², of radii without noise taken off: those are never too small."""
        self.w = self.stacked.n / np.maximum(self.square_radii(center, 0.0, basis), 1e-300)

    def extents(self) -> Floats:
        """Eigenvalues of Σ n C (3,), ascending."""
        return np.asarray(np.linalg.eigvalsh(np.einsum("p,pij->ij", self.stacked.n, self.stacked.c)))

    def matrix(self, size: float, basis: Floats) -> Floats:
        """A = Σ w (C - ηF), in the basis (d, d)."""
        m = self.stacked
        return np.asarray(basis.T @ np.einsum("p,pij->ij", self.w, m.c - size * m.f) @ basis)

    def largest_size(self, basis: Floats) -> float:
        """Smallest generalised eigenvalue of (Σ w C, Σ w F) in the basis: η must be below it for a centre to exist."""
        total = basis.T @ np.einsum("p,pij->ij", self.w, self.stacked.c) @ basis
        noise = basis.T @ np.einsum("p,pij->ij", self.w, self.stacked.f) @ basis
        return smallest_generalised_eigenvalue(total, noise)

    def square_radii(self, center: Floats, size: float, basis: Floats) -> Floats:
        """r̂² of each marker (M,) (paper eq. 23)."""
        m, o = self.stacked, self._offsets(center, basis)
        inside = basis.T @ (m.c - size * m.f) @ basis
        return np.asarray(np.trace(inside, axis1=1, axis2=2) + np.einsum("pi,pi->p", o, o))

    def radial_noise(self, size: float, center: Floats, basis: Floats) -> float:
        """Standard deviation of the noise along the radius, metres."""
        o = self._offsets(center, basis)
        square = np.trace(self.stacked.c, axis1=1, axis2=2) + np.einsum("pi,pi->p", o, o)
        return float(np.sqrt(max(size * (self.w @ self._mean_vfv(o)) / (self.w @ square), 0.0)))

    def significance(self, size: float, effective: float, basis: Floats, shape_error: float = 0.0) -> float:
        """Significance of the smallest eigenvalue: standard errors by which it exceeds the noise.

        Its standard error is η√(2/n), n the effective number of independent frames, and a share of η.
        """
        error = size * (np.sqrt(2.0 / max(effective, 1.0)) + shape_error)
        return float((self.largest_size(basis) - size) / max(error, 1e-300))

    def slow_share(self, center: Floats) -> float:
        """Share of the residuals' variance that a frame has in common with the next one.

        Soft tissue is slow, and noise of markers and poses is new in each frame.
        """
        common, total = 0.0, 0.0
        for marker, weight in zip(self.markers, self.w / self.stacked.n, strict=True):
            used = marker.used & (marker.by_pattern.pattern >= 0)
            one, two = lagged_products(marker.z, used, center - marker.mean)
            common, total = common + weight * one, total + weight * two
        return min(max(common / total, 0.0), 1.0) if 0.0 < total < math.inf else 1.0

    def shape_covariance(self, size: float, center: Floats, basis: Floats, error: float) -> Floats:
        """Covariance of the centre (3, 3), m², as the shape of the noise's covariance is known to `SHAPE_ERROR`.

        The noise along each principal direction e of the motion is off by that share, independently of the others: F
        changes by a share of eᵀFe eeᵀ. The estimating functions (see `add_scores`) change with it, and (c, η) by the
        inverse of their Jacobian. Where the noise shows along e itself, as the residual of one marker's sphere, η
        takes it up.
        """
        m, o = self.stacked, self._offsets(center, basis)
        directions = basis @ np.linalg.eigh(self.matrix(size, basis))[1]
        along = np.einsum("ik,pij,jk->kp", directions, m.f, directions)
        offset, extent = directions.T @ o.T, np.einsum("ik,pij,jk->kp", directions, m.c, directions)
        weighted = error * size * self.w * along
        scores = np.empty((basis.shape[1] + 1, directions.shape[1]))
        scores[:-1] = basis.T @ directions * (weighted * offset).sum(axis=1)
        scores[-1] = (4.0 * weighted * (size * along - extent - offset**2)).sum(axis=1)
        shifts = basis @ np.linalg.pinv(self.jacobian(size, center, basis))[:-1] @ scores
        return np.asarray(shifts @ shifts.T)

    def least_direction(self, size: float) -> tuple[Floats, Floats]:
        """Direction of least extent (3,), and the two across it as columns (3, 2)."""
        vectors = np.linalg.eigh(self.matrix(size, np.eye(3)))[1]
        return vectors[:, 0], vectors[:, 1:]

    def exactly_planar(self) -> bool:
        """True if the smallest extent, and that alone, is rounding."""
        values = self.extents()
        return bool(values[0] <= TINY * values[2] < values[1])

    def rms_angles(self, size: float) -> Floats:
        """Root mean square angles of motion about the centre, along the principal directions (3,), ascending."""
        values = np.linalg.eigvalsh(self.matrix(size, np.eye(3))) / self.stacked.n.sum()
        return np.asarray(np.sqrt(np.maximum(values, 0.0)))

    def jacobian(self, size: float, center: Floats, basis: Floats) -> Floats:
        """Jacobian of the estimating functions of (c, η), see `add_scores`, in the basis (d + 1, d + 1)."""
        m, o = self.stacked, self._offsets(center, basis)
        fo = np.einsum("pij,pj->pi", m.f, o)
        d = basis.shape[1]
        slopes = np.empty((d + 1, d + 1))
        slopes[:d, :d] = -self.matrix(size, basis)
        slopes[:d, d] = basis.T @ (self.w @ (fo - m.fz - 0.5 * m.trace_z))
        residual = m.s - 2.0 * np.einsum("pij,pj->pi", m.c, o)
        slopes[d, :d] = basis.T @ (self.w @ (-4.0 * residual + 8.0 * size * (m.fz - fo)))
        slopes[d, d] = self.w @ (-4.0 * self._mean_vfv(o) + 4.0 * size * self._squared_noise(center))
        return slopes

    def _offsets(self, center: Floats, basis: Floats) -> Floats:
        """O of each marker (M, 3), within the basis."""
        return np.asarray((center - self.stacked.mean) @ basis @ basis.T)

    def _squared_noise(self, center: Floats) -> Floats:
        """`squared_noise` of each marker (M,)."""
        m, result = self.stacked, np.empty(len(self.stacked.n))
        squared_noise(center, m.mean, m.pivot, m.shift, m.tilt, result)
        return result

    def _mean_vfv(self, o: Floats) -> Floats:
        """Mean vᵀFv of each marker (M,)."""
        quadratic = np.einsum("pi,pij,pj->p", o, self.stacked.f, o)
        return np.asarray(self.stacked.zfz - 2.0 * np.einsum("pi,pi->p", o, self.stacked.fz) + quadratic)
