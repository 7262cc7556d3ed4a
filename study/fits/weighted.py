"""Spheres whose radius is known, or whose points have a noise of their own: weighted fits in plain NumPy.

Point i has noise of variance s vᵢ on each coordinate: vᵢ is given, the scale s is known, or not. Its weight is p = 1/v.
With R = |x - c|, e = (x - c)/R and its own means of a noisy radius (theory 9.1) ρ = E R, λ = λ₀₁ and V = Var R, the
corrected equations (theory 9.6) are

    Σ p (R - λ) e + (α s/(N r)) Σ e = 0,    Σ p (R - ρ) = 0,    Σ p (R - ρ)² / (N - k) = Σ p V / N,

the second only where the radius is unknown, the third where the scale is; k is the number of coordinates of centre and
radius that are fitted, α Fuller's constant, 0 for a known radius. With ρ = λ = r and V = s/p they are those of weighted
geometric least squares. Newton's method solves for centre and radius, and the scale follows each step.

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

Intervals, and the score of a radius (theory 10.6), are those of `study.fits.intervals` with these weights.
"""

from typing import NamedTuple

import numpy as np

from study.arrays import Bools, Floats, Ints
from study.fits.corrected import RadialMeans, corrected, radial_means
from study.fits.jit import compiled
from study.fits.samples import Estimates, Samples

FULLER = 2.0
"""Fuller's constant where the radius is fitted: bias is removed in full, and tails are short (theory 9.3)."""
_STEPS = 50
_TOLERANCE = 1e-12
"""A step below this share of the radius ends the iteration."""
_SURE = 1e-9
"""A step below this share of a standard error ends it, too: rounding leaves no shorter ones on flat caps."""
_STEADY = 1e-11
"""Relative change of the scale that ends it."""
_LONGEST = 0.5
"""Longest step, in radii."""
_HALVINGS = 30
_TURNS = 100
"""Most steps of the closed forms' searches for one number."""
_LEAST = 1e-32
"""Scale that counts as none, in units of the points' spread squared."""


class Weighted(NamedTuple):
    """A batch of point sets with weights, relative to their weighted centroids and in units of their spread.

    Attributes:
        points: y (b, n, d), 0 where a point is missing.
        weights: p = 1/v (b, n), of mean 1 over the points of a set; 0 where a point is missing.
        covariances: Σ of each point (b, n, d, d), with the trace d/p; None where the noise is isotropic.
        scale: s (b,) where it is known, else NaN.
        radius: r (b,) where it is known, else NaN.
        origin: the centroids (b, d).
        unit: the spreads (b,).
        radial: the noise is along the radius alone.
    """

    points: Floats
    weights: Floats
    covariances: Floats | None
    scale: Floats
    radius: Floats
    origin: Floats
    unit: Floats
    radial: bool = False

    @classmethod
    def of(cls, points: Floats, noise: Floats, known: bool, radius: Floats) -> "Weighted":
        """Bring points (b, n, d), NaN where they are missing, to that form.

        Args:
            points: the points.
            noise: variance of each point (b, n), or its covariance (b, n, d, d).
            known: the noise is as large as that; else only ratios count.
            radius: r of each set (b,), NaN where it is not known.
        """
        d = points.shape[2]
        with np.errstate(all="ignore"):
            v = noise if noise.ndim == 2 else np.einsum("bnii->bn", noise) / d
            present = np.isfinite(points).all(axis=2) & (v > 0.0)
            least = np.where(present, v, np.inf).min(axis=1, keepdims=True)
            weights = np.where(present, least / v, 0.0)
            mean = weights.sum(axis=1, keepdims=True) / present.sum(axis=1, keepdims=True)
            size = (least / mean)[:, 0]
            x = np.where(present[..., None], points, 0.0)
            first = x[np.arange(len(x)), present.argmax(axis=1)][:, None]
            y = np.where(present[..., None], x - first, 0.0)
            share = weights / weights.sum(axis=1, keepdims=True)
            middle = np.einsum("bn,bni->bi", share, y)
            y = np.where(present[..., None], y - middle[:, None], 0.0)
            unit = np.nan_to_num(np.sqrt(np.einsum("bn,bni,bni->b", share, y, y)), nan=np.inf, posinf=np.inf)
            covariances = None
            if noise.ndim == 4:
                covariances = np.where(present[..., None, None], noise, np.eye(d)) / size[:, None, None, None]
            scale = size / unit**2 if known else np.full(len(x), np.nan)
            origin = first[:, 0] + middle
            return cls(y / unit[:, None, None], weights / mean, covariances, scale, radius / unit, origin, unit)

    @property
    def present(self) -> Bools:
        """False for missing points (b, n)."""
        return np.asarray(self.weights > 0.0)

    @property
    def size(self) -> Floats:
        """Number of points N of each set (b,)."""
        return np.asarray(self.present.sum(axis=1), dtype=float)

    @property
    def usable(self) -> Bools:
        """True for sets that can be computed with (b,): d + 1 points, and an extent that float64 holds."""
        with np.errstate(all="ignore"):
            known = (self.radius < 1e150) | np.isnan(self.radius)
            finite = np.isfinite(self.unit) & (self.unit > 0.0) & np.isfinite(self.origin).all(axis=1)
        return np.asarray(finite & known & (self.size > self.points.shape[2]))

    @property
    def variances(self) -> Floats:
        """1/p of each point (b, n), 0 where it is missing."""
        return np.divide(1.0, self.weights, where=self.present, out=np.zeros_like(self.weights))

    @property
    def mean_variance(self) -> Floats:
        """Mean of 1/p over the points of each set (b,)."""
        with np.errstate(all="ignore"):
            return np.asarray(self.variances.sum(axis=1) / self.size)

    @property
    def alike(self) -> Bools:
        """True for sets whose points all weigh the same, and the scale is not known (b,)."""
        plain = np.isnan(self.scale) & ((self.weights == 1.0) | ~self.present).all(axis=1)
        return np.asarray(plain & (self.covariances is None) & (not self.radial))

    def take(self, places: Bools | Ints) -> "Weighted":
        """Some sets of the batch."""
        parts = (part[places] if isinstance(part, np.ndarray) else part for part in self)
        return Weighted(*parts)  # type: ignore[arg-type]


