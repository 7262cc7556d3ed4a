"""Failures are rows: of a trial that raises, and of a unit that ends its workers. Everything else is computed."""

import functools
from types import SimpleNamespace

import pytest

from study.fits import Status
from study.simulation.runs import runner, workers
from study.simulation.runs.workers import Workers

pytestmark = pytest.mark.usefixtures("same_software", "small_units")

LLS = {"estimators": ["mle", "lls"]}


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("killed, one process", "killed while it sends")]


@pytest.fixture(params=["killed", *SLOW, "out of memory"])
def deadly(request, monkeypatch, start, tmp_path):
    """Let workers end at one cell of a study; the cell's name, its workers, and a folder with a file for each end."""
    import deadly as module

    cell = start({"estimators": ["lls"]}, draws="independent").table("errors")["cell"].astype(str).iloc[10]
    function, crew = {
        "killed": (module.kill, Workers("loky", 2)),
        "killed, one process": (module.kill, Workers("loky", 1)),
        "killed while it sends": (module.kill_while_sending, Workers("loky", 2)),
        "out of memory": (module.starve, 2),
    }[request.param]
    monkeypatch.setattr(workers, "_GRACE", 0.2)
    monkeypatch.setattr(workers, "_WATCH", 0.1)
    (tmp_path / "ends").mkdir()

    def limit(most):
        replaced = functools.partial(function, tmp_path / "ends", frozenset([cell]), most)
        monkeypatch.setattr(runner, "execute", replaced)

    limit(1000)
    return SimpleNamespace(cell=cell, workers=crew, ends=tmp_path / "ends", limit=limit)


def test_a_deadly_unit_is_tried_twice_and_recorded(start, deadly, computed):
    """Its rows are failures; the rows of all other units are there.

    Running the finished run again, where there is more memory, say, computes the lost unit, and no other.
    """
    told = []
    run = start(LLS, jobs=deadly.workers, warn=told.append, draws="independent")
    assert len(list(deadly.ends.iterdir())) == 2
    errors, failures = run.table("errors"), run.table("failures")
    assert set(errors["cell"][errors["status"] == Status.FAILED]) == {deadly.cell}
    assert errors.loc[errors["status"] == Status.FAILED, ["error", "radius_error", "bound"]].isna().all(axis=None)
    assert set(failures["cell"]) == {deadly.cell}
    assert set(failures["cause"]) == {"worker"}
    causes = ("killed (SIGKILL), perhaps for lack of memory: ", "out of memory (cannot allocate): ")
    (message,) = set(failures["message"])
    assert message.startswith(tuple(f"the worker died, twice: {cause}fewer workers (--jobs)" for cause in causes))
    samples = errors["samples"][errors["cell"] == deadly.cell].iloc[0]
    assert told == [f"{run.folder}: 1 unit is lost, trials 0 to 2 of 1 cell with N = {samples}: {message}"]
    assert len(failures) == run.manifest()["lost"] == 3 * 2
    assert len(errors) == 8 * 3 * 2
    computed.clear()
    deadly.limit(0)
    start(LLS, folder=run.folder, warn=str, draws="independent")
    assert {cell for cell, *_ in computed} == {deadly.cell}
    assert not run.has("failures")
    assert run.path("errors").read_bytes() == start(LLS, draws="independent").path("errors").read_bytes()


def test_a_worker_that_dies_once(start, deadly):
    """The unit is tried again, and its rows are there."""
    deadly.limit(1)
    run = start(LLS, jobs=deadly.workers, draws="independent")
    assert len(list(deadly.ends.iterdir())) == 1
    assert not run.has("failures")
    assert run.manifest()["failures"] == 0
