"""Corrected geometric fits: consistent for every law of directions, whatever the noise.

Noise lengthens the distances R = |x - c| on average, more so along some directions e = (x - c)/R than the geometric
fit allows for. Here the equations for the centre have mean zero for *each* direction: Σ [(1-ν) r (R - λ₀₁) + ν R (R -
λ₁₂)] e = 0, with two equations for the mean and the variance of R (theory 9.2). They are solved by Newton's method from
`fuller`, in 3-5 passes over the data. Where they have no root near it, it is the answer, and the status says so.

Every ν is consistent, and for ν = 0 the errors are least where the noise is small beside the points' extent, for ν = 1
where it is not. `corrected` takes ν by what the points show, which changes the error in second order only.

With ρ = R - r, s = σ² and the means of a noisy radius (below): D = E R - r, V = Var R, x₀₁ = λ₀₁ - r and
x₁₂ = λ₁₂ - r, the equations (theory 9.2) over N are

    h_c = c₁ mean ρe + ν mean ρ²e - c₀ ē,    c₁ = r - ν x₁₂,    c₀ = (1 - ν) r x₀₁ + ν r x₁₂ - α s/N,
    h_r = mean ρ - D,    h_s = mean ρ² - 2D mean ρ + D² - V,

and their derivatives are exact. Nothing in them cancels as σ → 0, where they become those of the geometric fit.

Standard errors are those of the root of estimating equations, J⁻¹ Ω J⁻ᵀ/N. J is the mean derivative of the equations
and Ω the covariance of their terms. Given its direction u, a sample's terms have means E[f e | u] = A u and
E[f e eᵀ | u] = a uuᵀ + b (I - uuᵀ), with numbers A, a and b that are integrals over the noise. Hence J and Ω depend on
the law of directions through m = E u and M = E uuᵀ alone, which follow from the mean and the covariance of the points:
there is no further pass over them (theory §9.4).

The means of a noisy radius are expectations of functions of R = |y|, y ~ N(r u, σ²I), for any dimension d ≥ 2.

Noise lengthens a radius on average and shortens the mean of its direction e = y/R. All the means that corrected
estimating equations need follow from two of them, both positive,

    P = E 1/R    and    Q = E (e·u)/R²,

by Stein's identity, with s = σ²:

    E e·u = rP - sQ,    E R = r E e·u + (d-1) s P,    E R e·u = r,    E R² e·u = r E R + s E e·u.    (theory 9.1)

P and Q are sums of positive terms where the noise is large, and a series in 1/t = 2σ²/r² where it is small, which
gives differences such as E R - r without cancellation down to σ = 0.

Source: theory §9.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss

from study.arrays import Floats
from study.fits.estimators.closed_forms import fuller_constant, root, shrunk
from study.fits.estimators.geometric import (
    SUM_E,
    SUM_EE_OVER_R,
    SUM_R_EE,
    SUM_RHO2_E,
    SUM_RHO_E,
    SphereSums,
    sphere_sums,
    sum_about,
)
from study.fits.loops.jit import CHUNK, SampleBlock, Scratch, Sums, compiled, dot, squared, zeros
from study.fits.points.samples import Estimates, Samples, Status

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
_LEAST_DIVISOR = 2.0**-104
"""Least noise variance, as a share of r², that is divided by."""
_NEAR = 0.5
"""Largest distance of a root from the start, as a share of its radius: beyond, it belongs to other points."""
_ROUNDING = 1e-16
"""Noise variance to begin with where fourth moments show none, as a share of the mean square of the points."""
_FAR = 1e5
"""Distance from the origin, in units of the points' spread, beyond which they are moved to it: centres are rounded."""


_SERIES = 40.0
"""Least t = r²/2σ² for the series in 1/t: its terms fall below e⁻ᵗ before they rise again."""
_EPSILON = 2.0**-53
_MOST_TERMS = 200


