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

Points may weigh differently, p = 1/v (theory 10.6), and belong to groups with radii of their own, such as markers
(theory 10.7). The radius of group 0 is hypothetical; or it is fitted, and the equations are the corrected ones of
theory 9.6. A radius that is not given follows from the centre, by Σp(R - ρ) = 0 over its group, and takes the mean ē of
the directions out of the centre's equation: J loses Σp ∂λ/∂r e Σpeᵀ/Σp ∂ρ/∂r. With h = 1 in group 0 and b·ē in the
others, w = h - b·e. Without weights and groups nothing of this is computed.

A sphere is stored by its radius, the direction u = c/r₀ and its height h = (|c|² - r₀²)/2r₀ about an origin near the
points: then R - r₀ has an error of the points' own size times 2⁻⁵², also where the radius is many times that size.
"""

import math
from typing import NamedTuple

import numpy as np

from study.arrays import Floats, Ints
from study.fits.estimators.corrected import RadialMeans, radial_means
from study.fits.loops.jit import Sums, compiled, fill, fresh, put, squared
from study.fits.loops.linalg import diagonalise, eliminate

_MAX_STEPS = 30
_TINY = 1e-280
_CONVERGED = 1e-10
"""Squared length of the last step in standard errors: its square, which is neglected, moves no end of an interval."""
_STEADY = 1e-5
"""Relative change of the noise variance that ends the iteration; its square is neglected."""
_LARGEST_STEP = 0.5
"""Largest step of the centre, in radii."""
_EXACTLY, _STEADILY = 1e-18, 1e-11
"""Both where the sphere itself is wanted."""
_SMALLEST = 1e-3
"""Least radius that follows from the centre, in mean distances: noise may explain all of that."""
_DROP = 1e-4
"""The noise variance falls in one step to this share of itself at most."""
_NOISY = 0.2
"""Noise, in radii, from which on the score is also studentised by its own sum of squares, in up to three dimensions.
The error of the noise variance adds (d - 1)²σ²/2r² to the relative variance of S, which T_F leaves out: .08 there."""


class Weights(NamedTuple):
    """Weights and groups of the points of one set: point i has the noise variance s/p on each coordinate (theory 10.6).

    Each group, such as a marker, has a radius of its own about the common centre; that of group 0 is hypothetical.

    Attributes:
        p: weights, of mean 1 (n,).
        bent: ρ - r and λ - r of points with covariances, times r/s (2, n); (2, 0) where noise is isotropic.
        scale: s, NaN where it is not known (1,).
        group: the group of each point (n,).
        fuller: Fuller's constant α where the radius of group 0 is fitted, too; NaN where it is given.
        downhill: the equations are those of a minimum of Σp(R - r)², to which each step goes down.
        offsets: by how much ρ and λ of each point exceed those of group 0, pV over its mean, and ∂λ/∂r - 1 (4, n);
            receives them.
        sums: what `_SIZE` and the others say, of each group (M, _E + 2d); receives them.
        own: Σp eeᵀ/R of group 0 (d, d); receives it.
        step: the last step of the centre (d,); receives it.
    """

    p: Floats
    bent: Floats
    scale: Floats
    group: Ints
    fuller: float
    downhill: bool
    offsets: Floats
    sums: Floats
    own: Floats
    step: Floats


_SIZE, _EXCESS, _SHIFT, _SHARE, _LONGER, _BENT, _LONGER_BY_S, _BENT_BY_S, _SHORT, _E = range(10)
"""Columns of the groups' sums: Σp, Σp(R - r₀), its radius less r₀, the h of w = h - b·e, then sums of p times ρ - r,
λ - r, their derivatives by s, and ∂ρ/∂r - 1; then Σpe, and Σp ∂λ/∂r e."""


@compiled
def new_weights(p: Floats, bent: Floats, scale: Floats, group: Ints, fuller: float, downhill: bool, d: int) -> Weights:
    """Weights of a set in d dimensions, with room for what is found."""
    groups = 0
    for k in range(group.size):
        groups = max(groups, group[k] + 1)
    sums = np.zeros((groups, _E + 2 * d))
    return Weights(p, bent, scale, group, fuller, downhill, np.empty((4, p.size)), sums, np.empty((d, d)), np.zeros(d))


class PointSet(NamedTuple):
    """The points of one set, relative to their centroid and in units of their spread.

    Attributes:
        rows: coordinates, then |x|² in the last row (d+1, n).
        zero: d sums at zero.
        square: d² sums at zero.
        least: noise variance that counts as none.
    """

    rows: Floats
    zero: Sums
    square: Sums
    least: float


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
def _free(weights: Weights | None) -> bool:
    """True if the radius of group 0 is fitted."""
    return False if weights is None else weights.fuller == weights.fuller


@compiled
def _fitted(weights: Weights | None) -> int:
    """Number of radii that follow from the centre."""
    return 0 if weights is None else weights.sums.shape[0] - (0 if _free(weights) else 1)


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
    """Means of R: of every point where all are alike, else means over group 0, and each point's offsets from them.

    They are Σ p ρ/Σp, Σ p λ/Σp and, over all points, Σ p V/N; of derivatives by s nothing is left where s is known.
    """
    if weights is None:
        return radial_means(r, s, d)
    p, sums, offsets, n = weights.p, weights.sums, weights.offsets, weights.p.size
    unknown = 1.0 if math.isnan(weights.scale[0]) else 0.0
    sums[:, _LONGER:_E] = 0.0
    of, last, radius = radial_means(r, s, d), math.nan, math.nan
    variance = by_s = by_r = 0.0
    for k in range(n):
        g, weight = weights.group[k], p[k]
        own = r + sums[g, _SHIFT]
        if weights.bent.shape[1] > 0:
            m_by_s, x_by_s = weights.bent[0, k] / own, weights.bent[1, k] / own
            m, x, v, v_by_s = s * m_by_s, s * x_by_s, s / weight, 1.0
            m_by_s, x_by_s, short, offsets[3, k] = weight * m_by_s, weight * x_by_s, -m / own, -x / own
        else:
            if weight != last or own != radius:
                of, last, radius = radial_means(own, s / weight, d), weight, own
            m, x, v, v_by_s = of.lengthening, of.excess01, of.variance, of.variance_by_s
            m_by_s, x_by_s, short, offsets[3, k] = of.mean_by_s, of.excess01_by_s, of.shortening, of.excess01_by_r
        offsets[0, k], offsets[1, k], offsets[2, k] = m + sums[g, _SHIFT], x + sums[g, _SHIFT], weight * v
        sums[g, _LONGER], sums[g, _BENT] = sums[g, _LONGER] + weight * m, sums[g, _BENT] + weight * x
        sums[g, _LONGER_BY_S] += m_by_s * unknown
        sums[g, _BENT_BY_S] += x_by_s * unknown
        sums[g, _SHORT] += weight * short
        variance, by_s = variance + weight * v / n, by_s + v_by_s / n
        by_r += weight * offsets[3, k] if g == 0 else 0.0
    size = sums[0, _SIZE]
    a, b = sums[0, _LONGER] / size, sums[0, _BENT] / size
    for k in range(n):
        offsets[0, k], offsets[1, k], offsets[2, k] = offsets[0, k] - a, offsets[1, k] - b, offsets[2, k] / variance
    m_by_s, x_by_s, short = sums[0, _LONGER_BY_S] / size, sums[0, _BENT_BY_S] / size, sums[0, _SHORT] / size
    return RadialMeans(a, short, variance, b, 0.0, m_by_s, 0.0, by_s, by_r / size, x_by_s, 0.0, 0.0)


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
def _measure(points: PointSet, weights: Weights | None, profile: Profile) -> None:
    """Fill in the sums of R and e over each group, and the radii that follow from them; group 0's is the sphere's."""
    if weights is None:
        return
    rows, sphere, toward, sums = points.rows, profile.sphere, profile.toward, weights.sums
    d, r, twice, u = toward.size, sphere[0], 2.0 * sphere[1], fresh(points.zero)
    for i in range(d):
        u = put(u, i, 2.0 * toward[i])
    sums[:, :_LONGER], sums[:, _E : _E + d] = 0.0, 0.0
    for k in range(rows.shape[1]):
        distance, excess = _distance(rows, k, r, twice, u)
        g, p = weights.group[k], weights.p[k]
        sums[g, _SIZE] += p
        sums[g, _EXCESS] += p * excess
        for i in range(d):
            sums[g, _E + i] += p * (rows[i, k] - r * toward[i]) / distance
    for g in range(0 if _free(weights) else 1, sums.shape[0]):
        mean = sums[g, _EXCESS] / sums[g, _SIZE]
        sums[g, _SHIFT] = max(mean - sums[g, _LONGER] / sums[g, _SIZE], _SMALLEST * (r + mean) - r)
    change = sums[0, _SHIFT]
    if change != 0.0:
        sphere[0] = r + change
        sphere[1] = (r * sphere[1] - change * (r + 0.5 * change)) / sphere[0]
        for i in range(d):
            toward[i] *= r / sphere[0]
        for g in range(sums.shape[0]):
            sums[g, _EXCESS] -= sums[g, _SIZE] * change
            sums[g, _SHIFT] -= change


@compiled
def _pass(
    points: PointSet, weights: Weights | None, profile: Profile, curvature: float, bend: float
) -> tuple[float, float]:
    """Fill in the profile's ``sums``, and return Σ(R - r₀) and Σ(R - r₀)²: all with weights, and less the offsets.

    With weights Σeeᵀ/R has those of λ, in units of λ of group 0, which is given, and ``bend`` is αs/(N r) of (9.6).
    """
    rows, zero, square, _ = points
    d, r, twice = len(zero), profile.sphere[0], 2.0 * profile.sphere[1]
    u, center, e, pull, mean, curve = fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(square)
    for i in range(d):
        u, center = put(u, i, 2.0 * profile.toward[i]), put(center, i, r * profile.toward[i])
    total = squares = 0.0
    if weights is not None:
        weights.sums[:, _E + d :] = 0.0
    for k in range(rows.shape[1]):
        distance, excess = _distance(rows, k, r, twice, u)
        over, p, rest = 1.0 / distance, 1.0, excess
        size, force = 1.0, excess  # factors of eeᵀ/R and e
        if weights is not None:
            p, rest = weights.p[k], excess - weights.offsets[0, k]
            size = p * (1.0 + weights.offsets[1, k] / curvature) - bend / curvature
            force = p * (excess - weights.offsets[1, k]) + bend
        total += p * rest
        squares += p * rest * rest
        for i in range(d):
            e = put(e, i, (rows[i, k] - center[i]) * over)
            mean = put(mean, i, mean[i] + p * e[i])
            pull = put(pull, i, pull[i] + force * e[i])
            if weights is not None:
                weights.sums[weights.group[k], _E + d + i] += p * (1.0 + weights.offsets[3, k]) * e[i]
            for j in range(i + 1):
                curve = put(curve, i * d + j, curve[i * d + j] + size * e[i] * over * e[j])
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
def _take_out_radii(weights: Weights | None, n: int, matrix: Floats) -> None:
    """Take the radii that follow from the centre out of the equations: each takes a mean direction."""
    if weights is None:
        return
    d, sums = matrix.shape[0], weights.sums
    for g in range(sums.shape[0] - _fitted(weights), sums.shape[0]):
        size, e, by_r = sums[g, _SIZE], sums[g, _E : _E + d], sums[g, _E + d :]
        rest, direct = sums[g, _EXCESS] - size * sums[g, _SHIFT] - sums[g, _LONGER], size + sums[g, _SHORT]
        for i in range(d):
            matrix[i, d] -= by_r[i] / direct * rest / n
            for j in range(d):
                matrix[i, j] -= by_r[i] * e[j] / direct / n


@compiled
def _along(weights: Weights | None, profile: Profile, i: int) -> float:
    """Coordinate i of Σpe, along which the noise variance moves the centre's equations."""
    if weights is None or not weights.sums[0, _BENT_BY_S] > 0.0:
        return profile.sums[1, i]  # type: ignore[no-any-return]
    total, sums = 0.0, weights.sums
    for g in range(sums.shape[0]):
        follows = sums[g, _LONGER_BY_S] if g > 0 or _free(weights) else 0.0
        total += (sums[g, _BENT_BY_S] - follows) / sums[g, _SIZE] * sums[g, _E + i]
    return float(total * sums[0, _SIZE] / sums[0, _BENT_BY_S])


