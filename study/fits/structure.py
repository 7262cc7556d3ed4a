"""Structure in the residuals of fits: a quick look at every set, errors that allow for it, and doubts that matter.

The test of fit (`study.fits.goodness`) takes a few times as long as a fit. So one pass over the points of each set
forms its statistics as they are for small noise, and only sets in which one is near its limit are tested in full.

Where structure is seen, a series over the directions measures it, the residuals' own squares do, and a series over time
if the rows are in the order in which they were measured: structure of low order has coefficients of like size among
the harmonics that a sphere absorbs and among those that are left.

Source: theory §13.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.special import fdtri, stdtrit

from study.arrays import Bools, Floats, Ints
from study.fits.circle import on_circles
from study.fits.corrected import corrected
from study.fits.goodness import (
    LEVEL,
    SHARES,
    SMALL,
    evenly_thinned,
    form_of,
    goodness,
    harmonics,
    highest_degree,
    mean_square,
    number_of,
    on_the_fit,
    scores_of_residuals,
    tail_statistic,
    weights_of_degrees,
)
from study.fits.intervals import Intervals, intervals
from study.fits.jit import compiled, dot
from study.fits.samples import Estimates, Samples, binary_size, is_ordinary

_UPPER = 0.975
"""Probability at whose quantile the widths of several series are compared."""
_COSINES = 6
"""Terms of the series over time (Lazarus et al. 2018)."""
_FURTHEST = 3.0
"""Half of the largest residual, in its standard error, whose sine and cosine the quick look forms."""
_MARGIN = 1.5
"""Level of the quick look, in units of that of a block; its statistics are those of the full test but for σ²."""
_NOISY_MARGIN = 8.0
"""The same where the noise is above `SMALL`."""
_ALL_NOISE = 0.25
"""Noise in radii above which all sets are tested in full: what fills a body is seen by waves alone."""
_CLEAR = 1e-11
"""Least pivot of the columns' Gram matrix, relative to its diagonal, with which the quick look and the full test agree:
for caps of 12 to 180 degrees it missed none of 27,000 clean sets, of which some 300 speak."""
_GRUBBS = 0.012
"""Share of clean data sets that are searched for outliers because of their largest residual, a little above the 1 % in
which that search finds one."""
_PEAKED, _SINGLE, _FAR, _BY_CHANCE = 1.55, 2.0, 3.0, 5.0
"""Σ|x - x̄|⁴ N/(Σ|x - x̄|²)² is 1 to 4/3 on caps, 9/5 at most on arcs, and 5/3 at most where the noise is large. Above
the first of these and the last over N, points far from the rest may have drawn the fit to themselves, and left no
residual; above the second, one may carry the fit alone; above the third, there are some."""
_WELL_ABOVE = 3.0
"""Factor on an interval from which the fit is doubted."""
_EFFECT = 0.005
"""Least share of the residuals' variance, about, that structure explains in many points when the fit is doubted."""
_USUAL = 200
"""Number of points up to which everything that is seen matters."""
_HARMLESS_NOISE, _TWO_SHELLS, _SKEW = 0.1, 0.15, 0.03
"""Noise in radii, E cos(3t/2) and E sin t up to which tails do no harm: a normal t has .325 and 0, a uniform one .199
and 0, two concentric spheres .07 and 0."""
_ROUNDING = 1e-11
"""Noise in radii that rounding makes."""
_MOST_NUMBERS = 200_000
"""Numbers of directions and residuals held at a time."""


@cache
def _products(d: int, most: int) -> tuple[Ints, Ints]:
    """Columns that span the harmonics of degrees 0 … most: (k, 2) parent and coordinate, and the degrees' ends.

    They are monomials of the directions, less their mean, with the last coordinate at most once: its square is a sum of
    the others. From column d + 1 on, each is the product of an earlier one and a coordinate.
    """
    rows, ends = [[0, 0]] * (d + 1), [1, d + 1]
    last = [(j + 1, j) for j in range(d)]  # place and largest coordinate of each monomial of the degree before
    for _ in range(2, most + 1):
        following = []
        for place, largest in last:
            for j in range(largest, d):
                if not (j == largest == d - 1):
                    rows.append([place, j])
                    following.append((len(rows) - 1, j))
        last = following
        ends.append(len(rows))
    return np.array(rows), np.array(ends)


