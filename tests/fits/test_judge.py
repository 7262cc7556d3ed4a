"""The size of each allowance for structure, against its formula in plain matrices and loops."""

import itertools
import math

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import t as student

from study.fits.evidence.goodness import Residuals, form_beside_noise
from study.fits.evidence.judge import LARGEST_UNSEEN, _allowance
from study.fits.points.samples import Estimates, Samples, blank


def residuals_of(points, weights=None):
    """Residuals of points (n, 3) about the unit sphere at the origin, with harmonics up to degree 2."""
    sphere = Estimates._make([array.copy() for array in blank(1, 3)])
    sphere.center[:], sphere.radius[:], sphere.noise_variance[:] = 0.0, 1.0, 1e-12
    samples = Samples(np.ascontiguousarray(points.T[None]), weights=None if weights is None else weights[None])
    return Residuals.about(samples.x, sphere, samples.weights, 2)


def regression(points, weights):
    """Residuals ρ, rows X = (e, 1), pull of ρ on (c, r), and harmonics of degree 2 by products of the directions."""
    R = np.linalg.norm(points, axis=1)
    e, root = points / R[:, None], np.sqrt(weights)
    X = np.column_stack([e, np.ones(len(e))]) * root[:, None]
    pull = np.linalg.inv(X.T @ X) @ X.T
    over = (R - 1.0) * root
    products = np.column_stack([e[:, i] * e[:, j] for i in range(3) for j in range(i, 3)]) * root[:, None]
    return over - X @ (pull @ over), X, pull, products


def by_form(rho, X, pull, products):
    """Variances of (c, r) by the mean square of the coefficients of degree 2, and their number."""
    both = np.column_stack([X, products])
    left = rho - both @ np.linalg.lstsq(both, rho, rcond=None)[0]
    count = np.linalg.matrix_rank(both) - X.shape[1]
    return [sum(w * w for w in row) * (rho @ rho - left @ left) / count for row in pull], count


def by_squares(rho, X, pull, products):
    """Variances of (c, r) by each residual's own square (HC3), and the degrees of freedom of the noise."""
    leverage = [x @ np.linalg.inv(X.T @ X) @ x for x in X]
    sizes = [r / (1.0 - h) for r, h in zip(rho, leverage, strict=True)]
    return [sum((w * size) ** 2 for w, size in zip(row, sizes, strict=True)) for row in pull], len(rho) - X.shape[1]


def by_cosines(rho, X, pull, products):
    """Variances of (c, r) by six cosines over the rows, and their number."""
    n, result = len(rho), []
    for row in pull:
        along = []
        for k in range(1, 7):
            places = [math.cos(math.pi * k * (i + 0.5) / n) for i in range(n)]
            along.append(math.sqrt(2.0) * sum(w * r * c for w, r, c in zip(row, rho, places, strict=True)))
        result.append(sum(a * a for a in along) / 6)
    return result, 6


def by_memory(rho, X, pull, products):
    """Variances of (c, r) for the worst AR(1) memory within 1.35 of the highest restricted likelihood, by matrices."""
    n, k = X.shape
    memories = [*(0.05 * step for step in range(16)), 0.8, 0.83, 0.86, 0.89, 0.92, 0.94, 0.96, 0.98]
    likelihood, variances = [], []
    for phi in memories:
        V = phi ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        inverse = np.linalg.inv(V)
        normal = X.T @ inverse @ X
        left = rho - X @ np.linalg.solve(normal, X.T @ inverse @ rho)
        square = left @ inverse @ left
        logs = np.linalg.slogdet(V)[1] + np.linalg.slogdet(normal)[1]
        likelihood.append(-0.5 * ((n - k) * math.log(square) + logs))
        variances.append([row @ V @ row * square / (n - k) for row in pull])
    plausible = [one for one, value in zip(variances, likelihood, strict=True) if value >= max(likelihood) - 1.35]
    return np.max(plausible, axis=0), n - k