@compiled
def _step(weights: Weights | None, matrix: Floats, profile: Profile) -> bool:
    """Solve for the step of the centre; by absolute eigenvalues, so that it goes down, where it seeks a minimum."""
    if weights is None or not weights.downhill:
        return eliminate(matrix, 1)
    d, values, axes = matrix.shape[0], profile.scatter[0], profile.axes
    for i in range(d):
        for j in range(d):
            values[i, j] = 0.5 * (matrix[i, j] + matrix[j, i])
    diagonalise(values, axes)
    largest = max(abs(values[0, 0]), abs(values[d - 1, d - 1]))
    if not 0.0 < largest < math.inf:
        return False
    for i in range(d):
        weights.step[i] = matrix[i, d]
        matrix[i, d] = 0.0
    for k in range(d):
        along = 0.0
        for i in range(d):
            along += axes[i, k] * weights.step[i]
        along /= max(abs(values[k, k]), 1e-15 * largest)
        for i in range(d):
            matrix[i, d] += axes[i, k] * along
    return True


@compiled
def _rose(weights: Weights | None, profile: Profile, cost: float, best: float) -> bool:
    """True, and half of the last step undone, if it went up where a minimum is sought."""
    if weights is None or not (weights.downhill and cost > best * (1.0 + 1e-9) + 1e-30):
        return False
    for i in range(weights.step.size):
        weights.step[i] *= 0.5
        profile.sphere[1] -= weights.step[i] * (profile.toward[i] - 0.5 * weights.step[i] / profile.sphere[0])
        profile.toward[i] -= weights.step[i] / profile.sphere[0]
    return True


