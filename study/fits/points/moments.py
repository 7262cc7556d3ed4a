"""Centred moments of a point set: all that a closed-form sphere fit needs to know about its data.

With y = x - x̄ they are n, x̄, Σyyᵀ, Σy|y|² and Σ|y|⁴ - 14 numbers in three dimensions. The moments of two sets merge
into those of their union, whatever the number of samples, exactly but for the rounding of their means.

The data are read once. Samples are taken relative to the mean of the first few, so that a distant origin costs no
digits, and the sums are then moved to their own mean by means of the first moment: the formulas assume Σy = 0, which a
rounded mean does not give. Each chunk is summed by itself, and the sums of chunks by block, for long sums lose digits.

Source: the digits that other ways lose are in theory §7.

Kåsa's regression: what every closed form of the family needs to know of a point set.

With y = x - o for any origin o, the algebraic fit regresses |y|² on y. It needs their means and covariances, and the
answer does not depend on o. From the points themselves o is the centroid, and the covariances are the centred
`Moments`. Where the truth is known o can be the true centre: then they are formed from the errors alone
(`study.fits.points.moments`), and so is the answer.

Joint moments of directions u and noise z: from one pass over the draws, the fits at every noise level.

A sample is x = c + r u + σ z. All that a closed form needs of x - c and |x - c|² are means and covariances of u, z,
u·z and |z|² (44 numbers in three dimensions), combined by powers of r and σ. So the points need not be formed, and
the error of a fit is found without the large numbers that would cancel in it: what remains is the statistical error
alone, to a relative accuracy of about 10 ε/φ², however small the noise.

Source: theory §8.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from study.arrays import Floats, Ints
from study.fits.loops.jit import (
    BLOCK,
    CHUNK,
    PointSets,
    SampleBlock,
    Scratch,
    Sums,
    View,
    at,
    compiled,
    dot,
    extent,
    fresh,
    near,
    put,
    readable,
    total,
    window,
    zeros,
)
from study.fits.loops.linalg import components_all, diagonalise_all


class Moments(NamedTuple):
    """Centred moments of a batch of point sets, in three arrays, which is what a kernel takes.

    Attributes:
        numbers: ``n`` and ``fourth`` of each set (2, b).
        vectors: ``mean`` and ``third`` (2, b, d).
        second: Σyyᵀ (b, d, d), unit squared.
    """

    numbers: Floats
    vectors: Floats
    second: Floats

    @classmethod
    def of(cls, x: Floats) -> "Moments":
        """Compute the moments of point sets: an array (b, d, n) in any memory layout."""
        b, d, _ = x.shape
        moments = cls(np.empty((2, b)), np.empty((2, b, d)), np.empty((b, d, d)))
        accumulate(readable(x), moments, zeros(d), zeros(d, d))
        return moments

    def merge(self, other: "Moments") -> "Moments":
        """Moments of the union of each set with the set at the same place of another batch, in any order.

        Means are stored rounded, to ε|x̄|: where that matters beside the points' extent, fit all points at once.
        """
        n, mean = self.n + other.n, self.mean + (other.n / (self.n + other.n))[:, None] * (other.mean - self.mean)
        second, third, fourth = map(np.add, self._about(mean), other._about(mean))
        return Moments(np.stack([n, fourth]), np.stack([mean, third]), second)

    def _about(self, origin: Floats) -> tuple[Floats, Floats, Floats]:
        """Σyyᵀ, Σy|y|² and Σ|y|⁴ about another origin (b, d)."""
        n, delta = self.n[:, None], origin - self.mean
        square = (delta * delta).sum(axis=1, keepdims=True)
        trace, product = np.trace(self.second, axis1=1, axis2=2)[:, None], np.einsum("bij,bj->bi", self.second, delta)
        second = self.second + n[:, None] * delta[:, :, None] * delta[:, None]
        third = self.third - 2.0 * product - delta * (trace + n * square)
        inner = 4.0 * (delta * (product - self.third)).sum(axis=1, keepdims=True)
        return second, third, self.fourth + (inner + square * (2.0 * trace + n * square))[:, 0]

    def moved(self, by: Floats) -> "Moments":
        """Moments of the points moved by a vector (d,) or one for each set (b, d)."""
        return self._replace(vectors=np.stack([self.mean + by, self.third]))

    @property
    def n(self) -> Floats:
        """Number of samples of each set (b,)."""
        return np.asarray(self.numbers[0])

    @property
    def mean(self) -> Floats:
        """The mean x̄ (b, d), in the unit of the points."""
        return np.asarray(self.vectors[0])

    @property
    def third(self) -> Floats:
        """Σy|y|² (b, d), unit cubed."""
        return np.asarray(self.vectors[1])

    @property
    def fourth(self) -> Floats:
        """Σ|y|⁴ (b,), unit to the fourth."""
        return np.asarray(self.numbers[1])

    @property
    def covariance(self) -> Floats:
        """Sample covariance C, paper eq. 5: (b, d, d)."""
        return self.second / (self.n - 1.0)[:, None, None]


@compiled
def shift(n: float, delta: Floats, first: Floats, second: Floats, third: Floats, fourth: float) -> float:
    """Move the origin of the raw moments of n samples by ``delta``, in place, and return the fourth.

    ``first`` = Σy, ``second`` = Σyyᵀ, ``third`` = Σy|y|², ``fourth`` = Σ|y|⁴; afterwards the same of y - δ.
    """
    d = delta.size
    square = trace = along_first = along_third = quadratic = 0.0
    for i in range(d):
        square += delta[i] * delta[i]
        trace += second[i, i]
        along_first += delta[i] * first[i]
        along_third += delta[i] * third[i]
        for j in range(d):
            quadratic += delta[i] * second[i, j] * delta[j]
    fourth += 4.0 * quadratic - 4.0 * along_third + square * (2.0 * trace - 4.0 * along_first + n * square)
    for i in range(d):
        product = 0.0
        for j in range(d):
            product += second[i, j] * delta[j]
        third[i] += square * first[i] - 2.0 * product - delta[i] * (trace - 2.0 * along_first + n * square)
    for i in range(d):
        for j in range(d):
            second[i, j] += n * delta[i] * delta[j] - first[i] * delta[j] - delta[i] * first[j]
    for i in range(d):
        first[i] -= n * delta[i]
    return fourth


@compiled
def _low(view: View, m: int, origin: Sums, first: Sums, second: Sums) -> tuple[Sums, Sums]:
    """Add Σy and Σyyᵀ (lower triangle), y = x - origin, of m samples of a set."""
    d, y = len(first), fresh(first)
    for k in range(m):
        for i in range(d):
            y = put(y, i, at(view, i, k) - origin[i])
        for i in range(d):
            first = put(first, i, first[i] + y[i])
            for j in range(i + 1):
                second = put(second, i * d + j, second[i * d + j] + y[i] * y[j])
    return first, second


@compiled
def _high(view: View, m: int, origin: Sums, third: Sums, fourth: float) -> tuple[Sums, float]:
    """Add Σy|y|² and Σ|y|⁴. Apart from `_low`, because together they need more registers than there are."""
    d, y = len(third), fresh(third)
    for k in range(m):
        square = 0.0
        for i in range(d):
            y = put(y, i, at(view, i, k) - origin[i])
            square += y[i] * y[i]
        for i in range(d):
            third = put(third, i, third[i] + y[i] * square)
        fourth += square * square
    return third, fourth


@compiled
def _add(block: SampleBlock, moments: Moments, first: Floats, scratch: Scratch) -> None:
    """Add the sums of a block of samples about its set's ``mean``: Σy to ``first`` (d,), the others to the moments."""
    x, t, begin, m = block
    rows, zero, square = scratch
    d = len(zero)
    origin, one, two, three, four = fresh(zero), fresh(zero), fresh(square), fresh(zero), 0.0
    mean, third, second = moments.vectors[0], moments.vectors[1], moments.second
    for i in range(d):
        origin = put(origin, i, mean[t, i])
    for start in range(begin, begin + m, CHUNK):
        count = min(CHUNK, begin + m - start)
        view = window(x, t, start, count, rows, zero)
        some_one, some_two = _low(view, count, origin, fresh(zero), fresh(square))
        some_three, some_four = _high(view, count, origin, fresh(zero), 0.0)
        four += some_four
        for i in range(d):
            one, three = put(one, i, one[i] + some_one[i]), put(three, i, three[i] + some_three[i])
            for j in range(i + 1):
                two = put(two, i * d + j, two[i * d + j] + some_two[i * d + j])
    for i in range(d):
        first[i] += one[i]
        third[t, i] += three[i]
        for j in range(i + 1):
            second[t, i, j] += two[i * d + j]
    moments.numbers[1, t] += four


