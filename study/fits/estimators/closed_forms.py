"""The Delogne-Kása family: ĉ = x̄ + ½ (C - ηI)⁻¹ S, with a rule for η that defines the member.

Kåsa's fit minimises the algebraic distance (paper eq. 1) and has a closed form in the first moments of the data. Its
bias comes from one term alone: noise adds Σ to the sample covariance C (eq. 10) while S stays unbiased (eq. 12, exact
at every n). Subtracting the noise again removes the bias. All members share the formulas below and differ in what
they subtract: nothing (GDKE), the known noise (UGDK), or noise found in the points themselves.

About an origin o that is not the centroid, with y = x - o and q = Cov(y, |y|²), the same fit is

    ĉ - o = (C - ηI)⁻¹ (½q - ηȳ),      r̂² = mean |y|² - 2 (ĉ - o)·ȳ + |ĉ - o|² + wη,               (theory 8.1)

with w = 0 for GDKE and -d for UGDK.

Members of the family that find the noise in the points themselves: η is the root of one equation.

With centred moments of weight 1/n, every classical algebraic fit is ĉ = x̄ + ½ (C - ηI)⁻¹ s with η the smallest root of

    g(η) = m₄ - m₂² - 4ηm₂ + ϰη² - sᵀ(C - ηI)⁻¹s                                               (theory 5.1)

and one constant ϰ each. g falls strictly on [0, λ_min), from g(0) = Var f ≥ 0 to -∞: the root is unique and C - ηI is
always positive definite. For ϰ = 2d the equation says that the variance of the algebraic residuals f equals its
theoretical value 4r²η + 2dη²: UGDK that measures its own noise.

UGDK with the whole noise covariance estimated from the points: the question that the paper leaves open.

About the centre, v = x - c and f = |v|² - mean |v|². For Gaussian noise of covariance Σ the moments of f² v vᵀ obey

    E f²vvᵀ - E f² Σ - 8ΣPΣ - 8Σ³ - 8(PΣ² + Σ²P) = 4 Q : Σ + 2 tr(Σ²) P,      P = E vvᵀ - Σ = r² E uuᵀ,
    Q = E vvvv - sym₆(P, Σ) - sym₃(Σ, Σ) = r⁴ E uuuu,                                              (theory §5.4)

linear in Σ up to small terms, which come from the step before. A step solves them for Σ, projects it on positive
semidefinite matrices, and computes the centre again; a dozen steps start from `als`. On small caps the noise across the
axis is not observed; a little of the isotropic answer is mixed in for it, and the centre does not need it.
"""

import math

import numpy as np
from scipy.special import fdtri

from study.arrays import Bools, Floats
from study.fits.loops.jit import CHUNK, compiled, dot, fill, squared, total
from study.fits.loops.linalg import eigenbasis
from study.fits.points.moments import Regression
from study.fits.points.samples import Estimates, Samples, Status, blank, remove

_EPS = 2.0**-52


def gdke(samples: Samples) -> Estimates:
    """Generalised Delogne-Kása estimator: nothing is subtracted (η = 0).

    Fast, and biased towards the centroid by (C₀ + Σ)⁻¹Σ(c₀ - μ̄) however many samples there are.

    Source: paper eqs 2-6; Kåsa 1976.
    """
    return member(samples, np.zeros(samples.shape[0]), 0.0)


def ugdk(samples: Samples) -> Estimates:
    """Unbiased GDK: the known noise is subtracted (η = σ², or the whole Σ).

    Where C - Σ̂ is not positive definite the paper's formula still gives a number. It is returned unchanged, with the
    status that says so and the condition ρ ≥ 1.

    Raises:
        ValueError: if the samples come without a noise.

    Source: paper eqs 15-21.
    """
    if samples.noise is None:
        raise ValueError("ugdk subtracts the known noise: pass noise=σ or a covariance, or use als, which finds it")
    b, d, _ = samples.shape
    noise = np.asarray(samples.noise)
    if noise.ndim == 2:
        return subtracting(samples, np.broadcast_to(noise, (b, d, d)))
    fit = member(samples, np.zeros(b) + noise**2, -float(d))
    return _with_noise(fit, np.zeros(b) + noise**2)


