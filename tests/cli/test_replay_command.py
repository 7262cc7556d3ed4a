"""`study replay`: one trial of a run again, for a reader and as a file; and what it refuses, in one line."""

import os

import numpy as np
import pandas as pd
import pytest

from study.analysis import trial_report
from study.experiment.compute_unit import compute
from study.experiment.replay import find, replay
from study.experiment.units import units
from study.runs.storage.run_folder import Run

AXES = ["x_1", "x_2", "x_3"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, config):
    """A run that has not begun: its config is all that a replay needs."""
    folder = tmp_path_factory.mktemp("replay")
    (folder / "out").mkdir()
    (folder / "out" / "config.toml").write_text(config.replace("seed = 1", "seed = 1\nkeep_points = 5"))
    return folder


@pytest.fixture(scope="module")
def made(folder):
    """The run's study."""
    return Run.open(folder / "out").study


@pytest.fixture(scope="module")
def points(made):
    """All points of the study, as a worker computes them."""
    parts = [pd.DataFrame(compute(made, unit).points) for unit in units(made)]
    return pd.concat(parts, ignore_index=True)


def refused(result, code, *words):
    """Assert a refusal: this exit code, one line on standard error with these words."""
    found, _, complained = result
    assert found == code
    assert len(complained.splitlines()) == 1, complained
    assert "Traceback" not in complained
    assert all(word in complained for word in words), complained


def test_replay(call, call_here, finished):
    """The command prints the lines of the library, also for a beginning of the cell's name."""
    folder = finished[0]
    run = Run.open(folder / "out")
    row = run.table("errors").iloc[-1]
    cell, trial = str(row["cell"]), int(row["trial"])
    for word, way in ((cell, call), (cell[:6], call_here)):
        code, said, complained = way(folder, "replay", "out", word, trial)
        assert (code, complained) == (0, "")
        assert said.splitlines() == list(
            trial_report.printed(run.study, replay(run.study, find(run.study, cell, trial)))
        )
    assert f"{row['error']:.3g}" in said
    assert row["estimator"] in said
    assert sorted(path.name for path in folder.iterdir()) == ["out", "tiny.toml"]


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_points_to_a_file(call_here, folder, points, tmp_path, suffix):
    """Every digit of the stored points is in the file, of either kind, in a folder that is made."""
    cell = str(points["cell"].iloc[-1])
    path = tmp_path / "new" / f"points.{suffix}"
    code, said, complained = call_here(folder, "replay", "out", cell, "3", "--out", path)
    assert (code, complained) == (0, "")
    assert said.startswith("tiny-")
    frame = pd.read_csv(path, dtype=str).map(float) if suffix == "csv" else pd.read_parquet(path)
    kept = points[(points["cell"] == cell) & (points["trial"] == 3)]
    assert list(frame.columns) == AXES
    np.testing.assert_array_equal(frame.to_numpy(), kept[AXES].to_numpy())
    assert [path.name for path in path.parent.iterdir()] == [f"points.{suffix}"]


def test_the_file_can_be_fitted(call_here, folder, made, tmp_path):
    """`study fit` reads it, and finds what the replay said."""
    cell = next(unit.batches[0].cells[0].name for unit in units(made) if unit.batches[0].samples == 20)
    code, said, _ = call_here(folder, "replay", "out", cell, "0", "--out", tmp_path / "p.csv")
    assert code == 0
    code, fitted, _ = call_here(folder, "fit", tmp_path / "p.csv", "--estimator", "lls")
    assert code == 0
    (line,) = [line for line in said.splitlines() if line.startswith("lls ")]
    center = np.array([float(cell.split()[0]) for cell in fitted.splitlines()[1].split("  ") if "±" in cell][:3])
    assert np.linalg.norm(center) == pytest.approx(float(line.split()[1]), rel=0.1)


def test_another_kind_of_file(call_here, folder, points, tmp_path):
    """A suffix of another kind is refused with the kinds that exist, and nothing is written."""
    cell = str(points["cell"].iloc[0])
    for name in ("points.txt", "points"):
        result = call_here(folder, "replay", "out", cell, "0", "--out", tmp_path / name)
        refused(result, 1, name, "give a name that ends in .csv or .parquet")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_written(call_here, folder, points, tmp_path):
    """A folder that is a file, and a file that is a folder: one line that names it."""
    cell = str(points["cell"].iloc[0])
    (tmp_path / "file").write_text("kept")
    (tmp_path / "folder.csv").mkdir()
    refused(
        call_here(folder, "replay", "out", cell, "0", "--out", tmp_path / "file" / "p.csv"),
        1,
        "file/p.csv",
        "cannot be",
    )
    refused(
        call_here(folder, "replay", "out", cell, "0", "--out", tmp_path / "folder.csv"), 1, "folder.csv", "cannot be"
    )
    assert (tmp_path / "file").read_text() == "kept"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder.csv"]


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="nothing is closed to the superuser")
def test_a_folder_that_is_closed(call_here, folder, points, tmp_path):
    """A folder without the right to write is one line that names it."""
    tmp_path.chmod(0o500)
    refused(call_here(folder, "replay", "out", points["cell"].iloc[0], "0", "--out", tmp_path / "p.csv"), 1, "p.csv")
    tmp_path.chmod(0o700)


def test_a_cell_that_is_not_there(call_here, folder, made):
    """A wrong name, or a beginning of several names, is code 2 and one line."""
    refused(call_here(folder, "replay", "out", "xyz", "0"), 2, "cell 'xyz': no such cell in", made.run_name())
    refused(call_here(folder, "replay", "out", "", "0"), 2, "not one cell but 4: ")


def test_a_trial_that_is_not_there(call_here, folder, points):
    """Code 2 and one line, which says what trials there are."""
    cell = str(points["cell"].iloc[0])
    refused(call_here(folder, "replay", "out", cell, "5"), 2, f"trial 5: cell {cell} has trial 0 to 4")


@pytest.mark.parametrize("arguments", [["c0", "-1"], ["c0", "one"], [], ["c0", "0", "1"]], ids=str)
def test_wrong_usage(call_here, folder, arguments):
    """A trial that is no number, or missing, is code 2 and the usage."""
    code, said, complained = call_here(folder, "replay", "out", *arguments)
    assert (code, said) == (2, "")
    assert "Usage: " in complained


@pytest.mark.parametrize("arguments", [["c0"], ["c0/"], ["c0/x"], ["c0/-1"], ["c0/1", "1"], ["/1/2"]], ids=str)
def test_a_name_that_is_none(call_here, folder, arguments):
    """A name without a trial's number, or with two, is code 2 and one line that shows the form of names."""
    refused(call_here(folder, "replay", "out", *arguments), 2, arguments[0], "CELL/TRIAL")


def test_what_is_no_run(call_here, folder):
    """A folder without a config is code 1 and one line."""
    refused(call_here(folder, "replay", ".", "c0", "0"), 1, "not a run folder")
    refused(call_here(folder, "replay", "none", "c0", "0"), 1, "none", "not a run folder")
