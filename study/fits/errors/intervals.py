"""Confidence intervals of a sphere's radius and centre that cover where standard errors do not.

The score T of a hypothetical radius (`score.py`) is inverted: the interval is the set of radii with |T| below
Student's quantile q. The radius is taken as a curvature k = ±1/r₀, positive where the centre lies on the side of the
first estimate and negative on the other, for T sign k is nearly linear in k, through the plane at k = 0, and far from
linear in r₀.

The search goes to T = 0, from there to T = q, and from T = 0 to T = -q, by secants within brackets. On the way to -q it
may pass k = 0: a plane and centres on the other side are then not rejected, and the radius has no upper end. A
curvature without a profile, or with an unidentified centre, is not rejected either; where these begin, an end is open.

The interval of a coordinate of the centre is the union, over the radii, of its interval given the radius.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from study.arrays import Bools, Floats, Ints
from study.fits.errors.score import PointSet, Profile, Weights, first_variance, new_profile, place, score, solve_profile
from study.fits.errors.weighted import (
    FAR,
    AtRadius,
    PointSets,
    at_radii,
    corrected_equations,
    cost,
    for_kernels,
    least_squares,
    load,
    solve,
    weights_of,
)
from study.fits.estimators.closed_forms import als
from study.fits.loops.jit import Sums, compiled, squared, zeros
from study.fits.points.samples import FARTHEST, Samples, is_ordinary

NOISY = 0.35
"""Noise, in radii, from which on a sphere counts as weakly identified although its interval is bounded."""
_MOST = 100
"""Largest number of evaluations for one set."""
_IDENTIFIED = 0.2
"""Largest standard error of the centre given the radius, in radii: beyond, plug-in nuisances do not serve."""
_EXTRAPOLATED = 2.5
"""Ratio of radii up to which the centre is extrapolated along its derivative."""
_BETWEEN = 16
"""Radii between two evaluations at which the ends of a coordinate are interpolated."""
_FLAT = 1e-5
"""Curvature that counts as none, in units of the points' spread; what is smaller is lost in rounding."""
_SHARPEST = 1e4
_CLOSE = 1e-4
"""Difference from the wanted T, in quantiles, from which one linear step suffices."""
_NEAR_ZERO = 1e-3
"""The same about T = 0."""
_RETRIES = 4
"""Attempts between a curvature that was fine and one that was not."""
_COLLAPSED = 1e-10
_STEEP = 0.1
"""Least slope of a secant, as a share of the one before."""
_SIDES = 3.0
"""Standard errors by which a known radius must fit better on one side of the points than on the other."""
_TINY = 1e-280
_GOOD, _WEAK, _FAILED = 0, 1, 2
"""A profile was found; the centre is not identified given the radius; there is no profile."""


class Intervals(NamedTuple):
    """Confidence intervals of a batch of spheres.

    Attributes:
        radius: ends for each set (b, 2), in the unit of the points; 0 and infinite where an end is open.
        center: ends of each coordinate (b, d, 2); -infinite and infinite where the radius has an open end.
        noise_share: σ̂/r̂ at the estimate within the interval (b,); NaN if there is none.
    """

    radius: Floats
    center: Floats
    noise_share: Floats

    @classmethod
    def unbounded(cls, batch: int, dimension: int, level: float) -> "Intervals":
        """Intervals without ends, to be filled in; ValueError if the level is not between 0 and 1."""
        if not 0.0 < level < 1.0:
            raise ValueError(f"level = {level}: a confidence level lies between 0 and 1, for example 0.95")
        radius, center = np.empty((batch, 2)), np.empty((batch, dimension, 2))
        radius[:], center[:] = (0.0, np.inf), (-np.inf, np.inf)
        return cls(radius, center, np.full(batch, np.nan))

    @property
    def identified(self) -> Bools:
        """True where the radius is bounded at both ends and the noise is below 0.35 radii (b,).

        In d > 3 dimensions the limit is lower by 3/d: intervals cover .74 in d = 10 at .2 radii, and .92 in d = 7.
        """
        limit = NOISY * min(3.0 / self.center.shape[1], 1.0)
        bounded = (self.radius[:, 0] > 0.0) & (self.radius[:, 1] < math.inf)
        return np.asarray(bounded & (self.noise_share < limit))


