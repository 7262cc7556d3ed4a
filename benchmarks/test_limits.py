"""The inner loop against what no loop can beat: filling memory with normal numbers, and reading it."""

import numpy as np
import pytest
from numba import njit
from studies import FOUR, grid, whole

import study
from study.fits import ESTIMATORS
from study.simulation.experiment.compute import Workspace, draw

MILLION = 1_000_000
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
