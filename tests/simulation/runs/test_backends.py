"""Threads, processes and a Dask cluster give the same bytes, even if Dask workers are killed.

Dispatch: units are computed outside the main thread, progress adds up, and no result is lost or waits for long. Items
are put together until they are heavy enough, the heaviest in sight first. A worker refuses tasks if it would compute
other bytes than its parent.
"""

import contextlib
import functools
import gc
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import study
from study.files import RunError
from study.fits import registry
from study.fits.points.samples import Estimator
from study.simulation.experiment.config import parse
from study.simulation.runs import provenance, workers
from study.simulation.runs.parts import Packet, Parts
from study.simulation.runs.plan import plan
from study.simulation.runs.workers import (
    DisagreementError,
    Dispatch,
    Threads,
    Workers,
    cut,
    enter,
    introduction,
    seal,
    serve,
)

pytestmark = pytest.mark.usefixtures("same_software")


ENTRIES = {"top": {"keep_points": 1}, "trials": 120, "samples": [20, 1000], "draws": "independent"}


@pytest.fixture
def one_unit_in_a_task(monkeypatch):
    """Many small tasks, so that all workers have some."""
    monkeypatch.setattr("study.simulation.experiment.designs._SAMPLES_PER_UNIT", 500)
    monkeypatch.setattr("study.simulation.runs.workers.Threads.enough", 0.0)
    monkeypatch.setattr("study.simulation.runs.workers.DaskCluster.enough", 0.0)


@pytest.fixture
def expected(start, one_unit_in_a_task, tables):
    """The tables that one thread makes."""
    return tables(start(jobs=1, **ENTRIES))


def read_scheduler(path):
    """Read the file in which a scheduler gives its address; None until all of it is there."""
    try:
        return json.loads(path.read_text())
    except (FileNotFoundError, json.JSONDecodeError):
        return None


@pytest.fixture
def gate(held, tmp_path, monkeypatch):
    """Let this process and the workers that it starts find `held.py`, and its gate, a folder."""
    folder = tmp_path / "gate"
    folder.mkdir()
    monkeypatch.setenv("GATE", str(folder))
    monkeypatch.syspath_prepend(str(held.parent))
    return folder


