"""Centred moments against exact rational arithmetic, and the exactness of merging."""

from fractions import Fraction

import numpy as np
import pytest

from study.sphere.layouts import BLOCK
from study.sphere.moments import Moments

EPS = np.finfo(float).eps
SIZES = [1, 2, 5, 511, 512, 513, 1024, 1025]


def exact(points):
    """Mean, Σyyᵀ, Σy|y|² and Σ|y|⁴ of points (n, d), in fractions; the scales that rounding is measured against."""
    x = [[Fraction(float(v)) for v in point] for point in points]
    n, d = len(x), len(x[0])
    mean = [sum(p[i] for p in x) / n for i in range(d)]
    y = [[p[i] - mean[i] for i in range(d)] for p in x]
    square = [sum(v * v for v in p) for p in y]
    second = [[sum(p[i] * p[j] for p in y) for j in range(d)] for i in range(d)]
    third = [sum(p[i] * s for p, s in zip(y, square, strict=True)) for i in range(d)]
    as_float = [np.array(v, dtype=float) for v in (mean, second, third, sum(s * s for s in square))]
    size = np.sqrt(np.array(square, dtype=float))
    return as_float, [np.abs(points).max(), np.sum(size**2), np.sum(size**3), np.sum(size**4)]


def assert_exact(got, points, relative):
    """Each moment agrees with exact arithmetic, relative to the sum of its terms' magnitudes."""
    for value, (true, scale) in zip(got, zip(*exact(points), strict=True), strict=True):
        np.testing.assert_allclose(value, true, rtol=0, atol=relative * scale)


def parts(moments, t=0):
    """The moments of one set, without its number of samples."""
    return moments.mean[t], moments.second[t], moments.third[t], moments.fourth[t]


def of(points):
    """Moments of one point set (n, d)."""
    return Moments.of(np.ascontiguousarray(points.T)[None])


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("d", [2, 3, 5])
def test_against_exact_arithmetic(rng, n, d):
    """Moments are right to 1e-14 of the sum of their terms, on both sides of every chunk boundary."""
    points = rng.standard_normal((n, d)) * np.arange(1, d + 1) + rng.standard_normal(d)
    assert_exact(parts(of(points)), points, 1e-14)


@pytest.mark.parametrize("offset", [1e6, 1e9])
@pytest.mark.parametrize("n", [7, 512, 600, 2000, BLOCK + 100])
def test_far_origin(rng, offset, n):
    """An origin 10⁶ or 10⁹ spreads away costs no digits, whatever the number of samples."""
    points = rng.standard_normal((n, 3)) + offset * np.array([1.0, -0.7, 0.3])
    assert_exact(parts(of(points)), points, 1e-14)


@pytest.mark.parametrize("order", ["as they come", "by height", "by a side", "around"])
def test_order_of_samples(rng, order):
    """Whatever the order, the variance along the axis of a flat cap, 2.5e-9 of that across it, keeps 13 digits.

    If blocks were merged by their means, which are rounded, it would be wrong by 1e-9 to 5e-7.
    """
    n, height = BLOCK + 5000, 1.0 - np.cos(np.radians(0.01))
    heights, turns = height * rng.random(n), 2.0 * np.pi * rng.random(n)
    across = np.sqrt(heights * (2.0 - heights))
    points = np.column_stack([1.0 - heights, across * np.cos(turns), across * np.sin(turns)]) + 100.0
    keys = {"by height": points[:, 0], "by a side": points[:, 1], "around": turns}
    points = points[np.argsort(keys.get(order, np.arange(n)))]
    axial = [Fraction(v) for v in points[:, 0].tolist()]
    mean = sum(axial) / n
    expected = float(sum((v - mean) ** 2 for v in axial))
    np.testing.assert_allclose(of(points).second[0, 0, 0], expected, rtol=1e-13)


@pytest.mark.parametrize("value", [0.3, 0.7, 1 / 3, 0.77])
def test_rounding_does_not_add_up(value):
    """8192 terms of one size, whose rounding errors may all have one sign, lose no more than 64 of them.

    Added to one sum they would lose 8192, in four lanes 2048; chunks are summed by themselves.
    """
    points = np.full((8192, 3), value)
    points[1::2] *= -1.0
    term = 3 * Fraction(value) ** 2
    _, second, _, fourth = parts(of(points))
    np.testing.assert_allclose(np.trace(second), float(8192 * term), rtol=64 * EPS)
    np.testing.assert_allclose(fourth, float(8192 * term**2), rtol=64 * EPS)


@pytest.mark.parametrize("n", [5, 513, 1025])
@pytest.mark.parametrize("apart", [0.0, 1.0, 100.0])
def test_merge_equals_the_whole(rng, n, apart):
    """Two parts of any sizes, near or far from each other, merge into the moments of the whole, and stay unchanged."""
    for cut in {1, n - 1, *rng.integers(1, n, 3).tolist()}:
        points = rng.standard_normal((n, 3)) + 3.0
        points[cut:] += apart
        one, two = of(points[:cut]), of(points[cut:])
        before = [part.copy() for part in (*one, *two)]
        merged = one.merge(two)
        assert merged.n[0] == n
        assert_exact(parts(merged), points, 1e-14)
        for part, copy in zip((*one, *two), before, strict=True):
            np.testing.assert_array_equal(part, copy)


@pytest.mark.parametrize("n", [6, 700])
def test_any_memory_layout(rng, n):
    """Coordinates first, samples first, strided and read-only arrays give equal results, to rounding."""
    x = rng.standard_normal((4, 3, n))
    frozen = x.copy()
    frozen.flags.writeable = False
    views = [
        np.ascontiguousarray(x.swapaxes(1, 2)).swapaxes(1, 2),
        np.asfortranarray(x),
        np.repeat(x, 2, axis=2)[:, :, ::2],
        x[::-1][::-1],
        frozen,
    ]
    expected = Moments.of(x)
    for view in views:
        got = Moments.of(view)
        for part, whole in zip(got, expected, strict=True):
            np.testing.assert_allclose(part, whole, rtol=0, atol=1e-14 * 9 * n)


def test_sets_of_a_batch_do_not_mix(rng):
    """A set's moments are, bit for bit, the same alone and in a batch."""
    x = rng.standard_normal((5, 3, 520))
    together = Moments.of(x)
    for t in range(5):
        alone = Moments.of(x[t : t + 1])
        for part, whole in zip(parts(alone), parts(together, t), strict=True):
            np.testing.assert_array_equal(part, whole)


def test_normalised_as_in_the_paper(rng):
    """C is NumPy's unbiased covariance (eq. 5), and S carries the same 1/(n - 1) (eq. 6)."""
    points = rng.standard_normal((9, 3))
    moments, y = of(points), points - points.mean(axis=0)
    np.testing.assert_allclose(moments.covariance[0], np.cov(points.T), rtol=0, atol=1e-14)
    np.testing.assert_allclose(moments.third_central[0], (y * np.sum(y**2, axis=1)[:, None]).sum(0) / 8, atol=1e-14)
