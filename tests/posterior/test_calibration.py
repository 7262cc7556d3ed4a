"""Monte-Carlo errors mean what they say: over many repetitions they match the scatter of what they belong to.

Standard deviations over 2000 repetitions are known to 1.6 % (normal) to 2 %, so 10 % is passed by chance in fewer
than 1 of 10⁵ cases, and 15 % still less.
"""

import math

import numpy as np
import pytest
from scipy import stats

from study.statistics.measures import UNKNOWN, mean, quantile, root_mean_square, share

REPEATS, SIZE = 2000, 1000
LAWS = {"normal": stats.norm, "cauchy": stats.cauchy}


@pytest.fixture(scope="module", params=list(LAWS))
def repeated(request):
    """A law, and 2000 samples of 1000 of it."""
    return LAWS[request.param], LAWS[request.param].rvs(size=(REPEATS, SIZE), random_state=17)


@pytest.mark.parametrize(("p", "tolerance"), [(0.5, 0.10), (0.05, 0.15), (0.95, 0.15)])
def test_quantile_errors_match_the_scatter(repeated, p, tolerance):
    """The reported error of a quantile is, on average, the standard deviation of that quantile."""
    law, data = repeated
    found = [quantile(row, p) for row in data]
    scatter = np.std([m.value for m in found])
    assert np.mean([m.error for m in found]) == pytest.approx(scatter, rel=tolerance)
    # and the scatter is the one of theory, √(p(1-p)/n)/f(x_p)
    expected = math.sqrt(p * (1 - p) / SIZE) / law.pdf(law.ppf(p))
    assert scatter == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize("p", [0.5, 0.05, 0.95])
def test_quantile_errors_cover_the_truth(repeated, p):
    """The true quantile lies within one error in 68 % of repetitions and within two in 95 %, to 5 points."""
    law, data = repeated
    found = [quantile(row, p) for row in data]
    pull = np.array([abs(m.value - law.ppf(p)) / m.error for m in found])
    assert np.mean(pull < 1) == pytest.approx(0.683, abs=0.05)
    assert np.mean(pull < 2) == pytest.approx(0.954, abs=0.05)


@pytest.mark.parametrize("p", [0.02, 0.3, 0.5])
def test_share_errors_match_the_scatter(p):
    """The error of a share is the standard deviation of the share, within 10 %."""
    counts = stats.binom(400, p).rvs(size=REPEATS, random_state=3)
    found = [share(int(count), 400) for count in counts]
    assert np.mean([m.value for m in found]) == pytest.approx(p, abs=4.5 * math.sqrt(p * (1 - p) / 400 / REPEATS))
    scatter = np.std([m.value for m in found])
    assert np.mean([m.error for m in found]) == pytest.approx(scatter, rel=0.15 if p < 0.1 else 0.1)


def test_share_at_the_ends():
    """None or all of n has an error of the order 1/n, not 0; none of none is unknown."""
    for count in (0, 100):
        found = share(count, 100)
        assert found.value == count / 100
        assert 0.005 < found.error < 0.03
    assert all(math.isnan(v) for v in share(0, 0))


@pytest.mark.parametrize("measure", [mean, root_mean_square])
def test_moment_errors_match_the_scatter(measure):
    """Errors of mean and root mean square match their scatter within 10 %, where moments exist."""
    data = stats.norm(1.0, 2.0).rvs(size=(REPEATS, SIZE), random_state=11)
    found = [measure(row) for row in data]
    scatter = np.std([m.value for m in found])
    assert np.mean([m.error for m in found]) == pytest.approx(scatter, rel=0.1)
    truth = 1.0 if measure is mean else math.sqrt(5.0)
    assert np.mean([m.value for m in found]) == pytest.approx(truth, abs=4.5 * scatter / math.sqrt(REPEATS) + 1e-3)


def test_moments_of_nothing():
    """Samples without a spread to estimate have no mean and no root mean square."""
    for values in (np.array([]), np.array([1.0])):
        assert all(math.isnan(v) for measure in (mean, root_mean_square) for v in measure(values))
    assert math.isnan(root_mean_square(np.zeros(5)).value) == math.isnan(UNKNOWN.value)
