"""The robust fit: maximum likelihood from the points that are not outliers, by a rule with a stated rate of alarms.

A forward search grows a clean set of points until the next one is an outlier. It begins with the points nearest to the
sphere of least trimmed squares, to which the sphere is fitted geometrically: the set S of m points. Each point has a
deleted residual, t = (R - r) / (s √(1 ± l)), with s² = Σ_S (R - r)²/(m - d - 1 - f), f the parameters that curvature
adds, and the leverage l of the fit linearised at its answer, + outside S and - inside. The next set is the m + 1 points
with the smallest ratio of |t| to its limit. The search stops when the largest of these ratios exceeds 1: that point and
all beyond it are outliers. The limit is the quantile of Student's t at level α/(2(m + 1)) with m - d - 1 degrees of
freedom, changed as the law of R differs from the normal one where the noise is not small beside the radius. Clean
Gaussian points then have an outlier in a share α of the data sets (Hadi & Simonoff 1993).

Before the search ends, the sphere is fitted once more, with the next point included. The point is an outlier only if
this also raises Σ(R - r)² by more than the squared limit times s². This second test needs no linearisation. While many
points are outside, all points clearly within the limit enter together; one at a time, each would enter as well.

Least trimmed squares: the sphere whose h smallest distances |R - r| have the least sum of squares.

A concentration step fits a sphere to the h points that are nearest to the last one, which lowers the sum (Rousseeuw &
Van Driessen 2006). The steps here fit by Taubin's method, which is near the geometric fit, needs no start and cannot
run away; the forward search that follows fits geometrically. All starts, which are spheres through d + 1 points, take
two steps, the best ten go on. Sets are in units of their own size, so that no power overflows.

The d + 1 points are chosen by a hash of counters: the same ones in each call, and for each set of a batch.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from study.arrays import Bools, Floats, Ints
from study.fits.closed_forms import smallest_root
from study.fits.geometric import ON, STATE, Room, Search, advance, begin, mle, sphere_sums, sum_about
from study.fits.jit import CHUNK, SampleBlock, Scratch, Sums, compiled, dot, fill, squared, zeros
from study.fits.linalg import cholesky_solve, diagonalise, eigenbasis
from study.fits.mixture import gain, in_own_units, mixture, standard_errors, white_errors, without_isolated
from study.fits.moments import Moments, accumulate
from study.fits.samples import Estimates, Samples, Status, blank, reach_of_copies, repeated
from study.fits.subsets import SUBSAMPLE, elemental, spread_out

FALSE_ALARMS = 0.01
"""Share α of data sets without outliers in which one is found."""
_WITHOUT_RADIUS = 0.534
"""d Var R/(E R)² of points that scatter about one place: (Var R)/(E R)² is at most this over d."""
_POWER = 0.31
"""Without a radius, R to the power 1 less this is nearly normal in its upper tail."""
_LITTLE = 1e-4
"""Var R/(E R)² below which R is normal."""
_CONCENTRATIONS = 10
"""Most geometric fits of h points before the set grows."""
_MANY = 40
"""With more points outside, several enter at once ..."""
_CLEARLY = 0.8
"""... namely those whose deleted residuals are below this share of their limit."""
_FURTHEST = 1000.0
"""An outlier is no less likely for being further away than so many times the set's size."""
_ENTROPY = 0.5 * math.log(2.0 * math.pi * math.e)
_LEAST = 1e-3
"""Least 1 - l: a fit goes through a point of leverage 1 whatever it is."""
_EXACT = 2000
"""Limits of larger point sets are interpolated between this many set sizes."""
_FEW = 40
"""Degrees of freedom beyond which the choice of the clean points does not matter."""
_CHOICE = 0.01
"""Share of α that the union bound spends on each number of outliers from two on."""
_BATCH = 1 << 16
"""Elemental spheres that are formed together."""
_ENOUGH = 20
"""Points from which clutter is weighed: with fewer, a sphere through few of them may be the most likely one."""
_TOGETHER = 1 << 15
"""Points that are weighed together."""
_CERTAIN, _EACH, _SOON = 5.0, 180.0, 10
"""Log-likelihood that tells of clutter, after so many rounds: the first, the second over the number of points, and the
first times the parameters that curvature adds. Chosen by the .999 quantiles of clean sets of 20 to 500 points on caps
and circles; of 11,000 others, of 20 to 200 points with noise of .02 to .1 radii, 7 had more, at most 3 of 1000 in one
cell."""


