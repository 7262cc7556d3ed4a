"""A test of fit: whether points are a sphere with white noise of one size, by moments that hold for all directions.

For a point y = c + r u + noise, isotropic and normal, with R = |y - c|, e = (y - c)/R and a spherical harmonic Y of
degree l,

    E[(R - λ) Y(e) | u] = 0 for every u,      λ = E[R P_l(e·u)] / E[P_l(e·u)],

so that no law of the directions enters; and so it is with waves, which see more where the noise is large. Four blocks
see what fits do not show: *shape*, *unequal noise*, *tails* and *memory* of the rows. The errors of centre, radius and
noise are taken out of each, and each gives a p value.

Source: theory §13.
"""

from functools import cache
from itertools import combinations_with_replacement
from math import comb
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.special import betainc, chdtrc, chndtr, hyp0f1, ive, jv, ndtri

from study.arrays import Bools, Floats, Ints
from study.fits.corrected import corrected
from study.fits.samples import Samples, binary_size

BLOCKS = ("shape", "unequal noise", "tails", "memory")
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
_TOGETHER = 20_000
"""Points that are tested at a time."""
_IN_CACHE = 4_000
"""Points whose harmonics are formed at a time, which stay in a processor's cache."""
_MOST_POINTS, _STRETCHES = 100_000, 100
"""Points of a set that are tested, at most, and the number of stretches of rows that they are taken in."""
_LEAST = 1e-13
"""Least mean square of a direction of the harmonics beside which rounding counts."""
SMALL = 0.05
"""Noise in radii up to which residuals are taken to be normal and of one size given the directions."""
_LITTLE, _MODERATE = 0.35, 0.7
"""Noise up to which the shape is tested as if noise were small, in the least spread of the directions, by all degrees
and by degree 2 alone."""
_LARGEST_NOISE = 0.45
"""Noise in radii beyond which no shape is tested: waves see a point."""
_NO_NOISE = 1e-22
"""Noise variance in square radii that rounding makes."""
_MANY = 300
"""Number of points from which the scores' own law is enough, and forms can be seen that are small beside the noise."""
_WAVES, _LAST_WAVE = ((0.01, 0), (1.0, 0), (1.0, 1)), 3.0
"""τ in inverse radii and degree of the waves whose moments are tested; the last goes with all degrees but 1."""
_LEAST_TERMS = 4
"""Points for each moment of waves beyond those that centre, radius and noise take, at least."""
_DEPENDENT = 1e-8
"""Share of the largest eigenvalue of the moments' correlation below which they depend on each other."""
_FAR = 1e-3
"""Noise in radii below which a distance is normal."""
_LARGEST_SCORE = 8.0
_LEAST_SPARE = 16
"""Least degrees of freedom of a test of unequal noise and tails."""
_ODD = 0.5 * (1.0 - np.exp(-2.0)) - np.exp(-1.0)
_EVEN = 0.5 * (1.0 + np.exp(-4.5)) - (1.0 + 0.5 * 1.5**4) * np.exp(-2.25)
"""Variances of sin z and cos(3z/2) for normal z, freed from 1, z and z²."""
_EXACT_MEAN = 150
"""Degrees of freedom below which the mean of cos(3t/2) is a hypergeometric function, and beyond a series."""


