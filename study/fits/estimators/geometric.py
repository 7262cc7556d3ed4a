"""Maximum likelihood: geometric least squares, minimising F(c) = Σ(Rᵢ - R̄)² over the centre, Rᵢ = |xᵢ - c|.

Newton's method with the exact Hessian, from GDKE's or Taubin's answer: 1-8 passes over the data where Gauss-Newton
takes 7-78. Never from UGDK's, which can lie anywhere. With e = (x - c)/R and r = R̄,

    ½∇F = -Σ(R - r)e,    ½∇²F = Σ[(1 - r/R) I + (r/R) eeᵀ] - n ē ēᵀ,

and where that is not positive definite its eigenvalues are replaced by their absolute values. A step is at most the
current radius long and is halved until F falls. The sums over the points of a sphere stand here for every fit that
iterates about one.

F falls off on both sides of the points: besides the minimum on the side of the sphere there may be one on the other
side, or only a slope to infinity, where the sphere is a plane: the centre is stopped at a bound. The status then is
`AT_BOUND`, as it is where a far sphere is no better than the best plane. `mle_centroid` and `mle_mirror` start
elsewhere, to show whether there are other minima, and better ones; on data use `mle`. Its answers are bad exactly where
one of these has a much better one, or none has. `mle_early` stops soon.

Source: paper §4.3 and Shakarji 1998, which minimise the same function by Levenberg-Marquardt.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from study.arrays import Floats
from study.fits.estimators.closed_forms import member, root
from study.fits.loops.jit import (
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
from study.fits.loops.linalg import cholesky_solve, diagonalise
from study.fits.points.moments import Regression
from study.fits.points.samples import Estimates, Samples, Status, blank

SUM_E, SUM_RHO_E, SUM_RHO2_E = 0, 1, 2
"""Rows of `SphereSums.vectors`: Σe, Σρe and Σρ²e."""
SUM_EE_OVER_R, SUM_R_EE = 0, 1
"""Matrices of `SphereSums.squares`: Σeeᵀ/R, whose trace is Σ1/R, and ΣR eeᵀ."""


class SphereSums(NamedTuple):
    """Sums over the points of a set about a trial sphere: with R = |x - c|, ρ = R - r and e = (x - c)/R.

    Few arrays, since each costs a kernel as much as ten points.

    Attributes:
        numbers: Σρ and Σρ² (2,).
        vectors: the rows `SUM_E`, `SUM_RHO_E` and, where a pass is wide, `SUM_RHO2_E` (3, d).
        squares: the matrices `SUM_EE_OVER_R` and, where a pass is wide, `SUM_R_EE`, in their lower triangles (2, d, d).
    """

    numbers: Floats
    vectors: Floats
    squares: Floats


@compiled
def sphere_sums(d: int) -> SphereSums:
    """Places for the sums in d dimensions."""
    return SphereSums(np.empty(2), np.empty((3, d)), np.empty((2, d, d)))


@compiled
def clear(sums: SphereSums) -> None:
    """Set the sums to zero."""
    numbers, vectors, squares = sums
    d = vectors.shape[1]
    numbers[0] = numbers[1] = 0.0
    for k in range(3):
        for i in range(d):
            vectors[k, i] = 0.0
    for k in range(2):
        for i in range(d):
            for j in range(i + 1):
                squares[k, i, j] = 0.0


@compiled
def _add(
    block: SampleBlock, origin: Floats, center: Floats, radius: float, wide: bool, sums: SphereSums, scratch: Scratch
) -> None:
    """Add a block of samples to the sums."""
    x, t, start, m = block
    rows, zero, square = scratch
    d = len(zero)
    near, away, y, e = fresh(zero), fresh(zero), fresh(zero), fresh(zero)
    pull, mean, second, curve, stretch = fresh(zero), fresh(zero), fresh(zero), fresh(square), fresh(square)
    for i in range(d):
        near, away = put(near, i, origin[i]), put(away, i, center[i])
    excess = square_sum = 0.0
    for part in range(start, start + m, CHUNK):
        count = min(CHUNK, start + m - part)
        view = window(x, t, part, count, rows, zero)
        for k in range(count):
            distance = 1e-300  # a sample may lie at the centre
            for i in range(d):
                y = put(y, i, (at(view, i, k) - near[i]) - away[i])
                distance += y[i] * y[i]
            distance = math.sqrt(distance)
            over = 1.0 / distance
            residual = distance - radius
            residual_square = residual * residual
            excess += residual
            square_sum += residual_square
            for i in range(d):
                e = put(e, i, y[i] * over)
                mean = put(mean, i, mean[i] + e[i])
                pull = put(pull, i, pull[i] + e[i] * residual)
                if wide:
                    second = put(second, i, second[i] + e[i] * residual_square)
                weighted = e[i] * over
                for j in range(i + 1):
                    curve = put(curve, i * d + j, curve[i * d + j] + weighted * e[j])
                    if wide:
                        stretch = put(stretch, i * d + j, stretch[i * d + j] + e[i] * y[j])
    numbers, vectors, squares = sums
    numbers[0] += excess
    numbers[1] += square_sum
    for i in range(d):
        vectors[SUM_E, i] += mean[i]
        vectors[SUM_RHO_E, i] += pull[i]
        if wide:
            vectors[SUM_RHO2_E, i] += second[i]
        for j in range(i + 1):
            squares[SUM_EE_OVER_R, i, j] += curve[i * d + j]
            if wide:
                squares[SUM_R_EE, i, j] += stretch[i * d + j]


@compiled
def sum_about(
    points: SampleBlock, origin: Floats, center: Floats, radius: float, wide: bool, sums: SphereSums, scratch: Scratch
) -> None:
    """Form the sums of a set's points about a trial sphere, whose centre is relative to ``origin``.

    ``wide`` adds two sums, and must be a constant.
    """
    x, t, first, n = points
    clear(sums)
    for start in range(first, first + n, BLOCK):
        _add(SampleBlock(x, t, start, min(BLOCK, first + n - start)), origin, center, radius, wide, sums, scratch)


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
        best: F of the best centre so far, infinite before there is one.
        before: R̄ of the best centre so far.
        wanted: length of the last step that was not halved, before it was cut to the radius.
        square: squared distance of the trial centre from the origin.
        last: length of the last step, if it was Newton's in full, else 0.
        steps: number of steps that were taken.
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


STATE = np.dtype((np.record, list(State.__annotations__.items())))
ON = -1
"""In place of a status: the search goes on."""


class Search(NamedTuple):
    """The search for the minimum of one set; centres are relative to an origin near the points.

    Attributes:
        state: a record of `STATE`.
        best: best centre so far (d,).
        trial: centre whose F the next pass forms (d,).
        step: the step between them (d,).
    """

    state: State
    best: Floats
    trial: Floats
    step: Floats


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
def _trace(curve: Floats) -> float:
    result = 0.0
    for i in range(curve.shape[1]):
        result += curve[SUM_EE_OVER_R, i, i]
    return result


@compiled
def _half_hessian(n: int, radius: float, sums: SphereSums, matrix: Floats) -> None:
    """½∇²F from the sums of a pass."""
    vectors, squares, inverse = sums.vectors, sums.squares, _trace(sums.squares)
    for i in range(vectors.shape[1]):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = (
                radius * squares[SUM_EE_OVER_R, i, j] - vectors[SUM_E, i] * vectors[SUM_E, j] / n
            )
        matrix[i, i] += n - radius * inverse


@compiled
def _downhill(n: int, radius: float, sums: SphereSums, room: Room, step: Floats) -> bool:
    """Write the step from ``room.descent``: Newton's, or with absolute eigenvalues, and then False is returned."""
    descent, matrix, vectors = room
    _half_hessian(n, radius, sums, matrix)
    _copy(descent, step)
    if cholesky_solve(matrix, step):
        return True
    _half_hessian(n, radius, sums, matrix)
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
    reach = _FAR * state.bound
    far, doubt = state.square > reach * reach, 2.0 * _EPS * state.before * math.sqrt(n * max(value, 0.0))
    if state.wanted > _LEVEL * state.before or (far and not value < state.plane - doubt):
        return Status.AT_BOUND
    return Status.OK


