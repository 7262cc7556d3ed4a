"""Chains of few and of many points against an integration of the same posterior by cells, which knows no draws.

The cells halve, in coordinates of their own, until the density varies little within each that counts. Draws of the
cells by mass, weighted by the density at their places, then have the posterior's means, deviations and quantiles to
less than a hundredth of a standard deviation.
"""

import itertools
import math

import numpy as np
import pytest
from scipy import special, stats

from study.fits import Samples
from study.simulation.experiment.config import ChainStatus
from study.simulation.posterior import marginal
from study.simulation.posterior.marginal import TOLERANCE, MarginalDraws, Streams, sample_checked
from study.simulation.posterior.sampler import Chain, Prior, sample

LEVELS = np.array([0.025, 0.16, 0.5, 0.84, 0.975])
WIDTH = 10.0


def logs(points, noise, known, largest, center):
    """Log-density of centres, the radius integrated from 0 to the largest, or σ over six decades; and R̄, S."""
    n = len(points)
    chunks = np.split(center, range(4096, len(center), 4096))
    parts = [np.sqrt(((chunk[:, None] - points) ** 2).sum(axis=2)) for chunk in chunks]
    mean = np.concatenate([part.mean(axis=1) for part in parts])
    squares = np.concatenate([part.var(axis=1) * n for part in parts])
    if known:
        above, below = (special.ndtr((end - mean) * math.sqrt(n) / noise) for end in (largest, 0.0))
        return -0.5 * squares / noise**2 + np.log(np.maximum(above - below, 1e-300)), mean, squares
    half = 0.5 * (n - 1)
    low, high = (special.gammainc(half, 0.5 * squares / (noise * factor) ** 2) for factor in (1e3, 1e-3))
    return -half * np.log(squares) + np.log(np.maximum(high - low, 1e-300)), mean, squares


def integrated(points, noise, known, largest, count=200_000):
    """Means, standard deviations and quantiles of (c, r), and σ if it is unknown, in the box about 0."""
    n, d = points.shape
    rng, middle, extent = np.random.default_rng(1), points.mean(axis=0), math.sqrt(points.var(axis=0).sum())

    def log_mass(v, half):
        value = logs(points, noise, known, largest, middle + extent * np.sinh(v))[0]
        return value + np.log(np.cosh(v)).sum(axis=1) + np.log(half).sum()

    low, high = (np.arcsinh((end - middle) / extent) for end in (-WIDTH, WIDTH))
    first = 64 if d == 2 else 20
    half = 0.5 * (high - low) / first
    cells = low + half * (2.0 * np.array(list(itertools.product(range(first), repeat=d))) + 1.0)
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=d)))
    done, total = [], -np.inf
    for _ in range(45):
        parts = (cells[:, None] + corners * half).reshape(-1, d)
        mass = log_mass(parts, half / 2.0).reshape(len(cells), -1)
        whole, varies = np.logaddexp.reduce(mass, axis=1), np.ptp(mass, axis=1)
        split = (varies > 1.5) & (whole + 2.0 * varies > np.logaddexp(total, np.logaddexp.reduce(whole)) - 10.0)
        total = np.logaddexp(total, np.logaddexp.reduce(whole[~split], initial=-np.inf))
        rest = np.repeat(~split, len(corners))
        done.append((parts[rest], np.broadcast_to(half / 2.0, (rest.sum(), d)), mass[~split].ravel()))
        cells, half = parts[~rest], half / 2.0
        if not len(cells):
            break
    parts, sizes, mass = (np.concatenate(column) for column in zip(*done, strict=True))
    share = np.exp(mass - mass.max())
    share = 0.6 * share / share.sum() + 0.4 * np.sqrt(share) / np.sqrt(share).sum()
    which = rng.choice(len(parts), count, p=share)
    v = parts[which] + sizes[which] * rng.uniform(-1.0, 1.0, (count, d))
    center = middle + extent * np.sinh(v)
    value, mean, squares = logs(points, noise, known, largest, center)
    value += np.log(np.cosh(v)).sum(axis=1) + np.log(sizes[which]).sum(axis=1) - np.log(share[which])
    sigma = np.full(count, noise) if known else np.sqrt(squares / rng.chisquare(n - 1, count))
    radius = mean + sigma / math.sqrt(n) * rng.standard_normal(count)
    allowed = (radius > 0.0) & (radius < largest) & (np.abs(np.log10(sigma / noise)) < 3.0)
    weights = np.where(allowed, np.exp(value - value.max()), 0.0)
    weights /= weights.sum()
    values = np.column_stack([center, radius] if known else [center, radius, sigma])
    mean = weights @ values
    assert 1.0 / (weights**2).sum() > 0.3 * count
    orders = np.argsort(values, axis=0).T
    quantiles = [np.interp(LEVELS, np.cumsum(weights[o]), v[o]) for o, v in zip(orders, values.T, strict=True)]
    return mean, np.sqrt(weights @ (values - mean) ** 2), np.column_stack(quantiles)


