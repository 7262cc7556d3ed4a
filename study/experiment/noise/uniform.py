"""The uniform law: no tails at all."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from study.experiment.noise.further_numbers import FurtherNumbers
from study.sphere.types import Floats


@dataclass(frozen=True)
class UniformNoise:
    """Independent coordinates uniform on [-√3, √3]: variance 1, excess kurtosis -6/5.

    The law of a sample is not the same in every direction: it fills a cube along the axes.
    """

    excess_kurtosis = -1.2

    def applied(self, noise: Floats, numbers: FurtherNumbers) -> Floats:
        """The quantile of each normal number z in this law: √3 (2Φ(z) - 1) = √3 erf(z/√2)."""
        return np.asarray(math.sqrt(3.0) * scipy.special.erf(math.sqrt(0.5) * noise))
