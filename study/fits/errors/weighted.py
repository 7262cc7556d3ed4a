"""Spheres whose radius is known, or whose points have a noise of their own: weighted fits.

Point i has noise of variance s vᵢ on each coordinate: vᵢ is given, the scale s is known, or not. Its weight is p = 1/v.
With R = |x - c|, e = (x - c)/R and its own means of a noisy radius (theory 9.1) ρ = E R, λ = λ₀₁ and V = Var R, the
corrected equations (theory 9.6) are

    Σ p (R - λ) e + (α s/(N r)) Σ e = 0,    Σ p (R - ρ) = 0,    Σ p (R - ρ)² / (N - k) = Σ p V / N,

the second only where the radius is unknown, the third where the scale is; k is the number of coordinates of centre and
radius that are fitted, α Fuller's constant, 0 for a known radius. With ρ = λ = r and V = s/p they are those of weighted
geometric least squares. `study.fits.errors.score` solves them.

Where a point has a covariance s Σᵢ, it weighs by its variance along the normal, p = 1/(eᵀΣe), and the means are those
of second order (theory 9.7): with P = I - eeᵀ and q = eᵀΣPΣe

    ρ - r = λ - r = s [tr PΣ / 2r - 2 p q / r],    and p s PΣe/r is taken from the term (R - λ) p e.

Noise along the radius alone has ρ = λ = r and V = s/p whatever its size: least squares are the corrected equations.

Closed forms are unbiased linear equations (theory 9.8). With y = x - x̄ about the weighted centroid, weights p of mean 1
and a noise covariance T of each point, ĉ = x̄ + a solves

    mean p(yyᵀ - T) 2a = mean p(|y|²y - tr(T) y - 2Ty),    r² = |a|² + mean p(|y|² - tr T),

with T = 0 for `gdke`, and the given one for `ugdk`; `als` finds the scale in the points. For a known radius r and
isotropic noise s/p the equation is mean p(|x - c|² - r² - (d + 2) s/p)(x - c) = 0, hence, with N points,

    (C + θI) a = ½ mean p|y|²y - ½ (d + 2) s mean y,    θ = ½ (mean p|y|² + |a|² - r² - (d + 2) s),

one equation in θ.

Functions take complete `Samples`, of each of which the same is known; those without weights weigh alike. The score of a
radius (theory 10.6) has these weights, too.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from study.arrays import Bools, Floats, Ints
from study.fits.errors.score import (
    PointSet,
    Weights,
    covary,
    first_variance,
    new_profile,
    new_weights,
    place,
    score,
    solve_profile,
)
from study.fits.estimators.corrected import corrected
from study.fits.loops.jit import Sums, compiled, dot, zeros
from study.fits.points.samples import Estimates, Samples, Status, blank

FULLER = 2.0
"""Fuller's constant where the radius is fitted: bias is removed in full, and tails are short (theory 9.3)."""
FAR = 1e7
"""Radius in units of the points' spread beyond which a sphere is a plane."""
_FLAT = 1e-14
"""Least extent of points over the largest, up to which they lie in a plane."""
_ROUNDS = 30
"""Most rounds in which points with covariances weigh anew by their normals."""
_SAME = 1e-13
"""Relative change of the sphere that ends them."""
_TURNS = 100
"""Most steps of the closed forms' searches for one number."""
_EPS = 2.0**-52


class BatchWeights(NamedTuple):
    """Weights and groups of the points of a batch; see `Weights`.

    Attributes:
        p: weights, of mean 1 in each set (b, n).
        bent: factors of s/r in the means of points with covariances (b, 2, n); else (b, 2, 0).
        scale: s (b,) in the points' unit squared, NaN where it is not known.
        group: the group of each point, of all sets alike (n,).
    """

    p: Floats
    bent: Floats
    scale: Floats
    group: Ints


class PointSets(NamedTuple):
    """Sets of more than d + 1 points, none missing, with a first sphere of each.

    Attributes:
        x: the points (b, d, n).
        center: centres (b, d).
        radius: radii (b,), of group 0.
        weights: of the points; None where all weigh the same, on one sphere, and the scale of the noise is not known.
    """

    x: Floats
    center: Floats
    radius: Floats
    weights: BatchWeights | None


