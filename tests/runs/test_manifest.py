"""The manifest: the study, the software, the machine and the time of a run."""

import json
import os
import platform
import subprocess
from datetime import datetime
from importlib.metadata import version
from pathlib import Path

import pytest

import study
from study.experiment.config import Study


@pytest.fixture(scope="module")
def manifest(make_text, tmp_path_factory):
    """The manifest of a finished run, and the run."""
    from study.experiment.config import parse
    from study.runs import runner

    text = make_text()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("study.runs.provenance._PATIENCE", 600.0)  # on a busy machine git may take long
        run = runner.run(parse(text), text, tmp_path_factory.mktemp("manifest") / "run", 2)
    return run, json.loads((run.folder / "manifest.json").read_text(encoding="utf-8"))


def test_fields(manifest):
    """The manifest has the declared fields and no others."""
    expected = {"run", "config", "cells", "started", "seconds_computing", "seconds", "jobs", "software", "machine"}
    expected |= {"format", "fits", "failures", "lost", "estimators", "tables", "backend", "also_computed_by", "digest"}
    assert set(manifest[1]) == expected


def test_what_was_run(manifest):
    """The run's name, its config and the number of cells are those of the study."""
    run, said = manifest
    assert said["run"] == run.study.run_name()
    assert Study.model_validate_json(json.dumps(said["config"])) == run.study
    assert said["cells"] == 8
    assert said["jobs"] == 2


def test_times(manifest):
    """The start has a time zone, and computing takes part of the whole."""
    said = manifest[1]
    assert datetime.fromisoformat(said["started"]).utcoffset() is not None
    assert 0.0 <= said["seconds_computing"] <= said["seconds"]


def test_software(manifest):
    """Versions are those installed, and the commit is git's."""
    software = manifest[1]["software"]
    assert software["study"] == study.__version__
    assert software["python"] == platform.python_version()
    for package in ("numpy", "scipy", "numba", "pyarrow", "joblib"):
        assert software["packages"][package] == version(package)
    root = Path(study.__file__).parents[1]
    if (root / ".git").exists():
        done = subprocess.run(["git", "-C", str(root), "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
        assert software["commit"] == done.stdout.strip()
        assert isinstance(software["dirty"], bool)


def test_machine(manifest):
    """System, processor and cores are in it."""
    machine = manifest[1]["machine"]
    assert machine["cores"] == os.cpu_count()
    assert platform.system() in machine["system"]
    assert machine["processor"]


def test_threads_are_those_of_the_run(manifest):
    """The threads of each library are the one that the run was limited to, not those of the machine."""
    assert set(manifest[1]["machine"]["threads"].values()) <= {1}
