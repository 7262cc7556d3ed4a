"""Numbers in tables for a terminal."""

import math

from study.text.numbers import number


def test_numbers():
    """Three digits, or what a format says; a dash where there is no number."""
    assert number(1234.5678) == "1.23e+03"
    assert number(0.0156, ".1%") == "1.6%"
    assert number(math.nan) == "-"
    assert number(math.inf, ".0f") == "inf"
