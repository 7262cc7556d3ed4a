"""One writer at a time: a second one is refused with the name of the first, unless that one has died."""

import os
import signal
import socket
import subprocess
import sys

import pytest

from study.runs.storage.atomic_write import RunError
from study.runs.storage.lock import holder, writing

pytestmark = pytest.mark.usefixtures("same_software")

HOLD = """
import sys
from pathlib import Path
from study.runs.storage.lock import writing
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


def test_a_second_writer_is_told_who_is_first(other, tmp_path):
    """Process and host are in the message, which is one line."""
    words = f"process {other.pid} on {socket.gethostname()} is writing to it"
    assert holder(tmp_path) == f"process {other.pid} on {socket.gethostname()}"
    with pytest.raises(RunError, match=words) as told, writing(tmp_path):
        pass
    assert "\n" not in str(told.value)
    assert holder(tmp_path) is not None  # still the other's


def test_a_dead_writer_holds_nothing(other, tmp_path):
    """The lock's file that a killed writer left does not matter."""
    os.kill(other.pid, signal.SIGKILL)
    other.wait()
    assert (tmp_path / ".lock").exists()
    assert holder(tmp_path) is None
    with writing(tmp_path):
        assert holder(tmp_path) == f"process {os.getpid()} on {socket.gethostname()}"
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_left(tmp_path):
    """The lock is released, and its file removed, in the end and after an exception."""
    with pytest.raises(ZeroDivisionError), writing(tmp_path):
        raise ZeroDivisionError
    assert holder(tmp_path) is None
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_written_to_is_left_alone(start, tmp_path, files):
    """A second run of the same config is refused, and nothing in the folder is touched."""
    run = start()
    before = files(run.folder)
    with writing(run.folder), pytest.raises(RunError, match=f"process {os.getpid()} on .* is writing to it"):
        start(folder=run.folder)
    assert files(run.folder) == before


def test_a_lock_without_words(tmp_path):
    """The file's content is only for a message, so that nonsense in it does no harm."""
    with writing(tmp_path):
        for text in ("", "{}", "[1]", "\x00"):
            (tmp_path / ".lock").write_text(text)
            assert holder(tmp_path) == "another process"
