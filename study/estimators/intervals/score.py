"""The score of a hypothetical radius: a studentised sum of deviations that noise and directions leave with mean zero.

At the profile of r₀ (`profile.py`) with b = J⁻¹ē, w = 1 - b·e and S = Σ(R - ρ),

    T_F² = ((S - β)²/Σw²) / [(Σ(R - ρ)² - S²/Σw²)/(N - d - 1)],
    T_H² = (N - d - 1)/N · (S - β)²/(Σψ² - S²/N),                                                  (theory 10.2)
    ψ = (R - ρ) - b·e (R - λ) - g [(R - ρ)² - V],    g = (∂ρ - ∂λ b·ē)/∂V,    ∂ = ∂/∂s.

β is the bias that the errors of centre and noise give S. T has the sign of S - β. It is T_F
where σ is below a fifth of r₀, else the one of T_F and T_H that is closer to zero.
"""

import math
from typing import NamedTuple

from study.estimators.intervals.profile import Cloud, ProfileRoom, Sphere
from study.sphere.jit import compiled, fill, fresh, put
from study.sphere.linalg import diagonalise
from study.sphere.radial import RadialMeans
from study.sphere.types import Floats

_TINY = 1e-280
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
