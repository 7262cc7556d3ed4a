"""Confidence intervals of a sphere's radius and centre that cover where standard errors do not.

Curvatures at which the score was evaluated, with the spheres found there, and the evaluation itself.

A curvature is k = ±1/r₀: positive where the centre lies on the side of the first estimate, negative on the other.
T sign k is nearly linear in k, through the plane at k = 0, while it is far from linear in r₀.

Interval of each coordinate of the centre: the union over the radii of an interval.

Ends of an interval: the curvatures at which the score reaches its quantile, found by secants and a bracket.

From the first estimate the search goes to T = 0, then to T = q, then to T = -q, where it may pass k = 0: a plane and
centres on the other side are then not rejected, and the radius has no upper end. A curvature without a profile, or with
an unidentified centre, is not rejected either; where these begin, an end is open.

Confidence intervals of radius and centre by inverting the corrected score of the radius, for a batch.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from study.arrays import Bools, Floats, Ints
from study.fits.closed_forms import als
from study.fits.jit import Sums, compiled, zeros
from study.fits.samples import FARTHEST, Samples, binary_size, is_ordinary, scaled
from study.fits.score import Beside, Cloud, ProfileRoom, Sphere, profile, score, set_height

GOOD, WEAK, FAILED = 0, 1, 2
"""A profile was found; the centre is not identified given the radius; there is no profile."""
MOST = 100
"""Largest number of evaluations for one set."""
_IDENTIFIED = 0.2
"""Largest standard error of the centre given the radius, in radii: beyond, plug-in nuisances do not serve."""
_LINEAR = 2.5
"""Ratio of radii up to which the centre is extrapolated along its derivative."""
_TINY = 1e-280
K, T, SLOPE, VARIANCE = 0, 1, 2, 3
"""Columns of `Trail.numbers`: curvature, T sign k, its derivative by k, noise variance."""


class Trail(NamedTuple):
    """Evaluations of one set, in their order.

    Attributes:
        numbers: the columns `K`, `T`, `SLOPE` and `VARIANCE` (MOST, 4).
        vectors: centre, b, standard errors of the centre and their correlations with T (MOST, 4, d).
    """

    numbers: Floats
    vectors: Floats


class Task(NamedTuple):
    """One set and working memory.

    Attributes:
        cloud: the points.
        sphere: the sphere at which the last evaluation ended.
        room: working memory of the profile.
        beside: working memory of the score.
        start: centre of the first estimate (d,), then an empty place for another centre (2, d).
        least: noise variance that counts as none.
    """

    cloud: Cloud
    sphere: Sphere
    room: ProfileRoom
    beside: Beside
    start: Floats
    least: float


@compiled
def _predict(task: Task, trail: Trail, count: int, k: float) -> None:
    """Centre and noise variance at a curvature from those at the nearest curvature before, or the start."""
    center, numbers, vectors = task.start[1], trail.numbers, trail.vectors
    d, r = center.size, 1.0 / abs(k)
    task.sphere.numbers[0] = r
    if count == 0:
        for i in range(d):
            center[i] = task.start[0, i]
        return
    near = 0
    for m in range(count):
        if abs(numbers[m, K] - k) < abs(numbers[near, K] - k):
            near = m
    before, length, bend = 1.0 / abs(numbers[near, K]), 0.0, vectors[near, 1]
    for i in range(d):
        length += bend[i] * bend[i]
    length = max(math.sqrt(length), _TINY)
    ratio = r / before if numbers[near, K] * k > 0.0 else 0.0
    for i in range(d):
        if 1.0 / _LINEAR < ratio < _LINEAR:
            center[i] = vectors[near, 0, i] + bend[i] * (before - r)
        elif ratio > 0.0:
            center[i] = vectors[near, 0, i] + bend[i] / max(length, 1.0) * (before - r)
        else:
            center[i] = bend[i] / length * r
    task.sphere.numbers[2] = numbers[near, VARIANCE]


@compiled
def evaluate(task: Task, trail: Trail, count: int, k: float) -> int:
    """Write the profile and the score at a curvature to place ``count`` of the trail, unless there is no profile.

    Returns:
        `GOOD`, `WEAK` or `FAILED`.
    """
    cloud, sphere, room, beside, start, least = task
    numbers, vectors = trail
    d = start.shape[1]
    _predict(task, trail, count, k)
    set_height(sphere, start[1])
    found, means = profile(cloud, sphere, room, least)
    side = 0.0
    for i in range(d):
        side += sphere.toward[i] * vectors[0, 1, i] if count > 0 else 0.0
    if not found or (k < 0.0 and not side > 0.0):  # it fell back to the side of the estimate
        return FAILED
    at = score(cloud, sphere, room, means, beside)
    if not (abs(at.value) < math.inf and at.slope == at.slope):
        return FAILED
    sign, r = math.copysign(1.0, k), sphere.numbers[0]
    numbers[count, K], numbers[count, T] = k, sign * at.value
    numbers[count, SLOPE], numbers[count, VARIANCE] = -r * r * at.slope, sphere.numbers[2]
    for i in range(d):
        vectors[count, 0, i] = r * sphere.toward[i]
        vectors[count, 1, i] = room.pull[i]
        vectors[count, 2, i], vectors[count, 3, i] = beside.error[i], beside.correlation[i]
    return GOOD if at.spread <= _IDENTIFIED * r else WEAK


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


_ESTIMATE, _SHARPER, _FLATTER, _BEYOND, _ENDED = 0, 1, 2, 3, 4
"""Stages of the search: for T = 0, for q, for -q, for -q on the other side of the plane; and its end."""
_FLAT = 1e-5
"""Curvature that counts as none, in units of the points' spread; what is smaller is lost in rounding."""
_SHARPEST = 1e4
_CLOSE = 1e-4
"""Difference from the wanted T, in quantiles, from which one linear step suffices."""
_NEAR_ZERO = 1e-3
"""The same about T = 0."""
_RETRIES = 4
"""Attempts between a curvature that was fine and one that was not."""
_COLLAPSED = 1e-10
_STEEP = 0.1
"""Least slope of a secant, as a share of the one before."""


