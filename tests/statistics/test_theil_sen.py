import numpy as np
import pytest
from scipy import stats

from study.statistics.theil_sen import theil_sen


@pytest.mark.parametrize("n", [2, 3, 4, 7, 20, 101, 300])
@pytest.mark.parametrize("level", [0.9, 0.95])
@pytest.mark.parametrize("digits", [0, 1, 15])
def test_agrees_with_scipy(n, level, digits):
    """Slope and interval are SciPy's to the bit, with ties in x and y and without."""
    rng = np.random.default_rng([n, digits])
    x = np.round(rng.normal(size=n), digits)
    x[0] = x.max() + 1.0  # two different values at least
    y = np.round(0.5 * x + rng.standard_cauchy(n), digits)
    told = stats.theilslopes(y, x, alpha=level)
    found = theil_sen(x, y, level)
    assert tuple(found) == (told.slope, told.low_slope, told.high_slope)


def test_no_slope_of_one_place():
    """Where all x are the same there is no slope."""
    assert np.all(np.isnan(theil_sen(np.ones(4), np.arange(4.0))))
