"""Least trimmed squares: the sphere whose h smallest distances |R - r| have the least sum of squares.

A concentration step fits a sphere to the h points that are nearest to the last one, which lowers the sum (Rousseeuw &
Van Driessen 2006). The steps here fit by Taubin's method, which is near the geometric fit, needs no start and cannot
run away; the forward search that follows fits geometrically. All starts take two steps, the best ten go on.

Sets are in units of their own size, so that no power overflows.

Copies among the points of a set: rows that repeat an earlier one exactly.

Subsets of a point set by a hash of counters: the same ones in each call, and for each set of a batch.

Sums over the points of weight 1: those of the geometric fit, and the scatter of the points' directions.
"""

import math
from functools import lru_cache
from itertools import combinations
from math import ceil, comb, log, log1p
from typing import NamedTuple

import numpy as np

from study.arrays import Bools, Floats, Ints, Words
from study.fits.closed_forms import smallest_root
from study.fits.geometric import CURVE, MEAN, PULL, SphereSums, clear
from study.fits.jit import CHUNK, compiled, dot, fill
from study.fits.linalg import cholesky_solve, diagonalise

_FIRST = 2
"""Concentration steps of every start."""
FINALISTS = 10
_LAST = 20
"""Most further steps of a finalist."""
_FALL = 1e-3
"""A step that lowers the sum by a smaller share is the last."""
_EPS = 2.0**-52
_SINGULAR = 64.0
"""An extent below so many roundings of the largest is none."""


class SearchRoom(NamedTuple):
    """Working memory for a set of n points in d dimensions.

    Attributes:
        distance: |R - r| (n,).
        copy: a copy of them, which the selection reorders (n,).
        weight: 1 for points that a fit uses, else 0 (n,).
        rows: a chunk of points about their centroid, and their squares (d + 2, CHUNK).
        vectors: five vectors (5, d).
        matrices: two matrices (2, d, d).
    """

    distance: Floats
    copy: Floats
    weight: Floats
    rows: Floats
    vectors: Floats
    matrices: Floats


@compiled
def search_room(d: int, n: int) -> SearchRoom:
    """Allocate working memory."""
    vectors, matrices = np.empty((5, d)), np.empty((2, d, d))
    return SearchRoom(np.empty(n), np.empty(n), np.empty(n), np.empty((d + 2, CHUNK)), vectors, matrices)


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
def select(values: Floats, place: int) -> float:
    """The value that stands at a place in ascending order. Reorders the values (Hoare's selection)."""
    low, high = 0, values.size - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if place <= j:
            high = j
        elif place >= i:
            low = i
        else:
            break
    return float(values[place])


@compiled
def nearest(y: Floats, sphere: Floats, h: int, work: SearchRoom) -> float:
    """Give the h points nearest to a sphere the weight 1, and return the sum of their squared distances.

    With ties there are more than h; the sum is that of h.
    """
    distance, copy, weight = work.distance, work.copy, work.weight
    residuals(y, sphere, distance)
    for k in range(distance.size):
        distance[k] = abs(distance[k])
        copy[k] = distance[k]
    limit = select(copy, h - 1)
    total, count = 0.0, 0.0
    for k in range(distance.size):
        weight[k] = 1.0 if distance[k] <= limit else 0.0
        total += weight[k] * distance[k] * distance[k]
        count += weight[k]
    return max(total - (count - h) * limit * limit, 0.0)


