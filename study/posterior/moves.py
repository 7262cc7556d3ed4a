"""Moves of the ensemble sampler: independent proposals from a fitted distribution, and jumps across the points."""

import emcee
import numpy as np

from study.experiment.streams import OldStream
from study.posterior.ray_coordinates import RayCoordinates
from study.sphere.types import Floats

_FREEDOM = 5.0
"""Degrees of freedom of the proposals: their tails are heavier than the posterior's, so that no walker is stuck."""


class FittedMove(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """Propose places independent of the walker's own, from Student's distribution fitted to the resting walkers.

    Args:
        rays: coordinates in which to fit and to propose; the walkers' own if None.
    """

    def __init__(self, rays: RayCoordinates | None = None) -> None:
        super().__init__()
        self.rays = rays

    def get_proposal(self, s: Floats, c: list[Floats], random: OldStream) -> tuple[Floats, Floats]:
        """Places for walkers ``s`` (k, p) given the resting walkers ``c``, and log-ratios of proposal densities."""
        others = np.concatenate(c, axis=0)
        if self.rays is None:
            return _drawn(s, others, random)
        here, volume = self.rays.coordinates(s)
        places, balance = _drawn(here, self.rays.coordinates(others)[0], random)
        walkers, after = self.rays.walkers(places)
        return walkers, balance + after - volume


class MirrorMove(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """Propose the sphere at the same distance on the other side of the points, for a mode with few walkers."""

    def __init__(self, rays: RayCoordinates) -> None:
        super().__init__()
        self.rays = rays

    def get_proposal(self, s: Floats, c: list[Floats], random: OldStream) -> tuple[Floats, Floats]:
        """Mirrored places of walkers ``s`` (k, p), and log-ratios of volumes."""
        here, volume = self.rays.coordinates(s)
        here[:, : len(self.rays.points)] *= -1.0
        walkers, after = self.rays.walkers(here)
        return walkers, after - volume


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