def robust(samples: Samples) -> Estimates:
    """Maximum likelihood where some points may be clutter: `mle` unless `find` finds some.

    Up to just under half of the points may be anywhere. Without outliers it equals `mle`, except in one data set in a
    hundred, in which a clean point is taken for an outlier. It fails if some sphere fits more than half of the points
    within the noise, outliers included. Two examples: far points beside a small cap that does not determine the radius,
    and a cluster a few standard deviations from the sphere.

    Source: Torr & Zisserman 2000; Rousseeuw & Van Driessen 2006; Hadi & Simonoff 1993; theory §11.
    """
    found = find(samples)
    if not found.named.any():
        return mle(samples)
    result = _of_the_rest(samples.x, found.named)
    weighed = np.isfinite(found.radius) & (result.status == Status.OK)
    for whole, values in zip(result, (found.center, found.radius, found.variance), strict=False):
        whole[weighed] = values[weighed]
    return result


def _part(estimates: Estimates, sets: Ints) -> Estimates:
    """Estimates of some sets."""
    return Estimates._make([array[sets] for array in estimates])


def _of_the_rest(x: Floats, named: Bools) -> Estimates:
    """`mle` of sets (b, d, n) from the points that are not named."""
    result = blank(*x.shape[:2])
    for sets, rest in Samples(np.where(named[:, None], np.nan, x)).by_count():
        for whole, part in zip(result, mle(rest), strict=True):
            whole[sets] = part
    return result


def outliers(samples: Samples, from_all: bool = False) -> Bools:
    """Find the points (b, n) that do not belong to the sphere of the majority; see `find`."""
    return find(samples, from_all).named


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


