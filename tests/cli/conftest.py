"""Shared by the tests of the command line: a small config, and a way to run a command as a user does."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import study
from study import cli
from study.fits.jit import COMPILING

CONFIG = """name = "tiny"
seed = 1
estimators = ["lls", "ugdk"]
[design]
kind = "grid"
trials = 5
samples = [5, 20]
noise = [0.01, 0.1]
angle = 90
"""


@pytest.fixture(scope="session")
def config():
    """A config that takes no time."""
    return CONFIG


@pytest.fixture(scope="session")
def command():
    """The command line, with warnings as errors, and the environment that finds the package."""
    paths = [str(Path(study.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "COLUMNS": "200"}
    return [sys.executable, "-W", "error", "-m", "study.cli"], environment


@pytest.fixture(scope="session")
def call(command):
    """Run a command in a folder; exit code, standard output and standard error come back as text."""
    words, environment = command

    def run(folder, *arguments):
        done = subprocess.run(
            [*words, *map(str, arguments)],
            cwd=folder,
            env=environment,
            capture_output=True,
            encoding="utf-8",
            timeout=300,
        )
        return done.returncode, done.stdout, done.stderr.replace(f"{COMPILING}\n", "")  # where no code is cached

    return run


@pytest.fixture
def hold(command, held, wait_for, tmp_path_factory):
    """Start a command, and wait until each of its workers stands at the gate and a part is stored; the process."""
    environment = {**command[1], "GATE": str(tmp_path_factory.mktemp("gate"))}
    gate, started = Path(environment["GATE"]), []

    def start(folder, parts, workers, *arguments):
        process = subprocess.Popen(
            [sys.executable, "-W", "error", str(held), *map(str, arguments)],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            start_new_session=True,
        )
        started.append(process)
        wait_for(
            lambda: len(list(gate.glob("held-*"))) == workers and any(parts.glob("[!.]*.part")),
            lambda: process.poll() is None,
        )
        return process

    yield start
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@pytest.fixture(scope="session")
def finished(call, config, tmp_path_factory):
    """A folder with a config, a finished run in ``out``, and what the command said."""
    folder = tmp_path_factory.mktemp("cli")
    (folder / "tiny.toml").write_text(config)
    return folder, call(folder, "run", "tiny.toml", "--out", "out")


@pytest.fixture
def call_here(monkeypatch, capsys):
    """Run a command as `call` does, but within this process, which takes no time; what is not caught, fails."""

    def run(folder, *arguments):
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "argv", ["study", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code, *capsys.readouterr()

    return run