class EndsState(Protocol):
    """State of a search between two evaluations, a record of `STATE`. Curvatures that are not known are NaN.

    Attributes:
        stage: one of the stages above.
        count: number of evaluations in the trail.
        tries: number of evaluations that were not fine, in this stage.
        kept: times in a row that ``far`` stayed.
        crossing: 1 if the evaluation in progress is that of a plane.
        k: the curvature to evaluate.
        below, above: curvatures on both sides of T = 0.
        low, high: the answer: curvatures at T = -q and T = q.
        estimate, variance: curvature at T = 0 and the noise variance there.
        origin, origin_t, slope: the evaluation nearest T = 0, T and dT/dk there.
        inner, inner_t: last curvature whose T has not reached the wanted value.
        far, far_t: one whose T is beyond it.
        barrier: nearest curvature without a profile.
        secant: dT/dk between the last two.
    """

    stage: int
    count: int
    tries: int
    kept: int
    crossing: int
    k: float
    below: float
    above: float
    low: float
    high: float
    estimate: float
    variance: float
    origin: float
    origin_t: float
    slope: float
    inner: float
    inner_t: float
    far: float
    far_t: float
    barrier: float
    secant: float


STATE = np.dtype(list(EndsState.__annotations__.items()))


@compiled
def _begin(state: EndsState, first: float) -> None:
    """Start the search for T = 0 at a curvature."""
    state.stage, state.count, state.tries, state.crossing = _ESTIMATE, 0, 0, 0
    state.k = max(first, _FLAT)
    state.below = state.above = state.low = state.high = state.estimate = state.variance = math.nan


@compiled
def _begin_side(state: EndsState, stage: int, inner: float, inner_t: float, secant: float) -> None:
    """Start the search for an end."""
    state.stage, state.tries, state.kept, state.crossing = stage, 0, 0, 0
    state.inner, state.inner_t, state.secant = inner, inner_t, secant
    state.far = state.far_t = state.barrier = math.nan


