"""`study status`, `diff`, `worst`, `regret`, `replay --plot`, and the codes with which `study run` ends.

Adaptive runs on the command line: `run --budget`, its code 4, and the other commands on such a run.

`study replay`: one trial of a run again, for a reader and as a file; and what it refuses, in one line.
"""

import os
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import study
from study.files import writing
from study.simulation.analysis import regret
from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import parse
from study.simulation.experiment.sampling import find, units
from study.simulation.runs.jobs import Layout, execute
from study.simulation.runs.parts import FORMAT, Parts
from study.simulation.runs.run_folder import Run


@pytest.fixture
def run(call_here, config, tmp_path):
    """A finished run in ``out``, beside its config; the folder."""
    (tmp_path / "tiny.toml").write_text(config)
    assert call_here(tmp_path, "run", "tiny.toml", "--out", "out")[0] == 0
    return tmp_path


@pytest.fixture
def begun(config, tmp_path):
    """A run of which one unit of two is stored; the folder."""
    made = parse(config)
    store = Run.create(tmp_path / "out", made).begin(config)
    parts = Parts(store.folder, "units")
    parts.add(execute(made, (Layout(made).task(next(units(made))),)))
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


def refused(result, code, *words):
    """Assert one line on standard error, this code, and nothing on standard output."""
    found, said, complained = result
    assert (found, said) == (code, "")
    assert len(complained.splitlines()) == 1, complained
    assert all(word in complained for word in words), complained


def test_status_of_a_finished_run(call_here, run, files_of):
    """Finished, all units done, tables by name; nothing in the folder changes."""
    before = files_of(run)
    code, said, complained = call_here(run, "status", "out")
    assert (code, complained) == (0, "")
    assert "finished" in said.splitlines()[0]
    assert "2, all done" in said
    assert "0 of 40 fits" in said
    assert "errors, summary, timings" in said
    assert files_of(run) == before


def test_status_of_a_run_that_is_begun(call_here, begun, files_of):
    """Begun, and how many units are missing; a part that is damaged is counted and left where it is."""
    said = call_here(begun, "status", "out")[1]
    assert "begun, not finished" in said
    assert "2, of which 1 are done and 1 missing" in said
    assert "1 whole, 0 damaged" in said
    (path,) = (begun / "out" / "parts").iterdir()
    path.write_bytes(path.read_bytes()[:-1])
    before = files_of(begun)
    said = call_here(begun, "status", "out")[1]
    assert "0 whole, 1 damaged" in said
    assert files_of(begun) == before


def test_status_of_a_damaged_run(call_here, run):
    """A table that was changed is named."""
    path = run / "out" / "errors.parquet"
    path.write_bytes(path.read_bytes()[:-1])
    said = call_here(run, "status", "out")[1]
    assert "damaged; `study run` computes the lost rows again" in said
    assert "errors (damaged)" in said


def test_a_run_that_is_written_to(call_here, run):
    """`status` names the writer; a second writer is refused with code 1."""
    with writing(run / "out"):
        assert "written by  process" in call_here(run, "status", "out")[1]
        refused(call_here(run, "run", "tiny.toml", "--out", "out"), 1, "is writing to it")


@pytest.mark.parametrize("verb", ["status", "worst", "summary"])
def test_what_is_no_run(call_here, tmp_path, verb):
    """Code 1 and one line."""
    (tmp_path / "file").write_text("mine")
    for name in ("none", ".", "file"):
        refused(call_here(tmp_path, verb, name), 1, name, "not a run folder")


@pytest.mark.parametrize("verb", [["status", "out"], ["run", "tiny.toml", "--out", "out"]], ids=str)
def test_a_run_of_a_newer_version(call_here, run, files_of, verb):
    """Code 1, one line, nothing touched."""
    store = Run.open(run / "out")
    store.save_manifest(store.manifest() | {"format": FORMAT + 1})
    before = files_of(run)
    refused(call_here(run, *verb), 1, "made by a newer version of this program")
    assert files_of(run) == before


def test_a_run_without_a_manifest(call_here, run):
    """It is not finished: `run` computes it again, to the same bytes."""
    errors = (run / "out" / "errors.parquet").read_bytes()
    (run / "out" / "manifest.json").unlink()
    assert "not begun, or nothing of it is stored" in call_here(run, "status", "out")[1]
    assert call_here(run, "run", "tiny.toml", "--out", "out")[0] == 0
    assert (run / "out" / "errors.parquet").read_bytes() == errors


