"""Newton's method for the minimum of F(c) = Σ(Rᵢ - R̄)², Rᵢ = |xᵢ - c|, step by step: from sums to the next centre.

With e = (x - c)/R and r = R̄,

    ½∇F = -Σ(R - r)e,    ½∇²F = Σ[(1 - r/R) I + (r/R) eeᵀ] - n ē ēᵀ,

and where that is not positive definite its eigenvalues are replaced by their absolute values. A step is at most the
current radius long and is halved until F falls. On a small cap the infimum can lie at infinity, where the sphere is
a plane: the centre is stopped at a bound. The status then is `AT_BOUND`, as it is where a far sphere is no better than
the best plane.

Maximum likelihood: geometric least squares, minimising F(c) = Σ(Rᵢ - R̄)² over the centre, Rᵢ = |xᵢ - c|.

Newton's method with the exact Hessian, from GDKE's or Taubin's answer: 1-8 passes over the data where Gauss-Newton
takes 7-78. Never from UGDK's, which can lie anywhere.

F falls off on both sides of the points: besides the minimum on the side of the sphere there may be one on the other
side, or only a slope to infinity, where the sphere is a plane (a status says so). `mle_centroid` and `mle_mirror`
start elsewhere, to show whether there are other minima, and better ones; on data use `mle`. Its answers are bad exactly
where one of these has a much better one, or none has.

Source: paper §4.3 and Shakarji 1998, which minimise the same function by Levenberg-Marquardt.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from study.arrays import Floats
from study.fits.closed_forms import member, root
from study.fits.jit import (
    BLOCK,
    CHUNK,
    SampleBlock,
    Scratch,
    Sums,
    at,
    compiled,
    dot,
    fill,
    fresh,
    put,
    window,
    zeros,
)
from study.fits.linalg import cholesky_solve, diagonalise
from study.fits.samples import Estimates, Samples, Status, blank

_MAX_ITERATIONS = 100
_MAX_HALVINGS = 40
_TOLERANCE = 1e-9
"""A Newton step below this share of the radius ends the iteration: the next one would be its square."""
_SHORT, _SURE = 1e-2, 1e-10
"""A step this short, beside the one before it and the radius, ends it too, if the next one should be this short ..."""
_THIRD = 1e-8
"""... and its third-order term is this small relative to F."""
_EPS = 2.0**-52
_LEVEL = 0.01
"""Where rounding ends the iteration although Newton's step is above this share of the radius, F has levelled off on the
way to a plane: it has the same value at centres far apart."""
_FAR = 1e-5
"""An iteration that does not end beyond this share of the bound is on its way to it."""
_CANCELLED = 1e4
"""F is formed about the last radius. Where a long step makes the correction this many times F, it is formed again."""
_FLAT = 1e-15
"""Least curvature, per sample, that a step is divided by."""
_BOUND = 1e8
"""Largest distance from the centroid, in units of the points' spread √Tr C: so flat a sphere is a plane in float64."""


class State(Protocol):
    """State of a search between two passes, a record of `STATE`.

    Attributes:
        bound: largest distance from the origin.
        plane: F of the best plane.
        radius: radius about which F is formed.
        best: F of the best centre so far.
        before: radius of the best centre so far.
        wanted: length of the last step that was not halved, before it was cut to the radius.
        square: squared distance of the trial centre from the origin.
        last: length of the last step, if it was Newton's in full, else 0.
        steps: number of steps.
        halvings: how often the present step was halved.
        again: 1 if F is formed a second time, about a better radius.
    """

    bound: float
    plane: float
    radius: float
    best: float
    before: float
    wanted: float
    square: float
    last: float
    steps: int
    halvings: int
    again: int


STATE = np.dtype(list(State.__annotations__.items()))
ON = -1
"""In place of a status: the search goes on."""


class Search(NamedTuple):
    """The search for the minimum of one set; centres are relative to an origin near the points.

    Attributes:
        state: a record of `STATE`.
        best: best centre so far (d,).
        trial: centre whose F the next pass forms (d,).
        step: the step between them (d,).
        result: radius and F of the best centre, and number of steps (3,).
    """

    state: State
    best: Floats
    trial: Floats
    step: Floats
    result: Floats