class RadialMeans(NamedTuple):
    """Means of a noisy radius and their derivatives by the radius r and the noise variance s = σ².

    Attributes:
        lengthening: E R - r.
        shortening: E e·u - 1, the derivative of E R by r less one.
        variance: Var R.
        excess01: λ₀₁ - r with λ₀₁ = r / E e·u, the radius at which E (R - λ) e = 0.
        excess12: λ₁₂ - r with λ₁₂ = E R² e·u / r, the radius at which E (R - λ) R e = 0.
        mean_by_s: ∂E R/∂s.
        variance_by_r: ∂Var R/∂r.
        variance_by_s: ∂Var R/∂s.
        excess01_by_r: ∂λ₀₁/∂r - 1.
        excess01_by_s: ∂λ₀₁/∂s.
        excess12_by_r: ∂λ₁₂/∂r - 1.
        excess12_by_s: ∂λ₁₂/∂s.
    """

    lengthening: float
    shortening: float
    variance: float
    excess01: float
    excess12: float
    mean_by_s: float
    variance_by_r: float
    variance_by_s: float
    excess01_by_r: float
    excess01_by_s: float
    excess12_by_r: float
    excess12_by_s: float


@compiled
def _far_less_one(a: float, d: int, inverse: float) -> float:
    """Σ_{k≥1} (a)_k ((3-d)/2)_k / k! t⁻ᵏ, ended where its terms vanish, given 1/t."""
    term, total, least = 1.0, 0.0, math.inf
    for k in range(_MOST_TERMS):
        term *= (a + k) * (0.5 * (3 - d) + k) / (k + 1.0) * inverse
        if abs(term) <= _EPSILON * abs(total) or (abs(term) >= least and abs(term) < _EPSILON):
            break
        least = abs(term)
        total += term
    return total


@compiled
def _near(a: float, b: float, t: float) -> float:
    """e⁻ᵗ ₁F₁(b-a; b; t) for b > a: all terms are positive."""
    term = total = math.exp(-t)
    for k in range(10 * _MOST_TERMS):
        term *= (b - a + k) / (b + k) * t / (k + 1.0)
        total += term
        if term <= _EPSILON * total:
            break
    return total


@compiled
def radial_means(radius: float, variance: float, dimension: int) -> RadialMeans:
    """Means of a noisy radius.

    Args:
        radius: r > 0.
        variance: s = σ² ≥ 0 of each coordinate, in the unit of r squared.
        dimension: d ≥ 2.
    """
    r, s, d = radius, variance, dimension
    inverse = 2.0 * s / (r * r)
    if inverse * _SERIES < 1.0:
        one, three = _far_less_one(0.5, d, inverse), _far_less_one(1.5, d, inverse)
        p, q = (1.0 + one) / r, (1.0 + three) / (r * r)
        shortening = one - s * q
    else:
        t, sigma = 1.0 / inverse, math.sqrt(s)
        scale = math.exp(math.lgamma(0.5 * (d - 1)) - math.lgamma(0.5 * d)) * math.sqrt(0.5)
        p = scale * _near(0.5, 0.5 * d, t) / sigma
        q = scale * (r / d) * _near(1.5, 0.5 * d + 1.0, t) / (s * sigma)
        shortening = r * p - s * q - 1.0
    direction = 1.0 + shortening
    lengthening = r * shortening + (d - 1) * s * p
    mean = r + lengthening
    spread = d * s - lengthening * (2.0 * r + lengthening)
    mean_by_s = 0.5 * (d - 1) * p
    by_r, by_s = (d - 1) * s * q / r, -0.5 * (d - 1) * q
    return RadialMeans(
        lengthening,
        shortening,
        spread,
        -r * shortening / direction,
        lengthening + s * direction / r,
        mean_by_s,
        -2.0 * (r * shortening + lengthening * direction),
        d - 2.0 * mean * mean_by_s,
        -shortening / direction - r * by_r / (direction * direction),
        -r * by_s / (direction * direction),
        shortening + s * by_r / r - s * direction / (r * r),
        mean_by_s + direction / r + s * by_s / r,
    )


