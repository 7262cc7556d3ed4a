"""`study status`, `diff`, `worst`, `regret`, `replay --plot`, and the codes with which `study run` ends.

Adaptive runs on the command line: `run --budget`, its code 4, and the other commands on such a run.

`study replay`: one trial of a run again, for a reader and as a file. What is refused stands in `test_mistakes`.

`study posterior`, and `study run` of a config with [posterior]: exit codes, lines, files; interruptions.
"""

import os
import shutil
import signal
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import study
from study.simulation.experiment import replay
from study.simulation.experiment.config import ChainStatus, parse
from study.simulation.posterior.run import chain_tasks, compute, printed
from study.simulation.runs.parts import Layout, Parts, execute
from study.simulation.runs.run_folder import Run
from tests.configs import config as small


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


def test_one_command_does_the_work_of_four(well, call_here, tmp_path):
    """`run --plan --figures --summary` prints what plan and summary print, and draws the PNG files of figures."""
    text = small({"estimators": ["lls", "ugdk"]}, trials=5, samples=[5, 10, 20], noise=[0.01, 0.1])  # for fig_regret
    (tmp_path / "small.toml").write_text(text)
    _, said, _ = call_here(tmp_path, "run", "small.toml", "--out", "out", "--plan", "--figures", "--summary")
    pictures = sorted((tmp_path / "out" / "figures").iterdir())
    assert "fig_regret.png" in [path.name for path in pictures]
    assert {path.suffix for path in pictures} == {".png"}
    planned = well(tmp_path, "plan", "small.toml").splitlines()[:-1]  # the last line is the time
    assert said.splitlines()[: len(planned)] == planned
    assert said.endswith(well(tmp_path, "summary", "out"))
    call_here(tmp_path, "figures", "out", "--out", "again")
    assert [(tmp_path / "again" / path.name).read_bytes() for path in pictures] == [p.read_bytes() for p in pictures]


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
    for verb in ("figures", "report", "regret", "rank"):
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


def test_shares(well, call_here, finished, tmp_path):
    """Shares lie beside the run's folder, where they are found; of one that is missing the line has the command."""
    shutil.copy(finished[0] / "tiny.toml", tmp_path)
    name = parse((tmp_path / "tiny.toml").read_text()).run_name()
    assert well(tmp_path, "run", "tiny.toml", "--part", "2/2") == f"results/{name}-part-2-of-2\n"
    assert "share 2/2 of a run, complete" in well(tmp_path, "status", f"results/{name}-part-2-of-2")
    code, said, complained = call_here(tmp_path, "merge", "tiny.toml")
    assert (code, said, complained.count("\n")) == (1, "", 1)
    assert complained.startswith(f"results/{name}: not complete; missing shares: 1 of 2; `study run ")
    assert well(tmp_path, *complained.split("`")[1].split()[1:]) == f"results/{name}-part-1-of-2\n"
    assert well(tmp_path, "merge", "tiny.toml") == f"results/{name}\n"
    for table in ("errors", "summary"):
        merged, whole = (folder / f"{table}.parquet" for folder in (tmp_path / "results" / name, finished[0] / "out"))
        assert merged.read_bytes() == whole.read_bytes()


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


