"""Rules that claims share: a number within a distance of its target.

Rows of error tables: every fit counts with its error, and one without a number as infinite.

Medians in claims: exponents of power laws, quotients, and conditions without an answer.
"""

import math

import numpy as np
import pandas as pd
import pytest

from study.simulation.claims.claim import Number, error_over, exponent, ratio, within
from study.simulation.statistics import Measure


@pytest.mark.parametrize(
    ("value", "error", "inside"),
    [(1.0, 0.05, True), (1.05, 0.02, True), (1.05, 0.03, False), (0.89, 0.0, False), (1.0, math.inf, False)],
)
def test_within(value, error, inside):
    """Within a tenth of one, two standard errors included; without an error, by the value."""
    assert within(Number("", value, error, 1), 1.0, 0.1) is inside
    assert within(Number("", value, math.nan, 0), 1.0, 0.1) is (abs(value - 1.0) <= 0.1)


def test_every_fit_counts():
    """A status leaves no fit out; without a number, or a finite bound, an error is infinite."""
    part = pd.DataFrame(
        {"status": [0, 1, 3, 0], "error": [1.0, 2.0, math.nan, 1.0], "bound": [2.0, 2.0, 2.0, math.inf]}
    )
    assert list(error_over(part, "bound")) == [0.5, 1.0, math.inf, math.inf]


@pytest.mark.parametrize("power", [-1.0, 0.0, 2.0])
def test_exponent(power, scores):
    """The exponent of exact medians comes back, with the smallest group's size; a group stands at its median x."""
    x = np.repeat([1.0, 10.0, 100.0, 1000.0], 101)
    values = x**power * np.exp(np.tile(scores(101), 4))
    number = exponent("slope", x, values, np.log10(x))
    assert number.value == pytest.approx(power, abs=1e-9)
    assert 0.0 < number.error < 0.1
    assert number.trials == 101


def test_law_of_failures(scores):
    """An infinite median is an exponent without limit; two groups are no law."""
    x = np.repeat([1.0, 10.0, 100.0], 101)
    values = np.exp(np.tile(scores(101), 3))
    assert exponent("slope", x, np.where(x == 10.0, math.inf, values), x).value == math.inf
    assert math.isnan(exponent("slope", x[:202], values[:202], x[:202]).value)
    assert math.isnan(exponent("slope", x[:0], values[:0], x[:0]).value)


def test_ratio():
    """Errors add in relative squares; over nothing finite there is no ratio."""
    value, error = ratio(Measure(3.0, 0.3), Measure(2.0, 0.1))
    assert (value, error) == pytest.approx((1.5, 1.5 * math.hypot(0.1, 0.05)))
    assert ratio(Measure(math.inf, math.inf), Measure(2.0, 0.1)).value == math.inf
    for below in (math.inf, math.nan, 0.0):
        assert math.isnan(ratio(Measure(1.0, 0.1), Measure(below, 0.1)).value)
