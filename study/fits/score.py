"""The score of a hypothetical radius: a studentised sum of deviations that noise and directions leave with mean zero.

Given the radius r₀, centre and noise variance are profiled out. With R = |x - c|, e = (x - c)/R, and ρ = E R,
λ = r₀/E e·u, V = Var R at (r₀, s) (`radial_means`), they solve

    Σ (R - λ) e = 0,        Σ (R - ρ)²/(N - d) = V                                                (theory 10.1)

for c and s = σ². Both are strongly identified on a cap, however weak its curvature is. At this profile, with
b = J⁻¹ē, w = 1 - b·e and S = Σ(R - ρ),

    T_F² = ((S - β)²/Σw²) / [(Σ(R - ρ)² - S²/Σw²)/(N - d - 1)],
    T_H² = (N - d - 1)/N · (S - β)²/(Σψ² - S²/N),                                                  (theory 10.2)
    ψ = (R - ρ) - b·e (R - λ) - g [(R - ρ)² - V],    g = (∂ρ - ∂λ b·ē)/∂V,    ∂ = ∂/∂s.

β is the bias that the errors of centre and noise give S. T has the sign of S - β. It is T_F
where σ is below a fifth of r₀ (.4 r₀/(d - 1) in more than three dimensions), else the one of T_F and T_H that is closer
to zero.

A sphere is stored by its radius, the direction u = c/r₀ and its height h = (|c|² - r₀²)/2r₀ about an origin near the
points: then R - r₀ has an error of the points' own size times 2⁻⁵², also where the radius is many times that size.
"""

import math
from typing import NamedTuple

import numpy as np

from study.arrays import Floats, Ints
from study.fits.corrected import RadialMeans, radial_means
from study.fits.jit import Sums, compiled, fill, fresh, put
from study.fits.linalg import diagonalise, eliminate

_MAX_STEPS = 30
_TINY = 1e-280
_CONVERGED = 1e-10
"""Squared length of the last step in standard errors: its square, which is neglected, moves no end of an interval."""
_STEADY = 1e-5
"""Relative change of the noise variance that ends the iteration; its square is neglected."""
_LARGEST_STEP = 0.5
"""Largest step of the centre, in radii."""
_DROP = 1e-4
"""The noise variance falls in one step to this share of itself at most."""
_NOISY = 0.2
"""Noise, in radii, from which on the score is also studentised by its own sum of squares, in up to three dimensions.
The error of the noise variance adds (d - 1)²σ²/2r² to the relative variance of S, which T_F leaves out: .08 there."""


class Weights(NamedTuple):
    """Weights of the points of one set: point i has the noise variance s/p on each coordinate (theory 10.6).

    Attributes:
        p: weights, of mean 1 (n,).
        bent: ρ - r and λ - r of points with covariances, times r/s (2, n); (2, 0) where noise is isotropic.
        offsets: what ρ and λ of each point exceed those of the set by (2, n); receives them.
        scale: s, NaN where it is not known (1,).
    """

    p: Floats
    bent: Floats
    offsets: Floats
    scale: Floats


class Markers(NamedTuple):
    """The markers of one set of points, of which marker 0 has the hypothetical radius.

    Attributes:
        which: the marker of each point (n,).
        size: number of points of each marker (M,).
        radii: their radii (M,); receives them.
        means: ρ - r, λ - r, V and the derivatives of ρ, λ and V by s (M, 6); receives them.
        sums: ΣR and Σe of each marker (M, d+1); receives them.
        points: R and e of each point (n, d+1); receives them.
    """

    which: Ints
    size: Floats
    radii: Floats
    means: Floats
    sums: Floats
    points: Floats

    @classmethod
    def of(cls, which: Ints, dimension: int) -> "Markers":
        """Markers of points, with room for what kernels find."""
        size = np.bincount(which).astype(float)
        m, n, wide = len(size), len(which), dimension + 1
        return cls(which, size, np.empty(m), np.empty((m, 6)), np.empty((m, wide)), np.empty((n, wide)))


