"""Interrupted runs end with code 130 and one line, and keep the finished parts; killed ones leave no workers."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import psutil
import pytest

from study import cli
from study.runs.storage.parts import Parts
from study.runs.workers.backend import leave_interrupts

# 200 units, of which the gate lets some pass
LONG = """name = "long"
seed = 1
estimators = ["lls"]
[design]
kind = "grid"
trials = 200_000
samples = 1000
noise = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]
angle = 90
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to another process")
@pytest.mark.parametrize(
    ("backend", "jobs", "number"),
    [("threads", 1, signal.SIGINT), ("threads", 2, signal.SIGTERM), ("loky", 2, signal.SIGINT)],
)
def test_interrupt(hold, tmp_path, backend, jobs, number):
    """Ctrl-C and SIGTERM end a run with code 130 and one line; its parts are whole, temporary files are gone."""
    (tmp_path / "long.toml").write_text(LONG)
    parts = tmp_path / "out" / "parts"
    options = ["--out", "out", "--jobs", jobs, "--backend", backend]
    process = hold(tmp_path, parts, jobs, "run", "long.toml", *options)
    # a terminal sends Ctrl-C to the workers, too, and they print nothing; a batch system may signal the parent alone
    os.killpg(process.pid, number) if backend == "loky" else process.send_signal(number)
    said, complained = process.communicate(timeout=600)
    assert process.returncode == 130
    assert said == ""
    kept = Parts(tmp_path / "out", "units")
    kept.load()
    assert kept.count == len(list(parts.iterdir())) > 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["config.toml", "parts"]
    assert complained.splitlines() == ["interrupted; run the same command again to resume"]


@pytest.mark.parametrize(("verb", "words"), [("run", "; run the same command again to resume"), ("estimators", "")])
def test_a_command_that_starts_anew_does_not_say_that_it_resumes(monkeypatch, capsys, verb, words):
    """The line of an interruption promises to resume for commands that store what is finished, and for no others."""
    monkeypatch.setattr(sys, "argv", ["study", verb])

    def interrupted():
        raise SystemExit(130)

    with pytest.raises(SystemExit):
        cli.main(interrupted)
    assert capsys.readouterr().err == f"interrupted{words}\n"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no masks of signals")
def test_processes_that_just_start():
    """A process that a dispatcher's thread starts has the signal blocked from the first; the main thread has not."""
    code = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    with ThreadPoolExecutor(1, initializer=leave_interrupts) as thread:
        started = thread.submit(subprocess.run, [sys.executable, "-c", code], capture_output=True, text=True)
        assert started.result().stdout == "True\n"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def is_gone(process):
    """True when a process has ended, whether or not its new parent has taken note of it."""
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def test_workers_end_with_a_killed_parent(hold, wait_for, tmp_path):
    """Worker processes at work notice that their parent is gone, and end."""
    (tmp_path / "long.toml").write_text(LONG)
    options = ["--out", "out", "--jobs", 2, "--backend", "loky"]
    process = hold(tmp_path, tmp_path / "out" / "parts", 2, "run", "long.toml", *options)
    children = psutil.Process(process.pid).children()
    workers = [child for child in children if "popen_loky" in " ".join(child.cmdline())]
    assert len(workers) == 2
    process.kill()
    wait_for(lambda: all(map(is_gone, workers)))


IDLE = """
import time
from study.runs.workers.choose import Workers
with Workers(backend="loky", jobs=2).open() as backend:
    backend._options["idle_worker_timeout"] = 1e6  # in place of loky's five minutes
    backend.restart()
    for _ in backend.parallel([backend.call(1, time.sleep, 1000)]):
        pass
"""


def test_workers_without_a_task_end_with_a_killed_parent(wait_for):
    """A worker process that still waits for its first task ends, too, and not only when loky's patience ends."""

    def workers():
        children = psutil.Process(process.pid).children()
        return [child for child in children if "popen_loky" in " ".join(child.cmdline())]

    with subprocess.Popen([sys.executable, "-c", IDLE]) as process:
        wait_for(lambda: len(workers()) == 2)
        found = workers()
        process.kill()
    wait_for(lambda: all(map(is_gone, found)))
