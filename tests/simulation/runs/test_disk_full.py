"""Disks that are full or read-only: one clear message, finished parts stay readable, no temporary file stays."""

import errno
import os
from dataclasses import replace
from unittest.mock import Mock

import pytest

import study
from study.files import RunError
from study.simulation.runs import runner
from study.simulation.runs.parts import Parts

pytestmark = pytest.mark.usefixtures("same_software", "small_units", "small_parts")


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
