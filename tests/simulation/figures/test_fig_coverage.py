"""The figure of coverage: shares by hand and by theory, from runs whose config lists the measures of intervals."""

import numpy as np
import pandas as pd
import pytest

from study.simulation.figures import Tables, fig_coverage
from study.simulation.figures.figure import NotApplicable
from tests.configs import config

TOP = {"estimators": ["mle", "als"], "measures": ["interval", "own_errors"], "seed": 3}
CELLS = {"trials": 400, "samples": 40, "noise": None, "kappa": [1, 100], "angle": [5, 60]}


@pytest.fixture(scope="module")
def tables(make_run):
    """Four cells of 400 trials."""
    return Tables(make_run(config(TOP, **CELLS)))


def test_shares_by_hand():
    """Coverage counts intervals that hold the truth; an infinite width has no upper end; the median is the middle."""
    held = np.array([False, True, True, True, True])
    fits = {"own_errors_radius": held, "own_errors_center_1": ~held, "own_errors_center_2": np.ones(5, dtype=bool)}
    fits["own_errors_width"] = np.array([np.inf, 1.0, 2.0, 3.0, np.inf])
    row = fig_coverage._measured(fits, "own_errors", np.array([True, True, True, False, False]))
    assert (row["radius"], row["axis"], row["across"], row["ok"]) == (0.8, 0.2, 1.0, 0.6)
    assert (row["radius_ok"], row["open"], row["width"]) == (2 / 3, 0.4, 3.0)
    assert row["across_error"] > 0.0


def test_coverage_by_kappa(tables):
    """Far from the noise every method covers in 95 %; where curvature is lost the interval alone does.

    Within 4.5 standard errors of 400 trials, and .015 for what the methods are off by; false alarms 1e-4.
    """
    cells = fig_coverage.prepare(tables).cells
    assert [*cells["method"].unique()] == ["mle", "als", "interval"]
    assert len(cells) == 4 * 3
    error = 4.5 * np.sqrt(0.05 * 0.95 / 400) + 0.015
    far = cells[cells["kappa"] == 100]
    assert (far["radius"] - 0.95).abs().max() < error
    assert far["width"].between(0.9, 1.2).all()
    lost = cells[cells["kappa"] == 1].set_index("method")
    assert (lost.loc["interval", "radius"] - 0.95).abs().max() < error
    assert lost.loc["als", "radius"].max() < 0.95 - error / 2
    assert (lost.loc["interval", "open"] > 0.1).all()


def test_shares_are_those_of_the_summary(tables):
    """The summary has the same shares and medians with the same errors, by the names of the measures."""
    cells, summary = fig_coverage.prepare(tables).cells, tables.summary
    assert np.array_equal(cells.loc[cells["method"] == "interval", "radius"], summary["interval_radius"][::2])
    for column, name in {"radius": "radius", "across": "center_2", "width": "width_median"}.items():
        for end in ("", "_error"):
            mine = cells[cells["method"] != "interval"][f"{column}{end}"].to_numpy()
            np.testing.assert_array_equal(mine, summary[f"own_errors_{name}{end}"].to_numpy())
    assert cells["sigma"].nunique() == 4


def test_runs_without_intervals(make_run):
    """A run without the measures says what its config needs."""
    with pytest.raises(NotApplicable, match=r"needs measures = \['interval', 'own_errors'\] in the config"):
        fig_coverage.prepare(Tables(make_run(config({"measures": ["interval"]}, trials=2))))


def test_panels(tables):
    """Each method has two panels; below are only cells in which a fifth of the fits are ok."""
    frame = fig_coverage.prepare(tables)
    frame.cells = pd.concat([frame.cells.assign(ok=0.1), frame.cells.query("kappa == 100").assign(samples=50)])
    axes = fig_coverage.draw(frame).axes
    assert [ax.get_title("left") for ax in axes[:3]][2] == "interval"
    counts = [sum(len(bars.lines[0].get_xdata()) for bars in ax.containers) for ax in axes]
    assert counts == [6] * 3 + [2] * 3