class Room(NamedTuple):
    """Working memory of a step: Σ(R - R̄)e (d,), ½∇²F (d, d) and its eigenvectors (d, d)."""

    descent: Floats
    matrix: Floats
    vectors: Floats


@compiled
def _copy(source: Floats, target: Floats) -> None:
    """Copy a vector (each slice assignment would take the compiler half a second)."""
    for i in range(source.size):
        target[i] = source[i]


@compiled
def _trace(square: Floats, d: int) -> float:
    result = 0.0
    for i in range(d):
        result += square[i * d + i]
    return result


@compiled
def half_hessian(n: int, radius: float, mean: Floats, curve: Floats, matrix: Floats) -> None:
    """½∇²F from the sums of a pass."""
    d, inverse = len(mean), _trace(curve, len(mean))
    for i in range(d):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = radius * curve[i * d + j] - mean[i] * mean[j] / n
        matrix[i, i] += n - radius * inverse


@compiled
def _downhill(n: int, radius: float, mean: Floats, curve: Floats, room: Room, step: Floats) -> bool:
    """Write the step from ``room.descent``: Newton's, or with absolute eigenvalues, and then False is returned."""
    descent, matrix, vectors = room
    half_hessian(n, radius, mean, curve, matrix)
    _copy(descent, step)
    if cholesky_solve(matrix, step):
        return True
    half_hessian(n, radius, mean, curve, matrix)
    diagonalise(matrix, vectors)
    fill(step, 0.0)
    for j in range(len(step)):
        along = dot(vectors[:, j], descent) / max(abs(matrix[j, j]), _FLAT * n)
        for i in range(len(step)):
            step[i] += along * vectors[i, j]
    return False


@compiled
def begin(search: Search, spread: float, plane: float) -> None:
    """Start from ``search.best``; ``spread`` is the mean of |x - origin|², ``plane`` the F of the best plane."""
    state, best = search.state, search.best
    state.plane = plane
    state.bound = _BOUND * math.sqrt(spread)
    state.radius = state.before = math.sqrt(spread + dot(best, best))  # eq. 3: it keeps R - r small
    state.best = math.inf
    state.wanted = state.square = state.last = 0.0
    state.steps = state.halvings = state.again = 0
    _copy(best, search.trial)


@compiled
def _ended(state: State, n: int, value: float) -> int:
    """Status of a search that ends where F has this value: a sphere, unless it is far and no better than a plane."""
    far, doubt = state.square > (_FAR * state.bound) ** 2, 2.0 * _EPS * state.before * math.sqrt(n * max(value, 0.0))
    if state.wanted > _LEVEL * state.before or (far and not value < state.plane - doubt):
        return Status.AT_BOUND
    return Status.OK