class PointSet(NamedTuple):
    """The points of one set, relative to their centroid and in units of their spread.

    Attributes:
        rows: coordinates, then |x|² in the last row (d+1, n).
        zero: d sums at zero.
        square: d² sums at zero.
        least: noise variance that counts as none.
        weights: their weights; None where all points have the same noise, of unknown size.
        markers: None for one sphere. Each combination has code of its own.
    """

    rows: Floats
    zero: Sums
    square: Sums
    least: float
    weights: Weights | None
    markers: Markers | None


class Profile(NamedTuple):
    """Centre and noise variance of one set for a hypothetical radius, and the sums that they and the score stand on.

    Of symmetric sums the lower triangle is filled.

    Attributes:
        sphere: radius r₀, height h and noise variance s (3,).
        toward: u = c/r₀ (d,).
        bend: b = J⁻¹ē, minus the derivative of c by r₀ (d,).
        inverse: J⁻¹ (d, d).
        errors: standard errors of the centre's coordinates given r₀ (d,).
        correlations: of these coordinates with the score (d,).
        system: equations and their right sides (d, 2d).
        sums: Σ(R - r₀)e, Σe and Σeeᵀ/R (d+2, d).
        scatter: Σeeᵀ and Σw eeᵀ/R (2, d, d).
        products: Σpψ, Σp and Σppᵀ, where p is the centre's own score (d+2, d).
        covariance: of the centre, as noise of constant variance makes it, and by p's own sum of squares (2, d, d).
        axes: eigenvectors (d, d).
    """

    sphere: Floats
    toward: Floats
    bend: Floats
    inverse: Floats
    errors: Floats
    correlations: Floats
    system: Floats
    sums: Floats
    scatter: Floats
    products: Floats
    covariance: Floats
    axes: Floats


@compiled
def new_profile(d: int) -> Profile:
    """Allocate a profile in d dimensions."""
    sums, scatter, products = np.empty((d + 2, d)), np.empty((2, d, d)), np.empty((d + 2, d))
    inverse, system, covariance, axes = np.empty((d, d)), np.empty((d, 2 * d)), np.empty((2, d, d)), np.empty((d, d))
    v = np.empty((4, d))
    return Profile(np.empty(3), v[0], v[1], inverse, v[2], v[3], system, sums, scatter, products, covariance, axes)


@compiled
def place(profile: Profile, radius: float, center: Floats) -> None:
    """Place the sphere of a radius about a centre (d,)."""
    square = 0.0
    for i in range(center.size):
        profile.toward[i] = center[i] / radius
        square += center[i] * center[i]
    length = math.sqrt(square)
    profile.sphere[0], profile.sphere[1] = radius, 0.5 * (length - radius) * (length + radius) / radius


@compiled
def _weight(weights: Weights | None, k: int) -> float:
    """Weight p of point k."""
    return 1.0 if weights is None else weights.p[k]


@compiled
def _offset(weights: Weights | None, of: int, k: int) -> float:
    """The offset of ρ (0) or λ (1) of point k from that of the set."""
    return 0.0 if weights is None else weights.offsets[of, k]


@compiled
def _known(weights: Weights | None) -> float:
    """The noise scale s, NaN where it is not known."""
    return math.nan if weights is None else weights.scale[0]


@compiled
def _widest(weights: Weights | None) -> float:
    """Mean of 1/p."""
    if weights is None:
        return 1.0
    total = 0.0
    for k in range(weights.p.size):
        total += 1.0 / weights.p[k]
    return total / weights.p.size


