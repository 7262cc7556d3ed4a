"""One ensemble posterior of a sphere: emcee's sampler, from the MLE's ellipsoid, until its chain is long enough.

Prior: flat on the centre in a box and on the radius, 1/σ on a noise that is not known. A box, because a flat prior on
the whole space leaves the posterior of a partial cap improper: along the way to a plane the likelihood tends to a
constant. Where the box decides the answer, the status says so.

Most moves propose places drawn afresh from Student's distribution with the mean and the covariance of the other half of
the walkers: posteriors here are so nearly normal that the integrated autocorrelation time τ (Goodman & Weare 2010, as
emcee computes it) is about 3 steps, where the stretch move's is about 50. One in ten is differential evolution (ter
Braak 2006), which holds its own where they are not. Where there may be mass elsewhere than about the best sphere
(`rays.py`), half of the walkers start there, places are drawn in coordinates in which the humps are neighbours, and one
move in five is to the other side of the points.

A chain is long enough when what is left after its first fifth is 50 τ, and τ is stable to 1 %. As τ is a mean over
walkers, each about its own mean, it is blind to walkers that stay at one hump each: a chain must be mixed as well, by
the variance between their means, or is reported as one that is not.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import emcee
import numpy as np

from study.estimators import ESTIMATORS, Samples, Status
from study.experiment.posterior_config import ChainStatus
from study.experiment.streams import OldStream
from study.posterior.multimodal import Rays
from study.sphere import likelihood
from study.sphere.types import Floats

LIKELIHOODS = {"geometric": likelihood.geometric, "whole_sphere": likelihood.whole_sphere}
_FIRST_LOOK = 100
_AFRESH = 0.9
"""Share of moves to places drawn afresh; the others are differential evolution."""
_ACROSS = 0.2
"""Share of moves across the points, where there are other humps."""
_FREEDOM = 5.0
"""Degrees of freedom of the proposals: tails heavier than the posterior's, so that no walker is stuck in one."""
_LENGTH = 50.0
_STABLE = 0.01
_WARM_UP = 0.2
_MIXED = 0.1
"""Largest share of a variance that may lie between the walkers' own means."""
_NOISE_RANGE = 1e3
_RIM = 0.9
"""Draws beyond this share of the box's half-width are at its rim."""
_AT_RIM = 0.01


