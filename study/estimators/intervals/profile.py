"""Centre and noise variance profiled out: their estimates for a hypothetical radius r₀.

With R = |x - c|, e = (x - c)/R, and ρ = E R, λ = r₀/E e·u, V = Var R at (r₀, s) (`study.sphere.radial`), the d + 1
equations

    Σ (R - λ) e = 0,        Σ (R - ρ)²/(N - d) = V                                                (theory 10.1)

determine c and s = σ². Given the radius both are strongly identified on a cap, however weak its curvature is.

A sphere is stored by its radius, the direction u = c/r₀ and its height h = (|c|² - r₀²)/2r₀ about an origin near the
points: then R - r₀ has an error of the points' own size times 2⁻⁵², also where the radius is many times that size.
"""

import math
from typing import NamedTuple

from study.sphere.jit import Sums, compiled, fresh, put
from study.sphere.radial import RadialMeans, radial_means
from study.sphere.types import Floats

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