@compiled
def _means(weights: Weights | None, r: float, s: float, d: int) -> RadialMeans:
    """Means of R: of every point where all are alike, else means over the points, and each point's offsets from them.

    They are Σ p ρ/N, Σ p λ/N and Σ p V/N; of derivatives by s nothing is left where s is known.
    """
    if weights is None:
        return radial_means(r, s, d)
    n, m, x = weights.p.size, weights.offsets[0], weights.offsets[1]
    a = b = v = m_by_s = x_by_s = v_by_s = x_by_r = short = 0.0
    for k in range(n):
        p = weights.p[k]
        if weights.bent.shape[1] > 0:
            m_s, x_s = weights.bent[0, k] / r, weights.bent[1, k] / r
            m[k], x[k] = s * m_s, s * x_s
            v, m_by_s, x_by_s, v_by_s = v + s, m_by_s + p * m_s, x_by_s + p * x_s, v_by_s + 1.0
            short, x_by_r = short - p * m[k] / r, x_by_r - p * x[k] / r
        else:
            of = radial_means(r, s / p, d)
            m[k], x[k] = of.lengthening, of.excess01
            v, m_by_s, x_by_s = v + p * of.variance, m_by_s + of.mean_by_s, x_by_s + of.excess01_by_s
            v_by_s, x_by_r, short = v_by_s + of.variance_by_s, x_by_r + p * of.excess01_by_r, short + p * of.shortening
        a, b = a + p * m[k], b + p * x[k]
    a, b = a / n, b / n
    for k in range(n):
        m[k], x[k] = m[k] - a, x[k] - b
    unknown = 1.0 / n if math.isnan(weights.scale[0]) else 0.0
    m_by_s, x_by_s = m_by_s * unknown, x_by_s * unknown
    return RadialMeans(a, short / n, v / n, b, 0.0, m_by_s, 0.0, v_by_s / n, x_by_r / n, x_by_s, 0.0, 0.0)


@compiled
def _distance(rows: Floats, k: int, r: float, twice_height: float, twice_u: Sums) -> tuple[float, float]:
    """R and R - r₀ of point k, of which the second has no digits lost: R² - r₀² = |x|² - 2c·x + 2r₀h."""
    d = len(twice_u)
    g = rows[d, k] / r + twice_height
    for i in range(d):
        g -= twice_u[i] * rows[i, k]
    distance = math.sqrt(max(r * (r + g), _TINY))
    return distance, g * r / (r + distance)


@compiled
def _pass(points: PointSet, profile: Profile) -> tuple[float, float]:
    """Fill in the profile's ``sums``, and return Σ(R - r₀) and Σ(R - r₀)²: all with weights, and less the offsets."""
    rows, zero, square, _, weights, _ = points
    d, r, twice = len(zero), profile.sphere[0], 2.0 * profile.sphere[1]
    u, center, e, pull, mean, curve = fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(square)
    for i in range(d):
        u, center = put(u, i, 2.0 * profile.toward[i]), put(center, i, r * profile.toward[i])
    total = squares = 0.0
    for k in range(rows.shape[1]):
        distance, excess = _distance(rows, k, r, twice, u)
        over, p = 1.0 / distance, _weight(weights, k)
        away, rest = excess - _offset(weights, 1, k), excess - _offset(weights, 0, k)
        total += p * rest
        squares += p * rest * rest
        for i in range(d):
            e = put(e, i, (rows[i, k] - center[i]) * over)
            mean = put(mean, i, mean[i] + p * e[i])
            pull = put(pull, i, pull[i] + p * e[i] * away)
            for j in range(i + 1):
                curve = put(curve, i * d + j, curve[i * d + j] + p * e[i] * over * e[j])
    for i in range(d):
        profile.sums[0, i], profile.sums[1, i] = pull[i], mean[i]
        for j in range(d):
            profile.sums[2 + i, j] = curve[i * d + j]
    return total, squares


@compiled
def _jacobian(n: int, curvature: float, profile: Profile) -> None:
    """Write J = mean[(1 - λ/R) I + (λ/R) eeᵀ], given λ, to the system."""
    matrix, curve = profile.system, profile.sums[2:]
    d, inverse = matrix.shape[0], 0.0
    for i in range(d):
        inverse += curve[i, i]
    for i in range(d):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = curvature * curve[i, j] / n
        matrix[i, i] += 1.0 - curvature * inverse / n