@compiled
def first_variance(points: PointSet, weights: Weights | None, center: Floats, radius: float) -> float:
    """Mean square of the distances from the first sphere, and of other groups from their mean distance."""
    total, n = 0.0, points.rows.shape[1]
    if weights is not None:
        weights.sums[:, :_SHIFT] = 0.0
    for k in range(n):
        square = 0.0
        for i in range(center.size):
            square += squared(points.rows[i, k] - center[i])
        away = math.sqrt(square) - radius
        total += squared(away)
        if weights is not None:
            weights.sums[weights.group[k], _SIZE] += 1.0
            weights.sums[weights.group[k], _EXCESS] += away
    if weights is not None:
        for g in range(1, weights.sums.shape[0]):
            total -= squared(weights.sums[g, _EXCESS]) / weights.sums[g, _SIZE]
    return float(total / n)


@compiled
def _finish(weights: Weights | None, profile: Profile) -> None:
    """Write Σpe of group 0 in place of that of all, and the h of each group: 1, and b·ē of the others."""
    if weights is None:
        return
    d, n, sums = profile.toward.size, weights.p.size, weights.sums
    for i in range(d):
        profile.bend[i] = 0.0
        for j in range(d):
            profile.bend[i] += profile.inverse[i, j] * sums[0, _E + j] / n
    for g in range(sums.shape[0]):
        sums[g, _SHARE] = 1.0 if g == 0 else 0.0
        for i in range(d):
            sums[g, _SHARE] += profile.bend[i] * sums[g, _E + i] / sums[g, _SIZE] if g > 0 else 0.0


