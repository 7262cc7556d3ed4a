"""The score of a hypothetical radius of one of several markers about a common centre.

Given the radius of one marker, centre, noise variance and the radii of the others are profiled out. With R, e, ρ, λ and
V as in `study.fits.score`, each at its own marker's radius, they solve

    Σ (R - λ) e = 0,    Σ_p (R - ρ) = 0 for every other marker p,    Σ (R - ρ)²/(N - d - M + 1) = Σ V/N  (theory 10.7)

so that the other radii are the mean distances less what noise lengthens them by. They take the means of the directions
out of the centre's equations: K = Σ[(1 - λ/R) I + (λ/R) eeᵀ] - Σ_p n ē ēᵀ over the other markers. With g = e, less ē in
these, b = K⁻¹ n ē of the marker itself and w = -b·g, plus 1 in it, the score S is that of one marker.
"""

import math

from study.arrays import Floats
from study.fits.corrected import RadialMeans, radial_means
from study.fits.jit import compiled
from study.fits.linalg import diagonalise, eliminate
from study.fits.score import Markers, PointSet, Profile

_MAX_STEPS = 50
_TINY = 1e-280
_LARGEST_STEP = 0.5
"""Largest step of the centre, in radii."""
_CONVERGED = 1e-10
"""Squared length of the last step in standard errors."""
_STEADY = 1e-8
"""Relative change of the noise variance that ends the iteration."""
_SMALLEST = 1e-3
"""Least radius of another marker, in its mean distance: noise may explain all of that."""


@compiled
def _measure(rows: Floats, profile: Profile, markers: Markers) -> None:
    """Fill in R and e of the points, and their sums."""
    which, _, _, _, sums, seen = markers
    d, r = sums.shape[1] - 1, profile.sphere[0]
    sums[:, :] = 0.0
    for k in range(which.size):
        square = 0.0
        for i in range(d):
            seen[k, 1 + i] = rows[i, k] - r * profile.toward[i]
            square += seen[k, 1 + i] * seen[k, 1 + i]
        seen[k, 0] = math.sqrt(max(square, _TINY))
        sums[which[k], 0] += seen[k, 0]
        for i in range(d):
            seen[k, 1 + i] /= seen[k, 0]
            sums[which[k], 1 + i] += seen[k, 1 + i]


@compiled
def _set_radii(markers: Markers, radius: float, s: float) -> None:
    """Set the radii and means of all markers for a noise variance; the means before are those of the last one."""
    _, count, radii, means, sums, _ = markers
    for p in range(count.size):
        mean = sums[p, 0] / count[p]
        radii[p] = radius if p == 0 else max(mean - means[p, 0], _SMALLEST * mean)
        of = radial_means(radii[p], s, sums.shape[1] - 1)
        means[p, 0], means[p, 1], means[p, 2] = of.lengthening, of.excess01, of.variance
        means[p, 3], means[p, 4], means[p, 5] = of.mean_by_s, of.excess01_by_s, of.variance_by_s


@compiled
def _squares(markers: Markers) -> tuple[float, float, float]:
    """Σ(R - ρ)², ΣV and Σ∂V."""
    which, count, radii, means, _, seen = markers
    total = variance = by_s = 0.0
    for k in range(which.size):
        p = which[k]
        total += (seen[k, 0] - radii[p] - means[p, 0]) ** 2
    for p in range(count.size):
        variance += count[p] * means[p, 2]
        by_s += count[p] * means[p, 5]
    return total, variance, by_s


@compiled
def _fill_system(markers: Markers, matrix: Floats) -> None:
    """Write K, and Σ(R - λ)e less what the other radii take of it as the right side, to the system (d, 2d)."""
    which, count, radii, means, sums, seen = markers
    d = matrix.shape[0]
    matrix[:, :] = 0.0
    for k in range(which.size):
        p = which[k]
        ratio, away = (radii[p] + means[p, 1]) / seen[k, 0], seen[k, 0] - radii[p] - means[p, 1]
        rest = seen[k, 0] - radii[p] - means[p, 0] if p > 0 else 0.0
        for i in range(d):
            matrix[i, d] += away * seen[k, 1 + i] - rest * sums[p, 1 + i] / count[p]
            matrix[i, i] += 1.0 - ratio
            for j in range(d):
                matrix[i, j] += ratio * seen[k, 1 + i] * seen[k, 1 + j]
    for p in range(1, count.size):
        for i in range(d):
            for j in range(d):
                matrix[i, j] -= sums[p, 1 + i] * sums[p, 1 + j] / count[p]


