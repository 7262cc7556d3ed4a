"""A chain against numerical integration of the same posterior, and what it says of data that have none.

Given the centre, the geometric posterior of the radius, and of σ, is known in closed form: with R̄ the mean and S the
sum of squares about it of the n distances, r is normal about R̄ with variance σ²/n; with σ unknown under 1/σ, S/σ² is χ²
with n - 1 degrees of freedom and √(n (n-1)/S) (r - R̄) is Student's. What is left to integrate is the centre, on a grid.

A chain of τ is worth steps × walkers / τ independent draws. Means, variances and quantiles (these as probabilities) are
compared to 5 standard errors of so many; allowing for τ to be a tenth too short, one comparison fails in 2 of 10⁵ cases
by chance, and all that are made here in 3 of 1000. Seeds are fixed.

Autocorrelation times against emcee's own, and against theory.
"""

import itertools
import math

import emcee
import numpy as np
import pytest
from emcee.autocorr import integrated_time
from scipy import optimize, special, stats

import study
from study.fits import Samples
from study.simulation.experiment.config import ChainStatus
from study.simulation.posterior import sampler
from study.simulation.posterior.marginal import Streams, sample_checked
from study.simulation.posterior.sampler import LIKELIHOODS, Prior, autocorrelation_times, sample

LEVELS = np.array([0.025, 0.16, 0.5, 0.84, 0.975])

LIMIT = 5.0


def run(points, noise, known=True, name="geometric", width=10.0, seed=1, walkers=64, max_steps=20_000, center=None):
    """Run a chain on points (n, d); the prior is about the origin, if not said otherwise."""
    d = points.shape[1]
    middle = np.zeros(d) if center is None else np.asarray(center, dtype=float)
    prior = Prior(middle, width, 2.0 + math.sqrt(d) * width, noise, known)
    random = np.random.RandomState(seed)
    return sample(Samples(points.T[None].copy(), None), prior, name, random, walkers, max_steps)


def checked(points, noise, width, known=True, walkers=64, max_steps=20_000):
    """Run a checked chain on points (n, d); the prior is about the origin."""
    d = points.shape[1]
    prior = Prior(np.zeros(d), width, 2.0 + math.sqrt(d) * width, noise, known)
    streams = Streams(np.random.default_rng(1), np.random.RandomState(1), np.random.RandomState(2))
    return sample_checked(Samples(points.T[None].copy(), None), prior, "geometric", streams, walkers, max_steps)


def best(points):
    """Geometric least squares by scipy, and the covariance of (c, r) at unit noise."""
    start = np.append(points.mean(axis=0), 1.0)

    def residuals(sphere):
        return np.linalg.norm(points - sphere[:-1], axis=1) - sphere[-1]

    found = optimize.least_squares(residuals, start, xtol=1e-12)
    return found.x, np.linalg.inv(found.jac.T @ found.jac), found.fun


class Integrated:
    """The geometric posterior of (c, r), and σ where it is not known, by integration over a grid of centres."""

    def __init__(self, points, noise, low, high, nodes):
        self.n, self.d = points.shape
        self.noise, self.shape = noise, (nodes,) * self.d
        edges = [np.linspace(a, b, nodes + 1) for a, b in zip(low, high, strict=True)]
        self.edges = edges
        axes = [0.5 * (edge[1:] + edge[:-1]) for edge in edges]
        self.place = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
        distance = np.sqrt(sum((points[:, i, None] - self.place[i]) ** 2 for i in range(self.d)))
        self.mean = distance.mean(axis=0)
        self.squares = ((distance - self.mean) ** 2).sum(axis=0)
        unknown = noise is None
        logs = -0.5 * ((self.n - 1) * np.log(self.squares) if unknown else self.squares / noise**2)
        weight = np.exp(logs - logs.max())
        self.weight = weight / weight.sum()

    def moments(self):
        """Mean and variance of each parameter."""
        n, s = self.n, self.squares
        scale = s / (n - 3) if self.noise is None else self.noise**2 + 0.0 * s
        parts = [(c, 0.0) for c in self.place] + [(self.mean, scale / n)]
        if self.noise is None:
            ratio = math.exp(math.lgamma(0.5 * n - 1.0) - math.lgamma(0.5 * n - 0.5)) / math.sqrt(2.0)
            parts.append((np.sqrt(s) * ratio, s / (n - 3) - s * ratio**2))
        mean = np.array([np.sum(self.weight * m) for m, _ in parts])
        square = np.array([np.sum(self.weight * (m**2 + v)) for m, v in parts])
        return mean, square - mean**2

    def below(self, parameter, value):
        """Probability that a parameter is below a value."""
        n = self.n
        if parameter < self.d:
            others = tuple(i for i in range(self.d) if i != parameter)
            steps = self.weight.reshape(self.shape).sum(axis=others)
            return np.interp(value, self.edges[parameter], np.concatenate([[0.0], np.cumsum(steps)]))
        if parameter == self.d + 1:
            return np.sum(self.weight * stats.chi2.sf(self.squares / value**2, n - 1))
        if self.noise is None:
            away = (value - self.mean) * np.sqrt(n * (n - 1) / self.squares)
            return np.sum(self.weight * special.stdtr(n - 1, away))
        return np.sum(self.weight * special.ndtr((value - self.mean) * math.sqrt(n) / self.noise))


