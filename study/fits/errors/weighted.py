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

Intervals, and the score of a radius (theory 10.6), are those of `study.fits.errors.intervals` with these weights.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from study.arrays import Bools, Floats, Ints
from study.fits.errors.intervals import BatchWeights, PointSets, Spheres, covariances_of, spheres_of
from study.fits.estimators.corrected import corrected
from study.fits.points.samples import Estimates, Samples

FULLER = 2.0
"""Fuller's constant where the radius is fitted: bias is removed in full, and tails are short (theory 9.3)."""
_ROUNDS = 30
"""Most rounds in which points with covariances weigh anew by their normals."""
_SAME = 1e-13
"""Relative change of the sphere that ends them."""
_TURNS = 100
"""Most steps of the closed forms' searches for one number."""


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


def for_kernels(
    sets: Weighted, spheres: Spheres, corrected: bool = True, plain: bool = False
) -> Iterator[tuple[Ints, PointSets, Floats]]:
    """Sets of equally many points as the compiled loops take them, with their places (k,) and the mean of 1/v (k,).

    A point with a covariance weighs by its variance along the normal of its set's sphere, and keeps that weight.

    Args:
        sets: the points.
        spheres: spheres to start from.
        corrected: noise lengthens radii; if not, as if all of it were along them.
        plain: sets of equal weights and unknown scale have none, which is faster.
    """
    kinds = np.column_stack([sets.size.astype(int), sets.alike & plain])
    for count, same in np.unique(kinds[sets.size > sets.points.shape[2]], axis=0).tolist():
        places = np.flatnonzero((kinds == [count, same]).all(axis=1))
        part, sphere = sets.take(places), spheres.take(places)
        if sets.covariances is not None:
            p, bent, mean = along_normals(part, sphere)
        else:
            p, bent, mean = part.weights, np.empty((len(places), 2, 0)), np.ones(len(places))
        if part.radial or not corrected:
            bent = np.zeros((*p.shape, 2))

        def dense(array: Floats, part: Weighted = part, shape: tuple[int, int] = (len(places), count)) -> Floats:
            return np.ascontiguousarray(np.moveaxis(array[part.present].reshape(*shape, -1), 2, 1))

        own = (
            None
            if same
            else BatchWeights(dense(p)[:, 0], bent if bent.size == 0 else dense(bent), part.scale / mean, alone(count))
        )
        yield places, PointSets(dense(part.points), sphere.center, sphere.radius, own), mean


def alone(count: int) -> Ints:
    """One group of so many points."""
    return np.zeros(count, dtype=np.int64)


def solve(sets: Weighted, start: Spheres, corrected: bool = True, fuller: float = 0.0) -> Spheres:
    """Solve the equations for centre, scale and, where it is unknown, radius.

    Args:
        sets: the points.
        start: spheres to start from.
        corrected: the corrected equations; else those of the minimum of Σ p (R - r)².
        fuller: α, where the radius is unknown.
    """
    corrected = corrected and not sets.radial
    known = np.isfinite(sets.radius)
    alpha = np.where(known, np.nan, fuller if corrected else 0.0)
    result = Spheres(start.center.copy(), start.radius.copy(), start.scale.copy(), start.found.copy())
    result.radius[known] = sets.radius[known]
    for _ in range(1 if sets.covariances is None else _ROUNDS):
        before = result.center.copy()
        for places, part, mean in for_kernels(sets, result, corrected):
            for whole, values in zip(result, spheres_of(part, alpha[places], not corrected), strict=True):
                whole[places] = values
            result.scale[places] *= mean
        with np.errstate(all="ignore"):
            moved = np.linalg.norm(result.center - before, axis=1) > _SAME * result.radius
        if not (moved & result.found).any():
            break
    return result


def cost(sets: Weighted, center: Floats, radius: Floats) -> Floats:
    """Σ p (R - r)² (b,)."""
    away = sets.points - center[:, None]
    distance = np.sqrt(np.einsum("bni,bni->bn", away, away))
    return np.asarray((sets.weights * (distance - radius[:, None]) ** 2).sum(axis=1))


def covariance(sets: Weighted, spheres: Spheres, corrected: bool = True) -> Floats:
    """Covariance of (ĉ, r̂) (b, d+1, d+1) in the units of the sets (theory 9.6).

    That of the corrected equations is J⁻¹ Σ p² V (e, 1)(e, 1)ᵀ J⁻ᵀ; else it is the Cramér-Rao bound with the estimates
    plugged in. A known radius has no error. NaN where there is no sphere.
    """
    d, corrected = spheres.center.shape[1], corrected and not sets.radial
    result = np.full((len(sets.unit), d + 1, d + 1), np.nan)
    for places, part, mean in for_kernels(sets, spheres, corrected):
        known = np.isfinite(sets.radius[places])
        result[places] = covariances_of(part, spheres.scale[places] / mean, known, corrected)
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
    """Weights of mean 1 (b, n), the means' factors (b, n, 2) and the mean of 1/v (b,) of covariances at spheres.

    What their noise across the normal adds to the centre's equation (9.7) is written as Σp eeᵀ h: it acts as a λ that
    varies by h·e from point to point.
    """
    noise, present = sets.covariances, sets.present
    assert noise is not None
    with np.errstate(all="ignore"):
        away = sets.points - spheres.center[:, None]
        e = np.where(present[..., None], away / np.linalg.norm(away, axis=2, keepdims=True), 0.0)
        turned = np.einsum("bnij,bnj->bni", noise, e)
        normal = np.where(present, np.einsum("bni,bni->bn", e, turned), 1.0)
        p = np.where(present, 1.0 / normal, 0.0)
        across = np.einsum("bni,bni->bn", turned, turned) - normal**2
        plain = np.where(present, (np.einsum("bnii->bn", noise) - normal) / 2.0 - 2.0 * p * across, 0.0)
        aside = np.where(present[..., None], turned - normal[..., None] * e, 0.0)
        spread = np.einsum("bn,bni,bnj->bij", p, e, e)
        h = np.einsum("bij,bnj,bn->bi", _inverse(spread), aside, p)
        mean = p.sum(axis=1, keepdims=True) / sets.size[:, None]
        bent = np.stack([plain, plain + np.einsum("bni,bi->bn", e, h)], axis=2) * mean[..., None]
        return p / mean, bent, mean[:, 0]


def _inverse(matrices: Floats) -> Floats:
    """Inverses of matrices (b, m, m); NaN where they are singular."""
    result = np.full(matrices.shape, np.nan)
    with np.errstate(all="ignore"):
        fine = np.isfinite(matrices).all(axis=(1, 2)) & (np.linalg.slogdet(matrices)[0] != 0.0)
    result[fine] = np.linalg.inv(matrices[fine])
    return result


def free_sphere(samples: Samples) -> Estimates:
    """Fit each complete set by `corrected`, or by its equations with the points' weights."""
    start = corrected(samples)
    if samples.weights is None:
        return start
    b, _, n = samples.shape
    mean, unknown = samples.weights.mean(axis=1), np.full(b, np.nan)
    own = BatchWeights(samples.weights / mean[:, None], np.empty((b, 2, 0)), unknown, alone(n))
    sphere = spheres_of(PointSets(samples.rows, start.center, start.radius, own), np.full(b, FULLER), False)
    for whole, part in zip(start, (sphere.center, sphere.radius, sphere.scale * mean), strict=False):
        whole[:] = np.where(sphere.found.reshape(-1, *[1] * (part.ndim - 1)), part, np.nan)
    return start