@pytest.fixture
def cluster(gate, held, wait_for, tmp_path):
    """A scheduler and two workers, each a process, started as the manual says; its address and the workers."""
    paths = [str(Path(study.__file__).parents[1]), str(held.parent), str(Path(__file__).parent)]
    paths.append(os.environ.get("PYTHONPATH", ""))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    processes, place = [], tmp_path / "scheduler.json"

    def begin(*words):
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        processes.append(subprocess.Popen([sys.executable, "-m", *words], cwd=tmp_path, env=environment, **quiet))
        return processes[-1]

    scheduler = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-jupyter", "--scheduler-file", str(place)]
    try:
        begin("distributed.cli.dask_scheduler", *scheduler)
        address = wait_for(lambda: read_scheduler(place), lambda: processes[0].poll() is None)["address"]
        more = ["--", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        yield address, [begin("study.cli", "worker", address, *more) for _ in range(2)]
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed")
def test_dask_with_a_worker_killed_midway(start, expected, tables, cluster, gate, wait_for, monkeypatch):
    """One of two Dask workers is killed while it computes, after a few results: the other computes the rest."""
    import held

    address, crew = cluster
    shares, killed = [], []

    def progress(share, done, total):
        shares.append(share)
        if len(shares) == held.FREE:
            path, *_ = wait_for(lambda: list(gate.glob("held-*")))
            (worker,) = [worker for worker in crew if path.name.endswith(f"-{worker.pid}")]
            worker.kill()
            killed.append(worker)
            (gate / "open").touch()

    monkeypatch.setattr("study.simulation.runs.workers._PATIENCE", 600.0)  # a busy machine may answer late
    monkeypatch.setattr("study.simulation.runs.runner.execute", held.execute)
    run = start(jobs=Workers("dask", 2, address), progress=progress, **ENTRIES)
    assert len(killed) == 1
    assert len(shares) > 10
    assert tables(run) == expected
    assert not run.has("failures")
    assert run.manifest()["backend"] == "dask"


MINE = """
import numpy as np
import study

def mean(points):
    return points.mean(axis=0), np.ptp(points) / 2.0

study.register("mean", mean)
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed")
def test_dask_with_an_estimator_of_ones_own(start, one_unit_in_a_task, cluster, tmp_path, monkeypatch):
    """The text of the file goes to the workers with the tasks: they need not have it."""
    from study.fits import registry

    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    registry.load(tmp_path / "mine.py")
    entries = {"top": {"estimators": ["mean", "gdke"]}, "trials": 40, "samples": [20, 50], "draws": "independent"}
    try:
        monkeypatch.setattr("study.simulation.runs.workers._PATIENCE", 600.0)
        alone = start(jobs=1, **entries)
        (tmp_path / "mine.py").unlink()
        run = start(jobs=Workers("dask", 2, cluster[0], task=1e-6), **entries)
        with Workers("dask", 2, cluster[0], task=30.0).open() as backend:
            assert backend.enough == 3e9
    finally:
        for path, _ in registry.loaded():
            registry.unload(path)
    assert set(run.table("errors")["estimator"]) == {"mean", "gdke"}
    assert not run.has("failures")
    assert (run.folder / "errors.parquet").read_bytes() == (alone.folder / "errors.parquet").read_bytes()
    assert run.manifest()["backend"] == "dask"


@pytest.fixture
def no_second_worker(monkeypatch):
    """Let the scheduler fail a task as soon as one worker has died of it."""
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "0")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed")
def test_dask_with_a_task_that_kills_its_workers(start, no_second_worker, cluster, tmp_path, monkeypatch):
    """The scheduler fails the task; it is tried once more, and given up; the run ends, without a worker left."""
    import deadly

    small = {"top": {"estimators": ["lls"]}, "samples": 6, "noise": 0.05, "angle": 60}
    (cell,) = set(start(**small).table("errors")["cell"])
    (tmp_path / "ends").mkdir()
    kill = functools.partial(deadly.kill, tmp_path / "ends", frozenset([cell]), 1000)
    monkeypatch.setattr("study.simulation.runs.workers._PATIENCE", 600.0)
    monkeypatch.setattr("study.simulation.runs.runner.execute", kill)
    address, crew = cluster
    run = start(jobs=Workers("dask", 2, address), **small)
    assert [worker.wait() for worker in crew] == [-signal.SIGKILL] * 2
    assert run.manifest()["lost"] == len(run.table("failures")) == 3
    assert all(message.startswith("the worker died, twice: ") for message in run.table("failures")["message"])


@pytest.fixture(params=["tcp://127.0.0.1:9", "nonsense://x", "127.0.0.1:notaport"])
def address(request, monkeypatch):
    """An address where no scheduler answers, for which nobody waits long."""
    monkeypatch.setattr("study.simulation.runs.workers._PATIENCE", 0.5)
    monkeypatch.setattr("study.simulation.runs.workers._STARTING", 0.5)
    return request.param


def test_a_worker_without_a_scheduler(address, monkeypatch):
    """`study worker` says in one line that none answers; Dask's worker, which ends with a traceback, is not begun."""
    begun = []
    monkeypatch.setattr(os, "execv", lambda *words: begun.append(words))
    with pytest.raises(RunError, match=f"^{re.escape(address)}: no scheduler answers there: [^\n]+$"):
        serve(address, [])
    assert begun == []


def test_no_scheduler(start, tmp_path, address):
    """An address where none answers: one line that names it, and nothing is written."""
    with pytest.raises(RunError, match="no scheduler answers there") as told:
        start(jobs=Workers("dask", 2, address), folder=tmp_path / "run")
    assert address in str(told.value)
    assert "\n" not in str(told.value)
    assert not (tmp_path / "run").exists()
    distributed = pytest.importorskip("distributed")
    left = [thing for thing in gc.get_objects() if type(thing) is distributed.Client and thing.status != "closed"]
    assert left == [], "a client that is collected in the thread of another one stops both"


@pytest.mark.parametrize("jobs", [1, 2])
def test_units_are_computed_outside_the_main_thread(start, make_text, monkeypatch, jobs):
    """No worker is the main thread, which is the one that Ctrl-C interrupts, nor is a plan calibrated there.

    Numba 0.68 ends the process with a segmentation fault if an exception rises while it unboxes a Generator.
    """
    good, threads = study.ESTIMATORS["lls"], set()

    def watched(samples):
        threads.add(threading.current_thread())
        return good(samples)

    monkeypatch.setitem(study.ESTIMATORS, "watched", Estimator(watched))
    for compute in (lambda top: start(top, jobs=jobs), lambda top: plan(parse(make_text(top)), jobs)):
        threads.clear()
        compute({"estimators": ["watched"]})
        assert 1 <= len(threads) <= jobs
        assert threading.main_thread() not in threads


@pytest.mark.usefixtures("small_parts")
def test_progress_is_told_to_the_end(start, make_text):
    """The callback is called once per task, with shares that add up to 1, and the units that are done, of all."""
    calls, units = [], len(list(parse(make_text()).units()))
    start(progress=lambda *numbers: calls.append(numbers))
    shares, done, total = zip(*calls, strict=True)
    assert sum(shares) == pytest.approx(1.0)
    assert min(shares) > 0.0
    assert (done, total) == (tuple(range(1, units + 1)), (units,) * units)


@pytest.fixture
def dispatch(tmp_path):
    """Send numbers to two threads, one at a time, to a function that may return or raise."""

    def send(function, count, ended):
        def work(shared, items):
            function(*items)
            return Packet.of([(str(items[0]), ("number@1",))], [{}])

        parts = Parts(tmp_path, "numbers")
        with contextlib.closing(Threads(2)) as backend:
            Dispatch(backend, work, None, parts).compute(range(count), lambda number: 1e9, ended)
        return parts

    return send


def test_results_do_not_pile_up(dispatch):
    """Tasks are sent as results are stored: never more are computed ahead of that than the workers have room for."""
    computed, stored, ahead = [], [], []

    def function(number):
        computed.append(number)
        ahead.append(len(computed) - len(stored))

    parts = dispatch(function, 200, lambda numbers, failure: stored.extend(numbers))
    assert sorted(stored) == sorted(computed) == list(range(200))
    assert all(parts.outputs(str(number)) for number in range(200))
    assert max(ahead) <= 6


def test_workers_that_become_more(dispatch, monkeypatch):
    """The number of tasks that are sent follows the number of workers while items are computed."""
    stored, counts = [], iter(range(2, 10**6))
    monkeypatch.setattr(Threads, "slots", property(lambda self: next(counts)))
    dispatch(lambda number: None, 20, lambda numbers, failure: stored.extend(numbers))
    assert sorted(stored) == list(range(20))
    assert next(counts) > 20


def test_what_came_is_stored_when_a_task_raises(dispatch, tmp_path):
    """The exception comes out; tasks that were finished then are stored, and no other is begun."""
    computed = []

    def function(number):
        if number == 30:
            raise ZeroDivisionError("my own mistake")
        computed.append(number)

    with pytest.raises(ZeroDivisionError, match="my own mistake"):
        dispatch(function, 1000, lambda numbers, failure: None)
    parts = Parts(tmp_path, "numbers")
    parts.load()
    assert {number for number in range(1000) if parts.outputs(str(number))} == set(computed)
    assert 29 <= len(computed) < 60


def weigh(item):
    """The weight of an item is the item."""
    return item


def test_small_items_go_together():
    """Each task has one item where one is heavy enough; of equal weights the first goes first, of others the heaviest.

    Items are added until the task weighs enough; the last task may weigh less.
    """
    assert list(cut([3, 9, 5, 7], weigh, 1)) == [(9,), (7,), (5,), (3,)]
    assert list(cut([(1, "a"), (1, "b")], lambda item: item[0], 0)) == [((1, "a"),), ((1, "b"),)]
    assert list(cut([1] * 7, weigh, 3)) == [(1, 1, 1), (1, 1, 1), (1,)]
    assert [sum(items) for items in cut([5, 1, 1, 1, 2], weigh, 3)] == [5, 3, 2]


@pytest.fixture
def fresh(monkeypatch):
    """Let this process stand for a worker that has not had a task yet."""
    monkeypatch.setattr(workers, "_agreed", [])


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize("name", ["numpy", "code generated for", "sources"])
def test_a_worker_that_differs_refuses(name):
    """It says what differs, and calls nothing; a later task from a parent that agrees is computed."""
    parent = introduction()
    other = parent._replace(fingerprint=parent.fingerprint | {name: "another"})
    with pytest.raises(DisagreementError, match=f"{name} .* instead of another") as refused:
        enter(other, b"this cannot be unpickled")
    assert f"{name} {parent.fingerprint[name]} instead of another" in str(refused.value)
    assert enter(parent, seal(divmod, 17, 5)) == (3, 2)


@pytest.mark.parametrize(
    "changed", ["fits/estimators/closed_forms.py", "simulation/experiment/compute.py", "simulation/statistics.py"]
)
def test_another_source_is_another_fingerprint(tmp_path, monkeypatch, changed):
    """A worker whose code of the fits, the experiment or the statistics differs in one byte would be refused."""
    home = shutil.copytree(provenance._HOME, tmp_path / "study", ignore=shutil.ignore_patterns("__pycache__"))
    before = provenance.fingerprint()["sources"]
    monkeypatch.setattr(provenance, "_HOME", home)
    assert provenance.fingerprint()["sources"] == before
    (home / changed).write_text((home / changed).read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert provenance.fingerprint()["sources"] != before


def test_processes_have_no_names_that_their_parent_gave_up(tmp_path):
    """A second file registers the name that the first had: it was refused in processes that had served the first."""
    for name, radius in (("one.py", 1.0), ("two.py", 2.0)):
        path = tmp_path / name
        path.write_text(f"import study\nstudy.register('mine', lambda points: (points.mean(axis=0), {radius}))\n")
        registry.load(path)
        try:
            processes = workers.Processes(2)
            assert processes.submit(registry.loaded).result(timeout=120)[-1][0] == str(path)
        finally:
            registry.unload(str(path))
