"""Newton's method for the d + 2 corrected equations in (c, r, s), s = σ², step by step: from sums to the next trial.

With ρ = R - r, e = (x - c)/R and the means of a noisy radius (`study.sphere.radial`): D = E R - r, V = Var R,
x₀₁ = λ₀₁ - r and x₁₂ = λ₁₂ - r, the equations (theory 9.2) over N are

    h_c = c₁ mean ρe + ν mean ρ²e - c₀ ē,    c₁ = r - ν x₁₂,    c₀ = (1 - ν) r x₀₁ + ν r x₁₂ - α s/N,
    h_r = mean ρ - D,    h_s = mean ρ² - 2D mean ρ + D² - V,

and their derivatives are exact. Nothing in them cancels as σ → 0, where they become those of the geometric fit.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from study.estimators.status import Status
from study.sphere.jit import compiled, dot
from study.sphere.radial import RadialMeans, radial_means
from study.sphere.types import Floats

MOST_PASSES = 12
_RADII, _VARIANCES = 0.3, 0.5
"""Longest step, as a share of the radius and of the noise variance."""
_TOLERANCE = 1e-9
"""A step below this share of the radius ends the iteration: the next one would be its square."""
_SHORT, _SURE = 1e-2, 1e-10
"""A step this short, beside the one before it and the radius, ends it too, if the next one should be this short ..."""
_THIRD = 1e-8
"""... and its third-order term is this small relative to the noise variance."""
_HIDDEN = 1e-10
"""Noise variance below this share of r² is taken from the distances of each pass: fourth moments round it away, and
nothing but itself depends on it."""
_LEAST = 2.0**-104
"""Least noise variance, as a share of r², that is divided by."""
ON = -1
"""In place of a status: the iteration goes on."""


class RootState(Protocol):
    """State of an iteration between two passes, a record of `STATE`.

    Attributes:
        pair: ν, the share of the pair (R, R²) of powers beside (1, R).
        fuller: α, Fuller's constant.
        radius: trial radius r.
        variance: trial noise variance s.
        last: length of the last step, if it was Newton's in full, else 0.
        passes: number of passes over the samples.
    """

    pair: float
    fuller: float
    radius: float
    variance: float
    last: float
    passes: int


STATE = np.dtype(list(RootState.__annotations__.items()))


class RootTrial(NamedTuple):
    """The iteration of one set: a record of `STATE`, and the centre (d,) relative to an origin near the points."""

    state: RootState
    center: Floats


class Equations(NamedTuple):
    """Working memory: the equations (d + 2,), which become the step, and their derivatives (d + 2, d + 2)."""

    values: Floats
    slopes: Floats


@compiled
def _form(trial: RootTrial, n: int, sums: Floats, means: RadialMeans, equations: Equations) -> None:
    """Write the equations, in units of r², r and r√s, and their derivatives by (c, r, s), in units of r, r and s."""
    state, center = trial
    values, slopes = equations
    d, r, s, pair = center.size, state.radius, state.variance, state.pair
    pull, mean, second = sums[2 : 2 + d], sums[2 + d : 2 + 2 * d], sums[2 + 2 * d : 2 + 3 * d]
    curve, stretch = sums[2 + 3 * d : 2 + 3 * d + d * d], sums[2 + 3 * d + d * d :]
    m, rest, weight, sigma = d + 2, 1.0 - pair, 1.0 / n, math.sqrt(s)
    bend = state.fuller / n
    slope, offset = r - pair * means.excess12, rest * r * means.excess01 + pair * r * means.excess12 - bend * s
    even, inverse = rest * r * (r + means.excess01) - bend * s, 0.0
    for i in range(d):
        inverse += curve[i * d + i]
    excess = sums[0] * weight - means.lengthening
    straight = rest * r - pair * (r + means.excess12) + pair * (r + sums[0] * weight) - even * inverse * weight
    direction = 1.0 + means.shortening
    for i in range(d):
        along, radial = mean[i] * weight, pull[i] * weight
        distance = r * along + radial
        values[i] = (slope * radial + pair * second[i] * weight - offset * along) / (r * r)
        for j in range(i + 1):
            entry = (pair * stretch[i * d + j] + even * curve[i * d + j]) * weight
            slopes[i, j] = slopes[j, i] = -entry / r
        slopes[i, i] -= straight / r
        by_r = rest * (radial - (means.excess01 + r * (1.0 + means.excess01_by_r)) * along)
        by_s = -rest * r * means.excess01_by_s * along - pair * means.excess12_by_s * distance + bend * along
        slopes[i, d] = (by_r - pair * (1.0 + means.excess12_by_r) * distance) / r
        slopes[i, d + 1] = by_s * s / (r * r)
        slopes[d, i] = -along
        slopes[d + 1, i] = -2.0 * (radial - means.lengthening * along) / sigma
    values[d] = excess / r
    slopes[d, d], slopes[d, d + 1] = -direction, -means.mean_by_s * s / r
    square = (sums[1] - sums[0] * sums[0] * weight) * weight + excess * excess
    values[d + 1] = (square - means.variance) / (r * sigma)
    slopes[d + 1, d] = -(2.0 * direction * excess + means.variance_by_r) / sigma
    slopes[d + 1, d + 1] = -(2.0 * means.mean_by_s * excess + means.variance_by_s) * sigma / r
    for i in range(m):
        values[i] = -values[i]


@compiled
def _solve(matrix: Floats, right: Floats) -> bool:
    """Solve a system in place by elimination with row pivots; False, and nothing of use, if it is singular."""
    m = right.size
    for k in range(m):
        pivot = k
        for i in range(k + 1, m):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if not 0.0 < abs(matrix[pivot, k]) < math.inf:
            return False
        if pivot != k:
            right[k], right[pivot] = right[pivot], right[k]
            for j in range(k, m):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        for i in range(k + 1, m):
            factor = matrix[i, k] / matrix[k, k]
            right[i] -= factor * right[k]
            for j in range(k + 1, m):
                matrix[i, j] -= factor * matrix[k, j]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]
    return True


@compiled
def advance(trial: RootTrial, n: int, sums: Floats, equations: Equations) -> int:
    """Move the trial to the next one by the sums of a pass about it.

    Returns:
        `ON`, or a `Status` if the iteration has ended.
    """
    state, center = trial
    step, d = equations.values, center.size
    r = state.radius
    hidden = state.variance < _HIDDEN * r * r
    if hidden:
        state.variance = max((sums[1] - sums[0] * sums[0] / n) / n, _LEAST * r * r)
    s = state.variance
    state.passes += 1
    _form(trial, n, sums, radial_means(r, s, d), equations)
    if not _solve(equations.slopes, step):
        return Status.NOT_CONVERGED
    moved = step[d] * step[d]
    for i in range(d):
        moved += step[i] * step[i]
    length, change = math.sqrt(moved), step[d + 1]
    if not length + abs(change) < math.inf:
        return Status.NOT_FINITE
    share = 1.0
    if length > _RADII:
        share = _RADII / length
    if share * abs(change) > _VARIANCES and not hidden:
        share = _VARIANCES / abs(change)
    for i in range(d):
        step[i] *= share * r
        center[i] += step[i]
    state.radius, state.variance = r + share * r * step[d], max(s + share * s * change, 0.0)
    if share < 1.0:
        state.last = 0.0
        return ON if state.passes < MOST_PASSES else Status.NOT_CONVERGED
    size = max(length, abs(change) * s / (r * r))
    following = size * (size / state.last) ** 2 if state.last > 0.0 else math.inf
    done = size <= _SHORT * min(1.0, state.last) and following <= _SURE
    done = done and size * moved * r * r <= _THIRD * s
    if done or size <= _TOLERANCE:
        mean, curve, along = sums[2 + d : 2 + 2 * d], sums[2 + 3 * d : 2 + 3 * d + d * d], r * step[d]
        bend = along * along + 2.0 * along * dot(step[:d], mean) / n  # of mean ρ², of second order in the step
        for i in range(d):
            for j in range(d):
                bend += r * step[i] * curve[max(i, j) * d + min(i, j)] * step[j] / n
        state.variance += max(bend, 0.0)
        return Status.OK
    state.last = size
    return ON if state.passes < MOST_PASSES else Status.NOT_CONVERGED
