"""Draws from the closed marginal density of a sphere's centre: they find the modes, start chains and check them.

Given the centre c, let R̄ and S be the mean of the points' distances from it and the sum of squares about that mean.
The geometric posterior of r is then normal about R̄ with variance σ²/n, and if σ is unknown, S/σ² is χ² with n - 1
degrees of freedom. Both integrate out: the centre has the density exp(-S/2σ²), or S^(-(n-1)/2). With the likelihood of
the whole sphere r moves by -(d-1)σ²/2R̄, and the ratio of the two likelihoods is part of a draw's weight.

The draws begin all over the prior's box, evenly in the coordinates w along rays (`sampler.py`). The density's power
then rises from 0 to 1 in steps. In each the draws are weighted, and new ones come from Student's kernels about some of
them, each with the covariance of its neighbourhood (population Monte Carlo: Cappé et al. 2004). At powers below 1 a
part of the points is enough, as its posterior is wider. Steps end early where draws lie about the best sphere as its
ellipsoid says: higher powers only narrow it. A step loses a mode with the share m of its mass with a probability of
(1 - m)^`_KERNELS`: 0.007 for a twentieth. The best sphere's mode is not lost. The last draws are of all points, a tenth
of them are spread over the whole box, and their weights are exact.

Of 60 sets of 5 to 200 points, the means, standard deviations and quantiles of ok chains are those of an integration by
cells (`tests/simulation/posterior/test_marginal.py`).
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import emcee
import numpy as np
from scipy import special

from study.arrays import Floats
from study.fits import Samples
from study.fits.loops.jit import compiled, squared
from study.fits.loops.random import OldStream
from study.simulation.experiment.config import ChainStatus
from study.simulation.posterior.sampler import (
    LIKELIHOODS,
    NOISE_RANGE,
    Chain,
    Prior,
    RayCoordinates,
    Reference,
    Start,
    best_start,
    distances,
    geometric,
    sample,
)

Source = np.random.Generator | OldStream

_FIRST, _DRAWS, _LAST = 8192, 1024, 4096
"""Draws of the first step, of each further one, and of the last one, which is repeated with twice as many ..."""
_REPEATS = 3
"""... so often at most, until they are precise."""
_LEFT = 0.125
"""Share of the draws that a step leaves, as an effective size."""
_STEPS = 200
"""Most steps; there are about 40 at σ = 10⁻⁹ r."""
_FEW = 64
"""Most points in steps at powers below 1."""
_KERNELS, _AROUND, _NEAR = 96, 256, 24
"""Kernels of a step; draws by weight among which they have their neighbours; and the number of these."""
_SPREAD = 0.1
"""Share of the draws that are spread over the box whatever the density."""
_SHARES, _ALIKE = np.array([0.5, 0.9]), 1.5
"""Draws are those of an ellipsoid if their squared distances have these quantiles, to a factor."""
PRECISE = 0.03
"""Largest standard error of the draws' means and standard deviations, in sd, with which they can check a chain."""
TOLERANCE = 0.1
"""Largest difference of means, standard deviations and quantiles between a chain and the draws, in sd."""
_LONG = 15.0
"""Most τ for which a chain from the draws is long enough for its standard deviations within its budget of steps."""
_LEVELS, _ERRORS = np.array([0.025, 0.16, 0.5, 0.84, 0.975]), 3.0
"""Levels of the quantiles, and their standard errors that do not count as a difference."""


