"""What the tests of runs share: small configs, and a function that runs them into fresh folders."""

import functools
import itertools

import pytest

from study.experiment.config import parse
from study.runs import provenance, runner


def _toml(value):
    """A value as TOML; dictionaries become inline tables."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(v)}" for key, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


@pytest.fixture(scope="session")
def make_text():
    """Write a small config: keyword arguments go into the design, ``top`` beside it; None leaves a key out."""

    def make(top=None, **design):
        head = {"name": "test", "seed": 1, "estimators": ["mle", "lls", "gdke", "ugdk"]} | (top or {})
        body = {"kind": "grid", "trials": 3, "samples": [6, 40], "noise": [0.05, 0.5], "angle": [60, 180]} | design
        lines = [f"{key} = {_toml(value)}" for key, value in head.items() if value is not None]
        lines += ["[design]", *(f"{key} = {_toml(value)}" for key, value in body.items() if value is not None)]
        return "\n".join(lines) + "\n"

    return make


@pytest.fixture
def start(make_text, tmp_path):
    """Run a config of these arguments, and return the run."""
    numbers = itertools.count()

    def run(top=None, jobs=2, folder=None, progress=None, **design):
        text = make_text(top, **design)
        return runner.run(parse(text), text, folder or tmp_path / f"run-{next(numbers)}", jobs, progress)

    return run


@pytest.fixture(scope="session")
def software():
    """Versions and commit, asked for once."""
    return functools.cache(provenance.software)


@pytest.fixture
def same_software(monkeypatch, software):
    """Let all runs be of the same commit, so that one made while tests run is no difference between two runs."""
    monkeypatch.setattr(provenance, "software", software)


@pytest.fixture
def small_units(monkeypatch):
    """Units of a few batches, so that a small study has many."""
    monkeypatch.setattr("study.experiment.design.BLOCK_TRIALS", 4)
    monkeypatch.setattr("study.experiment.design._SAMPLES_PER_UNIT", 500)


@pytest.fixture(scope="session")
def files():
    """All files under a folder with their bytes."""
    return lambda folder: {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
