"""Soak: runs are killed a hundred times while they work, and meet a full disk at every write; their tables stay equal.

Not run by `make bench`, because it takes minutes: ``make soak``, or ``python benchmarks/soak.py [kills [word …]]``, for
the cases that have all of the words, such as ``25 errors loky``. A kill counts if it hits while part files of this very
process exist and work is under way. After each one nothing may be left but the folder: no process, no held lock. At the
end the tables have the bytes of a run that was not killed.
"""

import atexit
import errno
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from study import instruction_set

instruction_set.fix()

import psutil

from study import cli, files
from study.files import RunError, holder
from study.simulation.experiment import designs
from study.simulation.experiment.config import parse
from study.simulation.runs import parts, runner
from study.simulation.runs.workers import Backend, DaskCluster

_GRID = """seed = 5
estimators = ["mle", "lls", "ugdk"]
keep_points = 3
[design]
kind = "grid"
trials = {trials}
samples = [300, 1000]
noise = [0.05, 0.5]
angle = [60, 180]
"""
_PRECISION = "[precision]\ntarget = 0.012\nfirst = 100\n"
_POSTERIOR = "[posterior]\ntrials = 6\nwalkers = 16\nmax_steps = 300\nwhere = { samples = 300 }\n"
CONFIGS = {
    "errors": 'name = "errors"\n' + _GRID.format(trials=1500),
    "precision": 'name = "precision"\n' + _GRID.format(trials=6000) + _PRECISION,
    "posterior": 'name = "posterior"\n' + _GRID.format(trials=30) + _POSTERIOR,
}
CASES = {
    ("errors", "threads", "parent"): 14,
    ("errors", "threads", "group"): 14,
    ("precision", "threads", "parent"): 12,
    ("posterior", "threads", "group"): 8,
    ("errors", "loky", "worker"): 5,
    ("errors", "loky", "parent"): 3,
    ("errors", "loky", "group"): 3,
    ("precision", "loky", "worker"): 4,
    ("precision", "loky", "group"): 3,
    ("posterior", "loky", "parent"): 3,
    ("posterior", "loky", "group"): 3,
    ("errors", "dask", "worker"): 10,
    ("errors", "dask", "parent"): 5,
    ("precision", "dask", "worker"): 8,
    ("posterior", "dask", "parent"): 5,
}
"""Cases, each with its number of kills in a hundred: fewer where each kill costs the start of several processes."""
_APART = 30
"""Parts between two kills of a run's workers. A unit whose worker dies twice is given up, since it may be the cause;
the units that were sent when a worker was killed are tried again first."""
_PATIENCE = 120.0
_started: list[subprocess.Popen[str]] = []


