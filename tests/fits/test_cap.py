"""Directions on a cap: within the angle, uniform by area, exact at tiny angles.

Heights in four dimensions and more against mpmath: relative accuracy at any angle and any share of the area.
"""

import math

import mpmath
import numpy as np
import pytest
from scipy import stats

from study.fits.cap import cap_moments, draw, heights, sample_cap
from study.fits.random import lanes

EPS = np.finfo(float).eps

DIMENSIONS = [2, 3, 4, 7]


@pytest.mark.parametrize("d", [*DIMENSIONS, 12])
@pytest.mark.parametrize("angle", [1e-7, 1e-3, 20.0, 90.0, 150.0, 180.0])
def test_unit_vectors_within_the_angle(rng, angle, d):
    """Every direction has norm 1 to rounding and lies within the angle of the first axis."""
    phi = math.radians(angle)
    u = sample_cap(rng, 2000, phi, d)
    assert u.shape == (2000, d)
    assert np.abs(np.linalg.norm(u, axis=1) - 1).max() < 8 * EPS
    across = np.linalg.norm(u[:, 1:], axis=1)
    assert np.all(np.arctan2(across, u[:, 0]) <= phi * (1 + 8 * EPS))


@pytest.mark.parametrize("d", DIMENSIONS)
def test_isotropic_across_the_axis(rng, assert_mean, d):
    """Across the axis the mean is zero and the covariance a multiple of 1, whatever the height.

    4.5 standard errors in at most 34 components: false alarms below 3e-4.
    """
    u = sample_cap(rng, 20_000, 1.2, d)
    across = u[:, 1:] / np.linalg.norm(u[:, 1:], axis=1, keepdims=True)
    assert_mean(across, 0.0)
    assert_mean(across * (u[:, :1] - u[:, :1].mean()), 0.0)
    if d > 2:
        i, j = np.tril_indices(d - 1, -1)
        assert_mean(across[:, i] * across[:, j], 0.0)
        assert_mean(across[:, :-1] ** 2, 1 / (d - 1))
    if d == 3:
        assert stats.kstest(np.arctan2(across[:, 1], across[:, 0]) / (2 * np.pi) + 0.5, "uniform").pvalue > 1e-6


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("phi", [1e-6, 1e-3, 1.0, math.pi])
def test_heights_against_mpmath(rng, d, phi):
    """Heights keep their relative accuracy at any angle: 4 rounding errors in two and three dimensions."""
    uniform = rng.random(20)
    t = heights(uniform.copy(), phi, d)
    with mpmath.workdps(60):
        angle = mpmath.mpf(phi)
        top = mpmath.sin(angle / 2) ** 2
        for value, share in zip(t.tolist(), uniform.tolist(), strict=True):
            exact = 1 - mpmath.cos(angle * share) if d == 2 else 2 * top * share
            assert abs(value - exact) <= 4 * EPS * exact


@pytest.mark.parametrize("d", DIMENSIONS)
def test_heights_at_the_ends(d):
    """The ends of the unit interval give finite heights from 0 to 2 on the whole sphere."""
    t = heights(np.array([0.0, 0.5, np.nextafter(1.0, 0.0)]), math.pi, d)
    assert t[0] == 0.0
    assert t[1] == pytest.approx(1.0, abs=1e-14)
    assert 2.0 - 1e-3 < t[2] <= 2.0


@pytest.mark.parametrize("axis", [[1, 0, 0], [-1, 0, 0], [0, 0, 1], [1e-9, 1, 0], [-3e5, 2e5, 1e5], [1e-5, -1e-6, 0]])
def test_axis(axis):
    """An axis of any direction and length rotates the cap as a whole: heights and mutual angles stay."""
    plain = sample_cap(np.random.default_rng(7), 200, 0.7, 3)
    rotated = sample_cap(np.random.default_rng(7), 200, 0.7, 3, axis)
    pole = np.array(axis, dtype=float) / np.linalg.norm(axis)
    np.testing.assert_allclose(rotated @ pole, plain[:, 0], rtol=0, atol=8 * EPS)
    np.testing.assert_allclose(rotated @ rotated.T, plain @ plain.T, rtol=0, atol=16 * EPS)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        *(([angle], "half_angle") for angle in (0.0, -1.0, np.nan, np.inf, 3.2)),
        ([1.0, 1], "dimension"),
        *(([1.0, 3, axis], "axis") for axis in ([1.0, 0.0], [0.0] * 3, [np.nan, 0.0, 1.0], [np.inf, 0.0, 1.0], 1.0)),
    ],
)
def test_bad_input(rng, arguments, name):
    """An angle outside (0, π], one dimension, an axis of the wrong shape, zero or not finite are named in the error."""
    with pytest.raises(ValueError, match=name):
        sample_cap(rng, 5, *arguments)


