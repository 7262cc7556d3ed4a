"""One ensemble posterior of a sphere by emcee, from the MLE's ellipsoid until the chain is long enough.

Most moves propose independent places from Student's distribution with the mean and covariance of the other half of the
walkers. The posteriors here are so nearly normal that the integrated autocorrelation time τ is then about 3 steps; with
the stretch move it is about 50. One move in ten is differential evolution (ter Braak 2006), which also works for
posteriors that are not normal. A chain whose walkers start elsewhere, because the ellipsoid is not like the posterior,
has a move of its own in place of the fitted one (`marginal.py`, which also checks every chain).

A chain is long enough when what remains after its first fifth is 50 τ long, and τ is stable to 1 %. As τ does not
notice walkers that stay at one mode each, they must be mixed as well, by the variance between their means; otherwise
the chain's status says so.

There are two log-likelihoods, both up to a constant. Geometric: the distances Rᵢ = |xᵢ - c| are normal about r with the
noise's σ. Maximum likelihood (paper §4.3) maximises it. It says nothing about directions, and holds for any cap. Whole
sphere: the density of a point x = c + r u + σ z with u uniform on the whole sphere, integrated over u. With k = Rr/σ²
and ν = d/2 - 1 it is (2πσ²)^(-d/2) exp(-(R - r)²/2σ²) Γ(ν+1) (2/k)^ν e^-k I_ν(k), and in three dimensions the Bessel
function is a sinh. For k ≫ 1 it is the geometric one times (R r)^(-(d-1)/2) per point, which moves the radius by
-(d-1)σ²/2r. It counts it as evidence where no points are, and so is wrong on a cap (theory §6).

Spheres are given as offsets from a reference (c*, r*) near the data's own: R - r is then formed without the
cancellation that would cost all digits where σ ≪ r.

The prior is flat on the centre in a box and on the radius, and 1/σ on an unknown noise. The box is needed, as a flat
prior on the whole space makes the posterior of a partial cap improper: towards a plane the likelihood tends to a
constant.

Modes of a flat cap's posterior. Points on a flat cap, whose noise is about its height or above, are explained about as
well by a sphere on the other side, by one of any larger radius up to a plane, and some of them by a small one. These
modes differ widely in size, and walkers in (c, r) hardly ever find a way between them. All have their centres on rays
from the points' centroid x̄, along which the sphere's tangent near the points keeps its direction. So the centre is
given as

    w = u log(1 + D/ε),    c - x̄ = D u,    dc/dw = (D + ε) (D/|w|)^(d-1),

with half the points' extent for ε; then both sides, near and far, are a few units apart. Given the centre, the
geometric radius is normal about the mean distance R̄(c) with variance σ²/n, and an unknown σ is proportional to √S(c),
S = Σ(R - R̄)². So (r - R̄)/√S and log σ - log √S take their places; r - R̄ takes that of r if σ is known.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import emcee
import numpy as np
import scipy.fft

from study.arrays import Floats
from study.fits import Samples, Status
from study.fits.loops.jit import compiled, squared
from study.fits.loops.random import OldStream
from study.fits.registry import fit_samples
from study.simulation.experiment.config import ChainStatus


def autocorrelation_times(chain: Floats) -> Floats:
    """Integrated autocorrelation times of the parameters, by emcee's rule.

    The autocorrelation is averaged over the walkers, each about its own mean (Goodman & Weare 2010), and summed up to
    the first lag M ≥ 5 τ(M) (Sokal 1989). Walkers that stay at one mode each go unnoticed: their means are subtracted.
    `emcee.autocorr.integrated_time` gives the same numbers, walker by walker with complex transforms: with it the
    paper's posteriors take 1.4 times as long.

    Args:
        chain: (steps, walkers, parameters).

    Returns:
        The times (parameters,) in steps; NaN for a parameter that some walker never changed.
    """
    steps = len(chain)
    length = scipy.fft.next_fast_len(2 * steps, real=True)
    series = (chain - chain.mean(axis=0)).T
    weight = 1.0 / (series**2).sum(axis=2)
    spectrum = scipy.fft.rfft(series, length)
    power = np.einsum("pwf,pw->pf", spectrum.real**2 + spectrum.imag**2, weight)
    correlation = scipy.fft.irfft(power, length)[:, :steps] / weight.shape[1]
    sums = 2.0 * np.cumsum(correlation, axis=1) - 1.0
    times = [up_to[emcee.autocorr.auto_window(up_to, 5)] for up_to in sums]
    return np.where((chain == chain[0]).all(axis=0).any(axis=0), np.nan, times)


class Reference(NamedTuple):
    """A point set relative to a reference sphere.

    Attributes:
        away: points less the reference centre (d, n).
        distance: their lengths (n,).
        excess: distances less the reference radius (n,).
        radius: the reference radius.
    """

    away: Floats
    distance: Floats
    excess: Floats
    radius: float

    @classmethod
    def of(cls, points: Floats, center: Floats, radius: float) -> "Reference":
        """Express points (d, n) relative to a centre (d,) and a radius."""
        away = np.ascontiguousarray(points - center[:, None])
        distance = np.sqrt(np.einsum("dn,dn->n", away, away))
        return cls(away, distance, distance - radius, float(radius))


def geometric(reference: Reference, offsets: Floats, log_noise: Floats) -> Floats:
    """Geometric log-likelihood: -N log σ - Σ(Rᵢ - r)²/2σ².

    Args:
        reference: the points.
        offsets: centre less the reference's, and radius less the reference's (k, d+1).
        log_noise: log σ (k,).

    Returns:
        The log-likelihood of each sphere (k,), up to the same constant.
    """
    squares = np.empty(len(offsets))
    _square_sums(reference, offsets, squares)
    return np.asarray(-0.5 * squares * np.exp(-2.0 * log_noise) - len(reference.distance) * log_noise)


def whole_sphere(reference: Reference, offsets: Floats, log_noise: Floats) -> Floats:
    """Log-likelihood of points that are spread evenly over the whole sphere; arguments as for `geometric`."""
    d, n = reference.away.shape
    residuals = np.empty((len(offsets), n))
    _residuals(reference, offsets, residuals)
    radius = reference.radius + offsets[:, d:]
    precision = np.exp(-2.0 * log_noise)[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):  # spheres without a radius, which the prior rules out
        k = (residuals + radius) * radius * precision
        logs = -0.5 * residuals**2 * precision + _log_spread(k, d)
        return np.asarray(logs.sum(axis=1) - d * n * log_noise)


def _log_spread(k: Floats, dimension: int) -> Floats:
    """Log of e^-k I_ν(k) Γ(ν+1) (2/k)^ν, ν = d/2 - 1; 0 at k = 0."""
    k = np.maximum(k, 1e-20)
    if dimension == 3:
        return np.asarray(np.log(-np.expm1(-2.0 * k) / (2.0 * k)))
    order = 0.5 * dimension - 1.0
    bessel = np.log(scipy.special.ive(order, np.minimum(k, 1e8)))
    large = -0.5 * np.log(2.0 * math.pi * k) + np.log1p((0.125 - 0.5 * order**2) / k)
    return np.asarray(np.where(k > 1e8, large, bessel) + math.lgamma(order + 1.0) + order * np.log(2.0 / k))


@compiled
def _square_sums(reference: Reference, offsets: Floats, squares: Floats) -> None:
    """Σ(Rᵢ - r)² for each offset."""
    k, n = len(offsets), reference.distance.size
    residuals = np.empty((1, n))
    for j in range(k):
        _residuals(reference, offsets[j : j + 1], residuals)
        square, row = 0.0, residuals[0]
        for i in range(n):
            square += row[i] * row[i]
        squares[j] = square


def distances(reference: Reference, away: Floats) -> tuple[Floats, Floats]:
    """Mean distances R̄ of the points from centres, and Σ(Rᵢ - R̄)².

    Args:
        reference: the points.
        away: centres less the reference's (k, d).

    Returns:
        Both for each centre (k,).
    """
    offsets = np.column_stack([away, np.zeros(len(away))])
    mean, squares = np.empty((2, len(away)))
    _moments(reference, offsets, mean, squares)
    return mean + reference.radius, squares


@compiled
def _moments(reference: Reference, offsets: Floats, mean: Floats, squares: Floats) -> None:
    """Mean of Rᵢ - r, and the sum of squares about it, for each offset."""
    k, n = len(offsets), reference.distance.size
    residuals = np.empty((1, n))
    for j in range(k):
        _residuals(reference, offsets[j : j + 1], residuals)
        total, square, row = 0.0, 0.0, residuals[0]
        for i in range(n):
            total += row[i]
        for i in range(n):
            square += squared(row[i] - total / n)
        mean[j], squares[j] = total / n, square


@compiled
def _residuals(reference: Reference, offsets: Floats, residuals: Floats) -> None:
    """Rᵢ - r of each offset (k, n), from |y - δ| - |y| = (|δ|² - 2 y·δ) / (|y - δ| + |y|)."""
    away, distance, excess, _ = reference
    d, n = away.shape
    for j in range(len(offsets)):
        row = residuals[j]
        square = 0.0
        for i in range(d):
            square += squared(offsets[j, i])
        for m in range(n):
            row[m] = square
        for i in range(d):
            y, twice = away[i], 2.0 * offsets[j, i]
            for m in range(n):
                row[m] -= twice * y[m]
        rise = offsets[j, d]
        for m in range(n):
            reach = distance[m] * distance[m] + row[m]
            row[m] = excess[m] + row[m] / (math.sqrt(max(reach, 0.0)) + distance[m] + 1e-300) - rise


LIKELIHOODS = {"geometric": geometric, "whole_sphere": whole_sphere}
NOISE_RANGE = 1e3
"""Factor by which an unknown σ may differ from the middle of its prior."""


@dataclass(frozen=True)
class Prior:
    """The range of the parameters.

    Attributes:
        center: middle of the box (d,).
        width: half-width of the box, in the unit of the points.
        radius: largest radius; the smallest is 0.
        noise: σ if it is known; else the middle of the range of log σ, three decades either way.
        known: true if σ is known.
    """

    center: Floats
    width: float
    radius: float
    noise: float
    known: bool


def log_posterior(
    prior: Prior, name: str, reference: Reference, origin: Floats, spread: Floats, walkers: Floats
) -> Floats:
    """Log-posteriors of walkers, which are offsets from a start scaled by a matrix.

    Args:
        prior: the range of the parameters.
        name: name of the likelihood, in `LIKELIHOODS`.
        reference: the points, prepared about the start.
        origin: parameters of the start: centre, radius, and log σ if σ is unknown (p,).
        spread: matrix from walkers to offsets (p, p).
        walkers: (k, p).

    Returns:
        The log-posterior of each (k,), up to a constant; -∞ outside the prior's range.
    """
    offsets, d = walkers @ spread.T, len(prior.center)
    center, radius = origin[:d] + offsets[:, :d], origin[d] + offsets[:, d]
    allowed = (np.abs(center - prior.center) < prior.width).all(axis=1) & (radius > 0.0) & (radius < prior.radius)
    if prior.known:
        log_noise = np.full(len(offsets), math.log(prior.noise))
    else:
        log_noise = origin[d + 1] + offsets[:, d + 1]  # 1/σ is flat in log σ
        allowed &= np.abs(log_noise - math.log(prior.noise)) < math.log(NOISE_RANGE)
    value = np.full(len(offsets), -np.inf)
    value[allowed] = LIKELIHOODS[name](reference, offsets[allowed, : d + 1], log_noise[allowed])
    return value


_LEAST = 1e-12
"""Least √S in units of the points' extent: far away rounding makes S zero, and √S is divided by."""
_TINY = 1e-300
"""Guard against division by zero."""
_FARTHEST = 100.0
"""Length |w| above which the distance is cut off: far outside any box, and still finite."""


