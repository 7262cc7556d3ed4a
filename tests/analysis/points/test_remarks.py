"""Remarks on fitted points, in words and as numbers."""

import numpy as np
import pytest

import study
from study.analysis.points.remarks import doubts, interval_numbers, intervals_in_words


@pytest.fixture
def cap(rng, on_cap):
    """40 points on a cap of 60°, with noise of .01 r."""
    points, _ = on_cap(rng, 40, 60.0, 3, 0.01)
    return points


def test_intervals_in_words(cap):
    """One line with the radius and each coordinate, whose ends are those of the fit to the digits shown."""
    fit = study.fit(cap)
    (line,) = intervals_in_words(fit, ["x", "y", "z"])
    words = line.split(": ", 1)[1].split(", ")
    assert line.startswith("95 % intervals: radius ")
    assert [part.split()[0] for part in words] == ["radius", "x", "y", "z"]
    ends = np.array([[float(part.split()[1]), float(part.split()[3])] for part in words])
    wanted = np.vstack([fit.interval("radius"), fit.interval("center")])
    widths = wanted[:, 1:] - wanted[:, :1]
    np.testing.assert_array_less(np.abs(ends - wanted), np.broadcast_to(0.01 * widths, ends.shape))
    numbers = interval_numbers(fit, ["x", "y", "z"])
    assert numbers["radius_low"] == wanted[0, 0]
    assert numbers["center_z_high"] == wanted[3, 1]


def test_an_open_interval_in_words(rng, on_cap):
    """Points that do not bound the radius are told so, with what they say of it."""
    points, _ = on_cap(rng, 40, 2.0, 3, 0.01)
    (line,) = intervals_in_words(study.fit(points), ["x", "y", "z"])
    assert "do not bound it" in line
    assert "radius at least" in line


def test_outliers_and_copies(cap):
    """Both are named; `robust` says that it left outliers out, and its interval is that of the others alone."""
    assert list(doubts(study.fit(cap))) == []
    wrong = cap.copy()
    wrong[7] += 0.5
    assert list(doubts(study.fit(wrong))) == [
        "1 of 40 points is an outlier (row 8): the fit uses it; -e robust leaves it out"
    ]
    robust = study.fit(wrong, "robust")
    assert list(doubts(robust)) == ["1 of 40 points is an outlier (row 8): the fit leaves it out"]
    others = study.fit(np.delete(wrong, 7, axis=0))
    np.testing.assert_allclose(robust.interval("radius"), others.interval("radius"), rtol=1e-6)
    twice = np.repeat(cap, 5, axis=0)
    assert list(doubts(study.fit(twice))) == [
        "160 of 200 rows repeat earlier ones: every ± is too small; the intervals count copies once"
    ]
