"""The robust fit: maximum likelihood from the points that are not outliers, by a rule with a stated rate of alarms.

Of n points the m of a set S lie near one sphere. Are the other k = n - m outliers? Let SS be the sum of the squares
(R - r)² about the sphere that is fitted to some points. If all n points are clean, x = SS(S)/SS(all) has for a set
chosen beforehand the Beta law with a = (m - d - 1)/2 and b = k/2: this is the F test of k outliers. S was not chosen
beforehand, but it is one of C(n, k) sets. So clean points have such a set with probability C(n, k) I_x(a, b) at most.
The search takes the set for which this *chance* is smallest. The points outside are outliers if the chance is below the
share of the level that belongs to their number: half of α for one, a quarter for more.

The rule has no unit, no scale and no table, and takes no law of the outliers. It is a number of false alarms (Moisan &
Stival 2004), of a test for several outliers (Cook & Weisberg 1982).

The sets are sought as in least trimmed squares. All starts, which are spheres through d + 1 points, are compared by the
chance of the points nearest to them. The best ten take concentration steps: a sphere is fitted to the set of smallest
chance, and the points nearest to this sphere have a set of smaller chance (Rousseeuw & Van Driessen 2006). They fit by
Taubin's method, which is near the geometric fit, needs no start and cannot run away. Sets are in units of their own
size, so that no power overflows. The d + 1 points are chosen by a hash of counters: the same ones in each call, and for
each set of a batch.
"""

import math
from functools import lru_cache
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from scipy.special import gammaln

from study.arrays import Bools, Floats, Ints
from study.fits.estimators.closed_forms import smallest_root
from study.fits.estimators.geometric import mle
from study.fits.estimators.mixture import in_own_units, mixture, standard_errors, white_errors, without_isolated
from study.fits.estimators.subsets import SUBSAMPLE, elemental, spread_out
from study.fits.loops.jit import Sums, compiled, dot, fill, zeros
from study.fits.loops.linalg import cholesky_solve, diagonalise
from study.fits.points.moments import Moments, accumulate
from study.fits.points.samples import Estimates, Samples, Status, blank, reach_of_copies, repeated

FALSE_ALARMS = 0.01
"""About the share α of data sets without outliers in which some are found; 0 to 0.018 were measured."""
_BATCH = 1 << 16
"""Elemental spheres that are formed together."""
_ENOUGH = 20
"""Points from which a sphere among clutter is fitted: with fewer, clutter near the sphere has no density."""
_TOGETHER = 1 << 15
"""Points that are weighed together."""


def robust(samples: Samples) -> Estimates:
    """Maximum likelihood where some points may be clutter: `mle` unless `find` finds some.

    Up to just under half of the points may be anywhere, if there are enough to tell: with 8, 10 and 12 points of which
    two, three and four are far away, these are found in 0.1, 0.5 and 0.9 of the data sets. Without outliers it equals
    `mle`, except in one data set in a hundred, in which a clean point is taken for an outlier. It fails if some sphere
    fits more than half of the points within the noise, outliers included. Two examples: far points beside a small cap
    that does not determine the radius, and a cluster a few standard deviations from the sphere.

    Source: Torr & Zisserman 2000; Rousseeuw & Van Driessen 2006; Moisan & Stival 2004; theory §11.
    """
    found = found_in(samples)
    if not found.named.any():
        return mle(samples)
    result = _of_the_rest(samples.x, found.named)
    weighed = np.isfinite(found.radius) & (result.status == Status.OK)
    for whole, values in zip(result, (found.center, found.radius, found.variance), strict=False):
        whole[weighed] = values[weighed]
    return result


def _of_the_rest(x: Floats, named: Bools) -> Estimates:
    """`mle` of sets (b, d, n) from the points that are not named."""
    result = blank(*x.shape[:2])
    for sets, rest in Samples(np.where(named[:, None], np.nan, x)).by_count():
        for whole, part in zip(result, mle(rest), strict=True):
            whole[sets] = part
    return result


_FOUND = WeakKeyDictionary[Samples, "Found"]()
"""What was found in samples that are still in use, because a fit and its status ask for the same."""


