"""Least trimmed squares: the sphere whose h smallest distances |R - r| have the least sum of squares.

A concentration step fits a sphere to the h points that are nearest to the last one, which lowers the sum (Rousseeuw &
Van Driessen 2006). The steps here fit by Taubin's method, which is near the geometric fit, needs no start and cannot
run away; the forward search that follows fits geometrically. All starts, which are spheres through d + 1 points, take
two steps, the best ten go on. Sets are in units of their own size, so that no power overflows.

The d + 1 points are chosen by a hash of counters: the same ones in each call, and for each set of a batch.
"""

import math
from functools import lru_cache
from itertools import combinations
from math import ceil, comb, log, log1p
from typing import NamedTuple

import numpy as np

from study.arrays import Bools, Floats, Ints
from study.fits.closed_forms import smallest_root
from study.fits.jit import Sums, compiled, dot, fill, zeros
from study.fits.linalg import cholesky_solve, diagonalise
from study.fits.moments import Moments, accumulate

_FIRST, _LAST = 2, 20
"""Concentration steps of every start, and most of a finalist."""
_FINALISTS = 10
_FALL = 1e-3
"""A step that lowers the sum by a smaller share is the last."""
_SINGULAR = 64.0 * 2.0**-52
"""An extent below so many roundings of the largest, for each dimension, is none."""
_FEWEST, _MOST = 200, 3000
"""Number of elemental subsets: as many as contain a clean one almost surely, between these."""
_CONTAMINATED, _MISSED = 0.4, 1e-4
"""With this share of outliers, no subset is clean with this probability, as far as the most suffice."""
SUBSAMPLE = 500
"""Points of a set that the search begins with: Rousseeuw & Van Driessen's choice is 1500 in five parts of 300."""


class Selection(NamedTuple):
    """The points of one set that a sphere is fitted to, and memory for that fit.

    Attributes:
        distance: of each point from a sphere (n,).
        inside: True for the points that are fitted (n,).
        chosen: their coordinates (d n + 1,).
        moments: theirs, a batch of one.
        vectors: three vectors (3, d).
        matrices: two matrices (2, d, d).
        zero: d sums at zero.
        square: d² sums at zero.
    """

    distance: Floats
    inside: Bools
    chosen: Floats
    moments: Moments
    vectors: Floats
    matrices: Floats
    zero: Sums
    square: Sums


@compiled
def new_selection(n: int, zero: Sums, square: Sums) -> Selection:
    """Allocate a selection among n points."""
    d = len(zero)
    moments = Moments(np.empty((2, 1)), np.empty((2, 1, d)), np.empty((1, d, d)))
    distance, inside, chosen = np.empty(n), np.empty(n, np.bool_), np.empty(d * n + 1)
    return Selection(distance, inside, chosen, moments, np.empty((3, d)), np.empty((2, d, d)), zero, square)


@compiled
def residuals(y: Floats, sphere: Floats, result: Floats) -> None:
    """Write R - r of each point; a sphere is its centre, then its radius (d + 1,)."""
    d, n = y.shape
    fill(result, 1e-300)
    for i in range(d):
        row, c = y[i], sphere[i]
        for k in range(n):
            result[k] += (row[k] - c) * (row[k] - c)
    radius = sphere[d]
    for k in range(n):
        result[k] = math.sqrt(result[k]) - radius


@compiled
def select_nearest(y: Floats, sphere: Floats, h: int, selection: Selection) -> float:
    """Select the h points nearest to a sphere, or more with ties, and return the sum of h squared distances."""
    distance, inside = selection.distance, selection.inside
    residuals(y, sphere, distance)
    for k in range(distance.size):
        distance[k] = abs(distance[k])
    limit = float(np.partition(distance, h - 1)[h - 1])
    total, count = 0.0, 0
    for k in range(distance.size):
        inside[k] = distance[k] <= limit
        total += distance[k] * distance[k] if inside[k] else 0.0
        count += inside[k]
    return max(total - (count - h) * limit * limit, 0.0)


@compiled
def selected(y: Floats, selection: Selection) -> Floats:
    """The selected points, as a batch of one (1, d, m)."""
    d, n = y.shape
    inside, m = selection.inside, 0
    for k in range(n):
        m += inside[k]
    for i in range(d):
        place = i * m
        for k in range(n):  # without a branch: what is not selected is overwritten
            selection.chosen[place] = y[i, k]
            place += inside[k]
    return selection.chosen[: d * m].reshape(1, d, m)


@compiled
def _taubin(y: Floats, selection: Selection, sphere: Floats) -> bool:
    """Taubin's fit of the selected points; False, and no sphere, if they do not determine one."""
    points, moments = selected(y, selection), selection.moments
    _, d, m = points.shape
    accumulate(points, moments, selection.zero, selection.square)
    scatter, basis = selection.matrices[0], selection.matrices[1]
    values, along, zero = selection.vectors[0], selection.vectors[1], selection.vectors[2]
    trace = 0.0
    for i in range(d):
        zero[i] = 0.0
        trace += moments.second[0, i, i] / m
        for j in range(d):
            scatter[i, j] = moments.second[0, i, j] / m
    diagonalise(scatter, basis)
    for i in range(d):
        values[i], along[i] = scatter[i, i], dot(basis[:, i], moments.vectors[1, 0]) / m
    if not values[0] > _SINGULAR * d * values[d - 1]:
        return False
    eta = smallest_root(values, along, zero, trace, moments.numbers[1, 0] / m - trace * trace, 0.0)
    square_radius = trace
    for i in range(d):
        sphere[i] = moments.vectors[0, 0, i]
    for k in range(d):
        part = 0.5 * along[k] / (values[k] - eta)
        square_radius += part * part
        for i in range(d):
            sphere[i] += part * basis[i, k]
    sphere[d] = math.sqrt(square_radius)
    return bool(sphere[d] < math.inf)