@compiled
def solve_profile(points: PointSet, profile: Profile, least: float) -> tuple[bool, RadialMeans]:
    """Solve for centre and noise variance by Newton's method, from those of ``profile``; the radius stays.

    Args:
        points: more than d + 1 points.
        profile: holds the starting values; receives the solution, J⁻¹ and b.
        least: noise variance that counts as none.

    Returns:
        False if the iteration did not converge; and the means of R at the solution.
    """
    sphere, toward, matrix, sums = profile.sphere, profile.toward, profile.system, profile.sums
    n, d, r, known = points.rows.shape[1], toward.size, sphere[0], _known(points.weights)
    means, done, fine = radial_means(r, 1.0, d), False, False
    for _ in range(_MAX_STEPS):
        sphere[2] = known if known == known else sphere[2]
        means = _means(points.weights, r, sphere[2], d)
        if done:
            fine = True
            break
        total, squares = _pass(points, profile)
        shift, mean = means.excess01, means.lengthening
        excess = (squares - 2.0 * mean * total + n * mean * mean) / (n - d) - means.variance
        slope = -2.0 * means.mean_by_s * (total - n * mean) / (n - d) - means.variance_by_s
        if not (abs(slope) > 1e-3 and squares < math.inf):
            break
        # the second equation gives the step of s, which is put into the first: d equations for the centre remain
        _jacobian(n, r + shift, profile)
        by_s, factor = means.excess01_by_s / slope, -2.0 / (n - d)
        for i in range(d):
            along = sums[1, i] / n
            for j in range(d):
                matrix[i, j] -= by_s * along * factor * (sums[0, j] - mean * sums[1, j])
            matrix[i, d] = sums[0, i] / n - shift * along + by_s * along * excess
        if not eliminate(matrix, 1):
            break
        length = change = forward = 0.0
        for i in range(d):
            length += matrix[i, d] * matrix[i, d]
        length = math.sqrt(length)
        if not length < math.inf:
            break
        scale = min(1.0, _LARGEST_STEP * r / max(length, _TINY))
        for i in range(d):
            step = scale * matrix[i, d]
            change += factor * (sums[0, i] - mean * sums[1, i]) * step
            forward += (sums[0, i] - shift * sums[1, i]) * step  # n times the length squared, measured by J
            sphere[1] += step * (toward[i] + 0.5 * step / r)
            toward[i] += step / r
        before = sphere[2]
        sphere[2] = max(before - (excess + change) / slope, _DROP * before, 0.1 * least)
        steady = abs(sphere[2] - before) <= _STEADY * before or known == known
        short = abs(forward) <= _CONVERGED * sphere[2] and length <= 1e-2 * r
        done = (short and steady) or (sphere[2] < least and before < least)
    if fine:
        _jacobian(n, r + means.excess01, profile)
        for i in range(d):
            for j in range(d):
                matrix[i, d + j] = 1.0 if i == j else 0.0
        fine = eliminate(matrix, d)
        for i in range(d):
            profile.bend[i] = 0.0
            for j in range(d):
                profile.inverse[i, j] = matrix[i, d + j]
                profile.bend[i] += matrix[i, d + j] * sums[1, j] / n
    return fine, means


