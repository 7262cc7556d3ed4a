"""Joint moments against the points themselves, and against arithmetic of 60 digits.

Centred moments against exact rational arithmetic.
"""

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from study.fits import ESTIMATORS, Samples
from study.fits.cap import draw
from study.fits.jit import BLOCK
from study.fits.moments import JointMoments, Moments
from study.fits.random import WORDS, seeded

CLOSED = ["gdke", "ugdk", "als", "taubin", "pratt", "hyper"]

EPS = 2.0**-52


def drawn(rng, trials, n, angle, d=3):
    """Directions with heights in place of their first component, and noise of unit size, (trials, d, n) each."""
    directions, noise = np.empty((trials, d, n)), np.empty((trials, d, n))
    draw(seeded(rng.integers(0, 2**64, WORDS, dtype=np.uint64)), math.radians(angle), directions, noise)
    return directions, noise


def errors(name, directions, noise, sigma, radius):
    """Errors (b, d + 1) of centre and radius, by joint moments."""
    joint = JointMoments.of(directions, noise).regression(np.array([sigma]), np.array([radius]))
    fit = ESTIMATORS[name](Samples.of_regression(joint, sigma))
    return np.concatenate([fit.center, fit.radius[:, None]], axis=1)


@pytest.mark.parametrize("name", CLOSED)
@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("angle", [20.0, 90.0, 180.0])
def test_both_routes_agree(name, d, angle):
    """Fits of joint moments and of points agree from σ/r = 1e-6 to 0.1, to 1e-9 of the error and rounding, ε r / φ²."""
    directions, noise = drawn(np.random.default_rng(7), 50, 60, angle, d)
    u = directions.copy()
    u[:, 0] = 1.0 - u[:, 0]
    for sigma in (1e-6, 1e-4, 1e-2, 0.1):
        radius = 2.0
        fit = ESTIMATORS[name](Samples(radius * u + radius * sigma * noise, radius * sigma))
        direct = np.concatenate([fit.center, fit.radius[:, None] - radius], axis=1)
        joint = errors(name, directions, noise, radius * sigma, radius)
        size = np.linalg.norm(joint, axis=1)
        floor = 30.0 * EPS * radius / math.radians(min(angle, 90.0)) ** 2
        apart = np.linalg.norm(direct - joint, axis=1)
        regular = np.isfinite(size) & np.isfinite(apart)
        assert regular.mean() > 0.9
        # an error far beyond the radius comes from a nearly singular matrix, and is as uncertain either way
        tame = regular & (size < radius)
        assert np.all(apart[tame] < 1e-9 * size[tame] + floor), (apart[tame] / (1e-9 * size[tame] + floor)).max()


def exact(directions, noise, sigma, radius, eta):
    """ĉ - c = ½ (C - ηI)⁻¹ s of one set, in sixty digits; C and s in weights of 1/(n-1)."""
    with mpmath.workdps(60):
        d, n = directions.shape
        u = [[mpmath.mpf(float(v)) for v in row] for row in directions]
        u[0] = [1 - t for t in u[0]]
        # the directions have unit length to a rounding only; make it so by their height, which is what was drawn
        for k in range(n):
            across = mpmath.sqrt(sum(u[i][k] ** 2 for i in range(1, d)))
            scale = mpmath.sqrt(1 - u[0][k] ** 2) / across
            for i in range(1, d):
                u[i][k] *= scale
        x = [[radius * u[i][k] + sigma * mpmath.mpf(float(noise[i, k])) for k in range(n)] for i in range(d)]
        mean = [mpmath.fsum(row) / n for row in x]
        y = [[v - mean[i] for v in x[i]] for i in range(d)]
        square = [sum(y[i][k] ** 2 for i in range(d)) for k in range(n)]
        c, s = mpmath.matrix(d), mpmath.matrix(d, 1)
        for i in range(d):
            s[i] = mpmath.fsum(y[i][k] * square[k] for k in range(n)) / (n - 1)
            for j in range(d):
                c[i, j] = mpmath.fsum(y[i][k] * y[j][k] for k in range(n)) / (n - 1) - (eta if i == j else 0)
        offset = mpmath.lu_solve(c, s / 2)
        return [float(mean[i] + offset[i]) for i in range(d)]


@pytest.mark.parametrize("angle", [1.0, 5.0, 90.0])
def test_sixty_digits_at_the_smallest_noise(angle):
    """At σ/r = 1e-13, where points show rounding alone, GDKE's and UGDK's errors have ten digits."""
    directions, noise = drawn(np.random.default_rng(11), 4, 200, angle)
    for name, eta in (("gdke", 0.0), ("ugdk", 1e-26)):
        found = errors(name, directions, noise, 1e-13, 1.0)
        for t in range(len(found)):
            true = np.array(exact(directions[t], noise[t], mpmath.mpf(1e-13), 1, mpmath.mpf(eta)))
            assert np.linalg.norm(found[t, :3] - true) < 1e-10 * np.linalg.norm(true)


SIZES = [1, 2, 5, 511, 512, 513, 1024, 1025]


def in_fractions(points):
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
    for value, (true, scale) in zip(got, zip(*in_fractions(points), strict=True), strict=True):
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