@compiled
def solve_profile(
    points: PointSet, weights: Weights | None, profile: Profile, least: float
) -> tuple[bool, RadialMeans]:
    """Solve for centre and noise variance by Newton's method, from those of ``profile``; the radius stays if given.

    Args:
        points: more than d + 1 points.
        weights: theirs; None where all points have the same noise, of unknown size, and one radius.
        profile: holds the starting values; receives the solution, J⁻¹ and b.
        least: noise variance that counts as none.

    Returns:
        False if the iteration did not converge; and the means of R at the solution.
    """
    sphere, toward, matrix, sums = profile.sphere, profile.toward, profile.system, profile.sums
    n, d, r, known = points.rows.shape[1], toward.size, sphere[0], math.nan
    means, done, fine, best, bend = radial_means(r, 1.0, d), False, False, math.inf, 0.0
    spare, steady_to, close_to, near, most = max(n - d - _fitted(weights), 1), _STEADY, _CONVERGED, 1e-2, _MAX_STEPS
    rounding = 0.0
    if weights is not None:
        known = weights.scale[0]
        weights.sums[:, _LONGER] = 0.0
        if weights.downhill or _free(weights):
            steady_to, close_to, near, most, rounding = _STEADILY, _EXACTLY, math.inf, 2 * _MAX_STEPS, least
    for _ in range(most):
        sphere[2] = known if known == known else sphere[2]
        _measure(points, weights, profile)
        if weights is not None:
            r = sphere[0]
        means = _means(weights, r, sphere[2], d)
        if done:
            fine = True
            break
        if weights is not None and _free(weights):
            bend = weights.fuller * sphere[2] / n / r
        total, squares = _pass(points, weights, profile, r + means.excess01, bend)
        shift, mean = means.excess01, means.lengthening
        cost = squares - 2.0 * mean * total + n * mean * mean
        if _rose(weights, profile, cost, best):
            continue
        best = cost
        excess = cost / spare - means.variance
        slope = -2.0 * means.mean_by_s * (total - n * mean) / spare - means.variance_by_s
        if not (abs(slope) > 1e-3 and squares < math.inf):
            break
        # the second equation gives the step of s, which is put into the first: d equations for the centre remain
        _jacobian(n, r + shift, profile)
        by_s, factor = means.excess01_by_s / slope, -2.0 / spare
        for i in range(d):
            along = direct = sums[1, i] / n
            if weights is not None:
                along = _along(weights, profile, i) / n
            for j in range(d):
                matrix[i, j] -= by_s * along * factor * (sums[0, j] - mean * sums[1, j])
            matrix[i, d] = sums[0, i] / n - shift * direct + by_s * along * excess
        _take_out_radii(weights, n, matrix)
        if not _step(weights, matrix, profile):
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
            if weights is not None:
                weights.step[i] = step
        before = sphere[2]
        sphere[2] = max(before - (excess + change) / slope, _DROP * before, 0.1 * least)
        steady = abs(sphere[2] - before) <= max(steady_to * before, math.sqrt(before * rounding)) or known == known
        short = abs(forward) <= max(close_to * sphere[2], rounding) and length <= near * r
        done = (short and steady) or (sphere[2] < least and before < least)
    if fine:
        _jacobian(n, r + means.excess01, profile)
        _take_out_radii(weights, n, matrix)
        for i in range(d):
            for j in range(d):
                matrix[i, d + j] = 1.0 if i == j else 0.0
        fine = eliminate(matrix, d)
        for i in range(d):
            profile.bend[i] = 0.0
            for j in range(d):
                profile.inverse[i, j] = matrix[i, d + j]
                profile.bend[i] += matrix[i, d + j] * sums[1, j] / n
        _finish(weights, profile)
    return fine, means


