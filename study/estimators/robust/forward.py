"""Forward search: grow a clean set of points one by one until the next one is an outlier.

From the h points of least trimmed squares, the sphere is fitted geometrically to the set S of m points. Each point has
a deleted residual, t = (R - r) / (s √(1 ± l)), with s² = Σ_S (R - r)²/(m - d - 1 - f), f the parameters that curvature
adds, and the leverage l of the fit linearised at its answer, + outside S and - inside. The set becomes the m + 1 points
of which |t| is least beside its limit, until the (m+1)-th is beyond: it and all beyond it are outliers. The limit is
the quantile of Student's t at level α/(2(m + 1)) with m - d - 1 degrees of freedom, changed as the law of R differs
from the normal one (`study.estimators.robust.curvature`). Clean Gaussian points then have an outlier in a share α of
the data sets (Hadi & Simonoff 1993).

Before it ends, the next point is fitted along: it is an outlier only if that raises Σ(R - r)² by more than the square
of the limit times s² too, which does not linearise.

While many points are outside, all that are clearly inside the limit enter at once: one by one each would, too.
"""

import math
from typing import NamedTuple

import numpy as np

from study.estimators.geometric.newton import ON, STATE, Search, advance, begin
from study.estimators.geometric.newton import Room as NewtonRoom
from study.estimators.robust.concentration import SearchRoom, nearest, residuals, search_room, select
from study.estimators.robust.curvature import as_rare
from study.estimators.robust.weighted_sums import direction, scatter_directions, weighted_pass
from study.sphere.jit import compiled
from study.sphere.types import Bools, Floats

_CONCENTRATIONS = 10
"""Most geometric fits of h points before the set grows."""
_MANY = 40
"""With more points outside, several enter at once ..."""
_CLEARLY = 0.8
"""... namely those whose deleted residuals are below this share of their limit."""
_FURTHEST = 1000.0
"""An outlier is no less likely for being further away than so many times the set's size."""
_ENTROPY = 0.5 * math.log(2.0 * math.pi * math.e)
_LEAST = 1e-3
"""Least 1 - l: a fit goes through a point of leverage 1 whatever it is."""


class Limits(NamedTuple):
    """Limits that residuals are compared with.

    Attributes:
        quantiles: Student's quantile for the next point, beside m points (n,).
        floor: residuals due to rounding (b,), per unit of the radius.
        extra: parameters that curvature adds, in the fit of all points (b,).
        share: (s/r)² of all points (b,), which clean points of the set have at most.
    """

    quantiles: Floats
    floor: Floats
    extra: Floats
    share: Floats


@compiled
def _deleted(y: Floats, sphere: Floats, scale: float, m: int, above: float, below: float, work: SearchRoom) -> None:
    """Replace the residuals R - r in ``work.distance`` by the sizes of the deleted ones over their limits."""
    d, n = y.shape
    mean, e, factor = work.vectors[0], work.vectors[1], work.matrices[0]
    regular = scatter_directions(y, sphere, work)
    for k in range(n):
        leverage = 1.0 / m
        if regular:
            direction(y, k, sphere, e)
            for i in range(d):
                e[i] -= mean[i]
                for j in range(i):
                    e[i] -= factor[i, j] * e[j]
                e[i] /= factor[i, i]
                leverage += e[i] * e[i]
        inside = work.weight[k] > 0.0
        spread = max(1.0 - leverage, _LEAST) if inside else 1.0 + leverage
        limit = above if work.distance[k] > 0.0 else below
        work.distance[k] = abs(work.distance[k]) / (limit * scale * math.sqrt(spread))
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
        cost: receives the negative log-likelihood (b,): residuals are Gaussian inside and uniform outside up to the
            largest within reason, and every choice of as many outliers is as likely; infinite where there is no sphere.
    """
    b, d, n = y.shape
    quantiles, floor, extra, share = limits
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
        square = variance = above = below = 0.0
        following = 0
        suspected = False
        while True:
            for i in range(d):
                search.best[i] = sphere[i]
            begin(search, 1.0, math.inf)
            status = ON
            while status == ON:
                weighted_pass(y[t], work.weight, search.trial, search.state.radius, work.rows, sums)
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
                limit = above if work.distance[following] > 0.0 else below
                if square - before > limit * limit * variance:
                    break
                suspected = False
                for k in range(n):
                    outside[t, k] = False
            if m == n:
                break
            rounding = floor[t] * (1.0 + sphere[d])
            variance = square / max(m - d - 1 - extra[t], 1.0) + rounding * rounding
            among = variance / (sphere[d] * sphere[d])
            above = as_rare(quantiles[m], max(among, share[t]), d)
            below = -as_rare(-quantiles[m], among, d)
            _deleted(y[t], sphere, math.sqrt(variance), m, above, below, work)
            cut = select(work.copy, m)
            if cut > 1.0:
                suspected, following = True, n
                for k in range(n):
                    outside[t, k] = work.weight[k] == 0.0
                    if outside[t, k] and (following == n or work.distance[k] < work.distance[following]):
                        following = k
                work.weight[following] = 1.0
                m += 1
                continue
            limit = max(cut, _CLEARLY) if n - m > _MANY else cut
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
            cost[t] += math.lgamma(n + 1.0) - math.lgamma(count + 1.0) - math.lgamma(n - count + 1.0)