class Spheres(NamedTuple):
    """Spheres of a batch: centre (b, d), radius (b,), noise variance of weight 1 (b,), True where they are answers."""

    center: Floats
    radius: Floats
    scale: Floats
    found: Bools


class AtRadius(NamedTuple):
    """Centres of a batch at radii (b, g), and what the points say of each radius; NaN where there is none.

    Attributes:
        score: T (b, g), positive where the points lie further out than the radius.
        center: centres (b, g, d).
        errors: standard errors of their coordinates, given the radius (b, g, d).
        variance: noise variance s (b, g), of a point of weight 1.
    """

    score: Floats
    center: Floats
    errors: Floats
    variance: Floats


def for_kernels(samples: Samples, spheres: Spheres, corrected: bool = True) -> tuple[PointSets, Floats]:
    """Samples as the compiled loops take them, with weights of mean 1, and the means that their weights have (b,).

    A point with a covariance weighs by its variance along the normal of its set's sphere, and keeps that weight.

    Args:
        samples: the points.
        spheres: spheres to start from.
        corrected: noise lengthens radii; if not, as if all of it were along them.
    """
    b, _, n = samples.shape
    weights, bent = samples.p, np.empty((b, 2, 0))
    if samples.given is not None and samples.given.covariances is not None:
        weights, bent = _along_normals(samples.points, samples.given.covariances, spheres.center)
    if not corrected or samples.radial:
        bent = np.zeros((b, 2, n))
    mean = weights.mean(axis=1)
    alone = np.zeros(n, dtype=np.int64)  # one group
    own = BatchWeights(weights / mean[:, None], bent * mean[:, None, None], samples.scale / mean, alone)
    return PointSets(samples.rows, spheres.center, spheres.radius, own), mean


def solve(samples: Samples, start: Spheres, corrected: bool = True, fuller: float = 0.0) -> Spheres:
    """Solve the equations for centre, scale and, where it is unknown, radius (theory 9.6).

    Args:
        samples: the points.
        start: spheres to start from.
        corrected: the corrected equations; else those of the minimum of Σ p (R - r)², to which steps go down.
        fuller: α, where the radius is unknown.
    """
    (b, d, _), corrected = samples.shape, corrected and not samples.radial
    known: Bools = np.isfinite(samples.radius)
    alpha = np.where(known, np.nan, fuller if corrected else 0.0)
    sphere = start._replace(radius=np.where(known, samples.radius, start.radius))
    for _ in range(1 if samples.given is None or samples.given.covariances is None else _ROUNDS):
        before, (sets, mean) = sphere.center, for_kernels(samples, sphere, corrected)
        sphere = Spheres(before.copy(), sphere.radius.copy(), np.full(b, np.nan), np.zeros(b, dtype=np.bool_))
        _solve_all(sets, alpha, not corrected, sphere, zeros(d), zeros(d, d))
        sphere.radius[known], sphere.scale[:] = samples.radius[known], sphere.scale * mean
        with np.errstate(all="ignore"):
            moved = np.linalg.norm(sphere.center - before, axis=1) > _SAME * sphere.radius
        if not (moved & sphere.found).any():
            break
    return sphere


def cost(samples: Samples, center: Floats, radius: Floats) -> Floats:
    """Σ p (R - r)² (b,)."""
    distance = np.linalg.norm(samples.x - center[:, :, None], axis=1)
    return np.asarray((samples.p * (distance - radius[:, None]) ** 2).sum(axis=1))


def covariance(samples: Samples, estimates: Estimates, corrected: bool = True) -> Floats:
    """Covariance of (ĉ, r̂) (b, d+1, d+1) (theory 9.6).

    That of the corrected equations is J⁻¹ Σ p² V (e, 1)(e, 1)ᵀ J⁻ᵀ; else it is the Cramér-Rao bound with the estimates
    plugged in. A known radius has no error. NaN where there is no sphere.
    """
    (b, d, _), corrected = samples.shape, corrected and not samples.radial
    scale = np.where(np.isfinite(samples.scale), samples.scale, estimates.noise_variance / mean_variance(samples))
    sphere = Spheres(estimates.center, estimates.radius, scale, np.isfinite(estimates.radius))
    (sets, mean), result = for_kernels(samples, sphere, corrected), np.full((b, d + 1, d + 1), np.nan)
    _covary_all(sets, scale / mean, np.isfinite(samples.radius), corrected, result, zeros(d), zeros(d, d))
    return result