class _Kernels(NamedTuple):
    """Student's kernels with d + 2 degrees of freedom, and a ball over which a share of the draws is spread evenly.

    Attributes:
        middle: (kernels, d).
        root: Cholesky's factor of each kernel's covariance (kernels, d, d).
        reach: radius of the ball about 0.
    """

    middle: Floats
    root: Floats
    reach: float

    @classmethod
    def of(cls, places: Floats, weights: Floats, reach: float, random: np.random.Generator) -> "_Kernels":
        """Kernels about some of the weighted places (k, d)."""
        chosen = places[random.choice(len(places), _AROUND, p=weights)]
        middle = chosen[:_KERNELS]
        apart = ((middle[:, None] - chosen) ** 2).sum(axis=2)
        around = chosen[np.argpartition(apart, _NEAR, axis=1)[:, :_NEAR]]
        around -= around.mean(axis=1, keepdims=True)
        covariance = around.transpose(0, 2, 1) @ around / _NEAR
        least = 1e-3 * np.trace(covariance, axis1=1, axis2=2) + 1e-30  # neighbours may be one draw, many times
        return cls(middle, np.linalg.cholesky(covariance + least[:, None, None] * np.eye(places.shape[1])), reach)

    def draw(self, count: int, random: Source) -> Floats:
        """Places (count, d)."""
        d = self.middle.shape[1]
        which, freedom = random.choice(len(self.middle), count), d + 2.0
        unit = random.standard_normal((count, d)) * np.sqrt(freedom / random.chisquare(freedom, count))[:, None]
        places = self.middle[which] + np.einsum("kij,kj->ki", self.root[which], unit)
        spread = random.random(count) < _SPREAD
        places[spread] = _in_ball(int(spread.sum()), d, self.reach, random)
        return np.asarray(places)

    def log_density(self, places: Floats) -> Floats:
        """Log-density at places (k, d)."""
        d = self.middle.shape[1]
        freedom, inverse, density = (
            d + 2.0,
            np.asarray(np.linalg.inv(self.root), dtype=np.float64),
            np.empty(len(places)),
        )
        height = math.gamma(d + 1.0) / (math.gamma(0.5 * freedom) * (freedom * math.pi) ** (0.5 * d) * len(inverse))
        _sum_kernels(self.middle, inverse, height * np.linalg.det(inverse), places, density)
        ball = math.pi ** (0.5 * d) * self.reach**d / math.gamma(0.5 * d + 1.0)
        even = ((places**2).sum(axis=1) < self.reach**2) / ball
        return np.asarray(np.log((1.0 - _SPREAD) * density + _SPREAD * even))


@compiled
def _sum_kernels(middle: Floats, inverse: Floats, height: Floats, places: Floats, density: Floats) -> None:
    """Sums over kernels of height (1 + |L⁻¹(w - m)|²/(d + 2))^-(d+1), at each place w."""
    d = middle.shape[1]
    for m in range(len(places)):
        total = 0.0
        for k in range(len(middle)):
            square = 0.0
            for i in range(d):
                along = 0.0
                for j in range(d):
                    along += inverse[k, i, j] * (places[m, j] - middle[k, j])
                square += squared(along)
            near, value = 1.0 / (1.0 + square / (d + 2.0)), height[k]
            for _ in range(d + 1):
                value *= near
            total += value
        density[m] = total


@dataclass(frozen=True)
class MarginalDraws:
    """Weighted draws of a posterior.

    Attributes:
        values: centre, radius, and σ if it is unknown (k, parameters).
        weights: their weights (k,), which sum to 1.
        kernels: the law by which their centres were drawn.
    """

    values: Floats
    weights: Floats
    kernels: _Kernels

    @property
    def size(self) -> float:
        """Effective sample size."""
        return _size(self.weights)

    @property
    def mean(self) -> Floats:
        """Means (parameters,)."""
        return np.asarray(self.weights @ self.values)

    @property
    def sd(self) -> Floats:
        """Standard deviations (parameters,)."""
        return np.asarray(np.sqrt(self.weights @ (self.values - self.mean) ** 2))

    @property
    def precise(self) -> bool:
        """True if means and standard deviations are known well enough to check a chain."""
        squares = ((self.values - self.mean) / self.sd) ** 2
        weights = self.weights**2
        errors = np.sqrt(np.maximum(weights @ squares, weights @ (0.5 * (squares - 1.0)) ** 2))
        return bool((errors < PRECISE).all())

    @property
    def least(self) -> float:
        """Effective size of a chain whose standard deviations have errors of a quarter of `TOLERANCE`."""
        fourth = self.weights @ ((self.values - self.mean) / self.sd) ** 4
        return float((fourth.max() - 1.0) / (0.25 * TOLERANCE) ** 2 / 4.0)

    def quantiles(self, levels: Floats) -> Floats:
        """Quantiles of each parameter (levels, parameters)."""
        orders = np.argsort(self.values, axis=0)
        pairs = zip(orders.T, self.values.T, strict=True)
        return np.column_stack([np.interp(levels, np.cumsum(self.weights[o]), v[o]) for o, v in pairs])

    def shrink_factor(self, chain: Chain) -> float:
        """R̂ of a chain and the draws: √(1 + variance of their means / mean of their variances), largest of all."""
        apart, within = chain.flat.mean(axis=0) - self.mean, 0.5 * (chain.flat.var(axis=0) + self.sd**2)
        return float(np.sqrt(1.0 + 0.5 * apart**2 / within).max())

    def difference(self, chain: Chain) -> float:
        """Largest difference between a chain and the draws, in sd: of means, standard deviations and quantiles.

        A chain's quantile of level p may be any of the draws' quantiles from p - 3e to p + 3e, with e the standard
        error of a share p in both. Means and standard deviations have no such allowance.
        """
        flat, sd = chain.flat, self.sd
        error = _ERRORS * np.sqrt(_LEVELS * (1.0 - _LEVELS) * (chain.tau / len(flat) + 1.0 / self.size))
        found, low, high = (
            np.quantile(flat, _LEVELS, axis=0),
            *np.split(self.quantiles(np.concatenate([_LEVELS - error, _LEVELS + error])), 2),
        )
        beyond = np.maximum(low - found, found - high).max(axis=0)
        apart = np.maximum(np.abs(flat.mean(axis=0) - self.mean), np.abs(flat.std(axis=0) - sd))
        return float((np.maximum(apart, beyond) / sd).max())


