"""Circles in space: they are named, fitted with errors, and their intervals are open along the axis."""

import math

import numpy as np
import pytest
from scipy.stats import binom

import study
from study import Status


def arcs(rng, sets, n, reach, width=0.0, sigma=0.01):
    """Points (sets, n, 3) of arcs of ± reach degrees on great circles about z, or of belts about them."""
    a, b = (np.radians(rng.uniform(-half, half, (sets, n))) for half in (reach, width))
    u = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=-1)
    return u + sigma * rng.normal(size=u.shape)


@pytest.mark.parametrize(("reach", "width"), [(45.0, 0.0), (180.0, 0.0), (90.0, 3.0)])
@pytest.mark.parametrize("n", [30, 300])
def test_circles_are_named(reach, width, n):
    """At least .98 of 400 sets are a hinge, and no more than that is bounded; false alarms 1e-4."""
    fit = study.fit(arcs(np.random.default_rng(n), 400, n, reach, width))
    assert (fit.status == Status.HINGE).sum() >= binom.ppf(1e-4, 400, 0.98)
    assert np.isfinite(fit.interval("radius")[:, 1]).mean() <= 0.05
    assert (fit.interval("radius")[:, 0] <= 1.0).mean() >= 0.95
    named = fit.status == Status.HINGE
    assert np.isinf(fit.interval("center")[named]).all()


@pytest.mark.parametrize("estimator", ["mle", "als", "gdke", "robust", "hinge"])
def test_every_estimator_says_so(estimator):
    fit = study.fit(arcs(np.random.default_rng(1), 20, 60, 120.0), estimator)
    assert (fit.status == Status.HINGE).mean() >= 0.95


@pytest.mark.parametrize("degrees", [20.0, 60.0, 180.0])
@pytest.mark.parametrize("sigma", [0.002, 0.03])
def test_caps_are_no_circles(on_cap, degrees, sigma):
    """Of 1000 caps at most as many are named as a share of .5 % gives in all but 1e-4 of runs."""
    fit = study.fit(on_cap(np.random.default_rng(2), 40, degrees, noise=sigma, sets=1000)[0])
    assert (fit.status == Status.HINGE).sum() <= binom.isf(1e-4, 1000, 0.005)


def test_errors_of_the_circle():
    """Centre, radius and axis scatter as their errors say: standardised errors of 500 arcs have a size of 1 to 12 %."""
    rng = np.random.default_rng(3)
    fit = study.fit(arcs(rng, 500, 80, 70.0))
    circle = fit.circle
    for error in ((circle.center / circle.center_errors).T, (circle.radius - 1.0) / circle.radius_error):
        assert np.sqrt(np.mean(error**2, axis=-1)) == pytest.approx(1.0, abs=0.12)
    tilt = np.arccos(np.minimum(np.abs(circle.axis[:, 2]), 1.0))
    assert np.sqrt(np.mean((tilt / circle.axis_error) ** 2)) == pytest.approx(1.0, abs=0.12)  # the other tilt is small


def test_a_circle_of_latitude_and_any_frame():
    """A small circle of a sphere is a circle as well; turned, moved and scaled it is the same one."""
    rng = np.random.default_rng(4)
    angle = rng.uniform(0.0, 2.0 * math.pi, 100)
    ring = np.column_stack([0.8 * np.cos(angle), 0.8 * np.sin(angle), np.full(100, 0.6)])
    points = ring + 0.005 * rng.normal(size=ring.shape)
    turn, shift = np.linalg.qr(rng.normal(size=(3, 3)))[0], np.array([3.0, -2.0, 5.0])
    fit, moved, huge = study.fit(points), study.fit(points @ turn.T + shift), study.fit(1e60 * points)
    for other in (fit, moved, huge):
        assert other.status == Status.HINGE
    np.testing.assert_allclose(moved.circle.center, fit.circle.center @ turn.T + shift, atol=1e-9)
    np.testing.assert_allclose(np.abs(moved.circle.axis @ turn @ fit.circle.axis), 1.0, atol=1e-9)
    np.testing.assert_allclose(huge.circle.radius, 1e60 * fit.circle.radius, rtol=1e-9)
    np.testing.assert_allclose(fit.circle.radius, 0.8, atol=5.0 * float(fit.circle.radius_error))


def test_other_dimensions_have_no_circle_in_space():
    u = np.random.default_rng(5).normal(size=(40, 2))
    assert np.isnan(study.fit(u).circle.radius)
    assert study.fit(u).circle.center.shape == (3,)