@compiled
def _choose(state: EndsState, wanted: float) -> None:
    """The next curvature of a search for an end."""
    k, t = state.inner, state.inner_t
    if state.far == state.far:
        share = (wanted - t) / (state.far_t - t) if state.kept % 4 < 3 else 0.5
        state.k = k + (state.far - k) * min(max(share, 1e-3), 0.999)
        return
    most = 2.0 * abs(k - state.origin) + abs(k)
    if wanted < 0.0 and k > 0.0:
        most = 2.0 * most  # towards the plane T is linear, and k has no other scale
    step = min(max((wanted - t) / state.secant, -most), most)
    if state.barrier == state.barrier and abs(step) > 0.5 * abs(state.barrier - k):
        step = 0.5 * (state.barrier - k)
    state.k = k + step
    if state.stage == _FLATTER and state.k < _FLAT:
        state.k, state.crossing = _FLAT, 1


@compiled
def _take(state: EndsState, t: float, wanted: float) -> None:
    """Narrow the search for an end by an evaluation that was fine."""
    secant = (t - state.inner_t) / (state.k - state.inner)
    if secant > _STEEP * state.secant:
        state.secant = secant
    if (t - wanted) * wanted >= 0.0:
        state.far, state.far_t, state.kept = state.k, t, 0
    else:
        state.inner, state.inner_t = state.k, t
        state.kept += 1


@compiled
def _toward_zero(state: EndsState, task: Task, trail: Trail, code: int, quantile: float) -> None:
    """After an evaluation, choose the next one in the search for T = 0, or go on to the ends."""
    numbers, m = trail.numbers, state.count
    if code == FAILED:
        state.tries += 1
        state.k = 0.5 * (state.k + numbers[m - 1, K]) if m > 0 else 0.5 * state.k
        if state.tries > 2 * _RETRIES or not abs(state.k) >= _FLAT:
            state.stage = _ENDED
        return
    k, t, slope, variance = state.k, numbers[m, T], numbers[m, SLOPE], numbers[m, VARIANCE]
    state.count += 1
    if abs(t) <= _NEAR_ZERO * quantile or variance <= task.least:
        if k < 0.0:  # the estimate lies on the other side: begin again from there, so that its curvature is positive
            for i in range(task.start.shape[1]):
                task.start[0, i] = trail.vectors[m, 0, i]
            _begin(state, -k)
            return
        state.estimate, state.variance = k - (t / slope if variance > task.least else 0.0), variance
        if variance <= task.least:
            state.low = state.high = k
        if code != GOOD or variance <= task.least:
            state.stage = _ENDED
            return
        state.origin, state.origin_t, state.slope = k, t, abs(slope)
        _begin_side(state, _SHARPER, k, t, state.slope)
        _choose(state, quantile)
        return
    if t < 0.0:
        state.below = k
    else:
        state.above = k
    if m > 0 and k != numbers[m - 1, K]:  # the derivative holds at T = 0 alone; far from there a secant is better
        secant = (t - numbers[m - 1, T]) / (k - numbers[m - 1, K])
        slope = secant if secant > _STEEP * slope else slope
    step, most = -t / slope if slope > 0.0 else math.copysign(math.inf, -t), 2.0 * abs(k) + 10.0 * _FLAT
    state.k = k + min(max(step, -most), most)
    if state.below == state.below and state.above == state.above and not state.below < state.k < state.above:
        state.k = 0.5 * (state.below + state.above)
    if abs(state.k) < _FLAT:
        state.k = -_FLAT if abs(k) <= _FLAT else _FLAT


@compiled
def _outward(state: EndsState, trail: Trail, code: int, quantile: float) -> None:
    """After an evaluation, choose the next one in the search for an end."""
    m, k = state.count, state.k
    wanted, end, ended = quantile if state.stage == _SHARPER else -quantile, math.nan, False
    if code != GOOD:
        state.tries += 1
        state.barrier, state.crossing = k, 0
        ended = state.tries > _RETRIES or state.inner != state.inner
    else:
        t = trail.numbers[m, T]
        state.count += 1
        if state.inner != state.inner:  # minus the sharpest curvature of the set, see below
            ended = t <= wanted
            _begin_side(state, _BEYOND, k, t, state.slope)
        else:
            _take(state, t, wanted)
        if ended:
            end = -_FLAT
        elif abs(t - wanted) <= _CLOSE * quantile:
            end, ended = k + (wanted - t) / state.secant, True
        elif abs(state.far - state.inner) <= _COLLAPSED * abs(state.inner):  # T jumps there
            end, ended = state.far, True
        elif state.crossing == 1:
            state.crossing = 0
            if t > wanted:  # a plane is not rejected: does the other side hold smaller radii than this one?
                state.low = -_FLAT
                _begin_side(state, _BEYOND, math.nan, math.nan, state.slope)
                state.k = -state.high
                state.stage = _BEYOND if state.high > 0.0 else _ENDED
                return
    if not ended:
        _choose(state, wanted)
        ended = abs(state.k) > _SHARPEST
    if ended and state.stage == _SHARPER:
        state.high = end
        _begin_side(state, _FLATTER, state.origin, state.origin_t, state.slope)
        _choose(state, -quantile)
    elif ended:
        state.low = end if end == end else state.low
        state.stage = _ENDED


