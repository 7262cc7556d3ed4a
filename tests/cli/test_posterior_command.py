"""`study posterior`, and `study run` of a config with [posterior]: exit codes, lines, files; interruptions."""

import os
import signal

import pytest

from study.simulation.experiment.config import parse
from study.simulation.posterior.run import chain_tasks, compute, printed
from study.simulation.runs.parts import Parts
from study.simulation.runs.run_folder import Run

NAMES = ["answers", "draws", "posterior"]
ASKED = '\n[posterior]\ntrials = 2\nwalkers = 16\nmax_steps = 100\nwhere = { samples = 20 }\nnoise = "known"\n'
# 16 chains, of which the gate lets some pass
LONG = """name = "long"
seed = 1
estimators = ["mle"]
[design]
kind = "grid"
trials = 16
samples = 20
noise = 0.1
angle = 90
[posterior]
trials = 16
walkers = 16
max_steps = 100
noise = "known"
"""


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


def test_run(done):
    """`study run` stores the posterior tables beside the others, and prints the folder and nothing else."""
    folder, said = done
    assert said == (0, "out\n", "")
    tables = {f"{name}.parquet" for name in ["errors", "timings", "summary", *NAMES]}
    assert {path.name for path in (folder / "out").iterdir()} == {"config.toml", "manifest.json"} | tables
    entry = Run.open(folder / "out").manifest()["posterior"]
    assert entry["chains"] == 4
    assert entry["jobs"] == 2
    assert entry["seconds"] >= 0.0


def test_the_tables_are_the_librarys(done, asked, tmp_path):
    """A command with two workers writes the bytes that one worker writes, and the errors of a run without it."""
    run = computed(tmp_path, asked)
    assert stored(done[0] / "out") == stored(run.folder)


def test_the_run_has_the_same_name_and_errors_as_without(done, finished):
    """A [posterior] in the config does not change the study."""
    plain, other = (Run.open(folder / "out") for folder in (finished[0], done[0]))
    assert plain.study.run_name() == other.study.run_name()
    assert plain.table("errors").equals(other.table("errors"))
    assert plain.metadata("errors")["study.config"] == other.metadata("errors")["study.config"]


def test_posterior(call_here, asked, done):
    """`study posterior` prints the lines of the library; finished chains are not computed again."""
    folder = done[0]
    before = {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in (folder / "out").iterdir()}
    code, said, complained = call_here(folder, "posterior", "out")
    assert (code, complained) == (0, "")
    assert said.splitlines() == list(printed(Run.open(folder / "out")))
    assert said.startswith(parse(asked).run_name())
    assert {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in (folder / "out").iterdir()} == before


def test_posteriors_of_an_old_run(call_here, config, asked, done, tmp_path):
    """A run from before can be given a [posterior]: its config is edited, and the errors stay as they are."""
    (tmp_path / "tiny.toml").write_text(config)
    assert call_here(tmp_path, "run", "tiny.toml", "--jobs", "1", "--out", "out")[0] == 0
    out = tmp_path / "out"
    errors = (out / "errors.parquet").read_bytes()
    (out / "config.toml").write_text(asked)
    code, said, complained = call_here(tmp_path, "posterior", "out", "--jobs", "1")
    assert (code, complained) == (0, "")
    assert "geometric" in said
    assert (out / "errors.parquet").read_bytes() == errors
    assert stored(out) == stored(done[0] / "out")
    assert Run.open(out).manifest()["posterior"]["jobs"] == 1
    assert not (out / "parts").exists()


def test_running_again_keeps_what_the_manifest_says(call_here, asked, tmp_path):
    """A second run computes no chain again, and the manifest still says what the posteriors took."""
    (tmp_path / "tiny.toml").write_text(asked)
    manifests = []
    for _ in range(2):
        assert call_here(tmp_path, "run", "tiny.toml", "--jobs", "1", "--out", "out")[0] == 0
        manifests.append(Run.open(tmp_path / "out").manifest())
    assert "posterior" in manifests[1]
    assert manifests[0]["posterior"] == manifests[1]["posterior"]


def refused(result, code, *words):
    """Assert a refusal: this exit code, nothing on standard output, one line on standard error with these words."""
    found, said, complained = result
    assert (found, said) == (code, "")
    assert len(complained.splitlines()) == 1, complained
    assert all(word in complained for word in words), complained


