"""One ensemble posterior of a sphere by emcee, from the MLE's ellipsoid until the chain is long enough.

Most moves propose independent places from Student's distribution with the mean and covariance of the other half of the
walkers. The posteriors here are so nearly normal that the integrated autocorrelation time τ is then about 3 steps; with
the stretch move it is about 50. One move in ten is differential evolution (ter Braak 2006), which also works for
posteriors that are not normal. Before the chain, independent draws are taken from the same posterior
(`study.simulation.posterior.proposals`). If they find mass apart from the best sphere, the walkers start at such draws,
and half of the moves are to such places.

A chain is long enough when what remains after its first fifth is 50 τ long, and τ is stable to 1 %. As τ does not
notice walkers that stay at one mode each, they must be mixed as well, by the variance between their means. Nor does it
notice a mode that no walker found: standard deviations and quantiles must be those of the independent draws. Otherwise
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
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import emcee
import numpy as np
import scipy.fft

from study.arrays import Floats
from study.fits import Samples, Status
from study.fits.jit import compiled
from study.fits.random import OldStream, stream
from study.fits.registry import fit_samples
from study.simulation.experiment.config import ChainStatus
from study.simulation.posterior.proposals import Proposals


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


@compiled
def _residuals(reference: Reference, offsets: Floats, residuals: Floats) -> None:
    """Rᵢ - r of each offset (k, n), from |y - δ| - |y| = (|δ|² - 2 y·δ) / (|y - δ| + |y|)."""
    away, distance, excess, _ = reference
    d, n = away.shape
    for j in range(len(offsets)):
        row = residuals[j]
        square = 0.0
        for i in range(d):
            square += offsets[j, i] ** 2
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


_FREEDOM = 5.0
"""Degrees of freedom of the proposals: their tails are heavier than the posterior's, so that no walker is stuck."""