class Afresh(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """Propose places that do not depend on where a walker is, from a fit to the walkers that do not move.

    Args:
        rays: coordinates in which to fit and to propose; the walkers' own if None.
    """

    def __init__(self, rays: Rays | None = None) -> None:
        super().__init__()
        self.rays = rays

    def get_proposal(self, s: Floats, c: list[Floats], random: OldStream) -> tuple[Floats, Floats]:
        """Places for walkers ``s`` (k, p), from the others ``c``, and the log-densities that balance the choice."""
        others = np.concatenate(c, axis=0)
        if self.rays is None:
            return _drawn(s, others, random)
        here, volume = self.rays.coordinates(s)
        places, balance = _drawn(here, self.rays.coordinates(others)[0], random)
        walkers, after = self.rays.walkers(places)
        return walkers, balance + after - volume


class Across(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """Propose the sphere on the other side of the points, as far away: for a hump that few walkers are at."""

    def __init__(self, rays: Rays) -> None:
        super().__init__()
        self.rays = rays

    def get_proposal(self, s: Floats, c: list[Floats], random: OldStream) -> tuple[Floats, Floats]:
        """Mirror places of walkers ``s`` (k, p), and the log-densities that balance the choice."""
        here, volume = self.rays.coordinates(s)
        here[:, : len(self.rays.points)] *= -1.0
        walkers, after = self.rays.walkers(here)
        return walkers, after - volume


def _drawn(s: Floats, others: Floats, random: OldStream) -> tuple[Floats, Floats]:
    """Student's draws (k, p) by others' mean and covariance, and the log-density at ``s`` less that at the draws."""
    mean, root = others.mean(axis=0), np.linalg.cholesky(np.cov(others.T))
    stretch = np.sqrt(_FREEDOM / random.chisquare(_FREEDOM, len(s)))
    unit = random.standard_normal(s.shape) * stretch[:, None]
    back = np.linalg.solve(root, (s - mean).T).T
    here, there = (-0.5 * (_FREEDOM + s.shape[1]) * np.log1p((u**2).sum(axis=1) / _FREEDOM) for u in (back, unit))
    return mean + unit @ root.T, here - there


@dataclass(frozen=True)
class Prior:
    """Where the parameters may be.

    Attributes:
        center: middle of the box (d,).
        width: its half-width, in the unit of the points.
        radius: largest radius; the smallest is 0.
        noise: σ if it is known; else the middle of the range of log σ, three decades either way.
        known: whether σ is known.
    """

    center: Floats
    width: float
    radius: float
    noise: float
    known: bool


@dataclass(frozen=True)
class Chain:
    """What a chain found.

    Attributes:
        status: how it ended.
        draws: of (c, r), and σ where it is not known (steps, walkers, parameters); empty if it could not start.
        tau: largest of the parameters' autocorrelation times, in steps.
        acceptance: share of proposals accepted.
        steps: all steps taken, the warm-up included.
    """

    status: ChainStatus
    draws: Floats = field(repr=False)
    tau: float = math.nan
    acceptance: float = math.nan
    steps: int = 0

    @property
    def flat(self) -> Floats:
        """The draws of all walkers (draws, parameters)."""
        return self.draws.reshape(-1, self.draws.shape[2])


def sample(samples: Samples, prior: Prior, name: str, random: OldStream, walkers: int, max_steps: int) -> Chain:
    """Run a chain.

    Args:
        samples: one point set (1, d, n); its noise is not used.
        prior: where the parameters may be, and whether σ is one of them.
        name: of the likelihood, in `LIKELIHOODS`.
        random: where the sampler draws from.
        walkers: of the ensemble.
        max_steps: budget, after which a chain that is not long enough is reported as not converged.

    Returns:
        The chain; it never raises on data.
    """
    start = _start(samples, prior)
    if start is None:
        return Chain(ChainStatus.NO_START, np.empty((0, walkers, samples.x.shape[1] + 2 - prior.known)))
    origin, spread = start
    parameters = len(spread)
    reference = likelihood.Reference.of(samples.x[0], origin[: parameters - 2 + prior.known], origin[-2 + prior.known])

    def log_probability(scaled: Floats) -> Floats:
        return _log_probability(scaled @ spread.T, reference, origin, prior, name)

    first = random.standard_normal((walkers, parameters))
    moves, rays = [(Afresh(), _AFRESH), (emcee.moves.DEMove(), 1.0 - _AFRESH)], Rays(samples.x[0], origin, spread)
    if rays.needed(prior.width, log_probability):
        first = rays.spread_out(first, prior.width, random)
        moves = [(Afresh(rays), _AFRESH - _ACROSS), (Across(rays), _ACROSS), moves[1]]
    first = _inside(first, log_probability)
    sampler = emcee.EnsembleSampler(walkers, parameters, log_probability, moves=moves, vectorize=True)
    state = emcee.State(first, random_state=random.get_state())
    status, tau = _until_long_enough(sampler, state, max_steps)
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
    sampler: emcee.EnsembleSampler, state: emcee.State | None, max_steps: int
) -> tuple[ChainStatus, float]:
    """Run on and look again until the chain is 50 τ long and τ is stable; returns the last τ."""
    target, before, taken = min(_FIRST_LOOK, max_steps), math.inf, 0
    while True:
        state = sampler.run_mcmc(state, target - taken, skip_initial_state_check=True)
        taken = target
        kept = sampler.get_chain(discard=int(_WARM_UP * taken))
        with np.errstate(all="ignore"):  # walkers that never moved have no autocorrelation
            tau = float(np.max(emcee.autocorr.integrated_time(kept, tol=0, quiet=True)))
        needed = _LENGTH * tau
        enough = len(kept) >= needed
        if enough and abs(before - tau) < _STABLE * tau and _mixed(kept):
            return ChainStatus.OK, tau
        if taken >= max_steps:
            return ChainStatus.NOT_MIXED if enough and not _mixed(kept) else ChainStatus.NOT_CONVERGED, tau
        before = tau
        ahead = math.ceil(needed / (1.0 - _WARM_UP)) if math.isfinite(needed) else 0
        target = min(max(ahead, math.ceil(1.1 * taken)), 4 * taken, max_steps)


def _mixed(kept: Floats) -> bool:
    """Whether walkers (steps, walkers, parameters) have all been everywhere.

    Of independent walkers of a chain of 50 τ a 50th of the variance is between their means: a χ² of so many degrees of
    freedom that even for 8 walkers it passes a tenth in 1 of 10⁵ chains only.
    """
    between, all_of_it = kept.mean(axis=0).var(axis=0), kept.var(axis=(0, 1))
    return bool((between <= _MIXED * all_of_it).all())


def _start(samples: Samples, prior: Prior) -> tuple[Floats, Floats] | None:
    """Where the walkers start: the best sphere's parameters, and a matrix that scales them to unit size.

    The best sphere is the MLE's; GDKE's, where that ran away or has no covariance.
    """
    told = Samples(samples.x, prior.noise if prior.known else None)
    d, n = samples.x.shape[1:]
    for name in ("mle", "gdke"):
        fit = ESTIMATORS[name](told).reshape(1, samples=told)
        center, radius, covariance = fit.center[0], fit.radius[0], fit.covariance[0]
        noise = prior.noise if prior.known else math.sqrt(max(fit.noise_variance[0], 0.0))
        usable = fit.status[0] == Status.OK and np.isfinite(covariance).all()
        usable &= prior.noise / _NOISE_RANGE < noise < prior.noise * _NOISE_RANGE
        if not usable or np.abs(center - prior.center).max() >= prior.width or radius >= prior.radius:
            continue
        try:
            spread = np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            continue
        if prior.known:
            return np.append(center, radius), spread
        whole = np.zeros((d + 2, d + 2))
        whole[: d + 1, : d + 1], whole[d + 1, d + 1] = spread, 1.0 / math.sqrt(2.0 * n)
        return np.concatenate([center, [radius, math.log(noise)]]), whole
    return None


def _inside(scaled: Floats, log_probability: Callable[[Floats], Floats]) -> Floats:
    """Pull walkers that start outside the prior towards the best sphere, which is inside, until they are in."""
    for _ in range(60):
        outside = np.isneginf(log_probability(scaled))
        if not outside.any():
            break
        scaled[outside] *= 0.5
    return scaled


def _log_probability(
    offsets: Floats, reference: likelihood.Reference, origin: Floats, prior: Prior, name: str
) -> Floats:
    """Log-posterior of parameters given as offsets from the start (k, parameters)."""
    d = len(prior.center)
    center, radius = origin[:d] + offsets[:, :d], origin[d] + offsets[:, d]
    allowed = (np.abs(center - prior.center) < prior.width).all(axis=1) & (radius > 0.0) & (radius < prior.radius)
    if prior.known:
        log_noise = np.full(len(offsets), math.log(prior.noise))
    else:
        log_noise = origin[d + 1] + offsets[:, d + 1]  # 1/σ is flat in log σ
        allowed &= np.abs(log_noise - math.log(prior.noise)) < math.log(_NOISE_RANGE)
    value = np.full(len(offsets), -np.inf)
    value[allowed] = LIKELIHOODS[name](reference, offsets[allowed, : d + 1], log_noise[allowed])
    return value