def found_in(samples: Samples) -> "Found":
    """Outliers of a batch by `find`, sought once."""
    if samples not in _FOUND:
        _FOUND[samples] = find(samples)
    return _FOUND[samples]


def outliers(samples: Samples) -> Bools:
    """Find the points (b, n) that do not belong to the sphere of the majority; see `find`."""
    return find(samples).named


class Found(NamedTuple):
    """Outliers, and the spheres that leave them out.

    Attributes:
        named: True for outliers (b, n).
        center: ĉ (b, d) of the sphere among clutter; NaN where there is none, or where points are too few for one.
        radius: r̂ (b,).
        variance: σ² (b,).
        ratio: factors of at least 1 on the standard errors of white noise, of centre and radius, for what the selection
            of the points adds (b, d + 1).
    """

    named: Bools
    center: Floats
    radius: Floats
    variance: Floats
    ratio: Floats


def find(samples: Samples, known: Floats | None = None) -> Found:
    """Find the points that do not belong to the sphere of the majority.

    More than half of the points are taken to lie on one sphere with Gaussian noise of unknown size. In data without
    outliers some are found in about 1 % of the data sets, whatever their number of points. If there are some among 20
    points or more, a mixture of a sphere and uniform clutter is fitted. The outliers are then the points that are more
    probably clutter. Among fewer points they are those of the search, which is repeated without them: one that is very
    far away hides others.

    Copies of a point count once, and are outliers together.

    Args:
        samples: the batch. Missing samples (NaN) are no outliers. A noise level given with them is not used.
        known: radii (b,), if they are known. The sphere among clutter is fitted with them fixed, and the factor of the
                radius is 1.

    Returns:
        The outliers. A set with fewer than d + 3 different points, in a plane, or with a coordinate that is not finite,
        has none.

    Source: Torr & Zisserman 2000; Moisan & Stival 2004; theory §11.
    """
    x = samples.x
    b, d, n = x.shape
    named, spheres = np.zeros((b, n), dtype=np.bool_), np.full((b, d + 1), np.nan)
    different = ~repeated(x) & ~np.isnan(x).any(axis=1)
    whole = np.flatnonzero(different.all(axis=1))
    named[whole], spheres[whole] = _among(np.ascontiguousarray(x[whole]))
    apart = np.flatnonzero(~different.all(axis=1))
    for t in apart:
        some = np.ascontiguousarray(x[t][:, different[t]])[None]
        named[t, different[t]], spheres[t : t + 1] = _among(some)
    result = Found(named, np.full((b, d), np.nan), np.full(b, np.nan), np.full(b, np.nan), np.ones((b, d + 1)))
    count = np.where(named.any(axis=1), different.sum(axis=1), 0)
    for m in np.unique(count[count >= _ENOUGH]):
        alike = np.flatnonzero(count == m)
        size = max(_TOGETHER // m, 1)
        for sets in (alike[i : i + size] for i in range(0, len(alike), size)):
            points = np.nonzero(different[sets])[1].reshape(len(sets), m)
            given = None if known is None else known[sets]
            _weigh(np.take_along_axis(x[sets], points[:, None], axis=2), points, spheres[sets], sets, result, given)
    few = np.flatnonzero((count > 0) & (count < _ENOUGH))
    if len(few):
        rest = np.where((named | ~different)[few, None], np.nan, x[few])
        named[few] |= find(Samples(rest)).named
    for t in apart[named[apart].any(axis=1)]:
        reach = reach_of_copies(x[t])
        with np.errstate(all="ignore"):  # points may be further apart than the largest number
            for k in np.flatnonzero(named[t]):
                named[t] |= (np.abs(x[t] - x[t][:, k : k + 1]) <= reach).all(axis=0)
    return result


def _weigh(x: Floats, points: Ints, spheres: Floats, sets: Ints, result: Found, known: Floats | None) -> None:
    """Fit spheres among clutter to sets (k, d, m), and write them.

    Args:
        x: the different points.
        points: their places in the batch (k, m).
        spheres: those of the search (k, d + 1).
        sets: places of the sets (k,).
        result: the outliers of the search; receives those of the mixtures, and their spheres.
        known: radii (k,), if they are known.
    """
    y, middle, size, floor = in_own_units(x)
    middle, size, fixed = middle[:, :, 0], size[:, 0, 0], known is not None
    d = y.shape[1]
    starts = np.column_stack([spheres[:, :d] - middle, spheres[:, d]]) / size[:, None]
    found = mixture(y, starts, floor, known=None if known is None else known / size)
    found = without_isolated(y, found, floor, fixed)
    kept = found.weights > 0.5
    ratio = standard_errors(y, found, fixed) / white_errors(y, found, kept, fixed)
    good = np.isfinite(ratio).all(axis=1) & (kept.sum(axis=1) > d + 2)
    result.ratio[sets[~good]] = np.inf  # no sphere stands out from the clutter
    result.named[sets[good, None], points[good]] = ~kept[good]
    good &= ~kept.all(axis=1)  # where no point is clutter after all, the fit is that of all points
    some = sets[good]
    result.center[some] = (middle + size[:, None] * found.center)[good]
    result.radius[some] = (size * found.radius)[good]
    result.variance[some] = np.square(size * found.scale)[good]
    result.ratio[some, : ratio.shape[1]] = np.maximum(ratio[good], 1.0)


def _among(x: Floats) -> tuple[Bools, Floats]:
    """Outliers of sets (b, d, n) without missing samples or copies, and the spheres beside them (b, d + 1)."""
    b, d, n = x.shape
    result, spheres = np.zeros((b, n), dtype=np.bool_), np.full((b, d + 1), np.nan)
    if n < d + 3:
        return result, spheres
    size = max(_BATCH // len(elemental(min(n, SUBSAMPLE), d + 1)), 1)
    usable = np.flatnonzero(np.isfinite(x).all(axis=(1, 2)))
    for begun in range(0, len(usable), size):
        sets = usable[begun : begun + size]
        result[sets], spheres[sets] = _search(x[sets])
    return result, spheres


class CleanLaw(NamedTuple):
    """Law of the sums of squares of clean sets.

    Attributes:
        choices: see `log_choices` (n + 1,).
        totals: SS of all points (b,).
        floor: residuals due to rounding (b,), per unit of the radius.
    """

    choices: Floats
    totals: Floats
    floor: Floats


_ALARM = -math.log(FALSE_ALARMS)
_LITTLE = 1e-4
"""Var R/(E R)² below which R is normal."""
_WITHOUT_RADIUS = 0.534
"""d Var R/(E R)² of points that scatter about one place: (Var R)/(E R)² is at most this over d."""
_POWER = 0.31
"""Without a radius, R to the power 1 less this is nearly normal in its upper tail."""
_TURNS = 4
"""Most concentration steps of a sphere."""
_FINALISTS = 10


def _search(x: Floats) -> tuple[Bools, Floats]:
    """Outliers of sets (b, d, n), and the spheres whose nearest points have the smallest chance (b, d + 1).

    Of more than `SUBSAMPLE` points as many are searched first, and the best sphere of these is improved.
    """
    b, d, n = x.shape
    y, middle, size, floor = in_own_units(x)
    whole, totals = _of_all(y)
    places = spread_out(n)
    part, sums = y, totals
    if len(places) < n:
        part = np.ascontiguousarray(y[:, :, places])
        sums = _of_all(part)[1]
    subsets = elemental(len(places), d + 1)
    spheres = np.empty((b, len(subsets), d + 1))
    _elemental_spheres(part, subsets, spheres)
    spheres = _best(part, CleanLaw(log_choices(len(places), d), sums, floor), spheres, 0, _FINALISTS)[0]
    spheres = np.concatenate([spheres, whole[:, None]], axis=1)
    spheres, chances, limits = _best(part, CleanLaw(log_choices(len(places), d), sums, floor), spheres, _TURNS, 1)
    if part is not y:
        spheres, chances, limits = _best(y, CleanLaw(log_choices(n, d), totals, floor), spheres, 1, 1)
    named, spheres = np.zeros((b, n), dtype=np.bool_), spheres[:, 0]
    for t in np.flatnonzero(chances[:, 0] > _ALARM):
        away = np.linalg.norm(y[t] - spheres[t, :d, None], axis=0)
        share = totals[t] / max(n - d - 1, 1) / whole[t, d] ** 2
        if share > _LITTLE:  # distances are skew, by as much as in the fit of all points
            every = normal(np.linalg.norm(y[t] - whole[t, :d, None], axis=0), whole[t, d], share, d)
            squares, total = np.sort(np.square(normal(away, spheres[t, d], share, d))), float(every @ every)
            rounding = float(floor[t] * (1.0 + spheres[t, d])) ** 2
            if smallest_chance(squares, log_choices(n, d), total, rounding, d)[0] < _ALARM:
                continue
        named[t] = np.square(away - spheres[t, d]) > limits[t, 0]
    spheres *= size[:, :, 0]
    spheres[:, :d] += middle[:, :, 0]
    return named, spheres


def normal(distances: Floats, radius: float, share: float, d: int) -> Floats:
    """Distances R less r, made nearly normal in their upper tail: r (R/r)^p/p less the same of r.

    With ``share`` = Var R/(E R)² it is right to 4 % of R - E R at 3 to 5 standard deviations, whatever the noise.

    Source: theory 11.3.
    """
    most = _WITHOUT_RADIUS / d
    share, linear = min(share, most), (d - 1.0) / 3.0
    power = 1.0 - linear * share - (_POWER - linear * most) * (share / most) ** 4
    return radius * ((distances / radius) ** power - 1.0) / power


def _of_all(y: Floats) -> tuple[Floats, Floats]:
    """Spheres of all points of sets (b, d, n), NaN where there is none (b, d + 1); SS about these or about planes (b,).

    A plane is a sphere without end: where it is nearer to the points, no sphere was found.
    """
    n, d = y.shape[2], y.shape[1]
    fit, away = mle(Samples(y)), y - y.mean(axis=2, keepdims=True)
    plane = np.linalg.eigvalsh(away @ away.swapaxes(1, 2))[:, 0]
    sums = np.fmin(fit.noise_variance * max(n - d - 1, 1), np.maximum(plane, 0.0))
    return np.column_stack([fit.center, fit.radius]), sums


def _best(y: Floats, law: CleanLaw, spheres: Floats, turns: int, count: int) -> tuple[Floats, Floats, Floats]:
    """The best of the spheres (b, s, d + 1) after some concentration steps (b, count, d + 1); see `_improve`.

    Returns:
        The spheres, NaN where there is none; -log of the chance of the points nearest to them, and the largest of
        their squared distances (b, count).
    """
    b, d, _ = y.shape
    chances, limits = found = np.empty((2, b, spheres.shape[1]))
    _improve(y, spheres, law, turns, found, zeros(d), zeros(d, d))
    order = np.argsort(-chances, axis=1, kind="stable")[:, :count]
    chosen = np.take_along_axis(spheres, order[:, :, None], axis=1)
    chances, limits = np.take_along_axis(chances, order, axis=1), np.take_along_axis(limits, order, axis=1)
    chosen[np.isinf(chances)] = np.nan
    return chosen, chances, limits


@lru_cache(maxsize=8)
def log_choices(n: int, d: int) -> Floats:
    """-log[C/(w_k a B(a, b))] for m = 0 … n (n + 1,): C sets of m points, and the share w_k of the level.

    The chance of m points is C I_x(a, b)/w_k with a = (m - d - 1)/2, b = k/2 and k = n - m, and I_x is
    x^a (1 - x)^b/(a B(a, b)) times a series. Many of the C(n, k) sets overlap: they count as 15 C(n, k)^0.7, if that
    is less. This follows the .998 quantiles of -log I_x of the best set in clean sets, of n = 20, 30, 40, 60, 100 and
    200 and every k, in d = 2, 3, 4 (20,000 sets). One outlier has a half of the level, each other number a quarter.

    Source: Digital Library of Mathematical Functions 8.17.8; theory 11.1.
    """
    m = np.arange(n + 1.0)
    k, a = np.maximum(n - m, 1.0), 0.5 * np.maximum(m - d - 1.0, 1.0)
    choices = gammaln(n + 1.0) - gammaln(m + 1.0) - gammaln(k + 1.0)
    beta = gammaln(a + 1.0) + gammaln(0.5 * k) - gammaln(a + 0.5 * k)
    return np.asarray(np.log(np.where(k > 1.0, 0.25, 0.5)) - np.minimum(choices, 0.7 * choices + 2.7) + beta)


@compiled
def majority(n: int, d: int) -> int:
    """Number of points of which the rest are the most outliers that can be found."""
    return (n + d + 2) // 2


@compiled
def smallest_chance(squares: Floats, choices: Floats, total: float, rounding: float, d: int) -> tuple[float, int]:
    """-log of the smallest chance of the m nearest points, and m.

    The series of I_x is bounded by a geometric one. Where x is above the mean of its law, the chance is 1, and the
    largest -x counts, so that a search goes on.

    Args:
        squares: of the distances from a sphere, in ascending order (n,).
        choices: see `log_choices`.
        total: SS of all points.
        rounding: square of the residual that is due to rounding.
        d: dimension.

    Source: theory 11.1.
    """
    n, first = squares.size, majority(squares.size, d)
    best, m, sum_of_squares = -math.inf, first, 0.0
    for count in range(1, n):
        sum_of_squares += squares[count - 1] + rounding
        if count < first:
            continue
        x, a, b = sum_of_squares / max(total, n * rounding), 0.5 * (count - d - 1), 0.5 * (n - count)
        if x < a / (a + b):
            series = 1.0 - x * max((a + b) / (a + 1.0), 1.0)
            value = choices[count] - a * math.log(x) - b * math.log1p(-x) + math.log(series)
            if value > best:
                best, m = value, count
        elif count == first:
            best = -_NOTHING * x
    return best, m


_NOTHING = 1e6
"""Beyond any -log of a chance."""


_SINGULAR = 64.0 * 2.0**-52
"""An extent below so many roundings of the largest, for each dimension, is none."""


class Selection(NamedTuple):
    """The points of one set that a sphere is fitted to, and memory for that fit.

    Attributes:
        distance: of each point from a sphere (n,).
        inside: True for the points that are fitted (n,).
        chosen: their coordinates (d n + 1,).
        moments: theirs, a batch of one.
        vectors: three vectors (3, d).
        matrices: two matrices (2, d, d).
        zero: d sums at zero.
        square: d² sums at zero.
    """

    distance: Floats
    inside: Bools
    chosen: Floats
    moments: Moments
    vectors: Floats
    matrices: Floats
    zero: Sums
    square: Sums


@compiled
def new_selection(n: int, zero: Sums, square: Sums) -> Selection:
    """Allocate a selection among n points."""
    d = len(zero)
    moments = Moments(np.empty((2, 1)), np.empty((2, 1, d)), np.empty((1, d, d)))
    distance, inside, chosen = np.empty(n), np.empty(n, np.bool_), np.empty(d * n + 1)
    return Selection(distance, inside, chosen, moments, np.empty((3, d)), np.empty((2, d, d)), zero, square)


@compiled
def residuals(y: Floats, sphere: Floats, result: Floats) -> None:
    """Write R - r of each point; a sphere is its centre, then its radius (d + 1,)."""
    d, n = y.shape
    fill(result, 1e-300)
    for i in range(d):
        row, c = y[i], sphere[i]
        for k in range(n):
            result[k] += (row[k] - c) * (row[k] - c)
    radius = sphere[d]
    for k in range(n):
        result[k] = math.sqrt(result[k]) - radius


@compiled
def selected(y: Floats, selection: Selection) -> Floats:
    """The selected points, as a batch of one (1, d, m)."""
    d, n = y.shape
    inside, m = selection.inside, 0
    for k in range(n):
        m += inside[k]
    for i in range(d):
        place = i * m
        for k in range(n):  # without a branch: what is not selected is overwritten
            selection.chosen[place] = y[i, k]
            place += inside[k]
    return selection.chosen[: d * m].reshape(1, d, m)


@compiled
def _taubin(y: Floats, selection: Selection, sphere: Floats) -> bool:
    """Taubin's fit of the selected points; False, and no sphere, if they do not determine one."""
    points, moments = selected(y, selection), selection.moments
    _, d, m = points.shape
    accumulate(points, moments, selection.zero, selection.square)
    scatter, basis = selection.matrices[0], selection.matrices[1]
    values, along, zero = selection.vectors[0], selection.vectors[1], selection.vectors[2]
    trace = 0.0
    for i in range(d):
        zero[i] = 0.0
        trace += moments.second[0, i, i] / m
        for j in range(d):
            scatter[i, j] = moments.second[0, i, j] / m
    diagonalise(scatter, basis)
    for i in range(d):
        values[i], along[i] = scatter[i, i], dot(basis[:, i], moments.vectors[1, 0]) / m
    if not values[0] > _SINGULAR * d * values[d - 1]:
        return False
    eta = smallest_root(values, along, zero, trace, moments.numbers[1, 0] / m - trace * trace, 0.0)
    square_radius = trace
    for i in range(d):
        sphere[i] = moments.vectors[0, 0, i]
    for k in range(d):
        part = 0.5 * along[k] / (values[k] - eta)
        square_radius += part * part
        for i in range(d):
            sphere[i] += part * basis[i, k]
    sphere[d] = math.sqrt(square_radius)
    return bool(sphere[d] < math.inf)


@compiled
def _elemental_spheres(y: Floats, subsets: Ints, spheres: Floats) -> None:
    """Spheres (b, subsets, d + 1) through d + 1 points each of the sets (b, d, n); NaN where there is none."""
    b, d, _ = y.shape
    normal, right = np.empty((d, d)), np.empty(d)
    edges, squares = np.empty((d, d)), np.empty(d)
    for t in range(b):
        for s in range(len(subsets)):
            base, sphere = subsets[s, d], spheres[t, s]
            for k in range(d):
                squares[k] = 0.0
                for i in range(d):
                    edges[k, i] = y[t, i, subsets[s, k]] - y[t, i, base]
                    squares[k] += 0.5 * edges[k, i] * edges[k, i]
            for i in range(d):
                right[i] = dot(edges[:, i], squares)
                for j in range(d):
                    normal[i, j] = dot(edges[:, i], edges[:, j])
            solved, square = cholesky_solve(normal, right), 0.0
            for i in range(d):
                sphere[i] = y[t, i, base] + right[i] if solved else math.nan
                square += right[i] * right[i]
            sphere[d] = math.sqrt(square) if solved else math.nan


@compiled
def _improve(y: Floats, spheres: Floats, law: CleanLaw, turns: int, found: Floats, zero: Sums, square: Sums) -> None:
    """Improve spheres (b, s, d + 1) of the sets (b, d, n) by at most some concentration steps, in place.

    ``found`` (2, b, s) receives -log of the smallest chance of the points nearest to each, -∞ where there is no sphere,
    and the largest squared distance of these points.
    """
    chances, limits = found[0], found[1]
    b, d, n = y.shape
    selection, trial, ordered = new_selection(n, zero, square), np.empty(d + 1), np.empty(n)
    for t in range(b):
        for s in range(spheres.shape[1]):
            chances[t, s], limits[t, s] = -math.inf, math.inf
            for i in range(d + 1):
                trial[i] = spheres[t, s, i]
            step, going = 0, bool(trial[d] < math.inf)
            while going:
                residuals(y[t], trial, selection.distance)
                for k in range(n):
                    selection.distance[k] *= selection.distance[k]
                    ordered[k] = selection.distance[k]
                ordered.sort()
                rounding = law.floor[t] * (1.0 + trial[d])
                value, m = smallest_chance(ordered, law.choices, law.totals[t], rounding * rounding, d)
                going = value > chances[t, s]
                if going:
                    chances[t, s], limits[t, s] = value, ordered[m - 1]
                    for i in range(d + 1):
                        spheres[t, s, i] = trial[i]
                    going = step < turns
                if going:
                    for k in range(n):
                        selection.inside[k] = selection.distance[k] <= limits[t, s]
                    going = _taubin(y[t], selection, trial)
                step += 1
