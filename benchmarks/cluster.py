"""A cluster that only waits: what a scheduler and the parent of a run take with 10, 100 and 1000 workers.

Not run by `make bench`, because it takes minutes: ``python benchmarks/cluster.py`` stores results/cluster*.csv, which
docs/cluster.md quotes. Scheduler and parent are those of ``study run --backend dask``, and each is a process. So are
the workers Dask's, but all share a process, and a task that would compute for some seconds sleeps for them instead. It
then returns as many random rows as it would return. So there may be more workers than this machine has cores.
"""

import asyncio
import csv
import heapq
import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from study import instruction_set

instruction_set.fix()

import numpy as np
import psutil

from study.simulation.experiment.compute import Errors, Result
from study.simulation.experiment.config import Study, parse
from study.simulation.experiment.designs import Batch
from study.simulation.experiment.sampling import units
from study.simulation.runs import jobs, runner, workers
from study.simulation.runs.parts import Packet, Parts
from study.simulation.runs.workers import PER_SECOND, Parent, Workers

RESULTS = Path(__file__).resolve().parents[1] / "results"
CONFIG = """name = "cluster"
seed = 2009
estimators = ["mle", "lls", "gdke", "ugdk"]
[design]
kind = "grid"
trials = {trials}
samples = 1_000_000
noise_over_radius = {{ logspace = [1e-13, 1e14, 28] }}
angle = [5, 15, 30, 60, 90, 135, 180]
radius = [0.1, 1, 10]
"""
_packets: dict[tuple[int, ...], Packet] = {}
"""What tasks of some sizes return, made once, because many workers share a core here."""
THREADS = 10
"""Threads of a Dask worker, like the cores of a machine; all Dask workers share a process."""
_SECONDS, _TASKS, _EACH = 20.0, 3000, 2
"""Work of each worker in seconds; but no more tasks than so many, and no fewer than so many for each worker."""


LARGE = """name = "large"
seed = 2009
estimators = ["mle", "lls", "gdke", "ugdk"]
keep = "summary"
[design]
kind = "grid"
trials = 1_000_000
most_samples = 5_000_000_000
samples = [4, 10, 100, 1_000, 10_000, 100_000, 1_000_000]
noise_over_radius = { logspace = [1e-13, 1e14, 28] }
angle = [5, 15, 30, 60, 90, 135, 180]
radius = [0.1, 1, 10]
"""
"""The factorial of configs/factorial.toml with a million trials a cell, fewer for large N."""


class Case(NamedTuple):
    """A cluster and the tasks that it computes.

    Attributes:
        workers: number of workers, of one thread each.
        task: least length of a task, in seconds.
    """

    workers: int
    task: float


CASES = [Case(workers, task) for task in (0.5, 10.0) for workers in (10, 100, 1000)]


async def asleep(pace: float, _: Parent, call: bytes) -> Packet:
    """Sleep for as long as jobs take, and return as many rows; in place of `study.simulation.runs.workers.enter`.

    A coroutine, so that a thousand of them need no thousand threads.
    """
    began = time.monotonic()
    study, some = pickle.loads(call)[1]
    shape = tuple(task.batch.rows for task in some)
    if shape not in _packets:
        _packets[shape] = jobs._packed(study, some, _random)
    await asyncio.sleep(began + pace * sum(task.weight for task in some) - time.monotonic())
    return _packets[shape]._replace(keys=[(task.key, task.outputs) for task in some])


def _random(study: Study, batch: Batch) -> Result:
    """Random errors of all fits of a unit, which cannot be compressed, like real ones."""
    rng, result = np.random.default_rng(), Result(study)
    shape = (len(batch.cells), len(study.estimators), batch.trials)
    errors = Errors(
        batch=batch,
        estimators=study.estimators,
        conditions=tuple(condition.name for condition in study.conditions()),
        bound=rng.random((shape[2], study.dimension + 1, study.dimension + 1)),
        center=rng.standard_normal((*shape, study.dimension)),
        radius=rng.standard_normal(shape),
        noise_variance=rng.random(shape),
        status=np.zeros(shape, dtype=np.int8),
        condition=rng.random(shape),
        iterations=rng.integers(1, 9, shape, dtype=np.int32),
    )
    result.blocks.append(errors)
    result.clock("draw", batch.group.samples, batch.trials)
    return result