@compiled
def covary(points: PointSet, weights: Weights, profile: Profile, known: bool, corrected: bool, result: Floats) -> None:
    """Write the covariance of centre and radius of a sphere (d+1, d+1), whatever it was fitted by (theory 9.6).

    Args:
        points: the points.
        weights: theirs.
        profile: holds radius, centre and noise variance.
        known: the radius has no error.
        corrected: J⁻¹ΩJ⁻ᵀ of the corrected equations; else the inverse of the information Ω/s.
        result: receives it.
    """
    _measure(points, weights, profile)
    d, r, s, sums = profile.toward.size, profile.sphere[0], profile.sphere[2], weights.sums
    means = _means(weights, r, s, d)
    _pass(points, weights, profile, r + means.excess01, 0.0)
    wide, n, curve, inverse = (d if known else d + 1), points.rows.shape[1], 0.0, r + means.excess01
    system, middle, e = np.zeros((wide, 2 * wide)), np.zeros((d + 1, d + 1)), np.ones(d + 1)
    for k in range(n):
        square = 0.0
        for i in range(d):
            e[i] = points.rows[i, k] - r * profile.toward[i]
            square += e[i] * e[i]
        for i in range(d):
            e[i] /= math.sqrt(square)
        for i in range(d + 1):
            for j in range(d + 1):
                middle[i, j] += weights.p[k] * weights.offsets[2, k] * means.variance * e[i] * e[j]
    for i in range(d):
        curve += inverse * profile.sums[2 + i, i]
    for i in range(wide):
        system[i, wide + i] = 1.0
        for j in range(wide):
            if not corrected:
                system[i, j] = middle[i, j] / s
            elif i < d and j < d:
                system[i, j] = inverse * profile.sums[2 + max(i, j), min(i, j)] + (n - curve if i == j else 0.0)
            elif i < d:
                system[i, j] = sums[0, _E + d + i]
            else:
                system[i, j] = sums[0, _E + j] if j < d else sums[0, _SIZE] + sums[0, _SHORT]
    fine = eliminate(system, wide)
    result[:, :] = 0.0 if fine else math.nan
    if fine:
        _sandwich(np.ascontiguousarray(system[:, wide:]), middle[:wide, :wide], 1.0, result[:wide, :wide])


