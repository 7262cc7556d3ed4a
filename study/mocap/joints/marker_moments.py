"""Moments of a marker in a segment's axes, and what the noise of marker and pose adds to them.

UGDK subtracts the covariance of the noise from the moments (paper eqs 10-17). Here each sample has a covariance F of
its own, (*) of `pose_noise`:

    second moment  Σzzᵀ - ΣF,        third moment  Σ|z|²z - Σ(2F + Tr F) z.

The mean of both is exact for any symmetric noise. `center` solves for the joint's centre with these moments.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from study.mocap.geometry.pose_noise import PatternNoise, PoseNoise, covariance_of_sample
from study.sphere.jit import compiled
from study.sphere.types import Bools, Floats


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