def data_sets(n, on_cap):
    """Six point sets (points, noise, known) in the plane and in space, on spheres and caps, and a seed for each."""
    for k in range(6):
        i = 6 * (5, 6, 7, 8, 10, 14, 20, 30, 60, 200).index(n) + k
        d, noise = 2 + k % 2, (0.005, 0.02, 0.1, 0.3)[(i * 7 // 6 + k) % 4]
        known = bool((k // 2 + i // 6) % 2) or n == d + 2
        angle = (180.0, 90.0, 45.0)[(k + i // 6) % 3]
        yield i, on_cap(np.random.default_rng(1000 + i), n, angle=angle, d=d, noise=noise)[0], noise, known


def run(points, noise, known, seed, walkers=64, width=WIDTH, name="geometric"):
    """Run a checked chain; the prior's box is about 0."""
    d = points.shape[1]
    prior = Prior(np.zeros(d), width, (0.2 + math.sqrt(d)) * width, noise, known)
    streams = Streams(np.random.default_rng(seed), np.random.RandomState(seed), np.random.RandomState(seed + 500))
    return sample_checked(Samples(points.T[None].copy(), None), prior, name, streams, walkers, 20_000)


def slow_but(*quick):
    """Numbers of points; all but a few are slow."""
    return [n if n in quick else pytest.param(n, marks=pytest.mark.slow) for n in (5, 8, 10, 20, 30, 200)]


@pytest.mark.parametrize("n", slow_but(8, 20))
def test_chains_that_are_ok_are_right(on_cap, n):
    """Of 36 data sets the ok chains' sd are within a tenth of the integral's, means and quantiles within 0.12 sd.

    256 walkers over 50 τ are worth 12,800 draws. Six sets of each number of points have so many ok chains: with 5 and 8
    points 2, with 10 4, with 20 5, with 30 4, with 200 all. The other chains reach the box, or have an sd that rare,
    far centres decide.
    """
    for seed, points, noise, known in data_sets(n, on_cap):
        found = run(points, noise, known, seed, walkers=256)
        if found.status is ChainStatus.OK:
            mean, sd, quantiles = integrated(points, noise, known, 2.0 + math.sqrt(points.shape[1]) * WIDTH)
            assert found.flat.std(axis=0) == pytest.approx(sd, rel=TOLERANCE)
            assert np.abs((found.flat.mean(axis=0) - mean) / sd).max() < TOLERANCE
            assert np.abs((np.quantile(found.flat, LEVELS, axis=0) - quantiles) / sd).max() < 1.2 * TOLERANCE
        else:
            assert found.status is not ChainStatus.NOT_CHECKED


@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_sphere_of_eight_points_may_be_a_plane(on_cap, seed):
    """The chain from the best sphere's ellipsoid is ok, with a tenth of the sd or less; the checked one is right.

    A far plane has a hundredth of the mass and decides the sd. With seed 3 that takes more steps than are allowed, and
    the chain is not ok.
    """
    points, _ = on_cap(np.random.default_rng(seed), 8, noise=0.02)
    _, sd, _ = integrated(points, 0.02, False, 2.0 + math.sqrt(3.0) * WIDTH)
    prior = Prior(np.zeros(3), WIDTH, 2.0 + math.sqrt(3.0) * WIDTH, 0.02, False)
    alone = sample(Samples(points.T[None].copy(), None), prior, "geometric", np.random.RandomState(seed), 64, 20_000)
    found = run(points, 0.02, False, seed)
    assert alone.status is ChainStatus.OK
    assert (alone.flat.std(axis=0) < 0.1 * sd)[:4].all()
    assert found.status is (ChainStatus.OK if seed == 2 else ChainStatus.DIFFERS)
    assert found.flat.std(axis=0) == pytest.approx(sd, rel=TOLERANCE if seed == 2 else 2.0 * TOLERANCE)


@pytest.mark.parametrize(("d", "known", "least"), [(2, True, 0.9), (3, False, 0.2)])
@pytest.mark.slow
def test_ranks_of_the_truth_are_uniform_with_eight_points(on_cap, d, known, least):
    """Simulation-based calibration of ok chains, by Kolmogorov and Smirnov's test, at a false-alarm rate of 10⁻⁴ each.

    Drawn are radii, evenly from 1 to 3, eight points all around, and σ: 0.02 if it is known, else from its prior, three
    decades either way. The centre is the middle of the box, as in a study. The choice of ok chains rests on the points,
    and leaves ranks uniform only if σ is drawn: with 0.02 always, ok chains are those whose residuals are small.
    """
    ranks, trials = [], 80 if known else 140
    for trial in range(trials):
        rng = np.random.default_rng(7000 + trial)
        radius, noise = rng.uniform(1.0, 3.0), 0.02 if known else 0.02 * 10.0 ** rng.uniform(-3.0, 3.0)
        points, _ = on_cap(rng, 8, d=d, noise=noise, radius=radius)
        found = run(points, 0.02, known, trial, width=10.0 * radius)
        if found.status is ChainStatus.OK:
            ranks.append(np.mean(found.flat < np.append(np.zeros(d), [radius, noise])[: d + 2 - known], axis=0))
    assert len(ranks) > least * trials
    assert min(stats.kstest(rank, "uniform").pvalue for rank in np.transpose(ranks)) > 1e-4


@pytest.fixture
def normal():
    """Draws of a normal law of three parameters, evenly weighted, and a chain of others."""
    rng = np.random.default_rng(3)
    kernels = marginal._Kernels(np.zeros((1, 2)), np.eye(2)[None], 5.0)
    draws = MarginalDraws(rng.standard_normal((4000, 3)), np.full(4000, 1 / 4000), kernels)
    return draws, Chain(ChainStatus.OK, rng.standard_normal((100, 64, 3)), 2.0)


def test_a_chain_that_agrees(normal):
    """Its largest difference is a few standard errors of a mean, 0.03, and its R̂ is 1."""
    found = marginal._checked(normal[1], normal[0])
    assert found.status is ChainStatus.OK
    assert 0.0 < found.difference < TOLERANCE
    assert 1.0 <= found.rhat < 1.001
    assert found.checked == pytest.approx(4000.0)


@pytest.mark.parametrize(
    ("change", "least"),
    [
        (lambda x: x + np.array([0.0, 0.2, 0.0]), 0.2),
        (lambda x: x * np.array([1.0, 1.0, 0.8]), 0.2),
        (lambda x: np.where(x[..., :1] < 1.7, x, 1.7), 0.1),
        (lambda x: np.abs(x), 0.5),
    ],
    ids=["mean", "sd", "tail", "half"],
)
def test_a_chain_that_differs(normal, change, least):
    """It is not ok, and the difference is stored; a chain with another status keeps it."""
    chain = Chain(ChainStatus.OK, change(normal[1].draws), 2.0)
    found = marginal._checked(chain, normal[0])
    assert found.status is ChainStatus.DIFFERS
    assert found.difference > 0.8 * least
    limited = Chain(ChainStatus.AT_PRIOR, chain.draws, 2.0)
    assert marginal._checked(limited, normal[0]).status is ChainStatus.AT_PRIOR


def test_a_chain_that_is_not_checked(normal):
    """If the draws are too few, or there are none, a chain is not ok, however well it agrees."""
    draws, chain = normal
    few = MarginalDraws(draws.values[:500], np.full(500, 1 / 500), draws.kernels)
    assert draws.precise
    assert not few.precise
    assert marginal._checked(chain, few).status is ChainStatus.NOT_CHECKED
    assert marginal._checked(chain, None).status is ChainStatus.NOT_CHECKED


def test_shrink_factor(normal):
    """Means one standard deviation apart: variance ½ of the means over 1 is √1.5; equal ensembles have 1."""
    draws = normal[0]
    standard = (draws.values - draws.mean) / draws.sd
    draws = MarginalDraws(standard, draws.weights, draws.kernels)
    for shift, expected in (([0.0, 0.0, 0.0], 1.0), ([0.0, 1.0, 0.0], math.sqrt(1.5))):
        chain = Chain(ChainStatus.OK, (standard + shift).reshape(-1, 40, 3), 1.0)
        assert draws.shrink_factor(chain) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_density_of_kernels(d):
    """It is SciPy's of Student's law, averaged over kernels, and a tenth even in the ball; draws have its mean."""
    rng = np.random.default_rng(4)
    root = np.tril(rng.uniform(0.1, 0.3, (5, d, d))) + 0.2 * np.eye(d)
    kernels = marginal._Kernels(rng.uniform(-1.0, 1.0, (5, d)), root, 3.0)
    places = rng.uniform(-2.5, 2.5, (50, d))
    each = [stats.multivariate_t(m, r @ r.T, df=d + 2).pdf(places) for m, r in zip(kernels.middle, root, strict=True)]
    ball = (np.linalg.norm(places, axis=1) < 3.0) / (math.pi * 9.0 if d == 2 else 36.0 * math.pi)
    np.testing.assert_allclose(np.exp(kernels.log_density(places)), 0.9 * np.mean(each, axis=0) + 0.1 * ball, rtol=1e-9)
    drawn = kernels.draw(40_000, rng)
    assert np.abs(drawn.mean(axis=0) - 0.9 * kernels.middle.mean(axis=0)).max() < 5.0 * drawn.std() / 200.0


def test_the_whole_sphere(on_cap):
    """A chain of this likelihood, whose r is not the geometric one's, is ok."""
    points, _ = on_cap(np.random.default_rng(6), 30, noise=0.2)
    whole, plain = (run(points, 0.2, True, 1, name=name) for name in ("whole_sphere", "geometric"))
    assert whole.status is plain.status is ChainStatus.OK
    assert whole.flat[:, 3].mean() < plain.flat[:, 3].mean() - 0.5 * plain.flat[:, 3].std()


@pytest.mark.slow
def test_four_dimensions(on_cap):
    """A chain in four dimensions is ok."""
    points, _ = on_cap(np.random.default_rng(6), 40, d=4, noise=0.05)
    assert run(points, 0.05, False, 1).status is ChainStatus.OK
