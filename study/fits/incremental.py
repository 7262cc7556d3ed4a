"""Incremental GDK: one sample at a time, in constant memory, with an answer at any moment.

There are two ways. `igdk` is the paper's: recurrences for x̄, C, S and C⁻¹ (a rank-one update, so no new inverse is
needed), and the answer is GDKE's with its bias - with C - Σ the update is no longer of rank one. `Incremental` keeps
the moments, which merge exactly, and solves the d × d system when an answer is wanted: every closed form, unbiased ones
among them, from the same few numbers.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from study.arrays import Floats, Ints, real_array
from study.fits.answer import Fit
from study.fits.bounds import noise_covariance
from study.fits.closed_forms import residual_noise
from study.fits.jit import compiled
from study.fits.moments import Moments
from study.fits.samples import Estimates, Estimator, Samples, Status, blank, is_ordinary, remove


class Running(NamedTuple):
    """State of the recurrences: x̄ (b, d), C (b, d, d) and S (b, d) in weights of 1/(n - 1), and C⁻¹ (b, d, d)."""

    mean: Floats
    covariance: Floats
    third: Floats
    inverse: Floats


@compiled
def _step(point: Floats, n: float, running: Running, delta: Floats, w: Floats) -> None:
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
            _step(point, float(k), one, delta, w)


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
        mean[waiting], c[waiting], s[waiting] = start.mean, start.covariance, start.third_central
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


class Incremental:
    """A sphere fit that grows with its points, in constant memory.

    The points are not stored: 14 numbers in three dimensions stand for all of them, and every closed form gives from
    these the answer that it gives from the points.

    Args:
        dimension: d ≥ 2.

    Attributes:
        dimension: d.
        moments: the `Moments` of the points so far, a batch of one; None while there are none.

    Raises:
        ValueError: if the dimension is smaller than 2.

    Example:
        >>> import study
        >>> growing = study.Incremental(2)
        >>> for points in ([[1, 0], [0, 1]], [[-1, 0], [0, -1]]):
        ...     growing.update(points)
        >>> fit = growing.fit(study.ESTIMATORS["gdke"])
        >>> fit.center, float(fit.radius)
        (array([0., 0.]), 1.0)

    Source: the idea is the paper's, eqs 24-25.
    """

    def __init__(self, dimension: int) -> None:
        if dimension < 2:
            raise ValueError(f"dimension = {dimension}: a sphere needs at least 2")
        self.moments: Moments | None = None
        self.dimension = dimension

    def update(self, points: ArrayLike) -> None:
        """Add points.

        Args:
            points: one (d,) or several (n, d), in the unit of those before. Points with a NaN are left out.

        Raises:
            TypeError: if they are not real numbers.
            ValueError: if the shape is another.
        """
        array = np.atleast_2d(real_array(points, "points")).astype(float, copy=False)
        if array.ndim != 2 or array.shape[1] != self.dimension:
            d = self.dimension
            raise ValueError(f"points have shape {np.shape(points)}: expected ({d},) or (n, {d})")
        array = array[~np.isnan(array).any(axis=1)]
        if len(array):
            x = array.T[None]
            self.moments = Moments.of(x) if self.moments is None else self.moments.update(x)

    def merge(self, other: "Incremental") -> None:
        """Add the points of another fit that grew; that one stays as it is.

        Raises:
            ValueError: if it is of another dimension.
        """
        if other.dimension != self.dimension:
            raise ValueError(f"points of dimension {other.dimension} cannot be added to points of {self.dimension}")
        if other.moments is not None:
            self.moments = other.moments if self.moments is None else self.moments.merge(other.moments)

    def fit(self, estimator: Estimator, noise: float | Floats | None = None) -> Fit:
        """Fit the points so far by a closed form.

        Args:
            estimator: one that needs the moments alone, such as ``study.ESTIMATORS["als"]``.
            noise: standard deviation σ in the unit of the points, a covariance (d, d), or None where the estimator
                does not need it.

        Returns:
            A fit of shape ``()``. While there are fewer than d + 1 points its status is `Status.TOO_FEW_POINTS`. Points
            of a size beyond 1e40 or below 1e-40 have the status `Status.NOT_FINITE`: their moments leave the range of
            numbers.

        Raises:
            TypeError: if the noise is no real number.
            ValueError: if the estimator needs the points themselves, which are not stored, or the noise cannot be used.
        """
        if not estimator.moments_suffice:
            raise ValueError("this estimator reads the points, which are not stored: take gdke, ugdk or als")
        if noise is not None:
            noise_covariance(noise, self.dimension)
        if self.moments is None or self.moments.n[0] < self.dimension + 1:
            status = Status.TOO_FEW_POINTS
        elif np.trace(self.moments.second[0]) > 0.0 and not is_ordinary(self.moments.fourth):
            status = Status.NOT_FINITE
        else:
            return Fit(estimator(Samples.of_moments(self.moments, noise)).reshape())
        fit = blank(1, self.dimension)
        fit.status[:] = status
        return Fit(fit.reshape())