@dataclass(frozen=True)
class Marginal:
    """The marginal density of the centre, in the coordinates w.

    Attributes:
        points: (d, n).
        prior: the range of the parameters.
        name: name of the likelihood, in `LIKELIHOODS`.
        rays: the coordinates.
    """

    points: Floats
    prior: Prior
    name: str
    rays: RayCoordinates

    def draws(self, random: np.random.Generator) -> MarginalDraws | None:
        """Draw from the posterior; None if it is not found: in a tiny box, or after too many steps."""
        d, n = self.points.shape
        every, few = self._reference(self.points), self._reference(self.points[:, random.permutation(n)[:_FEW]])
        # about a deep mode S^(-k/2) is |δ|^-k: the mass moves there as k passes d, step by step
        most = 1.0 if self.prior.known else 2.0 / (min(n, _FEW) - 1.0)
        kernels, before, power = None, None, 0.0
        for _ in range(_STEPS):
            places = _in_ball(_FIRST, d, self._reach, random) if kernels is None else kernels.draw(_DRAWS, random)
            places, center, volume = self._in_box(places)
            if not len(places):
                break
            begin = -volume if before is None else self._logs(before, center)[0]
            goal = self._logs(few if before is None else every, center)[0]
            logs = begin + volume - (0.0 if kernels is None else kernels.log_density(places))
            power, weights = _step(logs, goal - begin, power, most if power < 1.5 * d * most else 1.0)
            count = min(n, _FEW)
            now = (count, power) if before is None else (count + power * (n - count), 1.0)
            if self._regular(center, weights, *now):
                return self._last(every, self._ellipsoid(), random)
            kernels = _Kernels.of(places, weights, self._reach, random)
            if power == 1.0 and (before is not None or n <= _FEW):
                best = self._ellipsoid()
                middle, root = np.vstack([kernels.middle, best.middle]), np.vstack([kernels.root, best.root])
                return self._last(every, _Kernels(middle, root, self._reach), random)
            if power == 1.0:
                before, power = few, 0.0
        return None

    def _last(self, every: Reference, kernels: _Kernels, random: np.random.Generator) -> MarginalDraws | None:
        """Draw centres from kernels, and the other parameters given these, until they are precise or many."""
        d, n, prior = *self.points.shape, self.prior
        for repeat in range(_REPEATS + 1):
            places, center, volume = self._in_box(kernels.draw(_LAST << repeat, random))
            logs, mean, squares = self._logs(every, center)
            logs += volume - kernels.log_density(places)
            noise = np.full(len(logs), prior.noise)
            if not prior.known:
                noise = np.sqrt(squares / random.chisquare(n - 1.0, len(logs)))
            radius = mean + noise / math.sqrt(n) * random.standard_normal(len(logs))
            if self.name != "geometric":  # in place of what `_logs` has for it
                offsets = np.column_stack([center - self.rays.origin[:d], radius - every.radius])
                logs += n * (d - 1) * np.log(mean) - geometric(every, offsets, np.log(noise))
                shift = -0.5 * (d - 1) * noise**2 / mean
                radius, offsets[:, d] = radius + shift, offsets[:, d] + shift
                logs += LIKELIHOODS[self.name](every, offsets, np.log(noise))
            allowed = (radius > 0.0) & (radius < prior.radius)
            allowed &= np.abs(np.log(noise / prior.noise)) < math.log(NOISE_RANGE)
            if not allowed.any():
                return None
            weights = _weights(np.where(allowed, logs, -np.inf))
            values = np.column_stack([center, radius] if prior.known else [center, radius, noise])
            result = MarginalDraws(values, weights, kernels)
            if result.precise:
                break
            tails = weights * (1.0 + (((values - result.mean) / result.sd) ** 2).max(axis=1))  # they decide the sd
            kernels = _Kernels.of(places, tails / tails.sum(), self._reach, random)
        return result

    def _regular(self, center: Floats, weights: Floats, count: float, power: float) -> bool:
        """True if centres lie about the best sphere's as its ellipsoid says for so many points at a power.

        If S is quadratic, their squared Mahalanobis distances follow χ², or Snedecor's law if σ is unknown.
        """
        d, n = self.points.shape
        unit = np.linalg.solve(self.rays.spread[:d, :d], (center - self.rays.origin[:d]).T)
        squares = (unit**2).sum(axis=0) * count / n
        order = np.argsort(squares)
        found = np.interp(_SHARES, np.cumsum(weights[order]), squares[order])
        if self.prior.known:
            expected = special.chdtri(d, 1.0 - _SHARES) / power
        elif (spare := power * (count - 1.0) - d) > 0.0:
            expected = (count - d - 1.0) * d / spare * special.fdtri(d, spare, _SHARES)
        else:
            return False
        return bool(((found < _ALIKE * expected) & (expected < _ALIKE * found)).all())

    def _ellipsoid(self) -> _Kernels:
        """The best sphere's ellipsoid as one kernel."""
        d, near = len(self.points), 0.5 * self.rays.extent
        away = self.rays.origin[:d] - self.rays.centroid
        distance = max(float(np.linalg.norm(away)), 1e-9 * near)
        length, along = math.log1p(distance / near), np.outer(away, away) / distance**2
        slope = along / (distance + near) + (np.eye(d) - along) * (length / distance)
        return _Kernels((away * (length / distance))[None], (slope @ self.rays.spread[:d, :d])[None], self._reach)

    def _reference(self, points: Floats) -> Reference:
        d = len(points)
        return Reference.of(points, self.rays.origin[:d], self.rays.origin[d])

    @property
    def _reach(self) -> float:
        """Radius of a ball of places that holds the box."""
        corner = np.abs(self.rays.centroid - self.prior.center) + self.prior.width
        return math.log1p(float(np.linalg.norm(corner)) / (0.5 * self.rays.extent))

    def _in_box(self, places: Floats) -> tuple[Floats, Floats, Floats]:
        """Places whose centres are in the box, these centres, and the log-volumes of centres per volume of places."""
        center, volume = self.rays.centers(places)
        inside = (np.abs(center - self.prior.center) < self.prior.width).all(axis=1)
        return places[inside], center[inside], volume[inside]

    def _logs(self, reference: Reference, center: Floats) -> tuple[Floats, Floats, Floats]:
        """Log-density of centres (k, d), R̄ and S; the density is approximate for the whole sphere's likelihood."""
        d, n = reference.away.shape
        mean, squares = distances(reference, center - self.rays.origin[:d])
        squares = np.maximum(squares, 1e-6 * (self.prior.noise / NOISE_RANGE) ** 2)
        logs = -0.5 * squares / self.prior.noise**2 if self.prior.known else -0.5 * (n - 1) * np.log(squares)
        return logs - (0.0 if self.name == "geometric" else n * (d - 1) * np.log(mean)), mean, squares