def member(samples: Samples, eta: Floats, radius_weight: float | Floats, kept: Bools | None = None) -> Estimates:
    """The family's fit for a given η.

    Args:
        samples: the batch.
        eta: η, which is subtracted from C, per set (b,); 0 where nothing is.
        radius_weight: w: the radius is r̂² = (n-1)/n (Tr C + wη) + |ĉ - x̄|².
        kept: eigen-directions of C that take part (b, d), all if None; along the others the centre is the centroid's.

    Returns:
        The fit, its noise variance estimated from the residuals.
    """
    regression = samples.regression
    b, d, _ = regression.axes.shape
    fit, weight = blank(b, d), np.zeros(b) + radius_weight
    kept = every(b, d) if kept is None else kept
    _member(regression, eta, weight, kept, fit)
    return fit


def every(batch: int, dimension: int) -> Bools:
    """All eigen-directions of C take part."""
    kept = np.empty((batch, dimension), dtype=np.bool_)
    kept.fill(True)  # np.ones takes 0.8 µs more, of the 36 of one small fit
    return kept


def subtracting(samples: Samples, noise: Floats) -> Estimates:
    """The family's fit with a covariance Σ̂ (b, d, d) of each set's own subtracted from C."""
    r = samples.regression
    b, d = r.mean.shape
    remaining, basis = eigenbasis(r.covariance - noise)
    right = r.vectors[2] - 2.0 * np.einsum("bij,bj->bi", noise, r.mean)
    with np.errstate(all="ignore"):
        right = np.einsum("bji,bj->bi", basis, right)
    offset, fit, kept = np.empty((b, d)), blank(b, d), every(b, d)
    left = r._replace(along=np.stack([remaining, right, np.zeros((b, d))]), axes=basis)
    _offsets(left, np.zeros(b), kept, offset)
    with np.errstate(all="ignore"):  # the largest eigenvalue of Λ^-½ Vᵀ Σ̂ V Λ^-½, which is symmetric, is ρ(Σ̂C⁻¹)
        scaled = r.axes / np.sqrt(r.eigenvalues)[:, None, :]
        similar = np.einsum("bji,bjk,bkl->bil", scaled, noise, scaled)
    fit.condition[:] = eigenbasis(similar)[0][:, -1]
    trace = np.trace(noise, axis1=1, axis2=2)
    _conclude(r, offset, -(r.n - 1.0) / r.n * trace, kept, fit)
    return _with_noise(fit, trace / d)


def _with_noise(fit: Estimates, variance: Floats) -> Estimates:
    """Put a known noise variance (b,) in place of that of the residuals, where there is a sphere."""
    known = (fit.status != Status.SINGULAR) & (fit.status != Status.NOT_FINITE)
    fit.noise_variance[known] = variance[known]
    return fit


def residual_noise(regression: Regression, offset: Floats) -> Floats:
    """Noise variance σ² (b,) that explains the algebraic residuals f = |x - c|² - r² of a sphere about o + offset.

    Below σ ≈ 1e-8 r it shows nothing but the rounding of the moments.
    """
    noise, scratch = np.empty(len(offset)), np.empty(len(offset))
    _residuals(regression, offset, scratch, noise)
    return noise


@compiled
def noise_of_residuals(variance: float, mean_square: float, n: float, dimension: int) -> float:
    """Solve Var f = 4r²σ² + 2dσ⁴ for σ², with r² = mean |x - c|² - dσ² (theory §5.2).

    A fit of d + 1 parameters leaves the share (n - d - 1)/n of the variance, which is corrected for; NaN at n = d + 1,
    which leaves none.
    """
    if not n > dimension + 1:
        return math.nan
    variance = max(variance, 0.0) if variance == variance else math.nan
    root = 4.0 * mean_square * mean_square - 2.0 * dimension * variance
    root = math.sqrt(max(root, 0.0)) if root == root else math.nan
    return variance / (2.0 * mean_square + root) * n / (n - dimension - 1.0)


@compiled
def _offsets(regression: Regression, eta: Floats, kept: Bools, offset: Floats) -> None:
    """(C - ηI)⁻¹ (½q - ηȳ), paper eqs 2 and 17, from the eigenbasis of C."""
    along, axes = regression.along, regression.axes
    values, cross, mean = along[0], along[1], along[2]
    b, d = values.shape
    for t in range(b):
        for i in range(d):
            offset[t, i] = 0.0
        for k in range(d):
            component = mean[t, k]
            if kept[t, k]:
                component = (0.5 * cross[t, k] - eta[t] * component) / (values[t, k] - eta[t])
            for i in range(d):
                offset[t, i] += axes[t, i, k] * component


