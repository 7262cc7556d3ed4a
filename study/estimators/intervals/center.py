"""Interval of each coordinate of the centre: the union over the radii of an interval."""

import math

from study.estimators.intervals.trail import K, T, Trail
from study.sphere.jit import compiled
from study.sphere.types import Floats, Ints

_BETWEEN = 16
"""Radii between two evaluations at which the ends of a coordinate are interpolated."""


@compiled
def _order(trail: Trail, count: int, low: float, high: float, order: Ints) -> int:
    """Places of the evaluations within [low, high], up to the last step of a search, by their curvature."""
    inside = 0
    for m in range(count):
        k = trail.numbers[m, K]
        if not low * (1.0 - 1e-3) <= k <= high * (1.0 + 1e-3):
            continue
        place = inside
        while place > 0 and trail.numbers[order[place - 1], K] > k:
            order[place] = order[place - 1]
            place -= 1
        order[place] = m
        inside += 1
    return inside


@compiled
def center_ends(trail: Trail, count: int, low: float, high: float, quantile: float, order: Ints, ends: Floats) -> None:
    """Write the ends of each coordinate (d, 2), relative to the trail's origin.

    Given r₀, ĉ has the error √V with the correlation ρ to T; the coordinate's values that are rejected neither by T nor
    by what of ĉ is independent of T are ĉ - ρT√V ± √V √(1 - ρ²) √(q² - T²) (theory 10.3). Between evaluations T is
    linear in the curvature, and ĉ and √V in the radius.
    """
    numbers, vectors = trail
    d = ends.shape[0]
    inside = _order(trail, count, low, high, order)
    for i in range(d):
        ends[i, 0], ends[i, 1] = math.inf, -math.inf
    for m in range(max(inside - 1, 1)):
        one, two = order[m], order[min(m + 1, inside - 1)]
        first, last = numbers[one, K], numbers[two, K]
        for step in range(_BETWEEN + 1):
            by_k = step / _BETWEEN
            k = first + (last - first) * by_k
            t = numbers[one, T] + (numbers[two, T] - numbers[one, T]) * by_k
            by_r = (1.0 / k - 1.0 / first) / (1.0 / last - 1.0 / first) if last > first else 0.0
            rest = math.sqrt(max(quantile * quantile - t * t, 0.0))
            t = min(max(t, -quantile), quantile)
            for i in range(d):
                center = vectors[one, 0, i] + (vectors[two, 0, i] - vectors[one, 0, i]) * by_r
                error = vectors[one, 2, i] + (vectors[two, 2, i] - vectors[one, 2, i]) * by_r
                correlation = vectors[one, 3, i] + (vectors[two, 3, i] - vectors[one, 3, i]) * by_k
                middle = center - correlation * t * error
                half = error * rest * math.sqrt(1.0 - correlation * correlation)
                ends[i, 0] = min(ends[i, 0], middle - half)
                ends[i, 1] = max(ends[i, 1], middle + half)
