"""One ensemble posterior of a sphere by emcee, from the MLE's ellipsoid until the chain is long enough.

Most moves propose independent places from Student's distribution with the mean and covariance of the other half of the
walkers. The posteriors here are so nearly normal that the integrated autocorrelation time τ (Goodman & Weare 2010, as
emcee computes it) is then about 3 steps; with the stretch move it is about 50. One move in ten is differential
evolution (ter Braak 2006), which also works for posteriors that are not normal. If there may be modes apart from the
best sphere, half of the walkers start there, places are proposed in coordinates in which the modes are neighbours
(`ray_coordinates`), and one move in five is to the other side of the points.

A chain is long enough when what remains after its first fifth is 50 τ long, and τ is stable to 1 %. As τ does not
notice walkers that stay at one mode each (`autocorrelation`), they must be mixed as well, by the variance between their
means; otherwise the chain's status says so.
"""

import math
from dataclasses import dataclass, field

import emcee
import numpy as np

from study.estimators import Samples, Status
from study.estimators.registry import fit_samples
from study.experiment.posterior_config import ChainStatus
from study.experiment.streams import OldStream
from study.posterior.autocorrelation import autocorrelation_times
from study.posterior.density import NOISE_RANGE, LogPosterior, Prior
from study.posterior.moves import FittedMove, MirrorMove
from study.posterior.other_modes import other_modes_possible, spread_out
from study.posterior.ray_coordinates import RayCoordinates
from study.sphere import likelihood
from study.sphere.types import Floats

_FITTED = 0.9
"""Share of independent proposals; the other moves are differential evolution."""
_MIRRORED = 0.2
"""Share of moves across the points, taken from the independent proposals, if other modes are possible."""
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


class _Sampler(emcee.EnsembleSampler):  # type: ignore[misc]
    """emcee's sampler, for a log-posterior of all walkers at once that never returns NaN."""

    def compute_log_prob(self, coords: Floats) -> tuple[Floats, None]:
        """Log-posteriors of walkers (k, p), without emcee's search of each walker's answer for further data."""
        return self.log_prob_fn(coords), None


def sample(samples: Samples, prior: Prior, name: str, random: OldStream, walkers: int, max_steps: int) -> Chain:
    """Run a chain.

    Args:
        samples: one point set (1, d, n); its noise is not used.
        prior: the range of the parameters.
        name: name of the likelihood, in `LIKELIHOODS`.
        random: source of random numbers.
        walkers: number of walkers.
        max_steps: number of steps after which a chain that is not long enough is reported as not converged.

    Returns:
        The chain; it never raises on data.
    """
    start = _start(samples, prior)
    if start is None:
        return Chain(ChainStatus.NO_START, np.empty((0, walkers, samples.x.shape[1] + 2 - prior.known)))
    origin, spread = start
    parameters = len(spread)
    reference = likelihood.Reference.of(samples.x[0], origin[: parameters - 2 + prior.known], origin[-2 + prior.known])
    log_posterior = LogPosterior(prior, name, reference, origin, spread)
    first = random.standard_normal((walkers, parameters))
    moves = [(FittedMove(), _FITTED), (emcee.moves.DEMove(), 1.0 - _FITTED)]
    rays = RayCoordinates(samples.x[0], origin, spread)
    if other_modes_possible(rays, prior.width, log_posterior):
        first = spread_out(rays, first, prior.width, random)
        moves = [(FittedMove(rays), _FITTED - _MIRRORED), (MirrorMove(rays), _MIRRORED), moves[1]]
    first = _inside(first, log_posterior)
    sampler = _Sampler(walkers, parameters, log_posterior, moves=moves)
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
    """Run until the chain is 50 τ long, τ is stable, and the walkers are mixed; returns the status and the last τ."""
    target, before, taken = min(_FIRST_LENGTH, max_steps), math.inf, 0
    while True:
        state = sampler.run_mcmc(state, target - taken, skip_initial_state_check=True)
        taken = target
        chain = sampler.get_chain(discard=int(_WARM_UP * taken))
        with np.errstate(all="ignore"):  # walkers that never moved have no autocorrelation
            tau = float(np.max(autocorrelation_times(chain)))
        needed = _LENGTH * tau
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


def _start(samples: Samples, prior: Prior) -> tuple[Floats, Floats] | None:
    """Parameters of the best sphere, and a matrix from unit walkers to offsets; None if there is no usable fit.

    The best sphere is the MLE's, or GDKE's if the MLE diverged or has no covariance.
    """
    given = Samples(samples.x, prior.noise if prior.known else None)
    d, n = samples.x.shape[1:]
    for name in ("mle", "gdke"):
        fit = fit_samples(given, name)
        center, radius, covariance = fit.center[0], fit.radius[0], fit.covariance[0]
        noise = prior.noise if prior.known else math.sqrt(max(fit.noise_variance[0], 0.0))
        usable = fit.own_status[0] == Status.OK and np.isfinite(covariance).all()
        usable &= prior.noise / NOISE_RANGE < noise < prior.noise * NOISE_RANGE
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


def _inside(walkers: Floats, log_posterior: LogPosterior) -> Floats:
    """Halve the offsets of walkers outside the prior's range until they are inside, as the start is."""
    for _ in range(60):
        outside = np.isneginf(log_posterior(walkers))
        if not outside.any():
            break
        walkers[outside] *= 0.5
    return walkers
