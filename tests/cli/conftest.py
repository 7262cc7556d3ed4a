"""Shared by the tests of the command line: a small config, and ways to run a command as a user does."""

import contextlib
import io
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import study
from study import cli
from study.fits.loops.jit import COMPILING
from tests.configs import config as write


@pytest.fixture(scope="session")
def config():
    """A config that takes no time."""
    return write({"name": "tiny", "estimators": ["lls", "ugdk"]}, trials=5, samples=[5, 20], noise=[0.01, 0.1])


@pytest.fixture(scope="session")
def command():
    """The command line, with warnings as errors, and the environment that finds the package."""
    paths = [str(Path(study.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "COLUMNS": "200"}
    return [sys.executable, "-W", "error", "-m", "study.cli"], environment


@pytest.fixture(scope="session")
def call(command):
    """Run a command in a folder; exit code, standard output and standard error come back as text.

    Options go to the process: another environment, a shell's line in place of the command.
    """
    words, environment = command

    def run(folder, *arguments, **options):
        line = [*words, *map(str, arguments)]
        options = {"env": environment, "encoding": "utf-8", "timeout": 300, "capture_output": True} | options
        done = subprocess.run(line, cwd=folder, **options)
        # where no code is cached, a run may take a minute
        complained = re.sub(r"\S+: \S+ units, \S+ passed.*\n", "", done.stderr.replace(f"{COMPILING}\n", ""))
        return done.returncode, done.stdout, complained

    return run


@pytest.fixture(scope="session")
def done_here():
    """Run a command within this process that ends with code 0; fixtures that tests share need no new program."""

    def run(folder, *arguments):
        with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()):
            patch.chdir(folder)
            patch.setattr(sys, "argv", ["study", *arguments])
            with pytest.raises(SystemExit) as end:
                cli.main()
        assert end.value.code == 0

    return run


@pytest.fixture
def hold(command, held, wait_for, tmp_path_factory):
    """Start a command, and wait until each of its workers stands at the gate and a part is stored; the process."""
    environment = {**command[1], "GATE": str(tmp_path_factory.mktemp("gate"))}
    gate, started = Path(environment["GATE"]), []

    def start(folder, parts, workers, *arguments):
        line = [sys.executable, "-W", "error", str(held), *map(str, arguments)]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "encoding": "utf-8"}
        process = subprocess.Popen(line, cwd=folder, env=environment, start_new_session=True, **pipes)
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
def refused(call_here, files_of):
    """Run a command within this process that is refused, says nothing and changes no file; its complaint.

    It is one line (or so many) that begins with the words; a dot-dot-dot in them stands for any text. What is refused
    after an answer is not silent.
    """

    def run(folder, code, words, *arguments, lines=1, silent=True):
        before = files_of(folder)
        end, said, complained = call_here(folder, *arguments)
        assert (end, said == "" or not silent) == (code, True)
        assert len(complained.splitlines()) == lines, complained
        first, *others = words.split(" ... ")
        assert complained.startswith(first)
        assert all(word in complained for word in others), complained
        assert files_of(folder) == before
        return complained

    return run
