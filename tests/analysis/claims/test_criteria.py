"""Rules that claims share: a number within a distance of its target."""

import math

import pytest

from study.analysis.claims.claim import Number
from study.analysis.claims.criteria import within


@pytest.mark.parametrize(
    ("value", "error", "inside"),
    [(1.0, 0.05, True), (1.05, 0.02, True), (1.05, 0.03, False), (0.89, 0.0, False), (1.0, math.inf, False)],
)
def test_within(value, error, inside):
    """Within a tenth of one, two standard errors included; without an error, by the value."""
    assert within(Number("", value, error, 1), 1.0, 0.1) is inside
    assert within(Number("", value, math.nan, 0), 1.0, 0.1) is (abs(value - 1.0) <= 0.1)
