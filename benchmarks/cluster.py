"""A cluster that only waits: what a scheduler and the parent of a run take with 10, 100 and 1000 workers.

Not run by `make bench`, because it takes minutes: ``python benchmarks/cluster.py`` stores results/cluster*.csv, which
docs/cluster.md quotes. Scheduler and parent are those of ``study run --backend dask``, and each is a process. So are
the workers Dask's, but all share a process, and a task that would compute for some seconds sleeps for them instead. It
then returns as many random rows as it would return. So there may be more workers than this machine has cores.
"""

import asyncio
import heapq
import os
import pickle
import re
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from importlib import import_module
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from study import instruction_set

instruction_set.fix()

import numpy as np
import psutil
from studies import ROOT, store

from study.fits import Estimates
from study.simulation.experiment.compute import Errors, Result
from study.simulation.experiment.config import Study, parse
from study.simulation.experiment.designs import Batch
from study.simulation.runs import parts, runner, workers
from study.simulation.runs.parts import Packet, Parts
from study.simulation.runs.workers import PER_SECOND, Parent, Workers

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
SECONDS, MOST_TASKS, LEAST_TASKS = 20.0, 3000, 2
"""Work of each worker in seconds; but no more tasks than so many, and no fewer than so many for each worker."""


FACTORIAL = (ROOT / "configs" / "factorial.toml").read_text(encoding="utf-8")
CASES = [(workers, task) for task in (0.5, 10.0) for workers in (10, 100, 1000)]
"""Number of workers, of one thread each, and least length of a task in seconds."""


async def asleep(pace: float, _: Parent, call: bytes) -> Packet:
    """Sleep for as long as jobs take, and return as many rows; in place of `study.simulation.runs.workers.enter`.

    A coroutine, so that a thousand of them need no thousand threads.
    """
    began = time.monotonic()
    study, tasks = pickle.loads(call)[1]
    shape = tuple(task.batch.rows for task in tasks)
    if shape not in _packets:
        _packets[shape] = parts._packed(study, tasks, _random)
    await asyncio.sleep(began + pace * sum(task.weight for task in tasks) - time.monotonic())
    return _packets[shape]._replace(keys=[(task.key, task.outputs) for task in tasks])


def _random(study: Study, batch: Batch) -> Result:
    """Random errors of all fits of a unit, which cannot be compressed, like real ones."""
    rng, result = np.random.default_rng(), Result(study)
    shape = (len(batch.cells), len(study.estimators), batch.trials)
    numbers = [rng.random(shape) for _ in range(3)]
    center, steps = rng.standard_normal((*shape, study.dimension)), rng.integers(1, 9, shape, dtype=np.int32)
    fits = Estimates(center, *numbers, np.zeros(shape, dtype=np.int8), steps)
    bound = rng.random((shape[2], study.dimension + 1, study.dimension + 1))
    errors = Errors(batch, study.estimators, tuple(c.name for c in study.conditions()), bound, fits)
    result.blocks.append(errors)
    result.clock("draw", batch.group.samples, batch.trials)
    return result


def config(weight: float) -> str:
    """Config of a study of about so much work; see `study.simulation.runs.parts.UnitTask`."""
    of_hundred = sum(task.weight for task in tasks_of(parse(CONFIG.format(trials=100))))
    return CONFIG.format(trials=max(1, round(100 * weight / of_hundred)))


def tasks_of(study: Study) -> Iterator[parts.UnitTask]:
    """The tasks of a study, one a unit."""
    return map(parts.Layout(study).task, study.units())


def pace() -> float:
    """Seconds of one core to the weight of a task, measured on some units of the study."""
    study = parse(CONFIG.format(trials=100))
    seconds = []
    for task in islice(tasks_of(study), 5):
        began = time.process_time()
        parts.execute(study, (task,))
        seconds.append((time.process_time() - began) / task.weight)
    return min(seconds)


def noted(owner: Any, name: str, note: Callable[..., None]) -> None:
    """Let a function also hand its result, its arguments, and its seconds by clock and processor to another."""
    real = getattr(owner, name)

    def both(*arguments: object) -> object:
        began, busy = time.perf_counter(), time.process_time()
        result = real(*arguments)
        note(result, arguments, time.perf_counter() - began, time.process_time() - busy)
        return result

    setattr(owner, name, both)


