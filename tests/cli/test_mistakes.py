"""Commands that fail: exit code 1 or 2, a plain message on standard error, no traceback, and nothing written.

Interrupted runs end with code 130 and one line, and keep the finished parts; killed ones leave no workers.

Noise that is not normal, on the command line: every text that has the bound names its law.
"""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from study import cli
from study.simulation.runs.parts import Parts
from study.simulation.runs.workers import interrupts_later


@pytest.fixture
def folder(tmp_path, config):
    """A folder with a good config and a bad one."""
    (tmp_path / "tiny.toml").write_text(config)
    (tmp_path / "bad.toml").write_text(config.replace("trials = 5", "trials = 0").replace("= 90", "= 190"))
    return tmp_path


def names(folder):
    """All that is in a folder."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def refused(result, code, *words):
    """Assert a plain refusal with some words in it."""
    found, said, complained = result
    assert (found, said) == (code, "")
    assert "Traceback" not in complained
    assert "Warning" not in complained
    assert all(word in complained for word in words), complained
    return complained


@pytest.mark.parametrize("verb", ["plan", "run"])
def test_a_bad_config(call_here, folder, verb):
    """A bad config is code 2 and a line per fault, and nothing is written."""
    before = names(folder)
    said = refused(
        call_here(folder, verb, "bad.toml"), 2, "bad.toml: 2 faults", "design.trials = 0", "design.angle = 190"
    )
    assert len(said.splitlines()) == 3
    assert names(folder) == before


def test_a_bad_config_in_a_process_of_its_own(call, folder):
    """In a process of its own the refusal is the same: code 2, a line per fault, no traceback, nothing written."""
    before = names(folder)
    said = refused(call(folder, "run", "bad.toml"), 2, "bad.toml: 2 faults")
    assert len(said.splitlines()) == 3
    assert names(folder) == before


@pytest.mark.parametrize("verb", ["plan", "run"])
def test_a_config_that_is_not_there(call_here, folder, verb):
    """A missing config is code 2 and one line, and nothing is written."""
    before = names(folder)
    said = refused(call_here(folder, verb, "none.toml"), 2, "none.toml", "No such file or directory")
    assert len(said.splitlines()) == 1
    assert names(folder) == before


@pytest.mark.parametrize("verb", ["plan", "run"])
def test_a_name_that_no_config_has(call_here, folder, verb):
    """A name without a suffix that is neither a file nor shipped is code 2, with the nearest name and the list."""
    words = "papre: neither a file nor a shipped config; did you mean 'paper'? Known are anisotropic, bias, "
    said = refused(call_here(folder, verb, "papre"), 2, words)
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments", [["rnu"], ["run"], ["run", "tiny.toml", "--jobs", "0"], ["plan", "-x", "a"]], ids=str
)
def test_wrong_usage(call_here, folder, arguments):
    """Wrong usage is code 2 and the usage."""
    refused(call_here(folder, *arguments), 2, "Usage: ")


def test_what_is_no_run(call_here, folder):
    """A folder that is no run, or none at all, is code 1 and one line that says how to make one."""
    for path, named in ((".", "."), ("none", "none"), ("tiny.toml", "results/tiny-")):
        said = refused(call_here(folder, "summary", path), 1, named, "not a run folder", "study run CONFIG")
        assert len(said.splitlines()) == 1


def test_a_run_that_did_not_finish(call_here, folder):
    """A run without a summary is code 1, one line, and the command that finishes it."""
    (folder / "half").mkdir()
    (folder / "half" / "config.toml").write_text((folder / "tiny.toml").read_text())
    said = refused(call_here(folder, "summary", "half"), 1, "summary.parquet: missing", "study run half/config.toml")
    assert len(said.splitlines()) == 1


def test_the_folder_of_another_config(call_here, folder, config, finished):
    """A folder of another config is code 1 and one line, and is left as it is."""
    (folder / "other.toml").write_text(config.replace("seed = 1", "seed = 2"))
    taken = finished[0] / "out"
    before = {path.name: path.read_bytes() for path in taken.iterdir()}
    said = refused(call_here(folder, "run", "other.toml", "--out", taken), 1, "holds a run of another config")
    assert len(said.splitlines()) == 1
    assert {path.name: path.read_bytes() for path in taken.iterdir()} == before


def test_a_folder_that_cannot_be_made(call_here, folder):
    """A folder below a file is code 1 and one line."""
    said = refused(
        call_here(folder, "run", "tiny.toml", "--out", "tiny.toml/out"), 1, "cannot be written: Not a directory"
    )
    assert len(said.splitlines()) == 1


def test_numbers_beyond_floating_point(call_here, folder, config):
    """A number that no double holds is a fault, not a crash."""
    (folder / "huge.toml").write_text(config.replace("= 90", "= 1" + 400 * "0"))
    refused(call_here(folder, "plan", "huge.toml"), 2, "huge.toml: 1 fault", "design.angle")


@pytest.mark.parametrize("words", ["summary {}", "status {}", "plan {}", "run {}", "summary {}/x"])
def test_a_name_that_the_disk_refuses(call_here, folder, words):
    """A name that is too long for the system is one line, like any other that is not there."""
    code, said, complained = call_here(folder, *words.format("a" * 300).split())
    assert (code in (1, 2), said, len(complained.splitlines())) == (True, "", 1)


def test_a_closed_folder(call_here, folder, finished, monkeypatch):
    """A folder that may not be entered is named, with what to do; so is a manifest that may not be read."""
    (folder / "closed").mkdir()

    def closed(path):
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "is_file", closed)
        code, said, complained = call_here(folder, "status", "closed")
    assert (code, said) == (1, "")
    assert complained == "closed: cannot be read: Permission denied; make it readable, or give another folder\n"
    shutil.copytree(finished[0] / "out", folder / "odd")
    (folder / "odd" / "manifest.json").unlink()
    (folder / "odd" / "manifest.json").mkdir()
    code, said, _ = call_here(folder, "status", "odd")
    assert code == 0
    assert "odd/manifest.json: cannot be read: Is a directory; make it readable, or remove it" in said


# 200 units, of which the gate lets some pass
LONG = """name = "long"
seed = 1
estimators = ["lls"]
[design]
kind = "grid"
trials = 200_000
samples = 1000
noise = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]
angle = 90
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to another process")
@pytest.mark.parametrize(
    ("backend", "jobs", "number"),
    [("threads", 1, signal.SIGINT), ("threads", 2, signal.SIGTERM), ("loky", 2, signal.SIGINT)],
)
def test_interrupt(hold, tmp_path, backend, jobs, number):
    """Ctrl-C and SIGTERM end a run with code 130 and one line; its parts are whole, temporary files are gone."""
    (tmp_path / "long.toml").write_text(LONG)
    parts = tmp_path / "out" / "parts"
    options = ["--out", "out", "--jobs", jobs, "--backend", backend]
    process = hold(tmp_path, parts, jobs, "run", "long.toml", *options)
    # a terminal sends Ctrl-C to the workers, too, and they print nothing; a batch system may signal the parent alone
    os.killpg(process.pid, number) if backend == "loky" else process.send_signal(number)
    said, complained = process.communicate(timeout=600)
    assert process.returncode == 130
    assert said == ""
    kept = Parts(tmp_path / "out", "units")
    kept.load()
    assert kept.count == len(list(parts.iterdir())) > 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["config.toml", "parts"]
    assert complained.splitlines() == ["interrupted; run the same command again to resume"]


