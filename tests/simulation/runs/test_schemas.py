"""Stored tables: the declared columns with units and meanings, and nothing of time, machine or workers.

The manifest: the study, the software, the machine and the time of a run.
"""

import hashlib
import json
import os
import platform
import subprocess
from datetime import datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import study
from study.fits import Status
from study.simulation.analysis.summary import summarise
from study.simulation.experiment.config import Study
from study.simulation.runs import schemas


@pytest.fixture(scope="module")
def stored(make_text, tmp_path_factory):
    """A finished and summarised run with points, in two dimensions and in five."""
    from study.simulation.experiment.config import parse
    from study.simulation.runs import runner

    made = {}
    for d in (2, 5):
        text = make_text({"keep_points": 2, "dimension": d}, samples=[8, 40], trials=30)
        made[d] = runner.run(parse(text), text, tmp_path_factory.mktemp("stored") / "run")
        summarise(made[d])
    return made


def declared(name, d):
    """The declaration of a table."""
    return {
        "errors": schemas.errors(d),
        "timings": schemas.TIMINGS,
        "points": schemas.points(d),
        "summary": schemas.summary(),
    }[name]


@pytest.mark.parametrize("d", [2, 5])
@pytest.mark.parametrize("name", ["errors", "timings", "points", "summary"])
def test_columns_say_what_they_are(stored, name, d):
    """A file's columns are those declared, in order and type, each with its unit and a meaning."""
    schema = pq.read_schema(stored[d].folder / f"{name}.parquet")
    columns = declared(name, d)
    assert schema.names == [column.name for column in columns]
    for field, column in zip(schema, columns, strict=True):
        assert field.type == column.type
        found = {key: value.decode() for key, value in field.metadata.items()}
        assert found[b"unit"] == column.unit
        assert found[b"meaning"] == column.meaning
        assert len(column.meaning) > 8 or column.name == "condition"


@pytest.mark.parametrize("name", ["errors", "timings", "points", "summary"])
def test_lengths_have_a_unit(name):
    """Columns that hold a length, an angle or a time have a unit; counts and names have none."""
    united = {c.name for c in declared(name, 3) if c.unit}
    expected = {
        "errors": {"noise", "angle", "radius", "center", "error_1", "error_2", "error_3", "error", "radius_error"}
        | {"bound", "radius_bound", "noise_variance"},
        "timings": {"seconds"},
        "points": {"x_1", "x_2", "x_3", "center_1", "center_2", "center_3", "radius"},
        "summary": {"noise", "angle", "radius", "center"},
    }
    assert united == expected[name]


@pytest.mark.parametrize("name", ["errors", "timings", "points", "summary"])
def test_files_hold_their_config(stored, name):
    """Every table holds the canonical config that it came from."""
    metadata = pq.read_schema(stored[2].folder / f"{name}.parquet").metadata
    assert Study.model_validate_json(metadata[b"study.config"]) == stored[2].study


def test_error_table_knows_software_and_nothing_else(stored):
    """Beside the config, the error table's metadata hold versions and commit, but no time, host or workers."""
    metadata = pq.read_schema(stored[2].folder / "errors.parquet").metadata
    assert set(metadata) - {b"ARROW:schema", b"pandas"} == {b"study.config", b"study.software"}
    software = json.loads(metadata[b"study.software"])
    found = {"study", "commit", "dirty", "revision", "directory", "python", "packages", "code_generated_for"}
    assert set(software) == found
    assert software["packages"]["numpy"] == version("numpy")


def test_statuses_are_explained(stored):
    """The status column's meaning gives every number's text."""
    field = pq.read_schema(stored[2].folder / "errors.parquet").field("status")
    said = field.metadata[b"meaning"].decode()
    assert all(f"{status.value} = {status.text}" in said for status in Status)


@pytest.mark.parametrize("d", [2, 5])
def test_error_table_is_whole(stored, d):
    """A row for every cell, trial and estimator, in the order of the config, none twice."""
    frame = stored[d].table("errors")
    assert len(frame) == 2 * 2 * 2 * 30 * 4
    assert not frame.duplicated(["cell", "trial", "estimator"]).any()
    for _, part in frame.groupby(["cell", "estimator"], observed=True):
        assert sorted(part["trial"]) == list(range(30))
    assert list(dict.fromkeys(frame["samples"])) == [8, 40]
    assert list(dict.fromkeys(frame["estimator"])) == ["mle", "lls", "gdke", "ugdk"]