def at_radii(samples: Samples, start: Spheres, radii: Floats) -> AtRadius:
    """Centres and scores at radii (b, g), from the first sphere at the nearest one, and from there to both ends."""
    (sets, mean), d = for_kernels(samples, start), samples.shape[1]
    if samples.even.all():  # which is faster
        sets = sets._replace(weights=None)
    result = AtRadius(*(np.full((*radii.shape, *shape), np.nan) for shape in ((), (d,), (d,), ())))
    _compute_at(sets, radii, result, zeros(d), zeros(d, d))
    return result._replace(variance=result.variance * mean[:, None])


def mean_variance(samples: Samples) -> Floats:
    """Mean of 1/p over the points of each set (b,)."""
    return np.asarray((1.0 / samples.p).mean(axis=1))


def least_squares(samples: Samples) -> Spheres:
    """The minimum of Σ p (R - r)²."""
    return solve(samples, closed(samples), corrected=False)


def corrected_equations(samples: Samples, start: Spheres | None = None) -> Spheres:
    """The root of the corrected equations (theory 9.6), from least squares or another start."""
    return solve(samples, least_squares(samples) if start is None else start, corrected=True, fuller=FULLER)


def closed(samples: Samples, subtract: bool = False, find: bool = False) -> Spheres:
    """The closed forms: unbiased linear equations, or one equation in θ for a known radius (theory 9.8).

    Args:
        samples: the points.
        subtract: subtract the known noise, as `ugdk` does.
        find: subtract the noise that the points show, as `als` does.
    """
    (_, d, n), known = samples.shape, bool(np.isfinite(samples.radius).all())
    mean, finite = samples.p.mean(axis=1), np.asarray(np.isfinite(samples.x).all(axis=(1, 2)))
    share = samples.p / mean[:, None] / n
    x = np.where(finite[:, None, None], samples.x, 0.0)
    y = x - x[:, :, :1]
    middle = np.einsum("bn,bin->bi", share, y)
    y -= middle[:, :, None]
    finite &= np.isfinite(np.square(y).sum(axis=(1, 2)))  # points may be too large for their squares
    y = np.where(finite[:, None, None], y, 0.0)
    scale = np.where(np.isfinite(samples.scale) & subtract, samples.scale / mean, 0.0)
    if known:
        center, scale = _on_known_radius(y, share, samples.radius, scale, find)
        radius = samples.radius
    else:
        if find:
            scale = _least_root(y, share)
        if subtract:  # the centroid takes one degree of freedom
            scale *= (n - 1.0) / n
        given, square = None if samples.given is None else samples.given.covariances, np.square(y).sum(axis=1)
        noise = (1.0 / (n * share))[..., None, None] * np.eye(d) if given is None else given * mean[:, None, None, None]
        trace = scale[:, None] * np.einsum("bnii->bn", noise)
        matrix = _scatter(y, share) - scale[:, None, None] * np.einsum("bn,bnij->bij", share, noise)
        third = np.einsum("bn,bin->bi", share * (square - trace), y)
        third -= 2.0 * scale[:, None] * np.einsum("bn,bnij,bjn->bi", share, noise, y)
        center = 0.5 * np.einsum("bij,bj->bi", _inverse(matrix), third)
        radius = np.sqrt(np.einsum("bi,bi->b", center, center) + (share * (square - trace)).sum(axis=1))
    center = center + x[:, :, 0] + middle
    spare = max(n - d - (not known), 1)
    if find:  # a fit of d + 1 parameters leaves so much of the variance
        shown = scale * mean if known else scale * mean * n / spare
    else:
        shown = cost(samples, np.nan_to_num(center), np.nan_to_num(radius)) / spare
    scale = np.where(np.isfinite(samples.scale), samples.scale, shown)
    return Spheres(center, radius, scale, finite & np.isfinite(center).all(axis=1) & np.isfinite(radius))