@compiled
def solve_joint(points: PointSet, profile: Profile, markers: Markers) -> tuple[bool, RadialMeans]:
    """Solve for centre, noise variance and the other radii, from the centre of ``profile``; False without success.

    The profile receives the solution, K⁻¹ and b. The means of R at it are those of the first marker.
    """
    sphere, toward, matrix, count = profile.sphere, profile.toward, profile.system, markers.size
    n, d, r = markers.which.size, toward.size, sphere[0]
    spare, done = n - d - count.size + 1.0, False
    markers.means[:, :] = 0.0
    for turn in range(_MAX_STEPS):
        _measure(points.rows, profile, markers)
        _set_radii(markers, r, 0.0 if turn == 0 else sphere[2])
        squares, variance, _ = _squares(markers)
        before = sphere[2]
        if turn == 0:
            sphere[2] = max(squares / spare, 0.1 * points.least)
            _set_radii(markers, r, sphere[2])
        else:
            sphere[2] = max(before * (squares / spare) / max(variance / n, _TINY), 0.1 * points.least)
        _fill_system(markers, matrix)
        if done or not squares < math.inf:
            break
        if not eliminate(matrix, 1):
            break
        length = 0.0
        for i in range(d):
            length += matrix[i, d] * matrix[i, d]
        length = math.sqrt(length)
        if not length < math.inf:
            break
        scale = min(1.0, _LARGEST_STEP * r / max(length, _TINY))
        for i in range(d):
            toward[i] += scale * matrix[i, d] / r
        steady = turn > 0 and abs(sphere[2] - before) <= _STEADY * before
        done = n * length * length <= _CONVERGED * sphere[2] and steady
        done = done or (sphere[2] < points.least and before < points.least)
    means = radial_means(r, sphere[2], d)
    if not done:
        return False, means
    for i in range(d):
        for j in range(d):
            matrix[i, d + j] = 1.0 if i == j else 0.0
    fine = eliminate(matrix, d)
    for i in range(d):
        profile.bend[i] = 0.0
        for j in range(d):
            profile.inverse[i, j] = n * matrix[i, d + j]
            profile.bend[i] += matrix[i, d + j] * markers.sums[0, 1 + j]
    return fine, means


@compiled
def _covariance(profile: Profile, markers: Markers) -> None:
    """Write the covariance of the centre given the radius, K⁻¹ Σ V g gᵀ K⁻ᵀ, to the profile."""
    which, count, _, means, sums, seen = markers
    inverse, middle, result, n = profile.inverse, profile.scatter[0], profile.covariance[0], which.size
    d = inverse.shape[0]
    middle[:, :] = 0.0
    for k in range(n):
        for i in range(d):
            for j in range(d):
                middle[i, j] += means[which[k], 2] * seen[k, 1 + i] * seen[k, 1 + j]
    for p in range(1, count.size):
        for i in range(d):
            for j in range(d):
                middle[i, j] -= means[p, 2] * sums[p, 1 + i] * sums[p, 1 + j] / count[p]
    for i in range(d):
        for j in range(d):
            result[i, j] = 0.0
            for k in range(d):
                for m in range(d):
                    result[i, j] += inverse[i, k] * middle[k, m] * inverse[j, m] / n / n


@compiled
def joint_score(profile: Profile, markers: Markers) -> tuple[float, float, float]:
    """Score of a radius at its profile, which receives the standard errors of the centre given the radius.

    Returns:
        T, dT/dr₀ where T = 0, and the centre's largest standard error in any direction.
    """
    which, count, radii, means, sums, seen = markers
    n, d, bend, model = which.size, profile.toward.size, profile.bend, profile.covariance[0]
    _covariance(profile, markers)
    spare = n - d - count.size + 1.0
    squares, variance, by_s = _squares(markers)
    trace = score = weight = bias = own = longer = 0.0
    for i in range(d):
        trace += model[i, i]
    for k in range(n):
        p = which[k]
        rest, w, across, along, mean = seen[k, 0] - radii[p] - means[p, 0], 0.0, trace, 0.0, 0.0
        for i in range(d):
            e = seen[k, 1 + i]
            along += bend[i] * e
            mean += bend[i] * sums[p, 1 + i] / count[p] if p > 0 else 0.0
            for j in range(d):
                across -= e * model[i, j] * seen[k, 1 + j]
        w = (1.0 if p == 0 else mean) - along
        score += w * rest + along * (means[p, 1] - means[p, 0])
        weight += w * w * means[p, 2] * n / variance
        bias += 0.5 * w * across / seen[k, 0]
        if p == 0:
            own, longer = own + w, longer + across / seen[k, 0]
    bias += 0.5 * longer / count[0] * (weight - own)  # Σw is Σw² but for noise and rounding, as for one marker
    drift = count[0] * means[0, 3]  # less the derivative of S by s
    for p in range(count.size):
        for i in range(d):
            drift -= bend[i] * sums[p, 1 + i] * (means[p, 4] - (means[p, 3] if p > 0 else 0.0))
    bias += drift / by_s * variance / spare
    scale = max((squares - score * score / max(weight, _TINY)) / (spare - 1.0), 1e-12 * variance / n, _TINY)
    value = (score - bias) / math.sqrt(max(weight * scale, _TINY))
    for i in range(d):
        profile.errors[i], profile.correlations[i] = math.sqrt(model[i, i]), 0.0
    diagonalise(model, profile.axes)
    spread = math.sqrt(max(model[d - 1, d - 1], 0.0))
    return value, -math.sqrt(weight * n / max(variance, _TINY)), spread