@compiled
def _least(values: Floats, kept: Bools, t: int) -> float:
    """The least eigenvalue of C that takes part."""
    for k in range(values.shape[1]):
        if kept[t, k]:
            return values[t, k]  # type: ignore[no-any-return]
    return math.inf


@compiled
def _residuals(regression: Regression, offset: Floats, excess: Floats, noise: Floats) -> None:
    """Mean |x - ĉ|², less the base, and the noise that the variance of |x - ĉ|² shows."""
    numbers, vectors, covariance, _, _ = regression
    n, variance, square, base = numbers[0], numbers[1], numbers[2], numbers[3]
    mean, cross = vectors[1], vectors[2]
    b, d = offset.shape
    for t in range(b):
        spread, total = variance[t], square[t]
        weight = (n[t] - 1.0) / n[t]
        for i in range(d):
            linear = 0.0
            for j in range(d):
                linear += covariance[t, i, j] * offset[t, j]
            spread += 4.0 * weight * offset[t, i] * (linear - cross[t, i])
            total += offset[t, i] * (offset[t, i] - 2.0 * mean[t, i])
        excess[t] = total
        noise[t] = noise_of_residuals(spread, base[t] + total, n[t], d)


@compiled
def _conclude(regression: Regression, offset: Floats, radius_term: Floats, kept: Bools, fit: Estimates) -> None:
    """Fill in the fits whose centre is o + offset (paper eqs 3, 18, 21), with the statuses that follow from C and ρ.

    ``radius_term`` is the difference between the radius squared and the mean of |x - ĉ|². ``fit.condition`` is given.
    """
    origin, variance, base = regression.vectors[0], regression.numbers[1], regression.numbers[3]
    center, radius, noise, condition, status, _ = fit
    values = regression.along[0]
    b, d = offset.shape
    excess = np.empty(b)
    _residuals(regression, offset, excess, noise)
    for t in range(b):
        if condition[t] >= 1.0:
            status[t] = Status.NOT_POSITIVE_DEFINITE
        if not _least(values, kept, t) > d * _EPS * values[t, d - 1]:
            status[t] = Status.SINGULAR
        if not abs(variance[t]) < math.inf:
            status[t] = Status.NOT_FINITE
        if status[t] == Status.SINGULAR or status[t] == Status.NOT_FINITE:
            noise[t] = condition[t] = math.nan
            continue
        for i in range(d):
            center[t, i] = origin[t, i] + offset[t, i]
        beyond = excess[t] + radius_term[t]
        total = base[t] + beyond
        if total >= 0.0:
            radius[t] = math.sqrt(total)
            if base[t] > 0.0:  # the error of the radius, without the radius
                radius[t] = beyond / (radius[t] + math.sqrt(base[t]))


@compiled
def _member(regression: Regression, eta: Floats, weight: Floats, kept: Bools, fit: Estimates) -> None:
    """Fill in the family's fits for given η, and ρ = η/λ_min."""
    n, values = regression.numbers[0], regression.along[0]
    b, d = values.shape
    offset, radius_term = np.empty((b, d)), np.empty(b)
    _offsets(regression, eta, kept, offset)
    for t in range(b):
        fit.condition[t] = eta[t] / _least(values, kept, t) if eta[t] > 0.0 else math.nan
        radius_term[t] = (n[t] - 1.0) / n[t] * weight[t] * eta[t]
    _conclude(regression, offset, radius_term, kept, fit)


_MAX_STEPS = 200
_FULLER = (2.0, 7.0)
"""Fuller's constant α where the points determine the curvature well, and where they do not."""
_SEEN = 5.0
"""Wald statistic of the curvature at which α is halfway: noise on a plane exceeds it once in forty times."""
_THREE_SIGMA = 0.0027
"""Share of a Gaussian beyond three standard deviations on both sides."""


