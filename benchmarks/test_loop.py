"""The inner loop of a study: against what no loop can beat, beside a naive one, and its growth in all directions.

No loop beats filling memory with normal numbers, and reading it. At N = 1000 the compiled loop should be at least 12
times as fast as the one that one would first write. The unit of a group, or its fastest row, is 1.0.
"""

import math
import os

import naive
import numpy as np
import pytest
from numba import njit
from studies import FOUR, grid, whole

import study
from study.fits import ESTIMATORS
from study.simulation.experiment.compute import Workspace, draw
from study.simulation.runs.workers import Workers

MILLION = 1_000_000
SIGMA, ANGLE = 0.05, 60.0
MANY = 60
"""Rounds that find a moment in which no neighbour uses the processor: it slows these loops more than what they beat."""
DECADES = np.geomspace(1e-13, 1e14, 28)
"""Levels of noise on the same draws: those of the factorial study."""
FILL = "numpy standard_normal fills the same 3 N numbers"


@njit(fastmath=True)
def read(values):
    """The sum of an array: reading it, and nothing that takes time beside."""
    result = 0.0
    for k in range(values.size):
        result += values[k]
    return result


@pytest.fixture(scope="module")
def normals():
    """A generator, and room for a million 3-D samples in pieces that stay in a cache."""
    return np.random.default_rng(1), np.empty(30_000)


def fill(rng, room):
    for _ in range(3 * MILLION // room.size):
        rng.standard_normal(out=room)


@pytest.mark.parametrize("samples", [0, 10, 100, 1000, 10_000, 100_000, MILLION])
def test_whole_loop(timed, normals, samples):
    """Draw, bound, four estimators and errors of a million samples, one thread."""
    group = "whole loop, one thread, per sample"
    if not samples:
        timed(group, FILL, fill, *normals, items=MILLION, unit=True, rounds=MANY)
        return
    aim, rounds = ("≤ 1", MANY) if samples >= 1000 else ("", 15)
    timed(group, f"N = {samples:,}", whole(grid(samples, MILLION // samples)), items=MILLION, aim=aim, rounds=rounds)


@pytest.mark.parametrize("samples", [0, 1000, 10_000, 100_000])
def test_one_more_level(timed, normals, samples):
    """Points, moments and four estimators of another noise, on directions and noise that are there."""
    group = "one more level of noise, per sample"
    if not samples:
        timed(group, FILL, fill, *normals, items=MILLION, unit=True, rounds=MANY)
        return
    asked = grid(samples, max(1, 2**16 // samples), levels=DECADES)
    batch = next(next(asked.units()).parts(2**17))
    room = Workspace()
    draws = draw(asked, batch, room)
    levels = [cell.level for cell in batch.cells]

    def more():
        for level in levels:
            fitted = draws.place(level, room)
            for name in FOUR:
                ESTIMATORS[name](fitted)

    items = len(levels) * draws.unit_noise.size // 3
    timed(group, f"N = {samples:,}", more, items=items, aim="≤ 0.35" if samples >= 10_000 else "", rounds=MANY)


@pytest.mark.parametrize("case", ["read", "(d, n)", "(n, d)"])
def test_gdke_of_a_million(timed, case):
    """GDKE of N = 1e6 through the public function, against reading the array."""
    points = np.random.default_rng(1).standard_normal((3, MILLION))
    group = "GDKE of a million samples, per sample"
    if case == "read":
        timed(group, "sum of the array", read, points.ravel(), items=MILLION, unit=True, rounds=200)
    elif case == "(d, n)":
        timed(group, "array (d, n)", study.fit, points.T, "gdke", items=MILLION, aim="≤ 2", rounds=200)
    else:
        timed(group, "array (n, d)", study.fit, points.T.copy(), "gdke", items=MILLION, aim="≤ 4", rounds=200)


@pytest.mark.parametrize("samples", [100, 10_000])
def test_moment_route(timed, samples):
    """Closed forms at one more level, from joint moments: whatever N."""
    group = "closed forms from joint moments, per fit and level (aim: 2000 ns)"
    names = ["gdke", "ugdk", "als", "taubin", "pratt", "hyper"]
    levels = tuple(np.geomspace(1e-6, 1.0, 200))
    loop = whole(grid(samples, 100, levels, names, route="moments"))
    timed(group, f"N = {samples:,}, 200 levels, the draw included", loop, items=100 * 200 * len(names), rounds=5)


@pytest.mark.parametrize(("samples", "trials"), [(10, 2000), (1000, 200), (100_000, 4)])
@pytest.mark.parametrize("loop", ["compiled", "naive"])
def test_inner_loop(benchmark, loop, samples, trials):
    """Time one loop, and hold that both see the same statistics."""
    benchmark.group = f"inner loop, N = {samples}, per trial"
    words = {"compiled": "compiled, as a run computes it", "naive": "as one would first write it in NumPy"}[loop]
    aim = "≥ 5" if samples == 10 and loop == "naive" else ""
    benchmark.extra_info.update(what=words, items=trials, unit=loop == "compiled", aim=aim)
    if loop == "naive":
        rng = np.random.default_rng(1)
        rows = benchmark(naive.study, rng, trials, samples, math.radians(ANGLE), SIGMA)
        medians = np.median(rows[:, :4] / rows[:, 4:], axis=0)
    else:
        errors = benchmark(whole(grid(samples, trials))).errors
        ratio = errors["error"] / errors["bound"]
        medians = [np.median(ratio[errors["estimator"] == name]) for name in FOUR]
    assert np.all((np.array(medians) > 0.3) & (np.array(medians) < 200.0))


@pytest.mark.parametrize("samples", [10_000, 100_000, 1_000_000])
def test_samples(timed, samples):
    """Seven levels of noise, per sample: linear to 10 %."""
    loop = whole(grid(samples, 1_000_000 // samples, (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1)))
    group = "growth with N, seven levels, per sample"
    timed(group, f"N = {samples:,}", loop, items=1_000_000, unit=samples == 10_000, aim="0.9 to 1.1", rounds=8)


@pytest.mark.parametrize("dimension", [2, 3, 4, 5, 8])
def test_dimension(timed, dimension):
    """Per sample; sums are kept in registers up to four dimensions."""
    loop = whole(grid(10_000, 20, dimension=dimension))
    group = "growth with dimension, N = 10,000, per sample"
    timed(group, f"d = {dimension}", loop, items=200_000, unit=dimension == 3, rounds=8)


def run(unit):
    """Compute a unit, and send nothing back."""
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
            for future in [backend.submit(run, unit) for _ in range(8)]:
                future.result()

        timed("growth with workers, eight units", workers, eight, unit=workers == "1 thread", aim=aim, rounds=8)
