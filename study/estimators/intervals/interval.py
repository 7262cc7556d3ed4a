"""Confidence intervals of radius and centre by inverting the corrected score of the radius, for a batch."""

import math
from typing import NamedTuple

import numpy as np

from study.estimators.algebraic import als
from study.estimators.careful_fit import FARTHEST, binary_size, is_ordinary, scaled
from study.estimators.intervals.center import center_ends
from study.estimators.intervals.invert import STATE, EndsState, invert
from study.estimators.intervals.profile import Cloud, ProfileRoom, Sphere
from study.estimators.intervals.score import Beside
from study.estimators.intervals.trail import MOST, Task, Trail
from study.estimators.samples import Samples
from study.sphere.jit import Sums, compiled, zeros
from study.sphere.types import Bools, Floats

NOISY = 0.35
"""Noise, in radii, from which on a sphere counts as weakly identified although its interval is bounded."""
_EPS = 2.0**-52


class Intervals(NamedTuple):
    """Confidence intervals of a batch of spheres.

    Attributes:
        radius: ends for each set (b, 2), in the unit of the points; 0 and infinite where an end is open.
        center: ends of each coordinate (b, d, 2); -infinite and infinite where the radius has an open end.
        noise_share: σ̂/r̂ at the estimate within the interval (b,); NaN if there is none.
    """

    radius: Floats
    center: Floats
    noise_share: Floats

    @property
    def identified(self) -> Bools:
        """True where the radius is bounded at both ends and the noise is below 0.35 radii (b,)."""
        bounded = (self.radius[:, 0] > 0.0) & (self.radius[:, 1] < math.inf)
        return np.asarray(bounded & (self.noise_share < NOISY))


def intervals(samples: Samples, level: float = 0.95) -> Intervals:
    """Confidence intervals of radius and centre, each of the given level, whatever the estimator.

    The score of a hypothetical radius, with centre and noise profiled out, is inverted in signed curvature. It is free
    of the noise's bias for every law of directions, so that intervals cover on small caps and under large noise, where
    an estimate ± a standard error does not. They are asymmetric, and an end that the points do not determine is open.

    Args:
        samples: the batch, in d ≥ 2 dimensions; isotropic noise is assumed, and its size is found in the points.
            Points with a NaN are missing.
        level: nominal coverage, in (0, 1).

    Raises:
        ValueError: if the level is not between 0 and 1.

    Source: theory §10.
    """
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level}: a confidence level lies between 0 and 1, for example 0.95")
    b, d, _ = samples.shape
    result = Intervals(np.empty((b, 2)), np.empty((b, d, 2)), np.full(b, np.nan))
    result.radius[:] = 0.0, np.inf
    result.center[:] = -np.inf, np.inf
    if is_ordinary(samples.moments.fourth):
        _compute(samples, level, result)
        return result
    for sets, present in samples.by_count():
        if present.shape[2] <= d + 1:
            continue
        powers = binary_size(present.x)
        for power in np.unique(powers[np.abs(powers) <= FARTHEST]):  # a unit of their own size
            some = np.flatnonzero(powers == power)
            part = Intervals(*(array[sets[some]] for array in result))
            _compute(scaled(present.take(some), -int(power)), level, part)
            result.radius[sets[some]] = np.ldexp(part.radius, power)
            result.center[sets[some]] = np.ldexp(part.center, power)
            result.noise_share[sets[some]] = part.noise_share
    return result


def _compute(samples: Samples, level: float, result: Intervals) -> None:
    """Fill in the intervals of sets without missing samples, of ordinary size."""
    _, d, n = samples.shape
    if n <= d + 1:
        return
    from scipy.special import stdtrit  # imported here, as it takes as long as the rest of the library

    start = als(samples)
    quantile = float(stdtrit(n - d - 1, 0.5 * (1.0 + level)))
    x = np.ascontiguousarray(samples.x)
    _compute_all(x, start.center, start.radius, quantile, result, zeros(d), zeros(d, d))


