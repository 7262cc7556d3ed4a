"""Incremental GDK: one sample at a time, in constant memory, with an answer at any moment.

Two ways. `igdk` is the paper's: recurrences for x̄, C, S and C⁻¹ (a rank-one update, so no new inverse is needed), and
the answer is GDKE's with its bias - with C - Σ the update is no longer of rank one. `Incremental` keeps the moments,
which merge exactly, and solves the d × d system when an answer is wanted: every closed form, unbiased ones among
them, from the same few numbers.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from study.estimators.fit import Estimator, Fit, Samples, Status, blank
from study.estimators.kasa import residual_noise
from study.sphere.jit import compiled
from study.sphere.moments import Moments
from study.sphere.types import Floats


@compiled
def _step(point: Any, n: float, mean: Any, c: Any, s: Any, inverse: Any, delta: Any, w: Any) -> None:
    """Take one more sample into x̄, C, S (weights 1/(n-1)) and C⁻¹ of n samples, in place (theory §1.1)."""
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
def _stream_all(x: Any, first: int, mean: Any, c: Any, s: Any, inverse: Any) -> None:
    """Run each set of a batch (b, d, n) through the recurrence, from its sample number ``first`` on."""
    b, d, n = x.shape
    delta, w, point = np.empty(d), np.empty(d), np.empty(d)
    for t in range(b):
        for k in range(first, n):
            for i in range(d):
                point[i] = x[t, i, k]
            _step(point, float(k), mean[t], c[t], s[t], inverse[t], delta, w)


def igdk(samples: Samples) -> Fit:
    """Incremental GDK by the paper's recurrences, with GDKE's bias.

    They start on the first d + 5 samples, or more while those lie in a plane.

    Source: paper eqs 24-25; the recurrences are theory §1.1.
    """
    b, d, n = samples.shape
    first = min(n, d + 5)
    while True:
        start = Moments.of(samples.x[:, :, :first])
        mean, c, s = start.mean, start.covariance, start.third_central
        values = np.linalg.eigvalsh(np.where(np.isfinite(c), c, 0.0))
        regular = values[:, 0] > d * np.finfo(float).eps * values[:, -1]
        if regular.all() or first == n:
            break
        first = min(n, 2 * first)  # so far they lie in a plane
    fit = blank(b, d)
    inverse = np.linalg.inv(np.where(regular[:, None, None], c, np.eye(d)))
    _stream_all(samples.x, first, mean, c, s, inverse)
    offset = 0.5 * np.einsum("bij,bj->bi", inverse, s)
    fit.center[:] = mean + offset
    fit.radius[:] = np.sqrt((n - 1.0) / n * np.trace(c, axis1=1, axis2=2) + np.einsum("bi,bi->b", offset, offset))
    fit.noise_variance[:] = residual_noise(samples.regression, fit.center - samples.moments.mean)
    fit.status[~regular] = Status.SINGULAR
    fit.status[~np.isfinite(samples.moments.fourth)] = Status.NOT_FINITE
    lost = fit.status != Status.OK
    fit.center[lost], fit.radius[lost], fit.noise_variance[lost] = np.nan, np.nan, np.nan
    return fit


class Incremental:
    """A sphere fit that grows with its points, in constant memory.

    Args:
        dimension: d ≥ 2.

    Raises:
        ValueError: if the dimension is smaller.
    """

    def __init__(self, dimension: int) -> None:
        if dimension < 2:
            raise ValueError(f"dimension = {dimension}: a sphere needs at least 2")
        self.moments: Moments | None = None
        self.dimension = dimension

    def update(self, points: ArrayLike) -> None:
        """Take more points: one (d,) or several (n, d). Rows with a NaN are left out.

        Raises:
            ValueError: if the shape is another.
        """
        array = np.atleast_2d(np.asarray(points, dtype=float))
        if array.ndim != 2 or array.shape[1] != self.dimension:
            d = self.dimension
            raise ValueError(f"points have shape {np.shape(points)}: expected ({d},) or (n, {d})")
        array = array[~np.isnan(array).any(axis=1)]
        if len(array):
            x = array.T[None]
            self.moments = Moments.of(x) if self.moments is None else self.moments.update(x)

    def fit(self, estimator: Estimator, noise: float | Floats | None = None) -> Fit:
        """The answer so far, of a closed form.

        Args:
            estimator: one that looks at the moments alone, such as ``study.ESTIMATORS["als"]``.
            noise: σ, a covariance (d, d), or None where the estimator does not need it.

        Returns:
            A fit of shape ``()``; its status says so while there are fewer than d + 1 points.

        Raises:
            ValueError: if the estimator looks at the points themselves, which are not kept.
        """
        if not estimator.moments_suffice:
            raise ValueError("this estimator looks at the points, which are not kept: take gdke, ugdk or als")
        if self.moments is None or self.moments.count[0] < self.dimension + 1:
            fit = blank(1, self.dimension)
            fit.status[:] = Status.TOO_FEW_POINTS
        else:
            fit = estimator(Samples.of_moments(self.moments, noise))
        return fit.reshape()