@pytest.mark.parametrize("d", [2, 5])
def test_columns_agree_with_each_other(stored, d):
    """The error is the norm of its components; an ok fit has a finite error; bounds are positive."""
    frame = stored[d].table("errors")
    parts = frame[[f"error_{i + 1}" for i in range(d)]].to_numpy()
    np.testing.assert_allclose(frame["error"], np.sqrt((parts**2).sum(axis=1)), rtol=1e-14)
    ok = frame["status"] == Status.OK
    assert ok.any()
    assert np.isfinite(frame.loc[ok, ["error", "radius_error"]]).all(axis=None)
    assert (frame[["bound", "radius_bound"]] > 0).all(axis=None)


def test_points_lie_about_their_spheres(stored):
    """Stored points are those of the first two trials of each cell, about the sphere beside them."""
    frame = stored[2].table("points")
    assert set(frame["trial"]) == {0, 1}
    errors = stored[2].table("errors").drop_duplicates("cell").set_index("cell")
    for cell, part in frame.groupby("cell", observed=True):
        assert len(part) == 2 * errors.loc[cell, "samples"]
        distance = np.hypot(part["x_1"] - part["center_1"], part["x_2"] - part["center_2"])
        assert np.all(np.abs(distance - part["radius"]) < 7 * errors.loc[cell, "noise"])


def test_a_table_is_what_was_declared():
    """A column too many or too few is an error, not a file that surprises later."""
    data = {"step": ["draw"], "samples": [3], "fits": [1], "seconds": [0.1]}
    assert schemas.table(schemas.TIMINGS, data).num_rows == 1
    for wrong in (data | {"more": [1]}, {k: v for k, v in data.items() if k != "fits"}):
        with pytest.raises(ValueError, match=r"more|fits"):
            schemas.table(schemas.TIMINGS, wrong)
    with pytest.raises((pa.ArrowInvalid, pa.ArrowTypeError)):
        schemas.table(schemas.TIMINGS, data | {"samples": ["many"]})


def test_a_table_older_than_a_status_is_read():
    """A summary may lack the count of a status that is newer than it is, and no other column."""
    columns = schemas.summary()
    whole = schemas.schema(columns)
    without = lambda name: whole.remove(whole.get_field_index(name))  # noqa: E731
    assert schemas.fault(whole, columns) is None
    assert schemas.fault(without("weakly_identified"), columns) is None
    assert "no column 'ok'" in schemas.fault(without("ok"), columns)
    assert "no column 'planned'" in schemas.fault(without("planned"), columns)


@pytest.fixture(scope="module")
def manifest(make_text, tmp_path_factory):
    """The manifest of a finished run, and the run."""
    from study.simulation.experiment.config import parse
    from study.simulation.runs import runner

    text = make_text()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("study.simulation.runs.provenance._PATIENCE", 600.0)  # on a busy machine git may take long
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


def test_software_heritage_identifiers(manifest):
    """They are the hashes of git's own objects: SHA-1 of the commit's bytes, and the tree that the commit names."""
    software = manifest[1]["software"]
    root = Path(study.__file__).parents[1]
    if not (root / ".git").exists():
        assert (software["revision"], software["directory"]) == (None, None)
        return
    commit = software["commit"]
    done = subprocess.run(["git", "-C", str(root), "cat-file", "commit", commit], capture_output=True, check=True)
    digest = hashlib.sha1(b"commit %d\0" % len(done.stdout) + done.stdout).hexdigest()
    assert software["revision"] == f"swh:1:rev:{digest}"
    assert software["directory"] == f"swh:1:dir:{done.stdout.split()[1].decode()}"


def test_machine(manifest):
    """System, processor and cores are in it."""
    machine = manifest[1]["machine"]
    assert machine["cores"] == os.cpu_count()
    assert platform.system() in machine["system"]
    assert machine["processor"]


def test_threads_are_those_of_the_run(manifest):
    """The threads of each library are the one that the run was limited to, not those of the machine."""
    assert set(manifest[1]["machine"]["threads"].values()) <= {1}