def parent(address: str, count: int, task: float, speed: float, folder: Path) -> dict[str, float]:
    """Run a study on so many workers of a scheduler, as `study run` does; returns what it took.

    Args:
        address: the scheduler's.
        count: number of workers.
        task: least seconds of a task.
        speed: seconds to the weight of a task.
        folder: of the run.
    """
    text = config(max(LEAST_TASKS * count, min(MOST_TASKS, count * SECONDS / task)) * task / speed)
    study = parse(text)
    workers.DaskCluster.enough = task / speed
    workers.enter = partial(import_module("cluster").asleep, speed)  # by a name that the workers can import
    sent: list[int] = []
    came: list[int] = []
    row: dict[str, float] = {}

    def computed(_: object, __: object, seconds: float, busy: float) -> None:
        sizes = [path.stat().st_size for path in (folder / "parts").glob("*.part")]
        row.update(seconds=seconds, parent_cpu=busy, files=len(sizes), parts_mb=sum(sizes) / 1e6, parent_mib=_peak())

    noted(workers, "seal", lambda call, *_: sent.append(len(call)))
    noted(Parts, "add", lambda _, given, *__: came.append(sum(map(len, given[1].tables.values()))))
    noted(runner._Computation, "compute", computed)
    noted(runner, "finish", lambda _, __, seconds, ___: row.update(finish=seconds, finish_mib=_peak()))
    runner.run(study, text, folder, Workers("dask", scheduler=address))
    work, tasks = speed * sum(task.weight for task in tasks_of(study)), len(sent)
    first = {"tasks": tasks, "task_seconds": work / tasks, "efficiency": work / (count * row["seconds"])}
    return first | {"sent_kb": sum(sent) / tasks / 1e3, "came_kb": sum(came) / tasks / 1e3} | row


def _peak() -> float:
    """Peak memory of this program in MiB; `resource` would count that of the program that started it, too."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024


def schedule_tasks(started: Any) -> None:
    """Be a scheduler, which puts its address into a queue."""
    from distributed import Scheduler

    async def serve() -> None:
        async with Scheduler(host="127.0.0.1", port=0, dashboard_address="127.0.0.1:0") as scheduler:
            started.put(scheduler.address)
            await scheduler.finished()

    asyncio.run(serve())


def host(started: Any, address: str, count: int, folder: Path) -> None:
    """Be so many workers of a scheduler, until it ends; puts their number into a queue."""
    import dask
    from distributed import Worker

    async def serve() -> None:
        options = {"nthreads": THREADS, "memory_limit": 0, "local_directory": str(folder), "host": "127.0.0.1"}
        workers = await asyncio.gather(*(Worker(address, **options) for _ in range(count // THREADS)))
        started.put(count)
        await asyncio.gather(*(worker.finished() for worker in workers))

    dask.config.set({"distributed.worker.profile.enabled": False})  # it would cost a tenth of this machine
    asyncio.run(serve())


def measure(count: int, task: float, speed: float, folder: Path) -> dict[str, float]:
    """Start a cluster, run a study on it from a process of its own, and end the cluster."""
    spawn, processes = get_context("spawn"), []
    started = spawn.Queue()

    def start(function: Callable[..., None], *arguments: object) -> tuple[psutil.Process, Any]:
        processes.append(spawn.Process(target=function, args=(started, *arguments)))
        processes[-1].start()
        return psutil.Process(processes[-1].pid), started.get()

    try:
        scheduler, address = start(schedule_tasks)
        workers, _ = start(host, address, count, folder)
        before = _cpu(scheduler), _cpu(workers)
        with ProcessPoolExecutor(1, spawn) as pool:
            row = pool.submit(parent, address, count, task, speed, folder / "run").result()
        row |= {"scheduler_cpu": _cpu(scheduler) - before[0], "workers_cpu": _cpu(workers) - before[1]}
        return row | {"scheduler_mib": scheduler.memory_info().rss / 2**20}
    finally:
        for process in processes:
            process.terminate()
            process.join()


def _cpu(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def schedule() -> Iterator[dict[str, float]]:
    """Seconds that the study of 10¹³ samples takes by the weights of its units, the heaviest first; nothing is run.

    It is the factorial of configs/factorial.toml with a million trials a cell, fewer for large N, and summaries alone.
    """
    head, _, design = FACTORIAL.partition("[design]")
    design = re.sub(r"(?m)^(trials|most_samples) = .*\n", "", design)
    study = parse(f"{head}[design]\ntrials = 1_000_000\nmost_samples = 5_000_000_000{design}")
    tasks = list(tasks_of(study))
    seconds = sorted((task.weight / PER_SECOND for task in tasks), reverse=True)
    fits = sum(group.width * study.design.trials_of(group.samples) for group in study.groups()) * len(study.estimators)
    samples = sum(task.batch.rows * task.batch.group.samples for task in tasks)
    for count in (10, 100, 1000):
        busy = [0.0] * count
        for work in seconds:
            heapq.heapreplace(busy, busy[0] + work)
        row = {"workers": count, "units": len(tasks), "samples": samples, "rows": fits}
        row |= {"core_hours": sum(seconds) / 3600, "longest": seconds[0], "seconds": max(busy)}
        yield row | {"efficiency": sum(seconds) / count / max(busy)}


def measured() -> Iterator[dict[str, float]]:
    """A row for each case, which is printed, too."""
    speed = pace()
    for count, task in CASES:
        with tempfile.TemporaryDirectory() as name:
            row = {"workers": count, "task": task} | measure(count, task, speed, Path(name))
        print(row, flush=True)
        yield row


if __name__ == "__main__":
    os.environ["DASK_LOGGING__DISTRIBUTED"] = "error"  # for the processes that are started
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
    store("cluster-study", schedule(), "%.4g")
    store("cluster", measured(), "%.4g")
