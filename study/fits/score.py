"""The score of a hypothetical radius: a studentised sum of deviations that noise and directions leave with mean zero.

At the profile of r₀ (`profile.py`) with b = J⁻¹ē, w = 1 - b·e and S = Σ(R - ρ),

    T_F² = ((S - β)²/Σw²) / [(Σ(R - ρ)² - S²/Σw²)/(N - d - 1)],
    T_H² = (N - d - 1)/N · (S - β)²/(Σψ² - S²/N),                                                  (theory 10.2)
    ψ = (R - ρ) - b·e (R - λ) - g [(R - ρ)² - V],    g = (∂ρ - ∂λ b·ē)/∂V,    ∂ = ∂/∂s.

β is the bias that the errors of centre and noise give S. T has the sign of S - β. It is T_F
where σ is below a fifth of r₀, else the one of T_F and T_H that is closer to zero.

Centre and noise variance profiled out: their estimates for a hypothetical radius r₀.

With R = |x - c|, e = (x - c)/R, and ρ = E R, λ = r₀/E e·u, V = Var R at (r₀, s) (`study.fits.radial`), the d + 1
equations

    Σ (R - λ) e = 0,        Σ (R - ρ)²/(N - d) = V                                                (theory 10.1)

determine c and s = σ². Given the radius both are strongly identified on a cap, however weak its curvature is.

A sphere is stored by its radius, the direction u = c/r₀ and its height h = (|c|² - r₀²)/2r₀ about an origin near the
points: then R - r₀ has an error of the points' own size times 2⁻⁵², also where the radius is many times that size.
"""

import math
from typing import NamedTuple

from study.arrays import Floats
from study.fits.jit import Sums, compiled, fill, fresh, put
from study.fits.linalg import diagonalise
from study.fits.radial import RadialMeans, radial_means

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


class Cloud(NamedTuple):
    """The points of one set, relative to their centroid and in units of their spread.

    Attributes:
        rows: coordinates, then |x|² in the last row (d+1, at least n).
        size: number of points n.
        zero: d sums at zero.
        square: d² sums at zero.
    """

    rows: Floats
    size: int
    zero: Sums
    square: Sums


class Sphere(NamedTuple):
    """A sphere about a cloud, stored so that distances from it do not cancel.

    Attributes:
        numbers: radius r₀, height h and noise variance s (3,).
        toward: u = c/r₀ (d,).
    """

    numbers: Floats
    toward: Floats


class ProfileRoom(NamedTuple):
    """Working memory: sums of a pass, a matrix with right sides (d, 2d), the inverse of J (d, d), and b = J⁻¹ē (d,)."""

    sums: Floats
    matrix: Floats
    inverse: Floats
    pull: Floats


@compiled
def set_height(sphere: Sphere, center: Floats) -> None:
    """Place a sphere of the given radius about a centre (d,)."""
    numbers, toward = sphere
    square = 0.0
    for i in range(center.size):
        toward[i] = center[i] / numbers[0]
        square += center[i] * center[i]
    length = math.sqrt(square)
    numbers[1] = 0.5 * (length - numbers[0]) * (length + numbers[0]) / numbers[0]


@compiled
def _pass(cloud: Cloud, sphere: Sphere, sums: Floats) -> None:
    """Sums over the points: Σa, Σa², Σae, Σe and, in its lower triangle, Σeeᵀ/R, where a = R - r₀."""
    rows, n, zero, square = cloud
    d = len(zero)
    r, twice = sphere.numbers[0], 2.0 * sphere.numbers[1]
    u, center, e, pull, mean, curve = fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(zero), fresh(square)
    for i in range(d):
        u = put(u, i, 2.0 * sphere.toward[i])
        center = put(center, i, r * sphere.toward[i])
    inverse, total, squares = 1.0 / r, 0.0, 0.0
    for k in range(n):
        g = rows[d, k] * inverse + twice
        for i in range(d):
            g -= u[i] * rows[i, k]
        distance = math.sqrt(max(r * (r + g), _TINY))
        over = 1.0 / distance
        a = g * r / (r + distance)
        total += a
        squares += a * a
        for i in range(d):
            e = put(e, i, (rows[i, k] - center[i]) * over)
            mean = put(mean, i, mean[i] + e[i])
            pull = put(pull, i, pull[i] + e[i] * a)
            weighted = e[i] * over
            for j in range(i + 1):
                curve = put(curve, i * d + j, curve[i * d + j] + weighted * e[j])
    sums[0] = total
    sums[1] = squares
    for i in range(d):
        sums[2 + i] = pull[i]
        sums[2 + d + i] = mean[i]
    for i in range(d * d):
        sums[2 + 2 * d + i] = curve[i]


