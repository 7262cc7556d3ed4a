"""Centred moments of a point set: all that a closed-form sphere fit needs to know about its data.

With y = x - x̄ they are n, x̄, Σyyᵀ, Σy|y|² and Σ|y|⁴ - 14 numbers in three dimensions. The moments of two sets merge
into those of their union, whatever the number of samples, exactly but for the rounding of their means.

The data are read once. Samples are taken relative to the mean of the first few, so that a distant origin costs no
digits, and the sums are then moved to their own mean by means of the first moment: the formulas assume Σy = 0, which a
rounded mean does not give. Each chunk is summed by itself, and the sums of chunks by block, for long sums lose digits.

Source: the digits that other ways lose are in theory §7.
"""

from typing import NamedTuple

import numpy as np

from study.sphere.jit import CHUNK, Sums, compiled, fresh, put, zeros
from study.sphere.layouts import (
    BLOCK,
    Placed,
    PointSets,
    SampleBlock,
    Scratch,
    View,
    abreast,
    at,
    extent,
    near,
    readable,
    window,
)
from study.sphere.types import Floats


class _One(NamedTuple):
    """Moments of one set: n, x̄ (d,), Σyyᵀ (d, d), Σy|y|² (d,), Σ|y|⁴."""

    n: float
    mean: Floats
    second: Floats
    third: Floats
    fourth: float


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
    def of(cls, x: Floats | Placed) -> "Moments":
        """Compute the moments of point sets: an array (b, d, n) in any memory layout, or the draws they come from."""
        b, d, _ = extent(x)
        moments = cls(np.empty((2, b)), np.empty((2, b, d)), np.empty((b, d, d)))
        accumulate(readable(x), abreast(x), moments, zeros(d), zeros(d, d))
        return moments

    def merge(self, other: "Moments") -> "Moments":
        """Moments of the union of each set with the set at the same place of another batch, in any order.

        Means are stored rounded, to ε|x̄|: where that matters beside the points' extent, fit all points at once.
        """
        result = Moments(*(part.copy() for part in self))
        _merge_all(result, Moments(*(part.copy() for part in other)))
        result.numbers[0] += other.n
        return result

    def update(self, x: Floats) -> "Moments":
        """Moments after more samples (b, d, n)."""
        return self.merge(Moments.of(x))

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

    @property
    def third_central(self) -> Floats:
        """Third central vector moment S, paper eq. 6: (b, d)."""
        return self.third / (self.n - 1.0)[:, None]


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
def accumulate(x: PointSets, group: int, moments: Moments, zero: Sums, square: Sums) -> None:
    """Write the moments of each point set of a batch (b, d, n); ``group`` sets share their draws, see `abreast`.

    ``zero`` and ``square`` are d and d² sums at zero.
    """
    b, d, n = extent(x)
    scratch = Scratch(np.empty((1, d, CHUNK)), zero, square)
    first, delta = np.empty((group, d)), np.empty(d)
    mean, third, second = moments.vectors[0], moments.vectors[1], moments.second
    count, fourth = moments.numbers[0], moments.numbers[1]
    for head in range(0, b, group):
        for g in range(group):
            t = head + g
            point, count[t], fourth[t] = near(x, t, n, scratch.rows, zero), float(n), 0.0
            for i in range(d):
                mean[t, i], first[g, i], third[t, i] = point[i], 0.0, 0.0
                for j in range(i + 1):
                    second[t, i, j] = 0.0
        for start in range(0, n, BLOCK):
            for g in range(group):
                _add(SampleBlock(x, head + g, start, min(BLOCK, n - start)), moments, first[g], scratch)
        for g in range(group):
            t = head + g
            for i in range(d):
                delta[i] = first[g, i] / n
                for j in range(i):
                    second[t, j, i] = second[t, i, j]
            fourth[t] = shift(float(n), delta, first[g], second[t], third[t], fourth[t])
            for i in range(d):
                mean[t, i] += delta[i]


@compiled
def _merge(one: _One, two: _One, work: Floats) -> float:
    """Merge the second set into the first, in place, but for n; the second is destroyed, the fourth moment returned."""
    n, mean, second, third, fourth = one
    n2, mean2, second2, third2, fourth2 = two
    d = mean.size
    delta, first = work[0], work[1]
    share = n2 / (n + n2)
    for i in range(d):
        delta[i] = share * (mean2[i] - mean[i])
        first[i] = 0.0
    fourth = shift(n, delta, first, second, third, fourth)
    for i in range(d):
        mean[i] += delta[i]
        delta[i] = mean[i] - mean2[i]
        first[i] = 0.0
    fourth += shift(n2, delta, first, second2, third2, fourth2)
    for i in range(d):
        third[i] += third2[i]
        for j in range(d):
            second[i, j] += second2[i, j]
    return fourth


@compiled
def _set(moments: Moments, t: int) -> _One:
    numbers, vectors, second = moments
    return _One(numbers[0, t], vectors[0, t], second[t], vectors[1, t], numbers[1, t])


@compiled
def _merge_all(one: Moments, two: Moments) -> None:
    """Merge each set of the second batch into that of the first, but for n; the second batch is destroyed."""
    b, d, _ = one.second.shape
    work = np.empty((2, d))
    for t in range(b):
        one.numbers[1, t] = _merge(_set(one, t), _set(two, t), work)
