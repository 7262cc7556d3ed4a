"""Cost of a large run for its parent: seconds to resume with 10,000 parts, busy workers, memory by the row.

Not run by `make bench`, because it takes minutes: ``python benchmarks/scale.py resume|busy|memory [rows]``.
"""

import contextlib
import os
import resource
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

from study import instruction_set

instruction_set.fix()

from study.simulation.analysis.summary import summarise
from study.simulation.experiment.config import Study, parse
from study.simulation.runs import jobs, parts, runner
from study.simulation.runs.workers import Backend, Workers

_HEAD = 'name = "scale"\nseed = 1\nestimators = ["gdke", "ugdk", "als", "taubin"]\n[design]\n'
_HEAD += 'kind = "grid"\nangle = 90\n'
_BUSY = Path(tempfile.gettempdir()) / "busy"


class Stop(BaseException):
    """Ends a run before it is finished."""


def tiny(cells: int) -> str:
    """Config of a study of so many units, each of one trial of ten samples."""
    return _HEAD + f'draws = "independent"\ntrials = 1\nsamples = 10\nnoise = {{ linspace = [0.1, 0.9, {cells}] }}\n'


def resume(folder: Path) -> None:
    """Seconds from the start of a run to its first new unit, where 10,000 parts are finished."""
    text = tiny(10_100)
    Backend.enough = parts._SECONDS = parts._SHARE = 0.0
    told = []

    def stop(share: float) -> None:
        told.append(share)
        if len(told) == 10_000:
            raise Stop

    with contextlib.suppress(Stop):
        runner.run(parse(text), text, folder, 1, stop)
    count = len(list((folder / "parts").iterdir()))
    began, first = time.perf_counter(), []
    real = runner._Computation.compute

    def timed(computation: runner._Computation, backend: Backend) -> None:
        next(computation.missing(), None)
        first.append(time.perf_counter() - began)
        real(computation, backend)

    runner._Computation.compute = timed
    runner.run(parse(text), text, folder, 1)
    print(f"{count:,} parts: {first[0]:.2f} s until the first new unit; {time.perf_counter() - began:.2f} s in all")


def noted(study: Study, some: tuple[jobs.UnitTask, ...]) -> parts.Packet:
    """Compute tasks as `execute` does, and note the seconds."""
    began = time.perf_counter()
    done = jobs.execute(study, some)
    with open(f"{_BUSY}-{os.getpid()}", "a", encoding="utf-8") as file:
        file.write(f"{began} {time.perf_counter()}\n")
    return done


def busy(folder: Path) -> None:
    """Share of the time from first start to last end in which two processes compute, in a run of 100,000 tiny units."""
    text = tiny(100_000)
    runner.execute = import_module("scale").noted  # by a name that the workers can import
    began = time.perf_counter()
    runner.run(parse(text), text, folder, Workers("loky", 2))
    lines = [p.read_text().split("\n") for p in _BUSY.parent.glob("busy-*")]
    spans = [tuple(map(float, line.split())) for some in lines for line in some if line]
    whole = max(end for _, end in spans) - min(start for start, _ in spans)
    share = sum(end - start for start, end in spans) / (2 * whole)
    print(f"100,000 units: workers busy {share:.0%} of {whole:.1f} s; {time.perf_counter() - began:.1f} s in all")


def memory(folder: Path, rows: int) -> None:
    """The parent's peak memory in a run of so many rows, its summary included."""
    text = _HEAD + f"trials = {rows // 20}\nsamples = 6\nnoise = [0.1, 0.2, 0.3, 0.4, 0.5]\n"
    done = runner.run(parse(text), text, folder, Workers("loky", 2))
    ran = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    summarise(done)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{rows:,} rows: peak {ran:.0f} MiB of the run, {peak:.0f} MiB with its summary")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        what = sys.argv[1]
        if what == "memory":
            memory(Path(place) / "run", int(sys.argv[2]))
        else:
            {"resume": resume, "busy": busy}[what](Path(place) / "run")