@compiled
def smallest_root(values: Floats, cross: Floats, mean: Floats, square: float, spread: float, kappa: float) -> float:
    """Root η of g in [0, λ_min) by Newton's method inside a bracket.

    About any origin o, with y = x - o (theory 8.2),

        g(η) = Var |y|² - 4η mean |y|² + ϰη² - Σ (q_k - 2ηȳ_k)²/(λ_k - η)

    over the eigen-directions k of C; a direction without components takes no part. ``square`` is the mean of |y|²,
    ``spread`` the variance. Written from g(0), so that a small root is not lost in large terms.
    """
    d = values.size
    start, top, extent = spread, math.inf, 0.0
    for k in range(d):
        extent += values[k]
        if cross[k] != 0.0 or mean[k] != 0.0:
            start -= cross[k] * cross[k] / values[k]
            top = min(top, values[k])
    if not (start > 0.0 and top > 0.0):
        return 0.0
    low, high, eta = 0.0, min(top, start / (2.0 * extent)), 0.0
    for _ in range(_MAX_STEPS):
        value, slope = start - 4.0 * square * eta + kappa * eta * eta, 2.0 * kappa * eta - 4.0 * square
        for k in range(d):
            q, y = cross[k], mean[k]
            if q != 0.0 or y != 0.0:
                rest = values[k] - eta
                p = q - 2.0 * eta * y
                value -= eta * (q * q - 4.0 * values[k] * y * (q - eta * y)) / (values[k] * rest)
                slope -= p * (p - 4.0 * y * rest) / (rest * rest)
        if value > 0.0:
            low = eta
        else:
            high = eta
        step = -value / slope
        following = eta + step
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - eta) <= 4.0 * _EPS * following:
            return following
        eta = following
    return eta


@compiled
def _solve_all(regression: Regression, kappa: float, kept: Bools, eta: Floats) -> None:
    """The root for each set, found in units of its own size, so that no power of the points' unit overflows."""
    numbers, along = regression.numbers, regression.along
    values, cross, mean = along[0], along[1], along[2]
    b, d = values.shape
    extent, q, y = np.empty(d), np.empty(d), np.empty(d)
    for t in range(b):
        n = numbers[0, t]
        unit, weight = numbers[3, t] + numbers[2, t], (n - 1.0) / n
        root = math.sqrt(unit)
        for k in range(d):
            extent[k] = values[t, k] * weight / unit
            q[k] = cross[t, k] * weight / (unit * root) if kept[t, k] else 0.0
            y[k] = mean[t, k] / root if kept[t, k] else 0.0
        spread = numbers[1, t] / unit / unit
        eta[t] = smallest_root(extent, q, y, 1.0, spread, kappa) * unit / weight


def root(samples: Samples, kappa: float, kept: Bools | None = None) -> Floats:
    """Root η of (5.1) for each set, in units of the sample covariance C (b,).

    Args:
        samples: the batch.
        kappa: the constant ϰ.
        kept: eigen-directions of C that take part (b, d); all, if None.
    """
    regression = samples.regression
    b, d, _ = regression.axes.shape
    eta = np.empty(b)
    _solve_all(regression, kappa, every(b, d) if kept is None else kept, eta)
    return eta


def taubin(samples: Samples) -> Estimates:
    """Taubin's fit (ϰ = 0): the gradient-weighted algebraic fit. Its errors have shorter tails than those of `als`.

    Source: Taubin 1991; as a member of the family, theory table 5.1.
    """
    return member(samples, root(samples, 0.0), 0.0)


def pratt(samples: Samples) -> Estimates:
    """Pratt's fit (ϰ = -4).

    Source: Pratt 1987; as a member of the family, theory table 5.1.
    """
    return member(samples, root(samples, -4.0), 2.0)


def hyper(samples: Samples) -> Estimates:
    """The hyperaccurate fit (ϰ = -d²), without essential bias.

    Source: Al-Sharadqah & Chernov 2009; Kanatani & Rangarajan 2011.
    """
    d = samples.shape[1]
    return member(samples, root(samples, -float(d * d)), -float(d))


def als(samples: Samples) -> Estimates:
    """Adjusted least squares with unknown noise (ϰ = 2d): UGDK that measures σ² in the same points.

    It does better than UGDK does with the true σ: the realised noise along the cap's axis differs from σ² by chance,
    the residuals show by how much, and subtracting the realised noise removes that error. The noise variance is
    unbiased, nη/(n - d - 1) in weights of 1/n. Where the extent left after the subtraction is within two standard
    errors of zero, the status says that the centre is unreliable.

    Source: Kukush, Markovsky & Van Huffel 2004, specialised to spheres; theory §5.
    """
    eta = root(samples, 2.0 * samples.shape[1])
    return shrunk(samples, eta, np.zeros_like(eta))


