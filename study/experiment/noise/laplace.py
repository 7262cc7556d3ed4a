"""Laplace's law: tails of e^{-|x|} in each coordinate."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from study.experiment.noise.further_numbers import FurtherNumbers
from study.sphere.types import Floats


@dataclass(frozen=True)
class LaplaceNoise:
    """Independent coordinates of density e^{-√2 |x|}/√2: variance 1, excess kurtosis 3.

    The law of a sample is not the same in every direction: it reaches farther along the axes.
    """

    excess_kurtosis = 3.0

    def applied(self, noise: Floats, numbers: FurtherNumbers) -> Floats:
        """The quantile of each normal number z in this law: -sign(z) (ln 2 + ln Φ(-|z|))/√2, exact in the tails."""
        return np.asarray(-np.sign(noise) * (math.log(2.0) + scipy.special.log_ndtr(-np.abs(noise))) * math.sqrt(0.5))