def assert_moments(found, mean, variance, limit=LIMIT):
    """Means and variances of a chain's draws, to so many standard errors; those of variances from fourth moments."""
    draws = found.flat
    count = len(draws) / found.tau
    away = draws - mean
    pull = away.mean(axis=0) / np.sqrt(variance / count)
    assert np.all(np.abs(pull) < limit), f"means are {pull} standard errors away"
    error = np.sqrt(((away**2 - variance) ** 2).mean(axis=0) / count)
    pull = ((away**2).mean(axis=0) - variance) / error
    assert np.all(np.abs(pull) < limit), f"variances are {pull} standard errors away"


# Where σ is not known, a plane explains fewer than 20 samples well enough for a share of the posterior to lie far away.
CASES = [(2, 30, 90.0, 0.05, True), (2, 10, 180.0, 0.1, False), (3, 30, 120.0, 0.05, True), (3, 20, 180.0, 0.1, False)]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: f"{case[0]}-{'known' if case[4] else 'unknown'}")
def case(request, on_cap):
    """Points, a chain of their posterior, and the same posterior by integration."""
    d, n, angle, noise, known = request.param
    points, _ = on_cap(np.random.default_rng(5), n, angle=angle, d=d, noise=noise, center=0.3)
    middle, covariance, _ = best(points)
    # Student's tails, where σ is not known, are a millionth at 14 standard deviations
    reach = (8.0 if known else 14.0) * noise * np.sqrt(np.diag(covariance)[:d])
    grid = Integrated(points, noise if known else None, middle[:d] - reach, middle[:d] + reach, 300 if d == 2 else 61)
    return points, noise, known, run(points, noise, known), grid


def test_mean_and_spread(case):
    """Posterior means and variances of all parameters are those of the integral."""
    _, _, known, found, grid = case
    assert found.status is ChainStatus.OK
    mean, variance = grid.moments()
    assert found.draws.shape[2] == len(mean) == grid.d + 2 - known
    assert_moments(found, mean, variance)