@compiled
def _columns(x: Floats, center: Floats, inverse: float, products: Ints, Y: Floats, rho: Floats) -> None:
    """Write the columns (k, n) of a set (d, n) and its residuals in radii (n,)."""
    d, n = x.shape
    for i in range(n):
        square = 0.0
        for j in range(d):
            away = (x[j, i] - center[j]) * inverse
            Y[j + 1, i] = away
            square += away * away
        rho[i] = math.sqrt(square)
    for i in range(n):
        over = 1.0 / rho[i]
        rho[i] -= 1.0
        Y[0, i] = 1.0
        for j in range(d):
            Y[j + 1, i] *= over
    for j in range(d):
        mean = 0.0
        for i in range(n):
            mean += Y[j + 1, i]
        mean /= n
        for i in range(n):
            Y[j + 1, i] -= mean
    for row in range(d + 1, products.shape[0]):
        parent, coordinate = products[row, 0], products[row, 1] + 1
        for i in range(n):
            Y[row, i] = Y[parent, i] * Y[coordinate, i]


@compiled
def _factorise(Y: Floats, L: Floats) -> float:
    """Write Cholesky's factor of Y Yᵀ (k, k), and return its least pivot relative to the diagonal."""
    (k, n), least = Y.shape, math.inf
    for i in range(0, k - 1, 2):  # four sums at a time, which take half as long as one after the other
        for j in range(0, i + 1, 2):
            a = b = c = d = 0.0
            for m in range(n):
                a += Y[i, m] * Y[j, m]
                b += Y[i, m] * Y[j + 1, m]
                c += Y[i + 1, m] * Y[j, m]
                d += Y[i + 1, m] * Y[j + 1, m]
            L[i, j], L[i, j + 1], L[i + 1, j], L[i + 1, j + 1] = a, b, c, d
    for j in range(k if k % 2 else 0):
        L[k - 1, j] = dot(Y[k - 1], Y[j])
    for j in range(k):
        before = L[j, j]
        for m in range(j):
            L[j, j] -= L[j, m] * L[j, m]
        least = min(least, L[j, j] / before)
        if not L[j, j] > 0.0:
            return 0.0
        L[j, j] = math.sqrt(L[j, j])
        for i in range(j + 1, k):
            value = L[i, j]
            for m in range(j):
                value -= L[i, m] * L[j, m]
            L[i, j] = value / L[j, j]
    return least


@compiled
def _coefficients(Y: Floats, L: Floats, values: Floats, count: int, result: Floats) -> None:
    """Coefficients of values (n,) on the first columns, made orthonormal one after the other."""
    for i in range(count):
        value = dot(Y[i], values)
        for j in range(i):
            value -= L[i, j] * result[j]
        result[i] = value / L[i, i]


@compiled
def _standardise(Y: Floats, L: Floats, variance: float, rho: Floats, V: Floats, leverage: Floats) -> float:
    """Divide the residuals, freed from the first d + 1 columns, by their standard errors; return the largest size.

    V (d + 1, n) receives these columns made orthonormal, and ``leverage`` (n,) their squares' sums.
    """
    n, largest = rho.size, 0.0
    for i in range(n):
        leverage[i] = 0.0
    for j in range(len(V)):
        for i in range(n):
            V[j, i] = Y[j, i]
        for m in range(j):
            for i in range(n):
                V[j, i] -= L[j, m] * V[m, i]
        over = 1.0 / L[j, j]
        for i in range(n):
            V[j, i] *= over
            leverage[i] += V[j, i] * V[j, i]
    for i in range(n):
        rho[i] /= math.sqrt(variance * max(1.0 - leverage[i], 1e-9))
        largest = max(largest, abs(rho[i]))
    return largest