@compiled
def _reduce(matrix: Floats, columns: int) -> bool:
    """Solve d equations with so many right sides, which stand beside the matrix, in place; False if singular."""
    d = matrix.shape[0]
    wide = d + columns
    for j in range(d):
        best = j
        for i in range(j + 1, d):
            if abs(matrix[i, j]) > abs(matrix[best, j]):
                best = i
        if not abs(matrix[best, j]) > _TINY:
            return False
        for k in range(wide):
            matrix[j, k], matrix[best, k] = matrix[best, k], matrix[j, k]
        over = 1.0 / matrix[j, j]
        for k in range(wide):
            matrix[j, k] *= over
        for i in range(d):
            if i != j:
                factor = matrix[i, j]
                for k in range(wide):
                    matrix[i, k] -= factor * matrix[j, k]
    return True


@compiled
def _jacobian(n: int, curvature: float, sums: Floats, matrix: Floats) -> None:
    """J = mean[(1 - λ/R) I + (λ/R) eeᵀ], given λ."""
    d = matrix.shape[0]
    inverse = 0.0
    for i in range(d):
        inverse += sums[2 + 2 * d + i * d + i]
    for i in range(d):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = curvature * sums[2 + 2 * d + i * d + j] / n
        matrix[i, i] += 1.0 - curvature * inverse / n


@compiled
def _variance_step(cloud: Cloud, means: RadialMeans, sums: Floats) -> tuple[float, float, float]:
    """Excess of the second equation and its derivative by s, and the factor of Σ(R - ρ)e in that by the centre."""
    n, d = cloud.size, len(cloud.zero)
    spare = n - d
    mean = means.lengthening
    excess = (sums[1] - 2.0 * mean * sums[0] + n * mean * mean) / spare - means.variance
    slope = -2.0 * means.mean_by_s * (sums[0] - n * mean) / spare - means.variance_by_s
    return excess, slope, -2.0 / spare


@compiled
def profile(cloud: Cloud, sphere: Sphere, room: ProfileRoom, least: float) -> tuple[bool, RadialMeans]:
    """Solve for centre and noise variance, from those of ``sphere``, by Newton's method; the radius stays.

    Args:
        cloud: the points, more than d + 1.
        sphere: starting values; receives the solution.
        room: receives J⁻¹ and b.
        least: noise variance that counts as none.

    Returns:
        False if the iteration did not converge; and the means of R at the solution.
    """
    n, d = cloud.size, len(cloud.zero)
    numbers, toward = sphere
    sums, matrix, inverse, pull = room
    r = numbers[0]
    means, done, fine = radial_means(r, 1.0, 2), False, False
    for _ in range(_MAX_STEPS):
        means = radial_means(r, numbers[2], d)
        if done:
            fine = True
            break
        _pass(cloud, sphere, sums)
        shift = means.excess01
        excess, slope, factor = _variance_step(cloud, means, sums)
        if not (abs(slope) > 1e-3 and sums[1] < math.inf):
            break
        _jacobian(n, r + shift, sums, matrix)
        by_s = means.excess01_by_s / slope
        for i in range(d):
            mean = sums[2 + d + i] / n
            for j in range(d):
                matrix[i, j] -= by_s * mean * factor * (sums[2 + j] - means.lengthening * sums[2 + d + j])
            matrix[i, d] = sums[2 + i] / n - shift * mean + by_s * mean * excess
        if not _reduce(matrix, 1):
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
            change += factor * (sums[2 + i] - means.lengthening * sums[2 + d + i]) * step
            forward += (sums[2 + i] - shift * sums[2 + d + i]) * step  # n times the length squared, measured by J
            numbers[1] += step * (toward[i] + 0.5 * step / r)
            toward[i] += step / r
        before = numbers[2]
        numbers[2] = max(before - (excess + change) / slope, _DROP * before, 0.1 * least)
        steady = abs(numbers[2] - before) <= _STEADY * before
        short = abs(forward) <= _CONVERGED * numbers[2] and length <= 1e-2 * r
        done = (short and steady) or (numbers[2] < least and before < least)
    if fine:
        _jacobian(n, r + means.excess01, sums, matrix)
        for i in range(d):
            for j in range(d):
                matrix[i, d + j] = 1.0 if i == j else 0.0
        fine = _reduce(matrix, d)
        for i in range(d):
            pull[i] = 0.0
            for j in range(d):
                inverse[i, j] = matrix[i, d + j]
                pull[i] += inverse[i, j] * sums[2 + d + j] / n
    return fine, means


