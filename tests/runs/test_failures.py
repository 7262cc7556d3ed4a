"""Failures are rows: of a trial that raises, and of a unit that no worker survives; everything else goes on."""

from dataclasses import replace

import pytest

import study
from study.estimators import Status
from study.runs import jobs as module
from study.runs.finish import complaint
from study.runs.workers import dispatch

pytestmark = pytest.mark.usefixtures("same_software", "small_units")

LLS = {"estimators": ["mle", "lls"]}


@pytest.fixture
def raises(monkeypatch):
    """An estimator that raises where there are 40 samples."""

    def function(samples):
        if samples.shape[2] == 40:
            raise ZeroDivisionError("my own mistake")
        return study.ESTIMATORS["lls"](samples)

    monkeypatch.setitem(study.ESTIMATORS, "raises", replace(study.ESTIMATORS["lls"], function=function))


@pytest.mark.usefixtures("raises")
@pytest.mark.parametrize("jobs", [1, 2])
def test_an_exception_is_rows(start, jobs):
    """Its trials have the status, and a line each in the table of failures; all others have their numbers."""
    run = start({"estimators": ["raises", "lls"]}, jobs=jobs)
    errors, failures = run.table("errors"), run.table("failures")
    failed = errors["status"] == Status.FAILED
    assert set(errors["estimator"][failed]) == {"raises"}
    assert set(errors["samples"][failed]) == {40}
    assert errors["error"][failed].isna().all()
    names = ["cell", "trial", "estimator"]
    assert failures[names].astype(str).values.tolist() == errors[failed][names].astype(str).values.tolist()
    assert set(failures["message"]) == {"ZeroDivisionError: my own mistake"}
    said = run.manifest()
    assert (said["failures"], said["lost"], said["fits"]) == (12, 0, 48)


@pytest.mark.usefixtures("raises")
def test_what_is_tolerated(start):
    """A complete run is complained of where a larger share failed than its config tolerates."""
    top = {"estimators": ["raises", "lls"]}
    assert "12 of 48 fits raised" in complaint(start(top))
    assert "tolerate_failures = 0.24" in complaint(start(top | {"tolerate_failures": 0.24}))
    assert complaint(start(top | {"tolerate_failures": 0.25})) is None
    assert complaint(start(LLS)) is None


def test_tolerance_does_not_name_the_run(start):
    """It says what to think of a run, not what is in it: the run is the same."""
    run = start(LLS)
    assert start(LLS | {"tolerate_failures": 0.5}, folder=run.folder).study.run_name() == run.study.run_name()


def test_no_failures_no_table(start):
    """A run without failures has no table of them, nor keeps that of an earlier version."""
    run = start(LLS)
    assert not run.has("failures")


class Broken(dispatch.Threads):
    """Workers that die of some cells."""

    deadly: frozenset[str] = frozenset()
    deaths = 0
    once = False

    def submit(self, function, shared, items):
        """Die of a task with a deadly cell in it."""
        kind = type(self)

        def call():
            names = {cell.name for job in items for cell in job.span.group.cells}
            if names & kind.deadly and not (kind.once and kind.deaths):
                kind.deaths += 1
                raise dispatch.BrokenExecutor("gone")
            return function(shared, items)

        return self._pool.submit(call)


@pytest.fixture
def deadly(monkeypatch, start):
    """Let workers die of one cell of a study with independent draws; its name."""
    name = start({"estimators": ["lls"]}, draws="independent").table("errors")["cell"].astype(str).iloc[10]
    monkeypatch.setattr(dispatch, "Threads", Broken)
    monkeypatch.setattr(Broken, "deadly", frozenset([name]))
    monkeypatch.setattr(Broken, "deaths", 0)
    return name


def test_a_deadly_unit_is_tried_twice_and_recorded(start, deadly, computed):
    """It costs itself alone; its rows are failures, and all others are there."""
    run = start(LLS, draws="independent")
    assert Broken.deaths == 2
    errors, failures = run.table("errors"), run.table("failures")
    assert set(errors["cell"][errors["status"] == Status.FAILED]) == {deadly}
    assert set(failures["cell"]) == {deadly}
    assert set(failures["cause"]) == {"worker"}
    assert set(failures["message"]) == {"the worker died, twice: gone"}
    assert len(failures) == run.manifest()["lost"] == 3 * 2
    assert len(errors) == 8 * 3 * 2


def test_a_worker_that_dies_once(start, deadly, monkeypatch):
    """The unit is tried again, and nothing shows."""
    monkeypatch.setattr(Broken, "once", True)
    run = start(LLS, draws="independent")
    assert Broken.deaths == 1
    assert not run.has("failures")
    assert run.manifest()["failures"] == 0


def test_lost_units_are_tried_again_by_the_next_run(start, deadly, computed, monkeypatch):
    """A finished run with lost units is finished again where there is more memory, say: only they are computed."""
    run = start(LLS, draws="independent")
    computed.clear()
    monkeypatch.setattr(Broken, "deadly", frozenset())
    start(LLS, folder=run.folder, warn=str, draws="independent")
    assert {cell for cell, *_ in computed} == {deadly}
    assert not run.has("failures")
    assert run.path("errors").read_bytes() == start(LLS, draws="independent").path("errors").read_bytes()


def test_out_of_memory_is_a_death(start, monkeypatch, computed):
    """A unit that takes more memory than there is, is tried alone and then recorded."""
    real = module.compute

    def greedy(made, unit, reduce=None):
        if unit.batches[0].samples == 40:
            raise MemoryError("cannot allocate")
        return real(made, unit, reduce)

    monkeypatch.setattr(module, "compute", greedy)
    run = start(LLS)
    assert set(run.table("failures")["message"]) == {"the worker died, twice: cannot allocate"}
    assert run.manifest()["lost"] == 4 * 3 * 2