@compiled
def angle_means(concentration: Floats, dimension: int, density: Floats, cosine: Floats) -> None:
    """Means of the angle between a noisy sample and its direction, given the sample's radius R.

    The angle has a von Mises-Fisher law whose concentration is κ = Rr/σ², by the density of y ~ N(r u, σ²I).

    Args:
        concentration: κ > 0 (b, k).
        dimension: d ≥ 2.
        density: receives √κ e^-κ I_ν(κ), ν = d/2 - 1 (b, k).
        cosine: receives E[e·u | R] = I_{ν+1}(κ) / I_ν(κ) (b, k).
    """
    d, order = dimension, 0.5 * dimension - 1.0
    scale = math.exp(-math.lgamma(order + 1.0) - order * math.log(2.0))
    for t in range(concentration.shape[0]):
        for k in range(concentration.shape[1]):
            kappa = concentration[t, k]
            inverse = 0.5 / kappa
            if inverse * _SERIES < 1.0:
                density[t, k] = (1.0 + _far_less_one(0.5 * (d - 1), d, inverse)) / math.sqrt(2.0 * math.pi)
                higher = 1.0 + _far_less_one(0.5 * (d + 1), d + 2, inverse)
                cosine[t, k] = higher / (density[t, k] * math.sqrt(2.0 * math.pi))
            else:
                here = _near(0.5 * (d - 1), d - 1.0, 2.0 * kappa)
                density[t, k] = scale * kappa ** (order + 0.5) * here
                cosine[t, k] = kappa / d * _near(0.5 * (d + 1), d + 1.0, 2.0 * kappa) / here


class Member(NamedTuple):
    """The equations of one set: the number of points N, ν and α."""

    size: int
    pair: float
    fuller: float


class RootRoom(NamedTuple):
    """Working memory: the centre (d,), sums of a pass, equations (d + 2,), which become the step, and derivatives."""

    center: Floats
    sums: SphereSums
    values: Floats
    slopes: Floats


@compiled
def _form(member: Member, r: float, s: float, room: RootRoom) -> None:
    """Write -h, in units of r², r and r√s, and its derivatives by (c, r, s), in units of r, r and s (theory 9.2)."""
    n, pair, fuller = member
    center, sums, values, slopes = room
    d = center.size
    means = radial_means(r, s, d)
    rest, weight, sigma, bend = 1.0 - pair, 1.0 / n, math.sqrt(s), fuller / n
    by_power, by_mean = r - pair * means.excess12, rest * r * means.excess01 + pair * r * means.excess12 - bend * s
    even, inverse = rest * r * (r + means.excess01) - bend * s, 0.0
    for i in range(d):
        inverse += sums.squares[SUM_EE_OVER_R, i, i]
    longer = sums.numbers[0] * weight
    excess = longer - means.lengthening
    straight = rest * r - pair * (r + means.excess12) + pair * (r + longer) - even * inverse * weight
    direction = 1.0 + means.shortening
    for i in range(d):
        along, radial = sums.vectors[SUM_E, i] * weight, sums.vectors[SUM_RHO_E, i] * weight
        distance = r * along + radial
        values[i] = -(by_power * radial + pair * sums.vectors[SUM_RHO2_E, i] * weight - by_mean * along) / (r * r)
        for j in range(i + 1):
            entry = (pair * sums.squares[SUM_R_EE, i, j] + even * sums.squares[SUM_EE_OVER_R, i, j]) * weight
            slopes[i, j] = slopes[j, i] = -entry / r
        slopes[i, i] -= straight / r
        by_r = rest * (radial - (means.excess01 + r * (1.0 + means.excess01_by_r)) * along)
        by_s = -rest * r * means.excess01_by_s * along - pair * means.excess12_by_s * distance + bend * along
        slopes[i, d] = (by_r - pair * (1.0 + means.excess12_by_r) * distance) / r
        slopes[i, d + 1] = by_s * s / (r * r)
        slopes[d, i] = -along
        slopes[d + 1, i] = -2.0 * (radial - means.lengthening * along) / sigma
    values[d] = -excess / r
    slopes[d, d], slopes[d, d + 1] = -direction, -means.mean_by_s * s / r
    square = (sums.numbers[1] - sums.numbers[0] * longer) * weight + excess * excess
    values[d + 1] = -(square - means.variance) / (r * sigma)
    slopes[d + 1, d] = -(2.0 * direction * excess + means.variance_by_r) / sigma
    slopes[d + 1, d + 1] = -(2.0 * means.mean_by_s * excess + means.variance_by_s) * sigma / r


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
def _bend(r: float, step: Floats, sums: SphereSums, n: int) -> float:
    """Change of mean ρ² by a short step of centre and radius, of second order."""
    d, along = sums.vectors.shape[1], r * step[sums.vectors.shape[1]]
    bend = along * along + 2.0 * along * dot(step[:d], sums.vectors[SUM_E]) / n
    for i in range(d):
        for j in range(d):
            bend += r * step[i] * sums.squares[SUM_EE_OVER_R, max(i, j), min(i, j)] * step[j] / n
    return float(bend)