def fuller(samples: Samples) -> Estimates:
    """`als` with Fuller's modification: η(1 - α/N) is subtracted instead of η, α from 2 to 7.

    It changes the centre by O(1/N) of its error and bounds it: `als` has errors with a 1/x tail, this has none. The
    status is that of `als`.

    Source: Fuller 1987 §2.5; theory §9.3, (9.4).
    """
    eta = root(samples, 2.0 * samples.shape[1])
    return shrunk(samples, eta, fuller_constant(samples))


def fuller_constant(samples: Samples) -> Floats:
    """Fuller's α for each set (b,).

    The least mean square error needs more of his term where the points hardly determine the curvature, and none where
    they do.

    Source: theory (9.4).
    """
    alpha = np.empty(len(samples.regression.n))
    _constants(samples.regression, alpha)
    return alpha


@compiled
def _constants(regression: Regression, alpha: Floats) -> None:
    few, many = _FULLER
    for t in range(alpha.size):
        alpha[t] = few + (many - few) / (1.0 + squared(_wald_of_curvature(regression, t) / _SEEN))


@compiled
def _wald_of_curvature(regression: Regression, t: int) -> float:
    """Wald statistic W of the curvature across the least extent (theory 9.4), from set t of a batch.

    It tests whether |y|², regressed on y = x - x̄, depends on y along the least eigen-direction of C. By chance alone it
    is about 1, as where noise hides the curvature of a cap; it is infinite where the regression leaves no residuals.
    """
    along = regression.along
    values, cross, mean = along[0, t], along[1, t], along[2, t]
    n, size, left = regression.numbers[0, t], math.sqrt(regression.numbers[1, t]), 1.0
    for k in range(values.size):
        if values[k] > 0.0:
            # A correlation first: squares of covariances would overflow in large units.
            correlation = cross[k] / (math.sqrt(values[k]) * size)
            left -= correlation * correlation * (n - 1.0) / n
    least = (cross[0] - 2.0 * values[0] * mean[0]) / (math.sqrt(values[0]) * size)
    if not left > 0.0:
        return math.inf
    return (n - 1.0) * least * least / left if least == least else 0.0


def shrunk(samples: Samples, eta: Floats, alpha: Floats) -> Estimates:
    """The fit of `fuller` from the root η (b,) of `als` and Fuller's α (b,)."""
    shrink = np.maximum(1.0 - alpha / samples.regression.n, 0.0)
    fit = member(samples, shrink * eta, -float(samples.shape[1]))
    fit.status[(fit.status == Status.OK) & ~_significant(samples, eta, 2.0)[:, 0]] = Status.INSIGNIFICANT
    return fit


def hinge(samples: Samples) -> Estimates:
    """`als` for points that may lie on an arc or in a plane: a direction without significant extent is dropped.

    Along a dropped direction the centre stays at the centroid, and the status says so. The noise is found in the
    points, or is ``samples.noise`` (σ) if that is given.

    Raises:
        ValueError: if the noise is a covariance.

    Source: theory §1.2; with unknown noise, its rule with the two conditions of `_flat`.
    """
    if np.ndim(samples.noise if samples.noise is not None else 0.0) == 2:
        raise ValueError("hinge compares every direction with one noise level: pass noise=σ, not a covariance, or none")
    b, d, _ = samples.shape
    values = samples.regression.eigenvalues
    kept = values > 8.0 * d * _EPS * values[:, -1:]
    if samples.noise is not None:
        eta = np.zeros(b) + np.square(samples.noise)
        kept &= _significant(samples, eta, 3.0)
    else:
        for k in range(d - 1):  # from the least extent upwards, as long as all before are flat
            kept[:, k] &= ~(_flat(samples, kept, k) & ~kept[:, :k].any(axis=1))
        eta = root(samples, 2.0 * d, kept)
    fit = member(samples, eta, -float(d), kept)
    fine = fit.status == Status.OK
    if samples.noise is not None:
        fit.noise_variance[fine] = eta[fine]
    else:  # a dropped direction takes no degree of freedom
        n = samples.regression.n
        with np.errstate(all="ignore"):
            fit.noise_variance[:] *= (n - d - 1.0) / (n - kept.sum(axis=1) - 1.0)
    weak = ~(_significant(samples, eta, 2.0) | ~kept).all(axis=1)
    fit.status[fine & ~kept.all(axis=1)] = Status.HINGE
    fit.status[fine & weak] = Status.INSIGNIFICANT
    lost = fine & (kept.sum(axis=1) < 2)
    fit.status[lost] = Status.SINGULAR
    return remove(fit, lost)