def intervals(samples: Samples, level: float = 0.95, stretch: Floats | None = None) -> Intervals:
    """Confidence intervals of radius and centre, each of the given level, whatever the estimator.

    The score of a hypothetical radius, with centre and noise profiled out, is inverted in signed curvature. It is free
    of the noise's bias for every law of directions, so that intervals cover on small caps and under large noise, where
    an estimate ± a standard error does not. They are asymmetric, and an end that the points do not determine is open.

    Given the radius, those of the centre are ĉ ± q errors. Where the sphere on the other side of the points is not
    rejected, as on a cap whose curvature the noise hides, they hold both; where it is not by far, the noise share is
    NaN.

    Args:
        samples: the batch, in d ≥ 2 dimensions, with what is known of it; without weights isotropic noise is assumed,
            and without a scale its size is found in the points. Points with a NaN are missing.
        level: nominal coverage, in (0, 1).
        stretch: factors on the quantile of each set (b,), where the errors are larger than white noise makes them.

    Raises:
        ValueError: if the level is not between 0 and 1.

    Source: theory §10.
    """
    b, d, _ = samples.shape
    result = Intervals.unbounded(b, d, level)
    stretch = np.ones(b) if stretch is None else np.asarray(stretch, dtype=float)
    if samples.given is None and is_ordinary(samples.moments.fourth):
        _compute(samples, level, stretch, result)
        return result
    for sets, part, power in samples.alike():
        if part.shape[2] > d + 1 and abs(power) <= FARTHEST:
            own = Intervals(*(array[sets] for array in result))
            _compute(part, level, stretch[sets], own)
            result.radius[sets], result.center[sets] = np.ldexp(own.radius, power), np.ldexp(own.center, power)
            result.noise_share[sets] = own.noise_share
    return result


def _compute(samples: Samples, level: float, stretch: Floats, result: Intervals) -> None:
    """Fill in the intervals of sets without missing samples, of ordinary size, of each of which the same is known."""
    _, d, n = samples.shape
    if n <= d + 1:
        return
    quantiles = stretch * stdtrit(degrees(samples, n), 0.5 * (1.0 + level))
    with np.errstate(all="ignore"):
        if np.isfinite(samples.radius).all():
            _with_radius(samples, quantiles, result)
        else:
            without_radius(samples, quantiles, result)


def degrees(samples: Samples, count: int | Ints) -> Floats:
    """Degrees of freedom of the noise (b,) of so many points, infinite where its scale is known."""
    spare = np.maximum(count - samples.shape[1] - np.isnan(samples.radius), 1.0)
    return np.where(np.isfinite(samples.scale), np.inf, spare)


def without_radius(samples: Samples, quantiles: Floats, result: Intervals) -> None:
    """Fill in the intervals of radius and centre, from quantiles of T (b,)."""
    d = samples.shape[1]
    if samples.weights is None and samples.given is None:
        start = als(samples)
        sets = PointSets(samples.rows, start.center, start.radius, None)
    else:
        first = least_squares(samples)
        sphere = corrected_equations(samples, first)
        fine = sphere.found & (sphere.radius < FAR * np.sqrt(samples.regression.eigenvalues.sum(axis=1)))
        for part, better in zip(first, sphere, strict=True):
            part[fine] = better[fine]
        sets, _ = for_kernels(samples, first)
    _compute_all(sets, quantiles, result, zeros(d), zeros(d, d))