@compiled
def advance(search: Search, n: int, sums: SphereSums, room: Room) -> int:
    """Compare the trial centre with the best by the sums of a pass, and choose the next one.

    Returns:
        `ON`, or a `Status` if the search has ended.
    """
    state, best, trial, step = search
    descent, d, reach = room.descent, best.size, _FAR * state.bound
    excess, squares = sums.numbers
    value = squares - excess * excess / n
    if state.again == 0 and excess * excess > _CANCELLED * n * value:
        state.radius += excess / n
        state.again = 1
        return ON
    state.again = 0
    newton, rise = True, excess / n
    around = state.radius + rise  # R̄, the radius that belongs to this centre
    if value <= state.best:
        state.steps += 1 if state.best < math.inf else 0
        state.best, state.before, state.halvings = value, around, 0
        _copy(trial, best)
        if state.steps >= _MAX_ITERATIONS:
            return Status.AT_BOUND if state.square > reach * reach else Status.NOT_CONVERGED
        for i in range(d):  # Σ(R - R̄)e, from Σ(R - r)e: not by R̄ - r, which has lost digits
            descent[i] = sums.vectors[SUM_RHO_E, i] - rise * sums.vectors[SUM_E, i]
        newton = _downhill(n, around, sums, room, step)
    elif state.halvings == 0 and value <= state.best + 2.0 * _EPS * state.radius * math.sqrt(n * state.best):
        _copy(trial, best)  # F is the same to rounding, and this centre is a Newton step further
        status = _ended(state, n, value)
        state.best, state.before, state.steps = value, around, state.steps + 1
        return status
    else:
        state.halvings += 1
        if state.halvings > _MAX_HALVINGS:
            return Status.AT_BOUND if state.square > reach * reach else Status.NOT_CONVERGED
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
    shorter = length / state.last
    following = length * shorter * shorter  # steps fall off as the squares of those before them
    done = full and length <= _SHORT * min(before, state.last) and following <= _SURE * before
    done = done and n * length * length * length <= _THIRD * state.best * before
    state.last = length if full else 0.0
    if done or length <= _TOLERANCE * before:
        status = _ended(state, n, state.best)
        state.steps += 1
        if state.halvings == 0:  # what the step changes in R̄ and F, to second order in a step this short
            _copy(trial, best)
            bend = _trace(sums.squares) * length * length
            for i in range(d):
                state.best -= step[i] * descent[i]
                for j in range(d):
                    bend -= step[i] * sums.squares[SUM_EE_OVER_R, max(i, j), min(i, j)] * step[j]
            state.before += (0.5 * bend - dot(step, sums.vectors[SUM_E])) / n
        return status
    return Status.AT_BOUND if state.square > state.bound * state.bound else ON


