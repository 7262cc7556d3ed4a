"""Corrected geometric fits: consistent for every law of directions, whatever the noise.

Noise lengthens the distances R = |x - c| on average, more so along some directions e = (x - c)/R than the geometric
fit allows for. Here the equations for the centre have mean zero for *each* direction: Σ [(1-ν) r (R - λ₀₁) + ν R (R -
λ₁₂)] e = 0, with two equations for the mean and the variance of R (theory 9.2). They are solved by Newton's method from
`fuller`, in 3-5 passes over the data. Where they have no root near it, it is the answer, and the status says so.
`corrected_step.py` has the steps, this file the sums that they need.

Every ν is consistent, and for ν = 0 the errors are least where the noise is small beside the points' extent, for ν = 1
where it is not. `corrected` takes ν by what the points show, which changes the error in second order only.

Source: theory §9.
"""

import math
from typing import NamedTuple

import numpy as np

from study.estimators.algebraic import fuller_constant, root, shrunk
from study.estimators.estimates import Estimates
from study.estimators.geometric.corrected_step import ON, STATE, Equations, RootTrial, advance
from study.estimators.samples import Samples
from study.estimators.status import Status
from study.sphere.jit import CHUNK, Sums, compiled, fill, fresh, put, zeros
from study.sphere.layouts import BLOCK, PointSets, SampleBlock, Scratch, abreast, at, extent, window
from study.sphere.types import Floats

_NEAR = 0.5
"""Largest distance of a root from the start, as a share of its radius: beyond, it belongs to other points."""

_ROUNDING = 1e-16
"""Noise variance to begin with where fourth moments show none, as a share of the mean square of the points."""


class RootStart(NamedTuple):
    """Starting values of a batch.

    Attributes:
        origin: point near each set (b, d).
        offset: centre relative to the origin (b, d).
        radius: r (b,).
        variance: s = σ² (b,), 0 where the start is the answer, because as few points leave no choice.
        pair: ν (b,).
        fuller: α (b,).
    """

    origin: Floats
    offset: Floats
    radius: Floats
    variance: Floats
    pair: Floats
    fuller: Floats


def corrected(samples: Samples) -> Estimates:
    """The corrected fit with ν from the noise that the points show beside their least extent.

    Isotropic noise is assumed whatever ``samples.noise`` is, and its level is found with the sphere. The noise variance
    is that of the equations times n/(n - d - 1).

    Source: theory §9, (9.3).
    """
    eta = root(samples, 2.0 * samples.shape[1])
    return _fit(samples, eta, share_of_pair(eta, samples.spectrum.values[:, 0]))


def corrected_01(samples: Samples) -> Estimates:
    """The corrected fit with ν = 0: the geometric fit without its bias.

    Source: theory §9.2.
    """
    return _fit(samples, root(samples, 2.0 * samples.shape[1]), 0.0)


def corrected_02(samples: Samples) -> Estimates:
    """The corrected fit with ν = ½.

    Source: theory §9.2.
    """
    return _fit(samples, root(samples, 2.0 * samples.shape[1]), 0.5)


def corrected_12(samples: Samples) -> Estimates:
    """The corrected fit with ν = 1: points weigh by their distance, which suits much noise on small caps.

    Source: theory §9.2.
    """
    return _fit(samples, root(samples, 2.0 * samples.shape[1]), 1.0)


def share_of_pair(eta: Floats, least: Floats) -> Floats:
    """ν of theory (9.3) (b,), from ALS's root η and the least eigenvalue of C in the same weights (b,)."""
    with np.errstate(all="ignore"):
        share = (4.0 / 3.0) * eta / (eta + 3.0 * (least - eta))
    return np.where(eta > 0.0, share, 0.0)


def _fit(samples: Samples, eta: Floats, pair: float | Floats) -> Estimates:
    """The root of the equations near the fit of `fuller`, given the root η (b,) of `als`, and ν."""
    alpha, regression = fuller_constant(samples), samples.regression
    fit = shrunk(samples, eta, alpha)
    fit.condition.fill(np.nan)
    d, n = fit.center.shape[1], regression.n
    variance = np.where(n > d + 1.0, np.maximum(eta, _ROUNDING * regression.square) * (n - 1.0) / n, 0.0)
    start = RootStart(
        origin=regression.origin,
        offset=fit.center - regression.origin,
        radius=fit.radius.copy(),
        variance=variance,
        pair=pair + np.zeros_like(eta),
        fuller=alpha,
    )
    _fit_all(samples.rows, abreast(samples.source), start, fit, zeros(d), zeros(d, d))
    return fit