class Spheres(NamedTuple):
    """Spheres of a batch, in its units: centre (b, d), radius (b,), scale s (b,), and True where they are answers."""

    center: Floats
    radius: Floats
    scale: Floats
    found: Bools

    def take(self, places: Bools | Ints) -> "Spheres":
        """Some spheres of the batch."""
        return Spheres(self.center[places], self.radius[places], self.scale[places], self.found[places])


@compiled
def _radial(radius: Floats, variance: Floats, dimension: int, result: Floats) -> None:
    """Those means of a noisy radius that are used (12, b, n), in the order of `RadialMeans`.

    Args:
        radius: r (b,).
        variance: s of each point (b, n).
        dimension: d.
        result: receives the means.
    """
    for t in range(variance.shape[0]):
        for k in range(variance.shape[1]):
            means = radial_means(radius[t], variance[t, k], dimension)
            result[0, t, k], result[1, t, k], result[2, t, k] = means.lengthening, means.shortening, means.variance
            result[3, t, k], result[5, t, k], result[7, t, k] = means.excess01, means.mean_by_s, means.variance_by_s
            result[8, t, k], result[9, t, k] = means.excess01_by_r, means.excess01_by_s


class _At(NamedTuple):
    """Points about trial spheres.

    Attributes:
        distance: R (b, n).
        direction: e (b, n, d), 0 where a point is missing.
        weights: p (b, n).
        means: means of a noisy radius at each point (b, n), or (b, 1) where all are alike.
        aside: mean of (R - λ) e across e (b, n, d); None where it is nil.
    """

    distance: Floats
    direction: Floats
    weights: Floats
    means: RadialMeans
    aside: Floats | None = None


def _about(sets: Weighted, center: Floats, radius: Floats, scale: Floats, corrected: bool) -> _At:
    """Distances and directions of the points from trial spheres, and the means of each.

    Where each point has a covariance, the means are those of second order in the noise (theory 9.7); where the
    equations are not the corrected ones, those of a radius that noise does not lengthen.
    """
    noise, present, p, s, r = sets.covariances, sets.present, sets.weights, scale[:, None], radius[:, None]
    away = sets.points - center[:, None]
    distance = np.sqrt(np.einsum("bni,bni->bn", away, away) + 1e-300)
    e = np.where(present[..., None], away / distance[..., None], 0.0)
    if noise is not None:
        turned = np.einsum("bnij,bnj->bni", noise, e)
        normal = np.where(present, np.einsum("bni,bni->bn", e, turned), 1.0)
        p, variance = np.where(present, 1.0 / normal, 0.0), np.where(present, s * normal, 0.0)
    else:
        variance = s * sets.variances if (p != np.where(present, 1.0, 0.0)).any() else s
    numbers = np.zeros((len(RadialMeans._fields), *variance.shape))
    numbers[2], numbers[7] = variance, 1.0  # in the order of their names
    if corrected and noise is None:
        _radial(radius, variance, center.shape[1], numbers)
    if noise is None or not corrected:
        return _At(distance, e, p, RadialMeans._make(numbers))
    square = np.einsum("bni,bni->bn", turned, turned) - normal**2
    by_s = ((np.einsum("bnii->bn", noise) - normal) / 2.0 - 2.0 * p * square) / r
    numbers[0] = numbers[3] = np.where(present, s * by_s, 0.0)
    numbers[5] = numbers[9] = by_s
    aside = (s / r)[..., None] * (turned - normal[..., None] * e)
    return _At(distance, e, p, RadialMeans._make(numbers), np.where(present[..., None], aside, 0.0))