def _with_radius(samples: Samples, quantiles: Floats, result: Intervals) -> None:
    """Fill in the intervals of the centre for a known radius."""
    least, r = least_squares(samples), samples.radius
    mirrored = least._replace(center=2.0 * samples.x.mean(axis=2) - least.center)
    other = solve(samples, mirrored, corrected=False)
    both = (at_radii(samples, sphere, r[:, None]) for sphere in (least, other))
    at, second = (AtRadius(*(array[:, 0] for array in one)) for one in both)
    steps = quantiles[:, None, None] * [-1.0, 1.0]
    center, beside = (one.center[..., None] + one.errors[..., None] * steps for one in (at, second))
    apart = other.found & (np.linalg.norm(other.center - least.center, axis=1) > 1e-3 * r)
    excess = (cost(samples, other.center, r) - cost(samples, least.center, r)) / at.variance
    near = apart & (excess <= quantiles**2)
    center[near, :, 0] = np.fmin(center[..., 0], beside[..., 0])[near]
    center[near, :, 1] = np.fmax(center[..., 1], beside[..., 1])[near]
    lost = np.isnan(at.variance)
    center[lost] = -np.inf, np.inf
    share = np.sqrt(at.variance) / r
    result.radius[:], result.center[:] = r[:, None], center
    result.noise_share[:] = np.where(lost | (apart & (excess <= _SIDES**2)), np.nan, share)


def intervals_of(sets: PointSets, quantiles: Floats) -> Intervals:
    """Intervals of points of several groups, from quantiles of T (b,); the radius is that of group 0."""
    b, d, _ = sets.x.shape
    result = Intervals.unbounded(b, d, 0.5)
    _compute_all(sets, quantiles, result, zeros(d), zeros(d, d))
    return result


class Evaluations(NamedTuple):
    """Curvatures at which the score of one set was evaluated, in their order, and what was found there.

    Attributes:
        k: signed curvatures (_MOST,).
        t: T sign k (_MOST,).
        slope: its derivative by k (_MOST,).
        variance: noise variances (_MOST,).
        center: centres (_MOST, d).
        bend: minus their derivatives by r₀ (_MOST, d).
        error: standard errors of the centre's coordinates given r₀ (_MOST, d).
        correlation: of these coordinates with T (_MOST, d).
    """

    k: Floats
    t: Floats
    slope: Floats
    variance: Floats
    center: Floats
    bend: Floats
    error: Floats
    correlation: Floats


@compiled
def _predict(profile: Profile, before: Evaluations, count: int, k: float, center: Floats) -> None:
    """Write centre and noise variance at a curvature, from those at the nearest one before; nothing if none was."""
    if count == 0:
        return
    near = 0
    for m in range(count):
        if abs(before.k[m] - k) < abs(before.k[near] - k):
            near = m
    d, r, last, bend = center.size, 1.0 / abs(k), 1.0 / abs(before.k[near]), before.bend[near]
    length = 0.0
    for i in range(d):
        length += bend[i] * bend[i]
    length = max(math.sqrt(length), _TINY)
    ratio = r / last if before.k[near] * k > 0.0 else 0.0
    for i in range(d):
        if 1.0 / _EXTRAPOLATED < ratio < _EXTRAPOLATED:
            center[i] = before.center[near, i] + bend[i] * (last - r)
        elif ratio > 0.0:
            center[i] = before.center[near, i] + bend[i] / max(length, 1.0) * (last - r)
        else:
            center[i] = bend[i] / length * r
    profile.sphere[2] = before.variance[near]


@compiled
def _evaluate(
    points: PointSet, weights: Weights | None, profile: Profile, done: Evaluations, count: int, k: float, start: Floats
) -> int:
    """Write the profile and the score at a curvature to place ``count``, unless there is no profile.

    Args:
        points: the points.
        weights: theirs, or None.
        profile: that of the last evaluation; receives the new one.
        done: the evaluations, of which ``count`` are done.
        count: their number.
        k: the curvature.
        start: centre of the first estimate, and a place for another (2, d).

    Returns:
        `_GOOD`, `_WEAK` or `_FAILED`.
    """
    d = start.shape[1]
    for i in range(d):
        start[1, i] = start[0, i]
    _predict(profile, done, count, k, start[1])
    place(profile, 1.0 / abs(k), start[1])
    converged, means = solve_profile(points, weights, profile, points.least)
    side = 0.0
    for i in range(d):
        side += profile.toward[i] * done.bend[0, i] if count > 0 else 0.0
    if not converged or (k < 0.0 and not side > 0.0):  # it fell back to the side of the estimate
        return _FAILED
    value, slope, spread = score(points, weights, profile, means)
    if not (abs(value) < math.inf and slope == slope):
        return _FAILED
    r = profile.sphere[0]
    done.k[count], done.t[count] = k, math.copysign(1.0, k) * value
    done.slope[count], done.variance[count] = -r * r * slope, profile.sphere[2]
    for i in range(d):
        done.center[count, i], done.bend[count, i] = r * profile.toward[i], profile.bend[i]
        done.error[count, i], done.correlation[count, i] = profile.errors[i], profile.correlations[i]
    return _GOOD if spread <= _IDENTIFIED * r else _WEAK


