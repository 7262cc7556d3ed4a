"""Joint moments of directions u and noise z: from one pass over the draws, the fits at every noise level.

A sample is x = c + r u + σ z. All that a closed form needs of x - c and |x - c|² are means and covariances of u, z,
u·z and |z|² (44 numbers in three dimensions), combined by powers of r and σ. So the points need not be formed, and
the error of a fit is found without the large numbers that would cancel in it: what remains is the statistical error
alone, to a relative accuracy of about 10 ε/φ², however small the noise.

Source: theory §8.
"""

from dataclasses import dataclass

import numpy as np

from study.sphere.jit import CHUNK, compiled, dot, total
from study.sphere.regression import Regression
from study.sphere.types import Floats


@compiled
def _form(u: Floats, z: Floats, start: int, m: int, near: Floats, rows: Floats) -> None:
    """Rows of m samples: 1 - u₁, u₂ … u_d, z, u·z and |z|², less ``near``."""
    d = u.shape[0]
    along, square = rows[2 * d, :m], rows[2 * d + 1, :m]
    for i in range(d):
        ui, zi, direction, noise = u[i, start : start + m], z[i, start : start + m], rows[i, :m], rows[d + i, :m]
        for k in range(m):
            direction[k] = ui[k] - near[i]
        for k in range(m):
            noise[k] = zi[k] - near[d + i]
        for k in range(m):
            cosine = 1.0 - ui[k] if i == 0 else ui[k]
            along[k] = cosine * zi[k] + (along[k] if i > 0 else -near[2 * d])
        for k in range(m):
            square[k] = zi[k] * zi[k] + (square[k] if i > 0 else -near[2 * d + 1])


@compiled
def _accumulate(directions: Floats, noise: Floats, mean: Floats, covariance: Floats) -> None:
    """Means and covariances, in weights of 1/n, of the rows of each trial."""
    b, d, n = directions.shape
    q = 2 * d + 2
    rows, near, first = np.empty((q, CHUNK)), np.empty(q), np.empty(q)
    for t in range(b):
        m = min(n, CHUNK)
        near[:] = 0.0
        _form(directions[t], noise[t], 0, m, near, rows)
        for i in range(q):
            near[i] = total(rows[i, :m]) / m
            first[i] = 0.0
        second = covariance[t]
        second[:] = 0.0
        for start in range(0, n, CHUNK):
            m = min(CHUNK, n - start)
            _form(directions[t], noise[t], start, m, near, rows)
            for i in range(q):
                first[i] += total(rows[i, :m])
                for j in range(i + 1):
                    second[i, j] += dot(rows[i, :m], rows[j, :m])
        for i in range(q):
            first[i] /= n
            mean[t, i] = near[i] + first[i]
            for j in range(i + 1):
                second[i, j] = second[j, i] = second[i, j] / n - first[i] * first[j]


@dataclass(frozen=True)
class JointMoments:
    """Means and covariances of (u, z, u·z, |z|²), in weights of 1/n, of a batch of draws.

    Attributes:
        count: number of samples n of each (b,).
        mean: (b, 2d + 2).
        covariance: (b, 2d + 2, 2d + 2).
    """

    count: Floats
    mean: Floats
    covariance: Floats

    @classmethod
    def of(cls, directions: Floats, noise: Floats) -> "JointMoments":
        """Compute them from directions with the height 1 - u₁ in place of u₁, and unit noise, (b, d, n) each."""
        b, d, n = directions.shape
        q = 2 * d + 2
        mean, covariance = np.empty((b, q)), np.empty((b, q, q))
        _accumulate(directions, noise, mean, covariance)
        mean[:, 0] = 1.0 - mean[:, 0]
        covariance[:, 0, :] *= -1.0
        covariance[:, :, 0] *= -1.0
        return cls(np.full(b, float(n)), mean, covariance)

    @classmethod
    def joined(cls, parts: "list[JointMoments]") -> "JointMoments":
        """Join several batches into one."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("count", "mean", "covariance")))

    def regression(self, sigma: Floats, radius: Floats) -> Regression:
        """Form the regression about the true centre, with the batch placed at several levels of noise and radius.

        Args:
            sigma: standard deviations of the noise (L,).
            radius: radii (L,).

        Returns:
            A batch of L·b sets, level by level. A fit of it is an error: estimated minus true centre and radius.
        """
        b, q = self.mean.shape
        d = q // 2 - 1
        u, z, n, e = slice(0, d), slice(d, 2 * d), 2 * d, 2 * d + 1
        mean, c = self.mean, self.covariance
        r, s = radius[:, None, None], sigma[:, None, None]
        rr, ss = r[..., None], s[..., None]
        cross_uz = c[:, u, z] + c[:, z, u]
        second = rr**2 * c[:, u, u] + rr * ss * cross_uz + ss**2 * c[:, z, z]
        third = 2.0 * r**2 * s * c[:, u, n] + r * s**2 * (c[:, u, e] + 2.0 * c[:, z, n]) + s**3 * c[:, z, e]
        r, s = r[..., 0], s[..., 0]
        variance = 4.0 * (r * s) ** 2 * c[:, n, n] + 4.0 * r * s**3 * c[:, n, e] + s**4 * c[:, e, e]
        excess = 2.0 * r * s * mean[:, n] + s**2 * mean[:, e]
        middle = r[..., None] * mean[:, u] + s[..., None] * mean[:, z]
        count = np.tile(self.count, len(sigma))
        weight = count / (count - 1.0)
        cross = third.reshape(-1, d) * weight[:, None]
        return Regression(
            numbers=np.stack([count, variance.reshape(-1), excess.reshape(-1), np.repeat(radius**2, b)]),
            vectors=np.stack([np.zeros_like(cross), middle.reshape(-1, d), cross]),
            covariance=second.reshape(-1, d, d) * weight[:, None, None],
        )
