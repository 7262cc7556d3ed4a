"""`study status`, `diff`, `worst`, `regret`, `replay --plot`, and the codes with which `study run` ends.

Adaptive runs on the command line: `run --budget`, its code 4, and the other commands on such a run.

`study replay`: one trial of a run again, for a reader and as a file. What is refused stands in `test_mistakes`.
"""

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import study
from study.simulation.experiment import replay
from study.simulation.experiment.config import parse
from study.simulation.runs.parts import Layout, Parts, execute
from study.simulation.runs.run_folder import Run


@pytest.fixture
def run(finished, tmp_path):
    """A folder with a finished run in ``out``, beside its config, to be altered."""
    return shutil.copytree(finished[0], tmp_path / "run")


@pytest.fixture
def begun(config, tmp_path):
    """A run of which one unit of two is stored; the folder."""
    made = parse(config)
    store = Run.create(tmp_path / "out", made).begin(config)
    parts = Parts(store.folder, "units")
    parts.add(execute(made, (Layout(made).task(next(made.units())),)))
    parts.commit()
    return tmp_path


@pytest.fixture
def raises(monkeypatch):
    """An estimator that raises where there are 20 samples."""

    def function(samples):
        if samples.shape[2] == 20:
            raise ZeroDivisionError("my own mistake")
        return study.ESTIMATORS["lls"](samples)

    monkeypatch.setitem(study.ESTIMATORS, "raises", replace(study.ESTIMATORS["lls"], function=function))


def test_status(well, run, files_of):
    """Finished, all units done, tables by name; a table that was changed is named; nothing in the folder changes."""
    before = files_of(run)
    said = well(run, "status", "out")
    assert "finished" in said.splitlines()[0]
    assert all(words in said for words in ("2, all done", "0 of 40 fits", "errors, summary, timings"))
    assert files_of(run) == before
    path = run / "out" / "errors.parquet"
    path.write_bytes(path.read_bytes()[:-1])
    said = well(run, "status", "out")
    assert "damaged; `study run` computes the lost rows again" in said
    assert "errors (damaged)" in said


def test_status_of_a_run_that_is_begun(well, begun, files_of):
    """Begun, and how many units are missing; a part that is damaged is counted and left where it is."""
    said = well(begun, "status", "out")
    assert "begun, not finished" in said
    assert "2, of which 1 are done and 1 missing" in said
    assert "1 whole, 0 damaged" in said
    (path,) = (begun / "out" / "parts").iterdir()
    path.write_bytes(path.read_bytes()[:-1])
    before = files_of(begun)
    assert "0 whole, 1 damaged" in well(begun, "status", "out")
    assert files_of(begun) == before


def test_a_run_without_a_manifest(well, run):
    """It is not finished: `run` computes it again, to the same bytes."""
    errors = (run / "out" / "errors.parquet").read_bytes()
    (run / "out" / "manifest.json").unlink()
    assert "not begun, or nothing of it is stored" in well(run, "status", "out")
    well(run, "run", "tiny.toml", "--out", "out")
    assert (run / "out" / "errors.parquet").read_bytes() == errors


def test_diff(well, call_here, run, config, monkeypatch):
    """Two runs that differ are code 1, and the verdict is the first line."""
    many = config.replace("trials = 5", "trials = 400")
    (run / "many.toml").write_text(many)
    well(run, "run", "many.toml", "--out", "many")
    good = study.ESTIMATORS["lls"]

    def worse(samples):
        fit = good(samples)
        fit.center[:] *= 2.0
        return fit

    monkeypatch.setitem(study.ESTIMATORS, "lls", replace(good, function=worse, version=good.version + 1))
    well(run, "run", "many.toml", "--out", "worse")
    code, said, _ = call_here(run, "diff", "many", "worse")
    assert (code, said.splitlines()[0]) == (1, "many and worse: different")
    assert "lls" in said


def test_worst_and_replay(well, run):
    """The worst trial's name, as it is printed, is what `replay` takes; the picture is drawn."""
    said = well(run, "worst", "out", "-n", "3")
    assert len(said.splitlines()) == 2 + 3 + 1
    words = said.splitlines()[-1].split(": study ")[1].split()
    shown = well(run, *words)
    name, _, ratio, *_ = said.splitlines()[2].split()
    assert name.split("/")[0] in shown
    assert f"{float(ratio):.3g}" in shown
    assert (run / "worst.png").stat().st_size > 10_000


def test_regret(well, run):
    """The table is printed with a line per estimator, and written where it is asked for."""
    said = well(run, "regret", "out", "--csv", "regret.csv")
    assert {line.split()[0] for line in said.splitlines()[3:]} == {"lls", "ugdk"}
    assert (run / "regret.csv").read_text().startswith("samples,estimator,cells,median")


@pytest.mark.usefixtures("raises")
def test_failures_above_the_tolerance(well, call_here, config, tmp_path):
    """Code 3 and a line, again and again, with the tables all there; code 0 where it is tolerated."""
    text = config.replace('["lls", "ugdk"]', '["raises", "lls"]')
    (tmp_path / "bad.toml").write_text(text)
    for _ in range(2):
        code, said, complained = call_here(tmp_path, "run", "bad.toml", "--out", "out")
        assert (code, said) == (3, "out\n")
        assert len(complained.splitlines()) == 1
        assert "10 of 40 fits raised an exception" in complained
    assert Run.open(tmp_path / "out").has("summary")
    failure = Run.open(tmp_path / "out").table("failures").iloc[0]
    shown = well(tmp_path, "replay", "out", failure["name"])
    assert "ZeroDivisionError: my own mistake" in shown
    (tmp_path / "bad.toml").write_text(text.replace("seed = 1", "seed = 1\ntolerate_failures = 0.25"))
    well(tmp_path, "run", "bad.toml", "--out", "out")


