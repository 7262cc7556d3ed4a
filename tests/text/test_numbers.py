"""Numbers in tables for a terminal."""

import math

import pytest

from study.text.numbers import duration, number, size


def test_numbers():
    """Three digits, or what a format says; a dash where there is no number."""
    assert number(1234.5678) == "1.23e+03"
    assert number(0.0156, ".1%") == "1.6%"
    assert number(math.nan) == "-"
    assert number(math.inf, ".0f") == "inf"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (duration(0.04), "0.0 s"),
        (duration(119.0), "119.0 s"),
        (duration(2 * 60.0), "2.0 min"),
        (duration(36 * 3600.0), "36.0 h"),
        (duration(8 * 86_400.0), "8.0 days"),
        (duration(3e9), "95.1 years"),  # 3e9 / 31 557 600, the seconds of a Julian year
        (duration(3e14), "9,506,426.3 years"),
        (size(3e5), "0.3 MB"),
        (size(1.999e9), "1,999.0 MB"),
        (size(5.1e10), "51.0 GB"),
        (size(5.1e13), "51.0 TB"),
        (size(5.1e20), "510.0 EB"),
    ],
)
def test_units(text, expected):
    """Times and sizes are in units that a reader can picture."""
    assert text == expected