class MarginalMove(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """Propose places independent of the walker's own: a centre from kernels, and r and σ by their laws given it.

    Args:
        rays: coordinates of the walkers.
        kernels: law of the centre.
        noise: σ if it is known.
    """

    def __init__(self, rays: RayCoordinates, kernels: _Kernels, noise: float | None) -> None:
        super().__init__()
        self.rays, self.kernels, self.noise = rays, kernels, noise

    def get_proposal(self, s: Floats, c: list[Floats], random: OldStream) -> tuple[Floats, Floats]:
        """Places for walkers ``s`` (k, p), and log-ratios of proposal densities."""
        d, n = self.rays.points.shape
        there = np.empty_like(s)
        there[:, :d], spread = self.kernels.draw(len(s), random), np.full(len(s), self.noise or 1.0)
        if self.noise is None:
            spread /= np.sqrt(random.chisquare(n - 1.0, len(s)))
            there[:, d + 1] = np.log(spread)
        there[:, d] = spread / math.sqrt(n) * random.standard_normal(len(s))
        here, volume = self.rays.coordinates(s)
        walkers, after = self.rays.walkers(there)
        return walkers, self._logs(here) - self._logs(there) + after - volume

    def _logs(self, places: Floats) -> Floats:
        """Log-density of proposals at coordinates (k, p), up to a constant."""
        d, n = self.rays.points.shape
        logs = self.kernels.log_density(places[:, :d])
        if self.noise is not None:
            return np.asarray(logs - 0.5 * n * (places[:, d] / self.noise) ** 2)
        precision = np.exp(-2.0 * places[:, d + 1])
        return np.asarray(logs - n * places[:, d + 1] - 0.5 * precision * (1.0 + n * places[:, d] ** 2))


class Streams(NamedTuple):
    """Random numbers of a posterior.

    Attributes:
        marginal: of the draws of the centre's marginal density.
        chain: of a chain from the best sphere's ellipsoid.
        second: of a chain from these draws.
    """

    marginal: np.random.Generator
    chain: OldStream
    second: OldStream


def sample_checked(samples: Samples, prior: Prior, name: str, streams: Streams, walkers: int, max_steps: int) -> Chain:
    """Run a chain from the best sphere's ellipsoid, and check it by draws of the centre's marginal density.

    If these draws are precise and the ellipsoid is not like them, or the chain differs from them or does not mix, the
    chain is one that starts from them. For the arguments see `sampler.sample`.

    Returns:
        The chain; it is ok only if the draws are precise and agree with it.
    """
    start = best_start(samples, prior)
    if start is None:
        return sample(samples, prior, name, streams.chain, walkers, max_steps)
    rays = RayCoordinates(samples.x[0], start.origin, start.spread)
    draws = Marginal(samples.x[0], prior, name, rays).draws(streams.marginal)
    if draws is None or not draws.precise or _like(draws, start, samples.x.shape[1]):
        chain = _checked(sample(samples, prior, name, streams.chain, walkers, max_steps, start), draws)
        if draws is None or not draws.precise or chain.status not in (ChainStatus.DIFFERS, ChainStatus.NOT_MIXED):
            return chain
    places = draws.values[streams.second.choice(len(draws.values), walkers, p=draws.weights)]
    if not prior.known:
        places[:, -1] = np.log(places[:, -1])
    move = MarginalMove(rays, draws.kernels, prior.noise if prior.known else None)
    least = draws.least if draws.least * _LONG < walkers * max_steps else 0.0
    start = start._replace(walkers=rays.walkers_at(places), move=move, least=least)
    return _checked(sample(samples, prior, name, streams.second, walkers, max_steps, start), draws)


def _like(draws: MarginalDraws, start: Start, d: int) -> bool:
    """True if the centre's means and standard deviations are those of a start, to 1.5 sd and a factor of 2."""
    sd = np.sqrt((start.spread[:d] ** 2).sum(axis=1))
    near = np.abs(draws.mean[:d] - start.origin[:d]) < 1.5 * sd
    return bool((near & (np.abs(np.log2(draws.sd[:d] / sd)) < 1.0)).all())


def _checked(chain: Chain, draws: MarginalDraws | None) -> Chain:
    """A chain with its differences from the draws, and a status that takes account of them."""
    if draws is None or not len(chain.draws):
        return replace(chain, status=ChainStatus.NOT_CHECKED if chain.status == ChainStatus.OK else chain.status)
    difference, status = draws.difference(chain), chain.status
    if status == ChainStatus.OK and not draws.precise:
        status = ChainStatus.NOT_CHECKED
    elif status == ChainStatus.OK and not difference <= TOLERANCE:
        status = ChainStatus.DIFFERS
    rhat = draws.shrink_factor(chain)
    return replace(chain, status=status, rhat=rhat, difference=difference, checked=draws.size)


def _step(start: Floats, slope: Floats, power: float, most: float) -> tuple[float, Floats]:
    """The largest power up to 1 at which enough draws are left, and their weights there.

    Args:
        start: log-weights at power 0 (k,).
        slope: change of the log-weights up to power 1 (k,).
        power: the power of the step before, from which the draws are.
        most: largest change of the power.
    """
    last = 1.0 if power + most > 1.0 - 1e-9 else power + most
    weights = _weights(start + last * slope)
    if _size(weights) >= _LEFT * len(start):
        return last, weights
    low, high = -70.0, math.log(last - power)
    for _ in range(14):
        middle = 0.5 * (low + high)
        enough = _size(_weights(start + (power + math.exp(middle)) * slope)) >= _LEFT * len(start)
        low, high = (middle, high) if enough else (low, middle)
    power += math.exp(low)
    return power, _weights(start + power * slope)


def _weights(logs: Floats) -> Floats:
    weights = np.exp(logs - logs.max())
    return np.asarray(weights / weights.sum())


def _size(weights: Floats) -> float:
    return float(1.0 / (weights @ weights))


def _in_ball(count: int, dimension: int, reach: float, random: Source) -> Floats:
    """Places spread evenly over a ball about 0 (count, d)."""
    way = random.standard_normal((count, dimension))
    length = reach * random.random(count) ** (1.0 / dimension)
    return np.asarray(way * (length / np.linalg.norm(way, axis=1))[:, None])