def _scatter(y: Floats, share: Floats) -> Floats:
    """Mean of p yyᵀ (b, d, d) over points y (b, d, n), whose shares are p/N (b, n)."""
    return np.asarray((share[:, None] * y) @ y.swapaxes(1, 2))


def _least_root(y: Floats, share: Floats) -> Floats:
    """Scale s at which the corrected moment matrix of (|y|², y, 1) is singular (b,): theory (5.1), with weights.

    In weights p the least root of g(s) = M₀₀(s) - |v(s)|²/(Λ - s) - (m₂ - ds)² is between 0 and λ_min, where g falls.
    """
    (_, d, n), square = y.shape, np.square(y).sum(axis=1)
    values, axes = np.linalg.eigh(_scatter(y, share))
    cross = np.einsum("bn,bin,bij->bj", share * square, y, axes)
    mean, plain = np.einsum("bi,bij->bj", y.mean(axis=2), axes), square.mean(axis=1)
    second, fourth = (share * square).sum(axis=1), (share * square**2).sum(axis=1)
    low, high, wide = np.zeros(len(y)), values[:, 0].copy(), (1.0 / share).mean(axis=1) / n
    for _ in range(_TURNS):
        s = 0.5 * (low + high)
        excess = fourth - (2 * d + 4) * s * plain + d * (d + 2) * s**2 * wide - (second - d * s) ** 2
        excess -= ((cross - (d + 2) * s[:, None] * mean) ** 2 / (values - s[:, None])).sum(axis=1)
        low, high = np.where(excess > 0.0, s, low), np.where(excess > 0.0, high, s)
    return low


def _on_known_radius(y: Floats, share: Floats, r: Floats, scale: Floats, find: bool) -> tuple[Floats, Floats]:
    """Centre (b, d) and scale of the closed form with a known radius; ``find``: the scale is found in the points."""
    (_, d, n), square = y.shape, np.square(y).sum(axis=1)
    values, axes = np.linalg.eigh(_scatter(y, share))
    third, center = np.einsum("bn,bin->bi", share * square, y), np.zeros(values.shape)
    mean, size, wide = y.mean(axis=2), (share * square).sum(axis=1), (1.0 / share).mean(axis=1) / n
    for _ in range(_TURNS if find else 1):
        right = 0.5 * np.einsum("bji,bj->bi", axes, third - (d + 2) * scale[:, None] * mean)
        theta = _theta(values, right, 0.5 * (size - r**2 - (d + 2) * scale))
        center = np.einsum("bij,bj->bi", axes, right / (values + theta[:, None]))
        if find:
            residual = np.square(y - center[:, :, None]).sum(axis=1) - r[:, None] ** 2
            surplus = (share * residual**2).sum(axis=1) * n / (n - d)  # E f² = 4 r² τ + d (d + 2) τ², τ = s/p
            before, half = scale, 2.0 * r**2
            scale = surplus / (half + np.sqrt(half**2 + d * (d + 2) * wide * surplus))
            if (np.abs(scale - before) <= 1e-13 * scale).all():
                break
    return center, scale


def _theta(values: Floats, right: Floats, level: Floats) -> Floats:
    """The root θ > -λ_min of θ = level + ½ |(Λ + θI)⁻¹ right|², by bisection of its logarithm (b,)."""
    low, high = np.full(len(level), -80.0), np.full(len(level), 80.0)  # of log (θ + λ_min), in units of the extents
    least, unit = values[:, 0], values.sum(axis=1)
    for _ in range(120):
        middle = 0.5 * (low + high)
        theta = unit * np.exp(middle)
        offset = right / (values - least[:, None] + theta[:, None])
        above = level + 0.5 * np.einsum("bi,bi->b", offset, offset) > theta - least
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.asarray(unit * np.exp(0.5 * (low + high)) - least)