def scale_of(sets: Weighted, at: _At, radius: Floats, scale: Floats, fitted: Ints) -> Floats:
    """The scale s by which Σ p (R - ρ)² has its mean; the known one where it is known (theory 9.6)."""
    square = (at.weights * (at.distance - radius[:, None] - at.means.lengthening) ** 2).sum(axis=1)
    expected = (at.weights * at.means.variance).sum(axis=1)
    spare = np.maximum(sets.size - fitted, 1.0)
    ratio = np.where(expected > 0.0, square / spare / np.where(expected > 0.0, expected / sets.size, 1.0), 1.0)
    return np.where(np.isfinite(sets.scale), sets.scale, np.maximum(scale * ratio, _LEAST))


def _system(sets: Weighted, at: _At, radius: Floats, bend: Floats) -> tuple[Floats, Floats]:
    """The equations for centre and radius (b, d + 1), and less their derivatives (b, d + 1, d + 1), theory 9.6.

    ``bend`` is α s/(N r).
    """
    p, e = at.weights, at.direction
    b, _, d = e.shape
    curvature = radius[:, None] + at.means.excess01
    with np.errstate(all="ignore"):
        over = np.where(sets.present, 1.0 / at.distance, 0.0)
        fuller = bend[:, None] * over
    values, slopes = np.empty((b, d + 1)), np.empty((b, d + 1, d + 1))
    pull = p * (at.distance - curvature)
    values[:, :d] = np.einsum("bn,bni->bi", pull + bend[:, None], e)
    if at.aside is not None:
        values[:, :d] -= np.einsum("bn,bni->bi", p, at.aside)
    values[:, d] = (p * (at.distance - radius[:, None] - at.means.lengthening)).sum(axis=1)
    along = p * curvature * over - fuller
    slopes[:, :d, :d] = np.einsum("bn,bni,bnj->bij", along, e, e, optimize=True)
    slopes[:, :d, :d] += (p - along).sum(axis=1)[:, None, None] * np.eye(d)
    slopes[:, :d, d] = np.einsum("bn,bni->bi", p * (1.0 + at.means.excess01_by_r), e)
    slopes[:, d, :d] = np.einsum("bn,bni->bi", p, e)
    slopes[:, d, d] = (p * (1.0 + at.means.shortening)).sum(axis=1)
    return values, slopes


def _inverse(matrices: Floats) -> Floats:
    """Inverses of matrices (b, m, m); NaN where they are singular."""
    result = np.full(matrices.shape, np.nan)
    with np.errstate(all="ignore"):
        fine = np.isfinite(matrices).all(axis=(1, 2)) & (np.linalg.slogdet(matrices)[0] != 0.0)
    result[fine] = np.linalg.inv(matrices[fine])
    return result


