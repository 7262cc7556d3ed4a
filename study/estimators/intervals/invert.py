"""Ends of an interval: the curvatures at which the score reaches its quantile, found by secants and a bracket.

From the first estimate the search goes to T = 0, then to T = q, then to T = -q, where it may pass k = 0: a plane and
centres on the other side are then not rejected, and the radius has no upper end. A curvature without a profile, or with
an unidentified centre, is not rejected either; where these begin, an end is open.
"""

import math
from typing import Protocol

import numpy as np

from study.estimators.intervals.trail import FAILED, GOOD, MOST, SLOPE, VARIANCE, K, T, Task, Trail, evaluate
from study.sphere.jit import compiled

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