class Cluster:
    """A Dask scheduler and two workers on this machine, each a process; started when it is needed first."""

    def __init__(self) -> None:
        self.workers: list[subprocess.Popen[str]] = []
        self._address = ""

    def address(self) -> str:
        """The scheduler's address."""
        if not self._address:
            place = Path(tempfile.mkdtemp()) / "scheduler.json"
            words = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-jupyter", "--scheduler-file"]
            self._begin("distributed.cli.dask_scheduler", *words, str(place))
            last = time.monotonic() + _PATIENCE
            while not (place.is_file() and place.read_text().rstrip().endswith("}")):
                assert time.monotonic() < last, "no scheduler"
                time.sleep(0.05)
            self._address = json.loads(place.read_text())["address"]
            self.workers = [self._worker() for _ in range(2)]
        return self._address

    def kill_worker(self) -> None:
        """Kill the older worker, and start another in its place."""
        worker = self.workers.pop(0)
        worker.kill()
        worker.wait()
        self.workers.append(self._worker())

    def _worker(self) -> subprocess.Popen[str]:
        words = ["--", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        return self._begin("study.cli", "worker", self._address, *words)

    def _begin(self, *words: str) -> subprocess.Popen[str]:
        quiet = subprocess.DEVNULL
        command = [sys.executable, "-m", *words]
        _started.append(subprocess.Popen(command, stdout=quiet, stderr=quiet, text=True, start_new_session=True))
        return _started[-1]


cluster = Cluster()


def _make_parts_small() -> None:
    """Let every unit be small, and every result be stored at once."""
    designs.BLOCK_TRIALS, designs._SAMPLES_PER_UNIT = 50, 20_000
    Backend.enough = DaskCluster.enough = 0.0
    parts._SECONDS = parts._SHARE = 0.0


def _start(folder: Path, kind: str, backend: str) -> subprocess.Popen[str]:
    (folder / f"{kind}.toml").write_text(CONFIGS[kind], encoding="utf-8")
    words = ["run", f"{kind}.toml", "--out", "out", "--jobs", "2", "--backend", backend]
    words += ["--scheduler", cluster.address()] if backend == "dask" else []
    process = subprocess.Popen(
        [sys.executable, __file__, *words],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    _started.append(process)
    return process


def _end_all() -> None:
    """Kill what still runs, when the soak itself ends early."""
    for process in _started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)


def _files(folder: Path) -> set[str]:
    return {path.name for path in (folder / "out" / "parts").glob("*.part")}


def _tables(folder: Path) -> dict[str, bytes]:
    """Bytes of the tables that do not depend on time."""
    return {path.name: path.read_bytes() for path in (folder / "out").glob("*.parquet") if path.stem != "timings"}


def _wait(process: subprocess.Popen[str], folder: Path, known: set[str], count: int) -> bool:
    """Wait until a process has stored so many new parts; false if it ended before."""
    last = time.monotonic() + _PATIENCE
    while process.poll() is None:
        if len(_files(folder) - known) >= count:
            return True
        assert time.monotonic() < last, f"{folder}: no part in {_PATIENCE} s"
        time.sleep(0.005)
    return False


def _finish(folder: Path, kind: str, backend: str) -> None:
    """Run until the end."""
    process = _start(folder, kind, backend)
    said = process.communicate(timeout=10 * _PATIENCE)[1]
    assert process.returncode == 0, said


def _kill(process: subprocess.Popen[str], backend: str, target: str) -> bool:
    """Kill a process, its group or a worker of it; false if there is no worker."""
    below = psutil.Process(process.pid).children(recursive=True)
    if target == "worker" and backend == "dask":
        cluster.kill_worker()
        return True
    if target == "worker":
        workers = [child for child in below if "popen_loky" in " ".join(child.cmdline())]
        if workers:
            workers[-1].kill()
        return bool(workers)
    if target == "group":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()
    left = psutil.wait_procs(below, timeout=_PATIENCE)[1]
    assert not left, f"orphans: {left}"
    return True


def soak(kind: str, backend: str, target: str, kills: int, whole: dict[str, bytes]) -> tuple[int, int]:
    """Kill runs of one kind so often; returns the numbers of kills and of runs, all with equal bytes."""
    done = runs = 0
    while done < kills:
        runs += 1
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            while done < kills:
                process, known = _start(folder, kind, backend), _files(folder)
                count = 1
                while done < kills and _wait(process, folder, known, count):
                    known, count = _files(folder), _APART
                    done += _kill(process, backend, target)
                    if target != "worker":
                        break
                said = process.communicate()[1]
                assert holder(folder / "out") is None, "a stale lock"
                assert process.returncode in (0, -signal.SIGKILL), said
                if process.returncode == 0:
                    break
            _finish(folder, kind, backend)
            assert _tables(folder) == whole, f"{kind}, {backend}, {target}: other bytes"
            assert not (folder / "out" / "parts").exists(), "parts are left"
            assert not list((folder / "out").glob(".*")), "temporary files are left"
    return done, runs


def full_disk(text: str) -> int:
    """Let the disk be full at the first write, the second, and so on; returns the number of writes."""
    study, sync, count = parse(text), os.fsync, 0
    with tempfile.TemporaryDirectory() as name:
        whole = runner.run(study, text, Path(name) / "whole", 1).path("errors").read_bytes()
        while True:
            writes, count = iter(range(count + 1)), count + 1

            def full(handle: int, left: Iterator[int] = writes) -> None:
                if next(left, None) is None:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                sync(handle)

            folder = Path(name) / f"full-{count}"
            files.os.fsync = full
            try:
                runner.run(study, text, folder, 1)
            except RunError as error:
                said = str(error)
            else:
                return count
            finally:
                files.os.fsync = sync
            assert "No space left on device; what was finished is kept" in said, said
            assert holder(folder) is None, "a stale lock"
            assert not list(folder.rglob(".*.tmp")), "temporary files are left"
            assert runner.run(study, text, folder, 1).path("errors").read_bytes() == whole, "other bytes"


def main(kills: int, kinds: list[str]) -> None:
    """Print the tally of all cases, or of those that have all of some words: a kind, a backend, a target."""
    cases = {case: share for case, share in CASES.items() if set(kinds) <= set(case)}
    wholes: dict[str, dict[str, bytes]] = {}
    total = 0
    for (kind, backend, target), share in cases.items():
        began = time.monotonic()
        if kind not in wholes:
            with tempfile.TemporaryDirectory() as name:
                _finish(Path(name), kind, "threads")
                wholes[kind] = _tables(Path(name))
        done, runs = soak(kind, backend, target, max(1, round(kills * share / sum(cases.values()))), wholes[kind])
        total += done
        seconds = time.monotonic() - began
        print(f"{kind:10} {backend:8} {target:7} {done:4} kills of {runs:3} runs, {seconds:6.0f} s", flush=True)
    _make_parts_small()
    writes = full_disk(CONFIGS["errors"].replace("trials = 1500", "trials = 100"))
    print(f"{total} kills: all resumed, bytes equal, no process and no lock left; disk full at each of {writes} writes")


if __name__ == "__main__":
    if sys.argv[1:2] == ["run"]:
        _make_parts_small()
        cli.main()
    else:
        atexit.register(_end_all)
        signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 100, sys.argv[2:])