class Bracket(NamedTuple):
    """Curvatures between which T reaches a wanted value; NaN where one is not known.

    Attributes:
        inner: the last one whose T has not reached the value.
        inner_t: its T.
        far: one whose T is beyond the value.
        far_t: its T.
        barrier: the nearest one without a profile.
        secant: dT/dk between the last two.
        repeats: times in a row that ``far`` stayed.
    """

    inner: float
    inner_t: float
    far: float
    far_t: float
    barrier: float
    secant: float
    repeats: int


@compiled
def _open(k: float, t: float, slope: float) -> Bracket:
    """A bracket of which one side is known."""
    return Bracket(k, t, math.nan, math.nan, math.nan, slope, 0)


@compiled
def _next(bracket: Bracket, wanted: float, origin: float) -> float:
    """The next curvature to evaluate, in a search that began at T = 0, at the curvature ``origin``."""
    k, t, far, far_t, barrier, secant, repeats = bracket
    if far == far:
        share = (wanted - t) / (far_t - t) if repeats % 4 < 3 else 0.5
        return k + (far - k) * min(max(share, 1e-3), 0.999)
    most = 2.0 * abs(k - origin) + abs(k)
    if wanted < 0.0 and k > 0.0:
        most = 2.0 * most  # towards the plane T is linear, and k has no other scale
    step = min(max((wanted - t) / secant, -most), most)
    if barrier == barrier and abs(step) > 0.5 * abs(barrier - k):
        step = 0.5 * (barrier - k)
    return k + step


@compiled
def _narrowed(bracket: Bracket, k: float, t: float, wanted: float) -> Bracket:
    """The bracket after an evaluation."""
    inner, inner_t, far, far_t, barrier, secant, repeats = bracket
    between = (t - inner_t) / (k - inner)
    secant = between if between > _STEEP * secant else secant
    if (t - wanted) * wanted >= 0.0:
        return Bracket(inner, inner_t, k, t, barrier, secant, 0)
    return Bracket(k, t, far, far_t, barrier, secant, repeats + 1)


@compiled
def _toward_zero(done: Evaluations, m: int, below: float, above: float) -> float:
    """The next curvature on the way to T = 0 after evaluation m, given those next to it on both sides, or NaN."""
    k, t, slope = done.k[m], done.t[m], done.slope[m]
    if m > 0 and k != done.k[m - 1]:  # the derivative holds at T = 0 alone; far from there a secant is better
        secant = (t - done.t[m - 1]) / (k - done.k[m - 1])
        slope = secant if secant > _STEEP * slope else slope
    step, most = -t / slope if slope > 0.0 else math.copysign(math.inf, -t), 2.0 * abs(k) + 10.0 * _FLAT
    following = k + min(max(step, -most), most)
    if below == below and above == above and not below < following < above:
        following = 0.5 * (below + above)
    if abs(following) < _FLAT:
        return -_FLAT if abs(k) <= _FLAT else _FLAT
    return float(following)


