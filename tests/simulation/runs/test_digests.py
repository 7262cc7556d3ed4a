"""Digests: a table or manifest that was changed since it was written is named, and made again by `study run`.

Studies that keep only the summary: it is that of the errors, to the bit, and no errors are stored.

The run folder: its files when a run is done, and the folders that are refused.

One writer at a time: a second one is refused with the name of the first, unless that one has died.
"""

import hashlib
import json
import os
import signal
import socket
import subprocess
import sys

import pytest

import study
from study import files
from study.files import RunError, holder, writing
from study.fits import Status
from study.fits.points.samples import Estimator
from study.simulation.analysis.summary import summarise
from study.simulation.experiment.config import parse
from study.simulation.runs import run_folder, runner
from study.simulation.runs.parts import DAMAGED, Layout
from study.simulation.runs.run_folder import ManifestDamagedError, ManifestMissingError, Run
from study.simulation.runs.status import RunStatus, printed
from study.simulation.runs.workers import Workers

pytestmark = pytest.mark.usefixtures("same_software")


@pytest.fixture
def run(start):
    """A finished run of two cells with its summary."""
    made = start({"estimators": ["lls"]}, samples=6, angle=60)
    summarise(made)
    return made


def rewrite(run, change):
    """Change the manifest's content as another program would, and leave its digest as it is."""
    path = run.folder / run_folder.NAME
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content, indent=2), encoding="utf-8")


def test_a_table_that_is_changed_after_it_was_read(run):
    """A table is checked again when its file was written, also by the object that read it before."""
    run.table("errors")
    path, data = run.path("errors"), run.path("summary").read_bytes()
    path.write_bytes(data)
    os.utime(path, (2e9, 2e9))  # whatever the steps of the clock
    for read in (lambda: run.table("errors"), lambda: run.check("errors")):
        with pytest.raises(RunError, match="damaged: its SHA-256 is not the one in"):
            read()
    path.unlink()
    with pytest.raises(RunError, match="damaged"):
        run.check("errors")


def test_a_digest_is_sha_256(tmp_path):
    """The digest is that of the bytes, also right after a change that keeps size and place; None without a file."""
    path = tmp_path / "file"
    for data in (b"one", b"two", b"owt"):
        path.write_bytes(data)
        assert files.of_file(path) == hashlib.sha256(data).hexdigest()
    os.utime(path, (1e9, 1e9))
    assert files.of_file(path) == hashlib.sha256(b"owt").hexdigest()
    assert files.of_file(tmp_path / "none") is None
    with pytest.raises(RunError, match="cannot be read"):
        files.of_file(tmp_path)


def test_a_summary_that_is_gone(run):
    """It is said to be missing, by a repair and by the status, and nothing is set aside.

    The status counts the parts that were set aside, and not the tables beside them.
    """
    lines = []
    run.path("summary").unlink()
    assert any(line.endswith("timings, summary (missing)") for line in printed(RunStatus(run.folder)))
    run.set_damaged_aside(lines.append)
    assert lines == [f"{run.path('summary')}: missing, and made again"]
    assert not (run.folder / "parts").exists()
    run.path("timings").write_bytes(b"")
    run.set_damaged_aside(str)
    assert RunStatus(run.folder).parts["set_aside"] == 0
    (run.folder / "parts" / DAMAGED / "units-0.part").touch()
    assert RunStatus(run.folder).parts["set_aside"] == 1


def signed(content):
    """Give a manifest's content its digest."""
    del content["digest"]
    content["digest"] = files.of_json(content)


def drop(name):
    """A change that takes a field out, with the digest of the rest, so that only the fields can show it."""
    return lambda content: [content.pop(name), signed(content)]


def put(name, value):
    """A change that gives a field another value, and the digest of all."""
    return lambda content: [content.update({name: value}), signed(content)]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (drop("tables"), "no field 'tables'"),
        (drop("lost"), "no field 'lost'"),
        (drop("estimators"), "no field 'estimators'"),
        (put("format", "x"), 'format = "x" is not'),
        (put("format", True), "format = true is not"),
        (put("tables", []), r"tables = \[\] is not"),
        (put("tables", {"errors": 3}), "tables.errors = 3 is not"),
        (put("estimators", {"lls": "1"}), 'estimators = {"lls": "1"} is not'),
        (put("failures", None), "failures = null is not"),
        (put("also_computed_by", [3]), "also_computed_by.0 = 3 is not"),
        (put("software", {"commit": 7}), "no field 'software.study'"),
        (put("also_computed_by", [{"commit": 7}]), "also_computed_by.0.commit = 7 is not"),
        (put("own_estimators", ["my.py"]), 'own_estimators.0 = "my.py" is not'),
        (put("run", "test-0123456789"), "of test-0123456789, where config.toml is of test-"),
        (lambda content: content.update(failures=7), "its digest is not that of its content"),
        (lambda content: content.pop("machine"), "its digest is not that of its content"),
        (lambda content: content.update(digest=7), "its digest is not that of its content"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_odd_fields(run, change, words):
    """A missing or odd field is one line with the file and the remedy; `study run` makes the run again."""
    rewrite(run, change)
    with pytest.raises(ManifestDamagedError, match=rf"manifest\.json: damaged: {words}[^\n]*; `study run [^\n]*$"):
        run.manifest()
    assert not run.valid("errors")


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "null", "[" * 100_000, '{"format": 1e999}', "\udcff"], ids=len)
def test_no_manifest_at_all(run, text):
    """Text that is no manifest is damage, however deep it is nested; no file is a run that is not finished."""
    path = run.folder / run_folder.NAME
    path.write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(ManifestDamagedError):
        run.manifest()
    path.unlink()
    with pytest.raises(ManifestMissingError, match=r"missing; finish the run with `study run"):
        run.table("summary")


