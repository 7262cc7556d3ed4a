"""A test of fit: whether points are a sphere with white noise of one size, by moments that hold for all directions.

For a point y = c + r u + noise, isotropic and normal, with R = |y - c|, e = (y - c)/R and a spherical harmonic Y of
degree l,

    E[(R - λ) Y(e) | u] = 0 for every u,      λ = E[R P_l(e·u)] / E[P_l(e·u)],

whatever the law of the directions is; P_l is the Gegenbauer polynomial. Moments of plane waves obey such conditions as
well, and have more power where the noise is large (13.2). Four blocks of tests are made: *shape*, *unequal noise*
(heteroscedasticity), *tails* (other than normal) and *memory* of the rows (serial correlation). The errors of centre,
radius and noise are taken out of each, and each gives a p value, or the reason why there is none.

Points may have weights: residuals are divided by each point's own noise, and the regressions are weighted.

Source: theory §13.
"""

import math
from functools import cache
from itertools import combinations_with_replacement
from math import comb, factorial, prod
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.special import (
    betainc,
    chdtrc,
    chdtri,
    chndtr,
    chndtrinc,
    fdtri,
    gammaincc,
    hyp0f1,
    ive,
    jv,
    ncfdtrinc,
    ndtri,
)

from study.arrays import Bools, Floats, Ints
from study.fits.loops.jit import compiled_as_written, squared
from study.fits.points.samples import Estimates, Samples, Worded

BLOCKS = ("shape", "unequal noise", "tails", "memory")
TESTS = (*BLOCKS, "hinge", "outliers")
SHAPE, MEMORY, HINGE, OUTLIERS = (TESTS.index(name) for name in ("shape", "memory", "hinge", "outliers"))
SHARES = np.array([3.0, 1.0, 1.0, 1.0]) / 6.0
"""Shares of the level that the blocks have: whether the points are a sphere is the question."""
LEVEL = 0.01
"""Overall level at which the test speaks."""
_DEGREES = 4
_SMOOTH = 0.5
"""Weight of the harmonics of a degree over those of the degree before, in `_MANY` points: smooth forms have most in the
lowest degrees. In fewer points, where shapes like ellipsoids would be seen less often, degree 2 counts alone."""
_MOST_HARMONICS = 100
"""Number of harmonics that are tested, at most, beside those of degree 2."""
_IN_CACHE = 4_000
"""Points whose harmonics are formed at a time, which stay in a processor's cache."""
_MOST_POINTS, _STRETCHES = 100_000, 100
"""Points of a set that are tested, at most, and the number of stretches of rows that they are taken in."""
_LEAST = 1e-13
"""Least mean square of a direction of the harmonics beside which rounding counts."""
SMALL = 0.05
"""Noise in radii up to which residuals are taken to be normal and of one size given the directions."""
_LITTLE, _MODERATE = 0.35, 2.0
"""Largest noise of the tests for small noise, as multiples of the least standard deviation of the directions: by all
degrees, and by degree 2 alone. Simulated clean caps (30° to 180°, d = 2 to 4, N = 10 to 85, 800 sets a cell): at a
level of 1 %, at most 2 % are rejected."""
_APPARENT = 0.5
"""The same multiple up to which neighbours are compared: beyond, noise hides which points are neighbours."""
_LARGEST_NOISE = 0.45
"""Noise in radii beyond which no shape is tested: waves see a point."""
_NO_NOISE = 1e-22
"""Noise variance in square radii that rounding makes."""
_MANY = 300
"""Number of points from which the scores' own law is enough, and forms can be seen that are small beside the noise."""
_WAVES, _LAST_WAVE = ((0.01, 0), (1.0, 0), (1.0, 1)), 3.0
"""(τ r, degree) of the waves that are always tested, and the τ r that is tested with degrees 0, 2, 3 and 4."""
_LEAST_TERMS = 4
"""Points for each moment of waves beyond those that centre, radius and noise take, at least."""
_DEPENDENT = 1e-8
"""Share of the largest eigenvalue of the moments' correlation below which they depend on each other."""
_FAR, _SHRUNK = 1e-3, 1e-5
"""Noise in radii below which a distance is normal; and one that stands for any noise along the radius."""
_LARGEST_SCORE = 8.0
_LEAST_SPARE = 16
"""Least degrees of freedom of a test of unequal noise and tails."""
_NEAREST, _MOST_NEAR = 2, 20_000
"""Nearest directions to each point, times d - 1, that are its neighbours; and the number of points tested for it."""
_ABREAST = 16
"""Points whose distances are computed together, which a processor does side by side."""
_LEAST_SKEW = 0.01
"""Skewness below which a law is normal."""
_ODD = 0.5 * (1.0 - np.exp(-2.0)) - np.exp(-1.0)
_EVEN = 0.5 * (1.0 + np.exp(-4.5)) - (1.0 + 0.5 * 1.5**4) * np.exp(-2.25)
"""Variances of sin z and cos(3z/2) for normal z, freed from 1, z and z²."""
_EXACT_MEAN = 150
"""Degrees of freedom below which the mean of cos(3t/2) is a hypergeometric function, and beyond a series."""


class Answer(Worded):
    """Answer of one test of a fit; `Goodness.answers` holds their numbers."""

    PASSED = 0, "passed"
    FAILED = 1, "failed"
    NO_POINTS = 2, "not tested: the fit does not hold its points"
    NO_SPHERE = 3, "not tested: there is no sphere whose residuals could be looked at"
    TOO_FEW = 4, "not tested: the points are too few to tell"
    TOO_NOISY = 5, "not tested: the noise hides it"
    NO_NOISE = 6, "not tested: the points show no noise"
    ASSUMED = 7, "not tested: it is assumed"
    NOT_IN_SPACE = 8, "not tested: only points in space can lie on a hinge"