@dataclass(frozen=True)
class RayCoordinates:
    """The map between walkers and coordinates along rays from the points' centroid.

    A walker is an offset from the best sphere's parameters, scaled by a matrix.

    Attributes:
        points: (d, n).
        origin: parameters of the best sphere: centre, radius, and log σ if σ is unknown (p,).
        spread: matrix from walkers to offsets from the origin (p, p).
    """

    points: Floats
    origin: Floats
    spread: Floats

    @property
    def centroid(self) -> Floats:
        """The points' centroid (d,)."""
        return np.asarray(self.points.mean(axis=1))

    @property
    def extent(self) -> float:
        """The points' root mean square distance from the centroid."""
        return math.sqrt(self.points.var(axis=1).sum())

    def coordinates(self, walkers: Floats) -> tuple[Floats, Floats]:
        """Coordinates of walkers (k, p), and log-volumes of parameters per volume of coordinates (k,)."""
        d = len(self.points)
        result = self.origin + walkers @ self.spread.T
        mean, root = self.distances(result[:, :d])
        away = result[:, :d] - self.centroid
        distance = np.linalg.norm(away, axis=1)
        length = np.log1p(distance / (0.5 * self.extent))
        result[:, :d] = away * (length / np.maximum(distance, _TINY))[:, None]
        result[:, d] = (result[:, d] - mean) / root
        if len(self.origin) > d + 1:
            result[:, d + 1] -= np.log(root)
        return result, self._volume(distance, length, root)

    def walkers(self, coordinates: Floats) -> tuple[Floats, Floats]:
        """Walkers at coordinates (k, p), and log-volumes of parameters per volume of coordinates (k,)."""
        d = len(self.points)
        result = coordinates.copy()
        length = np.linalg.norm(result[:, :d], axis=1)
        distance = 0.5 * self.extent * np.expm1(np.minimum(length, _FARTHEST))
        result[:, :d] = self.centroid + result[:, :d] * (distance / np.maximum(length, _TINY))[:, None]
        mean, root = self.distances(result[:, :d])
        result[:, d] = mean + result[:, d] * root
        if len(self.origin) > d + 1:
            result[:, d + 1] += np.log(root)
        return self.walkers_at(result), self._volume(distance, length, root)

    def walkers_at(self, parameters: Floats) -> Floats:
        """Walkers at parameters (k, p)."""
        return np.asarray(np.linalg.solve(self.spread, (parameters - self.origin).T).T)

    def centers(self, places: Floats) -> tuple[Floats, Floats]:
        """Centres at the first coordinates (k, d), and log-volumes of centres per volume of coordinates (k,)."""
        length = np.linalg.norm(places, axis=1)
        distance = 0.5 * self.extent * np.expm1(np.minimum(length, _FARTHEST))
        center = self.centroid + places * (distance / np.maximum(length, _TINY))[:, None]
        return center, self._volume(distance, length, np.ones(len(center)))

    def distances(self, center: Floats) -> tuple[Floats, Floats]:
        """Mean R̄ of the points' distances from centres (k, d), and √S; 1 in place of √S if σ is known."""
        distance = np.sqrt(((center[:, :, None] - self.points) ** 2).sum(axis=1))
        mean = distance.mean(axis=1)
        if len(self.origin) == len(self.points) + 1:
            return mean, np.ones(len(mean))
        root = np.sqrt(((distance - mean[:, None]) ** 2).sum(axis=1))
        return mean, np.maximum(root, _LEAST * self.extent)

    def _volume(self, distance: Floats, length: Floats, root: Floats) -> Floats:
        """Log of dc/dw times √S."""
        d, near = len(self.points), 0.5 * self.extent
        stretch = np.where(length > 1e-9, distance / np.maximum(length, _TINY), near)
        return np.asarray(np.log(distance + near) + (d - 1) * np.log(stretch) + np.log(root))


