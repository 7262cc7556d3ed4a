"""Forward search: grow a clean set of points one by one until the next one is an outlier.

From the h points of least trimmed squares, the sphere is fitted geometrically to the set S of m points. Each point has
a deleted residual, d = |R - r| / (s √(1 ± l)), with s² = Σ_S (R - r)²/(m - d - 1) and the leverage l of the fit
linearised at its answer, + outside S and - inside. The set becomes the m + 1 points of least d, until the (m+1)-th d is
beyond the quantile of Student's t at level α/(2(m + 1)) with m - d - 1 degrees of freedom: it and all beyond it are
outliers. Clean Gaussian points then have an outlier in a share α of the data sets (Hadi & Simonoff 1993).

Before it ends, the next point is fitted along: it is an outlier only if that raises Σ(R - r)² by more than the square
of the quantile times s² too, which does not linearise.

While many points are outside, all that are clearly inside the quantile enter at once: one by one each would, too.
"""

import math
from typing import NamedTuple

import numpy as np

from study.estimators.geometric.newton import ON, STATE, Search, advance, begin
from study.estimators.geometric.newton import Room as NewtonRoom
from study.estimators.robust.concentration import SearchRoom, nearest, residuals, search_room, select
from study.sphere.jit import CHUNK, compiled, dot, fill
from study.sphere.linalg import cholesky_solve
from study.sphere.types import Bools, Floats

_CONCENTRATIONS = 10
"""Most geometric fits of h points before the set grows."""
_MANY = 40
"""With more points outside, several enter at once ..."""
_CLEARLY = 0.8
"""... namely those whose deleted residuals are below this share of the quantile."""
_FURTHEST = 1000.0
"""An outlier is no less likely for being further away than so many times the set's size."""
_ENTROPY = 0.5 * math.log(2.0 * math.pi * math.e)
_LEAST = 1e-3
"""Least 1 - l: a fit goes through a point of leverage 1 whatever it is."""


class Limits(NamedTuple):
    """Limits that residuals are compared with.

    Attributes:
        quantiles: largest deleted residual of the next point, beside m points (n,).
        floor: residuals due to rounding (b,), per unit of the radius.
    """

    quantiles: Floats
    floor: Floats


@compiled
def _pass(y: Floats, weight: Floats, center: Floats, radius: float, rows: Floats, sums: Floats) -> None:
    """Form the sums of `study.estimators.geometric.mle`, over the points of weight 1."""
    d, n = y.shape
    fill(sums, 0.0)
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
        sums[0] += excess
        sums[1] += squares
        for i in range(d):
            e = rows[i, :size]
            for k in range(size):
                e[k] *= over[k]
            sums[2 + i] += dot(e, part)
            sums[2 + d + i] += dot(e, w)
        for i in range(d):
            e = rows[i, :size]
            for k in range(size):
                part[k] = w[k] * over[k] * e[k]
            for j in range(i + 1):
                sums[2 + 2 * d + i * d + j] += dot(part, rows[j, :size])


@compiled
def _scatter(y: Floats, sphere: Floats, work: SearchRoom) -> bool:
    """Directions of the points of weight 1: their mean, and Cholesky's factor of Σ(e - ē)(e - ē)ᵀ; False if singular.

    They are left in ``work.vectors[0]`` and ``work.matrices[0]``.
    """
    d, n = y.shape
    mean, e, right, scatter = work.vectors[0], work.vectors[1], work.vectors[2], work.matrices[0]
    count = 0.0
    fill(mean, 0.0)
    fill(right, 0.0)
    for turn in range(2):
        for i in range(d):
            for j in range(d):
                scatter[i, j] = 0.0
        for k in range(n):
            if work.weight[k] > 0.0:
                distance = 1e-300
                for i in range(d):
                    e[i] = y[i, k] - sphere[i]
                    distance += e[i] * e[i]
                over = 1.0 / math.sqrt(distance)
                for i in range(d):
                    e[i] = e[i] * over - mean[i]
                if turn == 1:
                    for i in range(d):
                        for j in range(i + 1):
                            scatter[i, j] += e[i] * e[j]
                else:
                    count += 1.0
                    for i in range(d):
                        right[i] += e[i]
        if turn == 0:
            for i in range(d):
                mean[i] = right[i] / count
    fill(right, 0.0)
    return cholesky_solve(scatter, right)


