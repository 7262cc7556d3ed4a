"""`study status`, `diff`, `worst`, `regret`, `replay --plot`, and the codes with which `study run` ends."""

from dataclasses import replace

import pytest

import study
from study.experiment.config import parse
from study.experiment.units import spans
from study.runs.jobs import Jobs, execute
from study.runs.storage.lock import writing
from study.runs.storage.parts import FORMAT, Parts
from study.runs.storage.run_folder import Run


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
    parts.add(execute(made, (Jobs(made).job(next(spans(made))),)))
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
    monkeypatch.setattr("study.runs.workers.dask_cluster._PATIENCE", 0.5)
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
