"""The run folder: its files when a run is done, and the folders that are refused.

One writer at a time: a second one is refused with the name of the first, unless that one has died.
"""

import os
import signal
import socket
import subprocess
import sys

import pytest

from study.files import RunError, holder, writing
from study.simulation.experiment.config import parse
from study.simulation.runs.parts import Layout

pytestmark = pytest.mark.usefixtures("same_software")


def test_a_foreign_folder(start, tmp_path, files_of):
    """A file is not overwritten, and nothing is made below one; a folder with other things is left as it is.

    An empty folder is taken; a name that the disk refuses gives one clear line.
    """
    path, other, empty = (tmp_path / name for name in ("taken", "other", "empty"))
    path.write_text("mine")
    empty.mkdir()
    other.mkdir()
    (other / "thesis.tex").write_text("mine")
    assert start(folder=empty).folder == empty
    for folder, words in (
        (path, "is a file"),
        (path / "below", "Not a directory"),
        (other, "not empty and no run folder"),
        (tmp_path / ("a" * 300), "too long"),
    ):
        with pytest.raises(RunError, match=words):
            start(folder=folder)
    assert path.read_text() == "mine"
    assert files_of(other) == {"thesis.tex": b"mine"}


def test_a_folder_of_a_run_that_was_killed_in_its_first_write(start, tmp_path, files_of):
    """A lock and a temporary file of the config make no foreign folder; the temporary file is removed."""
    folder = tmp_path / "killed"
    folder.mkdir()
    (folder / ".config.toml.123.tmp").write_text("name = ")
    (folder / ".lock").touch()
    assert start(folder=folder).valid("errors")
    assert not list(folder.glob(".*.tmp"))


def test_a_folder_whose_config_is_broken(start, files_of):
    """A config that cannot be read any more is reported, not replaced, where no manifest says whose run it is."""
    run = start()
    (run.folder / "manifest.json").unlink()
    (run.folder / "config.toml").write_text("seed = ")
    before = files_of(run.folder)
    with pytest.raises(RunError, match="cannot be read any more"):
        start(folder=run.folder)
    assert files_of(run.folder) == before


def test_a_unit_is_named_by_its_content(make_text):
    """A unit's key depends on all that determines its rows, not on its position, the grid or other estimators."""

    def keys(top=None, **design):
        study = parse(make_text(top, **design))
        return {Layout(study).task(unit).key for unit in study.units()}

    alone = keys(samples=[40])
    assert alone < keys(samples=[6, 40])
    for top in ({"name": "other"}, {"estimators": ["lls"]}, {"keep_points": 1}, {"tolerate_failures": 0.5}):
        assert keys(top, samples=[40]) == alone
    for change in ({"top": {"seed": 2}}, {"top": {"dimension": 2}}, {"draws": "independent"}, {"noise": [0.1]}):
        assert not keys(**({"samples": [40]} | change)) & alone


HOLD = """
import sys
from pathlib import Path
from study.files import writing
with writing(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def other(tmp_path):
    """Another process that holds the lock of a folder until it is killed."""
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, encoding="utf-8")
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


def test_one_writer_at_a_time(other, tmp_path):
    """A second one is refused in a line with process and host; the lock's file of a killed writer does not matter.

    The lock is released, and its file removed, in the end and after an exception.
    """
    first = f"process {other.pid} on {socket.gethostname()}"
    assert holder(tmp_path) == first
    with pytest.raises(RunError, match=rf"^[^\n]*{first} is writing to it[^\n]*$"), writing(tmp_path):
        pass
    assert holder(tmp_path) is not None  # still the other's
    os.kill(other.pid, signal.SIGKILL)
    other.wait()
    assert (tmp_path / ".lock").exists()
    assert holder(tmp_path) is None
    with writing(tmp_path):
        assert holder(tmp_path) == f"process {os.getpid()} on {socket.gethostname()}"
    with pytest.raises(ZeroDivisionError), writing(tmp_path):
        raise ZeroDivisionError
    assert holder(tmp_path) is None
    assert list(tmp_path.iterdir()) == []


def test_a_lock_without_words(tmp_path):
    """The file's content is only for a message, so that nonsense in it does no harm."""
    with writing(tmp_path):
        for text in ("", "{}", "[1]", "\x00"):
            (tmp_path / ".lock").write_text(text)
            assert holder(tmp_path) == "another process"