def solve(sets: Weighted, start: Spheres, corrected: bool = True, fuller: Floats | float = 0.0) -> Spheres:
    """Solve the equations for centre, scale and, where it is unknown, radius, by Newton's method.

    Args:
        sets: the points.
        start: spheres to start from; the scale need not be known.
        corrected: the corrected equations; else those of the minimum of Σ p (R - r)², to which steps go downhill.
        fuller: α for each set, where the radius is unknown.
    """
    free: Bools = np.isnan(sets.radius)
    d, n = start.center.shape[1], sets.size
    if sets.radial:
        corrected, fuller = False, 0.0
    center, radius = start.center.copy(), np.where(free, start.radius, sets.radius)
    scale = np.where(np.isfinite(sets.scale), sets.scale, np.where(np.isfinite(start.scale), start.scale, 0.0))
    found: Bools = np.zeros(len(center), dtype=np.bool_)
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            at = _about(sets, center, radius, scale, corrected)
            before, scale = scale, scale_of(sets, at, radius, np.maximum(scale, _LEAST), d + free)
            values, slopes = _system(sets, at, radius, np.where(free, fuller * scale / (n * radius), 0.0))
            slopes[~free, :d, d] = slopes[~free, d, :d] = 0.0
            slopes[~free, d, d], values[~free, d] = 1.0, 0.0
            step = _step(values, slopes, corrected)
            length = np.linalg.norm(step, axis=1)
            share = np.minimum(1.0, _LONGEST * radius / np.maximum(length, 1e-300))
            if not corrected and sets.covariances is None:
                share = _downhill(sets, center, radius, step, share)
            moving = ~found & np.isfinite(length)
            center[moving] += (share[:, None] * step)[moving, :d]
            radius[moving] += (share * step[:, d])[moving]
            error = np.abs(np.einsum("bi,bi->b", step, values))
            short = (length <= _TOLERANCE * radius) | (error <= _SURE**2 * scale)
            found |= short & (np.abs(scale - before) <= _STEADY * scale + _LEAST)
            if (found | ~np.isfinite(length)).all():
                break
    return Spheres(center, radius, scale, found & (radius > 0.0))


def _step(values: Floats, slopes: Floats, corrected: bool) -> Floats:
    """Newton's step (b, m); downhill, by absolute eigenvalues, where the equations are those of a minimum."""
    fine: Bools = np.asarray(np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(values).all(axis=1))
    safe = np.where(fine[:, None, None], slopes, np.eye(slopes.shape[1]))
    if corrected:
        inverse = _inverse(safe)
    else:
        eigenvalues, vectors = np.linalg.eigh(safe)
        least = 1e-15 * np.abs(eigenvalues).max(axis=1, keepdims=True)
        inverse = np.einsum("bik,bk,bjk->bij", vectors, 1.0 / np.maximum(np.abs(eigenvalues), least), vectors)
    return np.where(fine[:, None], np.einsum("bij,bj->bi", inverse, values), np.nan)


def cost(sets: Weighted, center: Floats, radius: Floats) -> Floats:
    """Σ p (R - r)² (b,)."""
    away = sets.points - center[:, None]
    distance = np.sqrt(np.einsum("bni,bni->bn", away, away))
    return np.asarray((sets.weights * (distance - radius[:, None]) ** 2).sum(axis=1))


def _downhill(sets: Weighted, center: Floats, radius: Floats, step: Floats, share: Floats) -> Floats:
    """Halve shares of steps until the cost does not rise, but for rounding."""
    d, best = center.shape[1], cost(sets, center, radius)
    limit = best * (1.0 + 1e-9) + 1e-30
    for _ in range(_HALVINGS):
        worse = cost(sets, center + share[:, None] * step[:, :d], radius + share * step[:, d]) > limit
        if not worse.any():
            break
        share = np.where(worse, 0.5 * share, share)
    return share


def covariance(sets: Weighted, spheres: Spheres, corrected: bool = True) -> Floats:
    """Covariance of (ĉ, r̂) (b, d+1, d+1) in the units of the sets (theory 9.6).

    That of the corrected equations is J⁻¹ Σ p² V (e, 1)(e, 1)ᵀ J⁻ᵀ; else it is the Cramér-Rao bound with the estimates
    plugged in. A known radius has no error. NaN where there is no sphere.
    """
    d, free, corrected = spheres.center.shape[1], np.isnan(sets.radius), corrected and not sets.radial
    result = np.zeros((len(free), d + 1, d + 1))
    with np.errstate(all="ignore"):
        at = _about(sets, spheres.center, spheres.radius, spheres.scale, corrected)
        _, slopes = _system(sets, at, spheres.radius, np.zeros(len(free)))
        normal = np.concatenate([at.direction, np.where(sets.present, 1.0, 0.0)[..., None]], axis=2)
        spread = at.weights**2 * at.means.variance
        middle = np.einsum("bn,bni,bnj->bij", spread, normal, normal, optimize=True)
        information = middle / np.maximum(spheres.scale, 1e-300)[:, None, None]  # Σ p (e, 1)(e, 1)ᵀ, as pV = s
    for some, m in ((np.flatnonzero(free), d + 1), (np.flatnonzero(~free), d)):
        inverse = _inverse((slopes if corrected else information)[some, :m, :m])
        result[some, :m, :m] = inverse @ middle[some, :m, :m] @ inverse.swapaxes(1, 2)
    return result