def test_a_damaged_config_is_not_anothers(start, run):
    """A folder whose config is damaged is still its manifest's, and refuses another config."""
    (run.folder / "config.toml").write_text("name = ")
    with pytest.raises(RunError, match=r"its config cannot be read any more: [^\n]*$"):
        start({"estimators": ["gdke"]}, samples=6, angle=60, folder=run.folder)


def test_a_table_that_is_not_listed(run):
    """A table of another run, or one that a kill left, is not read."""
    run.forget("summary")
    with pytest.raises(RunError, match=r"summary\.parquet: not in manifest\.json, so not of this run"):
        run.table("summary")


GRID = {"trials": 70, "samples": [6, 700], "noise": [0.05, 0.5], "radius": [1.0, 10.0]}


@pytest.fixture
def keep(make_text, tmp_path):
    """Run a study that keeps only the summary."""

    def run(name, top=None, jobs=2, **design):
        text = make_text({"keep": "summary"} | (top or {}), **(GRID | design))
        return runner.run(parse(text), text, tmp_path / name, jobs, warn=str)

    return run


@pytest.mark.parametrize("route", ["points", "moments"])
def test_the_summary_is_that_of_the_errors(start, keep, files_of, route):
    """The summary is that of stored errors, by both routes."""
    top = MOMENTS if route == "moments" else {}
    short, whole = keep("short", top), start(top, **GRID)
    summarise(whole)
    assert short.table("summary").equals(whole.table("summary"))
    assert set(files_of(short.folder)) == {"config.toml", "manifest.json", "timings.parquet", "summary.parquet"}
    assert short.manifest()["tables"].keys() == {"timings", "summary"}


MOMENTS = {"route": "moments", "estimators": ["gdke", "ugdk"]}
LIMITS = {
    "memory": ({}, "_FITS_IN_MEMORY", 3 * 70 * 4, [3, 1] * 4),
    "time": ({}, "_SAMPLES_IN_SUMMARY", 3 * 70 * 700, [4, 4, 2, 2, 2, 2]),
    "least": ({}, "_FITS_IN_MEMORY", 1, [1] * 16),
    "time of moments": (MOMENTS, "_SAMPLES_IN_SUMMARY", 1, [4] * 4),  # where a level costs next to nothing
    "memory of moments": (MOMENTS, "_FITS_IN_MEMORY", 3 * 70 * 2, [3, 1] * 4),
}


@pytest.mark.parametrize(("top", "limit", "most", "cells"), LIMITS.values(), ids=LIMITS)
def test_large_summaries_are_cut_by_cells(keep, monkeypatch, top, limit, most, cells):
    """Cells of many trials are units of their own, which make the same draws: the summary keeps its bytes."""
    whole = keep("whole", top)
    assert [len(unit.group.cells) for unit in whole.study.units()] == [4] * 4
    monkeypatch.setattr(f"study.simulation.experiment.config.{limit}", most)
    assert [len(unit.group.cells) for unit in whole.study.units()] == cells
    assert keep("apart", top).path("summary").read_bytes() == whole.path("summary").read_bytes()


@pytest.mark.parametrize("draws", ["shared", "independent"])
def test_bytes_do_not_depend_on_workers(keep, draws):
    """Threads and processes write the same summary."""
    found = [keep(str(jobs), jobs=jobs, draws=draws) for jobs in (1, 2)]
    found.append(keep("loky", jobs=Workers("loky", 2), draws=draws))
    assert len({run.path("summary").read_bytes() for run in found}) == 1
    assert found[-1].manifest()["backend"] == "loky"


def test_a_finished_summary(keep, computed):
    """A finished run computes nothing, and a damaged summary is made again."""
    run, whole = keep("run"), keep("whole")
    computed.clear()
    keep("run")
    assert computed == []
    run.path("summary").write_bytes(run.path("summary").read_bytes()[:-5])
    assert keep("run").path("summary").read_bytes() == whole.path("summary").read_bytes()


