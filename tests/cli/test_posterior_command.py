"""`study posterior`, and `study run` of a config with [posterior]: exit codes, lines, files; interruptions."""

import os
import shutil
import signal

import pytest

from study.simulation.experiment.config import parse
from study.simulation.posterior.run import chain_tasks, compute, printed
from study.simulation.runs.parts import Parts
from study.simulation.runs.run_folder import Run

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


def test_posterior(well, asked, done):
    """`study posterior` prints the lines of the library; finished chains are not computed again, nor by `run`."""
    folder = done[0]

    def state():
        return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in (folder / "out").iterdir()}

    before = state()
    said = well(folder, "posterior", "out")
    assert said.splitlines() == list(printed(Run.open(folder / "out")))
    assert said.startswith(parse(asked).run_name())
    well(folder, "run", "tiny.toml", "--out", "out")
    assert state() == before


def test_posteriors_of_an_old_run(well, finished, asked, done, tmp_path):
    """A run from before can be given a [posterior]: its config is edited, and the errors stay as they are."""
    out = shutil.copytree(finished[0] / "out", tmp_path / "out")
    errors = (out / "errors.parquet").read_bytes()
    (out / "config.toml").write_text(asked)
    said = well(tmp_path, "posterior", "out", "--jobs", "1")
    assert "geometric" in said
    assert (out / "errors.parquet").read_bytes() == errors
    assert stored(out) == stored(done[0] / "out")
    assert Run.open(out).manifest()["posterior"]["jobs"] == 1
    assert not (out / "parts").exists()


def test_a_run_that_did_not_finish(well, asked, done, tmp_path):
    """Posteriors need the config alone: those of a run that was interrupted, or never begun, are the same."""
    out = tmp_path / "half"
    (out / "parts").mkdir(parents=True)
    (out / "config.toml").write_text(asked)
    part = out / "parts" / "0123456789abcdef0123.parquet"
    part.write_bytes(b"rows of a unit")
    well(tmp_path, "posterior", "half", "--jobs", "1")
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
@pytest.mark.parametrize(("jobs", "everyone"), [(1, False), (2, True)])
def test_interrupt(hold, long, tmp_path, jobs, everyone):
    """Ctrl-C: code 130, one line, whole parts, no half tables; then the rest is computed, to the same bytes.

    A terminal sends it to the workers as well, which keep silent.
    """
    (tmp_path / "config.toml").write_text(long[0])
    parts = tmp_path / "parts"
    process = hold(tmp_path, parts, jobs, "posterior", ".", "--jobs", jobs)
    (os.killpg if everyone else os.kill)(process.pid, signal.SIGINT)
    said, complained = process.communicate(timeout=600)
    assert (process.returncode, said) == (130, ""), complained
    assert complained.splitlines() == ["interrupted; run the same command again to resume"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["config.toml", "parts"]
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