@compiled
def _weigh(
    points: PointSet, weights: Weights | None, profile: Profile, excess: float
) -> tuple[float, float, float, float]:
    """Σw, Σw², Σw(R - r₀) and a rough Σw, given λ - r₀, all with weights; fills in the profile's ``scatter``.

    With weights Σw² has the noise variances of the points in units of their mean, as has Σeeᵀ, of e less its mean in
    groups whose radius follows from the centre.

    On a small cap w is of second order in its angle and Σw of fourth. So each w is formed by itself, and Σw from Σw²
    and the difference of J and mean eeᵀ: N b·(J - mean eeᵀ)b = Σ (1 - λ/R)(|b|² - (b·e)²).
    The rough one adds up the w, and has their rounding.
    """
    rows, zero, square, _ = points
    d, r, twice = len(zero), profile.sphere[0], 2.0 * profile.sphere[1]
    u, center, e, b = fresh(zero), fresh(zero), fresh(zero), fresh(zero)
    scatter, weighted = fresh(square), fresh(square)
    length = 0.0
    for i in range(d):
        u, center = put(u, i, 2.0 * profile.toward[i]), put(center, i, r * profile.toward[i])
        b = put(b, i, profile.bend[i])
        length += profile.bend[i] * profile.bend[i]
    total, squares, score, rough, spread = 0.0, 0.0, 0.0, 0.0, 0.0
    if weights is not None:
        weights.own[:, :] = 0.0
    for k in range(rows.shape[1]):
        distance, away = _distance(rows, k, r, twice, u)
        over, h, p, g, of_noise = 1.0 / distance, 1.0, 1.0, 0, 1.0
        if weights is not None:
            g, p, of_noise = weights.group[k], weights.p[k], weights.p[k] * weights.offsets[2, k]
            away -= weights.offsets[1, k]
            h = weights.sums[g, _SHARE]
        w = h
        for i in range(d):
            e = put(e, i, (rows[i, k] - center[i]) * over)
            w -= b[i] * e[i]
        for i in range(d):
            for j in range(i + 1):
                both = e[i] * e[j]
                if weights is not None and g == 0:
                    weights.own[i, j] += p * over * both
                elif weights is not None:
                    m = weights.sums[g]
                    both = (e[i] - m[_E + i] / m[_SIZE]) * (e[j] - m[_E + j] / m[_SIZE])
                scatter = put(scatter, i * d + j, scatter[i * d + j] + of_noise * both)
                weighted = put(weighted, i * d + j, weighted[i * d + j] + p * w * over * e[i] * e[j])
        total += p * (away - excess) * over * (length - (h - w) * (h - w))
        squares += p * w * w
        if weights is not None:
            spread += of_noise * w * w
        score += p * w * away
        rough += p * w
    for i in range(d):
        for j in range(d):
            profile.scatter[0, i, j], profile.scatter[1, i, j] = scatter[i * d + j], weighted[i * d + j]
    return squares + total, squares if weights is None else spread, score, rough