def _along_normals(points: Floats, noise: Floats, center: Floats) -> tuple[Floats, Floats]:
    """Weights (b, n) and the means' factors (b, 2, n) of points (b, n, d) with covariances about centres (b, d).

    What their noise across the normal adds to the centre's equation (9.7) is written as Σp eeᵀ h: it acts as a λ that
    varies by h·e from point to point.
    """
    with np.errstate(all="ignore"):
        away = points - center[:, None]
        e = away / np.linalg.norm(away, axis=2, keepdims=True)
        turned = np.einsum("bnij,bnj->bni", noise, e)
        normal = np.einsum("bni,bni->bn", e, turned)
        p, across = 1.0 / normal, np.einsum("bni,bni->bn", turned, turned) - normal**2
        plain = (np.einsum("bnii->bn", noise) - normal) / 2.0 - 2.0 * p * across
        aside = turned - normal[..., None] * e
        spread = np.einsum("bn,bni,bnj->bij", p, e, e)
        h = np.einsum("bij,bnj,bn->bi", _inverse(spread), aside, p)
        return p, np.stack([plain, plain + np.einsum("bni,bi->bn", e, h)], axis=1)


def _inverse(matrices: Floats) -> Floats:
    """Inverses of matrices (b, m, m); NaN where they are singular."""
    result = np.full(matrices.shape, np.nan)
    with np.errstate(all="ignore"):
        fine = np.isfinite(matrices).all(axis=(1, 2)) & (np.linalg.slogdet(matrices)[0] != 0.0)
    result[fine] = np.linalg.inv(matrices[fine])
    return result


def estimates(form: Callable[[Samples], Spheres], samples: Samples) -> Estimates:
    """Fit a batch in a way that uses what is known."""
    result = blank(*samples.shape[:2])
    with np.errstate(all="ignore"):
        sphere, extent = form(samples), samples.regression.eigenvalues
        status = np.where(sphere.found, Status.OK, Status.NOT_CONVERGED)
        status[sphere.radius > FAR * np.sqrt(extent.sum(axis=1))] = Status.AT_BOUND
        flat = ~(extent[:, 0] > _FLAT * extent[:, -1])
        status[flat & (np.isnan(samples.radius) | ~(extent[:, 1] > _FLAT * extent[:, -1]))] = Status.SINGULAR
        status[~np.isfinite(samples.moments.fourth)] = Status.NOT_FINITE
        found = (status == Status.OK) | (status == Status.AT_BOUND)
        numbers = sphere.center, sphere.radius, sphere.scale * mean_variance(samples)
        for whole, values in zip(result, numbers, strict=False):
            whole[found] = values[found]
    result.status[:] = status
    return result


def free_sphere(samples: Samples) -> Estimates:
    """Fit each complete set by `corrected`, or by its equations with what is known of the noise of its points.

    The noise variance is that of a point of weight 1.
    """
    if samples.weights is None and not samples.radial:
        return corrected(samples)
    free = estimates(corrected_equations, samples.with_radius(np.full(len(samples.x), np.nan)))
    return free._replace(noise_variance=free.noise_variance / mean_variance(samples))


@compiled
def load(x: Floats, t: int, rows: Floats, origin: Floats) -> tuple[float, float]:
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
    return unit, 8.0 * _EPS * (1.0 + largest / unit) if unit > 0.0 else math.inf  # plain Python divides by no zero


@compiled
def weights_of(
    weights: BatchWeights | None, t: int, unit: float, fuller: float, downhill: bool, d: int
) -> Weights | None:
    """Weights of a set in a unit; None where there are none."""
    if weights is None:
        return None
    scale = np.full(1, weights.scale[t] / unit / unit)
    return new_weights(weights.p[t], weights.bent[t], scale, weights.group, fuller, downhill, d)