class Goodness(NamedTuple):
    """The p values of a test of fit, for fits with leading axes `…`.

    Attributes:
        shape: the distances follow the directions beyond what a sphere explains (…).
        unequal_noise: the size of the residuals follows the directions (…).
        tails: the residuals are not normal (…).
        memory: residuals of neighbouring rows depend on each other (…).
    """

    shape: Floats
    unequal_noise: Floats
    tails: Floats
    memory: Floats

    @property
    def p(self) -> Floats:
        """One p value for all blocks (…), the least of those corrected for their shares; NaN if there is none."""
        values = np.stack(self)
        with np.errstate(divide="ignore", invalid="ignore"):
            sound = np.log1p(-np.minimum(values, 1.0 - 1e-16)) / self._shares
        return np.asarray(-np.expm1(np.fmax.reduce(sound)))

    def speaks(self, level: float = LEVEL) -> Bools:
        """True for each block that speaks at an overall level (4, …)."""
        return np.asarray(np.stack(self) < -np.expm1(np.log1p(-level) * self._shares))

    @property
    def _shares(self) -> Floats:
        """Shares of the level (4, …), of the blocks that have a p value."""
        tested = np.isfinite(np.stack(self))
        shares = SHARES.reshape(-1, *[1] * (tested.ndim - 1)) * tested
        return np.asarray(shares / np.maximum(shares.sum(axis=0), SHARES.min()))

    def first(self, level: float = LEVEL) -> np.ndarray[tuple[int, ...], np.dtype[np.str_]]:
        """Name of the block that explains what is seen at an overall level; "" if none speaks (…).

        It is the first that speaks, in the order of `BLOCKS`; but *memory* where its p value is the least. A form that
        is measured along a path makes neighbours alike, and noise with memory makes a form: what fits better is named.
        """
        speaks, values = self.speaks(level), np.stack(self)
        place = speaks.argmax(axis=0)
        others = np.fmin.reduce(np.where(speaks[:3], values[:3], 1.0))
        place = np.where(speaks[3] & (self.memory < others), 3, place)
        return np.where(speaks.any(axis=0), np.array(BLOCKS)[place], "")


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
            rules.append(null_space(laplacian.T).T)
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


def lengths(s: Floats, d: int, most: int) -> Floats:
    """λ_l of R (b, most + 1) for spheres of radius 1 and noise variances s (b,) that are small."""

    def moment(q: int, degree: int) -> Floats:
        """E[R^q P_l(e·u)] (b,)."""
        term = total = np.ones_like(s)
        for k in range(8):
            term = term * ((0.5 * (degree - q) + k) * (k + 1.0 - 0.5 * (degree + q + d)) / (k + 1.0)) * 2.0 * s
            total = total + term
        return total

    return np.stack([moment(1, degree) / moment(0, degree) for degree in range(most + 1)], axis=1)


def normal_scores(R: Floats, s: Floats, d: int) -> Floats:
    """Normal scores of distances R (b, n) from the centres of spheres of radius 1, whatever the directions.

    R²/s has a noncentral χ² law, exactly. Where the noise is small, Sankaran's power of it (1963) is normal.
    """
    s = s[:, None]
    z, far = (R - 1.0) / np.sqrt(s), 1.0 / np.maximum(s, _FAR**2)
    sets = np.flatnonzero(s > _FAR**2)
    if len(sets):
        k, far = float(d), far[sets]
        h = 1.0 - (2.0 / 3.0) * (k + far) * (k + 3.0 * far) / (k + 2.0 * far) ** 2
        p, m = (k + 2.0 * far) / (k + far) ** 2, (h - 1.0) * (1.0 - 3.0 * h)
        mean = 1.0 + h * p * (h - 1.0 - 0.5 * (2.0 - h) * m * p)
        spread = h * np.sqrt(2.0 * p) * (1.0 + 0.5 * m * p)
        z[sets] = ((R[sets] ** 2 * far / (k + far)) ** h - mean) / spread
    sets = np.flatnonzero(s > SMALL**2)
    if len(sets):
        square = R[sets] ** 2 / s[sets]
        z[sets] = np.clip(ndtri(chndtr(square, float(d), 1.0 / s[sets])), -_LARGEST_SCORE, _LARGEST_SCORE)
    return np.asarray(z)


@cache
def _size_by_degree(d: int) -> tuple[Floats, Floats]:
    """Noises ln s, and λ_l - λ_0 of φ = |z|^⅔ for degrees 1 and 2 (2, k), z the normal score of R, by a sum over R."""
    s = np.geomspace(SMALL**2, 1.0, 60)[:, None]
    R = 1.0 + np.sqrt(s) * np.linspace(-_LARGEST_SCORE, _LARGEST_SCORE + d, 1501)
    R, order = np.maximum(R, 1e-9), 0.5 * d - 1.0
    weight = R ** (0.5 * d) * np.exp(-((R - 1.0) ** 2) / (2.0 * s)) * ive(order, R / s) * (R > 1e-9)
    size = np.cbrt(normal_scores(R, s[:, 0] * (1.0 + 1e-12), d) ** 2)
    means = []
    for degree in range(3):
        harmonic = weight * ive(order + degree, R / s) / ive(order, R / s)
        means.append((harmonic * size).sum(axis=1) / harmonic.sum(axis=1))
    return np.log(s[:, 0]), np.array(means[1:]) - means[0]