class Goodness(NamedTuple):
    """The tests of fits with leading axes `…`: p values, and an answer of each test.

    Attributes:
        shape: p value: the distances follow the directions beyond what a sphere explains (…).
        unequal_noise: the size of the residuals follows the directions (…).
        tails: the residuals are not normal (…).
        memory: residuals of neighbouring rows depend on each other (…).
        answers: number of the `Answer` of each of `TESTS` (6, …). A p value is NaN where a test was not made; the
            answer says why.
        visible_form: size of a form of degree 2 that the test of shape finds in half of such sets (…): the rms of its
            departures at the points from the sphere beside it, in σ. NaN where the shape was not tested.
    """

    shape: Floats
    unequal_noise: Floats
    tails: Floats
    memory: Floats
    answers: Ints
    visible_form: Floats

    @classmethod
    def untested(cls, shape: tuple[int, ...], answer: Answer) -> "Goodness":
        """No test was made, for one reason."""
        p = np.full((4, *shape), np.nan)
        return cls(p[0], p[1], p[2], p[3], np.full((len(TESTS), *shape), int(answer)), np.full(shape, np.nan))

    @property
    def values(self) -> Floats:
        """The p values (4, …), in the order of `BLOCKS`."""
        return np.stack([self.shape, self.unequal_noise, self.tails, self.memory])

    @property
    def p(self) -> Floats:
        """One p value for all blocks (…), the least of those corrected for their shares; NaN if none was tested."""
        with np.errstate(divide="ignore", invalid="ignore"):
            sound = np.log1p(-np.minimum(self.values, 1.0 - 1e-16)) / self._shares
        return np.asarray(-np.expm1(np.fmax.reduce(sound)))

    def speaks(self, level: float = LEVEL) -> Bools:
        """True for each block that speaks at an overall level (4, …)."""
        return np.asarray(self.values < -np.expm1(np.log1p(-level) * self._shares))

    @property
    def _shares(self) -> Floats:
        """Shares of the level (4, …), of the blocks that have a p value."""
        tested = np.isfinite(self.values)
        shares = SHARES.reshape(-1, *[1] * (tested.ndim - 1)) * tested
        return np.asarray(shares / np.maximum(shares.sum(axis=0), SHARES.min()))

    def first(self, level: float = LEVEL) -> np.ndarray[tuple[int, ...], np.dtype[np.str_]]:
        """Name of the block that explains what is seen at an overall level; "" if none speaks (…).

        It is the first that speaks, in the order of `BLOCKS`; but *memory* where its p value is the least. A form that
        is measured along a path makes neighbours alike, and noise with memory makes a form: what fits better is named.
        """
        speaks, values = self.speaks(level), self.values
        place = speaks.argmax(axis=0)
        others = np.fmin.reduce(np.where(speaks[:3], values[:3], 1.0))
        place = np.where(speaks[3] & (self.memory < others), 3, place)
        return np.where(speaks.any(axis=0), np.array(BLOCKS)[place], "")

    def reshape(self, *lead: int) -> "Goodness":
        """The same answers with other leading axes."""
        p = self.values.reshape(4, *lead)
        answers, form = self.answers.reshape(len(TESTS), *lead), self.visible_form.reshape(lead)
        return Goodness(p[0], p[1], p[2], p[3], answers, form)

    def take(self, place: int) -> "Goodness":
        """The tests of one fit of a flat batch."""
        p = self.values[:, place]
        return Goodness(p[0], p[1], p[2], p[3], self.answers[:, place], np.asarray(self.visible_form[place]))

    def by_block(self) -> dict[str, Floats]:
        """The p values by the names of their fields."""
        return dict(zip(self._fields[:4], self.values, strict=True))

    def in_words(self) -> dict[str, str]:
        """The answer of each test of a single fit, by its name."""
        return {name: Answer(int(answer)).text for name, answer in zip(TESTS, self.answers, strict=True)}


class Harmonics(NamedTuple):
    """Harmonics of degrees 0 … L in d dimensions as columns.

    Attributes:
        degree: degree of each column (k,).
        turns: for each degree from 1, products of monomials (new monomial from an old one times a coordinate) (m, 2).
        rules: for each degree, coefficients of its harmonics on its monomials.
        gradient: ∂_j of column k as a sum of columns (d, k, k).
    """

    degree: Ints
    turns: list[Ints]
    rules: list[Floats]
    gradient: Floats


@cache
def harmonics(d: int, most: int) -> Harmonics:
    """Harmonics of degrees 0 … most on the unit sphere in d dimensions; columns 1 … d are the coordinates."""
    turns, rules, degree = [], [np.ones((1, 1))], [0]
    monomials: list[list[tuple[int, ...]]] = [[()], [(i,) for i in range(d)]]
    for order in range(2, most + 1):
        monomials.append(list(combinations_with_replacement(range(d), order)))
    places = [{m: k for k, m in enumerate(row)} for row in monomials]
    derivative = [np.zeros((d, 1, 0))]
    for order in range(1, most + 1):
        turns.append(np.array([[places[order - 1][m[:-1]], m[-1]] for m in monomials[order]]))
        by = np.zeros((d, len(monomials[order]), len(monomials[order - 1])))
        for k, m in enumerate(monomials[order]):
            for j in set(m):
                rest = list(m)
                rest.remove(j)
                by[j, k, places[order - 1][tuple(rest)]] += m.count(j)
        derivative.append(by)
        if order == 1:
            rules.append(np.eye(d))
        else:
            laplacian = sum(by[j] @ derivative[order - 1][j] for j in range(d))
            # monomials of size 1 in a product of polynomials that no rotation changes (Bombieri's)
            size = np.sqrt([factorial(order) / prod(factorial(m.count(j)) for j in range(d)) for m in monomials[order]])
            rules.append((size[:, None] * null_space(laplacian.T * size)).T)
        degree += [order] * len(rules[-1])
    of = np.array(degree)
    gradient = np.zeros((d, len(of), len(of)))
    for order in range(1, most + 1):
        mine, lower = np.flatnonzero(of == order), np.flatnonzero(of == order - 1)
        for j in range(d):
            gradient[j][np.ix_(mine, lower)] = rules[order] @ derivative[order][j] @ np.linalg.pinv(rules[order - 1])
    return Harmonics(of, turns, rules, gradient)