@compiled
def _iterate(
    points: SampleBlock, origin: Floats, r: float, s: float, member: Member, room: RootRoom, scratch: Scratch
) -> tuple[bool, int, float, float]:
    """Solve the equations of one set by Newton's method from the centre in ``room``, r and s.

    Returns:
        True if it converged; the number of passes, r and s. The centre is in ``room.center``.
    """
    center, sums, step, _ = room
    d, n, last = center.size, member.size, 0.0
    for passes in range(1, MOST_PASSES + 1):
        sum_about(points, origin, center, r, True, sums, scratch)
        hidden = s < _HIDDEN * r * r
        if hidden:
            s = max((sums.numbers[1] - sums.numbers[0] * sums.numbers[0] / n) / n, _LEAST_DIVISOR * r * r)
        _form(member, r, s, room)
        if not _solve(room.slopes, step):
            return False, passes, r, s
        moved, change = dot(step[: d + 1], step[: d + 1]), step[d + 1]
        length = math.sqrt(moved)
        if not length + abs(change) < math.inf:
            return False, passes, r, s
        share = min(1.0, _RADII / length) if length > 0.0 else 1.0
        if share * abs(change) > _VARIANCES and not hidden:
            share = _VARIANCES / abs(change)
        for i in range(d):
            step[i] *= share * r
            center[i] += step[i]
        before, variance = r, s
        r, s = r + share * r * step[d], max(s + share * s * change, 0.0)
        if share < 1.0:
            last = 0.0
            continue
        size = max(length, abs(change) * variance / (before * before))
        following = size * squared(size / last) if last > 0.0 else math.inf
        done = size <= _SHORT * min(1.0, last) and following <= _SURE
        done = done and size * moved * before * before <= _THIRD * variance
        if done or size <= _TOLERANCE:
            return True, passes, r, s + max(_bend(before, step, sums, n), 0.0)
        last = size
    return False, MOST_PASSES, r, s


def corrected(samples: Samples) -> Estimates:
    """The corrected fit with ν from the noise that the points show beside their least extent.

    Isotropic noise is assumed whatever ``samples.noise`` is, and its level is found with the sphere. The noise variance
    is that of the equations times n/(n - d - 1).

    Source: theory §9, (9.3).
    """
    eta = root(samples, 2.0 * samples.shape[1])
    return _fit(samples, eta, share_of_pair(eta, samples.regression.eigenvalues[:, 0]))


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
    regression = samples.regression
    d, n, origin = samples.shape[1], regression.n, regression.origin
    with np.errstate(all="ignore"):
        far = np.abs(origin).max(axis=1) > _FAR * np.sqrt(regression.square)
    if far.any():  # a kernel may add the origin to a trial centre before it subtracts both
        origin = np.where(far[:, None], origin, 0.0)
        fit = _fit(Samples(samples.x - origin[..., None]), eta, pair)
        return fit._replace(center=fit.center + origin)
    alpha = fuller_constant(samples)
    fit = shrunk(samples, eta, alpha)
    fit.condition.fill(np.nan)
    variance = np.where(n > d + 1.0, np.maximum(eta, _ROUNDING * regression.square) * (n - 1.0) / n, 0.0)
    constants = np.stack([variance, pair + np.zeros_like(eta), alpha])
    _fit_all(samples.rows, origin, constants, fit, zeros(d), zeros(d, d))
    return fit


