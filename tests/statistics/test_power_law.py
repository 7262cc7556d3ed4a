"""Power laws: the exponent, its error, and the points that carry no weight."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from study.statistics.measures import power_law

X = np.logspace(1, 5, 13)


@pytest.mark.parametrize("exponent", [-0.5, -1.0, 0.0, 2.0])
def test_exact_laws_are_recovered(exponent):
    """Exponent and factor of an exact law come back to rounding, whatever the weights."""
    y = 3.0 * X**exponent
    found = power_law(X, y, y * np.linspace(0.01, 0.3, X.size))
    assert found.exponent == pytest.approx(exponent, abs=1e-12)
    assert found.factor == pytest.approx(3.0, rel=1e-11)


def test_error_is_that_of_weighted_least_squares():
    """Without misfit the error is 1/√Σω(ln x - mean)², ω = (y/δy)² (numpy's polyfit, unscaled covariance)."""
    y = 3.0 * X**-0.5
    relative = np.linspace(0.01, 0.3, X.size)
    expected = np.polyfit(np.log(X), np.log(y), 1, w=1 / relative, cov="unscaled")[1][0, 0]
    assert power_law(X, y, relative * y).error == pytest.approx(math.sqrt(expected), rel=1e-9)


def expected_coverage(points):
    """P(|z| < √max(χ²/ν, 1)) for independent z and χ² of ν = points - 2."""
    chi2, dof = stats.chi2(points - 2), points - 2

    def within(v):
        return chi2.pdf(v) * (2 * stats.norm.cdf(math.sqrt(max(v / dof, 1.0))) - 1)

    return integrate.quad(within, 0, dof)[0] + integrate.quad(within, dof, 20 * dof)[0]


@pytest.mark.parametrize("scale", [1.0, 5.0])
def test_coverage(scale):
    """The true exponent lies within one error in about 68 % of repetitions, also where errors are told too small.

    The error never falls below that of the weights, so coverage is a little above 68 % where they are right (the
    integral), and Student's t where all is scatter; 4.5 binomial deviations of 2000 are 5 points.
    """
    rng = np.random.default_rng(12)
    law = 3.0 * X**-0.5
    inside = 0
    for _ in range(2000):
        y = law * np.exp(0.02 * scale * rng.standard_normal(X.size))
        found = power_law(X, y, 0.02 * y)
        inside += abs(found.exponent + 0.5) < found.error
    expected = expected_coverage(X.size) if scale == 1.0 else 2 * stats.t(X.size - 2).cdf(1.0) - 1
    assert 0.64 < expected < 0.76
    assert inside / 2000 == pytest.approx(expected, abs=4.5 * math.sqrt(expected * (1 - expected) / 2000))


@pytest.mark.parametrize("bad", [(math.inf, 1.0), (math.nan, 1.0), (0.0, 1.0), (-1.0, 1.0), (1.0, 0.0)])
@pytest.mark.parametrize("error", [None, math.inf, math.nan])
def test_points_without_weight_are_left_out(bad, error):
    """Points that are infinite, missing or not positive, or have no error, do not move the fit."""
    y = 3.0 * X**-0.5
    good = power_law(X, y, 0.1 * y)
    wide = np.append(X, 1e6), np.append(y, bad[0]), np.append(0.1 * y, bad[1] if error is None else error)
    assert power_law(*wide) == pytest.approx(good, rel=1e-12)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_points(count):
    """Fewer than three points leave no scatter to judge by, so there is no law."""
    y = X[:count] ** -0.5
    assert all(math.isnan(v) for v in power_law(X[:count], y, 0.1 * y))
