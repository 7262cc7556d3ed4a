"""Soak: runs are killed a hundred times while they work, and meet a full disk at every write; their tables stay equal.

Not run by `make bench`, because it takes minutes: ``make soak``, or ``python benchmarks/soak.py KILLS``. A kill hits
while a run has stored parts of its own and works on more. After it nothing may be left but the folder: no process, no
held lock. At the end the tables have the bytes of a run that was not killed. Workers and schedulers that die alone are
tested at gates, in tests/simulation/runs.
"""

import errno
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from study import instruction_set

instruction_set.fix()

import psutil

from study import cli, files
from study.files import RunError, holder
from study.simulation.experiment import designs
from study.simulation.experiment.config import parse
from study.simulation.runs import parts, runner
from study.simulation.runs.workers import Threads

GRID = """name = "soak"
seed = 5
estimators = ["mle", "lls", "ugdk"]
keep_points = 3
[design]
kind = "grid"
trials = {}
samples = [300, 1000]
noise = [0.05, 0.5]
angle = [60, 180]
"""
CONFIGS = {
    "errors": GRID.format(1500),
    "precision": GRID.format(6000) + "[precision]\ntarget = 0.012\nfirst = 100\n",
    "posterior": GRID.format(30)
    + "[posterior]\ntrials = 6\nwalkers = 16\nmax_steps = 300\nwhere = { samples = 300 }\n",
}
CASES = [(kind, backend, all_) for kind in CONFIGS for backend in ("threads", "loky") for all_ in (False, True)]
"""Config, backend, and whether the workers are killed with the parent."""
PATIENCE = 120.0


def make_parts_small():
    """Let every unit be small, and every result be stored at once."""
    designs.BLOCK_TRIALS, designs._SAMPLES_PER_UNIT = 50, 20_000
    Threads.enough = parts._SECONDS = parts._SHARE = 0.0


def start(folder, kind, backend):
    """A process that runs a config in a folder."""
    (folder / "soak.toml").write_text(CONFIGS[kind], encoding="utf-8")
    words = [sys.executable, __file__, "run", "soak.toml", "--out", "out", "--jobs", "2", "--backend", backend]
    options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    return subprocess.Popen(words, cwd=folder, **options)


def stored(folder):
    return {path.name for path in (folder / "out" / "parts").glob("*.part")}


def tables(folder):
    """Bytes of the tables that do not depend on time."""
    return {path.name: path.read_bytes() for path in (folder / "out").glob("*.parquet") if path.stem != "timings"}


def kill(process, folder, with_workers):
    """Kill a run once it has stored a part; False if it ended before."""
    known, last = stored(folder), time.monotonic() + PATIENCE
    while not stored(folder) - known:
        if process.poll() is not None:
            return False
        assert time.monotonic() < last, f"{folder}: no part in {PATIENCE} s"
        time.sleep(0.005)
    below = psutil.Process(process.pid).children(recursive=True)
    os.killpg(process.pid, signal.SIGKILL) if with_workers else process.kill()
    process.wait()
    assert not (left := psutil.wait_procs(below, timeout=PATIENCE)[1]), f"orphans: {left}"
    return True


def soak(case, kills, whole):
    """Kill runs of a case so often, each until it is done; the tables of every one are those of the whole run."""
    kind, backend, with_workers = case
    done = 0
    while done < kills:
        with tempfile.TemporaryDirectory() as name:
            folder, ended = Path(name), False
            while not ended:
                process = start(folder, kind, backend)
                try:
                    killed = done < kills and kill(process, folder, with_workers)
                    said = process.communicate(timeout=10 * PATIENCE)[1]
                finally:
                    process.kill()
                assert holder(folder / "out") is None, "a stale lock"
                assert process.returncode == (-signal.SIGKILL if killed else 0), said
                done, ended = done + killed, not killed
            assert tables(folder) == whole[kind], f"{case}: other bytes"
            assert not (folder / "out" / "parts").exists(), "parts are left"
            assert not list((folder / "out").glob(".*")), "temporary files are left"


def full_disk(text):
    """Let the disk be full at the first write, the second, and so on; returns the number of writes."""
    study, sync, count = parse(text), os.fsync, 0
    with tempfile.TemporaryDirectory() as name:
        whole = runner.run(study, text, Path(name) / "whole", 1).path("errors").read_bytes()
        while True:
            writes, count, folder = iter(range(count + 1)), count + 1, Path(name) / f"full-{count}"

            def full(handle, left=writes):
                if next(left, None) is None:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                sync(handle)

            files.os.fsync = full
            try:
                runner.run(study, text, folder, 1)
                return count
            except RunError as error:
                said = str(error)
            finally:
                files.os.fsync = sync
            assert "No space left on device; what was finished is kept" in said, said
            assert holder(folder) is None, "a stale lock"
            assert not list(folder.rglob(".*.tmp")), "temporary files are left"
            assert runner.run(study, text, folder, 1).path("errors").read_bytes() == whole, "other bytes"


def main(kills):
    """Run every case with its share of the kills, and fill the disk."""
    whole = {}
    for kind in CONFIGS:
        with tempfile.TemporaryDirectory() as name:
            said = (process := start(Path(name), kind, "threads")).communicate(timeout=10 * PATIENCE)[1]
            assert process.returncode == 0, said
            whole[kind] = tables(Path(name))
    share = math.ceil(kills / len(CASES))
    for case in CASES:
        began = time.monotonic()
        soak(case, share, whole)
        print(*case, f"{share} kills, {time.monotonic() - began:.0f} s", flush=True)
    make_parts_small()
    writes = full_disk(CONFIGS["errors"].replace("trials = 1500", "trials = 100"))
    print(f"all resumed, bytes equal, no process and no lock left; disk full at each of {writes} writes")


if __name__ == "__main__":
    if sys.argv[1:2] == ["run"]:
        make_parts_small()
        cli.main()
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
