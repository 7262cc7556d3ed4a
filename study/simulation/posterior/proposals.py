"""Spheres proposed independently of each other, from all places where a posterior may have mass.

Given the centre, the geometric posterior of radius and noise is known in closed form. With R̄ the mean of the n
distances and S the sum of squares about it, r is normal about R̄ with variance σ²/n, and S/σ² is χ² with n - 1 degrees
of freedom if σ is unknown. So a law of the centre c is all that is chosen. It is a mixture:

- Student's distribution about the best sphere, with its covariance;
- centres on rays from the points' centroid x̄, log-uniform in their distance, up to the end of the prior's box. The rays
  have angular central Gaussian laws (Tyler 1987), which are the same on both sides of the points: about the normals of
  the planes that explain the points, for the noise of the best sphere and for the points' own thickness; and all alike.

Points on a flat cap are explained about as well by a sphere on the other side, and by any larger one up to a plane;
a few points are so by small spheres through some of them, too. The rays reach all of these. Proposals, weighted by the
posterior over their density, are independent draws of the posterior (importance sampling): they show modes, are where
walkers start, and are what a chain has to agree with.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.special import gammaln, logsumexp

from study.arrays import Bools, Floats
from study.fits.random import OldStream

_FREEDOM = 3.0
"""Degrees of freedom about the best sphere: tails heavier than those of any posterior near it."""
_SHARES = (0.4, 0.25, 0.15, 0.2)
"""Shares of the mixture's parts before any draw, in the order above."""
_LEAST_SHARE = 0.05
_COUNTS = (4_000, 16_000, 64_000)
"""Draws of each round. The first are enough for a posterior that is nearly normal."""
_ENOUGH, _PRECISE = 1_000.0, 0.03
"""Effective number of draws, and relative error of standard deviations, after which there is no further round."""
_LEVELS = (0.025, 0.16, 0.5, 0.84, 0.975)
_TINY = 1e-300
"""Guard against division by zero, and the logarithm of zero."""


class Weighted(NamedTuple):
    """Weighted draws of a posterior.

    Attributes:
        parameters: centre, radius, and log σ if it is unknown (k, p).
        weights: their sum is 1 (k,).
    """

    parameters: Floats
    weights: Floats

    @property
    def effective(self) -> float:
        """Number of independent draws of equal weight that are worth as much (Kish 1965)."""
        return float(1.0 / max(np.square(self.weights).sum(), _TINY))

    def resampled(self, random: OldStream, count: int) -> Floats:
        """Draws of equal weight (count, p)."""
        return self.parameters[random.choice(len(self.weights), count, p=self.weights)]

    def spreads(self) -> tuple[Floats, Floats]:
        """Standard deviation of each parameter, and its relative standard error (p,)."""
        squares = np.square(self.parameters - self.weights @ self.parameters)
        variance = self.weights @ squares
        return np.sqrt(variance), np.sqrt(self.weights**2 @ np.square(squares - variance)) / (2.0 * variance)

    def agree(self, draws: Floats) -> bool:
        """True if a chain's draws (m, p) have this law: standard deviations to 10 %, quantiles to a tenth of them.

        Three standard errors of these draws are allowed beside that, and none of the chain's.
        """
        spreads, errors = self.spreads()
        if (np.abs(draws.std(axis=0) / spreads - 1.0) > 0.1 + 3.0 * errors).any():
            return False
        for mine, theirs, spread in zip(self.parameters.T, draws.T, spreads, strict=True):
            order = np.argsort(mine)
            below = np.cumsum(self.weights[order])
            for p in _LEVELS:
                reach = 3.0 * math.sqrt(p * (1.0 - p) / self.effective)
                ends = mine[order][np.searchsorted(below, np.clip([p - reach, p + reach], 0.0, below[-1]))]
                if not ends[0] - 0.1 * spread <= np.quantile(theirs, p) <= ends[1] + 0.1 * spread:
                    return False
        return True