def _flat(samples: Samples, kept: Bools, direction: int) -> Bools:
    """True where an eigen-direction of C holds noise alone, the noise being unknown (b,).

    Two conditions define it. Its eigenvalue is within three standard errors of the noise that the other directions
    show (each of the two has an error of η√(2/n)). And it explains no more of the algebraic residuals than chance: a
    direction is a regressor there, and its F statistic is below the quantile of three standard errors. The second
    condition separates an arc's flat direction from a small cap's axis, which may be as short but carries the
    curvature.
    """
    regression = samples.regression
    values, along = regression.along[:2]
    n, d = regression.n, values.shape[1]
    others = kept.copy()
    others[:, direction] = False
    eta = root(samples, 2.0 * d, others)
    spare = n - others.sum(axis=1) - 2.0
    with np.errstate(all="ignore"):
        explained = along**2 / values * ((n - 1.0) / n)[:, None]
        left = regression.variance - np.where(others, explained, 0.0).sum(axis=1) - explained[:, direction]
        limit = fdtri(1, np.maximum(spare, 1.0), 1.0 - _THREE_SIGMA)
        chance = (explained[:, direction] * spare <= limit * np.maximum(left, 0.0)) & (spare > 0.0)
    return np.asarray(chance & (values[:, direction] <= eta * (1.0 + 3.0 * np.sqrt(4.0 / n))))


def _significant(samples: Samples, eta: Floats, errors: float) -> Bools:
    """True where an eigenvalue of C exceeds the noise by so many standard errors of the noise, η√(2/n): (b, d)."""
    regression = samples.regression
    limit = errors * (eta * np.sqrt(2.0 / regression.n))
    return np.asarray(regression.eigenvalues - eta[:, None] > limit[:, None])


_ROUNDS = 12
_RIDGE = 1e-4


def ugdk_cov(samples: Samples) -> Estimates:
    """UGDK with Σ̂ estimated from the points, which need Gaussian noise of one covariance.

    It is worth its cost where the noise is markedly anisotropic and the points are many. With isotropic noise it
    estimates more than it needs: on a 20° cap with n = 1000 its median error is 1.4 times that of `als` at σ = .0056 r
    and 2.7 times at .018 r; on 90° and more the two are alike up to σ = .1 r. Above σ ≈ .2 r the equations can lead to
    a wrong Σ̂, which no status shows.

    Source: theory §5.4.
    """
    start = als(samples)
    d = samples.shape[1]
    usable: Bools = np.asarray(np.isfinite(start.center).all(axis=1))
    isotropic = np.where(usable, start.noise_variance, 0.0)
    isotropic = np.where(np.isfinite(isotropic), isotropic, 0.0)[:, None, None] * np.eye(d)
    noise, center = isotropic.copy(), np.where(usable[:, None], start.center, 0.0)
    # in units of the points' spread: sixth powers of raw coordinates may not be finite
    with np.errstate(all="ignore"):
        scale = np.sqrt(np.trace(samples.moments.covariance, axis1=1, axis2=2))
    scale = np.where(usable, scale, 1.0)[:, None, None]
    # in one memory layout: a quotient would have the points', which determines the order of adding
    x = np.ascontiguousarray(np.where(usable[:, None, None], samples.x, 0.0) / scale)
    fit = start
    for step in range(1, _ROUNDS + 1):
        unit = _covariance(x, center / scale[:, :, 0], noise / scale**2, isotropic / scale**2)
        noise = unit * scale**2
        fit = subtracting(samples, noise)
        good = (fit.status == Status.OK)[:, None]
        center = np.where(good, fit.center, center)
        noise = np.where(good[:, :, None], noise, isotropic)
        fit.iterations[:] = step
    fit.status[~usable] = start.status[~usable]
    fit.noise_variance[np.isnan(start.noise_variance)] = np.nan
    return fit