def config(weight: float) -> str:
    """Config of a study of about so much work; see `study.simulation.runs.jobs.UnitTask`."""
    return CONFIG.format(trials=max(1, round(100 * weight / _weight(parse(CONFIG.format(trials=100))))))


def _weight(study: Study) -> float:
    found = jobs.Layout(study)
    return sum(found.task(unit).weight for unit in units(study))


def pace() -> float:
    """Seconds of one core to the weight of a task, measured on some units of the study."""
    study = parse(CONFIG.format(trials=100))
    found = jobs.Layout(study)
    some = [found.task(unit) for unit in islice(units(study), 5)]
    seconds = []
    for task in some:
        began = time.process_time()
        jobs.execute(study, (task,))
        seconds.append((time.process_time() - began) / task.weight)
    return min(seconds)


def counted(function: Callable[..., object], note: Callable[..., None]) -> Callable[..., object]:
    """A function that also hands its result and its arguments to another."""

    def both(*arguments: object) -> object:
        found = function(*arguments)
        note(found, *arguments)
        return found

    return both


def parent(address: str, case: Case, speed: float, folder: Path) -> dict[str, float]:
    """Run the study of a case on a cluster, as `study run` does; returns what it took.

    Args:
        address: the scheduler's.
        case: the case.
        speed: seconds to the weight of a task.
        folder: of the run.
    """
    whole = max(_EACH * case.workers, min(_TASKS, case.workers * _SECONDS / case.task)) * case.task / speed
    text = config(whole)
    study = parse(text)
    workers.DaskCluster.enough = case.task / speed
    workers.enter = partial(import_module("cluster").asleep, speed)  # by a name that the workers can import
    sent, came, times = [], [], {}
    workers.seal = counted(workers.seal, lambda call, *_: sent.append(len(call)))
    Parts.add = counted(Parts.add, lambda _, parts, packet: came.append(sum(map(len, packet.tables.values()))))
    compute, finish = runner._Computation.compute, runner.finish

    def timed_compute(*arguments: object) -> None:
        began, busy = time.perf_counter(), time.process_time()
        compute(*arguments)
        times["seconds"], times["parent_cpu"] = time.perf_counter() - began, time.process_time() - busy
        files = list((folder / "parts").glob("*.part"))
        times["files"], times["parts_mb"] = len(files), sum(path.stat().st_size for path in files) / 1e6
        times["parent_mib"] = _peak()

    def timed_finish(*arguments: object) -> None:
        began = time.perf_counter()
        finish(*arguments)
        times["finish"], times["finish_mib"] = time.perf_counter() - began, _peak()

    runner._Computation.compute, runner.finish = timed_compute, timed_finish
    runner.run(study, text, folder, Workers("dask", scheduler=address))
    work = speed * _weight(study)
    return {
        "tasks": len(sent),
        "task_seconds": work / len(sent),
        "efficiency": work / (case.workers * times["seconds"]),
        "sent_kb": sum(sent) / len(sent) / 1e3,
        "came_kb": sum(came) / len(sent) / 1e3,
        **times,
    }


