"""Standard errors of corrected fits: those of the asymptotic covariance, which another route confirms."""

import numpy as np
import pytest

import study
from study.estimators.estimates import Estimates
from study.estimators.geometric.sandwich import corrected_covariance, sandwich
from study.estimators.samples import Samples
from study.sphere.regression import Regression

# Root of the trace of the centre's covariance over that of the Cramér-Rao bound, for ν = 0 and 1, from quadrature over
# the cap by another program; in two dimensions to four digits times the attainable bound's four.
TABLE = [
    (3, 20, 0.1, 1.830, 1.819),
    (3, 45, 0.1, 1.173, 1.178),
    (3, 45, 0.3, 2.839, 2.500),
    (3, 45, 0.6, 11.487, 8.870),
    (3, 90, 0.3, 1.407, 1.416),
    (3, 90, 0.6, 3.217, 2.824),
    (3, 180, 0.3, 1.187, 1.244),
    (2, 20, 0.1, 1.465 * 1.063, 1.465 * 1.060),
    (2, 45, 0.3, 1.991 * 1.232, 1.991 * 1.040),
    (2, 180, 0.6, 1.691 * 1.066, 1.691 * 1.046),
]


@pytest.fixture
def population(cap_moments):
    """Samples and estimates of one sample on a cap of the unit sphere whose moments are those of the law."""

    def make(d, angle, noise):
        mean, scatter = cap_moments(angle, d)
        vectors = np.stack([np.zeros((1, d)), mean[None], np.zeros((1, d))])
        regression = Regression(np.array([[1.0], [0], [0], [0]]), vectors, (scatter + noise**2 * np.eye(d))[None])
        one = np.ones(1)
        estimates = Estimates(np.zeros((1, d)), one, noise**2 * one, np.nan * one, np.zeros(1, int), np.zeros(1, int))
        return Samples.of_regression(regression), estimates, scatter

    return make


@pytest.mark.parametrize(("d", "angle", "noise", "lower", "upper"), TABLE)
def test_asymptotic_errors(population, d, angle, noise, lower, upper):
    """The covariance of a law's moments is the one that quadrature over its cap gives, to the table's digits."""
    samples, estimates, scatter = population(d, angle, noise)
    bound = noise**2 * np.trace(np.linalg.inv(scatter))
    for pair, expected in ((0.0, lower), (1.0, upper)):
        covariance = sandwich(samples, estimates, pair)[0]
        assert np.sqrt(np.trace(covariance[:d, :d]) / bound) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("noise", [1e-12, 1e-6, 1e-3])
def test_bound_as_noise_vanishes(population, cap_moments, noise):
    """Without noise to speak of the covariance is the Cramér-Rao bound (theory 3.1), up to a share of some σ²."""
    samples, estimates, _ = population(3, 60, noise)
    mean, scatter = cap_moments(60, 3)
    information = np.block([[scatter + np.outer(mean, mean), mean[:, None]], [mean[None], np.ones((1, 1))]])
    for pair in (0.0, 0.5, 1.0):
        covariance = sandwich(samples, estimates, pair)[0]
        np.testing.assert_allclose(covariance, noise**2 * np.linalg.inv(information), rtol=100 * noise**2 + 1e-9)


@pytest.mark.parametrize(("d", "angle", "noise"), [(2, 90.0, 0.3), (3, 60.0, 0.1), (4, 180.0, 0.5)])
@pytest.mark.parametrize("name", ["corrected", "corrected_01", "corrected_12"])
def test_scatter_of_fits(rng, on_cap, name, d, angle, noise):
    """Centres and radii scatter as the standard errors say.

    A standard deviation of 400 has an error of 3.5 %; 4.5 of these and 4 % for 500 samples, which are not infinitely
    many, are not exceeded but in 10⁻⁴ of seeds.
    """
    points = on_cap(rng, 500, angle, d, noise=2.0 * noise, radius=2.0, sets=400)[0]
    fit = study.fit(points, name)
    scatter = np.append(fit.center.std(axis=0), fit.radius.std())
    np.testing.assert_allclose(np.median(fit.standard_errors, axis=0), scatter, rtol=0.2)


def test_no_numbers_without_a_sphere(rng, on_cap):
    """Sets without a noise variance or without a sphere have NaN, others are not affected, and the unit is squared."""
    points = on_cap(rng, 50, 90.0, noise=0.05, sets=3)[0]
    points[1] = points[1, 0]
    samples = Samples(np.ascontiguousarray(points.swapaxes(1, 2)))
    estimates = study.ESTIMATORS["corrected"](samples)
    covariance = corrected_covariance(samples, estimates)
    assert np.isnan(covariance[1]).all()
    alone = study.fit(1000.0 * points[2], "corrected").covariance
    np.testing.assert_allclose(alone, 1e6 * covariance[2], rtol=1e-6)
    assert np.isnan(study.fit(points[0, :4], "corrected").covariance).all()
    np.testing.assert_allclose(covariance, covariance.swapaxes(1, 2), rtol=1e-12)