@compiled
def _taubin(y: Floats, work: SearchRoom, sphere: Floats) -> bool:
    """Taubin's fit of the points of weight 1; False, and no sphere, if they do not determine one."""
    weight, rows, vectors = work.weight, work.rows, work.vectors
    d, n = y.shape
    mean, third, along, values, zero = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    scatter, basis = work.matrices[0], work.matrices[1]
    count = 0.0
    for k in range(n):
        count += weight[k]
    for i in range(d):
        mean[i], third[i], zero[i] = dot(y[i], weight) / count, 0.0, 0.0
        for j in range(d):
            scatter[i, j] = 0.0
    fourth = 0.0
    for start in range(0, n, CHUNK):
        size = min(CHUNK, n - start)
        square, scaled, w = rows[d, :size], rows[d + 1, :size], weight[start : start + size]
        fill(square, 0.0)
        for i in range(d):
            row, v, c = y[i, start : start + size], rows[i, :size], mean[i]
            for k in range(size):
                v[k] = row[k] - c
                square[k] += v[k] * v[k]
        for k in range(size):
            scaled[k] = w[k] * square[k]
        fourth += dot(scaled, square)
        for i in range(d):
            third[i] += dot(rows[i, :size], scaled)
        for i in range(d):
            v = rows[i, :size]
            for k in range(size):
                scaled[k] = w[k] * v[k]
            for j in range(i + 1):
                scatter[i, j] += dot(scaled, rows[j, :size])
    trace = 0.0
    for i in range(d):
        third[i] /= count
        trace += scatter[i, i] / count
        for j in range(i + 1):
            scatter[i, j] /= count
            scatter[j, i] = scatter[i, j]
    diagonalise(scatter, basis)
    for i in range(d):
        values[i], along[i] = scatter[i, i], dot(basis[:, i], third)
    if not values[0] > _SINGULAR * d * _EPS * values[d - 1]:
        return False
    eta = smallest_root(values, along, zero, trace, fourth / count - trace * trace, 0.0)
    fill(sphere, 0.0)
    square_radius = trace
    for k in range(d):
        part = 0.5 * along[k] / (values[k] - eta)
        square_radius += part * part
        for i in range(d):
            sphere[i] += part * basis[i, k]
    for i in range(d):
        sphere[i] += mean[i]
    sphere[d] = math.sqrt(square_radius)
    return bool(sphere[d] < math.inf)


@compiled
def elemental_spheres(y: Floats, subsets: Ints, spheres: Floats) -> None:
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
            fine, square = cholesky_solve(normal, right), 0.0
            for i in range(d):
                sphere[i] = y[t, i, base] + right[i] if fine else math.nan
                square += right[i] * right[i]
            sphere[d] = math.sqrt(square) if fine else math.nan


@compiled
def concentrate(y: Floats, starts: Floats, h: int, spheres: Floats, sums: Floats) -> None:
    """The best spheres of each set (b, d, n) that concentration steps reach from the starts (b, starts, d + 1).

    ``spheres`` (b, FINALISTS, d + 1) receives them, ``sums`` (b, FINALISTS) the sums of the h smallest squares, the
    best first: infinite where there is no sphere.
    """
    b, d, n = y.shape
    work, sphere = search_room(d, n), np.empty(d + 1)
    for t in range(b):
        fill(sums[t], math.inf)
        for turn in range(starts.shape[1] + FINALISTS):
            late = turn - starts.shape[1]  # the starts in turn, then the best of them
            source = spheres[t, late] if late >= 0 else starts[t, turn]
            total, fine = math.inf, late < 0 or sums[t, late] < math.inf
            for i in range(d + 1):
                sphere[i] = source[i]
                fine = fine and abs(sphere[i]) < math.inf
            step, going = 0, fine
            while going:
                following = nearest(y[t], sphere, h, work)
                fell = following < total * (1.0 - _FALL)
                if late >= 0 and following < sums[t, late]:
                    sums[t, late] = following
                    for i in range(d + 1):
                        spheres[t, late, i] = sphere[i]
                total = following
                going = step < _FIRST or (late >= 0 and fell and step < _LAST)
                going = going and _taubin(y[t], work, sphere)
                step += 1
            if late < 0 and fine and total < sums[t, FINALISTS - 1]:
                place = FINALISTS - 1
                while place > 0 and total < sums[t, place - 1]:
                    sums[t, place] = sums[t, place - 1]
                    for i in range(d + 1):
                        spheres[t, place, i] = spheres[t, place - 1, i]
                    place -= 1
                sums[t, place] = total
                for i in range(d + 1):
                    spheres[t, place, i] = sphere[i]
        best = 0
        for k in range(FINALISTS):
            if sums[t, k] < sums[t, best]:
                best = k
        sums[t, 0], sums[t, best] = sums[t, best], sums[t, 0]
        for i in range(d + 1):
            spheres[t, 0, i], spheres[t, best, i] = spheres[t, best, i], spheres[t, 0, i]


def repeated(x: Floats) -> Bools:
    """True for each point of the sets (b, d, n) that repeats an earlier one: (b, n). Missing samples repeat none.

    Points of a continuous law never do: copies mean that a file holds the same measurement several times, or rounds,
    and then the standard errors, which take the points to be independent, may be too small.
    """
    result = np.zeros((x.shape[0], x.shape[2]), dtype=np.bool_)
    first = np.sort(x[:, 0], axis=1)  # where no two are equal, which is the rule, nothing else need be sorted
    tied = np.flatnonzero((first[:, 1:] == first[:, :-1]).any(axis=1))
    order = np.lexsort(np.moveaxis(x[tied], 1, 0), axis=1)  # stable: of equal points the earliest stands first
    ordered, again = np.take_along_axis(x[tied], order[:, None], axis=2), np.zeros(order.shape, dtype=np.bool_)
    np.put_along_axis(again, order[:, 1:], (ordered[:, :, 1:] == ordered[:, :, :-1]).all(axis=1), axis=1)
    result[tied] = again
    return result


