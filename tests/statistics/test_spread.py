"""Robust standard deviations and the error ellipsoids of their size."""

import math

import numpy as np
import pytest
from scipy import stats

from study.statistics.measures import inside, robust_sd


@pytest.mark.parametrize("scale", [1e-13, 2.0, 1e9])
def test_robust_sd_of_normal_scores(scale):
    """It is the standard deviation of a Gaussian, wherever its middle is."""
    scores = stats.norm.ppf((np.arange(10_000) + 0.5) / 10_000)
    assert robust_sd(scale * (scores + 3.0)) == pytest.approx(scale, rel=1e-3)


def test_robust_sd_without_a_mean():
    """That of a Cauchy law is its quantile at Φ(1), tan π(Φ(1) - ½) = 1.8373, whatever its wildest values do."""
    cauchy = np.tan(math.pi * ((np.arange(10_000) + 0.5) / 10_000 - 0.5))
    assert robust_sd(cauchy) == pytest.approx(math.tan(math.pi * (stats.norm.cdf(1.0) - 0.5)), rel=1e-3)
    cauchy[:10], cauchy[-10:] = -np.inf, np.inf
    assert robust_sd(cauchy) == pytest.approx(1.8373, rel=1e-3)


@pytest.mark.parametrize(("d", "square"), [(1, 3.841), (2, 5.991), (3, 7.815)])  # 95 % points of χ²
def test_inside(d, square):
    """Errors just within the ellipsoid of 95 % are inside, whatever their direction, and just beyond outside."""
    direction = np.random.default_rng(d).standard_normal((50, d))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    sd = np.geomspace(0.1, 10.0, d)
    for factor, expected in ((0.999, True), (1.001, False)):
        found = inside(factor * math.sqrt(square) * direction * sd, sd, 0.95)
        assert found.tolist() == [expected] * 50


def test_inside_of_nothing():
    """No errors are no ellipsoids."""
    assert inside(np.empty((0, 2)), np.array([1.0, 1.0]), 0.95).shape == (0,)
