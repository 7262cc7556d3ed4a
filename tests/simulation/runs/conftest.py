"""Fixtures for tests of runs: small configs, and a function that runs them into fresh folders."""

import contextlib
import functools
import itertools
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import study
from study.simulation.experiment.config import parse
from study.simulation.runs import parts, provenance, runner
from tests.configs import config

sys.path.append(str(Path(__file__).parent))  # worker processes, too, import `deadly` by its name


@pytest.fixture(scope="session")
def make_text():
    """Write a small config: keyword arguments go into the design, ``top`` beside it; None leaves a key out."""
    head = {"estimators": ["mle", "lls", "gdke", "ugdk"]}
    body = {"trials": 3, "samples": [6, 40], "noise": [0.05, 0.5], "angle": [60, 180]}
    return lambda top=None, **design: config(head | (top or {}), **body | design)


@pytest.fixture
def start(make_text, tmp_path):
    """Run a config of these arguments, and return the run; ``jobs`` is a number of threads, or other workers."""
    numbers = itertools.count()

    def run(top=None, jobs=2, folder=None, progress=None, warn=None, **design):
        text = make_text(top, **design)
        return runner.run(parse(text), text, folder or tmp_path / f"run-{next(numbers)}", jobs, progress, warn)

    return run


@pytest.fixture(scope="session")
def software():
    """Versions and commit, found once."""
    return functools.cache(provenance.software)


@pytest.fixture
def same_software(monkeypatch, software):
    """Let all runs be of the same commit, so that one made while tests run is no difference between two runs."""
    monkeypatch.setattr(provenance, "software", software)


@pytest.fixture(scope="session")
def tables():
    """Bytes of a run's tables that do not depend on time."""
    return lambda run: {name: run.path(name).read_bytes() for name in ("errors", "points")}


@pytest.fixture
def small_units(monkeypatch):
    """Units of a few batches, so that a small study has many."""
    monkeypatch.setattr("study.simulation.experiment.designs.BLOCK_TRIALS", 4)
    monkeypatch.setattr("study.simulation.experiment.designs._SAMPLES_PER_UNIT", 500)


@pytest.fixture
def small_parts(monkeypatch):
    """A part for every unit, so that a small study has many."""
    monkeypatch.setattr("study.simulation.runs.workers.Threads.enough", 0.0)
    monkeypatch.setattr("study.simulation.runs.parts._SECONDS", 0.0)
    monkeypatch.setattr("study.simulation.runs.parts._SHARE", 0.0)


@pytest.fixture
def dear(monkeypatch):
    """Make `lls` dear: a unit is cut into pieces of so many trials, where it has one level, or of less."""

    def cut(trials=3):
        monkeypatch.setitem(parts._DEAR, "lls", (1e9, 0.0))
        monkeypatch.setattr(parts, "_PIECE", (trials + 0.5) * 1e9)

    return cut


@pytest.fixture
def computed(monkeypatch):
    """A list of the computed fits: the cell's name, the trial and the estimator of each."""
    done, real = [], parts.compute

    def watched(made, unit):
        for batch in unit.parts(0):
            numbers = range(batch.first, batch.last)
            done.extend((c.name, t, e) for c in batch.cells for t in numbers for e in made.estimators)
        return real(made, unit)

    monkeypatch.setattr(parts, "compute", watched)
    return done


@pytest.fixture
def raises(monkeypatch):
    """An estimator that raises where there are 40 samples."""

    def function(samples):
        if samples.shape[2] == 40:
            raise ZeroDivisionError("my own mistake")
        return study.ESTIMATORS["lls"](samples)

    monkeypatch.setitem(study.ESTIMATORS, "raises", replace(study.ESTIMATORS["lls"], function=function))


@pytest.fixture
def small_disk(tmp_path):
    """A run's folder on a small disk of its own, and functions that fill it up and make room again.

    Where mounting is not allowed, it is a folder like others, and filling it up does nothing and is false.
    """
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=40m", "tmpfs", str(disk)]
    mounted = not os.geteuid() and shutil.which("mount") and not subprocess.run(command, capture_output=True).returncode

    def fill():
        if mounted:
            with contextlib.suppress(OSError), open(disk / "ballast", "wb", buffering=0) as file:
                while True:
                    file.write(bytes(1 << 16))
        return mounted

    yield disk / "run", fill, lambda: (disk / "ballast").unlink(missing_ok=True)
    if mounted:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)