@compiled
def accumulate(x: PointSets, moments: Moments, zero: Sums, square: Sums) -> None:
    """Write the moments of each point set of a batch (b, d, n).

    ``zero`` and ``square`` are d and d² sums at zero.
    """
    b, d, n = extent(x)
    scratch = Scratch(np.empty((1, d, CHUNK)), zero, square)
    first, delta = np.empty(d), np.empty(d)
    mean, third, second = moments.vectors[0], moments.vectors[1], moments.second
    count, fourth = moments.numbers[0], moments.numbers[1]
    for t in range(b):
        point, count[t], fourth[t] = near(x, t, n, scratch.rows, zero), float(n), 0.0
        for i in range(d):
            mean[t, i], first[i], third[t, i] = point[i], 0.0, 0.0
            for j in range(i + 1):
                second[t, i, j] = 0.0
        for start in range(0, n, BLOCK):
            _add(SampleBlock(x, t, start, min(BLOCK, n - start)), moments, first, scratch)
        for i in range(d):
            delta[i] = first[i] / n
            for j in range(i):
                second[t, j, i] = second[t, i, j]
        fourth[t] = shift(float(n), delta, first, second[t], third[t], fourth[t])
        for i in range(d):
            mean[t, i] += delta[i]


class Regression(NamedTuple):
    """Moments of y = x - o and |y|² of a batch of point sets, in the few arrays that a kernel takes.

    Attributes:
        numbers: n, ``variance``, ``square`` and the base of each set: r², where it is known and the fits are wanted as
            errors, else 0 (4, b).
        vectors: ``origin``, ``mean`` and the sample covariance of y and |y|² (3, b, d): that is the paper's S, eq. 6,
            where the mean of y is 0.
        covariance: C, the sample covariance of y, in weights of 1/(n - 1), paper eq. 5 (b, d, d).
        along: eigenvalues of C, ascending, and the components of S and ``mean`` along its axes (3, b, d).
        axes: eigenvectors of C (b, d, d), as columns.
    """

    numbers: Floats
    vectors: Floats
    covariance: Floats
    along: Floats
    axes: Floats

    @classmethod
    def of(cls, numbers: Floats, vectors: Floats, covariance: Floats) -> "Regression":
        """Form a regression from its moments, and diagonalise C."""
        result = cls(numbers, vectors, covariance, np.empty(vectors.shape), np.empty(covariance.shape))
        _decompose(result)
        return result

    @classmethod
    def about_centroids(cls, moments: Moments) -> "Regression":
        """Form the regression about the centroids."""
        b, d, _ = moments.second.shape
        parts = np.empty((3, b, d)), np.empty((b, d, d)), np.empty((3, b, d)), np.empty((b, d, d))
        result = cls(np.empty((4, b)), *parts)
        _central(moments, result)
        return result

    def take(self, places: Ints) -> "Regression":
        """The regression of sets of the batch, by their places (k,)."""
        return Regression.of(self.numbers[:, places], self.vectors[:, places], self.covariance[places])

    @property
    def n(self) -> Floats:
        """Number of samples of each set (b,)."""
        return np.asarray(self.numbers[0])

    @property
    def variance(self) -> Floats:
        """Variance of |y|², in weights of 1/n (b,)."""
        return np.asarray(self.numbers[1])

    @property
    def square(self) -> Floats:
        """Mean of |y|², less the base (b,)."""
        return np.asarray(self.numbers[2])

    @property
    def origin(self) -> Floats:
        """The origin o (b, d), in the unit of the points."""
        return np.asarray(self.vectors[0])

    @property
    def mean(self) -> Floats:
        """Mean of y (b, d)."""
        return np.asarray(self.vectors[1])

    @property
    def eigenvalues(self) -> Floats:
        """Eigenvalues of C (b, d), ascending."""
        return np.asarray(self.along[0])