@compiled
def _deleted(y: Floats, sphere: Floats, scale: float, m: int, work: SearchRoom) -> None:
    """Replace the residuals R - r in ``work.distance`` by the sizes of the deleted ones."""
    d, n = y.shape
    mean, e, factor = work.vectors[0], work.vectors[1], work.matrices[0]
    regular = _scatter(y, sphere, work)
    for k in range(n):
        leverage = 1.0 / m
        if regular:
            distance = 1e-300
            for i in range(d):
                e[i] = y[i, k] - sphere[i]
                distance += e[i] * e[i]
            over = 1.0 / math.sqrt(distance)
            for i in range(d):
                e[i] = e[i] * over - mean[i]
                for j in range(i):
                    e[i] -= factor[i, j] * e[j]
                e[i] /= factor[i, i]
                leverage += e[i] * e[i]
        inside = work.weight[k] > 0.0
        spread = max(1.0 - leverage, _LEAST) if inside else 1.0 + leverage
        work.distance[k] = abs(work.distance[k]) / (scale * math.sqrt(spread))
        work.copy[k] = work.distance[k]


@compiled
def grow(y: Floats, spheres: Floats, h: int, limits: Limits, outside: Bools, cost: Floats) -> None:
    """Find the outliers of each set, beginning with the points nearest to a sphere.

    Args:
        y: the sets (b, d, n), in units of their size.
        spheres: sphere near h clean points of each set (b, d + 1); NaN where there is none, which leaves no outliers.
        h: number of points to begin with.
        limits: what the residuals are compared with.
        outside: receives True for outliers (b, n).
        cost: receives the negative log-likelihood of the residuals (b,), Gaussian inside, uniform outside up to the
            largest within reason; infinite where there is no sphere.
    """
    b, d, n = y.shape
    quantiles, floor = limits
    work, sums = search_room(d, n), np.empty(2 + 2 * d + d * d)
    sphere, newton = np.empty(d + 1), NewtonRoom(np.empty(d), np.empty((d, d)), np.empty((d, d)))
    state = np.empty(1, STATE)
    search = Search(state[0], np.empty(d), np.empty(d), np.empty(d), np.empty(3))
    for t in range(b):
        cost[t] = math.inf
        for k in range(n):
            outside[t, k] = False
        for i in range(d + 1):
            sphere[i] = spheres[t, i]
        if not sphere[d] < math.inf:
            continue
        best, m, turns = nearest(y[t], sphere, h, work), h, 0
        square = variance = 0.0
        suspected = False
        while True:
            for i in range(d):
                search.best[i] = sphere[i]
            begin(search, 1.0, math.inf)
            status = ON
            while status == ON:
                _pass(y[t], work.weight, search.trial, search.state.radius, work.rows, sums)
                status = advance(search, m, sums, newton)
            for i in range(d):
                sphere[i] = search.best[i]
            sphere[d] = search.result[0]
            if turns < _CONCENTRATIONS:
                total, turns = nearest(y[t], sphere, h, work), turns + 1
                turns = turns if total < best * (1.0 - 1e-9) else _CONCENTRATIONS
                best, m = min(best, total), 0
                for k in range(n):
                    m += work.weight[k] > 0.0
                continue
            residuals(y[t], sphere, work.distance)
            before, square = square, 0.0
            for k in range(n):
                square += work.weight[k] * work.distance[k] * work.distance[k]
            if suspected:
                if square - before > quantiles[m - 1] * quantiles[m - 1] * variance:
                    break
                suspected = False
                for k in range(n):
                    outside[t, k] = False
            if m == n:
                break
            rounding = floor[t] * (1.0 + sphere[d])
            variance = square / (m - d - 1) + rounding * rounding
            _deleted(y[t], sphere, math.sqrt(variance), m, work)
            cut = select(work.copy, m)
            if cut > quantiles[m]:
                suspected, following = True, n
                for k in range(n):
                    outside[t, k] = work.weight[k] == 0.0
                    if outside[t, k] and (following == n or work.distance[k] < work.distance[following]):
                        following = k
                work.weight[following] = 1.0
                m += 1
                continue
            limit = max(cut, _CLEARLY * quantiles[m]) if n - m > _MANY else cut
            last, m = m, 0
            for k in range(n):
                work.weight[k] = 1.0 if work.distance[k] <= limit else 0.0
                m += work.distance[k] <= limit
            if m <= last:  # a distance is not a number
                break
        count, furthest = 0, 0.0
        for k in range(n):
            if outside[t, k]:
                furthest = max(furthest, abs(work.distance[k]))
            else:
                count += 1
        rounding = floor[t] * (1.0 + sphere[d])
        spread = before / (count - d - 1) if suspected else square / max(n - d - 1, 1)
        cost[t] = count * (0.5 * math.log(spread + rounding * rounding) + _ENTROPY)
        if count < n:
            cost[t] += (n - count) * math.log(2.0 * min(furthest, _FURTHEST))