_SOON = 1e-3
"""Share of the sum of squares by which a step must lower it, or `mle_early` ends."""
_CLEAR = 0.3
"""Noise below this share of the points' least variance leaves no doubt where to begin."""


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


def mle_early(samples: Samples) -> Estimates:
    """`mle` from GDKE's fit by Levenberg and Marquardt's method, stopped as Numerical Recipes advise: soon.

    It ends when a step lowers the sum of squares by less than a thousandth of it. Sets are fitted one after the other.

    Source: paper §4.3, which names the method; Press et al. 1992, §15.5.
    """
    from scipy.optimize import least_squares  # takes as long to load as the rest of the package, and serves here alone

    b, d, n = samples.shape
    first, fit = member(samples, np.zeros(b), 0.0), blank(b, d)
    fit.status[:] = first.status
    origins, starts = samples.regression.origin, np.column_stack([first.center, first.radius])
    for t in np.flatnonzero(np.isfinite(starts).all(axis=1)):
        x = samples.x[t] - origins[t][:, None]
        start = starts[t] - np.append(origins[t], 0.0)

        def residuals(sphere: Floats, x: Floats = x) -> Floats:
            return np.asarray(np.linalg.norm(x - sphere[:d, None], axis=0) - sphere[d])

        def jacobian(sphere: Floats, x: Floats = x) -> Floats:
            away = sphere[:d, None] - x
            with np.errstate(all="ignore"):
                return np.column_stack([(away / np.linalg.norm(away, axis=0)).T, np.full(n, -1.0)])

        with np.errstate(all="ignore"):
            end = least_squares(residuals, start, jacobian, method="lm", ftol=_SOON, xtol=1e-15, gtol=1e-15)
        fit.center[t], fit.radius[t], fit.iterations[t] = end.x[:d] + origins[t], abs(end.x[d]), end.njev
        fit.noise_variance[t] = 2.0 * end.cost / (n - d - 1) if n > d + 1 else math.nan
        fit.status[t] = Status.OK if end.success else Status.NOT_CONVERGED
    return fit


def _minimum_from(samples: Samples, share: float) -> Estimates:
    """The minimum of F that Newton's method finds from x̄ + share · (ĉ - x̄).

    ĉ is Taubin's answer where the noise is clearly below the points' extent, which saves a pass or two, and GDKE's,
    which does not run away, where it is not.
    """
    regression = samples.regression
    b, d, _ = regression.axes.shape
    eta = root(samples, 0.0)
    clear = eta < _CLEAR * regression.eigenvalues[:, 0]
    first = member(samples, np.where(clear, eta, 0.0), 0.0)
    fit = blank(b, d)
    fit.status[:] = first.status
    offset = share * (first.center - regression.origin)
    _fit_all(samples.rows, regression, offset, fit, zeros(d), zeros(d, d))
    return fit


@compiled
def _fit_all(x: Floats, regression: Regression, offset: Floats, fit: Estimates, zero: Sums, square: Sums) -> None:
    """Minimise F for each set of a batch (b, d, n) whose status is ok.

    ``offset`` holds the first centres relative to the regression's origins (b, d), and receives the best; ``zero`` and
    ``square`` are d and d² sums at zero.
    """
    b, d, n = x.shape
    scratch, room = (
        Scratch(np.empty((1, d, CHUNK)), zero, square),
        Room(np.empty(d), np.empty((d, d)), np.empty((d, d))),
    )
    states, sums, trial, step = np.empty(1, STATE), sphere_sums(d), np.empty(d), np.empty(d)
    origins, spread, values = regression.vectors[0], regression.numbers[2], regression.along[0]
    for t in range(b):
        if fit.status[t] != Status.OK:
            continue
        state, status = states[0], ON  # taken anew each time, for a record does not keep the memory that it is in
        search, points, origin = Search(state, offset[t], trial, step), SampleBlock(x, t, 0, n), origins[t]
        begin(search, spread[t], (n - 1.0) * values[t, 0])
        while status == ON:
            sum_about(points, origin, trial, state.radius, False, sums, scratch)
            status = advance(search, n, sums, room)
        fit.status[t], fit.iterations[t] = status, state.steps
        for i in range(d):
            fit.center[t, i] = origins[t, i] + offset[t, i]
        if state.best < math.inf:
            fit.radius[t] = state.before
            fit.noise_variance[t] = max(state.best, 0.0) / (n - d - 1) if n > d + 1 else math.nan  # F may round below 0
