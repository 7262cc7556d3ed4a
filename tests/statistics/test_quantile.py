"""Quantiles: numpy's definition, infinities as the worst value, and what too small a sample gives."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from study.statistics.measures import UNKNOWN, quantile

exact = settings(derandomize=True, deadline=None)
numbers = st.floats(-1e6, 1e6)
samples = st.lists(numbers, min_size=1, max_size=60).map(np.array)
levels = st.floats(0.01, 0.99)


@exact
@given(values=samples, p=levels)
def test_value_is_numpys_hazen_quantile(values, p):
    """The value is Hazen's quantile, whose i-th order statistic of n stands at (i - ½)/n."""
    expected = np.quantile(values, p, method="hazen")
    assert quantile(values, p).value == pytest.approx(expected, rel=1e-9, abs=1e-9)


@exact
@given(values=samples, p=levels, seed=st.integers(0, 99))
def test_order_of_values_does_not_count(values, p, seed):
    """A permutation of the sample changes nothing, and the sample is left as it was."""
    shuffled = np.random.default_rng(seed).permutation(values)
    before = shuffled.copy()
    assert quantile(shuffled, p) == quantile(values, p)
    np.testing.assert_array_equal(shuffled, before)


@exact
@given(values=samples, p=levels, worse=st.integers(0, 60))
def test_a_failure_never_improves_a_quantile(values, p, worse):
    """Counting a value as infinite never lowers a quantile."""
    ruined = values.copy()
    ruined[:worse] = np.inf
    assert quantile(ruined, p).value >= quantile(values, p).value


@pytest.mark.parametrize(
    ("values", "p", "expected"),
    [
        ([1, 2, 3], 0.5, 2.0),
        ([1, 2, 3, 4], 0.5, 2.5),
        ([1, 2, math.inf], 0.5, 2.0),
        ([1, 2, math.inf, math.inf], 0.5, math.inf),
        ([1, 2, 3, math.inf], 0.5, 2.5),
        ([1, math.inf, math.inf], 0.5, math.inf),
        ([math.inf] * 5, 0.05, math.inf),
        ([7], 0.05, 7.0),
        ([7], 0.95, 7.0),
        ([1, 2, 3], 0.05, 1.0),
        ([1, 2, 3], 0.95, 3.0),
    ],
)
def test_values_by_hand(values, p, expected):
    """Small samples, with and without infinities, as one computes them by hand."""
    assert quantile(np.array(values, dtype=float), p).value == expected


def test_error_by_hand():
    """Of 100 values the median's enclosing ranks are 45 and 55 (½ and 5 from the middle): half of 10 steps is 5."""
    found = quantile(np.arange(100.0), 0.5)
    assert found.value == pytest.approx(49.5)
    assert found.error == pytest.approx(5.0)


@pytest.mark.parametrize("p", [0.05, 0.5, 0.95])
@pytest.mark.parametrize("factor", [1e-9, 3.0])
def test_value_and_error_scale_and_shift(p, factor):
    """A change of unit changes value and error alike; a shift leaves the error."""
    values = np.random.default_rng(5).standard_normal(500)
    plain, other = quantile(values, p), quantile(factor * (values + 2.0), p)
    assert other.value == pytest.approx(factor * (plain.value + 2.0), rel=1e-12)
    assert other.error == pytest.approx(factor * plain.error, rel=1e-9)


@pytest.mark.parametrize(("n", "p"), [(1, 0.5), (2, 0.5), (15, 0.05), (15, 0.95)])
def test_error_is_infinite_where_no_values_enclose(n, p):
    """Samples too small to enclose the quantile have an infinite error, not a small one."""
    found = quantile(np.arange(float(n)), p)
    assert math.isfinite(found.value)
    assert found.error == math.inf


def test_error_is_infinite_beside_failures():
    """Where the upper enclosing value is a failure, the error is infinite; further away it is not."""
    values = np.arange(100.0)
    for failed, expected in ((49, math.inf), (46, math.inf), (40, 5.0)):
        ruined = np.where(values >= 100 - failed, np.inf, values)
        assert quantile(ruined, 0.5).error == pytest.approx(expected)
    assert quantile(np.where(values >= 20, np.inf, values), 0.5) == (math.inf, math.inf)


def test_no_values_no_quantile():
    """An empty sample has neither value nor error."""
    assert all(math.isnan(v) for v in (*quantile(np.array([]), 0.5), *UNKNOWN))