@compiled
def _search(
    points: PointSet,
    weights: Weights | None,
    profile: Profile,
    done: Evaluations,
    start: Floats,
    guess: tuple[float, float],
) -> tuple[float, float, int, int]:
    """Search the ends of the set of curvatures with |T| ≤ q, from a guess: a first curvature, and q.

    Returns:
        The curvatures where T is -q and where it is q, NaN where an end is open, the number of evaluations, and the
        place of that where T is 0, or -1. The lower end is negative where a plane is not rejected.
    """
    low = high = below = above = math.nan
    first, quantile = guess
    k, tries, origin, at_plane = max(first, _FLAT), 0, -1, False
    count = int(np.int64(0))  # for a plain 0, functions that get it would be compiled apart
    turn, wanted, bracket = 0, 0.0, _open(math.nan, math.nan, math.nan)
    for _ in range(_MOST):
        sharp = abs(k) > _SHARPEST
        m, code = count, _FAILED if sharp else _evaluate(points, weights, profile, done, count, k, start)
        if turn == 0:  # to T = 0
            if code == _FAILED:
                tries += 1
                k = 0.5 * (k + done.k[m - 1]) if m > 0 else 0.5 * k
                if tries > 2 * _RETRIES or not abs(k) >= _FLAT:
                    break
                continue
            count += 1
            exact = done.variance[m] <= points.least
            if not exact and abs(done.t[m]) > _NEAR_ZERO * quantile:
                below, above = (k, above) if done.t[m] < 0.0 else (below, k)
                k = _toward_zero(done, m, below, above)
                continue
            if (
                k < 0.0
            ):  # the estimate lies on the other side: begin again from there, so that its curvature is positive
                for i in range(start.shape[1]):
                    start[0, i] = done.center[m, i]
                k, count, tries, below, above = max(-k, _FLAT), 0, 0, math.nan, math.nan
                continue
            origin = m
            if exact:
                low = high = k
            if exact or code != _GOOD:
                break
            turn, tries, wanted, bracket = 1, 0, quantile, _open(k, done.t[m], abs(done.slope[m]))
        else:  # to q, then to -q, then to -q on the other side of the plane, where the first evaluation tells
            begun, end, ended, beyond = bracket.inner == bracket.inner, math.nan, False, False
            if code != _GOOD:
                tries += 1
                ended = tries > _RETRIES or not begun or sharp
                bracket = Bracket(bracket[0], bracket[1], bracket[2], bracket[3], k, bracket[5], bracket[6])
            else:
                count += 1
                t = done.t[m]
                bracket = _narrowed(bracket, k, t, wanted) if begun else _open(k, t, abs(done.slope[origin]))
                if not begun and t <= wanted:
                    end, ended = -_FLAT, True
                elif abs(t - wanted) <= _CLOSE * quantile:
                    end, ended = k + (wanted - t) / bracket.secant, True
                elif abs(bracket.far - bracket.inner) <= _COLLAPSED * abs(bracket.inner):  # T jumps there
                    end, ended = bracket.far, True
                else:
                    beyond = at_plane and t > wanted
            if beyond:  # a plane is not rejected: does the other side hold smaller radii than this one?
                low = -_FLAT
                if not high > 0.0:
                    break
                turn, tries, at_plane, k, bracket = 3, 0, False, -high, _open(math.nan, math.nan, math.nan)
                continue
            if ended and turn > 1:
                low = end if end == end else low
                break
            if ended:
                high, turn, tries, wanted = end, 2, 0, -quantile
                bracket = _open(done.k[origin], done.t[origin], abs(done.slope[origin]))
        k = _next(bracket, wanted, done.k[origin])
        at_plane = turn == 2 and k < _FLAT
        k = _FLAT if at_plane else k
    return low, high, count, origin


@compiled
def _order(done: Evaluations, count: int, low: float, high: float, order: Ints) -> int:
    """Places of the evaluations within [low, high], up to the last step of a search, by their curvature."""
    inside = 0
    for m in range(count):
        k = done.k[m]
        if not low * (1.0 - 1e-3) <= k <= high * (1.0 + 1e-3):
            continue
        place = inside
        while place > 0 and done.k[order[place - 1]] > k:
            order[place] = order[place - 1]
            place -= 1
        order[place] = m
        inside += 1
    return inside


