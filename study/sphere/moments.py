"""Centred moments of a point set: all that a closed-form sphere fit needs to know about its data.

With y = x - x̄ they are n, x̄, Σyyᵀ, Σy|y|² and Σ|y|⁴ - 14 numbers in three dimensions - and two sets of them merge,
whatever the number of samples behind each, exactly but for the rounding of their means.

The samples are taken from the mean of the first few, and their sums then moved to their own mean by what their first
moment says (theory: the formulas assume Σy = 0, which a rounded mean does not give). So the data are read once, and a
distant origin costs no digits. Each chunk is summed by itself, then blocks of chunks are, for long sums lose digits.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from study.sphere.jit import CHUNK, compiled, fresh, put, zeros
from study.sphere.layouts import BLOCK, Placed, abreast, at, extent, near, readable, window
from study.sphere.types import Floats


@compiled
def shift(count: float, delta: Any, first: Any, second: Any, third: Any, fourth: float) -> float:
    """Move the origin of raw moments by ``delta``, in place; the fourth moment is returned.

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
    fourth += 4.0 * quadratic - 4.0 * along_third + square * (2.0 * trace - 4.0 * along_first + count * square)
    for i in range(d):
        product = 0.0
        for j in range(d):
            product += second[i, j] * delta[j]
        third[i] += square * first[i] - 2.0 * product - delta[i] * (trace - 2.0 * along_first + count * square)
    for i in range(d):
        for j in range(d):
            second[i, j] += count * delta[i] * delta[j] - first[i] * delta[j] - delta[i] * first[j]
    for i in range(d):
        first[i] -= count * delta[i]
    return fourth


@compiled
def merge_into(
    count: float, mean: Any, second: Any, third: Any, fourth: float,
    count2: float, mean2: Any, second2: Any, third2: Any, fourth2: float, work: Any,
) -> float:  # fmt: skip
    """Merge a second centred set into the first, in place; the second is destroyed, the fourth moment returned."""
    d = mean.size
    delta, first = work[0], work[1]
    share = count2 / (count + count2)
    for i in range(d):
        delta[i] = share * (mean2[i] - mean[i])
        first[i] = 0.0
    fourth = shift(count, delta, first, second, third, fourth)
    for i in range(d):
        mean[i] += delta[i]
        delta[i] = mean[i] - mean2[i]
        first[i] = 0.0
    fourth += shift(count2, delta, first, second2, third2, fourth2)
    for i in range(d):
        third[i] += third2[i]
        for j in range(d):
            second[i, j] += second2[i, j]
    return fourth


@compiled
def _low(view: Any, m: int, origin: Any, first: Any, second: Any) -> Any:
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
def _high(view: Any, m: int, origin: Any, third: Any, fourth: float) -> Any:
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
def _add(
    x: Any, t: int, start: int, m: int, origin: Any, first: Any, second: Any, third: Any, fourth: float,
    rows: Any, zero: Any, square: Any,
) -> float:  # fmt: skip
    """Add the sums of m samples of a set, about ``origin``, to those given; the fourth is returned."""
    d = len(zero)
    here, one, two, three, four = fresh(zero), fresh(zero), fresh(square), fresh(zero), 0.0
    for i in range(d):
        here = put(here, i, origin[i])
    for a in range(start, start + m, CHUNK):
        count = min(CHUNK, start + m - a)
        view = window(x, t, a, count, rows, zero)
        some_one, some_two = _low(view, count, here, fresh(zero), fresh(square))
        some_three, some_four = _high(view, count, here, fresh(zero), 0.0)
        four += some_four
        for i in range(d):
            one, three = put(one, i, one[i] + some_one[i]), put(three, i, three[i] + some_three[i])
            for j in range(i + 1):
                two = put(two, i * d + j, two[i * d + j] + some_two[i * d + j])
    for i in range(d):
        first[i] += one[i]
        third[i] += three[i]
        for j in range(i + 1):
            second[i, j] += two[i * d + j]
    return fourth + four


@compiled
def accumulate(
    x: Any, group: int, mean: Any, second: Any, third: Any, fourth: Any, zero: Any, square: Any
) -> None:  # fmt: skip
    """Moments of each point set of a batch (b, d, n), written into the given arrays; ``group`` as `abreast` has it."""
    b, d, n = extent(x)
    rows, first, delta = np.empty((1, d, CHUNK)), np.empty((group, d)), np.empty(d)
    for head in range(0, b, group):
        for g in range(group):
            t = head + g
            point, fourth[t] = near(x, t, n, rows, zero), 0.0
            for i in range(d):
                mean[t, i], first[g, i], third[t, i] = point[i], 0.0, 0.0
                for j in range(i + 1):
                    second[t, i, j] = 0.0
        for start in range(0, n, BLOCK):
            m = min(BLOCK, n - start)
            for g in range(group):
                t = head + g
                fourth[t] = _add(
                    x, t, start, m, mean[t], first[g], second[t], third[t], fourth[t], rows, zero, square
                )  # fmt: skip
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
def _merge_all(
    count: Any, mean: Any, second: Any, third: Any, fourth: Any,
    count2: Any, mean2: Any, second2: Any, third2: Any, fourth2: Any,
) -> None:  # fmt: skip
    work = np.empty((2, mean.shape[1]))
    for t in range(count.size):
        fourth[t] = merge_into(
            count[t], mean[t], second[t], third[t], fourth[t],
            count2[t], mean2[t], second2[t], third2[t], fourth2[t], work,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Moments:
    """Centred moments of a batch of point sets.

    Attributes:
        count: number of samples of each set (b,).
        mean: x̄ (b, d), in the unit of the points.
        second: Σyyᵀ (b, d, d), unit squared.
        third: Σy|y|² (b, d), unit cubed.
        fourth: Σ|y|⁴ (b,), unit to the fourth.
    """

    count: Floats
    mean: Floats
    second: Floats
    third: Floats
    fourth: Floats

    @classmethod
    def of(cls, x: Floats | Placed) -> "Moments":
        """Moments of point sets given coordinates first, (b, d, n), in any memory layout, or by what forms them."""
        b, d, n = extent(x)
        m = cls(np.full(b, float(n)), np.empty((b, d)), np.empty((b, d, d)), np.empty((b, d)), np.empty(b))
        accumulate(readable(x), abreast(x), m.mean, m.second, m.third, m.fourth, zeros(d), zeros(d, d))
        return m

    def merge(self, other: "Moments") -> "Moments":
        """Moments of the union of each set with the other's set of equal place, in any order.

        Means are stored rounded, to ε|x̄|: where that shows beside the points' extent, fit them at once.
        """
        result = Moments(
            self.count + other.count, *(a.copy() for a in (self.mean, self.second, self.third, self.fourth))
        )
        taken = (other.second.copy(), other.third.copy())
        _merge_all(
            self.count, result.mean, result.second, result.third, result.fourth,
            other.count, other.mean, *taken, other.fourth,
        )  # fmt: skip
        return result

    def update(self, x: Floats) -> "Moments":
        """Moments after more samples (b, d, n)."""
        return self.merge(Moments.of(x))

    @property
    def covariance(self) -> Floats:
        """Sample covariance C, paper eq. 5: (b, d, d)."""
        return self.second / (self.count - 1.0)[:, None, None]

    @property
    def third_central(self) -> Floats:
        """Third central vector moment S, paper eq. 6: (b, d)."""
        return self.third / (self.count - 1.0)[:, None]