def test_diff(call_here, run, config):
    """Identical is code 0, different 1, each with the verdict in the first line."""
    assert call_here(run, "run", "tiny.toml", "--out", "again")[0] == 0
    code, said, complained = call_here(run, "diff", "out", "again")
    assert (code, complained) == (0, "")
    assert said.splitlines()[0] == "out and again: identical"
    (run / "other.toml").write_text(config.replace("trials = 5", "trials = 400").replace("seed = 1", "seed = 4"))
    (run / "worse.toml").write_text(config.replace("trials = 5", "trials = 400"))
    for name in ("other", "worse"):
        assert call_here(run, "run", f"{name}.toml", "--out", name)[0] == 0
    code, said, _ = call_here(run, "diff", "other", "worse")
    assert (code, said.splitlines()[0]) == (0, "other and worse: the same within Monte-Carlo error")


def test_diff_of_a_changed_estimator(call_here, run, config, monkeypatch):
    """A difference is code 1."""
    (run / "many.toml").write_text(config.replace("trials = 5", "trials = 100"))
    good = study.ESTIMATORS["lls"]
    assert call_here(run, "run", "many.toml", "--out", "one")[0] == 0

    def worse(samples):
        fit = good(samples)
        fit.center[:] *= 2.0
        return fit

    monkeypatch.setitem(study.ESTIMATORS, "lls", replace(good, function=worse, version=good.version + 1))
    assert call_here(run, "run", "many.toml", "--out", "other")[0] == 0
    code, said, _ = call_here(run, "diff", "one", "other")
    assert (code, said.splitlines()[0]) == (1, "one and other: different")
    assert "lls" in said
    refused(call_here(run, "diff", "one", "none"), 1, "none", "not a run folder")


def test_worst_and_replay(call_here, run):
    """The worst trial's name, as it is printed, is what `replay` takes; the picture is drawn."""
    code, said, complained = call_here(run, "worst", "out", "-n", "3")
    assert (code, complained) == (0, "")
    assert len(said.splitlines()) == 2 + 3 + 1
    words = said.splitlines()[-1].split(": study ")[1].split()
    code, shown, complained = call_here(run, *words)
    assert (code, complained) == (0, "")
    name, ratio = said.splitlines()[2].split()[0], float(said.splitlines()[2].split()[2])
    assert name.split("/")[0] in shown
    assert f"{ratio:.3g}" in shown
    assert (run / "worst.png").stat().st_size > 10_000
    refused(call_here(run, "worst", "out", "-e", "mle"), 1, "no estimator 'mle' in this run; known are lls, ugdk")


def test_regret(call_here, run):
    """The table is printed with a line per estimator, and written where it is asked for."""
    code, said, complained = call_here(run, "regret", "out", "--csv", "regret.csv")
    assert (code, complained) == (0, "")
    assert {line.split()[0] for line in said.splitlines()[3:]} == {"lls", "ugdk"}
    assert (run / "regret.csv").read_text().startswith("samples,estimator,cells,median")
    refused(call_here(run, "regret", "out", "--csv", "regret.txt"), 1, "give a name that ends in .csv or .parquet")
    complained = call_here(run, "regret", "out", "--csv", "regret.csv/below.csv")[2]
    assert complained.startswith("regret.csv/below.csv: cannot be written: ")
    assert "kept" not in complained


@pytest.mark.usefixtures("raises")
def test_failures_above_the_tolerance(call_here, config, tmp_path):
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
    shown = call_here(tmp_path, "replay", "out", failure["name"])[1]
    assert "ZeroDivisionError: my own mistake" in shown
    (tmp_path / "bad.toml").write_text(text.replace("seed = 1", "seed = 1\ntolerate_failures = 0.25"))
    assert call_here(tmp_path, "run", "bad.toml", "--out", "out")[0] == 0


@pytest.mark.parametrize(
    "words",
    [
        ["--backend", "slurm"],
        ["--backend", "dask"],
        ["--scheduler", "tcp://127.0.0.1:9"],
        ["--task", "10"],
        ["--backend", "dask", "--scheduler", "tcp://127.0.0.1:9", "--task", "0"],
    ],
    ids=str,
)
def test_wrong_backends(call_here, config, tmp_path, words):
    """An unknown backend, or one without its scheduler, is wrong usage; nothing is written."""
    (tmp_path / "tiny.toml").write_text(config)
    assert call_here(tmp_path, "run", "tiny.toml", *words)[0] == 2
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


