"""Dispatch: units are computed outside the main thread, and progress adds up."""

import threading

import pytest

import study
from study.estimators.estimator import Estimator
from study.experiment.config import parse
from study.experiment.units import units
from study.runs.plan import plan

pytestmark = pytest.mark.usefixtures("same_software")


@pytest.mark.parametrize("jobs", [1, 2])
def test_units_are_computed_outside_the_main_thread(start, monkeypatch, jobs):
    """No worker is the main thread, which is the one that Ctrl-C interrupts, whatever the number of workers.

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


@pytest.mark.usefixtures("small_parts")
def test_progress_is_told_to_the_end(start, make_text):
    """The callback is called once per task, with shares that add up to 1."""
    shares = []
    start(progress=shares.append)
    assert len(shares) == len(list(units(parse(make_text()))))
    assert sum(shares) == pytest.approx(1.0)
    assert min(shares) > 0.0
