"""`--json` of the commands on recordings: one object, with the numbers of the tables and the written files."""

import json
import sys

import numpy as np
import pandas as pd
import pytest

from study import cli
from study.mocap.io import fetch as libraries
from study.mocap.io.writing import write_recording
from study.mocap.markersets.set_file import load_markerset, shipped
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize


@pytest.fixture
def read(monkeypatch, capsys, tmp_path):
    """Run a command with --json in a folder of its own; the object that it prints comes back."""

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["study", *map(str, arguments), "--json"])
        with pytest.raises(SystemExit) as end:
            cli.main()
        said, complained = capsys.readouterr()
        assert (end.value.code, complained) == (0, "")
        return json.loads(said, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))

    return run


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    """A recording of a synthetic body as a file."""
    recording, _ = synthesize(Recipe(frames=400, gaps=0.05))
    return write_recording(recording, tmp_path_factory.mktemp("body") / "body.c3d")


def test_recording(read, body, small, tmp_path):
    found = read("recording", body)
    assert (found["recording"], found["frames"], found["rate"], len(found["markers"])) == ("body", 400, 120.0, 41)
    assert found["missing"] == pytest.approx(sum(row["missing"] for row in found["markers"]) / 400 / 41)
    assert (found["markerset"]["name"], len(found["markerset"]["joints"])) == ("cmu41", 14)
    other = read("recording", write_recording(small(("a", "b", "c")), tmp_path / "other.csv"))
    assert other["markerset"] is None


def test_joints(read, body, tmp_path):
    found = read("joints", body)
    table = pd.read_parquet(tmp_path / found["files"][0])
    assert [row["joint"] for row in found["joints"]] == list(table["joint"])
    wanted = table["error"].astype(object).where(table["error"].notna(), None)
    assert [row["error"] for row in found["joints"]] == pytest.approx(list(wanted))
    assert [name.rpartition("/")[2] for name in found["files"]] == ["joints.parquet", "calibration.json"]
    assert found["markerset"]["name"] == "cmu41"


def test_case_study(read, tmp_path):
    whole, _ = synthesize(Recipe(frames=300))
    hips = whole.select([marker for marker in whole.markers if marker[1:] in ("FWT", "BWT", "THI", "KNE")])
    found = read("case-study", write_recording(hips, tmp_path / "hips.c3d"), "--subsets", 4)
    joints = pd.read_parquet(tmp_path / "results/recordings/hips/case-study-joints.parquet")
    assert [row["joint"] for row in found["joints"]] == list(joints["joint"])
    np.testing.assert_allclose([row["worth"] for row in found["joints"]], joints["worth"])
    assert all((tmp_path / name).is_file() for name in found["files"])
    assert (found["recording"], found["subsets"]) == ("hips", 4)


def test_markersets(read):
    assert [each["name"] for each in read("markersets")["markersets"]] == shipped()
    (one,) = read("markersets", "cmu41")["markersets"]
    assert type(load_markerset("cmu41")).model_validate(one) == load_markerset("cmu41")


def test_synthetic(read, tmp_path):
    found = read("synthetic", "--frames", 30)
    assert (found["recording"], found["frames"], found["rate"]) == ("synthetic-1", 30, 120.0)
    assert all((tmp_path / name).is_file() for name in found["files"])


def test_fetch(read, monkeypatch, tmp_path):
    monkeypatch.setattr(libraries, "fetch", lambda library, name: tmp_path / f"{name}.c3d")
    found = read("fetch", "cmu", "60_08")
    assert found == {
        "library": "cmu",
        "name": "60_08",
        "file": str(tmp_path / "60_08.c3d"),
        "terms": libraries.LIBRARIES["cmu"].terms,
    }


def test_every_command_on_recordings_has_it():
    """A new command has it, too."""
    import inspect

    from study.mocap import commands

    names = ["case_study", "fetch", "joint", "joints", "markersets", "recording", "skeleton", "synthetic"]
    for name in names:
        module = __import__(f"{commands.__name__}.{name}", fromlist=[name])
        parameters = inspect.signature(getattr(module, name)).parameters
        assert {"as_json", "json"} & set(parameters), name