_FREEDOM = 5.0
"""Degrees of freedom of the proposals: their tails are heavier than the posterior's, so that no walker is stuck."""


class FittedMove(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """Propose places independent of the walker's own, from Student's distribution fitted to the resting walkers."""

    def get_proposal(self, s: Floats, c: list[Floats], random: OldStream) -> tuple[Floats, Floats]:
        """Places for walkers ``s`` (k, p) given the resting walkers ``c``, and log-ratios of proposal densities."""
        return _drawn(s, np.concatenate(c, axis=0), random)


def _drawn(s: Floats, others: Floats, random: OldStream) -> tuple[Floats, Floats]:
    """Student's draws (k, p) with others' mean and covariance, and the log-density at ``s`` less that at the draws."""
    mean = others.mean(axis=0)
    away = others - mean
    root = np.linalg.cholesky(away.T @ away * (1.0 / (len(others) - 1)))  # as np.cov has it, in a third of its time
    stretch = np.sqrt(_FREEDOM / random.chisquare(_FREEDOM, len(s)))
    unit = random.standard_normal(s.shape) * stretch[:, None]
    back = np.linalg.solve(root, (s - mean).T).T
    here, there = (-0.5 * (_FREEDOM + s.shape[1]) * np.log1p((u**2).sum(axis=1) / _FREEDOM) for u in (back, unit))
    return mean + unit @ root.T, here - there


_FITTED = 0.9
"""Share of independent proposals; the other moves are differential evolution."""
_FIRST_LENGTH = 100
"""Steps before the chain's length is checked first."""
_WARM_UP = 0.2
"""Share of the chain that is dropped at its beginning."""
_LENGTH = 50.0
"""Least length of the rest, in units of τ."""
_STABLE = 0.01
"""Largest relative change of τ between two checks."""
_MIXED = 0.1
"""Largest share of a variance that may lie between the walkers' own means."""
_RIM = 0.9
"""Draws beyond this share of the box's half-width are at its rim."""
_AT_RIM = 0.01
"""Largest share of draws at the rim for which the box does not decide the result."""


@dataclass(frozen=True)
class Chain:
    """The result of a chain.

    Attributes:
        status: how it ended.
        draws: draws of (c, r), and of σ if it is unknown (steps, walkers, parameters); empty if it could not start.
        tau: largest of the parameters' autocorrelation times, in steps.
        acceptance: share of proposals accepted.
        steps: all steps taken, the warm-up included.
        rhat: R̂ of the chain and of draws of the centre's marginal density (`marginal.py`).
        difference: largest difference of a mean, sd or quantile from that of these draws, in sd.
        checked: effective sample size of these draws.
    """

    status: ChainStatus
    draws: Floats = field(repr=False)
    tau: float = math.nan
    acceptance: float = math.nan
    steps: int = 0
    rhat: float = math.nan
    difference: float = math.nan
    checked: float = math.nan

    @property
    def flat(self) -> Floats:
        """The draws of all walkers (draws, parameters)."""
        return self.draws.reshape(-1, self.draws.shape[2])


def likelihood_rank(name: str, points: Floats, sphere: Floats, draws: Floats, noise: Floats) -> float:
    """Share of draws with a lower likelihood than the truth (Modrák et al. 2023); NaN without draws.

    Ranks of the parameters alone do not see a posterior that takes no account of the data: that of the likelihood does.

    Args:
        name: of the likelihood, in `LIKELIHOODS`.
        points: the data (d, n).
        sphere: true centre and radius (d+1,).
        draws: of centre and radius, less the truth (k, d+1).
        noise: σ of each draw, and of the truth at the end (k+1,).
    """
    if not len(draws):
        return math.nan
    reference = Reference.of(points, sphere[:-1], sphere[-1])
    offsets = np.vstack([draws, np.zeros(draws.shape[1])])
    *drawn, truth = LIKELIHOODS[name](reference, offsets, np.log(noise))
    return float(np.mean(np.array(drawn) < truth))


class _Sampler(emcee.EnsembleSampler):  # type: ignore[misc]
    """emcee's sampler, for a log-posterior of all walkers at once that never returns NaN."""

    # the generator has its state: to copy it with every step, as emcee does, takes a twelfth of a chain's time
    random_state = emcee.EnsembleSampler.random_state.getter(lambda _: None)

    def compute_log_prob(self, coords: Floats) -> tuple[Floats, None]:
        """Log-posteriors of walkers (k, p), without emcee's search of each walker's answer for further data."""
        return self.log_prob_fn(coords), None


class Start(NamedTuple):
    """The start of a chain: the best sphere, and walkers elsewhere if its ellipsoid is not like the posterior.

    Attributes:
        origin: parameters of the best sphere: centre, radius, and log σ if σ is unknown (p,).
        spread: matrix from walkers to offsets from the origin (p, p).
        walkers: where they start; from a unit normal distribution if None (walkers, p).
        move: a move to anywhere, in place of proposals fitted to the walkers.
        least: least effective size of the chain.
    """

    origin: Floats
    spread: Floats
    walkers: Floats | None = None
    move: emcee.moves.Move | None = None
    least: float = 0.0


def sample(
    samples: Samples,
    prior: Prior,
    name: str,
    random: OldStream,
    walkers: int,
    max_steps: int,
    start: Start | None = None,
) -> Chain:
    """Run a chain.

    Args:
        samples: one point set (1, d, n); its noise is not used.
        prior: the range of the parameters.
        name: name of the likelihood, in `LIKELIHOODS`.
        random: source of random numbers.
        walkers: number of walkers.
        max_steps: number of steps after which a chain that is not long enough is reported as not converged.
        start: as `best_start` returns it; it is computed if None.

    Returns:
        The chain; it never raises on data.
    """
    start = best_start(samples, prior) if start is None else start
    if start is None:
        return Chain(ChainStatus.NO_START, np.empty((0, walkers, samples.x.shape[1] + 2 - prior.known)))
    origin, spread, given, move, least = start
    parameters = len(spread)
    reference = Reference.of(samples.x[0], origin[: parameters - 2 + prior.known], origin[-2 + prior.known])
    density = partial(log_posterior, prior, name, reference, origin, spread)
    first = _inside(random.standard_normal((walkers, parameters)) if given is None else given, density)
    moves = [(FittedMove() if move is None else move, _FITTED), (emcee.moves.DEMove(), 1.0 - _FITTED)]
    sampler = _Sampler(walkers, parameters, density, moves=moves)
    state = emcee.State(first, random_state=random.get_state())
    status, tau = _until_long_enough(sampler, state, max_steps, max(_LENGTH, least / walkers))
    taken = sampler.get_chain().shape[0]
    draws = origin + sampler.get_chain(discard=int(_WARM_UP * taken)) @ spread.T
    if not prior.known:
        draws[..., -1] = np.exp(draws[..., -1])
    if status is ChainStatus.OK:
        d = len(prior.center)
        rim = np.abs(draws[..., :d] - prior.center).max(axis=-1) > _RIM * prior.width
        status = ChainStatus.AT_PRIOR if rim.mean() > _AT_RIM else status
    return Chain(status, draws, tau, float(np.mean(sampler.acceptance_fraction)), taken)


def _until_long_enough(
    sampler: emcee.EnsembleSampler, state: emcee.State | None, max_steps: int, length: float
) -> tuple[ChainStatus, float]:
    """Run until the chain is so many τ long, τ is stable, and the walkers are mixed; returns status and last τ."""
    target, before, taken = min(_FIRST_LENGTH, max_steps), math.inf, 0
    while True:
        state = sampler.run_mcmc(state, target - taken, skip_initial_state_check=True)
        taken = target
        chain = sampler.get_chain(discard=int(_WARM_UP * taken))
        with np.errstate(all="ignore"):  # walkers that never moved have no autocorrelation
            tau = float(np.max(autocorrelation_times(chain)))
        needed = length * tau
        enough = len(chain) >= needed
        if enough and abs(before - tau) < _STABLE * tau and _mixed(chain):
            return ChainStatus.OK, tau
        if taken >= max_steps:
            return ChainStatus.NOT_MIXED if enough and not _mixed(chain) else ChainStatus.NOT_CONVERGED, tau
        before = tau
        ahead = math.ceil(needed / (1.0 - _WARM_UP)) if math.isfinite(needed) else 0
        target = min(max(ahead, math.ceil(1.1 * taken)), 4 * taken, max_steps)


def _mixed(chain: Floats) -> bool:
    """True if little of the variance of a chain (steps, walkers, parameters) lies between its walkers' means.

    For independent walkers with chains of 50 τ, a 50th of the variance does. That share follows χ²; even for 8 walkers
    it exceeds a tenth in only 1 of 10⁵ chains.
    """
    between, total = chain.mean(axis=0).var(axis=0), chain.var(axis=(0, 1))
    return bool((between <= _MIXED * total).all())


def best_start(samples: Samples, prior: Prior) -> Start | None:
    """The best sphere and its ellipsoid; None if there is no usable fit.

    The best sphere is the MLE's, or GDKE's if the MLE diverged or has no covariance.
    """
    given = Samples(samples.x, prior.noise if prior.known else None)
    d, n = samples.x.shape[1:]
    for name in ("mle", "gdke"):
        fit = fit_samples(given, name)
        center, radius, covariance = fit.center[0], fit.radius[0], fit.covariance[0]
        noise = prior.noise if prior.known else math.sqrt(max(fit.estimates.noise_variance[0], 0.0))
        usable = fit.estimates.status[0] == Status.OK and np.isfinite(covariance).all()
        usable &= prior.noise / NOISE_RANGE < noise < prior.noise * NOISE_RANGE
        if not usable or np.abs(center - prior.center).max() >= prior.width or radius >= prior.radius:
            continue
        try:
            spread = np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            continue
        if prior.known:
            return Start(np.append(center, radius), spread)
        whole = np.zeros((d + 2, d + 2))
        whole[: d + 1, : d + 1], whole[d + 1, d + 1] = spread, 1.0 / math.sqrt(2.0 * n)
        return Start(np.concatenate([center, [radius, math.log(noise)]]), whole)
    return None


def _inside(walkers: Floats, log_density: Callable[[Floats], Floats]) -> Floats:
    """Halve the offsets of walkers outside the prior's range until they are inside, as the start is."""
    for _ in range(60):
        outside = np.isneginf(log_density(walkers))
        if not outside.any():
            break
        walkers[outside] *= 0.5
    return walkers
