"""The prior of a sphere's parameters, and the log-posterior that the sampler evaluates.

The prior is flat on the centre in a box and on the radius, and 1/σ on an unknown noise. The box is needed, as a flat
prior on the whole space makes the posterior of a partial cap improper: towards a plane the likelihood tends to a
constant.
"""

import math
from dataclasses import dataclass

import numpy as np

from study.sphere import likelihood
from study.sphere.types import Floats

LIKELIHOODS = {"geometric": likelihood.geometric, "whole_sphere": likelihood.whole_sphere}
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


@dataclass(frozen=True)
class LogPosterior:
    """The log-posterior of walkers, which are offsets from a start scaled by a matrix.

    Attributes:
        prior: the range of the parameters.
        name: name of the likelihood, in `LIKELIHOODS`.
        reference: the points, prepared about the start.
        origin: parameters of the start: centre, radius, and log σ if σ is unknown (p,).
        spread: matrix from walkers to offsets (p, p).
    """

    prior: Prior
    name: str
    reference: likelihood.Reference
    origin: Floats
    spread: Floats

    def __call__(self, walkers: Floats) -> Floats:
        """Log-posteriors of walkers (k, p), up to a constant; -∞ outside the prior's range."""
        prior, origin, offsets = self.prior, self.origin, walkers @ self.spread.T
        d = len(prior.center)
        center, radius = origin[:d] + offsets[:, :d], origin[d] + offsets[:, d]
        allowed = (np.abs(center - prior.center) < prior.width).all(axis=1) & (radius > 0.0) & (radius < prior.radius)
        if prior.known:
            log_noise = np.full(len(offsets), math.log(prior.noise))
        else:
            log_noise = origin[d + 1] + offsets[:, d + 1]  # 1/σ is flat in log σ
            allowed &= np.abs(log_noise - math.log(prior.noise)) < math.log(NOISE_RANGE)
        value = np.full(len(offsets), -np.inf)
        value[allowed] = LIKELIHOODS[self.name](self.reference, offsets[allowed, : d + 1], log_noise[allowed])
        return value