@compiled
def _solve_all(sets: PointSets, fuller: Floats, downhill: bool, result: Spheres, zero: Sums, square: Sums) -> None:
    """Fill in the sphere of each set of a batch; see `solve`."""
    x, centers, radii, every = sets
    b, d, n = x.shape
    rows, profile, start, origin = np.empty((d + 1, n)), new_profile(d), np.empty(d), np.empty(d)
    for t in range(b):
        unit, rounding = load(x, t, rows, origin)
        points = PointSet(rows, zero, square, rounding * rounding)
        weights = weights_of(every, t, unit, fuller[t], downhill, d)
        for i in range(d):
            start[i] = (centers[t, i] - origin[i]) / unit
        r = radii[t] / unit
        if not (unit > 0.0 and 0.0 < r < math.inf and dot(start, start) < math.inf):
            continue
        profile.sphere[2] = max(first_variance(points, weights, start, r), points.least)
        place(profile, r, start)
        result.found[t], _ = solve_profile(points, weights, profile, points.least)
        result.radius[t], result.scale[t] = unit * profile.sphere[0], profile.sphere[2] * unit * unit
        for i in range(d):
            result.center[t, i] = origin[i] + unit * profile.sphere[0] * profile.toward[i]


@compiled
def _covary_all(
    sets: PointSets, scale: Floats, known: Bools, corrected: bool, result: Floats, zero: Sums, square: Sums
) -> None:
    """Fill in the covariance of each sphere of a batch; see `covariance`."""
    x, centers, radii, every = sets
    b, d, n = x.shape
    rows, profile, start, origin = np.empty((d + 1, n)), new_profile(d), np.empty(d), np.empty(d)
    for t in range(b):
        unit, rounding = load(x, t, rows, origin)
        points = PointSet(rows, zero, square, rounding * rounding)
        weights = weights_of(every, t, unit, math.nan, False, d)
        for i in range(d):
            start[i] = (centers[t, i] - origin[i]) / unit
        r = radii[t] / unit
        if unit > 0.0 and 0.0 < r < math.inf and dot(start, start) < math.inf:
            place(profile, r, start)
            profile.sphere[2] = scale[t] / unit / unit
            assert weights is not None
            covary(points, weights, profile, known[t], corrected, result[t])
            for i in range(d + 1):
                for j in range(d + 1):
                    result[t, i, j] *= unit * unit


@compiled
def _compute_at(sets: PointSets, radii: Floats, result: AtRadius, zero: Sums, square: Sums) -> None:
    """Fill in the centres at radii (b, g); each begins at the one next to it, moved along its derivative."""
    x, centers, first_radius, every = sets
    b, d, n = x.shape
    g = radii.shape[1]
    rows, profile, start, origin = np.empty((d + 1, n)), new_profile(d), np.empty(d), np.empty(d)
    first, bends, variances = np.empty(d), np.empty((g, d)), np.empty(g)
    for t in range(b):
        unit, rounding = load(x, t, rows, origin)
        least, distance = rounding * rounding, 0.0
        points, weights = PointSet(rows, zero, square, least), weights_of(every, t, unit, math.nan, False, d)
        for i in range(d):
            start[i] = (centers[t, i] - origin[i]) / unit
            distance += start[i] * start[i]
        middle = 0
        for m in range(1, g):
            if abs(radii[t, m] - first_radius[t]) < abs(radii[t, middle] - first_radius[t]):
                middle = m
        for step in range(g):
            m = middle + step if step < g - middle else g - 1 - step
            near = m - 1 if m > middle else m + 1
            r = radii[t, m] / unit
            if not (unit > 0.0 and 0.0 < r < math.inf and distance < math.inf):
                continue
            if m != middle and result.score[t, near] == result.score[t, near]:
                for i in range(d):
                    away = (result.center[t, near, i] - origin[i]) / unit
                    first[i] = away - bends[near, i] * (r - radii[t, near] / unit)
                profile.sphere[2] = variances[near]
            else:
                for i in range(d):
                    first[i] = start[i]
                profile.sphere[2] = max(first_variance(points, weights, start, r), least)
            place(profile, r, first)
            converged, means = solve_profile(points, weights, profile, least)
            if converged:
                result.score[t, m] = score(points, weights, profile, means)[0]
                variances[m] = profile.sphere[2]
                result.variance[t, m] = profile.sphere[2] * unit * unit
                for i in range(d):
                    bends[m, i] = profile.bend[i]
                    result.center[t, m, i] = origin[i] + unit * r * profile.toward[i]
                    result.errors[t, m, i] = unit * profile.errors[i]
