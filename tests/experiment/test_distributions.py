"""The laws of a random design, as functions: quantiles, extremes, and what may be written for them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy import stats

from study.experiment.distributions import Choice, Constant, Law, LogUniform, Uniform

exact = settings(derandomize=True, deadline=None)
LAST = float(np.nextafter(1.0, 0.0))
QUANTILES = [0.0, 1e-16, 1e-9, 0.1, 0.25, 0.5, 0.9, 0.999999]


@pytest.mark.parametrize("u", QUANTILES)
@pytest.mark.parametrize(("low", "high"), [(0.0, 37.0), (0.0, 180.0), (2.5, 3.0), (1e-13, 1e14)])
def test_uniform_is_scipys_quantile_function(u, low, high):
    """The value at u is the quantile at 1 - u of the uniform distribution."""
    expected = stats.uniform(low, high - low).ppf(1.0 - u)
    assert Uniform(law="uniform", low=low, high=high).at(u) == pytest.approx(expected, rel=1e-14, abs=1e-15 * high)


@pytest.mark.parametrize("u", QUANTILES)
@pytest.mark.parametrize(("low", "high"), [(4.0, 1e6), (1e-13, 1e14), (0.5, 0.6), (1e-150, 1e150)])
def test_log_uniform_is_scipys_quantile_function(u, low, high):
    """The value at u is the quantile at 1 - u of the log-uniform distribution, over hundreds of decades."""
    expected = stats.loguniform(low, high).ppf(1.0 - u)
    assert LogUniform(law="log_uniform", low=low, high=high).at(u) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("low", "high"), [(1e-200, 1e200), (1e-307, 1e308), (5e-324, 1.0)])
def test_log_uniform_spans_all_doubles(low, high):
    """A range whose ratio overflows is still log-uniform: its median is the geometric mean of the ends."""
    median = LogUniform(law="log_uniform", low=low, high=high).at(0.5)
    assert np.log(median) == pytest.approx(0.5 * (np.log(low) + np.log(high)), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_choice_takes_each_value_equally_often(count):
    """Equal steps of u reach each value equally often, in the order of the list."""
    values = [float(10 - i) for i in range(count)]
    law = Choice(law="choice", values=values)
    assert [law.at((i + 0.5) / (5 * count)) for i in range(5 * count)] == list(np.repeat(values, 5))
    assert (law.at(0.0), law.at(LAST)) == (values[0], values[-1])


@exact
@given(u=st.floats(0.0, LAST))
def test_constant_ignores_u(u):
    """A constant is its value to the last bit, wherever it is evaluated."""
    assert Constant(law="constant", value=0.12345678901234567).at(u) == 0.12345678901234567


@exact
@given(ends=st.lists(st.floats(0, 1e15), min_size=2, max_size=2, unique=True), u=st.floats(0.0, LAST))
def test_uniform_stays_within_its_ends(ends, u):
    """No value lies outside, and an open lower end of 0 is never drawn."""
    low, high = sorted(ends)
    value = Uniform(law="uniform", low=low, high=high).at(u)
    assert low <= value <= high
    assert value > 0.0 or high < 1e-290


@exact
@given(ends=st.lists(st.floats(1e-150, 1e150), min_size=2, max_size=2, unique=True), u=st.floats(0.0, LAST))
def test_log_uniform_stays_within_its_ends(ends, u):
    """No value lies outside, but for the rounding of a logarithm of up to 690."""
    low, high = sorted(ends)
    value = LogUniform(law="log_uniform", low=low, high=high).at(u)
    assert low * (1 - 1e-12) <= value <= high
    assert LogUniform(law="log_uniform", low=low, high=high).at(0.0) == high


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (Constant(law="constant", value=2.0), (2.0,)),
        (Choice(law="choice", values=[3.0, 1.0, 2.0]), (3.0, 1.0, 2.0)),
        (Uniform(law="uniform", low=1.0, high=4.0), (1.0, 4.0)),
        (LogUniform(law="log_uniform", low=1.0, high=4.0), (1.0, 4.0)),
    ],
    ids=lambda v: type(v).__name__,
)
def test_possible(law, expected):
    """A law's possible values are its list, or the ends of its range."""
    assert law.possible() == expected


@pytest.mark.parametrize("number", [7, 7.0])
def test_plain_number_is_a_constant(number):
    """A number in place of a law is a constant, whole or not."""
    assert TypeAdapter(Law).validate_python(number) == Constant(law="constant", value=7.0)


@pytest.mark.parametrize("value", [True, "7", None, [1, 2], {"low": 1, "high": 2}, float("nan")])
def test_what_is_no_law(value):
    """Truth values, text, lists, a table without a law and NaN are refused."""
    with pytest.raises(ValidationError):
        TypeAdapter(Law).validate_python(value)