@compiled
def _multiply(
    points: PointSet, weights: Weights | None, profile: Profile, means: RadialMeans, g: float
) -> tuple[float, float]:
    """Fill in the profile's ``products`` of ψ and p = (R - λ)e - α[(R - ρ)² - V]ē; returns Σψ and Σψ²."""
    rows, zero, _, _ = points
    n, d, r, twice = rows.shape[1], len(zero), profile.sphere[0], 2.0 * profile.sphere[1]
    alpha, products = means.excess01_by_s / means.variance_by_s, profile.products
    u, p, tilt = fresh(zero), fresh(zero), fresh(zero)
    for i in range(d):
        u, tilt = put(u, i, 2.0 * profile.toward[i]), put(tilt, i, alpha * _along(weights, profile, i) / n)
        fill(products[i], 0.0)
    fill(products[d], 0.0)
    fill(products[d + 1], 0.0)
    total = squares = 0.0
    for k in range(n):
        distance, excess = _distance(rows, k, r, twice, u)
        rest, away, variance, h, m = excess - means.lengthening, excess - means.excess01, means.variance, 1.0, 0
        if weights is not None:
            m, p_k = weights.group[k], weights.p[k]
            rest, away = p_k * (rest - weights.offsets[0, k]), p_k * (away - weights.offsets[1, k])
            variance, h = variance * weights.offsets[2, k], weights.sums[m, _SHARE]
            surplus = rest * rest / p_k - variance
        else:
            surplus = rest * rest - variance
        psi = h * rest - g * surplus
        for i in range(d):
            e = (rows[i, k] - r * profile.toward[i]) / distance
            psi -= profile.bend[i] * e * away
            p = put(p, i, away * e - tilt[i] * surplus)
            if weights is not None and m > 0:
                p = put(p, i, p[i] - rest * weights.sums[m, _E + i] / weights.sums[m, _SIZE])
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
def _slope(points: PointSet, weights: Weights | None, profile: Profile, means: RadialMeans, plain: float) -> float:
    """The number g of points with weights, whose sums are without them; that of others is given."""
    if weights is None:
        return plain
    d, n, r, sums, drift = profile.toward.size, points.rows.shape[1], profile.sphere[0], weights.sums, 0.0
    for k in range(n):
        square = part = 0.0
        for i in range(d):
            away = points.rows[i, k] - r * profile.toward[i]
            square += away * away
            part += profile.bend[i] * away
        drift -= part / math.sqrt(square) * sums[weights.group[k], _BENT_BY_S] / sums[weights.group[k], _SIZE]
    for g in range(sums.shape[0]):
        drift += sums[g, _SHARE] * sums[g, _LONGER_BY_S]
    return float(drift / n / means.variance_by_s)


@compiled
def score(
    points: PointSet, weights: Weights | None, profile: Profile, means: RadialMeans
) -> tuple[float, float, float]:
    """Score of a radius at its profile, which receives the standard errors of the centre given the radius.

    Args:
        points: the points.
        weights: theirs, or None.
        profile: the solution of `solve_profile`.
        means: means of R there.

    Returns:
        T, dT/dr₀ where T = 0, and the centre's largest standard error in any direction.
    """
    model, robust = profile.covariance[0], profile.covariance[1]
    n, d, r, variance = points.rows.shape[1], profile.toward.size, profile.sphere[0], means.variance
    known, first, free, own = math.nan, n * 1.0, n - d - _fitted(weights), profile.sums[2:]
    total, weight, plain, rough = _weigh(points, weights, profile, means.excess01)
    s = plain - means.excess01 * total  # then with Σp h (λ - ρ)
    if weights is None:
        s += n * (means.excess01 - means.lengthening)
    else:
        known, first, own = weights.scale[0], weights.sums[0, _SIZE], weights.own
        for m in weights.sums:
            s += m[_SHARE] * (m[_BENT] - m[_LONGER])
    _sandwich(profile.inverse, profile.scatter[0], variance / n / n, model)
    for i in range(d):
        profile.errors[i], profile.correlations[i] = math.sqrt(model[i, i]), 0.0
    along = 1.0 - total / first  # b·ē
    g = (means.mean_by_s * (total / n) + (means.mean_by_s - means.excess01_by_s) * along) / means.variance_by_s
    g = _slope(points, weights, profile, means, g)
    # Σw is Σw² but for noise and rounding, which grow without limit towards a plane: the mean part of the sum has Σw²
    bias = 0.5 * _lengthening(profile.scatter[1], model) + g * variance * n / free
    bias += 0.5 * _lengthening(own, model) * (weight - rough) / first
    rest = s - bias
    scale = (free * variance - s * s / max(weight, _TINY)) / (free - 1.0)
    if known == known:
        scale = variance
    value = abs(rest) / math.sqrt(max(weight * max(scale, 1e-12 * variance, _TINY), _TINY))
    slope = (means.excess01_by_r - means.shortening) * along - (1.0 + means.shortening) * (total / first)
    slope *= first / math.sqrt(max(variance * weight, _TINY))
    larger = 0.0
    if profile.sphere[2] * _widest(weights) >= squared(_NOISY * min(1.0, 2.0 / (d - 1.0)) * r):
        sum_psi, squares = _multiply(points, weights, profile, means, g)
        squares, products, spare = max(squares - s * s / n, _TINY), profile.products, n * (free - 1.0)
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
