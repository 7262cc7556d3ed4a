"""Dispatch: units are computed outside the main thread, progress adds up, and no result is lost or waits for long."""

import contextlib
import threading

import pytest

import study
from study.estimators.estimator import Estimator
from study.experiment.config import parse
from study.experiment.units import units
from study.runs.plan import plan
from study.runs.storage.parts import Packet, Parts
from study.runs.workers.dispatch import Dispatch
from study.runs.workers.threads import Threads

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


class Growing(Threads):
    """Threads that always seem to have become more."""

    def outgrown(self):
        """Let each call of joblib end after its first task."""
        return True


@pytest.fixture
def dispatch(tmp_path):
    """Send numbers to two threads, one at a time, to a function that may return or raise."""

    def send(function, count, ended, kind=Threads):
        def work(shared, items):
            function(*items)
            return Packet.of([(str(items[0]), ("number@1",))], [{}])

        parts = Parts(tmp_path, "numbers")
        with contextlib.closing(kind(2)) as backend:
            Dispatch(backend, work, None, parts).compute(range(count), lambda number: 1e9, ended)
        return parts

    return send


def test_results_do_not_pile_up(dispatch):
    """While storing a result takes long, only some more tasks are computed; in the end all are."""
    computed, stored, ahead, enough = [], [], [], threading.Event()

    def function(number):
        computed.append(number)
        ahead.append(len(computed) - len(stored))
        if len(computed) == 9:
            enough.set()

    def ended(numbers, failure):
        assert enough.wait(600)
        stored.extend(numbers)

    parts = dispatch(function, 200, ended)
    assert sorted(stored) == sorted(computed) == list(range(200))
    assert all(parts.outputs(str(number)) for number in range(200))
    assert 8 <= max(ahead) <= 14


def test_workers_that_become_more(dispatch):
    """Each call of joblib may end early, so that it counts the workers again; all tasks are computed once."""
    stored = []
    dispatch(lambda number: None, 20, lambda numbers, failure: stored.extend(numbers), Growing)
    assert sorted(stored) == list(range(20))


def test_what_came_is_stored_when_a_task_raises(dispatch, tmp_path):
    """The exception comes out; tasks that were finished then are stored, and no other is begun."""
    computed = []

    def function(number):
        if number == 30:
            raise ZeroDivisionError("my own mistake")
        computed.append(number)

    with pytest.raises(ZeroDivisionError, match="my own mistake"):
        dispatch(function, 1000, lambda numbers, failure: None)
    parts = Parts(tmp_path, "numbers")
    parts.load()
    assert {number for number in range(1000) if parts.outputs(str(number))} == set(computed)
    assert 29 <= len(computed) < 60
