"""Moments of a marker as seen from a moving frame, and what the noise of marker and frame adds to them.

Subtracting the noise's covariance sample by sample is UGDK's own idea (paper eqs 10-17) where every sample has another
covariance F (`carried.py`):

    second moment  Σzzᵀ - ΣF,        third moment  Σ|z|²z - Σ(2F + Tr F) z,

exact in the mean for any symmetric noise. `center.py` makes a centre of them; the scores, what each frame adds to the
equations that define it, tell how well it is known.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from study.mocap.joints.pose_noise import CarriedNoise
from study.sphere.jit import compiled
from study.sphere.types import Bools, Floats, Ints


@dataclass(frozen=True)
class Seen:
    """Moments of one marker as seen from a moving frame, with what its noise adds to them at size 1 (weights 1/n).

    Attributes:
        count: samples n.
        mean: x̄ (3,), metres.
        second, third, fourth: of z = x - x̄: mean zzᵀ (3, 3), |z|²z (3,), |z|⁴.
        noise: mean F (3, 3).
        pulled: mean F z (3,); ``traced``: mean Tr F z (3,); ``along``: mean zᵀFz.
        shift, tilt: mean covariances of the noise that does not turn, the marker's own with it, and of the turn (3, 3).
        pivot: mean point about which it turns (3,), metres.
        z: the samples themselves, freed from what noise does to them on average, less their mean (3, frames).
    """

    count: float
    mean: Floats
    second: Floats
    third: Floats
    fourth: float
    noise: Floats
    pulled: Floats
    traced: Floats
    along: float
    shift: Floats
    tilt: Floats
    pivot: Floats
    z: Floats

    def squared(self, center: Floats) -> float:
        """Half the variance of |noise|² in the residuals about a centre; see `squared_noise`."""
        result = np.empty(1)
        squared_noise(center, self.mean[None], self.pivot[None], self.shift[None], self.tilt[None], result)
        return float(result[0])


@compiled
def squared_noise(center: Any, mean: Any, pivot: Any, shift: Any, tilt: Any, into: Any) -> None:
    """Half the variance of |noise|² in the residuals about a centre: Tr F², if noise were as (*) says it is.

    A turn about the pivot leaves the distance from it as it is: only as far as the centre is from the pivot does it
    count at second order. With d and v the centre and the marker's mean from there, S the shift and T the tilt, it is
    Tr S (S + 2 [d] T [d]ᵀ) + Tr Q², Q = (½ (d vᵀ + v dᵀ) - d·v) T.

    Args:
        center: (3,).
        mean: of each marker (M, 3).
        pivot: of each (M, 3), metres, as in `Seen`.
        shift: of each (M, 3, 3), m², likewise.
        tilt: of each (M, 3, 3), rad², likewise.
        into: receives the result (M,).
    """
    d, v, turned, q = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for p in range(len(into)):
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
        into[p] = total


def seen(y: Floats, used: Bools, carried: CarriedNoise, own: float, size: float) -> Seen:
    """Moments of a marker.

    Args:
        y: where it was seen from the frame (3, frames), metres.
        used: the samples that count (frames,), in frames that are known.
        carried: the frame's noise.
        own: variance s² of the marker's own noise, m².
        size: by how much the noise is larger than ``carried`` and ``own`` say, for what it draws in.
    """
    sums, tensors, vectors = np.zeros(2), np.zeros((2, 3, 3)), np.zeros((4, 3))
    z = np.empty_like(y)
    count = _seen(y, used, *_tables(carried, own, size), z, sums, tensors, vectors)
    patterns = carried.pattern[used & (carried.pattern >= 0)]
    share = np.bincount(patterns, minlength=len(carried.centroid)) / max(count, 1.0)
    shift = own * np.eye(3) + np.einsum("k,kij->ij", share, carried.shift)
    return Seen(
        count, vectors[0], tensors[0], vectors[1], sums[0], tensors[1], vectors[2], vectors[3], sums[1],
        shift, np.einsum("k,kij->ij", share, carried.tilt), share @ carried.centroid, z,
    )  # fmt: skip


def scores(
    moments: Seen, used: Bools, carried: CarriedNoise, own: float, size: float, center: Floats, within: Floats,
    weight: float, into: Floats,
) -> None:  # fmt: skip
    """Add a marker's part of the estimating functions of (c, size), frame by frame, to ``into`` (4, frames).

    They are ½ z f + size (F (o - z) - ½ Tr F z) for the centre, o = c - x̄, and f² - 4 size vᵀFv + 2 size² Tr F² (as in
    `Seen`) for the size, v = z - o, f = |v|² less its mean; both add up to zero at the solution.
    ``within`` (3, 3) projects o: onto the plane across an axis, or not at all. The other arguments are those of `seen`.
    """
    offset, squared = within @ (center - moments.mean), moments.squared(center)
    pattern, centroid, shift, tilt, cross, _, _ = _tables(carried, own, size)
    _scores(moments.z, used, pattern, centroid, shift, tilt, cross, size, offset, moments.mean, squared, weight, into)


def _tables(
    carried: CarriedNoise, own: float, size: float
) -> tuple[Ints, Floats, Floats, Floats, Floats, Floats, Floats]:
    shift = carried.shift + own * np.eye(3)
    grown, drift = carried.grown(size), carried.drift(size)
    return carried.pattern, carried.centroid, shift, carried.tilt, carried.cross, grown, drift


@compiled
def _noise_at(v0: float, v1: float, v2: float, shift: Any, tilt: Any, cross: Any, f: Any) -> None:
    """F at v (*), into ``f`` (3, 3)."""
    for j in range(3):
        # a row of [v] T, turned into columns: row i of [v] is v × e_i
        f[0, j] = v1 * tilt[2, j] - v2 * tilt[1, j]
        f[1, j] = v2 * tilt[0, j] - v0 * tilt[2, j]
        f[2, j] = v0 * tilt[1, j] - v1 * tilt[0, j]
    for i in range(3):
        a, b, c = f[i, 0], f[i, 1], f[i, 2]
        f[i, 0], f[i, 1], f[i, 2] = v1 * c - v2 * b, v2 * a - v0 * c, v0 * b - v1 * a
    for j in range(3):
        a, b, c = cross[0, j], cross[1, j], cross[2, j]
        x0, x1, x2 = v1 * c - v2 * b, v2 * a - v0 * c, v0 * b - v1 * a
        f[0, j] -= x0
        f[1, j] -= x1
        f[2, j] -= x2
        f[j, 0] -= x0
        f[j, 1] -= x1
        f[j, 2] -= x2
    for i in range(3):
        for j in range(3):
            f[i, j] += shift[i, j]


@compiled
def _seen(
    y: Any, used: Any, pattern: Any, centroid: Any, shift: Any, tilt: Any, cross: Any, grown: Any, drift: Any,
    z: Any, sums: Any, tensors: Any, vectors: Any,
) -> float:  # fmt: skip
    """Moments as `Seen` has them, ``z`` = corrected coordinates less their mean; the count is returned."""
    n = y.shape[1]
    count, mean = 0.0, vectors[0]
    for t in range(n):
        p = pattern[t]
        if p < 0 or not used[t]:
            continue
        count += 1.0
        v0, v1, v2 = y[0, t] - centroid[p, 0], y[1, t] - centroid[p, 1], y[2, t] - centroid[p, 2]
        for i in range(3):
            z[i, t] = centroid[p, i] + grown[p, i, 0] * v0 + grown[p, i, 1] * v1 + grown[p, i, 2] * v2 - drift[p, i]
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
        _noise_at(
            z[0, t] - centroid[p, 0], z[1, t] - centroid[p, 1], z[2, t] - centroid[p, 2], shift[p], tilt[p], cross[p], f
        )
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
        sums[0] += square * square
        sums[1] += along
    sums[0], sums[1] = sums[0] / count, sums[1] / count
    for i in range(3):
        for k in range(1, 4):
            vectors[k, i] /= count
        for j in range(3):
            tensors[0, i, j] /= count
            tensors[1, i, j] /= count
    return count


@compiled
def _scores(
    z: Any, used: Any, pattern: Any, centroid: Any, shift: Any, tilt: Any, cross: Any,
    size: float, offset: Any, mean: Any, squared: float, weight: float, into: Any,
) -> None:  # fmt: skip
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
        _noise_at(
            z[0, t] + mean[0] - centroid[p, 0], z[1, t] + mean[1] - centroid[p, 1], z[2, t] + mean[2] - centroid[p, 2],
            shift[p], tilt[p], cross[p], f,
        )  # fmt: skip
        v0, v1, v2 = z[0, t] - offset[0], z[1, t] - offset[1], z[2, t] - offset[2]
        residual = v0 * v0 + v1 * v1 + v2 * v2 - level
        trace, along = f[0, 0] + f[1, 1] + f[2, 2], 0.0
        for i in range(3):
            fv = f[i, 0] * v0 + f[i, 1] * v1 + f[i, 2] * v2
            along += fv * (z[i, t] - offset[i])
            into[i, t] += weight * (0.5 * z[i, t] * residual - size * (fv + 0.5 * trace * z[i, t]))
        into[3, t] += weight * (residual * residual - 4.0 * size * along + 2.0 * size * size * squared)