@compiled
def _sine(h: float) -> float:
    """Sine by its series, to 1e-6 up to 3 in size; the library's cannot be vectorised."""
    q = h * h
    value = 1.0 - q / 210.0 * (1.0 - q / 272.0)
    value = 1.0 - q / 110.0 * (1.0 - q / 156.0 * value)
    return h * (1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * value))))


@compiled
def _cosine(h: float) -> float:
    """Cosine, likewise."""
    q = h * h
    value = 1.0 - q / 182.0 * (1.0 - q / 240.0 * (1.0 - q / 306.0))
    value = 1.0 - q / 90.0 * (1.0 - q / 132.0 * value)
    return 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0 * value)))


@compiled
def _look(x: Floats, centers: Floats, radii: Floats, products: Ints, ends: Ints, out: Floats) -> None:
    """Write the statistics of each set (b, 5 + degrees), of which the first is NaN where the test in full must tell.

    They are those of memory, the largest residual, the means of the residuals' sine and cosine, F of unequal noise, and
    the square sum of each degree from 2 on over the noise variance.
    """
    b, d, n = x.shape
    k, d1 = products.shape[0], d + 1
    Y, rho, w = np.empty((k, n)), np.empty(n), np.empty(n)
    L, v, slopes, V = np.empty((k, k)), np.empty(k), np.empty(d1), np.empty((d1, n))
    two = ends[2]
    for t in range(b):
        _columns(x[t], centers[t], 1.0 / radii[t], products, Y, rho)
        least = _factorise(Y, L)
        if not least > _CLEAR:
            out[t, 0] = math.nan
            continue
        _coefficients(Y, L, rho, k, v)
        total = dot(rho, rho)
        for j in range(d1):
            total -= v[j] * v[j]
        rest = total
        for j in range(d1, k):
            rest -= v[j] * v[j]
        for degree in range(2, ends.size):
            form = 0.0
            for j in range(ends[degree - 1], ends[degree]):
                form += v[j] * v[j]
            out[t, 3 + degree] = form / rest * (n - k)
        for i in range(n):  # residuals of the regression on 1 and e, from the last column to the first
            w[i] = 0.0
        for j in range(d1 - 1, -1, -1):
            value = v[j]
            for m in range(j + 1, d1):
                value -= L[m, j] * slopes[m]
            slopes[j] = value / L[j, j]
        for j in range(d1):
            for i in range(n):
                rho[i] -= slopes[j] * Y[j, i]
        products_of_rows = 0.0
        for i in range(n - 1):
            products_of_rows += rho[i] * rho[i + 1]
        out[t, 0] = products_of_rows / total
        out[t, 1] = _standardise(Y, L, total / (n - d1), rho, V, w)
        odd = even = mean = 0.0
        for i in range(n):
            h = min(max(0.5 * rho[i], -_FURTHEST), _FURTHEST)
            sine, cosine = _sine(h), _cosine(h)
            odd += 2.0 * sine * cosine
            even += cosine * (4.0 * cosine * cosine - 3.0)
            size = abs(rho[i])
            w[i] = math.sqrt(size * math.sqrt(size))  # |t|^¾ for |t|^⅔, which takes ten times as long
            mean += w[i]
        out[t, 2], out[t, 3] = odd / n, even / n
        for i in range(n):
            w[i] -= mean / n
        _coefficients(Y, L, w, two, v)
        form, square = 0.0, dot(w, w)
        for j in range(1, two):
            form += v[j] * v[j]
        out[t, 4] = form / (two - 1) / ((square - form) / (n - two))


class Look(NamedTuple):
    """The quick look at a batch.

    Attributes:
        seen: sets that must be tested in full (b,).
        extreme: sets that may have outliers (b,), by their largest residual; all with few points.
    """

    seen: Bools
    extreme: Bools