@compiled
def _elemental_spheres(y: Floats, subsets: Ints, spheres: Floats) -> None:
    """Spheres (b, subsets, d + 1) through d + 1 points each of the sets (b, d, n); NaN where there is none."""
    b, d, _ = y.shape
    normal, right = np.empty((d, d)), np.empty(d)
    edges, squares = np.empty((d, d)), np.empty(d)
    for t in range(b):
        for s in range(len(subsets)):
            base, sphere = subsets[s, d], spheres[t, s]
            for k in range(d):
                squares[k] = 0.0
                for i in range(d):
                    edges[k, i] = y[t, i, subsets[s, k]] - y[t, i, base]
                    squares[k] += 0.5 * edges[k, i] * edges[k, i]
            for i in range(d):
                right[i] = dot(edges[:, i], squares)
                for j in range(d):
                    normal[i, j] = dot(edges[:, i], edges[:, j])
            solved, square = cholesky_solve(normal, right), 0.0
            for i in range(d):
                sphere[i] = y[t, i, base] + right[i] if solved else math.nan
                square += right[i] * right[i]
            sphere[d] = math.sqrt(square) if solved else math.nan


@compiled
def _concentrate(y: Floats, h: int, steps: int, spheres: Floats, sums: Floats, zero: Sums, square: Sums) -> None:
    """Improve spheres (b, s, d + 1) of the sets (b, d, n) by concentration steps, two or more, in place.

    ``sums`` (b, s) receives the sums of the h smallest squares; infinite where there is no sphere.
    """
    b, d, n = y.shape
    selection, trial = new_selection(n, zero, square), np.empty(d + 1)
    for t in range(b):
        for s in range(spheres.shape[1]):
            sums[t, s], total = math.inf, math.inf
            for i in range(d + 1):
                trial[i] = spheres[t, s, i]
            step, going = 0, bool(trial[d] < math.inf)
            while going:
                before, total = total, select_nearest(y[t], trial, h, selection)
                if total < sums[t, s]:
                    sums[t, s] = total
                    for i in range(d + 1):
                        spheres[t, s, i] = trial[i]
                going = step < _FIRST or (step < steps and total < before * (1.0 - _FALL))
                going = going and _taubin(y[t], selection, trial)
                step += 1


@compiled
def majority(n: int, d: int) -> int:
    """Number of points that least trimmed squares fits, which resists the most outliers."""
    return (n + d + 2) // 2


def best_spheres(y: Floats) -> Floats:
    """Spheres (b, d + 1) of least trimmed squares of the sets (b, d, n); NaN where there is none.

    Of more than `SUBSAMPLE` points as many are searched first, and the two best spheres of these improved.
    """
    b, d, n = y.shape
    places = spread_out(n)
    part = np.ascontiguousarray(y[:, :, places]) if len(places) < n else y
    subsets = elemental(len(places), d + 1)
    spheres = np.empty((b, len(subsets), d + 1))
    _elemental_spheres(part, subsets, spheres)
    spheres = _best(part, _LAST, _best(part, _FIRST, spheres, _FINALISTS), 2)
    return np.ascontiguousarray((spheres if part is y else _best(y, _LAST, spheres, 1))[:, 0])


def _best(y: Floats, steps: int, spheres: Floats, count: int) -> Floats:
    """The best of the spheres (b, s, d + 1) after concentration steps (b, count, d + 1)."""
    d, sums = y.shape[1], np.empty(spheres.shape[:2])
    _concentrate(y, majority(y.shape[2], d), steps, spheres, sums, zeros(d), zeros(d, d))
    order = np.argsort(sums, axis=1, kind="stable")[:, :count]
    chosen = np.take_along_axis(spheres, order[:, :, None], axis=1)
    chosen[np.isinf(np.take_along_axis(sums, order, axis=1))] = np.nan
    return chosen


def uniform(count: int, name: int) -> Floats:
    """Numbers (count,) spread evenly over [0, 1), a hash of their place and of a number that names the sequence.

    The hash is the finaliser of SplitMix64 (Steele, Lea & Flood 2014).
    """
    mixed = np.arange(count, dtype=np.uint64) + np.uint64((name << 40) + 0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed ^= mixed >> np.uint64(31)
    return np.asarray((mixed >> np.uint64(11)).astype(float) * 2.0**-53)


@lru_cache(maxsize=64)
def elemental(n: int, size: int) -> Ints:
    """Subsets (subsets, size) of n points, as indices: all of them if they are few, else hashed ones."""
    wanted = log(_MISSED) / log1p(-((1.0 - _CONTAMINATED) ** size))
    count = min(max(ceil(wanted), _FEWEST), _MOST)
    if comb(n, size) <= count:
        return np.array(list(combinations(range(n), size)), dtype=np.int64)
    chosen = np.empty((count, size), dtype=np.int64)
    for k in range(size):  # the draw-th of those that the subset does not hold yet
        draw = (uniform(count, k + 1) * (n - k)).astype(np.int64)
        held = np.sort(chosen[:, :k], axis=1)
        for i in range(k):
            draw += draw >= held[:, i]
        chosen[:, k] = draw
    return chosen


@lru_cache(maxsize=16)
def spread_out(n: int) -> Ints:
    """Places of the subsample among n points: one from each of as many equal parts."""
    if n <= SUBSAMPLE:
        return np.arange(n)
    edges = np.arange(SUBSAMPLE + 1) * n // SUBSAMPLE
    return np.asarray(edges[:-1] + (uniform(SUBSAMPLE, 0) * np.diff(edges)).astype(np.int64))
