"""Resumed runs: finished units are not computed again, and the tables are those of an unbroken run.

Disks that are full or read-only: one clear message, finished parts stay readable, no temporary file stays.
"""

import contextlib
import errno
import itertools
import math
import os
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

import study
from study.files import RunError
from study.simulation.runs import parts, provenance, runner
from study.simulation.runs.parts import Layout, Parts

pytestmark = pytest.mark.usefixtures("same_software", "small_units", "small_parts")

ENTRIES = {"top": {"keep_points": 2}, "trials": 40}


class Stop(BaseException):
    """Raised in a run to stop it."""


@pytest.fixture
def clock(monkeypatch):
    """Let a second go by each time that parts ask for the time."""
    monkeypatch.setattr(parts, "time", SimpleNamespace(monotonic=itertools.count().__next__))


@pytest.fixture
def killed_at(start, monkeypatch):
    """Run a study whose process ends at a step on the disk: from then on nothing is synced, renamed or removed."""

    def run(step, **arguments):
        steps = itertools.count()

        def dying(function):
            def act(path, *others, **options):
                if not str(path).endswith(".lock") and next(steps) >= step:
                    raise Stop
                return function(path, *others, **options)

            return act

        with monkeypatch.context() as patch:
            for name in ("fsync", "replace", "rename", "unlink"):
                patch.setattr(os, name, dying(getattr(os, name)))
            return start(**arguments)

    return run


@pytest.fixture
def stopped(killed_at, tmp_path):
    """A run that ended after three parts, at the twelfth step on the disk, in a folder."""
    with pytest.raises(Stop):
        killed_at(12, folder=tmp_path / "run", **ENTRIES)
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


MEASURED = {"keep_points": 2, "measures": ["own_errors", "jaccard"]}


@pytest.mark.parametrize(
    "top", [{"keep_points": 2}, {"keep": "summary"}, MEASURED], ids=["errors", "summary", "measures"]
)
def test_a_run_killed_at_any_step(killed_at, start, computed, tmp_path, top):
    """Resumed, it has the bytes of an unbroken run, and computes what is not stored, and no more; nothing stays behind.

    What was stored at one step is so at all later ones. Every other time a part is damaged, and computed again.
    """
    small = {"top": top, "trials": 20, "noise": 0.05, "angle": 60, "jobs": 1}
    whole, least = start(**small), math.inf
    tasks = [Layout(whole.study).task(unit) for unit in whole.study.units()]

    def tables(run):
        return {name: digest for name, digest in run.manifest()["tables"].items() if name != "timings"}

    def missing(folder):
        stored = Parts(folder, "units")
        stored.load(set_aside=False)
        finished = (folder / "manifest.json").exists()
        return 0 if finished else 4 * sum(task.batch.rows for task in tasks if not stored.outputs(task.key))

    for step in itertools.count():
        folder = tmp_path / f"killed-{step}"
        with contextlib.suppress(Stop):
            killed_at(step, folder=folder, **small)
            break
        assert missing(folder) <= least, step
        least = missing(folder)
        for path in sorted((folder / "parts").glob("[!.]*.part"))[: step % 2]:
            path.write_bytes(path.read_bytes()[:-9])
        expected = missing(folder)
        computed.clear()
        assert tables(start(folder=folder, warn=str, **small)) == tables(whole), step
        assert len(computed) == expected, step
        assert not list(folder.rglob("*.tmp")), step
        assert not list((folder / "parts").glob("*.part")), step
    assert step > 3 * len(tasks) >= 6


def test_trials_by_need_killed(killed_at, start, tables, tmp_path):
    """Killed in a round or as tables are joined, and resumed, they have the bytes of an unbroken run."""
    top = {"estimators": ["lls", "ugdk"], "keep_points": 2, "precision": {"relative_target": 0.08, "first": 100}}
    needs = {"top": top, "trials": 400, "samples": 6, "noise": [0.02, 0.6], "angle": 180, "jobs": 1}
    whole = start(**needs)
    for step in itertools.count(0, 11):
        folder = tmp_path / f"killed-{step}"
        with contextlib.suppress(Stop):
            killed_at(step, folder=folder, **needs)
            break
        run = start(folder=folder, warn=str, **needs)
        assert tables(run) == tables(whole), step
        assert run.path("precision").read_bytes() == whole.path("precision").read_bytes(), step
        assert not list(folder.rglob("*.tmp")), step
    assert step > 33


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


