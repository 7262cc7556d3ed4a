"""Expectations from theory on a cap, against closed forms, drawn Gaussians and each other."""

import math

import numpy as np
import pytest
from scipy import stats

import study
from study.fits.points.cap import cap_moments
from study.simulation.analysis import theory


def test_gdke_bias():
    """m₁σ²/(Kₐ + σ²) for isotropic noise; for a covariance the matrix formula, whichever way it is solved."""
    moments = cap_moments(math.radians(60.0), 3)
    np.testing.assert_allclose(theory.gdke_bias(0.02, moments, np.eye(3)), 0.75 * 4e-4 / (1 / 48 + 4e-4))
    shape = np.array([[1.0, 0.3, 0.0], [0.3, 2.0, 0.0], [0.0, 0.0, 0.5]])
    extent = np.diag([moments.along, moments.across, moments.across])
    told = np.linalg.inv(extent + 0.01 * shape) @ (0.01 * shape) @ [moments.mean, 0.0, 0.0]
    np.testing.assert_allclose(theory.gdke_bias(0.1, moments, shape), np.linalg.norm(told))


def test_median_at_bound():
    """On the whole sphere the length is χ₃/√3; on a cap it agrees with drawn Gaussians."""
    whole = math.sqrt(stats.chi2.median(3) / 3)
    np.testing.assert_allclose(theory.median_at_bound(cap_moments(math.pi, 3), 3), whole, rtol=1e-6)
    for dimension in (2, 3):
        moments = cap_moments(math.radians(40.0), dimension)
        variance = 1.0 / np.array([moments.along] + [moments.across] * (dimension - 1))
        drawn = np.random.default_rng(5).normal(size=(400_000, dimension)) * np.sqrt(variance / variance.sum())
        median = np.median(np.linalg.norm(drawn, axis=1))
        np.testing.assert_allclose(median, theory.median_at_bound(moments, dimension), rtol=0.01)


@pytest.mark.parametrize("noise", [1e-320, 1e-200, 1e-65, 1e-3, 1e155, 1e308])
@pytest.mark.parametrize("angle", [1e-300, 1e-100, 1e-10, 45.0, 180.0])
def test_medians_at_the_ends_of_float64(angle, noise):
    """Whatever a config may ask for, a median is a number or NaN; with next to no noise it is that of the bound."""
    at_bound = theory.median_at_bound(cap_moments(math.radians(angle), 3), 3)
    found = theory.median_attainable(angle, noise, 3)
    assert math.isnan(at_bound) == (angle < 1e-90)
    assert math.isnan(found) == (angle < 1e-90 or noise > 1e3 * math.radians(angle))
    if noise < 1e-6 * math.radians(angle):
        np.testing.assert_equal(found, at_bound)


@pytest.mark.parametrize("degrees", [20.0, 60.0])
def test_gdke_leaves_where_bias_meets_scatter(degrees):
    """At s* the bias of many samples is the bound's standard deviation along the axis, σ/√(N Kₐ)."""
    moments = cap_moments(math.radians(degrees), 3)
    noise = theory.gdke_leaves(10**8, moments)
    scatter = noise / math.sqrt(10**8 * moments.along)
    assert theory.gdke_bias(noise, moments, np.eye(3)) == pytest.approx(scatter, rel=1e-4)


def test_gdke_never_leaves_on_the_whole_sphere():
    """GDKE has no bias there; the mean of the directions is zero up to rounding."""
    for dimension in (2, 3, 4):
        assert theory.gdke_leaves(10**6, cap_moments(math.pi, dimension)) == math.inf


def test_where_ugdk_leaves_and_fails():
    """With v = Kₐ = (1 - cos φ)²/12: σ² = v/2; κ = (v/σ²)√(N/2), and the noise of a κ has it."""
    along = (1.0 - math.cos(0.7)) ** 2 / 12.0
    moments = cap_moments(0.7, 3)
    assert theory.ugdk_leaves(moments) ** 2 == pytest.approx(along / 2.0, rel=1e-12)
    assert theory.kappa(0.05, 1000, moments) == pytest.approx(along / 0.05**2 * math.sqrt(500.0), rel=1e-12)
    assert theory.kappa(theory.noise_at_kappa(3.0, 1000, moments), 1000, moments) == pytest.approx(3.0, rel=1e-12)


def test_ugdk_variance():
    """1 + 7.5 σ²/r² on the whole sphere, where Kₐ = ⅓ and m₁ = 0; 1 + 96 σ²/(r²φ⁴) on small caps, Kₐ → φ⁴/48."""
    assert theory.ugdk_variance(0.1, cap_moments(math.pi, 3), 3) == pytest.approx(1.0 + 0.01 * 7.5, rel=1e-12)
    assert theory.ugdk_variance(1e-4, cap_moments(0.01, 3), 3) == pytest.approx(1.0 + 96.0, rel=1e-3)


@pytest.mark.parametrize("degrees", [5.0, 60.0, 180.0])
def test_bound_shares(degrees):
    """They are as 12/(1 - cos φ)² to 6/[(1 - cos φ)(2 + cos φ)] (theory 3.3), and whole."""
    c = math.cos(math.radians(degrees))
    along, across = theory.bound_shares(cap_moments(math.radians(degrees), 3), 3)
    assert along + 2.0 * across == pytest.approx(1.0, rel=1e-12)
    assert along / across == pytest.approx(12.0 / (1 - c) ** 2 / (6.0 / ((1 - c) * (2 + c))), rel=1e-9)


@pytest.mark.parametrize(("dimension", "degrees", "noise"), [(3, 45.0, 0.3), (3, 180.0, 0.2), (2, 45.0, 0.1)])
def test_median_attainable(dimension, degrees, noise):
    """The median is that of drawn Gaussians with the attainable covariance, over the Cramér-Rao bound's root trace."""
    moments = cap_moments(math.radians(degrees), dimension)
    bound = study.attainable_bound(degrees, noise, dimension)[:-1, :-1]
    drawn = np.random.default_rng(5).normal(size=(400_000, dimension)) * np.sqrt(np.diag(bound))
    unit = noise * math.sqrt(1.0 / moments.along + (dimension - 1) / moments.across)
    expected = np.median(np.linalg.norm(drawn, axis=1)) / unit
    np.testing.assert_allclose(theory.median_attainable(degrees, noise, dimension), expected, rtol=0.01)
