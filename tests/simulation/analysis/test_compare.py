"""Two runs compared: identical, the same within Monte-Carlo error, or different, and where."""

from dataclasses import replace

import numpy as np
import pytest

import study
from study.files import RunError
from study.simulation.analysis import compare as compare_module
from study.simulation.analysis.compare import Difference, printed
from tests.configs import config

CONFIG = config({"name": "pair", "estimators": ["lls", "ugdk"]}, trials=200, samples=[20, 60], noise=[0.01, 0.1])


@pytest.fixture
def make(make_run, tmp_path):
    """Run a config with words replaced, into a new folder, with its summary."""

    def made(name, *changes):
        text = CONFIG
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        return make_run(text, tmp_path / name)

    return made


@pytest.fixture
def altered(monkeypatch):
    """Alter what LLS answers, by a function of its fit."""

    def alter(change):
        good = study.ESTIMATORS["lls"]

        def other(samples):
            fit = good(samples)
            change(fit)
            return fit

        monkeypatch.setitem(study.ESTIMATORS, "lls", replace(good, function=other, version=2))

    return alter


def verdict(found):
    """The last words of the first line."""
    return next(iter(printed(found))).split(": ")[-1]


def without_errors(made):
    """A run with its summary alone, like a reference run."""
    made.remove("errors")
    return made


def test_identical(make):
    """Equal runs are equal in all comparisons, by their errors and by their summaries."""
    one, other = make("one"), make("other")
    found = Difference(one, other)
    assert found.identical
    assert not found.different
    assert len(found.comparisons) == 2 * 4
    assert verdict(found) == "identical"
    found = Difference(without_errors(one), other)
    assert found.identical
    assert "summaries" in found.how


@pytest.mark.parametrize("by_summary", [False, True])
@pytest.mark.parametrize("change", [("seed = 1", "seed = 2"), ("trials = 200", "trials = 500")], ids=str)
def test_the_same_within_monte_carlo_error(make, change, by_summary):
    """Another seed, or more trials where errors are not stored: the same, which fails once in a thousand seeds.

    With more trials, those that both have are identical by their errors.
    """
    one, other = make("one"), make("other", change)
    found = Difference(without_errors(one) if by_summary else one, other)
    assert not found.different
    grown = change[0] == "trials = 200" and not by_summary
    words = "identical in the trials that both have" if grown else "the same within Monte-Carlo error"
    assert verdict(found) == words
    assert set(found.comparisons["equal"]) == {grown}
    assert set(found.comparisons["same_trials"]) == {by_summary and change[0] == "seed = 1"}


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("by_summary", [False, True])
def test_different(make, altered, seed, by_summary):
    """An estimator that got worse by half is found, with draws shared or not, and named; the other is the same."""
    one = make("one")
    altered(lambda fit: np.multiply(fit.center, 1.5, out=fit.center))  # the truth is the origin
    changes = [("seed = 1", f"seed = {seed}")] if seed != 1 else []
    found = Difference(without_errors(one) if by_summary else one, make("other", *changes))
    assert found.different
    assert set(found.comparisons["estimator"][found.comparisons["different"]]) == {"lls"}
    lines = list(printed(found))
    assert verdict(found) == "different"
    assert any(line.startswith("  !  N = ") and ", lls  " in line and "cell " in line for line in lines)


def test_a_change_of_rounding_is_none(make, altered):
    """Errors that differ in the tenth digit are the same, though not identical."""
    one = make("one")
    altered(lambda fit: np.multiply(fit.center, 1.0 + 1e-10, out=fit.center))
    found = Difference(one, make("other"))
    assert not found.different
    assert not found.identical


def test_more_failures_are_a_difference(make, altered):
    """Fits that are not ok any more count as worse than any."""
    one = make("one")
    altered(lambda fit: fit.status[::3].fill(study.Status.NOT_CONVERGED))
    assert Difference(one, make("other")).different


def test_names_of_cells_and_decades(make):
    """A cell whose name begins like a power of ten is no decade."""
    row = make("one").table("summary").iloc[0]
    assert compare_module._words(row, ("1e45ab0c12", "als")).endswith(", cell 1e45ab0c12")
    assert compare_module._words(row, ("1e-03", "als")) == "σ/r = 1e-03 …"


def test_cells_that_one_run_lacks(make):
    """Cells of one run alone are counted; two runs with nothing in common are refused."""
    one, other = make("one"), make("other", ("[20, 60]", "[60, 80]"))
    found = Difference(one, other)
    assert found.only == (4, 4)
    assert found.identical
    assert verdict(found) == "identical in the trials that both have"
    with pytest.raises(RunError, match="no cell and estimator is in both"):
        Difference(one, make("third", ("[20, 60]", "[10, 80]")))