def structured(kind, n, seed):
    """Points (n, 3) near the unit sphere, all around or on a cap, whose residuals have structure of a kind."""
    rng = np.random.default_rng(seed)
    e = rng.normal(size=(n, 3))
    e[:, 0] += 1.5 * (kind != "form")
    if kind == "drift":
        along = np.linspace(-1.0, 1.0, n)
        e = np.column_stack([np.ones(n), along, along**2 - 0.4]) + 0.1 * e
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    noise = rng.normal(size=n)
    if kind == "form":
        noise += 4.0 * e[:, 0] * e[:, 1]
    elif kind == "rim":
        noise *= np.where(np.arange(n) % 9 == 0, 12.0, 1.0)
    elif kind == "drift":
        noise += 0.8 * np.cos(math.pi * np.arange(n) / n) * e[:, 1]
    else:
        noise = lfilter([1.0], [1.0, -0.9], noise)
    return e * (1.0 + 1e-6 * noise)[:, None]


WAYS = (by_form, by_squares, by_cosines, by_memory)
KINDS = ("form", "rim", "drift", "memory")


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("ordered", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_factors_are_those_of_their_formulas(kind, ordered, weighted):
    """Of each number the widest way counts, by its own quantile of Student's t; each way does somewhere (next test)."""
    n, d = 50, 3
    points = structured(kind, n, 4)
    weights = np.ones(n)
    if weighted:
        weights = np.random.default_rng(4).uniform(0.5, 1.5, n)
        weights /= weights.mean()
    ratio, freedom = _allowance(residuals_of(points, weights if weighted else None), ordered, np.ones(1, dtype=bool))
    rho, X, pull, products = regression(points, weights)
    white = [sum(w * w for w in row) * (rho @ rho) / (n - d - 1) for row in pull]
    found = [way(rho, X, pull, products) for way in WAYS[: 4 if ordered else 2]]
    for place in range(d + 1):
        widths = [math.sqrt(v[place] / white[place]) * student.ppf(0.975, free) for v, free in found]
        widths.insert(0, student.ppf(0.975, n - d - 1))
        best = int(np.argmax(widths))
        expected = 1.0 if best == 0 else max(math.sqrt(found[best - 1][0][place] / white[place]), 1.0)
        assert ratio[0, place] == pytest.approx(expected, rel=1e-5)
        assert freedom[0, place] == (math.inf if best == 0 else found[best - 1][1])


def test_each_way_is_the_widest_somewhere():
    """So that the test above looks at all four."""
    widest = set()
    for kind, ways in itertools.product(KINDS, (WAYS[:2], WAYS)):
        rho, X, pull, products = regression(structured(kind, 50, 4), np.ones(50))
        found = [way(rho, X, pull, products) for way in ways]
        for place in range(4):
            widest.add(ways[int(np.argmax([v[place] * student.ppf(0.975, free) ** 2 for v, free in found]))])
    assert widest == set(WAYS)


def test_without_a_test_that_speaks_only_memory_counts():
    """Rows in order are allowed a memory whether a test speaks or not; other structure is not."""
    points = structured("form", 50, 4)
    ratio, freedom = _allowance(residuals_of(points), False, np.zeros(1, dtype=bool))
    assert (ratio == 1.0).all()
    assert np.isinf(freedom).all()
    points = structured("memory", 50, 4)
    rho, X, pull, products = regression(points, np.ones(50))
    ratio, _ = _allowance(residuals_of(points), True, np.zeros(1, dtype=bool))
    white = (pull**2).sum(axis=1) * (rho @ rho) / 46
    factors = np.sqrt(by_memory(rho, X, pull, products)[0] / white)
    np.testing.assert_allclose(ratio[0], np.maximum(factors, 1.0), rtol=1e-5)
    assert ratio.max() > 2.0


@pytest.mark.parametrize(("n", "spare"), [(7, 3), (10, 6), (30, 26)])
def test_a_known_noise_shows_a_form_in_half_of_the_sets(n, spare):
    """Of 100,000 sums of squares of normal numbers, the first of them shifted, .5 ± .02 exceed the .99 quantile."""
    rng = np.random.default_rng(5)
    z = rng.standard_normal((100_000, spare))
    quantile = np.quantile((z**2).sum(axis=1), 0.99)
    z[:, 0] += float(form_beside_noise(np.array(n), np.array(spare))) * math.sqrt(n)
    assert ((z**2).sum(axis=1) > quantile).mean() == pytest.approx(0.5, abs=0.02)
    assert form_beside_noise(np.array(n), np.array(spare)) < LARGEST_UNSEEN