@pytest.mark.parametrize(("verb", "words"), [("run", "; run the same command again to resume"), ("estimators", "")])
def test_a_command_that_starts_anew_does_not_say_that_it_resumes(monkeypatch, capsys, verb, words):
    """The line of an interruption promises to resume for commands that store what is finished, and for no others."""
    monkeypatch.setattr(sys, "argv", ["study", verb])

    def interrupted():
        raise SystemExit(130)

    with pytest.raises(SystemExit):
        cli.main(interrupted)
    assert capsys.readouterr().err == f"interrupted{words}\n"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no masks of signals")
def test_processes_that_just_start():
    """A process that starts while a task is sent has the signal blocked from the first; afterwards nothing has."""
    code = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    with interrupts_later():
        started = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert started.stdout == "True\n"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def is_gone(process):
    """True when a process has ended, whether or not its new parent has taken note of it."""
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def test_workers_end_with_a_killed_parent(hold, wait_for, tmp_path):
    """Worker processes at work notice that their parent is gone, and end."""
    (tmp_path / "long.toml").write_text(LONG)
    options = ["--out", "out", "--jobs", 2, "--backend", "loky"]
    process = hold(tmp_path, tmp_path / "out" / "parts", 2, "run", "long.toml", *options)
    children = psutil.Process(process.pid).children()
    workers = [child for child in children if "popen_loky" in " ".join(child.cmdline())]
    assert len(workers) == 2
    process.kill()
    wait_for(lambda: all(map(is_gone, workers)))