def test_replay(well, finished):
    """The command prints the lines of the library, also for a beginning of the cell's name."""
    folder = finished[0]
    run = Run.open(folder / "out")
    row = run.table("errors").iloc[-1]
    cell, trial = str(row["cell"]), int(row["trial"])
    for word in (cell, cell[:6]):
        said = well(folder, "replay", "out", word, trial)
        assert said.splitlines() == list(replay.printed(run.study, replay.find(run.study, cell, trial)))
    assert f"{row['error']:.3g}" in said
    assert row["estimator"] in said
    assert sorted(path.name for path in folder.iterdir()) == ["out", "tiny.toml"]


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_points_to_a_file(well, replayed, tmp_path, suffix):
    """Every digit of the points is in the file, of either kind, in a folder that is made; the truth is beside it."""
    *_, trial = replay.all_trials(Run.open(replayed / "out").study, 4)
    path = tmp_path / "new" / f"points.{suffix}"
    said = well(replayed, "replay", "out", trial.cell.name, "3", "--out", path)
    assert said.startswith("tiny-")
    frame = pd.read_csv(path, dtype=str).map(float) if suffix == "csv" else pd.read_parquet(path)
    assert list(frame.columns) == ["x_1", "x_2", "x_3"]
    np.testing.assert_array_equal(frame, replay.points(trial))
    assert sorted(path.name for path in path.parent.iterdir()) == [f"points.{suffix}", f"points.truth.{suffix}"]
    truth = path.with_name(f"points.truth.{suffix}")
    frame = pd.read_csv(truth, dtype=str).map(float) if suffix == "csv" else pd.read_parquet(truth)
    assert frame.to_dict("records") == [
        {f"center_{i + 1}": value for i, value in enumerate(trial.cell.center)}
        | {"radius": trial.cell.radius, "noise": trial.cell.noise}
    ]


def test_the_file_can_be_fitted(well, replayed, tmp_path):
    """`study fit` reads it, and finds what the replay said."""
    *_, trial = replay.all_trials(Run.open(replayed / "out").study, 1)
    said = well(replayed, "replay", "out", trial.cell.name, "0", "--out", tmp_path / "p.csv")
    fitted = well(replayed, "fit", tmp_path / "p.csv", "--estimator", "lls")
    (line,) = [line for line in said.splitlines() if line.startswith("lls ")]
    center = np.array([float(cell.split()[0]) for cell in fitted.splitlines()[1].split("  ") if "±" in cell][:3])
    assert np.linalg.norm(center) == pytest.approx(float(line.split()[1]), rel=0.1)


NAMES = ["answers", "draws", "posterior"]
ASKED = '\n[posterior]\ntrials = 2\nwalkers = 16\nmax_steps = 100\nwhere = { samples = 20 }\nnoise = "known"\n'


@pytest.fixture(scope="module")
def asked(config):
    """The small config with a [posterior]: four chains of a hundred steps."""
    return config + ASKED


def stored(folder):
    """Bytes of the posterior tables."""
    return {name: (folder / f"{name}.parquet").read_bytes() for name in NAMES}


def computed(folder, text):
    """The same tables by the library, in one worker, without a break."""
    run = Run.create(folder, parse(text)).begin(text)
    compute(run, 1)
    return run


@pytest.fixture(scope="module")
def done(call, asked, tmp_path_factory):
    """A folder where `study run` ran the config with two workers, and what it said."""
    folder = tmp_path_factory.mktemp("posterior")
    (folder / "tiny.toml").write_text(asked)
    return folder, call(folder, "run", "tiny.toml", "--out", "out")


def test_run(done, asked, tmp_path):
    """`study run` stores the posterior tables beside the others, with the bytes that one worker writes."""
    folder, said = done
    assert said == (0, "out\n", "")
    tables = {f"{name}.parquet" for name in ["errors", "timings", "summary", *NAMES]}
    assert {path.name for path in (folder / "out").iterdir()} == {"config.toml", "manifest.json"} | tables
    entry = Run.open(folder / "out").manifest()["posterior"]
    assert (entry["chains"], entry["jobs"], entry["seconds"] >= 0.0) == (4, 2, True)
    assert stored(folder / "out") == stored(computed(tmp_path, asked).folder)


def test_posterior(call_here, well, asked, done):
    """`study posterior` prints the lines of the library; finished chains are not computed again, nor by `run`.

    A hundred steps are no 50 autocorrelation times: no chain has an answer, and the exit code is 3.
    """
    folder = done[0]

    def state():
        return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in (folder / "out").iterdir()}

    before = state()
    code, said, complained = call_here(folder, "posterior", "out")
    assert (code, complained) == (3, "")
    assert said.splitlines() == list(printed(Run.open(folder / "out")))
    assert said.startswith(parse(asked).run_name())
    (why,) = [line for line in said.splitlines() if "no answer" in line]
    assert why.startswith(f"4 of 4 chains have no answer: {ChainStatus.NOT_CONVERGED.text} (")
    assert why.count(" geometric known") == 3
    assert why.endswith(" …)")
    well(folder, "run", "tiny.toml", "--out", "out")
    assert state() == before