@compiled
def invert(task: Task, trail: Trail, state: EndsState, first: float, quantile: float) -> None:
    """Search the ends of the set of curvatures with |T| ≤ q, and write them to the state.

    Args:
        task: the points and the first estimate of the centre.
        trail: receives the evaluations.
        state: receives ``low``, ``high``, ``estimate`` and ``variance``.
        first: curvature of the first estimate, positive.
        quantile: q.
    """
    _begin(state, first)
    for _ in range(MOST):
        code = evaluate(task, trail, state.count, state.k)
        if state.stage == _ESTIMATE:
            _toward_zero(state, task, trail, code, quantile)
        else:
            _outward(state, trail, code, quantile)
        if state.stage == _ENDED:
            break


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


def intervals(samples: Samples, level: float = 0.95, stretch: Floats | None = None) -> Intervals:
    """Confidence intervals of radius and centre, each of the given level, whatever the estimator.

    The score of a hypothetical radius, with centre and noise profiled out, is inverted in signed curvature. It is free
    of the noise's bias for every law of directions, so that intervals cover on small caps and under large noise, where
    an estimate ± a standard error does not. They are asymmetric, and an end that the points do not determine is open.

    Args:
        samples: the batch, in d ≥ 2 dimensions; isotropic noise is assumed, and its size is found in the points.
            Points with a NaN are missing.
        level: nominal coverage, in (0, 1).
        stretch: factors on the quantile of each set (b,), for errors larger than those of white noise; None for 1.

    Raises:
        ValueError: if the level is not between 0 and 1.

    Source: theory §10.
    """
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level}: a confidence level lies between 0 and 1, for example 0.95")
    b, d, _ = samples.shape
    factors = np.ones(b) if stretch is None else stretch
    result = Intervals(np.empty((b, 2)), np.empty((b, d, 2)), np.full(b, np.nan))
    result.radius[:] = 0.0, np.inf
    result.center[:] = -np.inf, np.inf
    if is_ordinary(samples.moments.fourth):
        _compute(samples, level, factors, result)
        return result
    for sets, present in samples.by_count():
        if present.shape[2] <= d + 1:
            continue
        powers = binary_size(present.x)
        for power in np.unique(powers[np.abs(powers) <= FARTHEST]):  # a unit of their own size
            some = np.flatnonzero(powers == power)
            part = Intervals(*(array[sets[some]] for array in result))
            _compute(scaled(present.take(some), -int(power)), level, factors[sets[some]], part)
            result.radius[sets[some]] = np.ldexp(part.radius, power)
            result.center[sets[some]] = np.ldexp(part.center, power)
            result.noise_share[sets[some]] = part.noise_share
    return result


def _compute(samples: Samples, level: float, factors: Floats, result: Intervals) -> None:
    """Fill in the intervals of sets without missing samples, of ordinary size."""
    _, d, n = samples.shape
    if n <= d + 1:
        return
    from scipy.special import stdtrit  # imported here, as it takes as long as the rest of the library

    start = als(samples)
    quantiles = float(stdtrit(n - d - 1, 0.5 * (1.0 + level))) * factors
    x = np.ascontiguousarray(samples.x)
    _compute_all(x, start.center, start.radius, quantiles, result, zeros(d), zeros(d, d))


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
    x: Floats, centers: Floats, radii: Floats, quantiles: Floats, result: Intervals, zero: Sums, square: Sums
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
        quantile = quantiles[t]
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
