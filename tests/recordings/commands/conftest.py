"""Commands as a user calls them, in a folder of their own, and the recording of a synthetic body as a file."""

import functools
import json

import pytest

from study.recordings.formats.write import write_recording
from study.recordings.synthetic.make import Recipe, synthesize


@pytest.fixture
def call(call_here, tmp_path):
    """Run a command on a standard input; exit code, standard output and standard error come back."""
    return functools.partial(call_here, tmp_path)


@pytest.fixture
def works(well, tmp_path):
    """Run a command that ends well and complains of nothing; its standard output comes back."""
    return functools.partial(well, tmp_path)


@pytest.fixture
def read(works):
    """Run a command with --json; the object that it prints comes back."""
    return lambda *arguments: json.loads(works(*arguments, "--json"), parse_constant=pytest.fail)


@pytest.fixture
def refused(call):
    """Run a command that is refused with these words, in one line, or below its usage."""

    def run(*arguments, says, code=2, silent=True):
        found, said, complained = call(*arguments)
        assert (found, said == "") == (code, silent), complained
        assert len(complained.splitlines()) == 1 or complained.startswith(("Usage:", "\nUsage:", " \n")), complained
        assert says in " ".join(complained.replace("│", " ").split())

    return run


@pytest.fixture(scope="session")
def body(tmp_path_factory):
    """A recording of a synthetic body as a file."""
    recording, _ = synthesize(Recipe(frames=500, gaps=0.05))
    return write_recording(recording, tmp_path_factory.mktemp("body") / "body.c3d")