def broken_after(monkeypatch, count, name="replace", code=errno.ENOSPC):
    """Let renaming, or syncing, fail from a given call on."""
    calls = iter(range(10**6))
    real = getattr(os, name)

    def fail(*arguments):
        if next(calls) >= count:
            raise OSError(code, os.strerror(code))
        return real(*arguments)

    monkeypatch.setattr(os, name, fail)


def parts_and_rest(folder):
    """Paths of the parts, and names of all else in a run folder."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    found = Parts(folder, "units")
    found.load(set_aside=False)
    assert not found.damaged
    parts = [path for path in paths if path.parent.name == "parts" and not path.name.startswith(".")]
    return parts, sorted(str(path.relative_to(folder)) for path in set(paths) - set(parts))


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize(("name", "calls"), [("replace", 4), ("fsync", 8)])
def test_a_disk_that_fills_up_while_parts_are_written(start, monkeypatch, tmp_path, jobs, name, calls):
    """Parts written before stay, whole and readable; the message names the folder and the reason."""
    broken_after(monkeypatch, calls, name)
    folder = tmp_path / "run"
    with pytest.raises(RunError, match=r"cannot be written: No space .*; what was finished is kept") as caught:
        start(folder=folder, jobs=jobs, trials=30)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)
    parts, rest = parts_and_rest(folder)
    assert len(parts) == 3  # the first of the four was the config; each syncs a file and its folder
    assert rest == ["config.toml"]


def test_a_small_disk(start, small_disk, tables):
    """Once there is room again, the run has the bytes of an unbroken one."""
    folder, fill, empty = small_disk
    if not fill():
        pytest.skip("a disk cannot be mounted here")
    empty()
    with pytest.raises(RunError, match=r"cannot be written: No space .*; what was finished is kept"):
        start(folder=folder, progress=lambda *numbers: fill(), **ENTRIES)
    empty()
    assert tables(start(folder=folder, **ENTRIES)) == tables(start(**ENTRIES))


def test_a_disk_that_fills_up_while_parts_are_joined(start, monkeypatch, tmp_path):
    """If the last step fails, all parts stay."""
    monkeypatch.setattr(runner.Run, "join", Mock(side_effect=RunError("cannot be written: No space left")))
    with pytest.raises(RunError, match="cannot be written"):
        start(folder=tmp_path / "run", trials=30)
    parts, rest = parts_and_rest(tmp_path / "run")
    assert len(parts) > 3
    assert rest == ["config.toml"]


def test_old_tables_survive_a_failure(start, monkeypatch, files_of):
    """A new version that cannot be written leaves the old tables as they were, and no temporary file."""
    run = start(trials=30)
    before = files_of(run.folder)
    monkeypatch.setitem(study.ESTIMATORS, "mle", replace(study.ESTIMATORS["mle"], version=2))
    broken_after(monkeypatch, 4)
    with pytest.raises(RunError):
        start(folder=run.folder, trials=30, warn=str)
    after = files_of(run.folder)
    assert {name: after.get(name) for name in before} == before
    assert not [name for name in after if name.endswith(".tmp")]


@pytest.mark.parametrize("code", [errno.EROFS, errno.EACCES, errno.EDQUOT, errno.EIO])
def test_other_reasons_are_told_too(start, monkeypatch, tmp_path, code):
    """The message of the system is in the message of the run, and nothing is computed."""
    broken_after(monkeypatch, 0, code=code)
    with pytest.raises(RunError, match=os.strerror(code)):
        start(folder=tmp_path / "run", progress=pytest.fail)