@compiled
def _fit_all(x: Floats, origins: Floats, constants: Floats, fit: Estimates, zero: Sums, square: Sums) -> None:
    """Solve the equations for each set of a batch (b, d, n), and write the roots that are near the starts.

    Args:
        x: the points.
        origins: point near each set (b, d).
        constants: s to start from, 0 where the start is the answer, as so few points leave no choice; ν and α (3, b).
        fit: holds the starts, receives the roots.
        zero: d sums at zero.
        square: d² sums at zero.
    """
    b, d, n = x.shape
    scratch = Scratch(np.empty((1, d, CHUNK)), zero, square)
    room = RootRoom(np.empty(d), sphere_sums(d), np.empty(d + 2), np.empty((d + 2, d + 2)))
    center, first = room.center, np.empty(d)
    for t in range(b):
        if not (constants[0, t] > 0.0 and fit.radius[t] > 0.0):
            continue
        for i in range(d):
            center[i] = first[i] = fit.center[t, i] - origins[t, i]
        points, member = SampleBlock(x, t, 0, n), Member(n, constants[1, t], constants[2, t])
        r, s = fit.radius[t], constants[0, t]
        found, fit.iterations[t], r, s = _iterate(points, origins[t], r, s, member, room, scratch)
        away = 0.0
        for i in range(d):
            away += squared(center[i] - first[i])
        if found and away <= squared(_NEAR * fit.radius[t]):
            for i in range(d):
                fit.center[t, i] = origins[t, i] + center[i]
            fit.radius[t], fit.noise_variance[t] = r, s * n / (n - d - 1)
        elif fit.status[t] == Status.OK:
            fit.status[t] = Status.NOT_CONVERGED


_NODES = 64
"""Nodes of the rule over R; with twice as many the covariances agree to 1e-8."""
_REACH = 8.5
"""Range of the rule, in standard deviations of the noise."""
_LEAST_NOISE = 1e-40
"""Least noise variance, as a share of r²."""


class Terms(NamedTuple):
    """Terms of the equations at the nodes of a rule over R (b, k), for spheres of radius 1.

    Attributes:
        weights: weights of the rule, with the density of R.
        distance: R.
        cosine: E[e·u | R].
        across: E[1 - (e·u)² | R].
        pull: ψ, of the equations for the centre.
        excess: R - E R.
        square: (R - E R)² - Var R.
    """

    weights: Floats
    distance: Floats
    cosine: Floats
    across: Floats
    pull: Floats
    excess: Floats
    square: Floats

    def mean(self, values: Floats) -> Floats:
        """Expectation (b, 1) of values at the nodes."""
        return np.asarray((self.weights * values).sum(axis=1, keepdims=True))

    def outer(self, factor: Floats, second: Floats) -> Floats:
        """E[f e eᵀ] (b, d, d) for a factor f at the nodes, given M = E uuᵀ."""
        d = second.shape[1]
        across = self.mean(factor * self.across)[..., None]
        along = self.mean(factor)[..., None] - across
        return np.asarray(along * second + across / (d - 1) * (np.eye(d) - second))


def corrected_covariance(samples: Samples, estimates: Estimates) -> Floats:
    """Covariance of (ĉ, r̂) (b, d+1, d+1) of the answers of `corrected`, unit squared.

    Args:
        samples: the points, without missing ones.
        estimates: the answers.

    Returns:
        The asymptotic covariance with the estimates plugged in; NaN where there is no sphere or no noise variance.

    Source: theory §9.4.
    """
    eta = root(samples, 2.0 * samples.shape[1])
    return sandwich(samples, estimates, share_of_pair(eta, samples.regression.eigenvalues[:, 0]))


def sandwich(samples: Samples, estimates: Estimates, pair: float | Floats) -> Floats:
    """Covariance of (ĉ, r̂) (b, d+1, d+1) for a ν, or for one of each set (b,); see `corrected_covariance`."""
    b, d, _ = samples.shape
    result = np.full((b, d + 1, d + 1), np.nan)
    with np.errstate(all="ignore"):
        good = np.isfinite(estimates.noise_variance) & (estimates.radius > 0.0) & (estimates.noise_variance >= 0.0)
        good &= np.isfinite(estimates.center).all(axis=1) & np.isfinite(estimates.radius)
        if not good.any():
            return result
        r, regression = estimates.radius[good, None], samples.regression
        variance = np.maximum(estimates.noise_variance[good, None] / r**2, _LEAST_NOISE)
        pair = np.broadcast_to(pair, b)[good, None]
        means = RadialMeans._make(np.transpose([radial_means(1.0, s, d) for s in variance[:, 0]])[..., None])
        mean = (regression.origin[good] + regression.mean[good] - estimates.center[good]) / r
        scatter = regression.covariance[good] / r[..., None] ** 2 - variance[..., None] * np.eye(d)
        second = scatter + mean[:, :, None] * mean[:, None, :]
        terms = _terms(means, variance, pair, d)
        slopes, spread = _slopes(terms, means, pair, mean, second), _spread(terms, mean, second)
        solvable = (np.linalg.slogdet(slopes)[0] != 0.0) & np.isfinite(spread).all(axis=(1, 2))
        inverse = np.full(slopes.shape, np.nan)
        inverse[solvable] = np.linalg.inv(slopes[solvable])
        whole = inverse @ spread @ inverse.swapaxes(1, 2) / regression.n[good, None, None]
        result[good] = whole[:, : d + 1, : d + 1] * r[..., None] ** 2
    return result