IDLE = """
import time
from study.simulation.runs import workers
workers._IDLE = 1e6  # in place of five minutes
with workers.Workers(backend="loky", jobs=2).open() as backend:
    backend.submit(time.sleep, 1000).result()
"""


def test_workers_without_a_task_end_with_a_killed_parent(wait_for):
    """A worker process that still waits for its first task ends, too, and not only when loky's patience ends."""

    def workers():
        children = psutil.Process(process.pid).children()
        return [child for child in children if "popen_loky" in " ".join(child.cmdline())]

    with subprocess.Popen([sys.executable, "-c", IDLE]) as process:
        wait_for(lambda: len(workers()) == 2)
        found = workers()
        process.kill()
    wait_for(lambda: all(map(is_gone, found)))


TOP = """name = "laws"
seed = 1
estimators = ["gdke", "als"]
[design]
kind = "grid"
trials = 5
samples = 20
noise = 0.05
angle = 90
"""

MORE = 'law = ["normal", "student(3)"]\noutlier_share = [0, 0.2]\n'

WORDS = "Gaussian bound at the same σ"


@pytest.fixture(scope="module")
def folder_of_departures(tmp_path_factory):
    """A folder with a config of other noise and one of normal noise."""
    folder = tmp_path_factory.mktemp("laws")
    (folder / "laws.toml").write_text(TOP + MORE, encoding="utf-8")
    (folder / "plain.toml").write_text(TOP, encoding="utf-8")
    return folder


def test_every_text_names_the_law(call_here, folder_of_departures):
    """Summary, worst trials, replayed trials and the report say of which noise the bound is, where it is not plain."""
    for name, expected in (("laws", True), ("plain", False)):
        assert call_here(folder_of_departures, "run", f"{name}.toml", "--out", name)[0] == 0
        for command in ("summary", "worst"):
            code, said, _ = call_here(folder_of_departures, command, name)
            assert code == 0
            assert (WORDS in said) == expected
        trials = [line.split()[0] for line in said.splitlines() if "/" in line.split(" ")[0]]
        replayed = [call_here(folder_of_departures, "replay", name, trial)[1] for trial in trials]
        assert len(replayed) == (10 if expected else 5)
        for text in replayed:
            departs = "law = student(3)" in text or "outliers = 0.2" in text
            assert (f"  {WORDS}: " in text) == departs
            assert ("  bound: " in text) == (not departs)
        assert call_here(folder_of_departures, "report", name)[0] == 0
        page = (folder_of_departures / name / "report.html").read_text(encoding="utf-8")
        assert (WORDS in page) == expected


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ('law = "cauchy"', "line 10: design.law = 'cauchy': 'cauchy' not allowed: every value must be normal, "),
        ("outlier_share = 1.5", "line 10: design.outlier_share = 1.5: 1.5 not allowed: every value must be a share"),
        ("outlier_size = 3", "line 10: design.outlier_size: has no effect without outlier_share"),
    ],
)
def test_refused(call_here, folder_of_departures, entry, words):
    """What makes no sense is one line after the file's name, and nothing is written."""
    (folder_of_departures / "wrong.toml").write_text(TOP + entry + "\n", encoding="utf-8")
    before = sorted(folder_of_departures.iterdir())
    code, said, complained = call_here(folder_of_departures, "run", "wrong.toml")
    assert (code, said) == (2, "")
    assert complained.splitlines()[0] == "wrong.toml: 1 fault"
    assert complained.splitlines()[1].startswith(f"  {words}")
    assert len(complained.splitlines()) == 2
    assert sorted(folder_of_departures.iterdir()) == before