@pytest.mark.parametrize("dimension", [2, 3, 5])
@pytest.mark.parametrize("degrees", [20.0, 60.0, 180.0])
def test_cap_moments_agree_with_drawn_directions(dimension, degrees):
    """Quadrature agrees with the mean and variance of a sample of directions."""
    u = sample_cap(np.random.default_rng(4), 200_000, math.radians(degrees), dimension)
    moments = cap_moments(math.radians(degrees), dimension)
    assert abs(u[:, 0].mean() - moments.mean) < 5 * math.sqrt(moments.along / len(u))
    np.testing.assert_allclose(u[:, 0].var(), moments.along, rtol=0.02)
    np.testing.assert_allclose(u[:, 1].var(), moments.across, rtol=0.02)


def test_cap_moments_in_closed_form():
    """Archimedes: on a sphere u₁ is uniform; and the small angle keeps its digits (Kₐ → φ⁴/48)."""
    phi = math.radians(60.0)
    m1, m2 = (1 + math.cos(phi)) / 2, (1 + math.cos(phi) + math.cos(phi) ** 2) / 3
    np.testing.assert_allclose(cap_moments(phi, 3), [m1, m2 - m1**2, (1 - m2) / 2], rtol=1e-12)
    np.testing.assert_allclose(cap_moments(1e-6, 3).along, 1e-24 / 48, rtol=1e-9)
    # on a small cap θ²/φ² has the mean (d - 1)/(d + 1), d - 1 of it across; sin θ to the power 148 is below float64
    np.testing.assert_allclose(cap_moments(1e-3, 150).across, 1e-6 / 151, rtol=1e-5)


ANGLES_CAP_QUANTILE = [1e-6, 1e-3, 0.7, math.pi / 2, 1.8, 2.6, 3.0, 3.13, math.pi - 1e-6, math.pi]

SMALL = 10.0 ** -np.arange(1.0, 13.0)

SHARES = np.concatenate([SMALL, [0.3, 0.5, 0.77], 1.0 - SMALL, [1.0 - EPS / 2, 1.0]])


def area(height, d):
    """The area of a cap of a height 0 ≤ t ≤ 2, up to a factor: the incomplete beta function of t/2."""
    a = mpmath.mpf(d - 1) / 2
    return mpmath.betainc(a, a, 0, min(height / 2, mpmath.mpf(1)))


@pytest.mark.parametrize("d", [4, 5, 6, 7, 8, 9, 10, 20, 50])
def test_relative_accuracy(d):
    """A height is right to 2e-13: the area below one that is less by that is too small, below one more too large."""
    for angle in ANGLES_CAP_QUANTILE:
        found = heights(SHARES.copy(), angle, d)
        with mpmath.workdps(60):
            whole = area(2 * mpmath.sin(mpmath.mpf(angle) / 2) ** 2, d)
            for t, share in zip(found.tolist(), SHARES.tolist(), strict=True):
                below, above = (area(mpmath.mpf(t) * (1 + side * mpmath.mpf("2e-13")), d) for side in (-1, 1))
                assert below <= share * whole <= above, (angle, share)


def test_the_smallest_caps_are_flat():
    """In 50 dimensions, where the area of a cap of 1e-7 rad is no number, heights go like w^(2/49) up to its edge."""
    t = heights(np.array([0.0, 1e-3, 0.5, 1.0]), 1e-7, 50)
    np.testing.assert_allclose(t, 0.5e-14 * np.array([0.0, 1e-3, 0.5, 1.0]) ** (2 / 49), rtol=1e-12)


@pytest.mark.parametrize("d", [4, 11])
def test_smallest_shares(d):
    """A share of zero has height zero, and the smallest shares follow t ∝ w^(2/(d-1))."""
    t = heights(np.array([0.0, 1e-300, 1e-290]), 2.0, d)
    assert t[0] == 0.0
    np.testing.assert_allclose(t[2] / t[1], 10.0 ** (20 / (d - 1)), rtol=16 * EPS)


def test_in_place_in_any_layout(rng):
    """Strided numbers become the same heights as contiguous ones."""
    uniform = rng.random((3, 4, 700))
    flat, strided = uniform[:, 1].flatten(), uniform[:, 1]
    assert heights(strided, 2.0, 4) is strided
    np.testing.assert_allclose(uniform[:, 1].ravel(), heights(flat, 2.0, 4), rtol=4 * EPS)


@pytest.mark.parametrize("d", [2, 4, 5, 7])
@pytest.mark.parametrize("angle", [1e-6, 1.0, 3.0])
def test_draws_have_the_heights_of_their_uniform_numbers(angle, d):
    """In three dimensions, on the whole sphere, the first row of a draw is twice its uniform numbers."""
    (plain, z), (directions, y) = np.empty((2, 1, 3, 200)), np.empty((2, 1, d, 200))
    draw(lanes(1, "heights"), math.pi, plain, z)
    draw(lanes(1, "heights"), angle, directions, y)
    np.testing.assert_allclose(directions[0, 0], heights(plain[0, 0] / 2, angle, d), rtol=8 * EPS)