def _terms(means: RadialMeans, variance: Floats, pair: Floats, d: int) -> Terms:
    """Terms of the equations at the nodes. Given R, the angle to u has a von Mises-Fisher law, concentrated by R/s."""
    node, weight = leggauss(_NODES)
    sigma = np.sqrt(variance)
    low, high = np.maximum(-1.0 / sigma, -_REACH), _REACH + np.sqrt(d)
    beyond = sigma * (low + 0.5 * (high - low) * (node + 1.0))
    distance = 1.0 + beyond
    narrow = distance / variance
    cosine, bessel = np.empty(narrow.shape), np.empty(narrow.shape)
    angle_means(narrow, d, bessel, cosine)
    density = distance ** (0.5 * (d - 1)) * bessel * np.exp(-0.5 * (beyond / sigma) ** 2)
    excess = beyond - means.lengthening
    pull = (1.0 - pair) * (beyond - means.excess01) + pair * distance * (beyond - means.excess12)
    weights = weight * density
    weights /= weights.sum(axis=1, keepdims=True)
    across = (d - 1) * cosine / narrow
    return Terms(weights, distance, cosine, across, pull, excess, excess**2 - means.variance)


def _slopes(terms: Terms, means: RadialMeans, pair: Floats, mean: Floats, second: Floats) -> Floats:
    """J (b, d+2, d+2) by (c, r, s)."""
    b, d = mean.shape
    rest, direction = 1.0 - pair, np.asarray(1.0 + means.shortening)
    even = rest * (1.0 + means.excess01)
    straight = rest + pair * (means.lengthening - means.excess12) - even * terms.mean(1.0 / terms.distance)
    slopes = np.zeros((b, d + 2, d + 2))
    slopes[:, :d, :d] = -terms.outer(pair * terms.distance + even / terms.distance, second)
    slopes[:, :d, :d] -= straight[..., None] * np.eye(d)
    by_r = rest * (1.0 + means.excess01_by_r) * direction + pair * (1.0 + means.excess12_by_r)
    by_s = rest * means.excess01_by_s * direction + pair * means.excess12_by_s
    slopes[:, :d, d], slopes[:, :d, d + 1] = -by_r * mean, -by_s * mean
    slopes[:, d, :d] = -direction * mean
    slopes[:, d + 1, :d] = -2.0 * (1.0 - (1.0 + means.lengthening) * direction) * mean
    slopes[:, d, d], slopes[:, d, d + 1] = np.ravel(-direction), np.ravel(-means.mean_by_s)
    slopes[:, d + 1, d], slopes[:, d + 1, d + 1] = np.ravel(-means.variance_by_r), np.ravel(-means.variance_by_s)
    return slopes


def _spread(terms: Terms, mean: Floats, second: Floats) -> Floats:
    """Ω (b, d+2, d+2): the covariance of the terms."""
    b, d = mean.shape
    spread = np.empty((b, d + 2, d + 2))
    spread[:, :d, :d] = terms.outer(terms.pull**2, second)
    others = (terms.excess, terms.square)
    for i, one in enumerate(others):
        cross = terms.mean(terms.pull * one * terms.cosine) * mean
        spread[:, :d, d + i] = spread[:, d + i, :d] = cross
        for j, other in enumerate(others):
            spread[:, d + i, d + j] = terms.mean(one * other)[:, 0]
    return spread
