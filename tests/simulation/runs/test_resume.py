"""Resumed runs: finished units are not computed again, and the tables are those of an unbroken run."""

import itertools
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

import study
from study.simulation.runs import parts, provenance
from study.simulation.runs.parts import Parts
from study.simulation.runs.run_folder import Run

pytestmark = pytest.mark.usefixtures("same_software", "small_units", "small_parts")

ENTRIES = {"top": {"keep_points": 2}, "trials": 40}


class Stop(BaseException):
    """Raised by a callback for progress to stop a run."""


@pytest.fixture
def clock(monkeypatch):
    """Let a second go by each time that parts ask for the time."""
    monkeypatch.setattr(parts, "time", SimpleNamespace(monotonic=itertools.count().__next__))


@pytest.fixture
def stopped(start, let_pass, tmp_path):
    """A run that was stopped after some units, in a folder."""
    with let_pass(4, "study.simulation.runs.runner.execute"), pytest.raises(Stop):
        start(folder=tmp_path / "run", progress=Mock(side_effect=[None] * 3 + [Stop]), **ENTRIES)
    return tmp_path / "run"


def test_a_finished_run_computes_nothing(start, computed, files_of):
    """Nothing is computed, and nothing in the folder changes."""
    run = start(**ENTRIES)
    before = files_of(run.folder)
    computed.clear()
    start(folder=run.folder, **ENTRIES)
    assert computed == []
    assert files_of(run.folder) == before


@pytest.mark.parametrize("jobs", [1, 2])
def test_only_what_is_missing_is_computed(start, stopped, computed, tables, jobs):
    """Each fit is computed once, before or after the interruption, and the tables are those of an unbroken run."""
    resumed = start(folder=stopped, jobs=jobs, **ENTRIES)
    second = list(computed)
    computed.clear()
    whole = start(**ENTRIES)
    assert 0 < len(second) < len(computed)
    assert len(set(computed)) == len(computed)
    assert tables(resumed) == tables(whole)
    assert not (stopped / "parts").exists()


def test_a_run_killed_between_tables_and_manifest(start, stopped, tables, monkeypatch):
    """The parts stay until the manifest is written, so that the last step is done again."""
    with monkeypatch.context() as patch:
        patch.setattr(Run, "save_manifest", Mock(side_effect=Stop))
        with pytest.raises(Stop):
            start(folder=stopped, **ENTRIES)
    assert (stopped / "errors.parquet").exists()
    assert (stopped / "parts").exists()
    assert tables(start(folder=stopped, **ENTRIES)) == tables(start(**ENTRIES))


def test_a_run_killed_after_the_manifest(start, stopped, monkeypatch, computed):
    """Parts that a kill left beside finished tables are removed."""
    with monkeypatch.context() as patch:
        patch.setattr(Parts, "remove", Mock(side_effect=Stop))
        with pytest.raises(Stop):
            start(folder=stopped, **ENTRIES)
    computed.clear()
    start(folder=stopped, **ENTRIES)
    assert computed == []
    assert not (stopped / "parts").exists()


def test_half_written_files_are_removed(start, stopped):
    """Temporary files of a writer that was killed do not stay."""
    for path in (stopped / ".errors.parquet.77.tmp", stopped / "parts" / ".units-0.part.77.tmp"):
        path.write_bytes(b"half")
    start(folder=stopped, **ENTRIES)
    assert not [path for path in stopped.rglob("*") if path.name.endswith(".tmp")]


def test_timings_are_kept(clock, start, stopped):
    """Timings from before the interruption are in the table, and the manifest's seconds cover both parts."""
    before = Parts(stopped, "units")
    before.load()
    resumed, whole = start(folder=stopped, **ENTRIES), start(**ENTRIES)

    def fits(run):
        return run.table("timings").groupby("step", observed=True)["fits"].sum().to_dict()

    assert fits(resumed) == fits(whole)
    assert resumed.manifest()["seconds_computing"] > before.seconds > 0.0


def test_another_version_of_an_estimator_is_not_mixed_in(start, stopped, computed, tables, monkeypatch):
    """Its rows are computed again, before and after the end of a run; those of the other estimators are kept."""
    version = study.ESTIMATORS["lls"].version
    monkeypatch.setitem(study.ESTIMATORS, "lls", replace(study.ESTIMATORS["lls"], version=version + 1))
    run = start(folder=stopped, **ENTRIES)
    fits = {(cell, trial) for cell, trial, _ in computed}
    assert len({(c, t) for c, t, e in computed if e == "lls"}) == 40 * 8
    assert sum(e == "mle" for *_, e in computed) < 40 * 8
    before = tables(run)
    computed.clear()
    monkeypatch.setitem(study.ESTIMATORS, "lls", replace(study.ESTIMATORS["lls"], version=version + 2))
    told = []
    again = start(folder=run.folder, warn=told.append, **ENTRIES)
    assert {e for *_, e in computed} == {"lls"}
    assert {(c, t) for c, t, _ in computed} == fits
    assert tables(again) == before  # the numbers have not changed but for the version
    assert again.manifest()["estimators"]["lls"] == version + 2
    assert any("are taken from" in line for line in told)


def test_software_that_changed_is_told(start, stopped, monkeypatch):
    """There is a warning if another version computed some of the rows, and the manifest has it."""
    real = provenance.software()
    monkeypatch.setattr(provenance, "software", lambda: real | {"study": "0.0.9", "commit": "f" * 40})
    told = []
    run = start(folder=stopped, warn=told.append, **ENTRIES)
    assert "resumes what version" in told[0]
    assert run.manifest()["also_computed_by"] == [real]