class FittedMove(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """Propose places independent of the walker's own, from Student's distribution fitted to the resting walkers."""

    def get_proposal(self, s: Floats, c: list[Floats], random: OldStream) -> tuple[Floats, Floats]:
        """Places for walkers ``s`` (k, p) given the resting walkers ``c``, and log-ratios of proposal densities."""
        return _drawn(s, np.concatenate(c, axis=0), random)


def scaled(parameters: Floats, origin: Floats, spread: Floats) -> Floats:
    """Walkers at parameters (k, p): offsets from the best sphere's, scaled by a matrix (p, p)."""
    return np.asarray(np.linalg.solve(spread, (parameters - origin).T).T, dtype=np.float64)


class IndependentMove(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """Propose spheres from all places where the posterior may have mass; see `Proposals`.

    Args:
        proposals: of spheres.
        origin: parameters of the best sphere (p,).
        spread: matrix from walkers to offsets from the origin (p, p).
    """

    def __init__(self, proposals: Proposals, origin: Floats, spread: Floats) -> None:
        super().__init__()
        self.proposals, self.origin, self.spread = proposals, origin, spread

    def get_proposal(self, s: Floats, c: list[Floats], random: OldStream) -> tuple[Floats, Floats]:
        """Places for walkers ``s`` (k, p), and log-ratios of proposal densities."""
        drawn = self.proposals.draw(random, len(s))
        here, there = map(self.proposals.log_density, (self.origin + s @ self.spread.T, drawn))
        return scaled(drawn, self.origin, self.spread), here - there


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
_ANYWHERE = 0.5
"""Share of moves to any place of the posterior, taken from the fitted proposals, if there is mass apart."""
_APART = 6.0
"""A centre farther than this from the best sphere, in its standard deviations, is apart from it."""
_LEAST_MASS = 1e-3
"""Least share of the posterior that counts as mass apart."""
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


def shrink_factor(chains: Sequence[Chain]) -> float:
    """R̂ of independent ensembles: √(1 + variance of their means / mean of their variances), largest of the parameters.

    It is 1 if they agree; NaN if one has no draws. Walkers of one ensemble are not independent of each other, so they
    do not count as chains (Gelman & Rubin 1992).
    """
    if not all(len(chain.draws) for chain in chains):
        return math.nan
    means = np.array([chain.flat.mean(axis=0) for chain in chains])
    within = np.mean([chain.flat.var(axis=0) for chain in chains], axis=0)
    return float(np.sqrt(1.0 + means.var(axis=0, ddof=1) / within).max())


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
    reference = Reference.of(samples.x[0], origin[: parameters - 2 + prior.known], origin[-2 + prior.known])
    density = partial(log_posterior, prior, name, reference, origin, spread)
    first = random.standard_normal((walkers, parameters))
    moves = [(FittedMove(), _FITTED), (emcee.moves.DEMove(), 1.0 - _FITTED)]
    d = len(prior.center)
    noise = prior.noise if prior.known else None
    proposals = Proposals.of(samples.x[0], origin, spread[:d] @ spread[:d].T, noise, prior.width)
    # a stream of its own, so that the chain's numbers do not depend on how many draws are taken here
    own = stream(int(random.get_state(legacy=False)["state"]["key"][-1]), "posterior", "draws")
    with np.errstate(all="ignore"):  # the density is zero where no sphere exists
        drawn = proposals.search(lambda places: density(scaled(places, origin, spread)), own)
        apart = drawn.weights[proposals.apart(drawn.parameters, _APART)].sum() > _LEAST_MASS
    if apart:
        first = scaled(drawn.resampled(random, walkers), origin, spread)
        everywhere = IndependentMove(proposals, origin, spread)
        moves = [(FittedMove(), _FITTED - _ANYWHERE), (everywhere, _ANYWHERE), moves[1]]
    first = _inside(first, density)
    sampler = _Sampler(walkers, parameters, density, moves=moves)
    state = emcee.State(first, random_state=random.get_state())
    status, tau = _until_long_enough(
        sampler, state, max_steps, lambda chain: drawn.agree(origin + chain.reshape(-1, parameters) @ spread.T)
    )
    taken = sampler.get_chain().shape[0]
    draws = origin + sampler.get_chain(discard=int(_WARM_UP * taken)) @ spread.T
    if not prior.known:
        draws[..., -1] = np.exp(draws[..., -1])
    if status is ChainStatus.OK:
        rim = np.abs(draws[..., :d] - prior.center).max(axis=-1) > _RIM * prior.width
        status = ChainStatus.AT_PRIOR if rim.mean() > _AT_RIM else status
    return Chain(status, draws, tau, float(np.mean(sampler.acceptance_fraction)), taken)


def _until_long_enough(
    sampler: emcee.EnsembleSampler, state: emcee.State | None, max_steps: int, agrees: Callable[[Floats], bool]
) -> tuple[ChainStatus, float]:
    """Run until the chain is 50 τ long, τ is stable, the walkers are mixed, and agree with independent draws.

    Returns:
        The status, and the last τ.
    """
    target, before, taken = min(_FIRST_LENGTH, max_steps), math.inf, 0
    while True:
        state = sampler.run_mcmc(state, target - taken, skip_initial_state_check=True)
        taken = target
        chain = sampler.get_chain(discard=int(_WARM_UP * taken))
        with np.errstate(all="ignore"):  # walkers that never moved have no autocorrelation
            tau = float(np.max(autocorrelation_times(chain)))
        needed = _LENGTH * tau
        enough = len(chain) >= needed
        mixed = enough and _mixed(chain) and agrees(chain)
        if mixed and abs(before - tau) < _STABLE * tau:
            return ChainStatus.OK, tau
        if taken >= max_steps:
            return ChainStatus.NOT_MIXED if enough and not mixed else ChainStatus.NOT_CONVERGED, tau
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
            return np.append(center, radius), spread
        whole = np.zeros((d + 2, d + 2))
        whole[: d + 1, : d + 1], whole[d + 1, d + 1] = spread, 1.0 / math.sqrt(2.0 * n)
        return np.concatenate([center, [radius, math.log(noise)]]), whole
    return None


def _inside(walkers: Floats, log_density: Callable[[Floats], Floats]) -> Floats:
    """Halve the offsets of walkers outside the prior's range until they are inside, as the start is."""
    for _ in range(60):
        outside = np.isneginf(log_density(walkers))
        if not outside.any():
            break
        walkers[outside] *= 0.5
    return walkers
