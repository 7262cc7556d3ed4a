import numpy as np
import pandas as pd
import pytest

from study.fits import Status
from study.simulation.analysis import summary
from study.simulation.analysis.summary import worst


def table(*rows):
    """An error table of (cell, trial, estimator, error, bound, status)."""
    return pd.DataFrame(rows, columns=["cell", "trial", "estimator", "error", "bound", "status"])


def found(frame):
    """The rows in short."""
    return [(row.cell, row.trial, row.estimator, row.ratio) for row in frame.itertuples()]


OK, FAILED = int(Status.OK), int(Status.NOT_CONVERGED)
ERRORS = table(
    ("b", 0, "mle", 3.0, 1.0, OK),
    ("b", 0, "gdke", 4.0, 1.0, OK),  # the worse of the same trial
    ("a", 0, "mle", 1.0, 0.5, OK),  # another cell's trial of the same number
    ("a", 1, "mle", 9.0, 1.0, FAILED),
    ("a", 1, "gdke", 0.1, 1.0, OK),
    ("a", 2, "mle", 8.0, np.inf, OK),  # the directions do not determine the centre
    ("a", 3, "mle", np.nan, 1.0, OK),
    ("a", 4, "mle", np.inf, 1.0, OK),  # lost without saying so: the worst there is
)


def test_largest_error_over_the_bound_of_each_trial():
    """A trial counts once, by its worst ok fit; infinite bounds and missing errors do not count."""
    expected = [("a", 4, "mle", np.inf), ("b", 0, "gdke", 4.0), ("a", 0, "mle", 2.0), ("a", 1, "gdke", 0.1)]
    assert found(worst(ERRORS)) == expected
    assert found(worst(ERRORS, 2)) == expected[:2]
    assert list(worst(ERRORS, 2).index) == [0, 1]


def test_one_estimator():
    """Only the estimator's fits are used; an estimator that is not in the table has none."""
    assert found(worst(ERRORS, estimator="gdke")) == [("b", 0, "gdke", 4.0), ("a", 1, "gdke", 0.1)]
    assert found(worst(ERRORS, estimator="mle"))[1] == ("b", 0, "mle", 3.0)
    assert worst(ERRORS, estimator="ugdk").empty


@pytest.mark.parametrize("seed", range(4))
def test_order_of_equal_ones(seed):
    """Ties are in the order of cell, trial and estimator by name, whatever the table's order and its categories."""
    rows = [(cell, trial, name, 2.0, 1.0, OK) for cell in "cab" for trial in (10, 9) for name in ("mle", "gdke")]
    frame = table(*rows).sample(frac=1.0, random_state=seed)
    for name in ("cell", "estimator"):  # as they are stored: dictionaries in the order of first appearance
        frame[name] = pd.Categorical(frame[name], categories=list(dict.fromkeys(frame[name])))
    expected = [(cell, trial, "gdke", 2.0) for cell in "abc" for trial in (9, 10)]
    assert found(worst(frame, 6)) == expected


def test_the_table_is_left_as_it_is():
    """Nothing is written into the table that is given, and all its columns come back."""
    before = ERRORS.copy()
    assert [*ERRORS.columns, "ratio"] == list(worst(ERRORS).columns)
    assert before.equals(ERRORS)
    assert worst(ERRORS[:0]).empty


def test_part_by_part(circles, random, monkeypatch):
    """The worst trials of a run, found some rows at a time, are those of its whole error table."""
    for run in (circles, random):
        errors, by_decade = run.table("errors"), run.study.design.one_trial_a_cell
        parts = np.array_split(np.arange(len(errors)), 7)
        monkeypatch.setattr(summary, "_parts", lambda _, e=errors, p=parts: (e.iloc[rows] for rows in p))
        trials, of_groups = summary.worst_of_run(run, 6)
        told = worst(errors, 6)
        pd.testing.assert_frame_equal(trials[told.columns], told, check_dtype=False)
        pd.testing.assert_frame_equal(summary.of_run(run, 6)[told.columns], told, check_dtype=False)
        keys = ["group", "estimator"]
        whole = summary.worst_of_groups(errors, by_decade).sort_values(keys, ignore_index=True)
        pd.testing.assert_frame_equal(of_groups.sort_values(keys, ignore_index=True), whole)