_NOISY = 0.2
"""Noise, in radii, from which on the score is also studentised by its own sum of squares."""


class Score(NamedTuple):
    """The score at one radius: T, dT/dr₀ where T = 0, and the centre's largest standard error in any direction."""

    value: float
    slope: float
    spread: float


class Beside(NamedTuple):
    """Moments of the centre's estimate given r₀, and working memory.

    Attributes:
        sums: sums of the score's pass: Σeeᵀ, then Σw eeᵀ/R in its lower triangle (2, d²).
        products: Σpψ (d,), Σp (d,), Σppᵀ (d²), Σψ, Σψ², where p is the centre's own score.
        model: covariance of the centre, as noise of constant variance makes it (d, d).
        robust: the same by its own sum of squares (d, d).
        vectors: working memory (d, d).
        error: standard errors of the centre's coordinates (d,).
        correlation: their correlations with the score (d,).
    """

    sums: Floats
    products: Floats
    model: Floats
    robust: Floats
    vectors: Floats
    error: Floats
    correlation: Floats


@compiled
def _weigh(
    cloud: Cloud, sphere: Sphere, pull: Floats, excess: float, sums: Floats
) -> tuple[float, float, float, float]:
    """Σw, Σw², Σw(R - r₀) and a rough Σw, given λ - r₀; Σeeᵀ and Σw eeᵀ/R to ``sums``.

    On a small cap w is of second order in its angle and Σw of fourth. So each w is formed by itself, and Σw from Σw²
    and the difference of J and mean eeᵀ: N b·(J - mean eeᵀ)b = Σ (1 - λ/R)(|b|² - (b·e)²).
    The rough one adds up the w, and has their rounding.
    """
    rows, n, zero, square = cloud
    d = len(zero)
    r, twice = sphere.numbers[0], 2.0 * sphere.numbers[1]
    u, center, e, b = fresh(zero), fresh(zero), fresh(zero), fresh(zero)
    scatter, bend = fresh(square), fresh(square)
    length = 0.0
    for i in range(d):
        u = put(u, i, 2.0 * sphere.toward[i])
        center = put(center, i, r * sphere.toward[i])
        b = put(b, i, pull[i])
        length += pull[i] * pull[i]
    inverse, total, squares, score, rough = 1.0 / r, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        g = rows[d, k] * inverse + twice
        for i in range(d):
            g -= u[i] * rows[i, k]
        distance = math.sqrt(max(r * (r + g), _TINY))
        over = 1.0 / distance
        w = 1.0
        for i in range(d):
            e = put(e, i, (rows[i, k] - center[i]) * over)
            w -= b[i] * e[i]
        for i in range(d):
            weighted = w * over * e[i]
            for j in range(i + 1):
                scatter = put(scatter, i * d + j, scatter[i * d + j] + e[i] * e[j])
                bend = put(bend, i * d + j, bend[i * d + j] + weighted * e[j])
        a = g * r / (r + distance)
        total += (a - excess) * over * (length - (1.0 - w) * (1.0 - w))
        squares += w * w
        score += w * a
        rough += w
    for i in range(d * d):
        sums[0, i], sums[1, i] = scatter[i], bend[i]
    return squares + total, squares, score, rough


@compiled
def _multiply(cloud: Cloud, sphere: Sphere, pull: Floats, means: RadialMeans, alpha: float, products: Floats) -> None:
    """Sums of squares and products of ψ and p = (R - λ)e - α[(R - ρ)² - V]ē', given ē' and g in ``products``."""
    rows, n, zero, _ = cloud
    d = len(zero)
    r, twice = sphere.numbers[0], 2.0 * sphere.numbers[1]
    g_factor = products[d]
    p, tilt = fresh(zero), fresh(zero)
    for i in range(d):
        tilt = put(tilt, i, products[i] * alpha)
    fill(products, 0.0)
    for k in range(n):
        g = rows[d, k] / r + twice
        for i in range(d):
            g -= 2.0 * sphere.toward[i] * rows[i, k]
        distance = math.sqrt(max(r * (r + g), _TINY))
        a = g * r / (r + distance)
        rest, away = a - means.lengthening, a - means.excess01
        surplus = rest * rest - means.variance
        psi = rest - g_factor * surplus
        for i in range(d):
            e = (rows[i, k] - r * sphere.toward[i]) / distance
            psi -= pull[i] * e * away
            p = put(p, i, away * e - tilt[i] * surplus)
        for i in range(d):
            products[i] += p[i] * psi
            products[d + i] += p[i]
            for j in range(d):
                products[2 * d + i * d + j] += p[i] * p[j]
        products[2 * d + d * d] += psi
        products[2 * d + d * d + 1] += psi * psi


