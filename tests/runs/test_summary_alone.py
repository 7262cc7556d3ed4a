"""Studies that keep only the summary: it is that of the errors, to the bit, and no errors are stored."""

import functools

import pytest

import study
from study.analysis.summary import summarise
from study.estimators import Status
from study.estimators.estimator import Estimator
from study.experiment.config import parse
from study.experiment.units import spans
from study.runs import runner
from study.runs.storage.atomic_write import RunError
from study.runs.storage.run_folder import Run
from study.runs.workers.choose import Workers

pytestmark = pytest.mark.usefixtures("same_software")

GRID = {"trials": 70, "samples": [6, 700], "noise": [0.05, 0.5], "radius": [1.0, 10.0]}


@pytest.fixture
def keep(make_text, tmp_path):
    """Run a study that keeps only the summary."""

    def run(name, top=None, jobs=2, **design):
        text = make_text({"keep": "summary"} | (top or {}), **(GRID | design))
        return runner.run(parse(text), text, tmp_path / name, jobs, warn=str)

    return run


@pytest.mark.parametrize("route", ["points", "moments"])
def test_the_summary_is_that_of_the_errors(start, keep, files, route):
    """The summary is that of stored errors, by both routes."""
    top = {"route": route, "estimators": ["gdke", "ugdk"]} if route == "moments" else {}
    short, whole = keep("short", top), start(top, **GRID)
    summarise(whole)
    assert short.table("summary").equals(whole.table("summary"))
    assert set(files(short.folder)) == {"config.toml", "manifest.json", "timings.parquet", "summary.parquet"}
    assert short.manifest()["tables"].keys() == {"timings", "summary"}


LIMITS = {
    "memory": ("_FITS_IN_MEMORY", 3 * 70 * 4, [3, 1] * 4),
    "time": ("_SAMPLES_IN_SUMMARY", 3 * 70 * 700, [4, 4, 2, 2, 2, 2]),
    "least": ("_FITS_IN_MEMORY", 1, [1] * 16),
}


@pytest.mark.parametrize(("limit", "most", "cells"), LIMITS.values(), ids=LIMITS)
def test_large_summaries_are_cut_by_cells(keep, monkeypatch, limit, most, cells):
    """Cells of many trials are units of their own, which make the same draws: the summary keeps its bytes."""
    whole = keep("whole")
    assert [len(span.group.cells) for span in spans(whole.study)] == [4] * 4
    monkeypatch.setattr(f"study.experiment.units.{limit}", most)
    assert [len(span.group.cells) for span in spans(whole.study)] == cells
    assert keep("apart").path("summary").read_bytes() == whole.path("summary").read_bytes()


def test_moments_cut_by_cells(keep, monkeypatch):
    """So are those that are fitted from joint moments, where a level costs next to nothing."""
    top = {"route": "moments", "estimators": ["gdke", "ugdk"]}
    whole = keep("whole", top)
    monkeypatch.setattr("study.experiment.units._SAMPLES_IN_SUMMARY", 1)
    assert [len(span.group.cells) for span in spans(whole.study)] == [4] * 4
    monkeypatch.setattr("study.experiment.units._FITS_IN_MEMORY", 3 * 70 * 2)
    assert [len(span.group.cells) for span in spans(whole.study)] == [3, 1] * 4
    assert keep("apart", top).path("summary").read_bytes() == whole.path("summary").read_bytes()


@pytest.mark.parametrize("draws", ["shared", "independent"])
def test_bytes_do_not_depend_on_workers(keep, draws):
    """Threads and processes write the same summary."""
    found = [keep(str(jobs), jobs=jobs, draws=draws) for jobs in (1, 2)]
    found.append(keep("loky", jobs=Workers("loky", 2), draws=draws))
    assert len({run.path("summary").read_bytes() for run in found}) == 1


def test_a_run_that_stops_goes_on(keep, computed, monkeypatch):
    """Finished units are not computed again, a finished run computes nothing, and a damaged summary is made again."""
    monkeypatch.setattr("study.runs.workers.backend.Backend.enough", 0.0)
    monkeypatch.setattr("study.runs.storage.parts._SECONDS", 0.0)
    whole = keep("whole")
    everything = list(computed)

    class Stop(BaseException):
        pass

    def stop(share):
        raise Stop

    computed.clear()
    real = runner.run
    monkeypatch.setattr(runner, "run", functools.partial(real, progress=stop))
    with pytest.raises(Stop):
        keep("broken")
    first = list(computed)
    monkeypatch.setattr(runner, "run", real)
    computed.clear()
    run = keep("broken")
    assert sorted([*first, *computed]) == sorted(everything)
    assert run.path("summary").read_bytes() == whole.path("summary").read_bytes()
    computed.clear()
    keep("broken")
    assert computed == []
    run.path("summary").write_bytes(run.path("summary").read_bytes()[:-5])
    assert keep("broken").path("summary").read_bytes() == whole.path("summary").read_bytes()


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


def test_it_is_opened_like_any_other(keep):
    """Its summary is read back, and its errors are missing."""
    run = Run.open(keep("run").folder)
    assert len(run.table("summary")) == 16 * 4
    assert not run.has("errors")


def test_errors_that_were_not_kept(keep):
    """The message says why the errors are missing, and does not say to finish the run."""
    with pytest.raises(RunError, match="keeps its summary alone"):
        keep("alone").table("errors")