@compiled
def _weigh(points: PointSet, profile: Profile, excess: float) -> tuple[float, float, float, float]:
    """Σw, Σw², Σw(R - r₀) and a rough Σw, given λ - r₀, all with weights; fills in the profile's ``scatter``.

    On a small cap w is of second order in its angle and Σw of fourth. So each w is formed by itself, and Σw from Σw²
    and the difference of J and mean eeᵀ: N b·(J - mean eeᵀ)b = Σ (1 - λ/R)(|b|² - (b·e)²).
    The rough one adds up the w, and has their rounding.
    """
    rows, zero, square, _, weights, _ = points
    d, r, twice = len(zero), profile.sphere[0], 2.0 * profile.sphere[1]
    u, center, e, b = fresh(zero), fresh(zero), fresh(zero), fresh(zero)
    scatter, weighted = fresh(square), fresh(square)
    length = 0.0
    for i in range(d):
        u, center = put(u, i, 2.0 * profile.toward[i]), put(center, i, r * profile.toward[i])
        b = put(b, i, profile.bend[i])
        length += profile.bend[i] * profile.bend[i]
    total, squares, score, rough = 0.0, 0.0, 0.0, 0.0
    for k in range(rows.shape[1]):
        distance, away = _distance(rows, k, r, twice, u)
        over, w, p = 1.0 / distance, 1.0, _weight(weights, k)
        away -= _offset(weights, 1, k)
        for i in range(d):
            e = put(e, i, (rows[i, k] - center[i]) * over)
            w -= b[i] * e[i]
        for i in range(d):
            for j in range(i + 1):
                scatter = put(scatter, i * d + j, scatter[i * d + j] + p * e[i] * e[j])
                weighted = put(weighted, i * d + j, weighted[i * d + j] + p * w * over * e[i] * e[j])
        total += p * (away - excess) * over * (length - (1.0 - w) * (1.0 - w))
        squares += p * w * w
        score += p * w * away
        rough += p * w
    for i in range(d):
        for j in range(d):
            profile.scatter[0, i, j], profile.scatter[1, i, j] = scatter[i * d + j], weighted[i * d + j]
    return squares + total, squares, score, rough


@compiled
def _multiply(points: PointSet, profile: Profile, means: RadialMeans, g: float) -> tuple[float, float]:
    """Fill in the profile's ``products`` of ψ and p = (R - λ)e - α[(R - ρ)² - V]ē; returns Σψ and Σψ²."""
    rows, zero, _, _, weights, _ = points
    n, d, r, twice = rows.shape[1], len(zero), profile.sphere[0], 2.0 * profile.sphere[1]
    alpha, products = means.excess01_by_s / means.variance_by_s, profile.products
    u, p, tilt = fresh(zero), fresh(zero), fresh(zero)
    for i in range(d):
        u, tilt = put(u, i, 2.0 * profile.toward[i]), put(tilt, i, alpha * profile.sums[1, i] / n)
        fill(products[i], 0.0)
    fill(products[d], 0.0)
    fill(products[d + 1], 0.0)
    total = squares = 0.0
    for k in range(n):
        distance, excess = _distance(rows, k, r, twice, u)
        weight = _weight(weights, k)
        rest, away = excess - means.lengthening, excess - means.excess01
        rest, away = rest - _offset(weights, 0, k), weight * (away - _offset(weights, 1, k))
        surplus = weight * rest * rest - means.variance
        psi = weight * rest - g * surplus
        for i in range(d):
            e = (rows[i, k] - r * profile.toward[i]) / distance
            psi -= profile.bend[i] * e * away
            p = put(p, i, away * e - tilt[i] * surplus)
        for i in range(d):
            products[0, i] += p[i] * psi
            products[1, i] += p[i]
            for j in range(i + 1):
                products[2 + i, j] += p[i] * p[j]
        total += psi
        squares += psi * psi
    return total, squares


@compiled
def _sandwich(inverse: Floats, middle: Floats, factor: float, result: Floats) -> None:
    """Write A M Aᵀ times a factor; of the symmetric M the lower triangle is read."""
    d = inverse.shape[0]
    for i in range(d):
        for j in range(d):
            total = 0.0
            for k in range(d):
                for m in range(d):
                    total += inverse[i, k] * middle[max(k, m), min(k, m)] * inverse[j, m]
            result[i, j] = total * factor


@compiled
def _lengthening(scatter: Floats, covariance: Floats) -> float:
    """Σ f tr[(I - eeᵀ)C], given Σ f eeᵀ in its lower triangle, with any factors f."""
    every = along = trace = 0.0
    for i in range(covariance.shape[0]):
        every += scatter[i, i]
        trace += covariance[i, i]
        along += scatter[i, i] * covariance[i, i]
        for j in range(i):
            along += 2.0 * scatter[i, j] * covariance[i, j]
    return every * trace - along


