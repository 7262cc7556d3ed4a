"""Stored tables: the declared columns with units and meanings, and nothing of time, machine or workers.

The manifest: the study, the software, the machine and the time of a run.
"""

import hashlib
import json
import os
import platform
import re
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
from study.simulation.experiment.config import Study, parse
from study.simulation.runs import runner, schemas


@pytest.fixture(scope="module")
def stored(make_text, tmp_path_factory):
    """A finished and summarised run with points, in two dimensions and in five."""
    made = {}
    for d in (2, 5):
        text = make_text({"keep_points": 2, "dimension": d}, samples=[8, 40], trials=30)
        made[d] = runner.run(parse(text), text, tmp_path_factory.mktemp("stored") / "run")
        summarise(made[d])
    return made


TABLES = {
    "errors": schemas.errors,
    "timings": lambda d: schemas.TIMINGS,
    "points": schemas.points,
    "summary": lambda d: schemas.summary(),
}


PARAMETERS = r"(mean|sd|q\d+|bound)_(\d|radius|noise)"
LENGTH = re.compile(rf"noise|radius|center(_\d)?|x_\d|error(_\d)?|radius_error|(radius_)?bound|{PARAMETERS}")
ODD = {"angle": "degree", "trace": "length²", "noise_variance": "length²", "tau": "step", "seconds": "s"}


@pytest.mark.parametrize("d", [2, 5])
@pytest.mark.parametrize("name", TABLES)
def test_columns_say_what_they_are(stored, name, d):
    """A file's columns are those declared, in order and type, each with its unit and a meaning; it holds its config."""
    schema = pq.read_schema(stored[d].folder / f"{name}.parquet")
    columns = TABLES[name](d)
    told = [[field.metadata[key].decode() for key in (b"unit", b"meaning")] for field in schema]
    assert [(field.name, field.type, *words) for field, words in zip(schema, told, strict=True)] == columns
    assert all(len(column.meaning) > 8 or column.name == "condition" for column in columns)
    assert Study.model_validate_json(schema.metadata[b"study.config"]) == stored[d].study


@pytest.mark.parametrize("name", [*TABLES, "posterior", "answers", "draws"])
def test_units(name):
    """Columns that hold a length, an angle or a time have a unit; counts, names, shares, ranks and ratios have none.

    An area has a length's square, τ is in steps.
    """
    for column in (TABLES.get(name) or getattr(schemas, name))(3):
        unit = "length" if LENGTH.fullmatch(column.name) else ODD.get(column.name, "")
        assert (column.unit or "") == unit, column.name


def test_error_table_knows_software_and_nothing_else(stored):
    """Beside the config, the error table's metadata hold versions and commit, but no time, host or workers.

    The status column's meaning gives every number's text.
    """
    metadata = pq.read_schema(stored[2].folder / "errors.parquet").metadata
    assert set(metadata) - {b"ARROW:schema", b"pandas"} == {b"study.config", b"study.software"}
    software = json.loads(metadata[b"study.software"])
    found = {"study", "commit", "dirty", "revision", "directory", "python", "packages", "code_generated_for"}
    assert set(software) == found
    assert software["packages"]["numpy"] == version("numpy")
    said = pq.read_schema(stored[2].folder / "errors.parquet").field("status").metadata[b"meaning"].decode()
    assert all(f"{status.value} = {status.text}" in said for status in Status)


@pytest.mark.parametrize("d", [2, 5])
def test_error_table_is_whole(stored, d):
    """A row for every cell, trial and estimator, in the order of the config, none twice.

    An ok fit has a finite error; bounds are positive.
    """
    frame = stored[d].table("errors")
    assert len(frame) == 2 * 2 * 2 * 30 * 4
    assert not frame.duplicated(["cell", "trial", "estimator"]).any()
    for _, part in frame.groupby(["cell", "estimator"], observed=True):
        assert sorted(part["trial"]) == list(range(30))
    assert list(dict.fromkeys(frame["samples"])) == [8, 40]
    assert list(dict.fromkeys(frame["estimator"])) == ["mle", "lls", "gdke", "ugdk"]
    ok = frame["status"] == Status.OK
    assert ok.any()
    assert np.isfinite(frame.loc[ok, ["error", "radius_error"]]).all(axis=None)
    assert (frame[["bound", "radius_bound"]] > 0).all(axis=None)


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
    """A summary may lack the count of a status that is newer than it is, and no other column; types are declared."""
    columns = schemas.summary()
    whole = schemas.schema(columns)
    without = lambda name: whole.remove(whole.get_field_index(name))  # noqa: E731
    words = whole.set(whole.get_field_index("bias"), pa.field("bias", pa.string()))
    assert schemas.fault(words, columns).endswith(": column 'bias' is of type string, not double")
    assert schemas.fault(whole, columns) is None
    assert schemas.fault(without("weakly_identified"), columns) is None
    assert "no column 'ok'" in schemas.fault(without("ok"), columns)
    assert "no column 'planned'" in schemas.fault(without("planned"), columns)


@pytest.fixture(scope="module")
def manifest(make_text, tmp_path_factory):
    """The manifest of a finished run, and the run."""
    text = make_text()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("study.simulation.runs.provenance._PATIENCE", 600.0)  # on a busy machine git may take long
        run = runner.run(parse(text), text, tmp_path_factory.mktemp("manifest") / "run", 2)
    return run, json.loads((run.folder / "manifest.json").read_text(encoding="utf-8"))


def test_what_was_run(manifest):
    """The manifest has the declared fields: the study, when and where it was run, and the threads that it had.

    The start has a time zone, and computing takes part of the whole.
    """
    run, said = manifest
    expected = {"run", "config", "cells", "started", "seconds_computing", "seconds", "jobs", "software", "machine"}
    expected |= {"format", "fits", "failures", "lost", "estimators", "tables", "backend", "also_computed_by", "digest"}
    assert set(said) == expected
    assert (said["run"], said["cells"], said["jobs"]) == (run.study.run_name(), 8, 2)
    assert Study.model_validate_json(json.dumps(said["config"])) == run.study
    assert datetime.fromisoformat(said["started"]).utcoffset() is not None
    assert 0.0 <= said["seconds_computing"] <= said["seconds"]
    assert said["machine"]["cores"] == os.cpu_count()
    assert platform.system() in said["machine"]["system"]
    assert said["machine"]["processor"]
    assert set(said["machine"]["threads"].values()) <= {1}


def test_software(manifest):
    """Versions are those installed, and the commit is git's.

    Software Heritage's identifiers are the hashes of git's own objects: SHA-1 of the commit's bytes, and the tree that
    the commit names.
    """
    software = manifest[1]["software"]
    assert (software["study"], software["python"]) == (study.__version__, platform.python_version())
    for package in ("numpy", "scipy", "numba", "pyarrow", "joblib"):
        assert software["packages"][package] == version(package)
    root = Path(study.__file__).parents[1]
    if not (root / ".git").exists():
        assert (software["commit"], software["revision"], software["directory"]) == (None, None, None)
        return
    git = lambda *words: subprocess.run(["git", "-C", str(root), *words], capture_output=True, check=True).stdout  # noqa: E731
    assert software["commit"] == git("rev-parse", "HEAD").decode().strip()
    assert isinstance(software["dirty"], bool)
    text = git("cat-file", "commit", software["commit"])
    assert software["revision"] == f"swh:1:rev:{hashlib.sha1(b'commit %d' % len(text) + bytes(1) + text).hexdigest()}"
    assert software["directory"] == f"swh:1:dir:{text.split()[1].decode()}"
