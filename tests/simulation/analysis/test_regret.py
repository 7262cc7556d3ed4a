"""Regret: ratios to the best in a cell, their geometric means, and errors of these."""

import math

import numpy as np
import pandas as pd
import pytest

from study.files import RunError
from study.simulation.analysis import regret
from tests.configs import config

DESIGN = config({"dimension": 2, "estimators": ["gdke", "als"]}, trials=20, samples=[10, 20], angle=[90, 180])


def table(**cells):
    """An error table of cells, each with its samples and lists of errors by estimator."""
    rows = []
    for cell, (samples, errors) in cells.items():
        for estimator, values in errors.items():
            rows += [(cell, samples, trial, estimator, value) for trial, value in enumerate(values)]
    return pd.DataFrame(rows, columns=["cell", "samples", "trial", "estimator", "error"])


def test_ratios_and_geometric_means():
    """Two cells with constant errors have these ratios and these means, whatever is left out."""
    errors = table(a=(10, {"x": [1.0] * 20, "y": [2.0] * 20}), b=(99, {"x": [8.0] * 20, "y": [1.0] * 20}))
    cells = regret.by_cell([errors], ["x", "y"])
    assert list(cells["median"]) == [1.0, 2.0, 8.0, 1.0]
    assert list(cells["q95"]) == [1.0, 2.0, 8.0, 1.0]
    means = regret.regret(cells).set_index(["samples", "estimator"])
    assert means.loc[(0, "x"), "median"] == pytest.approx(math.sqrt(8.0))
    assert means.loc[(0, "y"), "q95"] == pytest.approx(math.sqrt(2.0))
    assert means.loc[(99, "x"), "median"] == pytest.approx(8.0)
    assert means.loc[(0, "x"), "median_worst"] == 8.0
    assert means["median_error"].abs().max() < 1e-12
    assert list(means["cells"]) == [2, 2, 1, 1, 1, 1]


def test_fits_without_a_number_count_as_worse_than_any():
    """Lost fits beyond the median do not change it, and those at the 95 % quantile make it infinite."""
    errors = table(a=(10, {"x": [1.0] * 17 + [np.nan] * 3, "y": [3.0] * 20}))
    cells = regret.by_cell([errors], ["x", "y"]).set_index("estimator")
    assert cells.loc["y", "median"] == 3.0
    assert cells.loc["y", "q95"] == 1.0
    assert cells.loc["x", "q95"] == np.inf
    whole = table(a=(10, {"x": [1.0] * 20, "y": [2.0] * 20}), b=(10, {"x": [np.nan] * 20, "y": [1.0] * 20}))
    means = regret.regret(regret.by_cell([whole], ["x", "y"])).set_index(["samples", "estimator"])
    assert list(means.loc[(0, "x"), ["median", "median_error", "median_worst"]]) == [np.inf] * 3
    assert means.loc[(0, "y"), "median"] == pytest.approx(math.sqrt(2.0))


def test_standard_error_is_that_of_repetitions():
    """The jackknife's error is the scatter of the mean regret over repetitions, within 40 %.

    The scatter of 50 has an error of 10 %, the median jackknife of 10 groups one of some 5 % and a bias of order 10 %.
    """
    rng, found = np.random.default_rng(1), []
    for _ in range(50):
        noisy = rng.exponential(size=(4, 2, 200))
        cells = {f"c{i}": (10, {"x": one, "y": 2.0 * two}) for i, (one, two) in enumerate(noisy)}
        means = regret.regret(regret.by_cell([table(**cells)], ["x", "y"])).set_index(["samples", "estimator"])
        found.append((means.loc[(0, "y"), "median"], means.loc[(0, "y"), "median_error"]))
    values, errors = np.transpose(found)
    assert np.median(errors) == pytest.approx(values.std(ddof=1), rel=0.4)


def test_one_trial_is_too_few():
    """A cell of one trial has no Monte-Carlo error, and the message says where."""
    with pytest.raises(RunError, match="cell a: 1 trials; regret needs at least 2"):
        regret.by_cell([table(a=(10, {"x": [1.0], "y": [1.0]}))], ["x", "y"])


def test_regret_of_a_run(make_run):
    """The command's table has a line per estimator, and ratios that the error table confirms."""
    run = make_run(DESIGN)
    cells = regret.of_run(run)
    errors = run.table("errors")
    medians = errors.groupby(["cell", "estimator"], observed=True)["error"].quantile(0.5, interpolation="lower")
    medians = medians.unstack()
    expected = (medians["als"] / medians.min(axis=1)).to_dict()
    mine = cells[cells["estimator"] == "als"]
    assert dict(zip(mine["cell"], mine["median"], strict=True)) == pytest.approx(expected)
    lines = list(regret.printed(run, regret.regret(cells)))
    assert {line.split()[0] for line in lines[3:]} == {"gdke", "als"}
    assert "N = 10" in lines[2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('["gdke", "als"]', '["als"]'), "regret compares estimators"),
        (("[design]", 'keep = "summary"\n[design]'), "regret needs every error"),
    ],
)
def test_runs_that_have_none(make_run, change, message):
    """A run of one estimator, or without its error table, is refused in one line."""
    with pytest.raises(RunError, match=message):
        regret.of_run(make_run(DESIGN.replace(*change)))


def test_regret_by_a_summary_alone(make_run):
    """Ratios of the summary's medians; their errors are as by hand."""
    run = make_run(DESIGN.replace("trials = 20", "trials = 400"))
    cells = regret.of_summary(run.table("summary"))
    exact = (
        regret.of_run(run).set_index(["cell", "estimator"]).loc[[*zip(cells["cell"], cells["estimator"], strict=True)]]
    )
    np.testing.assert_allclose(cells["median"], exact["median"], rtol=0.05)  # errors over bound, and errors
    one = run.table("summary").iloc[0]
    by_hand = cells["median"][0] * one["ratio_median_error"] / one["ratio_median"]
    assert cells["median_error"][0] == pytest.approx(by_hand)
    rough, paired = (
        regret.regret(part).query("samples == 0").set_index("estimator") for part in (cells, regret.of_run(run))
    )
    np.testing.assert_allclose(rough["median"], paired["median"], rtol=0.05)
    part = cells[cells["estimator"] == "gdke"]
    mean = float(np.exp(np.log(part["median"]).mean()))
    spread = math.sqrt(((part["median_error"] / part["median"]) ** 2).sum()) / len(part)
    assert rough.loc["gdke", "median_error"] == pytest.approx(mean * spread)