def least_squares(sets: Weighted) -> Spheres:
    """The minimum of Σ p (R - r)²."""
    return solve(sets, closed(sets), corrected=False)


def corrected_equations(sets: Weighted, start: Spheres | None = None) -> Spheres:
    """The root of the corrected equations (theory 9.6), from least squares or another start."""
    return solve(sets, least_squares(sets) if start is None else start, corrected=True, fuller=FULLER)


def closed(sets: Weighted, subtract: bool = False, find: bool = False) -> Spheres:
    """The closed forms: unbiased linear equations, or one equation in θ for a known radius (theory 9.8).

    Args:
        sets: the points.
        subtract: subtract the known noise, as `ugdk` does.
        find: subtract the noise that the points show, as `als` does.
    """
    b, _, d = sets.points.shape
    y, p, n = sets.points, sets.weights, sets.size
    scale = np.where(np.isfinite(sets.scale) & subtract, sets.scale, 0.0)
    known = np.isfinite(sets.radius)
    square = np.einsum("bni,bni->bn", y, y)
    if find:
        scale[~known] = _least_root(sets.take(np.flatnonzero(~known)))
    if subtract:  # the centroid takes one degree of freedom
        scale = np.where(known, scale, scale * (n - 1.0) / n)
    noise = sets.variances[..., None, None] * np.eye(d) if sets.covariances is None else sets.covariances
    trace, share = np.einsum("bnii->bn", noise), p / n[:, None]
    matrix = np.einsum("bn,bni,bnj->bij", share, y, y) - scale[:, None, None] * np.einsum("bn,bnij->bij", share, noise)
    third = np.einsum("bn,bni->bi", share * (square - scale[:, None] * trace), y)
    third -= 2.0 * scale[:, None] * np.einsum("bn,bnij,bnj->bi", share, noise, y)
    center = np.full((b, d), np.nan)
    regular = ~known & np.isfinite(matrix).all(axis=(1, 2)) & (np.abs(np.linalg.slogdet(matrix)[1]) < np.inf)
    center[regular] = 0.5 * np.linalg.solve(matrix[regular], third[regular][..., None])[..., 0]
    level = (share * (square - scale[:, None] * trace)).sum(axis=1)
    radius = np.sqrt(np.einsum("bi,bi->b", center, center) + level)
    if known.any():
        part = sets.take(np.flatnonzero(known))
        center[known], scale[known] = _on_known_radius(part, scale[known], find)
        radius[known] = sets.radius[known]
    spare = np.maximum(n - d - ~known, 1.0)
    deviation = cost(sets, np.nan_to_num(center), np.nan_to_num(radius)) / spare
    if find:  # a fit of d + 1 parameters leaves so much of the variance
        deviation = np.where(known, scale, scale * n / spare)
    scale = np.where(np.isfinite(sets.scale), sets.scale, deviation)
    return Spheres(center, radius, scale, np.isfinite(center).all(axis=1) & np.isfinite(radius))


def _least_root(sets: Weighted) -> Floats:
    """Scale s at which the corrected moment matrix of (|y|², y, 1) is singular (b,): theory (5.1), with weights.

    In weights p the least root of g(s) = M₀₀(s) - |v(s)|²/(Λ - s) - (m₂ - ds)² is between 0 and λ_min, where g falls.
    """
    y, n, d = sets.points, sets.size, sets.points.shape[2]
    share, square = sets.weights / n[:, None], np.einsum("bni,bni->bn", sets.points, sets.points)
    values, axes = np.linalg.eigh(np.einsum("bn,bni,bnj->bij", share, y, y))
    cross = np.einsum("bn,bni,bij->bj", share * square, y, axes)
    mean, plain = np.einsum("bni,bij->bj", y, axes) / n[:, None], square.sum(axis=1) / n
    second, fourth = (share * square).sum(axis=1), (share * square**2).sum(axis=1)
    low, high = np.zeros(len(n)), values[:, 0].copy()
    for _ in range(_TURNS):
        s = 0.5 * (low + high)
        excess = fourth - (2 * d + 4) * s * plain + d * (d + 2) * s**2 * sets.mean_variance - (second - d * s) ** 2
        excess -= ((cross - (d + 2) * s[:, None] * mean) ** 2 / (values - s[:, None])).sum(axis=1)
        low, high = np.where(excess > 0.0, s, low), np.where(excess > 0.0, high, s)
    return low