def test_a_scheduler_that_does_not_answer(call_here, config, tmp_path, monkeypatch):
    """Code 1, one line, nothing written."""
    monkeypatch.setattr("study.simulation.runs.workers._PATIENCE", 0.5)
    (tmp_path / "tiny.toml").write_text(config)
    words = ["--backend", "dask", "--scheduler", "tcp://127.0.0.1:9"]
    refused(call_here(tmp_path, "run", "tiny.toml", *words), 1, "tcp://127.0.0.1:9", "no scheduler answers there")
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


@pytest.mark.parametrize("name", ["../evil", "a/b", "..", "/tmp/x", "x\\y"])
def test_names_cannot_leave_the_folder(call_here, config, tmp_path, name):
    """A config's name is a plain word: it becomes a folder's."""
    (tmp_path / "tiny.toml").write_text(config.replace('"tiny"', f"'{name}'"))
    code, _, complained = call_here(tmp_path, "run", "tiny.toml")
    assert code == 2
    assert "name" in complained
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


CONFIG = """name = "need"
seed = 1
estimators = ["lls", "ugdk"]
[design]
kind = "grid"
trials = 400
samples = [5, 20]
noise = [0.01, 0.1]
angle = 90
[precision]
relative_target = 0.08
first = 100
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with a config that has a [precision], and one that has not."""
    (tmp_path / "need.toml").write_text(CONFIG)
    (tmp_path / "fixed.toml").write_text(CONFIG[: CONFIG.index("[precision]")])
    return tmp_path


def test_a_budget_that_ends_at_once(call_here, folder):
    """Code 4 and one line, again and again; every command works on the run; the command in the line finishes it."""
    for _ in range(2):
        code, said, complained = call_here(folder, "run", "need.toml", "--out", "out", "--budget", "0")
        assert (code, said) == (4, "out\n")
        assert len(complained.splitlines()) == 1
        assert complained.startswith("out: stopped by its budget of 0 s: 0 of 4 cells reached the target; `study run ")
        assert complained.endswith(" resumes it\n")
    assert "stopped by its budget of 0 s" in call_here(folder, "status", "out")[1]
    assert "no cell has a trial yet" in call_here(folder, "summary", "out")[1]
    for verb in ("figures", "report"):
        code, _, complained = call_here(folder, verb, "out")
        assert (code, len(complained.splitlines())) == (1, 1)
        assert "its budget ended before any cell had a trial" in complained
    assert call_here(folder, "worst", "out")[0] == 0
    command = call_here(folder, "run", "need.toml", "--out", "out", "--budget", "0")[2].split("`")[1]
    assert call_here(folder, *command.split()[1:]) == (0, "out\n", "")
    assert "finished" in call_here(folder, "status", "out")[1]


def test_a_finished_run(call_here, folder):
    """Status and report count the cells that reached the target; `replay` draws a trial beyond them, with a warning."""
    assert call_here(folder, "run", "need.toml", "--out", "out")[0] == 0
    run = Run.open(folder / "out")
    trials = run.trials()
    assert len(set(trials.values())) > 1
    reached = int((run.table("precision")["reason"] == "target").sum())
    assert f"4, of which {reached} reached the target" in call_here(folder, "status", "out")[1]
    page = folder / "out" / "report.html"
    assert call_here(folder, "report", "out")[0] == 0
    text = page.read_text(encoding="utf-8")
    assert "Trials by need" in text
    assert "the target is reached" in text
    assert "up to 400 trials" in text.replace("\u202f", "").replace("\u00a0", " ")
    name, count = min(trials.items(), key=lambda item: item[1])
    assert count < 400
    code, said, complained = call_here(folder, "replay", "out", name, str(count - 1))
    assert (code, complained) == (0, "")
    code, said, complained = call_here(folder, "replay", "out", name, str(count))
    assert code == 0
    assert f"cell {name}, trial {count}" in said
    assert complained == f"out: cell {name} has {count} trials; trial {count} is not in its tables\n"
    assert call_here(folder, "replay", "out", name, "400")[0] == 2