@dataclass
class Proposals:
    """The proposals for one set of points.

    Attributes:
        points: (d, n).
        center: of the best sphere (d,).
        root: Cholesky's factor of its covariance (d, d).
        noise: σ if it is known, else None.
        reach: largest distance of a centre from the centroid.
        axes: the points' main axes as columns (d, d), that of the least extent first.
        scales: squared scales of the rays' directions along these axes (3, d).
        shares: of the parts of the mixture (4,).
    """

    points: Floats
    center: Floats
    root: Floats
    noise: float | None
    reach: float
    axes: Floats
    scales: Floats
    shares: Floats

    @classmethod
    def of(cls, points: Floats, best: Floats, covariance: Floats, noise: float | None, width: float) -> Self:
        """Proposals about the best sphere's parameters (p,) and its centre's covariance (d, d), in a box of a width."""
        d, n = points.shape
        away = points - points.mean(axis=1, keepdims=True)
        extents, axes = np.linalg.eigh(away @ away.T / n)
        of_fit = (math.exp(best[d + 1]) if noise is None else noise) ** 2
        # a normal is known to √(s/n) over the extent along an axis, for residuals of variance s from its plane
        scales = [1.0 / (n * np.maximum(extents, 0.0) / max(s, _TINY) + 1.0) for s in (of_fit, max(of_fit, extents[0]))]
        scales = [scale / scale[0] for scale in scales]
        root, reach = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64), 2.0 * math.sqrt(d) * width
        return cls(points, best[:d], root, noise, reach, axes, np.array([*scales, np.ones(d)]), np.array(_SHARES))

    @property
    def near(self) -> float:
        """Distance from the centroid below which distances are not log-uniform: half the points' extent."""
        return 0.5 * math.sqrt(self.points.var(axis=1).sum())

    def draw(self, random: OldStream, count: int) -> Floats:
        """Parameters of so many spheres (count, p)."""
        d, n = self.points.shape
        part, normal = random.choice(4, count, p=self.shares), random.standard_normal((count, d))
        stretch = np.sqrt(_FREEDOM / random.chisquare(_FREEDOM, count))
        center = self.center + (normal * stretch[:, None]) @ self.root.T
        rays = part > 0
        along = (normal[rays] * np.sqrt(self.scales[part[rays] - 1])) @ self.axes.T
        distance = self.near * np.expm1(random.uniform(0.0, math.log1p(self.reach / self.near), count))[rays]
        along *= (distance / np.maximum(np.linalg.norm(along, axis=1), _TINY))[:, None]
        center[rays] = self.points.mean(axis=1) + along
        mean, squares = self._distances(center)
        chi = random.chisquare(n - 1.0, count)
        sigma = np.sqrt(squares / chi) if self.noise is None else np.full(count, self.noise)
        radius = mean + sigma * random.standard_normal(count) / math.sqrt(n)
        return np.column_stack([center, radius, *([np.log(np.maximum(sigma, _TINY))] if self.noise is None else [])])

    def log_density(self, parameters: Floats) -> Floats:
        """Log-density of the proposals at parameters (k, p): (k,)."""
        return np.asarray(logsumexp(self._parts(parameters[:, : len(self.points)]), axis=0) + self._given(parameters))

    def adapt(self, drawn: Weighted) -> None:
        """Give each part of the mixture the share that it has of the posterior."""
        parts = self._parts(drawn.parameters[:, : len(self.points)])
        shares = np.exp(parts - logsumexp(parts, axis=0)) @ drawn.weights
        self.shares = np.maximum(shares, _LEAST_SHARE)
        self.shares /= self.shares.sum()

    def search(self, log_posterior: Callable[[Floats], Floats], random: np.random.Generator) -> Weighted:
        """Draw from the posterior, until the draws are enough or many.

        Args:
            log_posterior: of parameters (k, p).
            random: source of random numbers.

        Returns:
            The draws; weights of zero if the posterior is zero wherever it was looked at.
        """
        for count in _COUNTS:
            parameters = self.draw(random, count)  # type: ignore[arg-type]  # both kinds of generators have these laws
            logs = log_posterior(parameters) - self.log_density(parameters)
            logs[~np.isfinite(logs)] = -np.inf
            if np.isneginf(logs).all():
                return Weighted(parameters, np.zeros(count))
            drawn = Weighted(parameters, np.exp(logs - logsumexp(logs)))
            if drawn.effective >= _ENOUGH and drawn.spreads()[1].max() < _PRECISE:
                break
            self.adapt(drawn)
        return drawn

    def apart(self, parameters: Floats, distance: float) -> Bools:
        """True for centres farther from the best sphere's than so many of its standard deviations (k,)."""
        away = np.linalg.solve(self.root, (parameters[:, : len(self.center)] - self.center).T)
        return np.asarray(np.square(away).sum(axis=0) > distance**2)

    def _parts(self, center: Floats) -> Floats:
        """Log-densities of the mixture's parts at centres (k, d), with their shares (4, k)."""
        d = len(self.points)
        away = np.linalg.solve(self.root, (center - self.center).T)
        about = gammaln(0.5 * (_FREEDOM + d)) - gammaln(0.5 * _FREEDOM) - 0.5 * d * math.log(_FREEDOM * math.pi)
        about -= np.log(np.diag(self.root)).sum()
        along = center - self.points.mean(axis=1)
        distance = np.maximum(np.linalg.norm(along, axis=1), _TINY)
        turned = (along / distance[:, None]) @ self.axes
        length = math.log1p(self.reach / self.near)
        by_distance = -math.log(length) - np.log(distance + self.near) - (d - 1) * np.log(distance)
        by_distance[distance > self.reach] = -np.inf
        sphere = gammaln(0.5 * d) - math.log(2.0) - 0.5 * d * math.log(math.pi)
        parts = [about - 0.5 * (_FREEDOM + d) * np.log1p(np.square(away).sum(axis=0) / _FREEDOM)]
        for scale in self.scales:
            by_direction = sphere - 0.5 * np.log(scale).sum() - 0.5 * d * np.log((turned**2 / scale).sum(axis=1))
            parts.append(by_distance + by_direction)
        return np.asarray(np.array(parts) + np.log(self.shares)[:, None])

    def _given(self, parameters: Floats) -> Floats:
        """Log-density of radius, and of log σ if it is unknown, given the centre (k,)."""
        d, n = self.points.shape
        mean, squares = self._distances(parameters[:, :d])
        log_noise, by_noise = np.full(len(mean), math.log(self.noise or 1.0)), np.zeros(len(mean))
        if self.noise is None:
            log_noise = parameters[:, d + 1]
            half = 0.5 * squares * np.exp(-2.0 * log_noise)
            by_noise = math.log(2.0) - gammaln(0.5 * (n - 1)) + 0.5 * (n - 1) * np.log(np.maximum(half, _TINY)) - half
        score = (parameters[:, d] - mean) * np.exp(-log_noise)
        return np.asarray(by_noise - 0.5 * n * score**2 + 0.5 * math.log(n / (2.0 * math.pi)) - log_noise)

    def _distances(self, center: Floats) -> tuple[Floats, Floats]:
        """Mean R̄ of the points' distances from centres (k, d), and S."""
        distance = np.sqrt(np.square(center[:, :, None] - self.points).sum(axis=1))
        mean = distance.mean(axis=1)
        return mean, np.square(distance - mean[:, None]).sum(axis=1)