def _covariance(x: Floats, center: Floats, noise: Floats, isotropic: Floats) -> Floats:
    """One step: Σ̂ (b, d, d) from the moments about a centre and the Σ̂ before."""
    b, d, n = x.shape
    m = d * (d + 1) // 2
    sums, weighted_sums, products = np.empty((b, m)), np.empty((b, m)), np.empty((b, m, m))
    square = np.empty(b)
    _sums(x, center, sums, weighted_sums, products, square)
    place = np.zeros((d, d), dtype=int)  # place of a pair of coordinates among the d(d+1)/2
    upper = np.triu_indices(d)
    place[upper] = place.T[upper] = np.arange(m)
    second, weighted = sums[:, place] / n, weighted_sums[:, place] / n
    fourth = products[:, place[:, :, None, None], place] / n
    p, noise2 = second - noise, noise @ noise
    known = (
        square[:, None, None] / n * noise
        + 8.0 * noise @ p @ noise
        + 8.0 * noise @ noise2
        + 8.0 * (p @ noise2 + noise2 @ p)
        + 2.0 * np.trace(noise2, axis1=1, axis2=2)[:, None, None] * p
    )
    quartic = fourth - _symmetric_products(p, noise) - _symmetric_products(noise, noise) / 2.0
    # Σ has d(d+1)/2 unknowns; least squares on the symmetric part, pulled a little towards the isotropic answer
    basis = np.zeros((m, d, d))
    basis[np.arange(m), upper[0], upper[1]] = basis[np.arange(m), upper[1], upper[0]] = 1.0
    matrix = 4.0 * np.einsum("bijkl,mkl->bijm", quartic, basis)[:, upper[0], upper[1]]
    right = (weighted - known)[:, upper[0], upper[1]]
    prior = isotropic[:, upper[0], upper[1]]
    scale = _RIDGE * np.trace(matrix, axis1=1, axis2=2)[:, None, None] / m
    normal = matrix + scale * np.eye(m)
    flat = ~(np.abs(np.linalg.det(normal)) > 0.0)
    normal[flat] = np.eye(m)
    solution = np.linalg.solve(normal, (right + scale[:, 0] * prior)[:, :, None])[:, :, 0]
    solution[flat] = prior[flat]
    result = np.einsum("bm,mij->bij", solution, basis)
    values, vectors = np.linalg.eigh(np.where(np.isfinite(result), result, 0.0))
    return np.asarray(np.einsum("bij,bj,bkj->bik", vectors, np.maximum(values, 0.0), vectors))


@compiled
def _sums(x: Floats, center: Floats, sums: Floats, weighted: Floats, products: Floats, square: Floats) -> None:
    """Σp, Σf²p and Σpp' over the pairs p = vᵢvⱼ, i ≤ j, of v = x - c, and Σf²; f is |v|² less its mean."""
    b, d, n = x.shape
    m = sums.shape[1]
    rows = np.empty((m + d + 1, CHUNK))
    for t in range(b):
        sums[t], weighted[t], products[t], square[t] = 0.0, 0.0, 0.0, 0.0
        mean = 0.0
        for i in range(d):
            row, c, total_square = x[t, i], center[t, i], 0.0
            for k in range(n):
                total_square += squared(row[k] - c)
            mean += total_square / n
        for start in range(0, n, CHUNK):
            size = min(CHUNK, n - start)
            f2 = rows[m + d, :size]
            fill(f2, -mean)
            for i in range(d):
                v, row, c = rows[m + i, :size], x[t, i, start : start + size], center[t, i]
                for k in range(size):
                    v[k] = row[k] - c
                    f2[k] += v[k] * v[k]
            for k in range(size):
                f2[k] *= f2[k]
            square[t] += total(f2)
            pair = 0
            for i in range(d):
                for j in range(i, d):
                    p, v, w = rows[pair, :size], rows[m + i, :size], rows[m + j, :size]
                    for k in range(size):
                        p[k] = v[k] * w[k]
                    sums[t, pair] += total(p)
                    weighted[t, pair] += dot(p, f2)
                    for other in range(pair + 1):
                        products[t, pair, other] += dot(p, rows[other, :size])
                    pair += 1
        for i in range(m):
            for j in range(i):
                products[t, j, i] = products[t, i, j]


def _symmetric_products(a: Floats, b: Floats) -> Floats:
    """The six products aᵢⱼbₖₗ over the pairings of four indices: for a = b, each of the three pairings twice."""
    first = np.einsum("bij,bkl->bijkl", a, b) + np.einsum("bij,bkl->bijkl", b, a)
    return np.asarray(first + first.transpose(0, 1, 3, 2, 4) + first.transpose(0, 1, 4, 3, 2))
