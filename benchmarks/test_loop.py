"""The inner loop of a study: against what no loop can beat, beside a naive one, and its growth in all directions.

No loop beats filling memory with normal numbers, and reading it. At N = 1000 the compiled loop should be at least 12
times as fast as the one that one would first write. The unit of a group, or its fastest row, is 1.0.
"""

import os

import naive
import numpy as np
import pytest
from numba import njit
from studies import FOUR, grid, whole

import study
from study.fits import ESTIMATORS
from study.simulation.experiment.compute import draw
from study.simulation.runs.workers import Workers

MILLION = 1_000_000
MANY = 60
"""Rounds that find a moment in which no neighbour uses the processor: it slows these loops more than what they beat."""
DECADES = np.geomspace(1e-13, 1e14, 28)
"""Levels of noise on the same draws: those of the factorial study."""
LOOP, LEVEL = "whole loop, one thread, per sample", "one more level of noise, per sample"


@njit(fastmath=True)
def read(values):
    """The sum of an array: reading it, and nothing that takes time beside."""
    result = 0.0
    for k in range(values.size):
        result += values[k]
    return result


@pytest.mark.parametrize("group", [LOOP, LEVEL])
def test_normal_numbers(timed, group):
    """The unit of both groups: a million samples, in pieces that stay in a cache."""
    rng, piece = np.random.default_rng(1), np.empty(30_000)

    def fill():
        for _ in range(3 * MILLION // piece.size):
            rng.standard_normal(out=piece)

    timed(group, "numpy standard_normal fills the same 3 N numbers", fill, items=MILLION, unit=True, rounds=MANY)


@pytest.mark.parametrize("samples", [10, 100, 1000, 10_000, 100_000, MILLION])
def test_whole_loop(timed, samples):
    """Draw, bound, four estimators and errors of a million samples, one thread."""
    aim, rounds = ("≤ 1", MANY) if samples >= 1000 else ("", 15)
    timed(LOOP, f"N = {samples:,}", whole(grid(samples, MILLION // samples)), items=MILLION, aim=aim, rounds=rounds)


@pytest.mark.parametrize("samples", [1000, 10_000, 100_000])
def test_one_more_level(timed, samples):
    """Points, moments and four estimators of another noise, on directions and noise that are there."""
    asked = grid(samples, max(1, 2**16 // samples), levels=DECADES)
    batch = next(next(asked.units()).parts(2**17))
    draws = draw(asked, batch)
    points = np.empty_like(draws.unit_noise)

    def more():
        for cell in batch.cells:
            fitted = draws.place(cell.level, points)
            for name in FOUR:
                ESTIMATORS[name](fitted)

    items = len(batch.cells) * draws.unit_noise.size // 3
    timed(LEVEL, f"N = {samples:,}", more, items=items, aim="≤ 0.35" if samples >= 10_000 else "", rounds=MANY)


@pytest.mark.parametrize("what", ["sum of the array", "array (d, n)", "array (n, d)"])
def test_gdke_of_a_million(timed, what):
    """GDKE of N = 1e6 through the public function, against reading the array."""
    points, group = np.random.default_rng(1).standard_normal((3, MILLION)), "GDKE of a million samples, per sample"
    if what == "sum of the array":
        timed(group, what, read, points.ravel(), items=MILLION, unit=True, rounds=200)
    else:
        points, aim = (points.T, "≤ 2") if what == "array (d, n)" else (points.T.copy(), "≤ 4")
        timed(group, what, study.fit, points, "gdke", items=MILLION, aim=aim, rounds=200)


@pytest.mark.parametrize("samples", [100, 10_000])
def test_moment_route(timed, samples):
    """Closed forms at one more level, from joint moments: whatever N."""
    names = ["gdke", "ugdk", "als", "taubin", "pratt", "hyper"]
    loop = whole(grid(samples, 100, np.geomspace(1e-6, 1.0, 200), names, route="moments"))
    group, what = "closed forms from joint moments, per fit and level (aim: 2000 ns)", "200 levels, the draw included"
    timed(group, f"N = {samples:,}, {what}", loop, items=100 * 200 * len(names), rounds=5)


@pytest.mark.parametrize(("samples", "trials"), [(10, 2000), (1000, 200), (100_000, 4)])
@pytest.mark.parametrize("loop", ["compiled, as a run computes it", "as one would first write it in NumPy"])
def test_inner_loop(timed, loop, samples, trials):
    """Time one loop, and hold that both see the same statistics."""
    group, compiled = f"inner loop, N = {samples}, per trial", loop.startswith("compiled")
    if compiled:
        errors = timed(group, loop, whole(grid(samples, trials)), items=trials, unit=True).errors
        ratios = [(errors["error"] / errors["bound"])[errors["estimator"] == name] for name in FOUR]
    else:
        arguments, aim = (np.random.default_rng(1), trials, samples, np.radians(60.0), 0.05), "≥ 5" * (samples == 10)
        rows = timed(group, loop, naive.study, *arguments, items=trials, aim=aim)
        ratios = (rows[:, :4] / rows[:, 4:]).T
    assert all(0.3 < np.median(ratio) < 200.0 for ratio in ratios)


@pytest.mark.parametrize("samples", [10_000, 100_000, MILLION])
def test_samples(timed, samples):
    """Seven levels of noise, per sample: linear to 10 %."""
    group, levels = "growth with N, seven levels, per sample", (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1)
    loop = whole(grid(samples, MILLION // samples, levels))
    timed(group, f"N = {samples:,}", loop, items=MILLION, unit=samples == 10_000, aim="0.9 to 1.1", rounds=8)


@pytest.mark.parametrize("d", [2, 3, 4, 5, 8])
def test_dimension(timed, d):
    """Per sample; sums are kept in registers up to four dimensions."""
    loop, group = whole(grid(10_000, 20, dimension=d)), "growth with dimension, N = 10,000, per sample"
    timed(group, f"d = {d}", loop, items=200_000, unit=d == 3, rounds=8)


@pytest.mark.parametrize("workers", ["1 thread", "2 threads", "2 processes"])
def test_workers(timed, workers):
    """Eight equal units on one worker and on two: threads as in short studies, processes as in long ones."""
    count, group, unit = int(workers[0]), "growth with workers, eight units", whole(grid(10_000, 100))
    if count > (os.cpu_count() or 1):
        pytest.skip("one core")
    with Workers("loky" if workers == "2 processes" else "threads", count).open() as backend:

        def eight():
            for future in [backend.submit(discard, unit) for _ in range(8)]:
                future.result()

        timed(group, workers, eight, unit=count == 1, aim="≤ 0.59" * (count == 2), rounds=8)


def discard(unit):
    """Compute a unit, and send nothing back."""
    unit()
