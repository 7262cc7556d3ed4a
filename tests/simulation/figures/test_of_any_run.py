"""Figures of any grid: nested loops, moments and zip plots, against the summary and against cases by hand."""

import numpy as np
import pytest

from study.simulation.figures import FIGURES, NotApplicable, Tables, fig_bias, fig_nested, fig_zip, gallery
from tests.configs import config

TOP = {"estimators": ["mle", "gdke"], "measures": ["ends", "interval", "own_errors"], "seed": 5}


@pytest.fixture(scope="module")
def tables(make_run):
    """Twelve cells of 300 trials."""
    return Tables(make_run(config(TOP, trials=300, samples=[100, 10], noise=[0.01, 0.1], angle=[90, 40, 60])))


@pytest.fixture(scope="module")
def two(make_run):
    """Two cells of 200 trials, the second of much noise."""
    return Tables(make_run(config(TOP, trials=200, samples=50, noise=[0.02, 0.3], angle=50)))


def test_they_are_drawn_where_they_are_named():
    """A report, and the figures of a run that are not named, leave them out."""
    named = {"fig_nested", "fig_bias", "fig_zip"}
    assert named <= set(FIGURES)
    assert not named & set(gallery().undrawn)
    assert set(gallery(["fig_zip"]).undrawn) == {"fig_zip"}


def test_loops_are_in_order(tables):
    """Conditions of few values are outermost; values are in the order of the config; the last one changes fastest."""
    frame = fig_nested.prepare(tables)
    assert [loop.symbol for loop in frame.loops] == ["N", "σ/r", "φ"]
    assert [loop.values for loop in frame.loops] == [["100", "10"], ["0.01", "0.1"], ["90°", "40°", "60°"]]
    places = np.stack([loop.place for loop in frame.loops])
    np.testing.assert_array_equal(np.array([6, 3, 1]) @ places, np.arange(12))


def test_medians_are_those_of_the_summary(tables):
    """Each step is the median of the cell whose conditions stand below it."""
    frame = fig_nested.prepare(tables)
    rows = tables.summary.set_index(["estimator", "samples", "noise", "angle"])
    for step in frame.medians.itertuples():
        n, noise, angle = (loop.values[loop.place[step.at]] for loop in frame.loops)
        row = rows.loc[(step.estimator, int(n), float(noise), float(angle.removesuffix("°")))]
        assert (step.ratio, step.error) == (row["ratio_median"].item(), row["ratio_median_error"].item())
    assert len(frame.medians) == 24


def test_moments_are_those_of_the_summary(tables):
    """Bias and root mean square by cell; GDKE's bias is towards the points, so positive along the axis."""
    frame = fig_bias.prepare(tables)
    for name in ("bias", "rmse_error"):
        mine = np.sort(frame.moments[name].to_numpy())
        np.testing.assert_array_equal(mine, np.sort(tables.summary[name].to_numpy()))
    large = frame.moments[(frame.moments["estimator"] == "gdke") & (frame.moments["at"].isin([4, 5]))]
    assert (large["bias"] > 5.0 * large["bias_error"]).all()


def test_what_a_run_lacks(tables, two, random):
    """Each reason says what to change."""
    for figure, run, words in (
        (fig_nested, two, "has 2 cells; 4 to 400"),
        (fig_nested, random, 'kind = "grid"'),
        (fig_bias, two, "has 2 cells; 4 to 60"),
        (fig_zip, tables, "has 12 cells; a zip plot shows 4"),
        (fig_zip, Tables(random), "grid"),
    ):
        with pytest.raises(NotApplicable, match=words):
            figure.prepare(run if isinstance(run, Tables) else Tables(run))


def test_a_zip_by_hand():
    """Sorted by the distance from the truth in half-widths of that side; those that miss it are last."""
    estimate = np.array([1.0, 0.9, 1.2, 0.5])
    ends = np.array([[0.8, 1.2], [0.8, 1.3], [0.9, 1.5], [0.4, 0.9]])
    # distances: 0, 0.1/0.4, 0.2/0.3, 0.5/0.4
    placed, ranks, coverage = fig_zip._sorted(estimate[::-1], ends[::-1])
    np.testing.assert_array_equal(placed, ends)
    np.testing.assert_array_equal(ranks, [0.125, 0.375, 0.625, 0.875])
    assert coverage.value == 0.75


def test_intervals_of_a_long_cell_are_thinned(two, monkeypatch):
    """A panel shows at most so many intervals, evenly over the ranks; as many as it may show are not thinned."""
    frame = fig_zip.prepare(two)
    for most, shown in ((100, 100), (99, 50), (30, 25)):  # the upper half of 200 trials
        monkeypatch.setattr(fig_zip, "_LINES", most)
        (lines, *_) = fig_zip.draw(frame).axes[-1].collections
        assert len(lines.get_segments()) == shown


def test_an_open_interval_holds_what_it_reaches():
    """No upper end is no distance on that side; an interval that is not known misses."""
    estimate, ends = np.array([0.9, 1.1]), np.array([[0.8, np.inf], [np.nan, np.nan]])
    placed, _, coverage = fig_zip._sorted(estimate, ends)
    assert placed[0, 1] == np.inf
    assert coverage.value == 0.5


def test_shares_of_a_zip_are_those_of_the_measures(two):
    """The ends hold the truth where the measures of the same intervals say so, trial by trial and as shares."""
    errors = two.run.table("errors")
    for measure, prefix in (("interval", ""), ("own_errors", "own_")):
        held = (errors[f"ends_{prefix}low"] <= 1.0) & (errors[f"ends_{prefix}high"] >= 1.0)
        assert (held == errors[f"{measure}_radius"]).all()
    frame, summary = fig_zip.prepare(two), two.summary
    shares = [[coverage.value for *_, coverage in row] for row in frame.panels]
    for (_, part), of_cell in zip(summary.groupby("group", sort=False), shares, strict=True):
        assert of_cell == pytest.approx([*part["own_errors_radius"], part["interval_radius"].iloc[0]])
    assert [title for title, *_ in frame.panels[0]] == ["MLE ± t s.e.", "GDKE ± t s.e.", "interval"]
    # 200 trials, 5 % outside: the interval covers within 4.5 errors, false alarm 1e-5; GDKE's own errors do not
    assert all(abs(row[-1][3].value - 0.95) < 4.5 * np.sqrt(0.95 * 0.05 / 200) for row in frame.panels)
    assert frame.panels[1][1][3].value < 0.5