def quick_look(samples: Samples, fit: Estimates) -> Look:
    """Look at the fits of a batch (b, d, n) of complete sets by `corrected`."""
    b, d, n = samples.shape
    degree = highest_degree(n, d)
    products, ends = _products(d, degree)
    with np.errstate(all="ignore"):
        noise = np.sqrt(fit.noise_variance) / fit.radius
    usable = (noise > _ROUNDING) & (noise < np.inf)
    if len(products) - d - 1 > (n - d - 1) // 2 or n - d - 1 < 30:
        return Look(usable, usable)  # among few points outliers hide in each other's residuals
    sizes = np.diff(ends)[1:]
    out = np.empty((b, 5 + len(sizes)))
    with np.errstate(all="ignore"):
        _look(samples.rows, fit.center, fit.radius, products, ends, out)
        noisy = (noise > SMALL).astype(np.int64)
        shape, other = np.outer(-np.expm1(SHARES[:2] * math.log1p(-LEVEL)), [_MARGIN, _NOISY_MARGIN])
        seen = np.isnan(out[:, 0])
        for first, weight in weights_of_degrees(n)[: len(sizes)]:
            square, freedom = mean_square(out[:, 5 + first :].T, sizes[first:, None], weight)
            seen |= ~(square < fdtri(freedom, n - len(products), 1.0 - 0.6 * shape)[noisy])
        seen |= ~(out[:, 4] < fdtri(ends[2] - 1, n - ends[2], 1.0 - 1.5 * other)[noisy])
        seen |= tail_statistic(out[:, 2], out[:, 3], n, n - d - 1) > -2.0 * np.log(other)[noisy]
        spare = n - d - 1.0
        along = np.maximum(np.abs(out[:, 0] * n), np.abs(out[:, 0] * n + d + 1.0))  # its mean lies between 0 and d + 1
        seen |= along**2 / spare > fdtri(1, spare, 1.0 - other)[noisy]
        seen |= noise > _ALL_NOISE
    return Look(seen & usable, usable & (_extreme(out[:, 1], n, d) | np.isnan(out[:, 0])))


class Structure(NamedTuple):
    """Structure that the residuals of each set show, and its consequences.

    Attributes:
        speaks: True for each block of the test of fit that speaks (4, b).
        doubted: sets in which the model fails by enough to matter (b,).
        extreme: sets that may have outliers (b,).
        hinge: sets in space that lie on a circle (b,).
        ratio: factors of at least 1 on the standard errors of white noise, of the centre and the radius (b, d + 1).
        freedom: degrees of freedom of Student's t that goes with them (b, d + 1); infinite for white noise.
        kurtosis: N Σ|x - x̄|⁴/(Σ|x - x̄|²)² of the points, less what chance adds (b,).
    """

    speaks: Bools
    doubted: Bools
    extreme: Bools
    hinge: Bools
    ratio: Floats
    freedom: Floats
    kurtosis: Floats

    @property
    def spread(self) -> Bools:
        """True for sets in which points may lie so far from the rest that they are outliers without a residual (b,)."""
        return self.kurtosis > _PEAKED

    @property
    def single(self) -> Bools:
        """True for sets in which one point may lie so far from the rest that it carries the fit alone (b,)."""
        return self.kurtosis > _SINGLE

    @property
    def far(self) -> Bools:
        """True for sets in which points certainly lie far from the rest (b,)."""
        return self.kurtosis > _FAR

    def stretch(self, level: float, spare: Ints) -> Floats:
        """Factors on the half-widths of intervals with ``spare`` (b,) degrees of freedom (b, d + 1); 1 if no structure.

        Args:
            level: nominal coverage.
            spare: degrees of freedom of the noise of each set.
        """
        factors, quantile = np.ones_like(self.ratio), 0.5 * (1.0 + level)
        sets = np.flatnonzero((self.ratio > 1.0).any(axis=1))
        ends = stdtrit(spare[sets, None].astype(float), quantile)
        wide = stdtrit(np.minimum(self.freedom[sets], spare[sets, None]), quantile)
        factors[sets] = np.maximum(self.ratio[sets] * wide / ends, 1.0)
        return factors


