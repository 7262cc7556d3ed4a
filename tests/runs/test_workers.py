"""Workers: where units are computed, what is told of their progress, and what an estimator that raises leaves."""

import threading

import pyarrow.parquet as pq
import pytest

import study
from study.estimators.fit import Estimator
from study.experiment.config import parse
from study.experiment.design import units
from study.experiment.work import WorkError
from study.runs import runner
from study.runs.plan import plan

pytestmark = pytest.mark.usefixtures("same_software")


@pytest.mark.parametrize("jobs", [1, 2])
def test_units_are_computed_outside_the_main_thread(start, monkeypatch, jobs):
    """Whatever the number of workers, none is the main thread, which is the one that Ctrl-C interrupts.

    Numba 0.68 ends the process with a segmentation fault if an exception rises while it unboxes a Generator.
    """
    good, threads = study.ESTIMATORS["lls"], set()

    def watched(samples):
        threads.add(threading.current_thread())
        return good(samples)

    monkeypatch.setitem(study.ESTIMATORS, "watched", Estimator(watched))
    start({"estimators": ["watched"]}, jobs=jobs)
    assert threads
    assert threading.main_thread() not in threads
    assert len(threads) <= jobs


def test_a_plan_is_calibrated_outside_the_main_thread(make_text, monkeypatch):
    """For the same reason, the calibration of a plan is not computed in the main thread."""
    good, threads = study.ESTIMATORS["lls"], set()

    def watched(samples):
        threads.add(threading.current_thread())
        return good(samples)

    monkeypatch.setitem(study.ESTIMATORS, "watched", Estimator(watched))
    plan(parse(make_text({"estimators": ["watched"]})), 2)
    assert threads
    assert threading.main_thread() not in threads


def test_progress_is_told_to_the_end(start, make_text):
    """Progress is told once per unit, in shares that add up to 1."""
    shares = []
    start(progress=shares.append)
    assert len(shares) == len(list(units(parse(make_text()))))
    assert sum(shares) == pytest.approx(1.0)
    assert min(shares) > 0.0


@pytest.mark.usefixtures("small_units")
@pytest.mark.parametrize("jobs", [1, 2])
def test_an_estimator_that_raises_ends_the_run(start, monkeypatch, tmp_path, jobs):
    """What an estimator raises in a worker reaches the caller by name, without warnings; finished parts stay."""
    good = study.ESTIMATORS["lls"]

    def sometimes(samples):
        if samples.shape[2] == 40:
            raise ZeroDivisionError("my own mistake")
        return good(samples)

    monkeypatch.setitem(study.ESTIMATORS, "sometimes", Estimator(sometimes))
    monkeypatch.setattr(runner, "weight", lambda unit: 1.0 / unit.batches[0].samples)
    with pytest.raises(WorkError, match=r"sometimes on cell [0-9a-f]{10}, trials .*my own mistake"):
        start({"estimators": ["sometimes"]}, jobs=jobs, folder=tmp_path / "run", trials=30)
    parts = list((tmp_path / "run" / "parts").iterdir())
    assert parts or jobs > 1  # of what other workers had finished, all may still have been on its way
    assert all(set(pq.read_table(path)["samples"].to_pylist()) == {6} for path in parts)