@compiled
def _pass(block: SampleBlock, origin: Floats, center: Floats, radius: float, sums: Floats, scratch: Scratch) -> None:
    """Add a block of samples to the sums for a trial centre, which is relative to ``origin``.

    They are, with ρ = R - r, Σρ, Σρ², Σρe, Σe, Σρ²e and, in their lower triangles, Σeeᵀ/R and ΣReeᵀ.
    """
    x, t, start, m = block
    rows, zero, square = scratch
    d = len(zero)
    near, away, y, e = fresh(zero), fresh(zero), fresh(zero), fresh(zero)
    pull, mean, second, curve, stretch = fresh(zero), fresh(zero), fresh(zero), fresh(square), fresh(square)
    for i in range(d):
        near, away = put(near, i, origin[i]), put(away, i, center[i])
    excess = squares = 0.0
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
            squares += residual_square
            for i in range(d):
                e = put(e, i, y[i] * over)
                mean = put(mean, i, mean[i] + e[i])
                pull = put(pull, i, pull[i] + e[i] * residual)
                second = put(second, i, second[i] + e[i] * residual_square)
                weighted = e[i] * over
                for j in range(i + 1):
                    curve = put(curve, i * d + j, curve[i * d + j] + weighted * e[j])
                    stretch = put(stretch, i * d + j, stretch[i * d + j] + e[i] * y[j])
    sums[0] += excess
    sums[1] += squares
    for i in range(d):
        sums[2 + i] += pull[i]
        sums[2 + d + i] += mean[i]
        sums[2 + 2 * d + i] += second[i]
    for i in range(d * d):
        sums[2 + 3 * d + i] += curve[i]
        sums[2 + 3 * d + d * d + i] += stretch[i]


@compiled
def _conclude(start: RootStart, t: int, trial: RootTrial, status: int, n: int, fit: Estimates) -> None:
    """Write the root that the iteration of set t ended at, if it is near the start, and else leave the start."""
    state, center = trial
    d, away, reach = center.size, 0.0, _NEAR * start.radius[t]
    fit.iterations[t] = state.passes
    for i in range(d):
        away += (center[i] - start.offset[t, i]) ** 2
    if status == Status.OK and away <= reach * reach:
        for i in range(d):
            fit.center[t, i] = start.origin[t, i] + center[i]
        fit.radius[t] = state.radius
        fit.noise_variance[t] = state.variance * n / (n - d - 1)
    elif fit.status[t] == Status.OK:
        fit.status[t] = Status.NOT_CONVERGED


@compiled
def _fit_all(x: PointSets, group: int, start: RootStart, fit: Estimates, zero: Sums, square: Sums) -> None:
    """Solve the equations for each set of a batch; ``group`` sets share their draws, see `abreast`.

    ``fit`` holds the starts. ``zero`` and ``square`` are d and d² sums at zero.
    """
    b, d, n = extent(x)
    scratch = Scratch(np.empty((1, d, CHUNK)), zero, square)
    equations = Equations(np.empty(d + 2), np.empty((d + 2, d + 2)))
    state, going, sums = np.empty(group, STATE), np.empty(group, np.bool_), np.empty((group, 2 + 3 * d + 2 * d * d))
    center = np.empty((group, d))
    for head in range(0, b, group):
        left = 0
        for g in range(group):
            t = head + g
            going[g] = start.variance[t] > 0.0 and start.radius[t] > 0.0
            if going[g]:
                left += 1
                state[g].pair, state[g].radius, state[g].variance = start.pair[t], start.radius[t], start.variance[t]
                state[g].fuller, state[g].last, state[g].passes = start.fuller[t], 0.0, 0
                for i in range(d):
                    center[g, i] = start.offset[t, i]
        while left > 0:
            for g in range(group):
                fill(sums[g], 0.0)
            for begun in range(0, n, BLOCK):
                for g in range(group):
                    if going[g]:
                        block = SampleBlock(x, head + g, begun, min(BLOCK, n - begun))
                        _pass(block, start.origin[head + g], center[g], state[g].radius, sums[g], scratch)
            for g in range(group):
                if going[g]:
                    trial = RootTrial(state[g], center[g])
                    status = advance(trial, n, sums[g], equations)
                    if status != ON:
                        _conclude(start, head + g, trial, status, n, fit)
                        going[g] = False
                        left -= 1