def test_failures_are_rows(keep, monkeypatch):
    """Exceptions of an estimator are in the table of failures, and counted in the summary."""

    def raises(samples):
        raise ZeroDivisionError("my own mistake")

    monkeypatch.setitem(study.ESTIMATORS, "raises", Estimator(raises))
    run = keep("run", {"estimators": ["raises", "lls"]})
    rows = run.table("summary").set_index("estimator")
    assert set(rows.loc["raises"][Status.FAILED.name.lower()]) == {70}
    assert set(rows.loc["lls"][Status.FAILED.name.lower()]) == {0}
    assert len(run.table("failures")) == run.manifest()["failures"] == 70 * 16


def test_errors_that_were_not_kept(keep):
    """The summary is read back; the message says why the errors are missing, and does not say to finish the run."""
    run = Run.open(keep("run").folder)
    assert len(run.table("summary")) == 16 * 4
    assert not run.has("errors")
    with pytest.raises(RunError, match="keeps its summary alone"):
        run.table("errors")


def test_a_foreign_folder(start, tmp_path, files_of):
    """A file is not overwritten, and nothing is made below one; a folder with other things is left as it is.

    An empty folder is taken; a name that the disk refuses gives one clear line.
    """
    path, other, empty = (tmp_path / name for name in ("taken", "other", "empty"))
    path.write_text("mine")
    empty.mkdir()
    other.mkdir()
    (other / "thesis.tex").write_text("mine")
    assert start(folder=empty).folder == empty
    for folder, words in (
        (path, "is a file"),
        (path / "below", "Not a directory"),
        (other, "not empty and no run folder"),
        (tmp_path / ("a" * 300), "too long"),
    ):
        with pytest.raises(RunError, match=words):
            start(folder=folder)
    assert path.read_text() == "mine"
    assert files_of(other) == {"thesis.tex": b"mine"}


def test_a_folder_of_a_run_that_was_killed_in_its_first_write(start, tmp_path, files_of):
    """A lock and a temporary file of the config make no foreign folder; the temporary file is removed."""
    folder = tmp_path / "killed"
    folder.mkdir()
    (folder / ".config.toml.123.tmp").write_text("name = ")
    (folder / ".lock").touch()
    assert start(folder=folder).valid("errors")
    assert not list(folder.glob(".*.tmp"))


def test_a_folder_whose_config_is_broken(start, files_of):
    """A config that cannot be read any more is reported, not replaced, where no manifest says whose run it is."""
    run = start()
    (run.folder / "manifest.json").unlink()
    (run.folder / "config.toml").write_text("seed = ")
    before = files_of(run.folder)
    with pytest.raises(RunError, match="cannot be read any more"):
        start(folder=run.folder)
    assert files_of(run.folder) == before


def test_a_unit_is_named_by_its_content(make_text):
    """A unit's key depends on all that determines its rows, not on its position, the grid or other estimators."""

    def keys(top=None, **design):
        study = parse(make_text(top, **design))
        return {Layout(study).task(unit).key for unit in study.units()}

    alone = keys(samples=[40])
    assert alone < keys(samples=[6, 40])
    for top in ({"name": "other"}, {"estimators": ["lls"]}, {"keep_points": 1}, {"tolerate_failures": 0.5}):
        assert keys(top, samples=[40]) == alone
    for change in ({"top": {"seed": 2}}, {"top": {"dimension": 2}}, {"draws": "independent"}, {"noise": [0.1]}):
        assert not keys(**({"samples": [40]} | change)) & alone


HOLD = """
import sys
from pathlib import Path
from study.files import writing
with writing(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def other(tmp_path):
    """Another process that holds the lock of a folder until it is killed."""
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, encoding="utf-8")
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


def test_one_writer_at_a_time(other, tmp_path):
    """A second one is refused in a line with process and host; the lock's file of a killed writer does not matter.

    The lock is released, and its file removed, in the end and after an exception.
    """
    first = f"process {other.pid} on {socket.gethostname()}"
    assert holder(tmp_path) == first
    with pytest.raises(RunError, match=rf"^[^\n]*{first} is writing to it[^\n]*$"), writing(tmp_path):
        pass
    assert holder(tmp_path) is not None  # still the other's
    os.kill(other.pid, signal.SIGKILL)
    other.wait()
    assert (tmp_path / ".lock").exists()
    assert holder(tmp_path) is None
    with writing(tmp_path):
        assert holder(tmp_path) == f"process {os.getpid()} on {socket.gethostname()}"
    with pytest.raises(ZeroDivisionError), writing(tmp_path):
        raise ZeroDivisionError
    assert holder(tmp_path) is None
    assert list(tmp_path.iterdir()) == []


def test_a_lock_without_words(tmp_path):
    """The file's content is only for a message, so that nonsense in it does no harm."""
    with writing(tmp_path):
        for text in ("", "{}", "[1]", "\x00"):
            (tmp_path / ".lock").write_text(text)
            assert holder(tmp_path) == "another process"