def test_posteriors_of_an_old_run(call_here, finished, asked, done, tmp_path):
    """A run from before can be given a [posterior]: its config is edited, and the errors stay as they are."""
    out = shutil.copytree(finished[0] / "out", tmp_path / "out")
    errors = (out / "errors.parquet").read_bytes()
    (out / "config.toml").write_text(asked)
    code, said, _ = call_here(tmp_path, "posterior", "out", "--jobs", "1")
    assert (code, "geometric" in said) == (3, True)
    assert (out / "errors.parquet").read_bytes() == errors
    assert stored(out) == stored(done[0] / "out")
    assert Run.open(out).manifest()["posterior"]["jobs"] == 1
    assert not (out / "parts").exists()


def test_a_run_that_did_not_finish(call_here, asked, done, tmp_path):
    """Posteriors need the config alone: those of a run that was interrupted, or never begun, are the same."""
    out = tmp_path / "half"
    (out / "parts").mkdir(parents=True)
    (out / "config.toml").write_text(asked)
    part = out / "parts" / "0123456789abcdef0123.parquet"
    part.write_bytes(b"rows of a unit")
    assert call_here(tmp_path, "posterior", "half", "--jobs", "1")[0] == 3
    assert stored(out) == stored(done[0] / "out")
    assert list((out / "parts").iterdir()) == [part]
    assert set(Run.open(out).manifest()["tables"]) == {"posterior", "answers", "draws"}
    assert not Run.open(out).finished()


@pytest.fixture(scope="module")
def long(asked, tmp_path_factory):
    """A config of 16 chains, of which the gate lets some pass; its tables, computed by the library without a break."""
    text = asked.replace('["lls", "ugdk"]', '["mle"]').replace("[0.01, 0.1]", "0.1").replace("[5, 20]", "20")
    text = text.replace("trials = 5", "trials = 16").replace("trials = 2", "trials = 16")
    return text, stored(computed(tmp_path_factory.mktemp("long"), text).folder)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to another process")
@pytest.mark.parametrize(
    ("jobs", "everyone", "name"),
    [
        (1, False, "SIGINT"),
        pytest.param(2, True, "SIGINT", marks=pytest.mark.slow),
        pytest.param(1, False, "SIGKILL", marks=pytest.mark.slow),
    ],
)
def test_interrupt(hold, long, tmp_path, jobs, everyone, name):
    """Ctrl-C: code 130, one line, whole parts, no half tables; then the rest is computed, to the same bytes.

    A terminal sends it to the workers as well, which keep silent. A process that is killed leaves as much.
    """
    (tmp_path / "config.toml").write_text(long[0])
    parts = tmp_path / "parts"
    process = hold(tmp_path, parts, jobs, "posterior", ".", "--jobs", jobs)
    number = getattr(signal, name)
    (os.killpg if everyone else os.kill)(process.pid, number)
    said, complained = process.communicate(timeout=600)
    end = (130, "interrupted; run the same command again to resume\n") if number == signal.SIGINT else (-number, "")
    assert (process.returncode, said, complained) == (end[0], "", end[1])
    assert {path.name for path in tmp_path.iterdir()} - {".lock"} == {"config.toml", "parts"}
    there, run = Parts(tmp_path, "chains"), Run.open(tmp_path)
    there.load()
    tasks = chain_tasks(run.study)
    whole = [task for task in tasks if there.outputs(task.part)]
    assert 0 < len(whole) < 16
    assert not there.damaged
    assert not list(parts.glob(".*"))
    before = {path: path.stat().st_mtime_ns for path in parts.iterdir()}
    shares = []

    def note(share):
        shares.append(share)
        assert all(path.stat().st_mtime_ns == time for path, time in before.items())

    compute(Run.open(tmp_path), 1, note)
    assert len(shares) == 16 - len(whole)
    assert stored(tmp_path) == long[1]
    assert not parts.exists()
