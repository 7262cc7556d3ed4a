"""A grown study keeps its old rows, bit for bit: more values on an axis, more trials, more estimators."""

import numpy as np
import pandas as pd
import pytest

pytestmark = pytest.mark.usefixtures("same_software")

KEY = ["cell", "trial", "estimator"]
SMALL = {"trials": 1, "samples": [7, 40], "noise": [0.3], "angle": [60], "radius": [1.0], "center": [0.0]}
LARGE = {
    "trials": 1001,
    "samples": [100, 7, 20, 40],
    "noise": [0.1, 0.3, 5.0],
    "angle": [60, 90],
    "radius": [2.0, 1.0],
    "center": [0.0, 3.0],
}
SHAPE = [[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]]


def rows(run):
    """The error table by its key, and its columns in order."""
    return run.table("errors").astype({"cell": str, "estimator": str}).set_index(KEY)


def assert_kept(old, new):
    """Every old row is among the new ones with the same bits; NaN stays NaN."""
    assert len(new) > len(old)
    pd.testing.assert_frame_equal(new.loc[old.index], old, check_exact=True)


@pytest.fixture(params=[2, 3, 5, "shape", "independent"])
def kind(request):
    """Arguments of a study in each dimension, of shaped noise, and of independent draws."""
    if request.param == "shape":
        return {"top": {"noise_shape": SHAPE}}
    return {"draws": "independent"} if request.param == "independent" else {"top": {"dimension": request.param}}


@pytest.mark.parametrize("axis", [*LARGE, "all"])
def test_old_rows_do_not_move(start, kind, axis):
    """A value more on any axis, more trials, or all at once, leave the rows of the old cells and trials in place."""
    small = SMALL if axis != "all" else LARGE | {"trials": 5, "samples": [7], "noise": [5.0]}
    large = SMALL | {axis: LARGE[axis]} if axis != "all" else LARGE | {"trials": 9}
    assert_kept(rows(start(**kind, **small)), rows(start(**kind, **large)))


def test_trials_of_a_random_design_do_not_move(start):
    """More trials of a random design continue the old ones."""
    laws = {
        "kind": "random",
        "samples": {"law": "log_uniform", "low": 4, "high": 500},
        "noise": {"law": "log_uniform", "low": 1e-3, "high": 10},
        "angle": {"law": "uniform", "low": 0, "high": 180},
        "center": {"law": "uniform", "low": 0, "high": 2},
    }
    assert_kept(rows(start(trials=40, **laws)), rows(start(trials=130, **laws)))


def test_estimators_do_not_move_each_other(start):
    """An estimator's rows do not depend on which others run beside it, or in which order."""
    both = rows(start({"estimators": ["ugdk", "mle", "lls"]}))
    for name in ("lls", "mle", "ugdk"):
        assert_kept(rows(start({"estimators": [name]})), both)


def test_dimensions_and_seeds_share_no_number(start):
    """Studies of another seed have other numbers: the comparisons above can fail."""
    one, two = (rows(start({"seed": seed})) for seed in (1, 2))
    assert list(one.index) == list(two.index)
    assert not np.intersect1d(one["error"].to_numpy(), two["error"].to_numpy()).size