_FEWEST, _MOST = 200, 3000
"""Number of elemental subsets: as many as contain a clean one almost surely, between these."""
_CONTAMINATED, _MISSED = 0.4, 1e-4
"""With this share of outliers, no subset is clean with this probability, as far as the most suffice."""
SUBSAMPLE = 500
"""Points of a set that the search begins with: Rousseeuw & Van Driessen's choice is 1500 in five parts of 300."""


def _hash(words: Words) -> Words:
    """Mix 64-bit words (the finaliser of SplitMix64, Steele, Lea & Flood 2014)."""
    mixed = words + np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(mixed ^ (mixed >> np.uint64(31)))


def uniform(count: int, name: int) -> Floats:
    """Numbers (count,) spread evenly over [0, 1), a hash of their place and of a number that names the sequence."""
    words = np.arange(count, dtype=np.uint64) + np.uint64(name << 40)
    return np.asarray((_hash(words) >> np.uint64(11)).astype(float) * 2.0**-53)


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


@compiled
def weighted_pass(y: Floats, weight: Floats, center: Floats, radius: float, rows: Floats, sums: SphereSums) -> None:
    """Form the sums of `study.fits.geometric`, over the points of weight 1."""
    d, n = y.shape
    clear(sums)
    for start in range(0, n, CHUNK):
        size = min(CHUNK, n - start)
        over, part, w = rows[d, :size], rows[d + 1, :size], weight[start : start + size]
        fill(over, 1e-300)  # a sample may lie at the centre
        for i in range(d):
            row, e, c = y[i, start : start + size], rows[i, :size], center[i]
            for k in range(size):
                e[k] = row[k] - c
                over[k] += e[k] * e[k]
        excess = squares = 0.0
        for k in range(size):
            distance = math.sqrt(over[k])
            over[k] = 1.0 / distance
            part[k] = w[k] * (distance - radius)
            excess += part[k]
            squares += part[k] * part[k]
        sums.numbers[0] += excess
        sums.numbers[1] += squares
        for i in range(d):
            e = rows[i, :size]
            for k in range(size):
                e[k] *= over[k]
            sums.vectors[PULL, i] += dot(e, part)
            sums.vectors[MEAN, i] += dot(e, w)
        for i in range(d):
            e = rows[i, :size]
            for k in range(size):
                part[k] = w[k] * over[k] * e[k]
            for j in range(i + 1):
                sums.squares[CURVE, i, j] += dot(part, rows[j, :size])


@compiled
def direction(y: Floats, k: int, sphere: Floats, e: Floats) -> None:
    """Write the direction of point k from the centre of a sphere (d,)."""
    square = 1e-300  # a sample may lie at the centre
    for i in range(e.size):
        e[i] = y[i, k] - sphere[i]
        square += e[i] * e[i]
    over = 1.0 / math.sqrt(square)
    for i in range(e.size):
        e[i] *= over


@compiled
def scatter_directions(y: Floats, sphere: Floats, work: SearchRoom) -> bool:
    """Directions of the points of weight 1: their mean, and Cholesky's factor of Σ(e - ē)(e - ē)ᵀ; False if singular.

    They are left in ``work.vectors[0]`` and ``work.matrices[0]``.
    """
    d, n = y.shape
    mean, e, right, scatter = work.vectors[0], work.vectors[1], work.vectors[2], work.matrices[0]
    count = 0.0
    fill(mean, 0.0)
    fill(right, 0.0)
    for i in range(d):
        for j in range(d):
            scatter[i, j] = 0.0
    for turn in range(2):
        for k in range(n):
            if work.weight[k] > 0.0:
                direction(y, k, sphere, e)
                if turn == 0:
                    count += 1.0
                for i in range(d):
                    if turn == 0:
                        right[i] += e[i]
                    else:
                        e[i] -= mean[i]
                        for j in range(i + 1):
                            scatter[i, j] += e[i] * e[j]
        if turn == 0:
            for i in range(d):
                mean[i] = right[i] / count
    fill(right, 0.0)
    return cholesky_solve(scatter, right)