def test_a_run_without_posteriors(call_here, finished):
    """Code 1, and one line that says what to add."""
    before = {path.name: path.read_bytes() for path in (finished[0] / "out").iterdir()}
    refused(
        call_here(finished[0], "posterior", "out"), 1, "out: its config has no [posterior]", "configs/posterior.toml"
    )
    assert {path.name: path.read_bytes() for path in (finished[0] / "out").iterdir()} == before


def test_where_chooses_no_cell(call_here, config, tmp_path):
    """Code 1, and one line: the values exist, but not together."""
    where = "where = { noise = 0.1, noise_over_radius = 0.01, samples = 20 }"
    (tmp_path / "config.toml").write_text(config + ASKED.replace("where = { samples = 20 }", where))
    refused(call_here(tmp_path, "posterior", "."), 1, "chooses none of its cells")


def test_a_config_with_faults(call_here, config, tmp_path):
    """`study run` tells faults of [posterior] as those of the rest: code 2, a line each, and no folder."""
    text = config + ASKED.replace("samples = 20", "samples = 21")
    (tmp_path / "tiny.toml").write_text(text)
    code, said, complained = call_here(tmp_path, "run", "tiny.toml", "--out", "out")
    assert (code, said) == (2, "")
    number = 1 + next(i for i, line in enumerate(text.splitlines()) if line.startswith("where"))
    assert complained.splitlines()[1:] == [f"  line {number}: posterior.where: no cell has samples = 21"]
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


def test_what_is_no_run(call_here, tmp_path):
    """Code 1 and one line."""
    refused(call_here(tmp_path, "posterior", "."), 1, "not a run folder")


def test_a_run_that_did_not_finish(call_here, asked, done, tmp_path):
    """Posteriors need the config alone: those of a run that was interrupted, or never begun, are the same."""
    out = tmp_path / "half"
    (out / "parts").mkdir(parents=True)
    (out / "config.toml").write_text(asked)
    (out / "parts" / "0123456789abcdef0123.parquet").write_bytes(b"rows of a unit")
    code, _, complained = call_here(tmp_path, "posterior", "half", "--jobs", "1")
    assert (code, complained) == (0, "")
    assert stored(out) == stored(done[0] / "out")
    assert [path.name for path in (out / "parts").iterdir()] == ["0123456789abcdef0123.parquet"]
    assert set(Run.open(out).manifest()["tables"]) == {"posterior", "answers", "draws"}
    assert not Run.open(out).finished()


def test_posteriors_that_cannot_be_written(call_here, asked, tmp_path):
    """A parts folder that is a file is code 1 and one line."""
    (tmp_path / "config.toml").write_text(asked)
    (tmp_path / "parts").write_text("in the way")
    refused(call_here(tmp_path, "posterior", ".", "--jobs", "1"), 1, "cannot be written", "what was finished is kept")


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """The tables of the long config, computed by the library without a break."""
    return stored(computed(tmp_path_factory.mktemp("long"), LONG).folder)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to another process")
@pytest.mark.parametrize(("jobs", "everyone"), [(1, False), (2, True)])
def test_interrupt(hold, long, tmp_path, jobs, everyone):
    """Ctrl-C: code 130, one line, whole parts, no half tables; then the rest is computed, to the same bytes.

    A terminal sends it to the workers as well, which keep silent.
    """
    (tmp_path / "config.toml").write_text(LONG)
    parts = tmp_path / "parts"
    process = hold(tmp_path, parts, jobs, "posterior", ".", "--jobs", jobs)
    (os.killpg if everyone else os.kill)(process.pid, signal.SIGINT)
    said, complained = process.communicate(timeout=600)
    assert (process.returncode, said) == (130, ""), complained
    assert complained.splitlines() == ["interrupted; run the same command again to resume"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["config.toml", "parts"]
    there, run = Parts(tmp_path, "chains"), Run.open(tmp_path)
    there.load()
    kept = [
        task
        for task in chain_tasks(run.study, run.study.posterior)
        if there.outputs(task.part(run.study, run.study.posterior))
    ]
    assert 0 < len(kept) < 16
    assert not there.damaged
    assert not list(parts.glob(".*"))
    before = {path: path.stat().st_mtime_ns for path in parts.iterdir()}
    shares = []
    compute(Run.open(tmp_path), 1, lambda share: shares.append(share) or all_there(before))
    assert len(shares) == 16 - len(kept)
    assert stored(tmp_path) == long
    assert not parts.exists()


def all_there(before):
    """Assert that files are as they were."""
    assert all(path.stat().st_mtime_ns == time for path, time in before.items())