@compiled
def _load(x: Floats, t: int, rows: Floats, origin: Floats) -> tuple[float, float]:
    """Write a set relative to its centroid in units of its spread; returns the unit and the level of rounding."""
    _, d, n = x.shape
    trace = largest = 0.0
    for i in range(d):
        first, total = x[t, i, 0], 0.0
        for k in range(n):
            total += x[t, i, k] - first
        origin[i] = first + total / n
        square = 0.0
        for k in range(n):
            rows[i, k] = x[t, i, k] - origin[i]
            square += rows[i, k] * rows[i, k]
            largest = max(largest, abs(x[t, i, k]))
        trace += square / n
    unit = math.sqrt(trace)
    for k in range(n):
        square = 0.0
        for i in range(d):
            rows[i, k] /= unit
            square += rows[i, k] * rows[i, k]
        rows[d, k] = square
    return unit, 8.0 * _EPS * (1.0 + largest / unit)


@compiled
def _write(state: EndsState, unit: float, result: Intervals, t: int) -> bool:
    """Write the radius of a set; False if it has an open end."""
    radius, _, share = result
    low, high = state.low, state.high
    if state.estimate > 0.0:
        share[t] = math.sqrt(max(state.variance, 0.0)) * state.estimate
    sharpest = max(high, -low) if low < 0.0 and high == high else high
    if sharpest > 0.0:
        radius[t, 0] = unit / sharpest
    if low > 0.0:
        radius[t, 1] = unit / low
    return low > 0.0 and high > 0.0


@compiled
def _compute_all(
    x: Floats, centers: Floats, radii: Floats, quantile: float, result: Intervals, zero: Sums, square: Sums
) -> None:
    """Fill in the intervals of each set of a batch, of which a first estimate is known."""
    b, d, n = x.shape
    rows, origin, ends, order = np.empty((d + 1, n)), np.empty(d), np.empty((d, 2)), np.empty(MOST, np.int64)
    products = np.empty(2 * d + d * d + 2)
    sphere = Sphere(np.empty(3), np.empty(d))
    room = ProfileRoom(np.empty(2 + 2 * d + d * d), np.empty((d, 2 * d)), np.empty((d, d)), np.empty(d))
    matrices = np.empty((3, d, d))
    beside = Beside(np.empty((2, d * d)), products, matrices[0], matrices[1], matrices[2], np.empty(d), np.empty(d))
    trail, start, states = Trail(np.empty((MOST, 4)), np.empty((MOST, 4, d))), np.empty((2, d)), np.empty(1, STATE)
    state = states[0]
    for t in range(b):
        unit, rounding = _load(x, t, rows, origin)
        distance = 0.0
        for i in range(d):
            start[0, i] = (centers[t, i] - origin[i]) / unit
            distance += start[0, i] * start[0, i]
        first = unit / radii[t] if radii[t] > 0.0 else 1.0 / math.sqrt(distance)
        if not (unit > 0.0 and 0.0 < first < math.inf and distance < math.inf):
            continue
        least = rounding * rounding
        sphere.numbers[2] = max(_first_variance(rows, n, start, 1.0 / first), least)
        task = Task(Cloud(rows, n, zero, square), sphere, room, beside, start, least)
        invert(task, trail, state, first, quantile)
        if _write(state, unit, result, t):
            if state.low == state.high:
                for i in range(d):
                    ends[i, 0] = ends[i, 1] = trail.vectors[state.count - 1, 0, i]
            else:
                center_ends(trail, state.count, state.low, state.high, quantile, order, ends)
            for i in range(d):
                for side in range(2):
                    result.center[t, i, side] = origin[i] + unit * ends[i, side]


@compiled
def _first_variance(rows: Floats, n: int, start: Floats, radius: float) -> float:
    """Mean square of the distances from the first sphere."""
    d = start.shape[1]
    total = 0.0
    for k in range(n):
        square = 0.0
        for i in range(d):
            square += (rows[i, k] - start[0, i]) ** 2
        total += (math.sqrt(square) - radius) ** 2
    return total / n