@compiled
def _decompose(regression: Regression) -> None:
    """Write eigenvalues and eigenvectors of C, and the components along these."""
    _, vectors, covariance, along, axes = regression
    diagonalise_all(covariance, along[0], axes)
    components_all(axes, vectors[2], along[1])
    components_all(axes, vectors[1], along[2])


@compiled
def _central(moments: Moments, regression: Regression) -> None:
    """C and S (paper eqs 5 and 6), and variance and mean of |y|², of sums about the centroid."""
    second, origin, third = moments.second, moments.vectors[0], moments.vectors[1]
    count, fourth = moments.numbers[0], moments.numbers[1]
    numbers, vectors, covariance, _, _ = regression
    b, d = third.shape
    for t in range(b):
        n, trace = count[t], 0.0
        for i in range(d):
            trace += second[t, i, i]
            vectors[0, t, i], vectors[1, t, i], vectors[2, t, i] = origin[t, i], 0.0, third[t, i] / (n - 1.0)
            for j in range(d):
                covariance[t, i, j] = second[t, i, j] / (n - 1.0)
        square = trace / n
        numbers[0, t], numbers[1, t], numbers[2, t], numbers[3, t] = n, fourth[t] / n - square * square, square, 0.0
    _decompose(regression)


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
        return Regression.of(
            numbers=np.stack([count, variance.reshape(-1), excess.reshape(-1), np.repeat(radius**2, b)]),
            vectors=np.stack([np.zeros_like(cross), middle.reshape(-1, d), cross]),
            covariance=second.reshape(-1, d, d) * weight[:, None, None],
        )