def test_length(case):
    """An ok chain has 50 τ after its first fifth; all steps and walkers after it are there.

    τ is that of the draws, to the half that other coordinates and centring walkers apart can make.
    """
    _, _, _, found, _ = case
    assert 0.8 * found.steps >= 50.0 * found.tau - 1.0
    assert found.draws.shape[:2] == (found.steps - found.steps // 5, 64)
    assert found.flat.shape == (found.draws.shape[0] * 64, found.draws.shape[2])
    assert 0.1 < found.acceptance < 0.9
    longest = integrated_time(found.draws, tol=0, quiet=True).max()
    assert 0.6 * longest < found.tau < 1.6 * longest


def test_quantiles(case):
    """At the draws' quantiles the integral's distribution functions have the quantiles' levels."""
    _, _, _, found, grid = case
    error = np.sqrt(LEVELS * (1.0 - LEVELS) * found.tau / len(found.flat))
    for parameter in range(found.draws.shape[2]):
        levels = [grid.below(parameter, value) for value in np.quantile(found.flat[:, parameter], LEVELS)]
        pull = (levels - LEVELS) / error
        assert np.all(np.abs(pull) < LIMIT), f"parameter {parameter}: {pull} standard errors away"


def test_the_same_seed_gives_the_same_bytes(case):
    """A chain depends on its points, prior and generator alone; another seed gives another one."""
    points, noise, known, found, _ = case
    again, other = (run(points, noise, known, seed=seed, max_steps=100) for seed in (1, 2))
    whole = run(points, noise, known, max_steps=100)
    assert again.draws.tobytes() == whole.draws.tobytes()
    assert (again.tau, again.acceptance) == (whole.tau, whole.acceptance)
    assert other.draws.tobytes() != whole.draws.tobytes()
    assert whole.status is ChainStatus.NOT_CONVERGED
    assert found.status is ChainStatus.OK


def test_whole_sphere(on_cap):
    """The other likelihood, in the plane: against a grid of (c, r) of the density by scipy's Bessel function."""
    noise = 0.35
    points, _ = on_cap(np.random.default_rng(6), 25, d=2, noise=noise)
    middle, covariance, _ = best(points)
    reach = 7.0 * noise * np.sqrt(np.diag(covariance))
    axes = [np.linspace(a - b, a + b, 57) for a, b in zip(middle, reach, strict=True)]
    axes[2] = axes[2][axes[2] > 0.0]
    x, y, r = np.meshgrid(*axes, indexing="ij")
    logs = np.zeros(x.shape)
    for point in points:
        distance = np.hypot(point[0] - x, point[1] - y)
        logs += np.log(special.i0e(distance * r / noise**2)) - (distance - r) ** 2 / (2.0 * noise**2)
    weight = np.exp(logs - logs.max())
    weight /= weight.sum()
    mean = np.array([np.sum(weight * v) for v in (x, y, r)])
    variance = np.array([np.sum(weight * v**2) for v in (x, y, r)]) - mean**2
    found = run(points, noise, name="whole_sphere")
    assert found.status is ChainStatus.OK
    assert_moments(found, mean, variance)
    with pytest.raises(AssertionError):  # the two likelihoods are told apart here
        assert_moments(run(points, noise), mean, variance)


def test_a_likelihood_of_ones_own(on_cap, monkeypatch):
    """Any function of spheres will do: under a Gaussian the draws are of it, in the points' unit and from the origin.

    σ, which it does not depend on, follows its prior alone: flat in log σ, three decades either way.
    """
    rng = np.random.default_rng(7)
    points, _ = on_cap(rng, 20, d=3, noise=0.05, center=0.2)
    middle, covariance, _ = best(points)
    mean = middle + 0.2 * np.sqrt(np.diag(covariance))
    scatter = 0.002 * covariance

    def gaussian(reference, offsets, log_noise):
        away = offsets + np.append(points[0] - reference.away[:, 0], reference.radius) - mean
        return -0.5 * np.einsum("ki,ij,kj->k", away, np.linalg.inv(scatter), away)

    monkeypatch.setitem(LIKELIHOODS, "own", gaussian)
    found = run(points, 0.05, name="own")
    assert found.status is ChainStatus.OK
    assert_moments(found, mean, np.diag(scatter))
    found = run(points, 0.05, known=False, name="own", max_steps=3000)
    logs = np.log10(found.flat[:, -1] / 0.05)
    count = len(logs) / found.tau
    assert np.abs(logs).max() < 3.0
    assert abs(logs.mean()) < LIMIT * math.sqrt(3.0 / count)
    assert np.mean(np.abs(logs) > 1.5) == pytest.approx(0.5, abs=LIMIT * math.sqrt(0.25 / count))


def test_the_prior_itself(on_cap, monkeypatch):
    """If the likelihood is flat, draws fill the box and all radii evenly, and the status is AT_PRIOR."""
    points, _ = on_cap(np.random.default_rng(16), 10, d=2, noise=0.3)
    monkeypatch.setitem(LIKELIHOODS, "flat", lambda reference, offsets, log_noise: 0.0 * log_noise)
    center, largest = np.array([0.2, -0.1]), 2.0 + math.sqrt(2.0) * 1.5
    found = run(points, 0.3, name="flat", width=1.5, center=center)
    assert found.status is ChainStatus.AT_PRIOR
    assert_moments(found, np.append(center, 0.5 * largest), np.array([1.5**2 / 3.0] * 2 + [largest**2 / 12.0]))
    assert 0.99 * largest < found.flat[:, 2].max() < largest
    assert 0.0 < found.flat[:, 2].min() < 0.01 * largest


@pytest.mark.parametrize("scale", [1e-6, 1e6])
@pytest.mark.parametrize("known", [True, False])
def test_other_units(on_cap, scale, known):
    """Points in another unit give the same chain in that unit, wherever they lie."""
    points, _ = on_cap(np.random.default_rng(8), 30, d=2, noise=0.1, angle=120.0)
    one = run(points, 0.1, known, max_steps=100)
    shift = np.array([3.0, -4.0])
    prior = Prior(scale * shift, 10.0 * scale, scale * (2.0 + math.sqrt(2.0) * 10.0), 0.1 * scale, known)
    moved = Samples(((points + shift) * scale).T[None].copy(), None)
    other = sample(moved, prior, "geometric", np.random.RandomState(1), 64, 100)
    back = other.draws / scale - np.append(shift, [0.0] * (2 - known))
    np.testing.assert_allclose(back, one.draws, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("noise", [1e-6, 1e-12])
def test_noise_far_below_the_radius(on_cap, noise):
    """At σ = 10⁻⁶ and 10⁻¹² r the posterior is the Gaussian that the bound says, the draws rounded to 10⁻¹⁶."""
    points, directions = on_cap(np.random.default_rng(9), 30, d=3, noise=noise, angle=120.0)
    found = run(points, noise, walkers=32)
    assert found.status is ChainStatus.OK
    rows = np.column_stack([directions, np.ones(30)])
    bound = np.linalg.inv(rows.T @ rows) * noise**2
    draws = found.flat - [0.0, 0.0, 0.0, 1.0]  # before sums, which would round them
    count = len(draws) / found.tau
    ratio = draws.var(axis=0) / np.diag(bound)
    assert np.all(np.abs(ratio - 1.0) < LIMIT * np.sqrt(2.0 / count) + 1e-3)
    excess = np.linalg.norm(points, axis=1) - 1.0
    linear = bound @ rows.T @ excess / noise**2
    pull = (draws.mean(axis=0) - linear) / np.sqrt(np.diag(bound) / count)
    assert np.all(np.abs(pull) < LIMIT + 3e-4 * math.sqrt(count) * (noise == 1e-12))


class Looks:
    """A stand-in for the estimate of τ: it gives the times in turn and counts the calls."""

    def __init__(self, monkeypatch, times):
        self.times, self.steps = list(times), []
        monkeypatch.setattr(sampler, "autocorrelation_times", self)

    def __call__(self, kept):
        """Give the next time for all parameters, the last one for ever."""
        self.steps.append(len(kept))
        time = self.times.pop(0) if len(self.times) > 1 else self.times[0]
        return np.array([time, 0.5 * time, 0.1])


@pytest.mark.parametrize("last", [False, True])
def test_a_chain_goes_on_until_it_is_fifty_times_long(on_cap, monkeypatch, last):
    """With τ = 30 the chain runs until 1500 steps remain, and not much longer; τ is the largest of the parameters'."""
    points, _ = on_cap(np.random.default_rng(10), 20, d=2, noise=0.05)
    looks = Looks(monkeypatch, [30.0])
    found = run(points, 0.05, walkers=16, max_steps=1800 if last else 20_000)
    assert found.tau == 30.0
    assert found.status is (ChainStatus.NOT_CONVERGED if last else ChainStatus.OK)
    assert looks.steps[-1] == len(found.draws)
    assert all(steps < 1500 for steps in looks.steps[:-1])
    assert (len(found.draws) >= 1500) is not last
    assert found.steps <= (1800 if last else 2000)


@pytest.mark.parametrize(
    ("times", "count"), [([1.0], 2), ([1.0, 1.0075], 2), ([1.0, 1.025], 3), ([1.0, 0.975, 1.0], 4)]
)
def test_a_chain_goes_on_until_its_time_is_stable(on_cap, monkeypatch, times, count):
    """A chain of any length ends when two checks in a row differ by less than 1 %, and never at the first check."""
    points, _ = on_cap(np.random.default_rng(10), 20, d=2, noise=0.05)
    looks = Looks(monkeypatch, times)
    assert run(points, 0.05, walkers=16).status is ChainStatus.OK
    assert len(looks.steps) == count
    assert looks.steps == sorted(set(looks.steps))


@pytest.mark.parametrize("max_steps", [31, 100, 120])
@pytest.mark.parametrize("known", [True, False])
def test_a_budget_that_is_too_small(on_cap, max_steps, known):
    """The chain is returned with its status, and its draws are numbers near the sphere."""
    points, _ = on_cap(np.random.default_rng(11), 40, d=3, noise=0.05)
    found = run(points, 0.05, known, max_steps=max_steps)
    assert found.status is ChainStatus.NOT_CONVERGED
    assert found.steps == max_steps
    assert len(found.draws) == max_steps - max_steps // 5
    assert np.isfinite(found.draws).all()
    assert 0.0 < found.tau < max_steps
    middle, covariance, _ = best(points)
    assert np.all(np.abs(found.flat.mean(axis=0)[:4] - middle) < 3.0 * 0.05 * np.sqrt(np.diag(covariance)))


def across(points, centers):
    """True for centres (k, 2) on one side of the points (n, 2)."""
    normal = np.linalg.eigh(np.cov(points.T))[1][:, 0]
    return (centers - points.mean(axis=0)) @ normal > 0.0


@pytest.mark.parametrize(
    ("seed", "noise", "width"),
    [
        (18, 0.2, 1.5),
        *(pytest.param(18, 0.1, width, marks=pytest.mark.slow) for width in (1.0, 2.0)),
        pytest.param(12, 0.2, 1.5, marks=pytest.mark.slow),
        *(pytest.param(seed, 0.1, 2.0, marks=pytest.mark.slow) for seed in (12, 21)),
        pytest.param(21, 0.2, 1.5, marks=pytest.mark.slow),
        (12, 0.01, 2.0),
    ],
)
def test_flat_caps(on_cap, seed, noise, width):
    """On a cap of 20°, .06 high, the likelihood does not fall towards a plane: the draws are those of the integral.

    Where the integral has mass beyond nine tenths of the box, the status says so; with little noise it has none. The
    second group has a mode on either side of the points: from the best sphere alone and without moves across, chains
    settled at one. With 12 and .2 such a chain had 87 % of its draws on the side that has 71 %, and passed for long
    enough. The share of the draws on one side of the points is the integral's, too.
    """
    points, _ = on_cap(np.random.default_rng(seed), 50, angle=20.0, d=2, noise=noise)
    grid = Integrated(points, noise, [-width] * 2, [width] * 2, 500)
    rim = grid.weight[np.abs(grid.place).max(axis=0) > 0.9 * width].sum()
    assert rim > 0.03 or seed != 18
    found = checked(points, noise, width, max_steps=6000)
    assert found.status is not ChainStatus.OK or rim < 0.03
    assert found.status is not ChainStatus.AT_PRIOR or rim > 2e-3
    assert found.status in (ChainStatus.OK, ChainStatus.AT_PRIOR)
    assert np.abs(found.flat[:, :2]).max() < width
    share, drawn = grid.weight[across(points, grid.place.T)].sum(), across(points, found.flat[:, :2]).mean()
    spread = np.sqrt(max(share * (1.0 - share), 0.0) * found.tau / len(found.flat))
    assert abs(drawn - share) <= LIMIT * spread + 1e-9
    assert_moments(found, *grid.moments())


def test_walkers_that_do_not_mix(on_cap):
    """With moves too short to cross, walkers stay where they started, and the status is neither ok nor at the prior."""
    points, _ = on_cap(np.random.default_rng(12), 50, angle=40.0, d=2, noise=0.2)
    prior, samples = (
        Prior(np.zeros(2), 3.0, 2.0 + math.sqrt(2.0) * 3.0, 0.2, True),
        Samples(points.T[None].copy(), None),
    )
    start = sampler.best_start(samples, prior)
    middle = points.mean(axis=0)
    there = 2.0 * middle - start.origin[:2]
    walkers = 0.01 * np.random.default_rng(1).standard_normal((64, 3))
    other = np.append(there, np.linalg.norm(points - there, axis=1).mean()) - start.origin
    walkers[1::2] += np.linalg.solve(start.spread, other)
    start = start._replace(walkers=walkers, move=emcee.moves.GaussianMove(1e-4))
    found = sample(samples, prior, "geometric", np.random.RandomState(1), 64, 3000, start)
    assert found.status is not ChainStatus.OK
    assert not sampler._mixed(found.draws)


@pytest.mark.parametrize("walkers", [8, 64])
def test_mixed(walkers):
    """Independent draws of 50 steps are mixed; half of them near by for good, or one far away, are not.

    The first is false in 1 of 10⁵ chains, ten of which are tried.
    """
    rng = np.random.default_rng(1)
    for _ in range(10):
        draws = rng.standard_normal((50, walkers, 3))
        assert sampler._mixed(draws)
        draws[:, : walkers // 2, 1] += 1.0
        assert not sampler._mixed(draws)
    draws = rng.standard_normal((50, 64, 3))
    draws[:, 0, 2] += 20.0
    assert not sampler._mixed(draws)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("noise", [0.05, 0.1])
def test_a_cap_on_which_the_flat_prior_is_improper(on_cap, noise, known):
    """Theory §6: φ = 20°, N = 50 in a box of ten radii is not called ok (σ = .02 r has 10⁻⁶ of its mass beyond).

    A chain of an ordinary cap is ok within 200 steps.
    """
    points, _ = on_cap(np.random.default_rng(2), 50, angle=20.0, noise=noise)
    found = checked(points, noise, 10.0, known, walkers=32, max_steps=500)
    assert found.status in (ChainStatus.AT_PRIOR, ChainStatus.NOT_CONVERGED)
    assert np.isfinite(found.draws).all()
    assert np.abs(found.flat[:, :3]).max() < 10.0


def degenerate(d):
    """Point sets (n, d) that say little or nothing of a sphere, by name."""
    rng = np.random.default_rng(13)
    line = rng.standard_normal((20, 1)) * np.ones(d)
    direction = rng.standard_normal((20, d))
    sphere = direction / np.linalg.norm(direction, axis=1)[:, None]
    plane = rng.standard_normal((20, d))
    plane[:, 0] = 0.0
    return {
        "collinear": line,
        "one point": np.ones((20, d)),
        "two points": np.repeat([[0.0] * d, [1.0] * d], 10, axis=0),
        "coplanar": plane,
        "a ball": 0.1 * rng.standard_normal((20, d)),
        "as many as parameters": sphere[: d + 1] + 0.1 * rng.standard_normal((d + 1, d)),
        "one more": sphere[: d + 2] + 0.1 * rng.standard_normal((d + 2, d)),
        "without noise": sphere,
        "a point in the centre": np.concatenate([sphere, -sphere, np.zeros((1, d))]),
        "a cross": np.concatenate([np.eye(d), -np.eye(d)]),
        "far away": 1e9 + sphere,
        "huge": 1e120 * sphere,
        "too large": 1e300 * sphere,
        "infinite": np.concatenate([sphere, np.full((1, d), np.inf)]),
        "missing": np.concatenate([sphere, np.full((1, d), np.nan)]),
    }


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("known", [True, False], ids=["known", "unknown"])
@pytest.mark.parametrize("name", ["geometric", "whole_sphere"])
@pytest.mark.parametrize("kind", list(degenerate(2)))
def test_points_without_a_sphere(d, known, name, kind):
    """Degenerate points never raise: a status, and either no draws or numbers within the prior."""
    found = run(degenerate(d)[kind], 0.1, known, name, walkers=16, max_steps=20)
    assert found.status is not ChainStatus.OK  # twenty steps are never enough
    assert found.draws.shape[1:] == (16, d + 2 - known)
    if found.status is ChainStatus.NO_START:
        assert found.draws.size == found.flat.size == found.steps == 0
        assert math.isnan(found.tau)
        assert math.isnan(found.acceptance)
    else:
        assert np.isfinite(found.draws).all()
        assert found.acceptance > 0.0  # a chain that cannot move is no posterior
        assert np.abs(found.draws[..., :d]).max() < 10.0
        assert found.draws[..., d].min() > 0.0
        if not known:
            assert np.abs(np.log10(found.draws[..., -1] / 0.1)).max() < 3.0
    nothing = {"collinear", "one point", "two points", "far away", "huge", "too large", "infinite"}
    if kind in nothing or (kind == "coplanar" and d == 3) or (kind == "as many as parameters" and not known):
        assert found.status is ChainStatus.NO_START


def test_a_start_outside_of_the_box(on_cap):
    """If the points' sphere is not in the box, there is no start and no chain."""
    points, _ = on_cap(np.random.default_rng(14), 30, noise=0.01, center=20.0)
    assert run(points, 0.01, max_steps=100).status is ChainStatus.NO_START
    assert run(points, 0.01, max_steps=100, center=[20.0] * 3).status is ChainStatus.NOT_CONVERGED


@pytest.mark.parametrize(("d", "seed"), [(2, 29), (3, 3)])
@pytest.mark.parametrize("known", [True, False])
def test_a_start_where_the_best_sphere_is_none(on_cap, d, seed, known):
    """If maximum likelihood leaves the box or diverges to a plane, walkers start from GDKE's sphere."""
    points, _ = on_cap(np.random.default_rng(seed), 50, angle=20.0, d=d, noise=0.1)
    fit = study.fit(points, "mle")
    assert fit.status != study.Status.OK or np.abs(fit.center).max() > 10.0
    found = run(points, 0.1, known, walkers=16, max_steps=50)
    assert found.status is ChainStatus.NOT_CONVERGED
    assert np.abs(found.draws[0, :, :d]).max() < 10.0
    assert found.acceptance > 0.1


def test_walkers_that_start_outside_of_the_box_are_pulled_in(on_cap):
    """A box that just holds the best sphere holds all draws as well, and they move."""
    points, _ = on_cap(np.random.default_rng(15), 30, noise=0.1)
    middle, _, _ = best(points)
    found = run(points, 0.1, center=middle[:3] + 0.0499, width=0.05, max_steps=300)
    assert found.status is ChainStatus.NOT_CONVERGED
    assert np.abs(found.flat[:, :3] - middle[:3] - 0.0499).max() < 0.05
    assert found.acceptance > 0.05
    assert np.all(np.ptp(found.draws[..., 0], axis=0) > 0.0)


def test_statuses_have_words():
    """Numbers are those stored in tables, and each has its words."""
    names = ["OK", "NOT_CONVERGED", "AT_PRIOR", "NO_START", "NOT_MIXED", "DIFFERS", "NOT_CHECKED"]
    assert [(s.name, int(s)) for s in ChainStatus] == [(name, number) for number, name in enumerate(names)]
    assert len({s.text for s in ChainStatus}) == 7


def autoregressive(steps, walkers, memory, seed=1):
    """Chains x' = ρx + √(1 - ρ²) z of several ρ, from their stationary law: (steps, walkers, parameters)."""
    random, memory = np.random.default_rng(seed), np.asarray(memory)
    chain = np.empty((steps, walkers, len(memory)))
    chain[0] = random.standard_normal((walkers, len(memory)))
    for before, after in itertools.pairwise(chain):
        after[:] = memory * before + np.sqrt(1.0 - memory**2) * random.standard_normal(before.shape)
    return chain


def test_theory():
    """τ = (1 + ρ)/(1 - ρ). With 256 walkers of 4000 steps each τ has an error below 1 %; a fixed seed, five of them.

    emcee's own function gives the same numbers. A walker that never moved leaves its parameter without one.
    """
    memory = np.array([0.0, 0.3, 0.6, 0.8])
    expected = (1.0 + memory) / (1.0 - memory)
    chain = autoregressive(4000, 256, memory)
    assert autocorrelation_times(chain) == pytest.approx(expected, rel=0.05)
    for part in (chain[:, :5], chain[:201, :9]):
        assert autocorrelation_times(part) == pytest.approx(integrated_time(part, tol=0, quiet=True), rel=1e-9)
    chain = autoregressive(50, 8, [0.5, 0.5])
    chain[:, 3, 1] = 0.1  # whose mean is another number in the last bit
    with np.errstate(all="ignore"):
        assert np.isnan(autocorrelation_times(chain)).tolist() == [False, True]
