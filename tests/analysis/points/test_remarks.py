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
        "160 of 200 rows repeat earlier ones; if they are no new measurement, every ± is too small",
        "for the intervals, rows that repeat an earlier one count once",
    ]


@pytest.mark.parametrize(("n", "told"), [(5, "only 1 point more than a sphere needs"), (9, "only 5 points more")])
def test_few_points(on_cap, n, told):
    """An ok fit of fewer than ten points says that its noise may be small by chance; one of ten does not."""
    fit = study.fit(on_cap(np.random.default_rng(3), n, 180.0, noise=1e-4)[0])
    assert fit.ok
    (line,) = doubts(fit)
    assert line.startswith(told)
    assert list(doubts(study.fit(on_cap(np.random.default_rng(3), 10, 180.0, noise=1e-4)[0]))) == []


def test_infinite_rows(cap):
    """A coordinate that is not finite is told with its row."""
    cap[[6, 20], 1] = np.inf
    assert next(doubts(study.fit(cap))) == "not finite in 2 of 40 rows, the first of which is row 7"


@pytest.mark.parametrize(("width", "expected"), [(5.0, True), (20.0, False)])
def test_belts(width, expected):
    """Points about an equator, whose centre is as uncertain as they are high, are told; wide belts and caps are not."""
    rng = np.random.default_rng(4)
    z, turn = np.sin(np.radians(width)) * rng.uniform(-1, 1, 40), rng.uniform(0, 2 * np.pi, 40)
    across = np.sqrt(1 - z**2)
    points = np.column_stack([across * np.cos(turn), across * np.sin(turn), z]) + 0.02 * rng.standard_normal((40, 3))
    fit = study.fit(points)
    assert fit.ok
    assert any("close to a plane through the centre" in line for line in doubts(fit)) == expected