def find(samples: Samples, from_all: bool = False, known: Floats | None = None) -> Found:
    """Find the points that do not belong to the sphere of the majority.

    More than half of the points are taken to lie on one sphere with Gaussian noise of unknown size. Least trimmed
    squares and a forward search tell whether there are outliers: in data without any, they find one in about 1 % of the
    data sets, whatever their number of points. With 20 points or more, a mixture of a sphere and
    uniform clutter is fitted if the search finds outliers, or if its likelihood leaves no doubt. The outliers are then
    the points that are more probably clutter. Otherwise they are those of the search.

    Copies of a point count once, and are outliers together.

    Args:
        samples: the batch. Missing samples (NaN) are no outliers. A noise level given with them is not used.
        from_all: begin the search with the geometric fit of all points alone. That takes a tenth of the time, and
            serves where a few outliers hide no others.
        known: radii (b,), if they are known. The sphere among clutter is fitted with them fixed, and the factor of the
                radius is 1.

    Returns:
        The outliers. A set with fewer than d + 3 different points, in a plane, or with a coordinate that is not finite,
        has none.

    Source: Torr & Zisserman 2000; Rousseeuw & Van Driessen 2006; Hadi & Simonoff 1993; theory §11.
    """
    x = samples.x
    b, d, n = x.shape
    named, spheres = np.zeros((b, n), dtype=np.bool_), np.full((b, d + 1), np.nan)
    different = ~repeated(x) & ~np.isnan(x).any(axis=1)
    whole = np.flatnonzero(different.all(axis=1))
    named[whole], spheres[whole] = _among(np.ascontiguousarray(x[whole]), from_all)
    apart = np.flatnonzero(~different.all(axis=1))
    for t in apart:
        some = np.ascontiguousarray(x[t][:, different[t]])[None]
        named[t, different[t]], spheres[t : t + 1] = _among(some, from_all)
    result = Found(named, np.full((b, d), np.nan), np.full(b, np.nan), np.full(b, np.nan), np.ones((b, d + 1)))
    count = different.sum(axis=1)
    for m in np.unique(count[count >= _ENOUGH]):
        alike = np.flatnonzero((count == m) & (named.any(axis=1) | np.isfinite(spheres[:, d])))
        size = max(_TOGETHER // m, 1)
        for sets in (alike[i : i + size] for i in range(0, len(alike), size)):
            points = np.nonzero(different[sets])[1].reshape(len(sets), m)
            given = None if known is None else known[sets]
            _weigh(np.take_along_axis(x[sets], points[:, None], axis=2), points, spheres[sets], sets, result, given)
    for t in apart[named[apart].any(axis=1)]:
        reach = reach_of_copies(x[t])
        with np.errstate(all="ignore"):  # points may be further apart than the largest number
            for k in np.flatnonzero(named[t]):
                named[t] |= (np.abs(x[t] - x[t][:, k : k + 1]) <= reach).all(axis=0)
    return result


def _weigh(x: Floats, points: Ints, spheres: Floats, sets: Ints, result: Found, known: Floats | None) -> None:
    """Fit spheres among clutter to sets (k, d, m), and write them where there is some.

    Args:
        x: the different points.
        points: their places in the batch (k, m).
        spheres: those of least trimmed squares (k, d + 1), NaN if they were not sought.
        sets: places of the sets (k,).
        result: the outliers so far; receives the new ones, and the spheres.
        known: radii (k,), if they are known.
    """
    y, middle, size, floor = in_own_units(x)
    radius = (lambda places: None) if known is None else (known / size[:, 0, 0]).__getitem__
    fixed = known is not None
    d, named = y.shape[1], result.named[sets[:, None], points]
    rest = _of_the_rest(y, named)
    trimmed = np.column_stack([spheres[:, :d] - middle[:, :, 0], spheres[:, d]]) / size[:, 0]
    clutter = np.asarray(named.any(axis=1))
    unsure = np.flatnonzero(~clutter)
    quick = mixture(y[unsure], trimmed[unsure], floor[unsure], _SOON, radius(unsure))
    extra = extra_parameters(y[unsure], rest.center[unsure], rest.radius[unsure])
    limit = _CERTAIN * (1.0 + extra) + _EACH / y.shape[2]
    clutter[unsure] = gain(y[unsure], quick, _part(rest, unsure)) > limit
    some = np.flatnonzero(clutter)
    if not len(some):
        return
    y, middle, size, rest = y[some], middle[some, :, 0], size[some, 0, 0], _part(rest, some)
    found = mixture(y, trimmed[some], floor[some], known=radius(some))
    other = mixture(y, np.column_stack([rest.center, rest.radius]), floor[some], known=radius(some))
    better = gain(y, other, rest) > gain(y, found, rest)
    for one, two in zip(found, other, strict=True):
        one[better] = two[better]
    found = without_isolated(y, found, floor[some], fixed)
    kept = found.weights > 0.5
    ratio = standard_errors(y, found, fixed) / white_errors(y, found, kept, fixed)
    good = np.isfinite(ratio).all(axis=1) & (kept.sum(axis=1) > d + 2)
    some, places = sets[some[good]], points[some[good]]
    result.named[some[:, None], places] = ~kept[good]
    result.center[some] = (middle + size[:, None] * found.center)[good]
    result.radius[some] = (size * found.radius)[good]
    result.variance[some] = np.square(size * found.scale)[good]
    result.ratio[some, : ratio.shape[1]] = np.maximum(ratio[good], 1.0)


def _among(x: Floats, from_all: bool) -> tuple[Bools, Floats]:
    """Outliers of sets (b, d, n) without missing samples or copies, and spheres of least trimmed squares (b, d + 1)."""
    b, d, n = x.shape
    result, spheres = np.zeros((b, n), dtype=np.bool_), np.full((b, d + 1), np.nan)
    if n < d + 3:
        return result, spheres
    size = max(_BATCH // len(elemental(min(n, SUBSAMPLE), d + 1)), 1)
    usable = np.flatnonzero(np.isfinite(x).all(axis=(1, 2)))
    for begun in range(0, len(usable), size):
        sets = usable[begun : begun + size]
        result[sets], spheres[sets] = _search(x[sets], from_all)
    return result, spheres


def _search(x: Floats, from_all: bool) -> tuple[Bools, Floats]:
    """Outliers of sets (b, d, n) by forward searches, about their medians and in units of their sizes.

    The first starts from the spheres of least trimmed squares. Where it finds outliers, a second one starts from the
    geometric fit of all points, and the more likely result is taken: if more than half of the points lie close
    together, the first search may find a small sphere among those, and take all others for outliers. With
    ``from_all`` there is the second search alone.

    The rate of false alarms is stated for sets without outliers. So the corrections for curvature come from the fit of
    all points: points selected for being near one sphere underestimate the noise.
    """
    _, d, n = x.shape
    y, middle, size, floor = in_own_units(x)
    whole = mle(Samples(y))
    extra = extra_parameters(y, whole.center, whole.radius)
    with np.errstate(all="ignore"):
        share = whole.noise_variance * (n - d - 1) / np.maximum(n - d - 1 - extra, 1.0) / whole.radius**2
    share[~(share < np.inf)] = 0.0
    limits = Limits(limits_of(n, d), floor, extra, share)
    starts = np.concatenate([whole.center, whole.radius[:, None]], axis=1)
    spheres = np.full_like(starts, np.nan) if from_all else best_spheres(y)
    outside, cost = _grow(y, starts if from_all else spheres, limits)
    again = np.flatnonzero(outside.any(axis=1))
    if len(again) and not from_all:
        limits = Limits(limits.quantiles, floor[again], extra[again], share[again])
        other, other_cost = _grow(y[again], starts[again], limits)
        better = other_cost < cost[again]
        outside[again[better]] = other[better]
    spheres *= size[:, :, 0]
    spheres[:, :d] += middle[:, :, 0]
    return outside, spheres


def extra_parameters(y: Floats, centers: Floats, radii: Floats) -> Floats:
    """Parameters that curvature adds to the d + 1 of a sphere, of geometric fits of the sets (b, d, n).

    It is Tr H⁻¹K - d (b,) with K = Σ(e - ē)(e - ē)ᵀ and H half the Hessian of Σ(R - r)², held between 0 and d; d
    where the fit is no minimum.

    Source: Moody 1992; theory 11.3.
    """
    _, d, n = y.shape
    with np.errstate(all="ignore"):
        e = y - centers[:, :, None]
        distance = np.linalg.norm(e, axis=1)
        e /= distance[:, None]
        mean = e.mean(axis=2)
        tilted = e - mean[:, :, None]
        share = radii[:, None] / distance
        k = tilted @ tilted.swapaxes(1, 2)
        h = (e * share[:, None]) @ e.swapaxes(1, 2) - n * mean[:, :, None] * mean[:, None]
        h += (n - share.sum(axis=1))[:, None, None] * np.eye(d)
        values, vectors = eigenbasis(h)
        trace = np.einsum("bik,bij,bjk,bk->b", vectors, k, vectors, 1.0 / values)
        return np.asarray(np.where((values[:, 0] > 0.0) & (trace < np.inf), np.clip(trace - d, 0.0, d), d))


@lru_cache(maxsize=32)
def limits_of(n: int, d: int) -> Floats:
    """Critical values (n,): with m clean points, the largest |t| that the nearest of the other n - m points may have.

    It is the quantile of Student's t at level α/(2(m + 1)) on either side with m - d - 1 degrees of freedom. With few
    degrees of freedom, the m points may have been selected because their residuals are small by chance. The limit is
    then raised by a union bound over all choices of the n - m others, to a probability of 0.01 α.

    Returns:
        The limit beside m points at place m; NaN where m < d + 2.

    Source: Hadi & Simonoff 1993; theory §11.
    """
    m, first = np.arange(n, dtype=float), d + 2
    nodes = np.arange(first, n) if n <= _EXACT else np.unique(np.geomspace(first, n - 1, _EXACT).astype(int))
    freedom = np.asarray(nodes - (d + 1), dtype=np.float64)
    limits = -scipy.special.stdtrit(freedom, 0.5 * FALSE_ALARMS / (nodes + 1.0))
    chosen = (freedom <= _FEW) & (nodes < n - 1) & (2 * nodes >= n)
    levels = math.log(_CHOICE * FALSE_ALARMS) - np.log(scipy.special.comb(n, nodes[chosen]))
    limits[chosen] = np.maximum(limits[chosen], _all_beyond(freedom[chosen], n - nodes[chosen].astype(float), levels))
    return np.asarray(np.where(m >= first, np.interp(np.log(m + 1.0), np.log(nodes + 1.0), limits), np.nan))


def _all_beyond(freedom: Floats, count: Floats, levels: Floats) -> Floats:
    """Limits q at which log P(|z| > q s for all of ``count`` normal z) has the given values, s² ~ χ²/freedom."""
    log_s = np.linspace(-20.0, 2.0, 441)
    density = freedom[:, None] * log_s - 0.5 * freedom[:, None] * np.exp(2.0 * log_s)
    density -= scipy.special.logsumexp(density, axis=1, keepdims=True)
    low, high = np.zeros(len(count)), np.full(len(count), 20.0)  # of log q
    for _ in range(40):
        middle = 0.5 * (low + high)
        tails = math.log(2.0) + scipy.special.log_ndtr(-np.exp(middle[:, None] + log_s))
        above = scipy.special.logsumexp(density + count[:, None] * tails, axis=1) > levels
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.asarray(np.exp(0.5 * (low + high)))


_FIRST, _LAST = 2, 20
"""Concentration steps of every start, and most of a finalist."""
_FINALISTS = 10
_FALL = 1e-3
"""A step that lowers the sum by a smaller share is the last."""
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
def select_nearest(y: Floats, sphere: Floats, h: int, selection: Selection) -> float:
    """Select the h points nearest to a sphere, or more with ties, and return the sum of h squared distances."""
    distance, inside = selection.distance, selection.inside
    residuals(y, sphere, distance)
    for k in range(distance.size):
        distance[k] = abs(distance[k])
    limit = float(np.partition(distance, h - 1)[h - 1])
    total, count = 0.0, 0
    for k in range(distance.size):
        inside[k] = distance[k] <= limit
        total += distance[k] * distance[k] if inside[k] else 0.0
        count += inside[k]
    return max(total - (count - h) * limit * limit, 0.0)


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
def _concentrate(y: Floats, h: int, steps: int, spheres: Floats, sums: Floats, zero: Sums, square: Sums) -> None:
    """Improve spheres (b, s, d + 1) of the sets (b, d, n) by concentration steps, two or more, in place.

    ``sums`` (b, s) receives the sums of the h smallest squares; infinite where there is no sphere.
    """
    b, d, n = y.shape
    selection, trial = new_selection(n, zero, square), np.empty(d + 1)
    for t in range(b):
        for s in range(spheres.shape[1]):
            sums[t, s], total = math.inf, math.inf
            for i in range(d + 1):
                trial[i] = spheres[t, s, i]
            step, going = 0, bool(trial[d] < math.inf)
            while going:
                before, total = total, select_nearest(y[t], trial, h, selection)
                if total < sums[t, s]:
                    sums[t, s] = total
                    for i in range(d + 1):
                        spheres[t, s, i] = trial[i]
                going = step < _FIRST or (step < steps and total < before * (1.0 - _FALL))
                going = going and _taubin(y[t], selection, trial)
                step += 1


@compiled
def majority(n: int, d: int) -> int:
    """Number of points that least trimmed squares fits, which resists the most outliers."""
    return (n + d + 2) // 2


def best_spheres(y: Floats) -> Floats:
    """Spheres (b, d + 1) of least trimmed squares of the sets (b, d, n); NaN where there is none.

    Of more than `SUBSAMPLE` points as many are searched first, and the two best spheres of these improved.
    """
    b, d, n = y.shape
    places = spread_out(n)
    part = np.ascontiguousarray(y[:, :, places]) if len(places) < n else y
    subsets = elemental(len(places), d + 1)
    spheres = np.empty((b, len(subsets), d + 1))
    _elemental_spheres(part, subsets, spheres)
    spheres = _best(part, _LAST, _best(part, _FIRST, spheres, _FINALISTS), 2)
    return np.ascontiguousarray((spheres if part is y else _best(y, _LAST, spheres, 1))[:, 0])


def _best(y: Floats, steps: int, spheres: Floats, count: int) -> Floats:
    """The best of the spheres (b, s, d + 1) after concentration steps (b, count, d + 1)."""
    d, sums = y.shape[1], np.empty(spheres.shape[:2])
    _concentrate(y, majority(y.shape[2], d), steps, spheres, sums, zeros(d), zeros(d, d))
    order = np.argsort(sums, axis=1, kind="stable")[:, :count]
    chosen = np.take_along_axis(spheres, order[:, :, None], axis=1)
    chosen[np.isinf(np.take_along_axis(sums, order, axis=1))] = np.nan
    return chosen


class Limits(NamedTuple):
    """Limits that residuals are compared with.

    Attributes:
        quantiles: Student's quantile for the next point, beside m points (n,).
        floor: residuals due to rounding (b,), per unit of the radius.
        extra: parameters that curvature adds, in the fit of all points (b,).
        share: (s/r)² from the fit of all points (b,), the most that clean points of the set have.
    """

    quantiles: Floats
    floor: Floats
    extra: Floats
    share: Floats


def _grow(y: Floats, spheres: Floats, limits: Limits) -> tuple[Bools, Floats]:
    """Outliers of each set (b, d, n) by a search that begins with the points nearest to a sphere (b, d + 1).

    Returns:
        True for outliers (b, n), none where the sphere is NaN; and the negative log-likelihood (b,): residuals are
        Gaussian inside and uniform outside up to the largest within reason, and every choice of as many outliers is as
        likely; infinite where there is no sphere.
    """
    b, d, n = y.shape
    outside, residual = np.zeros((b, n), dtype=np.bool_), np.stack([np.full(b, np.inf), np.zeros(b)])
    _grow_all(y, spheres, limits, outside, residual, zeros(d), zeros(d, d))
    inside, gammaln = n - outside.sum(axis=1), scipy.special.gammaln
    cost = inside * (0.5 * np.log(residual[0]) + _ENTROPY)
    with np.errstate(all="ignore"):
        gone = (n - inside) * np.log(2.0 * np.minimum(residual[1], _FURTHEST))
    gone += gammaln(n + 1.0) - gammaln(inside + 1.0) - gammaln(n - inside + 1.0)
    return outside, np.where(inside < n, cost + gone, cost)


@compiled
def _grow_all(
    y: Floats, spheres: Floats, limits: Limits, outside: Bools, residual: Floats, zero: Sums, square: Sums
) -> None:
    """Grow each set of a batch; see `_grow`.

    ``outside`` is False at first. ``residual`` receives variances inside and the largest distances outside (2, b).
    """
    quantiles, floor, extra, share = limits
    b, d, n = y.shape
    selection, sphere, e, origin = new_selection(n, zero, square), np.empty(d + 1), np.empty((d, n)), np.zeros(d)
    scratch, sums = Scratch(np.empty((1, d, CHUNK)), zero, square), sphere_sums(d)
    room, states = Room(np.empty(d), np.empty((d, d)), np.empty((d, d))), np.empty(1, STATE)
    best, trial, step = np.empty(d), np.empty(d), np.empty(d)
    distance, inside = selection.distance, selection.inside
    for t in range(b):
        for i in range(d + 1):
            sphere[i] = spheres[t, i]
        if not sphere[d] < math.inf:
            continue
        state = states[0]  # taken anew for each set, for a record does not keep the memory that it is in
        search = Search(state, best, trial, step)
        nearest, concentrations, growing = math.inf, 0, False
        squares = variance = above = below = rounding = 0.0
        following, suspected = 0, False
        while True:
            if not growing:  # the set is that of the points nearest to the last sphere, as long as they come nearer
                total = select_nearest(y[t], sphere, majority(n, d), selection)
                growing = concentrations == _CONCENTRATIONS or not total < nearest * (1.0 - 1e-9)
                nearest, concentrations = min(nearest, total), concentrations + 1
            points = selected(y[t], selection)
            m = points.shape[2]
            for i in range(d):
                best[i] = sphere[i]
            begin(search, 1.0, math.inf)
            block, status = SampleBlock(points, 0, 0, m), ON
            while status == ON:
                sum_about(block, origin, trial, state.radius, False, sums, scratch)
                status = advance(search, m, sums, room)
            for i in range(d):
                sphere[i] = best[i]
            sphere[d] = state.before
            if not growing:
                continue
            residuals(y[t], sphere, distance)
            before, squares = squares, 0.0
            for k in range(n):
                squares += distance[k] * distance[k] if inside[k] else 0.0
            if suspected:
                limit = above if distance[following] > 0.0 else below
                if squares - before > limit * limit * variance:
                    break
                suspected = False
                for k in range(n):
                    outside[t, k] = False
            if m == n:
                break
            rounding = floor[t] * (1.0 + sphere[d])
            variance = squares / max(m - d - 1 - extra[t], 1.0) + rounding * rounding
            among = variance / (sphere[d] * sphere[d])
            above = as_rare(float(quantiles[m]), max(among, share[t]), d)
            below = -as_rare(-float(quantiles[m]), among, d)
            _delete(y[t], sphere, selection, e, (m, math.sqrt(variance) * above, math.sqrt(variance) * below))
            cut = float(np.partition(distance, m)[m])
            if cut > 1.0:  # is the next point an outlier also if it is fitted along?
                suspected, following = True, -1
                for k in range(n):
                    outside[t, k] = not inside[k]
                    if outside[t, k] and (following < 0 or distance[k] < distance[following]):
                        following = k
                inside[following] = True
                continue
            limit, last, m = max(cut, _CLEARLY) if n - m > _MANY else cut, m, 0
            for k in range(n):
                inside[k] = distance[k] <= limit
                m += inside[k]
            if m <= last:  # a distance is not a number
                break
        count = n
        for k in range(n):
            if outside[t, k]:
                count -= 1
                residual[1, t] = max(residual[1, t], abs(distance[k]))
        rounding = floor[t] * (1.0 + sphere[d])
        freedom = count - d - 1 if suspected else max(n - d - 1, 1)
        residual[0, t] = (before if suspected else squares) / freedom + rounding * rounding


@compiled
def _delete(y: Floats, sphere: Floats, selection: Selection, e: Floats, limits: tuple[int, float, float]) -> None:
    """Replace the residuals R - r in ``selection.distance`` by the sizes of the deleted ones over their limits.

    Args:
        y: the points (d, n).
        sphere: fitted to the selected ones (d + 1,).
        selection: the residuals, and the points.
        e: receives the directions of the points, less the mean of the selected ones (d, n).
        limits: number of selected points, and the limits of R - r above and below.
    """
    d, n = y.shape
    m, above, below = limits
    distance, inside, right, factor = selection.distance, selection.inside, selection.vectors[0], selection.matrices[0]
    for i in range(d):
        right[i] = mean = 0.0
        for k in range(n):
            e[i, k] = (y[i, k] - sphere[i]) / max(distance[k] + sphere[d], 1e-150)  # a sample may lie at the centre
            mean += e[i, k] / m if inside[k] else 0.0
        for k in range(n):
            e[i, k] -= mean
        for j in range(i + 1):
            factor[i, j] = 0.0
            for k in range(n):
                factor[i, j] += e[i, k] * e[j, k] if inside[k] else 0.0
    regular = cholesky_solve(factor, right)
    for k in range(n):
        leverage = 1.0 / m
        if regular:
            for i in range(d):
                for j in range(i):
                    e[i, k] -= factor[i, j] * e[j, k]
                e[i, k] /= factor[i, i]
                leverage += e[i, k] * e[i, k]
        spread = max(1.0 - leverage, _LEAST) if inside[k] else 1.0 + leverage
        distance[k] = abs(distance[k]) / ((above if distance[k] > 0.0 else below) * math.sqrt(spread))


@compiled
def as_rare(z: float, share: float, d: int) -> float:
    """Quantile of (R - E R)/√(Var R) at the tail probability of the normal quantile z.

    With ``share`` = Var R/(E R)², R to a power below 1 is nearly normal in its upper tail: the value is right to 4 %
    for z of 3 to 5 and every radius and noise. In the lower tail, which ends at R = 0, the quantile is too far out,
    so the test is conservative.

    Source: theory 11.3.
    """
    if share < _LITTLE:
        return z
    most = _WITHOUT_RADIUS / d
    share = min(share, most)
    linear = (d - 1.0) / 3.0
    power = 1.0 - linear * share - (_POWER - linear * most) * squared(squared(share / most))
    moved = 1.0 - 0.5 * power * (1.0 - power) * share + power * math.sqrt(share) * z
    return float((max(moved, 0.0) ** (1.0 / power) - 1.0) / math.sqrt(share))