@compiled
def advance(search: Search, n: int, sums: Floats, room: Room) -> int:
    """Compare the trial centre with the best by the sums of a pass, and choose the next one.

    Returns:
        `ON`, or a `Status` if the search has ended.
    """
    state, best, trial, step, result = search
    descent = room.descent
    d, excess = best.size, sums[0]
    pull, mean, curve = sums[2 : 2 + d], sums[2 + d : 2 + 2 * d], sums[2 + 2 * d :]
    value = sums[1] - excess * excess / n
    if state.again == 0 and excess * excess > _CANCELLED * n * value:
        state.radius += excess / n
        state.again = 1
        return ON
    state.again = 0
    newton, rise = True, excess / n
    around = state.radius + rise  # R̄, the radius that belongs to this centre
    if value <= state.best:
        state.best, state.before, state.halvings = value, around, 0
        _copy(trial, best)
        result[0], result[1], result[2] = around, value, float(state.steps)
        if state.steps >= _MAX_ITERATIONS:
            return Status.AT_BOUND if state.square > (_FAR * state.bound) ** 2 else Status.NOT_CONVERGED
        state.steps += 1
        for i in range(d):
            descent[i] = pull[i] - rise * mean[i]  # Σ(R - R̄)e, from Σ(R - r)e: not by R̄ - r, which has lost digits
        newton = _downhill(n, around, mean, curve, room, step)
    elif state.halvings == 0 and value <= state.best + 2.0 * _EPS * state.radius * math.sqrt(n * state.best):
        _copy(trial, best)  # F is the same to rounding, and this centre is a Newton step further
        result[0], result[1], result[2] = around, value, float(state.steps)
        return _ended(state, n, value)
    else:
        state.halvings += 1
        if state.halvings > _MAX_HALVINGS:
            return Status.AT_BOUND if state.square > (_FAR * state.bound) ** 2 else Status.NOT_CONVERGED
        for i in range(d):
            step[i] *= 0.5
    before, length = state.before, math.sqrt(dot(step, step))
    if not length < math.inf:
        return Status.NOT_FINITE
    if state.halvings == 0:
        state.wanted = length
    if length > before:
        newton = False
        for i in range(d):
            step[i] *= before / length
    for i in range(d):
        trial[i] = best[i] + step[i]
    state.square, state.radius = dot(trial, trial), before
    full = newton and state.halvings == 0
    following = length * (length / state.last) ** 2  # steps fall off as the squares of those before them
    done = full and length <= _SHORT * min(before, state.last) and following <= _SURE * before
    done = done and n * length**3 <= _THIRD * state.best * before
    state.last = length if full else 0.0
    if done or length <= _TOLERANCE * before:
        if state.halvings == 0:  # what the step changes in R̄ and F, to second order in a step this short
            _copy(trial, best)
            bend = _trace(curve, d) * length * length
            for i in range(d):
                result[1] -= step[i] * descent[i]
                for j in range(d):
                    bend -= step[i] * curve[max(i, j) * d + min(i, j)] * step[j]
            result[0] += (0.5 * bend - dot(step, mean)) / n
        result[2] = float(state.steps)
        return _ended(state, n, state.best)
    return Status.AT_BOUND if state.square > state.bound * state.bound else ON


_CLEAR = 0.3
"""Noise below this share of the points' least variance leaves no doubt where to begin."""


class Start(NamedTuple):
    """Starting values of a batch.

    Attributes:
        origin: point near each set (b, d).
        spread: mean of |x - origin|² (b,).
        values: eigenvalues of C (b, d), ascending.
        offset: centre relative to the origin (b, d); receives the best centre.
    """

    origin: Floats
    spread: Floats
    values: Floats
    offset: Floats


def mle(samples: Samples) -> Estimates:
    """Maximum likelihood (geometric least squares) by Newton's method with a bound.

    Isotropic noise is assumed whatever ``samples.noise`` is; the noise level does not enter the centre. The noise
    variance is Σ(R - r)²/(n - d - 1).

    Source: paper §4.3; Shakarji 1998.
    """
    return _minimum_from(samples, 1.0)


def mle_centroid(samples: Samples) -> Estimates:
    """`mle` from the centroid of the points, between the two sides.

    Source: paper §4.1, which explains MLE's outliers by multiple solutions.
    """
    return _minimum_from(samples, 0.0)


def mle_mirror(samples: Samples) -> Estimates:
    """`mle` from the wrong side of the points: GDKE's answer reflected through their centroid.

    Source: paper §4.1, which explains MLE's outliers by multiple solutions.
    """
    return _minimum_from(samples, -1.0)


def _minimum_from(samples: Samples, share: float) -> Estimates:
    """The minimum of F that Newton's method finds from x̄ + share · (ĉ - x̄).

    ĉ is Taubin's answer where the noise is clearly below the points' extent, which saves a pass or two, and GDKE's,
    which does not run away, where it is not.
    """
    regression, values = samples.regression, samples.spectrum.values
    b, d = values.shape
    eta = root(samples, 0.0)
    clear = eta < _CLEAR * values[:, 0]
    first = member(samples, np.where(clear, eta, 0.0), 0.0)
    fit = blank(b, d)
    fit.status[:] = first.status
    start = Start(regression.origin, regression.square, values, share * (first.center - regression.origin))
    _fit_all(samples.rows, start, fit, zeros(d), zeros(d, d))
    return fit