def _on_known_radius(sets: Weighted, scale: Floats, find: bool) -> tuple[Floats, Floats]:
    """Centre (b, d) and scale of the closed form with a known radius; ``find``: the scale is found in the points."""
    y, p, n, r = sets.points, sets.weights, sets.size, sets.radius
    d, share = y.shape[2], sets.weights / sets.size[:, None]
    square = np.einsum("bni,bni->bn", y, y)
    values, axes = np.linalg.eigh(np.einsum("bn,bni,bnj->bij", share, y, y))
    third, mean = np.einsum("bn,bni->bi", share * square, y), y.sum(axis=1) / n[:, None]
    size, wide = (share * square).sum(axis=1), sets.mean_variance
    center = np.empty((len(n), d))
    for _ in range(_TURNS if find else 1):
        right = 0.5 * np.einsum("bji,bj->bi", axes, third - (d + 2) * scale[:, None] * mean)
        level = 0.5 * (size - r**2 - (d + 2) * scale)
        theta = _theta(values, right, level)
        center = np.einsum("bij,bj->bi", axes, right / (values + theta[:, None]))
        if find:
            away = y - center[:, None]
            residual = np.einsum("bni,bni->bn", away, away) - r[:, None] ** 2
            surplus = (p * residual**2).sum(axis=1) / (n - d)  # E f² = 4 r² τ + d (d + 2) τ², τ = s/p
            before, half = scale, 2.0 * r**2
            scale = surplus / (half + np.sqrt(half**2 + d * (d + 2) * wide * surplus))
            if (np.abs(scale - before) <= 1e-13 * scale).all():
                break
    return center, scale


def _theta(values: Floats, right: Floats, level: Floats) -> Floats:
    """The root θ > -λ_min of θ = level + ½ |(Λ + θI)⁻¹ right|², by bisection of its logarithm (b,)."""
    low, high = np.full(len(level), -80.0), np.full(len(level), 80.0)  # of log (θ + λ_min)
    least = values[:, 0]
    for _ in range(120):
        middle = 0.5 * (low + high)
        theta = np.exp(middle)
        offset = right / (values - least[:, None] + theta[:, None])
        above = level + 0.5 * np.einsum("bi,bi->b", offset, offset) > theta - least
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.asarray(np.exp(0.5 * (low + high)) - least)


def along_normals(sets: Weighted, spheres: Spheres) -> tuple[Floats, Floats, Floats]:
    """Weights of mean 1 (b, n), the means' factors (b, n, 2) and the scale, of points with covariances at spheres.

    What their noise across the normal adds to the centre's equation (9.7) is written as Σp eeᵀ h: it acts as a λ that
    varies by h·e from point to point.
    """
    at = _about(sets, spheres.center, spheres.radius, np.ones(len(sets.unit)), True)
    assert at.aside is not None
    mean = at.weights.sum(axis=1, keepdims=True) / sets.size[:, None]
    spread = np.einsum("bn,bni,bnj->bij", at.weights, at.direction, at.direction)
    h = np.einsum("bij,bnj,bn->bi", _inverse(spread), at.aside, at.weights)
    plain, radius = at.means.lengthening, spheres.radius[:, None] * mean
    tilted = plain + np.einsum("bni,bi->bn", at.direction, h)
    return at.weights / mean, np.stack([plain, tilted], axis=2) * radius[..., None], sets.scale / mean[:, 0]


def free_sphere(samples: Samples) -> Estimates:
    """Fit each complete set by `corrected`, or by its equations with the points' weights."""
    start = corrected(samples)
    if samples.weights is None:
        return start
    sets = Weighted.of(samples.points, 1.0 / samples.weights, False, np.full(len(samples.x), np.nan))
    with np.errstate(all="ignore"):
        center = (start.center - sets.origin) / sets.unit[:, None]
        sphere = Spheres(
            center, start.radius / sets.unit, start.noise_variance / sets.unit**2, np.isfinite(start.radius)
        )
        sphere = corrected_equations(sets, sphere)
        scale = sphere.scale * sets.unit**2 * samples.weights.mean(axis=1)
    fields = [sets.origin + sphere.center * sets.unit[:, None], sphere.radius * sets.unit, scale]
    for whole, part in zip(start, fields, strict=False):
        whole[:] = np.where(sphere.found.reshape(-1, *[1] * (part.ndim - 1)), part, np.nan)
    return start
