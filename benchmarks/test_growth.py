"""How cost grows with samples, trials, levels, dimension and workers, and what memory a million samples take."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from studies import grid, whole

from study.simulation.runs.workers import Workers

MEMORY = """
import resource, sys
sys.path.insert(0, "benchmarks")
from studies import grid, whole
samples = int(sys.argv[1])
whole(grid(samples, 2, (0.01, 0.1, 1.0)))()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.parametrize("samples", [10_000, 100_000, 1_000_000])
def test_samples(timed, samples):
    """Seven levels of noise, per sample: linear to 10 %."""
    loop = whole(grid(samples, 1_000_000 // samples, (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1)))
    group = "growth with N, seven levels, per sample"
    timed(group, f"N = {samples:,}", loop, items=1_000_000, unit=samples == 10_000, aim="0.9 to 1.1", rounds=8)


@pytest.mark.parametrize("trials", [100, 1000, 10_000])
def test_trials(timed, trials):
    """Of 100 samples, per trial."""
    timed("growth with trials, N = 100, per trial", f"{trials:,} trials", whole(grid(100, trials)), items=trials,
          unit=trials == 1000)  # fmt: skip


@pytest.mark.parametrize("count", [1, 4, 16])
def test_levels(timed, count):
    """Per level, the draw included."""
    loop = whole(grid(10_000, 20, tuple(0.001 * 1.5**k for k in range(count))))
    timed("growth with levels, N = 10,000, per level", f"{count} levels", loop, items=count, unit=count == 1)


@pytest.mark.parametrize("dimension", [2, 3, 4, 5, 8])
def test_dimension(timed, dimension):
    """Per sample; sums are kept in registers up to four dimensions."""
    loop = whole(grid(10_000, 20, dimension=dimension))
    group = "growth with dimension, N = 10,000, per sample"
    timed(group, f"d = {dimension}", loop, items=200_000, unit=dimension == 3, rounds=8)


def run(unit, _):
    """Compute a unit, as workers call it."""
    unit()


@pytest.mark.parametrize("workers", ["1 thread", "2 threads", "2 processes"])
def test_workers(timed, workers):
    """Eight equal units on one worker and on two: threads as in short studies, processes as in long ones."""
    unit = whole(grid(10_000, 100))
    if workers[0] == "2" and (os.cpu_count() or 1) < 2:
        pytest.skip("one core")
    aim = "≤ 0.59" if workers[0] == "2" else ""
    crew = Workers("loky" if workers == "2 processes" else "threads", int(workers[0]))
    with crew.open() as backend:

        def eight():
            assert len(list(backend.parallel(backend.call(k, run, unit, ()) for k in range(8)))) == 8

        timed("growth with workers, eight units", workers, eight, unit=workers == "1 thread", aim=aim, rounds=8)


@pytest.mark.parametrize("samples", [1000, 1_000_000])
def test_memory(benchmark, samples):
    """Peak memory of a process that computes one unit, beside that of one whose unit is small."""
    command = [sys.executable, "-c", MEMORY, str(samples)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).resolve().parents[1])
    megabytes = int(done.stdout) / 1024
    benchmark.extra_info.update(what=f"N = {samples:,}", items=1, unit=False, aim="< 1024", megabytes=megabytes)
    benchmark.group = "peak memory of a worker, three levels"
    benchmark.pedantic(lambda: None, rounds=1)