def columns(e: Floats, basis: Harmonics) -> Floats:
    """Harmonics (b, k, n) of directions (b, d, n)."""
    b, d, n = e.shape
    out = np.empty((b, len(basis.degree), n))
    out[:, 0], out[:, 1 : d + 1] = 1.0, e
    size = max(_IN_CACHE // n, 1)
    for part in (slice(begun, begun + size) for begun in range(0, b, size)):
        last, at = e[part], d + 1
        for turn, rule in zip(basis.turns[1:], basis.rules[2:], strict=True):
            last = last[:, turn[:, 0]] * e[part][:, turn[:, 1]]
            np.matmul(rule, last, out=out[part, at : at + len(rule)])
            at += len(rule)
    return out


@cache
def _length_series(d: int, most: int) -> Floats:
    """Coefficients (2, most + 1, 9) of powers of 2s in E[R P_l(e·u)] and in E[P_l(e·u)]."""
    degree, k = np.arange(most + 1.0)[:, None], np.arange(8.0)
    ratios = [(0.5 * (degree - q) + k) * (k + 1.0 - 0.5 * (degree + q + d)) / (k + 1.0) for q in (1, 0)]
    return np.asarray(np.cumprod(np.pad(ratios, [(0, 0), (0, 0), (1, 0)], constant_values=1.0), axis=2), dtype=float)


def lengths(s: Floats, d: int, most: int) -> Floats:
    """λ_l of R (b, most + 1, …) for spheres of radius 1 and noise variances s (b, …) that are small."""
    series = _length_series(d, most)
    powers = (2.0 * s[:, None]) ** np.arange(series.shape[2]).reshape(-1, *[1] * (s.ndim - 1))
    first, zeroth = (np.einsum("lk,bk...->bl...", coefficients, powers) for coefficients in series)
    return np.asarray(first / zeroth)


def normal_scores(R: Floats, s: Floats, d: int) -> Floats:
    """Normal scores of distances R (b, n) from centres of unit spheres, of noise s (b, n or 1), for all directions.

    R²/s has a noncentral χ² law, exactly. Where the noise is small, Sankaran's power of it (1963) is normal.
    """
    z, far = (R - 1.0) / np.sqrt(s), 1.0 / np.maximum(s, _FAR**2)
    sets = np.flatnonzero((s > _FAR**2).any(axis=1))
    if len(sets):
        k, far = float(d), far[sets]
        h = 1.0 - (2.0 / 3.0) * (k + far) * (k + 3.0 * far) / (k + 2.0 * far) ** 2
        p, m = (k + 2.0 * far) / (k + far) ** 2, (h - 1.0) * (1.0 - 3.0 * h)
        mean = 1.0 + h * p * (h - 1.0 - 0.5 * (2.0 - h) * m * p)
        spread = h * np.sqrt(2.0 * p) * (1.0 + 0.5 * m * p)
        z[sets] = ((R[sets] ** 2 * far / (k + far)) ** h - mean) / spread
    sets = np.flatnonzero((s > SMALL**2).any(axis=1))
    if len(sets):
        square = R[sets] ** 2 / s[sets]
        z[sets] = np.clip(ndtri(chndtr(square, float(d), 1.0 / s[sets])), -_LARGEST_SCORE, _LARGEST_SCORE)
    return np.asarray(z)


@cache
def _size_by_degree(d: int) -> tuple[Floats, Floats]:
    """Ln of the variances s, and λ_l - λ_0 of φ = |z|^⅔ for degrees 1, 2 (2, k), z the normal score of R, by a sum."""
    s = np.geomspace(SMALL**2, 1.0, 60)[:, None]
    R = 1.0 + np.sqrt(s) * np.linspace(-_LARGEST_SCORE, _LARGEST_SCORE + d, 1501)
    R, order = np.maximum(R, 1e-9), 0.5 * d - 1.0
    weight = R ** (0.5 * d) * np.exp(-((R - 1.0) ** 2) / (2.0 * s)) * ive(order, R / s) * (R > 1e-9)
    size = np.cbrt(normal_scores(R, s * (1.0 + 1e-12), d) ** 2)
    means = []
    for degree in range(3):
        harmonic = weight * ive(order + degree, R / s) / ive(order, R / s)
        means.append((harmonic * size).sum(axis=1) / harmonic.sum(axis=1))
    return np.log(s[:, 0]), np.array(means[1:]) - means[0]


def f_tail(F: Floats, a: Floats | Ints, b: Floats | Ints | float) -> Floats:
    """Upper tail probability of Fisher's F; NaN without degrees of freedom."""
    with np.errstate(all="ignore"):
        return np.where((a > 0) & (b > 0), betainc(0.5 * b, 0.5 * a, b / (b + a * np.maximum(F, 0.0))), np.nan)


class Residuals(NamedTuple):
    """Points of complete sets about fitted spheres, in units of the radii.

    Attributes:
        R: distances from the centres (b, n).
        Y: harmonics of the directions (b, k, n); rows 1 … d are the directions.
        s: noise variance of a coordinate of a point of weight 1 (b,).
        weights: of the points, their mean 1 (b, n); the noise variance of a point is s over its weight. None if equal.
        basis: the harmonics that are rows of Y.
    """

    R: Floats
    Y: Floats
    s: Floats
    weights: Floats | None
    basis: Harmonics

    @classmethod
    def about(cls, x: Floats, spheres: Estimates, weights: Floats | None, degree: int) -> "Residuals":
        """Residuals of points (b, d, n) about spheres, with harmonics up to a degree."""
        y = (x - spheres.center[:, :, None]) / spheres.radius[:, None, None]
        R = np.sqrt(np.einsum("bdn,bdn->bn", y, y))
        basis = harmonics(x.shape[1], degree)
        return cls(R, columns(y / R[:, None], basis), spheres.noise_variance / spheres.radius**2, weights, basis)

    def take(self, places: Ints | Bools) -> "Residuals":
        """Some sets of the batch."""
        weights = None if self.weights is None else self.weights[places]
        return Residuals(self.R[places], self.Y[places], self.s[places], weights, self.basis)

    def shrunk(self) -> "Residuals":
        """For noise along the radius alone: residuals scaled to a small noise, as R is then normal at every size."""
        share = np.where(self.s > 0.0, _SHRUNK / np.sqrt(np.maximum(self.s, _NO_NOISE)), 1.0)
        return self._replace(R=1.0 + (self.R - 1.0) * share[:, None], s=self.s * share**2)

    @property
    def dimension(self) -> int:
        """The number of coordinates d."""
        return len(self.basis.gradient)

    @property
    def variances(self) -> Floats:
        """Noise variance of a coordinate of each point (b, n), or of all alike (b, 1)."""
        return self.s[:, None] if self.weights is None else self.s[:, None] / self.weights

    def weighted(self, rows: Floats) -> Floats:
        """Rows (b, …, n) times the roots of the weights."""
        if self.weights is None:
            return rows
        return rows * np.sqrt(self.weights).reshape(len(rows), *[1] * (rows.ndim - 2), -1)


class Seen(NamedTuple):
    """The tests of complete sets by their residuals.

    Attributes:
        goodness: p values and answers of the four blocks; the two last answers are for others to fill in.
        largest: the largest studentised residual (b,).
        harmless: the noise is small, and its tails are long or short on both sides alike, as in no other shape (b,).
    """

    goodness: Goodness
    largest: Floats
    harmless: Bools


_HARMLESS_NOISE, _TWO_SHELLS, _SKEW = 0.1, 0.15, 0.03
"""Noise in radii, E cos(3t/2) and E sin t up to which tails do no harm: a normal t has .325 and 0, a uniform one .199
and 0, two concentric spheres .07 and 0."""


def see(residuals: Residuals, ordered: bool = False) -> Seen:
    """Test complete sets by their residuals; sets that no sphere fits are not tested.

    Where the rows are in order of time, neighbours by direction are often neighbours in time, and are not compared.

    Source: theory §13.
    """
    R, Y, s, *_ = residuals
    (b, n), d = R.shape, residuals.dimension
    goodness = Goodness.untested((b,), Answer.NO_SPHERE)
    answers, largest, harmless = goodness.answers, np.full(b, np.nan), np.zeros(b, dtype=np.bool_)
    with np.errstate(all="ignore"):
        usable = np.isfinite(R).all(axis=1) & (R > 0.0).all(axis=1) & np.isfinite(s)
        silent = usable & ~(s > _NO_NOISE)
        answers[:4, silent] = int(Answer.NO_NOISE)
        e = residuals.weighted(np.where(usable[:, None, None], Y[:, : d + 1], 0.0))
        usable &= ~silent & (np.linalg.eigvalsh(e @ e.swapaxes(1, 2) / n)[:, 0] > _LEAST)
        if n < d + 4:
            answers[:4, usable] = int(Answer.TOO_FEW)
            return Seen(goodness, largest, harmless)
        sets = np.flatnonzero(usable)
        if not len(sets):
            return Seen(goodness, largest, harmless)
        part = residuals if len(sets) == b else residuals.take(sets)
        scores = scores_of_residuals(part)
        neighbours = np.full(len(sets), np.nan) if ordered else _neighbours(part, scores)
        goodness.shape[sets], goodness.visible_form[sets] = _shape(part, neighbours)
        sizes, t, memory = _residual_blocks(part, scores)
        goodness.memory[sets], largest[sets] = memory, np.abs(t).max(axis=1)
        odd, even = np.sin(t).mean(axis=1), np.cos(1.5 * t).mean(axis=1)
        harmless[sets] = (part.s < _HARMLESS_NOISE**2) & (even > _TWO_SHELLS) & (np.abs(odd) < _SKEW)
        if n - d - 1 >= _LEAST_SPARE:
            goodness.unequal_noise[sets] = sizes
            goodness.tails[sets] = np.exp(-0.5 * tail_statistic(odd, even, n, n - d - 1))
    values = goodness.values
    answers[:4, sets] = np.where(goodness.speaks(), Answer.FAILED, Answer.PASSED)[:, sets]
    answers[:4][~np.isfinite(values) & usable] = int(Answer.TOO_FEW)
    answers[0][~np.isfinite(goodness.shape) & usable] = int(Answer.TOO_NOISY)
    return Seen(goodness, largest, harmless)


def evenly_thinned(samples: Samples) -> Samples:
    """The samples, or of very large sets stretches of consecutive rows: their neighbours are those of the whole."""
    n = samples.shape[2]
    if n <= _MOST_POINTS:
        return samples
    length = _MOST_POINTS // _STRETCHES
    begun = np.linspace(0, n - length, _STRETCHES).astype(np.int64)
    return samples.rows_at((begun[:, None] + np.arange(length)).ravel())


def highest_degree(n: int, d: int) -> int:
    """Largest degree, 2 to 4: those below leave half of the freedom to the noise, and harmonics are few enough."""
    count, degree = number_of(d, 2), 2
    while degree < _DEGREES and count < (n - d - 1) // 2 and count + number_of(d, degree + 1) <= _MOST_HARMONICS:
        degree += 1
        count += number_of(d, degree)
    return degree


def number_of(d: int, degree: int) -> int:
    """Number of harmonics of a degree."""
    return comb(d + degree - 1, degree) - (comb(d + degree - 3, degree - 2) if degree > 1 else 0)


def _shape(residuals: Residuals, neighbours: Floats) -> tuple[Floats, Floats]:
    """The p values (b,) of shape, NaN where the noise hides it, and forms (b,) that it finds in half of such sets.

    The noise is estimated after degree 2 is removed, because a misfit inflates the noise of the sphere.

    Args:
        residuals: of complete sets.
        neighbours: p values of `_neighbours` (b,), where the noise is small.
    """
    R, Y, s, *_ = residuals
    n, d = R.shape[1], residuals.dimension
    e = Y[:, 1 : d + 1] - Y[:, 1 : d + 1].mean(axis=2, keepdims=True)
    spread = np.linalg.eigvalsh(e @ e.swapaxes(1, 2) / n)[:, 0]
    limit = np.maximum(SMALL**2, _LITTLE**2 * spread)
    forms = _forms_of_degrees(residuals._replace(s=np.where(s <= limit, s, 0.0)))
    smooth = n * (forms.left - forms.squares[0]) / (n - d - 1 - forms.counts[0])
    little, visible = smooth <= limit, _visible_form(forms, n, n - d - 1)
    neighbours = np.where(smooth <= _APPARENT**2 * spread, neighbours, np.nan)
    result = np.where(little, _by_degrees(forms, n, n - d - 1, neighbours), np.nan)
    if n < _LEAST_TERMS * (Y.shape[1] - d):  # too few for waves
        some, low = (
            ~little & (smooth <= _MODERATE**2 * spread),
            forms._replace(squares=forms.squares[:1], counts=forms.counts[:1]),
        )
        return np.where(some, _by_degrees(low, n, n - d - 1, neighbours), result), visible
    much = np.flatnonzero(~little & (s < _LARGEST_NOISE**2))
    if len(much):
        result[much] = _shape_of_much_noise(residuals.take(much))
    return result, visible


class _Forms(NamedTuple):
    """Forms that residuals show, by degrees from 2.

    Attributes:
        squares: sums of squares of (R - λ) Y over N, each term over its variance (b,) for each degree.
        counts: their numbers of terms (b,) for each degree.
        left: the sum of squares over N that 1 and e leave (b,).
        smooth: weighted mean square of the terms of degree 2, with their variances as weights (b,).
        freedom: its degrees of freedom (b,).
        share: of the squares of a form of degree 2 that its terms hold, on average over such forms (b,).
    """

    squares: list[Floats]
    counts: list[Ints]
    left: Floats
    smooth: Floats
    freedom: Floats
    share: Floats


def _forms_of_degrees(residuals: Residuals) -> _Forms:
    """Sums of squares of (R - λ) Y for each degree from 2.

    By least squares on 1 and e, which takes the errors of centre and radius out where the noise is small. Each degree
    is freed from those below it. If the variance of the noise is s/p, λ_l - λ_0 is
    proportional to 1/p, and the weights p cancel it (13.8).
    """
    R, Y, s, weights, basis = residuals
    n, d = R.shape[1], residuals.dimension
    degree = basis.degree
    value, d1 = lengths(s, d, int(degree.max()))[:, degree], d + 1
    over = residuals.weighted(R - lengths(residuals.variances, d, 0)[:, 0])
    rows = residuals.weighted(Y)
    gram = rows @ rows.swapaxes(1, 2) / n
    means = gram[:, 0] if weights is None else Y.mean(axis=2)
    g = (rows @ over[:, :, None])[:, :, 0] / n - (value - value[:, :1]) * means
    explained = np.linalg.solve(gram[:, :d1, :d1], np.concatenate([gram[:, :d1, d1:], g[:, :d1, None]], axis=2))
    omega = gram[:, d1:, d1:] - gram[:, d1:, :d1] @ explained[:, :, :-1]
    left = (over**2).mean(axis=1) - np.einsum("bi,bi->b", g[:, :d1], explained[:, :, -1])
    g = g[:, d1:] - (gram[:, d1:, :d1] @ explained[:, :, -1:])[:, :, 0]
    degree, most = degree[d1:], (n - d1) // 2
    forms, counts = list[Floats](), list[Ints]()
    two = degree == 2
    low, trace = omega[:, two][:, :, two], np.einsum("bii->b", omega[:, two][:, :, two])
    smooth, freedom = np.square(g[:, two]).sum(axis=1) / trace, trace**2 / np.square(low).sum(axis=(1, 2))
    share = np.ones_like(trace)
    while len(degree):
        now, later = degree == degree[0], degree > degree[0]
        form, count, inverse = form_of(g[:, now], omega[:, now][:, :, now], most)
        if not forms and (count < now.sum()).any():
            share = np.einsum("bij,bjk,bki->b", low, inverse, low) / trace
        turn = omega[:, later][:, :, now] @ inverse
        g = g[:, later] - (turn @ g[:, now, None])[:, :, 0]
        omega = omega[:, later][:, :, later] - turn @ omega[:, now][:, :, later]
        degree, most = degree[later], most - int(now.sum())
        forms.append(form)
        counts.append(count)
    return _Forms(forms, counts, left, smooth, freedom, share)


def _visible_form(forms: _Forms, n: int, spare: int) -> Floats:
    """Size (b,) of a form of degree 2 that the F test of its terms finds in half of such sets, in σ."""
    tests = (n < _MANY) + min(len(forms.counts), 2) + (spare >= _LEAST_SPARE)
    kinds, place = np.unique(np.stack([forms.counts[0], spare - sum(forms.counts)]), axis=1, return_inverse=True)
    found = np.array([_found_in_half(int(terms), int(free), spare, tests) for terms, free in kinds.T])
    return np.sqrt(found[place.reshape(-1)] / (n * forms.share))


@cache
def _found_in_half(terms: int, free: int, spare: int, tests: int) -> float:
    """Noncentrality at which one of so many F tests of the shape speaks in half of the sets."""
    if terms < 1 or free < 1:
        return math.inf
    shares = SHARES if spare >= _LEAST_SPARE else SHARES[[0, 3]]  # of the blocks that are tested
    level = -math.expm1(math.log1p(-LEVEL) * SHARES[0] / shares.sum() / tests)
    return float(ncfdtrinc(terms, free, 0.5, fdtri(terms, free, 1.0 - level)))


@cache
def fewest_points(d: int, size: float) -> int:
    """Number of points all around a sphere from which the test finds forms of a size, in σ, in half of the sets."""
    for n in range(d + 4, 100 + d**3):
        terms = min(number_of(d, 2), (n - d - 1) // 2)
        more = sum(number_of(d, degree) for degree in range(3, highest_degree(n, d) + 1))
        found = _found_in_half(terms, n - d - 1 - terms - more, n - d - 1, 2 + (more > 0) + (n - d - 1 >= _LEAST_SPARE))
        if found <= size**2 * n * terms / number_of(d, 2):
            return n
    return 100 + d**3


def form_beside_noise(n: Ints, spare: Ints) -> Floats:
    """Rms of a form at n points (…), in σ, that the χ² test of a known noise finds in half of such sets, at `LEVEL`.

    It may be of any degree. ``spare`` are the degrees of freedom of the residuals.
    """
    return np.asarray(np.sqrt(chndtrinc(chdtri(spare, LEVEL), spare, 0.5) / n))


def _by_degrees(forms: _Forms, n: int, spare: int, neighbours: Floats) -> Floats:
    """The smallest p value (b,) of two to four tests, corrected by Šidák's formula.

    They are: all degrees, by `weights_of_degrees`; degrees 3 and above; below 300 points, degree 2 with equal weight on
    each coefficient; and neighbours, for forms of any degree. The third favours smooth shapes: coefficients that the
    directions determine poorly do not dominate it (13.2).
    """
    squares, counts, left = forms.squares, forms.counts, forms.left
    free = spare - sum(counts)
    noise = np.maximum(left - sum(squares), 1e-12 * left) / free
    tests = [neighbours] + ([f_tail(forms.smooth / noise, forms.freedom, free)] if n < _MANY else [])
    for first, weight in weights_of_degrees(n)[: len(squares)]:
        square, freedom = mean_square(np.array(squares[first:]), np.array(counts[first:]), weight)
        tests.append(f_tail(square / noise, freedom, free))
    tested = np.isfinite(tests).sum(axis=0)  # the highest degrees vanish on the smallest caps
    return np.asarray(-np.expm1(tested * np.log1p(-np.minimum(np.fmin.reduce(tests), 1.0 - 1e-16))))


def weights_of_degrees(n: int) -> tuple[tuple[int, float], tuple[int, float]]:
    """For both tests in n points: the lowest degree less 2, and the ratio of the weights of successive degrees."""
    return (0, _SMOOTH if n >= _MANY else 0.0), (1, 1.0)


def mean_square(sums: Floats, counts: Ints, weight: float) -> tuple[Floats, Floats]:
    """Weighted mean square (…) of sums of squares (k, …) of so many terms, and its degrees of freedom (…).

    Terms of one sum have the weight of those of the sum before times ``weight``. The degrees of freedom are
    Satterthwaite's (1946), which are exact if it is 1.
    """
    weights = weight ** np.arange(len(sums)).reshape(-1, *[1] * (sums.ndim - 1))
    terms = (weights * counts).sum(axis=0)
    return (weights * sums).sum(axis=0) / terms, terms**2 / (weights**2 * counts).sum(axis=0)


def _shape_of_much_noise(residuals: Residuals) -> Floats:
    """The smaller p value (b,) of moments of waves, without degree 3 and with it, corrected by Šidák's formula."""
    d, most = residuals.dimension, int(residuals.basis.degree.max())
    waves = (*_WAVES, *((_LAST_WAVE, degree) for degree in (0, 2, 4, 3) if degree <= most))
    parts = [wave_moments(residuals, tau, degree) for tau, degree in waves]
    terms, slopes = (np.concatenate(arrays, axis=1) for arrays in zip(*parts, strict=True))
    result = _overidentified(terms, slopes)
    if most > 2:
        even = terms.shape[1] - number_of(d, 3)
        least = np.fmin(result, _overidentified(terms[:, :even], slopes[:, :even]))
        result = 1.0 - (1.0 - least) ** 2
    return np.asarray(result)


def _overidentified(terms: Floats, slopes: Floats) -> Floats:
    """P values (b,) of Hansen's test that k moments (b, k, n) have mean zero for some c, r and s.

    ``slopes`` are minus their derivatives. The metric is the moments' own covariance, by one step (Hansen 1982). With N
    less the degrees of freedom in place of N, the statistic is nearly χ² from four points a degree of freedom on, where
    Hotelling's law is conservative.
    """
    n, parameters = terms.shape[2], slopes.shape[2]
    mean = terms.mean(axis=2)
    around = terms - mean[:, :, None]
    scale = np.sqrt((around**2).mean(axis=2))
    around /= scale[:, :, None]
    values, vectors = np.linalg.eigh(around @ around.swapaxes(1, 2) / n)
    used = values > _DEPENDENT * values[:, -1:]
    root = np.where(used, values, np.inf)[:, :, None] ** -0.5 * vectors.swapaxes(1, 2) / scale[:, None]
    along, Q = root @ mean[:, :, None], root @ slopes
    form = np.square(along - Q @ (np.linalg.pinv(Q) @ along)).sum(axis=(1, 2))
    count = used.sum(axis=1) - parameters
    return np.asarray(chdtrc(count, form * (n - count)))


def wave_moments(residuals: Residuals, tau: float, degree: int) -> tuple[Floats, Floats]:
    """Terms f(R) Y (b, k, n) of degree l whose means are 0, and minus the slopes of these by (c, r, s) (b, k, d + 2).

    The part of degree l of E[exp(iω·y) (|y - isω|² - r² - ds)] = 0, |ω| = τ: f is B(τR)(R² - s²τ² - r² - ds)
    - 2sτR B'(τR) with B(x) = x^(1 - d/2) J(x) and Bessel's function J of order l - 1 + d/2.
    """
    R, Y, _, _, basis = residuals
    n, d, s = R.shape[1], residuals.dimension, residuals.variances
    curved = degree * (degree + d - 2)
    x, over = tau * R, np.square(R) - 1.0 - s * (d + s * tau**2)
    wave, next_wave = (x ** (1.0 - 0.5 * d) * jv(order - 1.0 + 0.5 * d, x) for order in (degree, degree + 1))
    by_x = degree / x * wave - next_wave
    f = wave * over - 2.0 * s * x * by_x
    by_R = tau * by_x * (over + 2.0 * s * (d - 2)) + 2.0 * R * wave * (1.0 + s * tau**2 - s * curved / R**2)
    mine, lower = basis.degree == degree, basis.degree == degree - 1
    H = Y[:, mine]
    slopes = np.empty((len(R), H.shape[1], d + 2))
    slopes[:, :, :d] = (H * (by_R - degree * f / R)[:, None]) @ Y[:, 1 : d + 1].swapaxes(1, 2) / n
    if degree:  # the solid harmonic's gradient
        mean = (Y[:, lower] @ (f / R)[:, :, None]) / n
        slopes[:, :, :d] += (basis.gradient[:, mine][:, :, lower] @ mean[:, None])[..., 0].swapaxes(1, 2)
    slopes[:, :, d] = (H @ (2.0 * wave)[:, :, None])[:, :, 0] / n
    by_s = (d + 2.0 * s * tau**2) * wave + 2.0 * x * by_x
    by_s = by_s if residuals.weights is None else by_s / residuals.weights
    slopes[:, :, d + 1] = (H @ by_s[:, :, None])[:, :, 0] / n
    return H * f[:, None], slopes


def form_of(g: Floats, omega: Floats, most: int) -> tuple[Floats, Ints, Floats]:
    """gᵀ Ω⁺ g (b,), the rank of Ω, and Ω⁺, of the ``most`` directions of largest variance."""
    if omega.shape[1] <= most:
        diagonal = np.einsum("bii->bi", omega)
        try:
            root = np.linalg.inv(np.linalg.cholesky(omega))
        except np.linalg.LinAlgError:
            root = np.full_like(omega, np.nan)
        if (np.einsum("bii->bi", root) ** -2.0 > np.maximum(1e-6 * diagonal, 1e3 * _LEAST)).all():
            along = (root @ g[:, :, None])[:, :, 0]
            return (along**2).sum(axis=1), np.full(len(g), g.shape[1]), root.swapaxes(1, 2) @ root
    values, vectors = np.linalg.eigh(omega)
    used = values > np.maximum(_LEAST, 1e-9 * values[:, -1:])
    used &= np.arange(values.shape[1])[::-1] < most
    weights = np.where(used, 1.0 / values, 0.0)
    along = (vectors.swapaxes(1, 2) @ g[:, :, None])[:, :, 0]
    return (along**2 * weights).sum(axis=1), used.sum(axis=1), (vectors * weights[:, None]) @ vectors.swapaxes(1, 2)


def scores_of_residuals(residuals: Residuals) -> tuple[Floats, Floats, Floats, Floats]:
    """Normal scores z of R (b, n), what 1 and e leave of them, that over its standard error, and orthonormal 1, e."""
    n, d = residuals.R.shape[1], residuals.dimension
    z = normal_scores(residuals.R, residuals.variances, d)
    X = residuals.weighted(residuals.Y[:, : d + 1])
    Q = np.linalg.solve(np.linalg.cholesky(X @ X.swapaxes(1, 2)), X)  # orthonormal rows
    rho = z - ((Q @ z[:, :, None]).swapaxes(1, 2) @ Q)[:, 0]
    total = np.einsum("bn,bn->b", rho, rho)
    leverage = np.minimum(np.einsum("bkn,bkn->bn", Q, Q), 1.0 - 1e-9)
    return z, rho, rho / np.sqrt((1.0 - leverage) * (total / (n - d - 1))[:, None]), Q


_Scores = tuple[Floats, Floats, Floats, Floats]


def _neighbours(residuals: Residuals, scores: _Scores) -> Floats:
    """P values (b,) of residuals that are like those of points in near directions, whatever the degree of the form.

    Moran's statistic (1950): q = ρᵀSρ/ρᵀρ, S = (A + Aᵀ)/2, where A joins each point to its nearest ones by direction.
    With M = 1 - QQᵀ and m degrees of freedom its moments follow from t_k = tr (MS)ᵏ, as q does not depend on ρᵀρ; its
    law is taken for a gamma law with these three moments. NaN where points are few, or the noise is large.
    """
    d, p = residuals.dimension, np.full(len(residuals.R), np.nan)
    sets, every = np.flatnonzero(residuals.s <= SMALL**2), slice(None, None, -(-residuals.R.shape[1] // _MOST_NEAR))
    e, rho, Q = (array[sets][..., every] for array in (residuals.Y[:, 1 : d + 1], scores[1], scores[3]))
    n, m = rho.shape[1], rho.shape[1] - d - 1
    if m < _LEAST_SPARE or not len(sets):
        return p
    widest = np.take_along_axis(e, e.var(axis=2).argmax(axis=1)[:, None, None], axis=1)
    order = np.argsort(widest, axis=2, kind="stable")
    e, rows, along = (
        np.take_along_axis(array, order, axis=2) for array in (e, np.concatenate([Q, rho[:, None]], axis=1), widest)
    )
    near, traces = np.empty((len(sets), n, _NEAREST * (d - 1)), np.int64), np.zeros((2, len(sets)))
    _nearest(e, along[:, 0], near, traces)
    once, twice = np.zeros((2, len(sets), d + 2, n))
    _join(near, rows, once)
    _join(near, once, twice)
    Q, rho, S, SS = rows[:, :-1], rows[:, -1], once[:, :-1], twice[:, :-1]
    one, two, three = S @ Q.swapaxes(1, 2), S @ S.swapaxes(1, 2), SS @ S.swapaxes(1, 2)  # Q S Qᵀ, Q S² Qᵀ, Q S³ Qᵀ

    def trace(product: Floats) -> Floats:
        return np.asarray(np.einsum("bii->b", product))

    t1 = -trace(one)
    t2 = traces[0] - 2.0 * trace(two) + trace(one @ one)
    t3 = traces[1] - 3.0 * trace(three) + 3.0 * trace(two @ one) - trace(one @ one @ one)
    mean = t1 / m
    variance = (t1**2 + 2.0 * t2) / (m * (m + 2.0)) - mean**2
    third = (t1**3 + 6.0 * t1 * t2 + 8.0 * t3) / (m * (m + 2.0) * (m + 4.0)) - 3.0 * mean * variance - mean**3
    shape = 4.0 / np.maximum(third / variance**1.5, _LEAST_SKEW) ** 2
    q = np.einsum("bn,bn->b", rho, once[:, -1]) / np.einsum("bn,bn->b", rho, rho)
    p[sets] = gammaincc(shape, np.maximum(shape + np.sqrt(shape) * (q - mean) / np.sqrt(variance), 0.0))
    return p


@compiled_as_written
def _nearest(e: Floats, along: Floats, near: Ints, traces: Floats) -> None:
    """Fill in the nearest others of each point (b, n, k) by direction, and tr S² and tr S³ (2, b) of `_neighbours`.

    Args:
        e: directions (b, d, n), sorted by one coordinate, along which the nearest are sought on both sides.
        along: that coordinate (b, n).
        near: to be filled.
        traces: to be added to.
    """
    b, d, n = e.shape
    k = near.shape[2]
    best, square = np.empty(k), np.empty(_ABREAST)
    for t in range(b):
        for i in range(n):
            best[:], near[t, i] = np.inf, i
            low, high = i, i + 1
            while low > 0 or high < n:  # some on the right, some on the left, until both sides are too far
                for begun, end in ((high, min(high + _ABREAST, n)), (max(low - _ABREAST, 0), low)):
                    square[:] = 0.0
                    for c in range(d):
                        for other in range(begun, end):
                            square[other - begun] += squared(e[t, c, other] - e[t, c, i])
                    for other in range(begun, end):
                        if square[other - begun] < best[k - 1]:
                            place = k - 1
                            while place > 0 and square[other - begun] < best[place - 1]:
                                best[place], near[t, i, place] = best[place - 1], near[t, i, place - 1]
                                place -= 1
                            best[place], near[t, i, place] = square[other - begun], other
                low, high = max(low - _ABREAST, 0), min(high + _ABREAST, n)
                reach = math.sqrt(best[k - 1])
                low = low if along[t, i] - along[t, low] < reach else 0
                high = high if high < n and along[t, high] - along[t, i] < reach else n
        mutual, cycles, detours = 0, 0, 0  # i → j → i; i → j → other → i; i → j → other beside i → other
        for i in range(n):
            for j in near[t, i]:
                for other in near[t, j]:
                    mutual += other == i
                    for last in range(k):
                        cycles += near[t, other, last] == i
                        detours += near[t, i, last] == other
        traces[0, t] += 0.5 * (n * k + mutual)
        traces[1, t] += 0.25 * cycles + 0.75 * detours


@compiled_as_written
def _join(near: Ints, rows: Floats, joined: Floats) -> None:
    """Add S times rows (b, m, n) to others, where S joins each point to its nearest ones (b, n, k) with weight ½."""
    for t in range(rows.shape[0]):
        for row in range(rows.shape[1]):
            for i in range(rows.shape[2]):
                for other in near[t, i]:
                    joined[t, row, i] += 0.5 * rows[t, row, other]
                    joined[t, row, other] += 0.5 * rows[t, row, i]


def _residual_blocks(residuals: Residuals, scores: _Scores) -> tuple[Floats, Floats, Floats]:
    """The p values of unequal noise (b,), studentised residuals (b, n), and the p values of memory (b,).

    They are formed from the scores of R freed from 1 and e.
    """
    _, Y, s, *_ = residuals
    d = residuals.dimension
    z, rho, t, Q = scores
    sizes = _unequal(t, Y, np.zeros(len(s)), d)
    noisy = np.flatnonzero(s > SMALL**2)
    if len(noisy):  # scores are normal in every direction; regression on e may remove more than the error
        about = z[noisy] - z[noisy].mean(axis=1, keepdims=True)
        about /= np.sqrt((about**2).mean(axis=1, keepdims=True))
        sizes[noisy] = np.fmax(sizes[noisy], _unequal(about, Y[noisy], s[noisy], d))
        if t.shape[1] >= _MANY:
            t[noisy] = about
    return sizes, t, _memory(rho, Q, np.einsum("bn,bn->b", rho, rho))


def _unequal(t: Floats, Y: Floats, s: Floats, d: int) -> Floats:
    """Test of a regression of |t|^⅔, which is nearly normal, on the harmonics of degrees 1 and 2."""
    n, last = t.shape[1], 1 + d + number_of(d, 2)
    w = np.cbrt(t * t)
    w -= w.mean(axis=1, keepdims=True)
    X = Y[:, 1:last] - Y[:, 1:last].mean(axis=2, keepdims=True)
    moments = (X @ w[:, :, None])[:, :, 0] / n
    noisy = np.flatnonzero(s > SMALL**2)
    if len(noisy):
        places, excess = _size_by_degree(d)
        for degree, part in ((1, slice(0, d)), (2, slice(d, last - 1))):
            shift = np.interp(np.log(s[noisy]), places, excess[degree - 1])
            moments[noisy, part] -= shift[:, None] * Y[noisy, 1:last][:, part].mean(axis=2)
    form, count, _ = form_of(moments, X @ X.swapaxes(1, 2) / n, (n - 1) // 4)
    rest = n - 1.0 - count
    return f_tail(form / count / (((w * w).mean(axis=1) - form) / rest), count, rest)


def tail_statistic(odd: Floats, even: Floats, n: int, spare: int) -> Floats:
    """Statistic (b,) of the means of sin t and cos(3t/2), which are bounded, of n residuals; χ² with two freedoms.

    Each mean is made standard normal, the latter by its skewness too. Both are large together more often than if they
    were independent, so the sum of their squares is made smaller from its .95 quantile on.
    """
    even_at = 2.25
    with np.errstate(all="ignore"):
        few, many = hyp0f1(0.5 * spare, -0.25 * even_at * spare), 1.0 - 0.25 * even_at**2 / (spare + 2.0)
    expected = few if spare < _EXACT_MEAN else np.exp(-0.5 * even_at) * many
    odd = odd * np.sqrt(n / (_ODD * (1.0 - 2.1 / n)))
    even = (even - expected) * np.sqrt(n / (_EVEN * (1.0 - 4.0 / n)))
    skew = 3.4 / np.sqrt(n)
    even = (np.cbrt(np.maximum(1.0 + 0.5 * skew * even, 0.0)) - 1.0 + skew**2 / 36.0) * 6.0 / skew
    square = odd**2 + even**2
    return np.asarray(square - np.maximum(square - 6.0, 0.0) / (3.0 + 0.1 * spare))


def _memory(rho: Floats, Q: Floats, total: Floats) -> Floats:
    """Test of the sum of products of neighbours, a ratio of quadratic forms, by its exact mean and variance."""
    d, n = Q.shape[1] - 1, Q.shape[2]
    spare = n - d - 1
    ratio = np.einsum("bn,bn->b", rho[:, 1:], rho[:, :-1]) / total
    moved = np.zeros_like(Q)
    moved[:, :, 1:] += 0.5 * Q[:, :, :-1]
    moved[:, :, :-1] += 0.5 * Q[:, :, 1:]
    inner = Q @ moved.swapaxes(1, 2)
    trace = -np.einsum("bii->b", inner)
    square = 0.5 * (n - 1) - 2.0 * np.einsum("bkn,bkn->b", moved, moved) + np.einsum("bij,bij->b", inner, inner)
    variance = 2.0 * (spare * square - trace**2) / (spare**2 * (spare + 2.0))
    free, share = 1.0 / variance - 1.0, np.minimum((ratio - trace / spare) ** 2, 1.0 - 1e-15)
    return f_tail(share * free / (1.0 - share), np.ones_like(free), free)