@compiled
def _pass(block: SampleBlock, origin: Floats, center: Floats, radius: float, sums: Floats, scratch: Scratch) -> None:
    """Add a block of samples to the sums for a trial centre, which is relative to ``origin``.

    They are Σ(R-r), Σ(R-r)², Σ(R-r)e, Σe and, in its lower triangle, Σeeᵀ/R, whose trace is Σ1/R.
    """
    x, t, start, m = block
    rows, zero, square = scratch
    d = len(zero)
    near, away, e, pull, mean, curve = fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(square)
    for i in range(d):
        near, away = put(near, i, origin[i]), put(away, i, center[i])
    excess = squares = 0.0
    for part in range(start, start + m, CHUNK):
        count = min(CHUNK, start + m - part)
        view = window(x, t, part, count, rows, zero)
        for k in range(count):
            distance = 1e-300  # a sample may lie at the centre
            for i in range(d):
                e = put(e, i, (at(view, i, k) - near[i]) - away[i])
                distance += e[i] * e[i]
            distance = math.sqrt(distance)
            over = 1.0 / distance
            residual = distance - radius
            excess += residual
            squares += residual * residual
            for i in range(d):
                e = put(e, i, e[i] * over)
                mean = put(mean, i, mean[i] + e[i])
                pull = put(pull, i, pull[i] + e[i] * residual)
                weighted = e[i] * over
                for j in range(i + 1):
                    curve = put(curve, i * d + j, curve[i * d + j] + weighted * e[j])
    sums[0] += excess
    sums[1] += squares
    for i in range(d):
        sums[2 + i] += pull[i]
        sums[2 + d + i] += mean[i]
    for i in range(d * d):
        sums[2 + 2 * d + i] += curve[i]


@compiled
def minimise(x: Floats, t: int, origin: Floats, search: Search, sums: Floats, room: Room, scratch: Scratch) -> int:
    """Search the minimum of F of set t of a batch (b, d, n), from where `begin` started it; returns the status."""
    n, status = x.shape[2], ON
    while status == ON:
        fill(sums, 0.0)
        for begun in range(0, n, BLOCK):
            block = SampleBlock(x, t, begun, min(BLOCK, n - begun))
            _pass(block, origin, search.trial, search.state.radius, sums, scratch)
        status = advance(search, n, sums, room)
    return status


@compiled
def _fit_all(x: Floats, start: Start, fit: Estimates, zero: Sums, square: Sums) -> None:
    """Minimise F for each set of a batch (b, d, n) whose status is ok.

    ``zero`` and ``square`` are d and d² sums at zero.
    """
    b, d, n = x.shape
    scratch = Scratch(np.empty((1, d, CHUNK)), zero, square)
    room = Room(np.empty(d), np.empty((d, d)), np.empty((d, d)))
    state, sums = np.empty(1, STATE), np.empty(2 + 2 * d + d * d)
    trial, step, result = np.empty(d), np.empty(d), np.empty(3)
    for t in range(b):
        result[0] = result[1] = math.nan
        result[2] = 0.0
        search = Search(state[0], start.offset[t], trial, step, result)
        status = fit.status[t]
        if status == Status.OK:
            begin(search, start.spread[t], (n - 1.0) * start.values[t, 0])
            status = minimise(x, t, start.origin[t], search, sums, room, scratch)
        fit.status[t] = status
        for i in range(d):
            fit.center[t, i] = start.origin[t, i] + start.offset[t, i]
        fit.radius[t], fit.iterations[t] = result[0], int(result[2])
        value = max(result[1], 0.0) if result[1] == result[1] else math.nan  # rounding can take F below 0
        fit.noise_variance[t] = value / (n - d - 1) if n > d + 1 else math.nan