@compiled
def _sandwich(inverse: Floats, middle: Floats, factor: float, result: Floats) -> None:
    """A M Aᵀ times a factor; of the symmetric M the lower triangle is read."""
    d = inverse.shape[0]
    for i in range(d):
        for j in range(d):
            total = 0.0
            for k in range(d):
                for m in range(d):
                    total += inverse[i, k] * middle[max(k, m) * d + min(k, m)] * inverse[j, m]
            result[i, j] = total * factor


@compiled
def _lengthening(scatter: Floats, covariance: Floats) -> float:
    """Σ f tr[(I - eeᵀ)C], given Σ f eeᵀ in its lower triangle, with any factors f."""
    d = covariance.shape[0]
    every = along = trace = 0.0
    for i in range(d):
        every += scatter[i * d + i]
        trace += covariance[i, i]
        along += scatter[i * d + i] * covariance[i, i]
        for j in range(i):
            along += 2.0 * scatter[i * d + j] * covariance[i, j]
    return every * trace - along


@compiled
def score(cloud: Cloud, sphere: Sphere, room: ProfileRoom, means: RadialMeans, beside: Beside) -> Score:
    """Score of a radius at its profile; fills in the standard errors of the centre given the radius.

    Args:
        cloud: the points.
        sphere: the profile.
        room: J⁻¹ and b of the profile.
        means: means of R there.
        beside: receives standard errors and correlations.
    """
    n, d = cloud.size, len(cloud.zero)
    r, variance = sphere.numbers[0], means.variance
    spare = n - d - 1.0
    total, weight, plain, rough = _weigh(cloud, sphere, room.pull, means.excess01, beside.sums)
    s = plain - means.excess01 * total + n * (means.excess01 - means.lengthening)
    _sandwich(room.inverse, beside.sums[0], variance / n / n, beside.model)
    for i in range(d):
        beside.error[i], beside.correlation[i] = math.sqrt(beside.model[i, i]), 0.0
    along = 1.0 - total / n  # b·ē
    by_noise = means.mean_by_s * (total / n) + (means.mean_by_s - means.excess01_by_s) * along
    g = by_noise / means.variance_by_s
    # Σw is Σw² but for noise and rounding, which grow without limit towards a plane: the mean part of the sum has Σw²
    lengthening = _lengthening(beside.sums[1], beside.model)
    lengthening += _lengthening(room.sums[2 + 2 * d :], beside.model) * (weight - rough) / n
    rest = s - 0.5 * lengthening - g * variance * n / (n - d)
    explained = s * s / max(weight, _TINY)
    scale = max(((n - d) * variance - explained) / spare, 1e-12 * variance, _TINY)
    value = abs(rest) / math.sqrt(max(weight * scale, _TINY))
    slope = (means.excess01_by_r - means.shortening) * along - (1.0 + means.shortening) * (total / n)
    slope *= n / math.sqrt(max(variance * weight, _TINY))
    larger = False
    if sphere.numbers[2] >= (_NOISY * r) ** 2:
        products = beside.products
        for i in range(d):
            products[i] = room.sums[2 + d + i] / n
        products[d] = g
        _multiply(cloud, sphere, room.pull, means, means.excess01_by_s / means.variance_by_s, products)
        last = 2 * d + d * d
        squares = max(products[last + 1] - s * s / n, _TINY)
        value = min(value, abs(rest) * math.sqrt(spare / n / squares))
        _sandwich(room.inverse, products[2 * d : last], 1.0 / (n * spare), beside.robust)
        trace = 0.0
        for i in range(d):
            trace += beside.robust[i, i] - beside.model[i, i]
            both = 0.0
            for j in range(d):
                both += room.inverse[i, j] * (products[j] - products[d + j] * products[last] / n)
            both /= math.sqrt(max(beside.robust[i, i] * n * spare, _TINY) * squares)
            beside.correlation[i] = min(max(both, -1.0), 1.0)
            beside.error[i] = math.sqrt(max(beside.model[i, i], beside.robust[i, i]))
        larger = trace > 0.0
    if larger:
        for i in range(d):
            for j in range(d):
                beside.model[i, j] = beside.robust[i, j]
    diagonalise(beside.model, beside.vectors)
    spread = math.sqrt(max(beside.model[d - 1, d - 1], 0.0))
    return Score(value if rest >= 0.0 else -value, slope, spread)
