"""A cluster that only waits: what a scheduler and the parent of a run take with 10, 100 and 1000 workers.

Not run by `make bench`, because it takes minutes: ``python benchmarks/cluster.py`` stores results/cluster*.csv, which
docs/cluster.md quotes. Scheduler and parent are those of ``study run --backend dask``, and each is a process. So are
the workers Dask's, but all share a process, and a task that would compute for some seconds sleeps for them instead. It
then returns as many random rows as it would return. So there may be more workers than this machine has cores.
"""

import asyncio
import heapq
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from itertools import islice
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
from study.simulation.experiment.sampling import groups, units
from study.simulation.runs import jobs, runner, workers
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
_SECONDS, _TASKS, _EACH = 20.0, 3000, 2
"""Work of each worker in seconds; but no more tasks than so many, and no fewer than so many for each worker."""


FACTORIAL = (ROOT / "configs" / "factorial.toml").read_text(encoding="utf-8")
CASES = [(workers, task) for task in (0.5, 10.0) for workers in (10, 100, 1000)]
"""Number of workers, of one thread each, and least length of a task in seconds."""


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
    numbers = [rng.random(shape) for _ in range(3)]
    center, steps = rng.standard_normal((*shape, study.dimension)), rng.integers(1, 9, shape, dtype=np.int32)
    fits = Estimates(center, *numbers, np.zeros(shape, dtype=np.int8), steps)
    bound = rng.random((shape[2], study.dimension + 1, study.dimension + 1))
    errors = Errors(batch, study.estimators, tuple(c.name for c in study.conditions()), bound, fits)
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


def noted(owner: Any, name: str, note: Callable[..., None]) -> None:
    """Let a function also hand its result, its arguments, and its seconds by clock and processor to another."""
    real = getattr(owner, name)

    def both(*arguments: object) -> object:
        began, busy = time.perf_counter(), time.process_time()
        found = real(*arguments)
        note(found, arguments, time.perf_counter() - began, time.process_time() - busy)
        return found

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
    text = config(max(_EACH * count, min(_TASKS, count * _SECONDS / task)) * task / speed)
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
    work, tasks = speed * _weight(study), len(sent)
    first = {"tasks": tasks, "task_seconds": work / tasks, "efficiency": work / (count * row["seconds"])}
    return first | {"sent_kb": sum(sent) / tasks / 1e3, "came_kb": sum(came) / tasks / 1e3} | row


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


def measure(count: int, task: float, speed: float, folder: Path) -> dict[str, float]:
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
        started.append(subprocess.Popen([*me, "host", address, str(count), str(folder)], **quiet))
        assert started[1].stdout.readline() == "ready\n"
        scheduler, workers = (psutil.Process(process.pid) for process in started)
        before = _cpu(scheduler), _cpu(workers)
        told = [*map(repr, (count, task, speed)), str(folder / "run")]
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


def schedule() -> Iterator[dict[str, float]]:
    """Seconds that the study of 10¹³ samples takes by the weights of its units, the heaviest first; nothing is run.

    It is the factorial of configs/factorial.toml with a million trials a cell, fewer for large N, and summaries alone.
    """
    head, _, design = FACTORIAL.partition("[design]")
    design = re.sub(r"(?m)^(trials|most_samples) = .*\n", "", design)
    study = parse(f"{head}[design]\ntrials = 1_000_000\nmost_samples = 5_000_000_000{design}")
    found = jobs.Layout(study)
    some = [found.task(unit) for unit in units(study)]
    seconds = sorted((task.weight / PER_SECOND for task in some), reverse=True)
    fits = sum(group.width * study.design.trials_of(group.samples) for group in groups(study)) * len(study.estimators)
    samples = sum(task.batch.rows * task.batch.group.samples for task in some)
    for count in (10, 100, 1000):
        busy = [0.0] * count
        for each in seconds:
            heapq.heapreplace(busy, busy[0] + each)
        row = {"workers": count, "units": len(some), "samples": samples, "rows": fits}
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
    if sys.argv[1:2] == ["host"]:
        asyncio.run(host(sys.argv[2], int(sys.argv[3]), sys.argv[4]))
    elif sys.argv[1:2] == ["parent"]:
        count, task, speed = map(float, sys.argv[3:6])
        print(json.dumps(parent(sys.argv[2], int(count), task, speed, Path(sys.argv[6]))))
    else:
        signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
        store("cluster-study", schedule(), "%.4g")
        store("cluster", measured(), "%.4g")