def test_beside_a_fixed_run(call_here, folder):
    """The trials that both runs have are the same data sets: `diff` finds no difference."""
    assert call_here(folder, "run", "need.toml", "--out", "need")[0] == 0
    assert call_here(folder, "run", "fixed.toml", "--out", "fixed")[0] == 0
    code, said, _ = call_here(folder, "diff", "need", "fixed")
    assert code == 0
    assert said.splitlines()[0] == "need and fixed: identical in the trials that both have"
    assert "errors, trial by trial" in said


def test_plan(call_here, folder):
    """The plan has the least work, up to the first checkpoint, and the most, up to the cap."""
    code, said, complained = call_here(folder, "plan", "need.toml")
    assert (code, complained) == (0, "")
    least, most = said.split("at most")
    assert "up to the first checkpoint, 100 trials" in least
    assert "fits     800\n" in least
    assert "fits     3,200\n" in most


@pytest.mark.parametrize("value", ["-1", "soon"])
def test_budgets_that_are_none(call_here, folder, value):
    """A budget that is no time is wrong usage, and nothing is written."""
    assert call_here(folder, "run", "need.toml", "--out", "out", "--budget", value)[0] == 2
    assert not (folder / "out").exists()


def test_a_budget_for_a_fixed_study(call_here, folder):
    """A budget for a fixed number of trials is refused before anything is run."""
    code, said, complained = call_here(folder, "run", "need.toml", "fixed.toml", "--budget", "1")
    assert (code, said) == (2, "")
    assert "fixed.toml has no [precision]" in complained
    assert sorted(path.name for path in folder.iterdir()) == ["fixed.toml", "need.toml"]


def test_a_wrong_key(call_here, folder):
    """One line for the fault, with the nearest name, and code 2."""
    (folder / "bad.toml").write_text(CONFIG + 'measure = "ratio_medain"\n')
    code, said, complained = call_here(folder, "run", "bad.toml")
    assert (code, said) == (2, "")
    assert len(complained.splitlines()) == 2
    assert "precision.measure = 'ratio_medain'" in complained
    assert "did you mean 'ratio_median'" in complained


AXES = ["x_1", "x_2", "x_3"]


@pytest.fixture(scope="module")
def folder_of_replay_command(tmp_path_factory, config):
    """A run that has not begun: its config is all that a replay needs."""
    folder = tmp_path_factory.mktemp("replay")
    (folder / "out").mkdir()
    (folder / "out" / "config.toml").write_text(config.replace("seed = 1", "seed = 1\nkeep_points = 5"))
    return folder


@pytest.fixture(scope="module")
def made(folder_of_replay_command):
    """The run's study."""
    return Run.open(folder_of_replay_command / "out").study


@pytest.fixture(scope="module")
def points(made):
    """All points of the study, as a worker computes them."""
    parts = [pd.DataFrame(compute(made, unit).points) for unit in units(made)]
    return pd.concat(parts, ignore_index=True)


def refused_of_replay_command(result, code, *words):
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
        assert said.splitlines() == list(regret.trial_printed(run.study, find(run.study, cell, trial)))
    assert f"{row['error']:.3g}" in said
    assert row["estimator"] in said
    assert sorted(path.name for path in folder.iterdir()) == ["out", "tiny.toml"]


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_points_to_a_file(call_here, folder_of_replay_command, points, tmp_path, suffix):
    """Every digit of the stored points is in the file, of either kind, in a folder that is made."""
    cell = str(points["cell"].iloc[-1])
    path = tmp_path / "new" / f"points.{suffix}"
    code, said, complained = call_here(folder_of_replay_command, "replay", "out", cell, "3", "--out", path)
    assert (code, complained) == (0, "")
    assert said.startswith("tiny-")
    frame = pd.read_csv(path, dtype=str).map(float) if suffix == "csv" else pd.read_parquet(path)
    kept = points[(points["cell"] == cell) & (points["trial"] == 3)]
    assert list(frame.columns) == AXES
    np.testing.assert_array_equal(frame.to_numpy(), kept[AXES].to_numpy())
    assert [path.name for path in path.parent.iterdir()] == [f"points.{suffix}"]


