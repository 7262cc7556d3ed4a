"""Outliers: some samples lie far from where their noise alone would put them."""

from dataclasses import dataclass

import numpy as np

from study.experiment.noise.further_numbers import FurtherNumbers
from study.sphere.types import Floats


@dataclass(frozen=True)
class Outliers:
    """Each sample is displaced with some probability, by a given distance, in a direction uniform on the sphere.

    The covariance of a sample grows by share × size² σ²/d I. Studies that differ in share or size alone displace in the
    same directions, and the outliers of a smaller share are among those of a larger one.

    Attributes:
        share: probability of a displacement.
        size: its length, in units of σ.
    """

    share: float
    size: float

    def applied(self, noise: Floats, numbers: FurtherNumbers) -> Floats:
        """The noise, with the displacement added where a uniform number of the sample is below the share."""
        _, d, n = noise.shape
        number = numbers.draw(("outliers", "choice"), lambda g, trials: g.random((trials, n)))
        away = numbers.draw(("outliers", "direction"), lambda g, trials: g.standard_normal((trials, d, n)))
        length = np.where(number < self.share, self.size, 0.0) / np.sqrt(np.einsum("bdn,bdn->bn", away, away))
        return np.asarray(noise + length[:, None] * away)