def _peak() -> float:
    """Peak memory of this program in MiB; `resource` would count that of the program that started it, too."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024


async def host(address: str, count: int, folder: str) -> None:
    """Be so many workers of a scheduler, until it ends."""
    import dask
    from distributed import Worker

    dask.config.set({"distributed.worker.profile.enabled": False})  # it would cost a tenth of this machine
    options = {"nthreads": THREADS, "memory_limit": 0, "local_directory": folder, "host": "127.0.0.1"}
    workers = await asyncio.gather(*(Worker(address, **options) for _ in range(count // THREADS)))
    print("ready", flush=True)
    await asyncio.gather(*(worker.finished() for worker in workers))


def measure(case: Case, speed: float, folder: Path) -> dict[str, float]:
    """Start a cluster, run a study on it from a process of its own, and end the cluster."""
    place, me, started = folder / "scheduler.json", [sys.executable, __file__], []
    words = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-jupyter", "--scheduler-file", str(place)]
    path = os.pathsep.join([*sys.path[:1], *os.environ.get("PYTHONPATH", "").split(os.pathsep)])  # where this file is
    quiet: dict[str, Any] = {"stderr": subprocess.DEVNULL, "text": True, "stdout": subprocess.PIPE}
    quiet["env"] = os.environ | {"PYTHONPATH": path}
    try:
        started.append(subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_scheduler", *words], **quiet))
        while not (place.is_file() and place.read_text().rstrip().endswith("}")):
            time.sleep(0.1)
        address = json.loads(place.read_text())["address"]
        started.append(subprocess.Popen([*me, "host", address, str(case.workers), str(folder)], **quiet))
        assert started[1].stdout.readline() == "ready\n"
        scheduler, workers = (psutil.Process(process.pid) for process in started)
        before = _cpu(scheduler), _cpu(workers)
        told = [json.dumps(case), repr(speed), str(folder / "run")]
        found = json.loads(subprocess.run([*me, "parent", address, *told], check=True, stdout=subprocess.PIPE).stdout)
        found |= {"scheduler_cpu": _cpu(scheduler) - before[0], "workers_cpu": _cpu(workers) - before[1]}
        return found | {"scheduler_mib": scheduler.memory_info().rss / 2**20}
    finally:
        for process in started:
            process.terminate()
            process.wait()


def _cpu(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def schedule() -> list[dict[str, float]]:
    """Seconds that the study of 10¹³ samples takes by the weights of its units, the heaviest first; nothing is run."""
    study, rows = parse(LARGE), []
    found = jobs.Layout(study)
    some = [found.task(unit) for unit in units(study)]
    seconds = sorted((task.weight / PER_SECOND for task in some), reverse=True)
    fits = study.design.groups(study.seed, study.dimension)
    data_sets = sum(group.width * study.design.trials_of(group.samples) for group in fits)
    for count in (10, 100, 1000):
        busy = [0.0] * count
        for each in seconds:
            heapq.heapreplace(busy, busy[0] + each)
        rows.append(
            {
                "workers": count,
                "units": len(some),
                "samples": sum(j.batch.rows * j.batch.group.samples for j in some),
                "rows": data_sets * len(study.estimators),
                "core_hours": sum(seconds) / 3600,
                "longest": seconds[0],
                "seconds": max(busy),
                "efficiency": sum(seconds) / count / max(busy),
            }
        )
    return rows


def store(rows: list[dict[str, float]], name: str) -> None:
    """Write rows to a table of the results, with four digits."""
    with open(RESULTS / name, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: v if isinstance(v, int) else float(f"{v:.4g}") for k, v in row.items()})


def main() -> None:
    """Measure all cases, print them, and store them."""
    store(schedule(), "cluster-study.csv")
    speed, rows = pace(), []
    for case in CASES:
        with tempfile.TemporaryDirectory() as name:
            rows.append(case._asdict() | measure(case, speed, Path(name)))
        print(rows[-1], flush=True)
    store(rows, "cluster.csv")


if __name__ == "__main__":
    if sys.argv[1:2] == ["host"]:
        asyncio.run(host(sys.argv[2], int(sys.argv[3]), sys.argv[4]))
    elif sys.argv[1:2] == ["parent"]:
        print(json.dumps(parent(sys.argv[2], Case(*json.loads(sys.argv[3])), float(sys.argv[4]), Path(sys.argv[5]))))
    else:
        signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
        main()