@compiled
def _center_ends(
    done: Evaluations, count: int, low: float, high: float, quantile: float, order: Ints, ends: Floats
) -> None:
    """Write the ends of each coordinate of the centre (d, 2).

    Given r₀, ĉ has the error √V with the correlation ρ to T; the coordinate's values that are rejected neither by T nor
    by what of ĉ is independent of T are ĉ - ρT√V ± √V √(1 - ρ²) √(q² - T²) (theory 10.3). Between evaluations T is
    linear in the curvature, and ĉ and √V in the radius.
    """
    d, inside = ends.shape[0], _order(done, count, low, high, order)
    for i in range(d):
        ends[i, 0], ends[i, 1] = math.inf, -math.inf
    for m in range(max(inside - 1, 1)):
        one, two = order[m], order[min(m + 1, inside - 1)]
        first, last = done.k[one], done.k[two]
        for step in range(_BETWEEN + 1):
            by_k = step / _BETWEEN
            k = first + (last - first) * by_k
            t = done.t[one] + (done.t[two] - done.t[one]) * by_k
            by_r = (1.0 / k - 1.0 / first) / (1.0 / last - 1.0 / first) if last > first else 0.0
            rest = math.sqrt(max(quantile * quantile - t * t, 0.0))
            t = min(max(t, -quantile), quantile)
            for i in range(d):
                center = done.center[one, i] + (done.center[two, i] - done.center[one, i]) * by_r
                error = done.error[one, i] + (done.error[two, i] - done.error[one, i]) * by_r
                correlation = done.correlation[one, i] + (done.correlation[two, i] - done.correlation[one, i]) * by_k
                middle, half = center - correlation * t * error, error * rest * math.sqrt(1.0 - squared(correlation))
                ends[i, 0], ends[i, 1] = min(ends[i, 0], middle - half), max(ends[i, 1], middle + half)


@compiled
def _compute_all(sets: PointSets, quantiles: Floats, result: Intervals, zero: Sums, square: Sums) -> None:
    """Fill in the intervals of each set of a batch."""
    x, centers, radii, every = sets
    b, d, n = x.shape
    rows, profile, start = np.empty((d + 1, n)), new_profile(d), np.empty((2, d))
    origin, ends, order = np.empty(d), np.empty((d, 2)), np.empty(_MOST, np.int64)
    a, v = np.empty((4, _MOST)), np.empty((4, _MOST, d))
    done = Evaluations(a[0], a[1], a[2], a[3], v[0], v[1], v[2], v[3])
    for t in range(b):
        unit, rounding = load(x, t, rows, origin)
        distance, least, quantile = 0.0, rounding * rounding, quantiles[t]
        points, weights = PointSet(rows, zero, square, least), weights_of(every, t, unit, math.nan, False, d)
        for i in range(d):
            start[0, i] = (centers[t, i] - origin[i]) / unit
            distance += start[0, i] * start[0, i]
        first = unit / radii[t] if radii[t] > 0.0 else 1.0 / math.sqrt(distance)
        if not (unit > 0.0 and 0.0 < first < math.inf and distance < math.inf):
            continue
        profile.sphere[2] = max(first_variance(points, weights, start[0], 1.0 / first), least)
        low, high, count, m = _search(points, weights, profile, done, start, (first, quantile))
        if m < 0:
            continue
        exact = done.variance[m] <= points.least
        estimate = done.k[m] if exact else done.k[m] - done.t[m] / done.slope[m]
        if estimate > 0.0:
            result.noise_share[t] = math.sqrt(max(done.variance[m], 0.0)) * estimate
        sharpest = max(high, -low) if low < 0.0 and high == high else high
        if sharpest > 0.0:
            result.radius[t, 0] = unit / sharpest
        if low > 0.0:
            result.radius[t, 1] = unit / low
        if low > 0.0 and high > 0.0:
            if exact:
                for i in range(d):
                    ends[i, 0] = ends[i, 1] = done.center[m, i]
            else:
                _center_ends(done, count, low, high, quantile, order, ends)
            for i in range(d):
                for side in range(2):
                    result.center[t, i, side] = origin[i] + unit * ends[i, side]