def structure(samples: Samples, ordered: bool = False, known: Estimates | None = None) -> Structure:
    """Look for structure in each set of points.

    Args:
        samples: the points (b, d, n), missing ones as NaN, copies left out.
        ordered: the rows are in the order in which they were measured.
        known: their fits by `corrected`, if there are.

    Source: theory §13.
    """
    b, d, _ = samples.shape
    no = np.zeros((7, b), dtype=np.bool_)
    white = np.ones((b, d + 1)), np.full((b, d + 1), np.inf)
    result = Structure(no[:4], no[4], no[5], no[6], *white, np.zeros(b))
    for sets, present in samples.by_count():
        n = present.shape[2]
        finite = np.isfinite(present.moments.fourth)
        if n < d + 4 or not finite.any():
            continue
        if not finite.all():
            sets, present = sets[finite], present.take(np.flatnonzero(finite))
        if not is_ordinary(present.moments.fourth):  # a unit of their own size
            present, known = Samples(np.ldexp(present.x, -binary_size(present.x)[:, None, None])), None
        tested = evenly_thinned(present)
        with np.errstate(all="ignore"):
            fit = corrected(present) if known is None else Estimates._make([array[sets] for array in known])
            look = quick_look(tested, fit)
            result.hinge[sets] = on_circles(present, fit)
        result.extreme[sets] = look.extreme
        square = np.einsum("bii->b", present.moments.second)
        with np.errstate(invalid="ignore"):
            result.kurtosis[sets] = n * present.moments.fourth / square**2 - _BY_CHANCE / n
        seen = np.flatnonzero(look.seen)
        part = max(_MOST_NUMBERS // (10 * n), 1)
        for some in (seen[i : i + part] for i in range(0, len(seen), part)):
            _fill(present.take(some), tested.take(some), ordered, result, sets[some])
    return result


def widened(samples: Samples, level: float, white: Intervals, stretch: Floats) -> Intervals:
    """Intervals of errors that allow for structure, where there is some.

    The score of the radius is inverted anew, at a larger quantile. The ends of a coordinate of the centre, which come
    with it, are moved by its own factor.

    Args:
        samples: the points (b, d, n).
        level: nominal coverage.
        white: their intervals for white noise.
        stretch: factors of `Structure.stretch` (b, d + 1).
    """
    sets = np.flatnonzero((stretch > 1.0).any(axis=1))
    if not len(sets):
        return white
    radius, center, share = (array.copy() for array in white)
    of_radius = stretch[sets, -1]
    again = intervals(samples.take(sets), level, of_radius)
    with np.errstate(all="ignore"):
        middle = again.center.mean(axis=2, keepdims=True)
        ends = middle + (again.center - middle) * (stretch[sets, :-1] / of_radius[:, None])[:, :, None]
    center[sets] = np.where(np.isfinite(again.center), ends, again.center)
    radius[sets] = again.radius
    return Intervals(radius, center, share)


def _extreme(largest: Floats, n: int, d: int) -> Bools:
    """True where the largest of n studentised residuals is beyond Grubbs' limit (b,)."""
    spare = n - d - 1.0
    q = stdtrit(spare - 1.0, 1.0 - 0.5 * _GRUBBS / n)
    return np.asarray(largest > q * np.sqrt(spare / (spare - 1.0 + q * q)))


def _fill(samples: Samples, tested: Samples, ordered: bool, result: Structure, sets: Ints) -> None:
    """Test some complete sets in full, and fill in their places in the result."""
    n = tested.shape[2]
    answer = goodness(tested)
    result.speaks[:, sets] = answer.speaks()
    strong = answer.speaks(LEVEL * math.exp(-_EFFECT * max(n - _USUAL, 0)))
    where = np.flatnonzero(result.speaks[:, sets].any(axis=0))
    if not len(where):
        return
    with np.errstate(all="ignore"):
        used, R, Y, s = on_the_fit(samples.x[where], harmonics(samples.shape[1], 2))
        places = where[used]
        matters = strong[0, places] | strong[1, places] | (strong[3, places] & (not ordered))
        matters |= strong[2, places] & ~_harmless(R, Y, s)
        matters &= ~(ordered & (answer.first()[places] == "memory"))  # which the errors allow for
        structured = np.flatnonzero(result.speaks[:, sets[places]][[0, 1, 3]].any(axis=0))
        here = sets[places[structured]]
        result.ratio[here], result.freedom[here] = _allowance(R[structured], Y[structured], ordered)
        wide = result.stretch(0.95, np.full(len(result.ratio), samples.shape[2] - samples.shape[1] - 1))[sets[places]]
    result.doubted[sets[places]] = matters | (wide > _WELL_ABOVE).any(axis=1)


def _harmless(R: Floats, Y: Floats, s: Floats) -> Bools:
    """True where the noise is small, and its tails are long or short on both sides alike, as in no other shape."""
    t = scores_of_residuals(R, Y, s, _dimension(Y))[2]
    even, odd = np.cos(1.5 * t).mean(axis=1), np.abs(np.sin(t).mean(axis=1))
    return np.asarray((s < _HARMLESS_NOISE**2) & (even > _TWO_SHELLS) & (odd < _SKEW))


def _dimension(Y: Floats) -> int:
    """The dimension whose harmonics of degrees up to 2 are as many as these (b, k, n)."""
    return next(d for d in range(2, Y.shape[1]) if Y.shape[1] == 1 + d + number_of(d, 2))


def _allowance(R: Floats, Y: Floats, ordered: bool) -> tuple[Floats, Floats]:
    """Factors on the standard errors of fitted sets, and their degrees of freedom (b, d + 1); the largest counts."""
    b, _, n = Y.shape
    d = _dimension(Y)
    X, spare = Y[:, : d + 1], n - d - 1
    inverse = np.linalg.inv(X @ X.swapaxes(1, 2))
    pull = (inverse @ X)[:, np.r_[1 : d + 1, 0]]  # (c, r) = pull ρ to first order
    rho = (R - 1.0) - ((R - 1.0)[:, None] @ X.swapaxes(1, 2) @ inverse @ X)[:, 0]
    weight = np.einsum("bkn,bkn->bk", pull, pull)
    white = weight * (np.einsum("bn,bn->b", rho, rho) / spare)[:, None]
    ratio, freedom, best = (
        np.ones((b, d + 1)),
        np.full((b, d + 1), np.inf),
        np.full((b, d + 1), float(stdtrit(spare, _UPPER))),
    )

    def admit(variance: Floats, free: Floats) -> None:
        width = np.sqrt(variance / white) * stdtrit(free, _UPPER)
        larger = width > best
        best[larger], ratio[larger] = width[larger], np.sqrt(variance / white)[larger]
        freedom[larger] = np.broadcast_to(free, (b, d + 1))[larger]

    gram = Y[:, d + 1 :] - Y[:, d + 1 :] @ X.swapaxes(1, 2) @ inverse @ X
    form, count, _ = form_of((gram @ rho[:, :, None])[:, :, 0], gram @ gram.swapaxes(1, 2), max(spare // 3, 2))
    admit(weight * (form / count)[:, None], count[:, None].astype(float))
    leverage = np.einsum("bkn,bkl,bln->bn", X, inverse, X, optimize=True)
    admit((pull**2 @ ((rho / (1.0 - leverage)) ** 2)[:, :, None])[:, :, 0], np.full((b, 1), float(spare)))
    if ordered:
        places = np.pi * np.outer(np.arange(1, _COSINES + 1), (np.arange(n) + 0.5) / n)
        along = (pull * rho[:, None]) @ np.cos(places).T * np.sqrt(2.0)
        admit((along**2).mean(axis=2), np.full((b, 1), float(_COSINES)))
    return np.maximum(ratio, 1.0), freedom