def f_tail(F: Floats, a: Floats | Ints, b: Floats | Ints | float) -> Floats:
    """P(F_{a,b} > F); 1 where there is nothing to test."""
    with np.errstate(all="ignore"):
        return np.where((a > 0) & (b > 0), betainc(0.5 * b, 0.5 * a, b / (b + a * np.maximum(F, 0.0))), np.nan)


def goodness(samples: Samples) -> Goodness:
    """Test of fit of each set of points (b,).

    Args:
        samples: the points (b, d, n), missing ones as NaN, copies left out. The noise is taken to be unknown.

    Returns:
        p values (b,) of each block; NaN where the points are too few for it, or show no noise.

    Source: theory §13.
    """
    samples = evenly_thinned(samples)
    b, d, _ = samples.shape
    result = np.full((4, b), np.nan)
    for sets, present in samples.by_count():
        n = present.shape[2]
        if n < d + 4:
            continue
        for begun in range(0, len(sets), max(_TOGETHER // n, 1)):
            part = slice(begun, begun + max(_TOGETHER // n, 1))
            with np.errstate(all="ignore"):
                result[:, sets[part]] = _of_part(present.x[part])
    return Goodness(*result)


def evenly_thinned(samples: Samples) -> Samples:
    """The samples, or of very large sets stretches of consecutive rows: their neighbours are those of the whole."""
    n = samples.shape[2]
    if n <= _MOST_POINTS:
        return samples
    length = _MOST_POINTS // _STRETCHES
    begun = np.linspace(0, n - length, _STRETCHES).astype(np.int64)
    return Samples(np.ascontiguousarray(samples.x[:, :, (begun[:, None] + np.arange(length)).ravel()]))


def _of_part(x: Floats) -> Floats:
    """The p values (4, b) of complete sets (b, d, n)."""
    b, d, n = x.shape
    out = np.full((4, b), np.nan)
    basis = harmonics(d, highest_degree(n, d))
    sets, R, Y, s = on_the_fit(x, basis)
    if len(sets):
        out[0, sets] = _shape(R, Y, s, basis)
        out[1:, sets] = _residual_blocks(R, Y, s, d)
    return out


def on_the_fit(x: Floats, basis: Harmonics) -> tuple[Ints, Floats, Floats, Floats]:
    """Sets whose `corrected` fit serves; their R, harmonics and noise variance s, in radii."""
    d, n = x.shape[1:]
    x = np.ldexp(x, -binary_size(x)[:, None, None])
    fit = corrected(Samples(np.ascontiguousarray(x)))
    s = fit.noise_variance / fit.radius**2
    y = (x - fit.center[:, :, None]) / fit.radius[:, None, None]
    R = np.sqrt(np.einsum("bdn,bdn->bn", y, y))
    usable = np.isfinite(R).all(axis=1) & (R > 0.0).all(axis=1) & (s > _NO_NOISE)
    Y = columns(np.where(usable[:, None, None], y / R[:, None], 0.0), basis)
    usable &= np.linalg.eigvalsh(Y[:, : d + 1] @ Y[:, : d + 1].swapaxes(1, 2) / n)[:, 0] > _LEAST
    sets = np.flatnonzero(usable)
    return (sets, R, Y, s) if len(sets) == len(x) else (sets, R[sets], Y[sets], s[sets])


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


def _shape(R: Floats, Y: Floats, s: Floats, basis: Harmonics) -> Floats:
    """The p values (b,) of shape."""
    d = len(basis.gradient)
    e = Y[:, 1 : d + 1] - Y[:, 1 : d + 1].mean(axis=2, keepdims=True)
    spread = np.linalg.eigvalsh(e @ e.swapaxes(1, 2) / e.shape[2])[:, 0]
    little, result = s <= np.maximum(SMALL**2, _LITTLE**2 * spread), np.full(len(s), np.nan)
    result[little] = _shape_of_little_noise(R[little], Y[little], s[little], basis)
    if R.shape[1] < _LEAST_TERMS * (len(basis.degree) - d):  # too few for waves
        some, low = ~little & (s <= _MODERATE**2 * spread), basis.degree <= 2
        result[some] = _shape_of_little_noise(R[some], Y[some][:, low], s[some], harmonics(d, 2))
    else:
        much = np.flatnonzero(~little & (s < _LARGEST_NOISE**2))
        result[much] = _shape_of_much_noise(R[much], Y[much], s[much], basis)
    return result


def _shape_of_little_noise(R: Floats, Y: Floats, s: Floats, basis: Harmonics) -> Floats:
    """The p values (b,) of (R - λ) Y: by weights of the degrees, and of degrees 3 and more; the lesser counts twice.

    By least squares on 1 and e, which takes the errors of centre and radius out where the noise is small. Each degree
    is freed from those below it.
    """
    n, d, degree = R.shape[1], len(basis.gradient), basis.degree
    value = lengths(s, d, int(degree.max()))[:, degree]
    over, gram, d1 = R - value[:, :1], Y @ Y.swapaxes(1, 2) / n, d + 1
    g = (Y @ over[:, :, None])[:, :, 0] / n - (value - value[:, :1]) * gram[:, 0]
    explained = np.linalg.solve(gram[:, :d1, :d1], np.concatenate([gram[:, :d1, d1:], g[:, :d1, None]], axis=2))
    omega = gram[:, d1:, d1:] - gram[:, d1:, :d1] @ explained[:, :, :-1]
    left = (over**2).mean(axis=1) - np.einsum("bi,bi->b", g[:, :d1], explained[:, :, -1])
    g = g[:, d1:] - (gram[:, d1:, :d1] @ explained[:, :, -1:])[:, :, 0]
    degree, spare, forms, counts = degree[d1:], n - d1, [], []
    most = spare // 2
    while len(degree):
        now, later = degree == degree[0], degree > degree[0]
        form, count, inverse = form_of(g[:, now], omega[:, now][:, :, now], most)
        turn = omega[:, later][:, :, now] @ inverse
        g = g[:, later] - (turn @ g[:, now, None])[:, :, 0]
        omega = omega[:, later][:, :, later] - turn @ omega[:, now][:, :, later]
        degree, most = degree[later], most - int(now.sum())
        forms.append(form)
        counts.append(count)
    free = spare - sum(counts)
    noise = np.maximum(left - sum(forms), 1e-12 * left) / free
    tests = []
    for first, weight in weights_of_degrees(n)[: len(forms)]:
        square, freedom = mean_square(np.array(forms[first:]), np.array(counts[first:]), weight)
        tests.append(f_tail(square / noise, freedom, free))
    tested = np.isfinite(tests).sum(axis=0)  # the highest degrees vanish on the smallest caps
    return np.asarray(-np.expm1(tested * np.log1p(-np.minimum(np.fmin.reduce(tests), 1.0 - 1e-16))))


def weights_of_degrees(n: int) -> tuple[tuple[int, float], tuple[int, float]]:
    """The first degree, less 2, of both tests of a form in n points, and the weight of each degree over that before."""
    return (0, _SMOOTH if n >= _MANY else 0.0), (1, 1.0)


def mean_square(sums: Floats, counts: Ints, weight: float) -> tuple[Floats, Floats]:
    """Weighted mean square (…) of sums of squares (k, …) of so many terms, and its degrees of freedom (…).

    Terms of one sum have the weight of those of the sum before times ``weight``. The degrees of freedom are
    Satterthwaite's (1946), which are exact if it is 1.
    """
    weights = weight ** np.arange(len(sums)).reshape(-1, *[1] * (sums.ndim - 1))
    terms = (weights * counts).sum(axis=0)
    return (weights * sums).sum(axis=0) / terms, terms**2 / (weights**2 * counts).sum(axis=0)


def _shape_of_much_noise(R: Floats, Y: Floats, s: Floats, basis: Harmonics) -> Floats:
    """The p values (b,) of moments of waves, of even degrees and of all; the lesser counts twice."""
    d, most = len(basis.gradient), int(basis.degree.max())
    if not len(s):
        return s
    waves = (*_WAVES, *((_LAST_WAVE, degree) for degree in (0, 2, 4, 3) if degree <= most))
    parts = [wave_moments(R, Y, s, basis, tau, degree) for tau, degree in waves]
    terms, slopes = (np.concatenate(arrays, axis=1) for arrays in zip(*parts, strict=True))
    result = _overidentified(terms, slopes)
    if most > 2:
        even = terms.shape[1] - number_of(d, 3)
        least = np.fmin(result, _overidentified(terms[:, :even], slopes[:, :even]))
        result = 1.0 - (1.0 - least) ** 2
    return np.asarray(result)


def _overidentified(terms: Floats, slopes: Floats) -> Floats:
    """The p values (b,) that the means of k terms (b, k, n) are 0 for some c, r and s, by minus their slopes.

    In the metric of the terms' own covariance, by one step (Hansen 1982). With N less the freedoms in place of N the
    rest is nearly χ² from four terms a freedom on, where Hotelling's law is too cautious.
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


def wave_moments(R: Floats, Y: Floats, s: Floats, basis: Harmonics, tau: float, degree: int) -> tuple[Floats, Floats]:
    """Terms f(R) Y (b, k, n) of degree l whose means are 0, and minus the slopes of these by (c, r, s) (b, k, d + 2).

    The part of degree l of E[exp(iω·y) (|y - isω|² - r² - ds)] = 0, |ω| = τ: f is B(τR)(R² - s²τ² - r² - ds)
    - 2sτR B'(τR) with B(x) = x^(1 - d/2) J(x) and Bessel's function J of order l - 1 + d/2.
    """
    n, d = R.shape[1], len(basis.gradient)
    s = s[:, None]
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
    slopes[:, :, d + 1] = (H @ ((d + 2.0 * s * tau**2) * wave + 2.0 * x * by_x)[:, :, None])[:, :, 0] / n
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


def scores_of_residuals(R: Floats, Y: Floats, s: Floats, d: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Normal scores z of R (b, n), what 1 and e leave of them, that over its standard error, and orthonormal 1, e."""
    n = R.shape[1]
    z = normal_scores(R, s, d)
    X = Y[:, : d + 1]
    Q = np.linalg.solve(np.linalg.cholesky(X @ X.swapaxes(1, 2)), X)  # orthonormal rows
    rho = z - ((Q @ z[:, :, None]).swapaxes(1, 2) @ Q)[:, 0]
    total = np.einsum("bn,bn->b", rho, rho)
    leverage = np.minimum(np.einsum("bkn,bkn->bn", Q, Q), 1.0 - 1e-9)
    return z, rho, rho / np.sqrt((1.0 - leverage) * (total / (n - d - 1))[:, None]), Q


def _residual_blocks(R: Floats, Y: Floats, s: Floats, d: int) -> Floats:
    """The p values (3, b) of unequal noise, tails and memory, from the scores of R freed from 1 and e."""
    b, _, n = Y.shape
    z, rho, t, Q = scores_of_residuals(R, Y, s, d)
    spare, total = n - d - 1, np.einsum("bn,bn->b", rho, rho)
    missing = np.full(b, np.nan)
    if spare < _LEAST_SPARE:
        return np.stack([missing, missing, _memory(rho, Q, total)])
    sizes = _unequal(t, Y, np.zeros(b), d)
    noisy = np.flatnonzero(s > SMALL**2)
    if len(noisy):  # scores have their law for every direction; what e explains of them is not all error
        scores = z[noisy] - z[noisy].mean(axis=1, keepdims=True)
        scores /= np.sqrt((scores**2).mean(axis=1, keepdims=True))
        sizes[noisy] = np.fmax(sizes[noisy], _unequal(scores, Y[noisy], s[noisy], d))
        if n >= _MANY:
            t[noisy] = scores
    tails = tail_statistic(np.sin(t).mean(axis=1), np.cos(1.5 * t).mean(axis=1), n, spare)
    return np.stack([sizes, np.exp(-0.5 * tails), _memory(rho, Q, total)])


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