@compiled
def _slope(points: PointSet, profile: Profile, means: RadialMeans, plain: float, weights: Weights | None) -> float:
    """The number g of points with weights, whose sums are without them; that of others is given."""
    if weights is None:
        return plain
    d, n, r, along = profile.toward.size, points.rows.shape[1], profile.sphere[0], 0.0
    for k in range(n):
        square = part = 0.0
        for i in range(d):
            away = points.rows[i, k] - r * profile.toward[i]
            square += away * away
            part += profile.bend[i] * away
        along += part / math.sqrt(square)
    return float((means.mean_by_s - means.excess01_by_s * (along / n)) / means.variance_by_s)


@compiled
def score(points: PointSet, profile: Profile, means: RadialMeans) -> tuple[float, float, float]:
    """Score of a radius at its profile, which receives the standard errors of the centre given the radius.

    Args:
        points: the points.
        profile: the solution of `solve_profile`.
        means: means of R there.

    Returns:
        T, dT/dr₀ where T = 0, and the centre's largest standard error in any direction.
    """
    model, robust = profile.covariance[0], profile.covariance[1]
    n, d, r, variance = points.rows.shape[1], profile.toward.size, profile.sphere[0], means.variance
    known = _known(points.weights)
    total, weight, plain, rough = _weigh(points, profile, means.excess01)
    s = plain - means.excess01 * total + n * (means.excess01 - means.lengthening)
    _sandwich(profile.inverse, profile.scatter[0], variance / n / n, model)
    for i in range(d):
        profile.errors[i], profile.correlations[i] = math.sqrt(model[i, i]), 0.0
    along = 1.0 - total / n  # b·ē
    g = (means.mean_by_s * (total / n) + (means.mean_by_s - means.excess01_by_s) * along) / means.variance_by_s
    g = _slope(points, profile, means, g, points.weights)
    # Σw is Σw² but for noise and rounding, which grow without limit towards a plane: the mean part of the sum has Σw²
    bias = 0.5 * _lengthening(profile.scatter[1], model) + g * variance * n / (n - d)
    bias += 0.5 * _lengthening(profile.sums[2:], model) * (weight - rough) / n
    rest = s - bias
    scale = ((n - d) * variance - s * s / max(weight, _TINY)) / (n - d - 1.0)
    if known == known:
        scale = variance
    value = abs(rest) / math.sqrt(max(weight * max(scale, 1e-12 * variance, _TINY), _TINY))
    slope = (means.excess01_by_r - means.shortening) * along - (1.0 + means.shortening) * (total / n)
    slope *= n / math.sqrt(max(variance * weight, _TINY))
    larger = 0.0
    if profile.sphere[2] * _widest(points.weights) >= (_NOISY * min(1.0, 2.0 / (d - 1.0)) * r) ** 2:
        sum_psi, squares = _multiply(points, profile, means, g)
        squares, products, spare = max(squares - s * s / n, _TINY), profile.products, n * (n - d - 1.0)
        if known != known:
            value = min(value, abs(rest) * math.sqrt(spare / squares) / n)
        _sandwich(profile.inverse, products[2:], 1.0 / spare, robust)
        for i in range(d):
            larger += robust[i, i] - model[i, i]
            both = 0.0
            for j in range(d):
                both += profile.inverse[i, j] * (products[0, j] - products[1, j] * sum_psi / n)
            both /= math.sqrt(max(robust[i, i] * spare, _TINY) * squares)
            profile.correlations[i] = min(max(both, -1.0), 1.0)
            profile.errors[i] = math.sqrt(max(model[i, i], robust[i, i]))
    covariance = robust if larger > 0.0 else model
    diagonalise(covariance, profile.axes)
    spread = math.sqrt(max(covariance[d - 1, d - 1], 0.0))
    return value if rest >= 0.0 else -value, slope, spread