def test_the_file_can_be_fitted(call_here, folder_of_replay_command, made, tmp_path):
    """`study fit` reads it, and finds what the replay said."""
    cell = next(unit.cells[0].name for unit in units(made) if unit.group.samples == 20)
    code, said, _ = call_here(folder_of_replay_command, "replay", "out", cell, "0", "--out", tmp_path / "p.csv")
    assert code == 0
    code, fitted, _ = call_here(folder_of_replay_command, "fit", tmp_path / "p.csv", "--estimator", "lls")
    assert code == 0
    (line,) = [line for line in said.splitlines() if line.startswith("lls ")]
    center = np.array([float(cell.split()[0]) for cell in fitted.splitlines()[1].split("  ") if "±" in cell][:3])
    assert np.linalg.norm(center) == pytest.approx(float(line.split()[1]), rel=0.1)


def test_another_kind_of_file(call_here, folder_of_replay_command, points, tmp_path):
    """A suffix of another kind is refused with the kinds that exist, and nothing is written."""
    cell = str(points["cell"].iloc[0])
    for name in ("points.txt", "points"):
        result = call_here(folder_of_replay_command, "replay", "out", cell, "0", "--out", tmp_path / name)
        refused_of_replay_command(result, 1, name, "give a name that ends in .csv or .parquet")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_written(call_here, folder_of_replay_command, points, tmp_path):
    """A folder that is a file, and a file that is a folder: one line that names it."""
    cell = str(points["cell"].iloc[0])
    (tmp_path / "file").write_text("kept")
    (tmp_path / "folder.csv").mkdir()
    refused_of_replay_command(
        call_here(folder_of_replay_command, "replay", "out", cell, "0", "--out", tmp_path / "file" / "p.csv"),
        1,
        "file/p.csv",
        "cannot be",
    )
    refused_of_replay_command(
        call_here(folder_of_replay_command, "replay", "out", cell, "0", "--out", tmp_path / "folder.csv"),
        1,
        "folder.csv",
        "cannot be",
    )
    assert (tmp_path / "file").read_text() == "kept"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder.csv"]


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="nothing is closed to the superuser")
def test_a_folder_that_is_closed(call_here, folder_of_replay_command, points, tmp_path):
    """A folder without the right to write is one line that names it."""
    tmp_path.chmod(0o500)
    refused_of_replay_command(
        call_here(folder_of_replay_command, "replay", "out", points["cell"].iloc[0], "0", "--out", tmp_path / "p.csv"),
        1,
        "p.csv",
    )
    tmp_path.chmod(0o700)


def test_a_cell_that_is_not_there(call_here, folder_of_replay_command, made):
    """A wrong name, or a beginning of several names, is code 2 and one line."""
    refused_of_replay_command(
        call_here(folder_of_replay_command, "replay", "out", "xyz", "0"),
        2,
        "cell 'xyz': no such cell in",
        made.run_name(),
    )
    refused_of_replay_command(call_here(folder_of_replay_command, "replay", "out", "", "0"), 2, "not one cell but 4: ")


def test_a_trial_that_is_not_there(call_here, folder_of_replay_command, points):
    """Code 2 and one line, which says what trials there are."""
    cell = str(points["cell"].iloc[0])
    refused_of_replay_command(
        call_here(folder_of_replay_command, "replay", "out", cell, "5"), 2, f"trial 5: cell {cell} has trial 0 to 4"
    )


@pytest.mark.parametrize("arguments", [["c0", "-1"], ["c0", "one"], [], ["c0", "0", "1"]], ids=str)
def test_wrong_usage(call_here, folder_of_replay_command, arguments):
    """A trial that is no number, or missing, is code 2 and the usage."""
    code, said, complained = call_here(folder_of_replay_command, "replay", "out", *arguments)
    assert (code, said) == (2, "")
    assert "Usage: " in complained


@pytest.mark.parametrize("arguments", [["c0"], ["c0/"], ["c0/x"], ["c0/-1"], ["c0/1", "1"], ["/1/2"]], ids=str)
def test_a_name_that_is_none(call_here, folder_of_replay_command, arguments):
    """A name without a trial's number, or with two, is code 2 and one line that shows the form of names."""
    refused_of_replay_command(
        call_here(folder_of_replay_command, "replay", "out", *arguments), 2, arguments[0], "CELL/TRIAL"
    )


def test_what_is_no_run_replay_command(call_here, folder_of_replay_command):
    """A folder without a config is code 1 and one line."""
    refused_of_replay_command(call_here(folder_of_replay_command, "replay", ".", "c0", "0"), 1, "not a run folder")
    refused_of_replay_command(
        call_here(folder_of_replay_command, "replay", "none", "c0", "0"), 1, "none", "not a run folder"
    )