@pytest.fixture
def folder(config, tmp_path):
    """A folder with a config that has a [precision], and one that has not."""
    fixed = config.replace("tiny", "need").replace("trials = 5", "trials = 400")
    (tmp_path / "need.toml").write_text(fixed + "[precision]\nrelative_target = 0.08\nfirst = 100\n")
    (tmp_path / "fixed.toml").write_text(fixed)
    return tmp_path


def test_a_budget_that_ends_at_once(refused, well, call_here, folder):
    """Code 4 and one line, again and again; every command works on the run; the command in the line finishes it."""
    for _ in range(2):
        code, said, complained = call_here(folder, "run", "need.toml", "--out", "out", "--budget", "0")
        assert (code, said, complained.count("\n")) == (4, "out\n", 1)
        assert complained.startswith("out: stopped by its budget of 0 s: 0 of 4 cells reached the target; `study run ")
        assert complained.endswith(" resumes it\n")
        command = complained.split("`")[1]
    status = well(folder, "status", "out")
    assert "stopped by its budget of 0 s; `study run` resumes it" in status
    assert "0 reached the target" in status
    assert "4 are open" in status
    assert "no cell has a trial yet" in well(folder, "summary", "out")
    for verb in ("figures", "report"):
        refused(folder, 1, " ... its budget ended before any cell had a trial", verb, "out")
    well(folder, "worst", "out")
    assert well(folder, *command.split()[1:]) == "out\n"
    assert "finished" in well(folder, "status", "out")


def test_a_finished_run(refused, well, call_here, folder):
    """Status and report count the cells that reached the target; `replay` draws a trial beyond them, with a warning."""
    well(folder, "run", "need.toml", "--out", "out")
    run = Run.open(folder / "out")
    trials = run.trials()
    assert len(set(trials.values())) > 1
    reached = int((run.table("precision")["reason"] == "target").sum())
    assert f"4, of which {reached} reached the target" in well(folder, "status", "out")
    well(folder, "report", "out")
    page = (folder / "out" / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    assert all(words in page for words in ("Trials by need", "the target is reached", "up to 400 trials"))
    name, count = min(trials.items(), key=lambda item: item[1])
    assert count < 400
    well(folder, "replay", "out", name, count - 1)
    code, said, complained = call_here(folder, "replay", "out", name, count)
    assert (code, f"cell {name}, trial {count}" in said) == (0, True)
    assert complained == f"out: cell {name} has {count} trials; trial {count} is not in its tables\n"
    refused(folder, 2, f"trial 400: cell {name} has trial 0 to 399", "replay", "out", name, 400)


def test_plan(well, folder):
    """The plan has the least work, up to the first checkpoint, and the most, up to the cap."""
    said = well(folder, "plan", "need.toml")
    least, most = said.split("at most")
    assert "up to the first checkpoint, 100 trials" in least
    assert "fits     800\n" in least
    assert "fits     3,200\n" in most


@pytest.fixture(scope="module")
def replayed(tmp_path_factory, config):
    """A run that has not begun: its config is all that a replay needs."""
    folder = tmp_path_factory.mktemp("replay")
    (folder / "out").mkdir()
    (folder / "out" / "config.toml").write_text(config)
    return folder


def test_replay(call, call_here, finished):
    """The command prints the lines of the library, also for a beginning of the cell's name."""
    folder = finished[0]
    run = Run.open(folder / "out")
    row = run.table("errors").iloc[-1]
    cell, trial = str(row["cell"]), int(row["trial"])
    for word, way in ((cell, call), (cell[:6], call_here)):
        code, said, complained = way(folder, "replay", "out", word, trial)
        assert (code, complained) == (0, "")
        assert said.splitlines() == list(replay.printed(run.study, replay.find(run.study, cell, trial)))
    assert f"{row['error']:.3g}" in said
    assert row["estimator"] in said
    assert sorted(path.name for path in folder.iterdir()) == ["out", "tiny.toml"]


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_points_to_a_file(well, replayed, tmp_path, suffix):
    """Every digit of the points is in the file, of either kind, in a folder that is made."""
    *_, trial = replay.all_trials(Run.open(replayed / "out").study, 4)
    path = tmp_path / "new" / f"points.{suffix}"
    said = well(replayed, "replay", "out", trial.cell.name, "3", "--out", path)
    assert said.startswith("tiny-")
    frame = pd.read_csv(path, dtype=str).map(float) if suffix == "csv" else pd.read_parquet(path)
    assert list(frame.columns) == ["x_1", "x_2", "x_3"]
    np.testing.assert_array_equal(frame, replay.points(trial))
    assert [path.name for path in path.parent.iterdir()] == [f"points.{suffix}"]


def test_the_file_can_be_fitted(well, replayed, tmp_path):
    """`study fit` reads it, and finds what the replay said."""
    *_, trial = replay.all_trials(Run.open(replayed / "out").study, 1)
    said = well(replayed, "replay", "out", trial.cell.name, "0", "--out", tmp_path / "p.csv")
    fitted = well(replayed, "fit", tmp_path / "p.csv", "--estimator", "lls")
    (line,) = [line for line in said.splitlines() if line.startswith("lls ")]
    center = np.array([float(cell.split()[0]) for cell in fitted.splitlines()[1].split("  ") if "±" in cell][:3])
    assert np.linalg.norm(center) == pytest.approx(float(line.split()[1]), rel=0.1)
