"""Student's t law: heavy tails, the same in every direction."""

import math
from dataclasses import dataclass

import numpy as np

from study.experiment.noise.further_numbers import FurtherNumbers
from study.sphere.types import Floats


@dataclass(frozen=True)
class StudentNoise:
    """Multivariate t noise of ν degrees of freedom, scaled to the covariance I.

    The coordinates of a sample share one χ² number. So its law is the same in every direction, and a sample is far off
    in all coordinates together. Each coordinate is a t number times √((ν - 2)/ν), whose excess kurtosis is 6/(ν - 4)
    for ν > 4 and infinite below.

    Attributes:
        freedom: ν > 2; below there is no covariance.
    """

    freedom: float

    @property
    def excess_kurtosis(self) -> float:
        """6/(ν - 4), or infinity."""
        return 6.0 / (self.freedom - 4.0) if self.freedom > 4.0 else math.inf

    def applied(self, noise: Floats, numbers: FurtherNumbers) -> Floats:
        """Normal noise z as z √((ν - 2)/χ²), with a χ² number of ν degrees of freedom for each sample."""
        n = noise.shape[2]
        square = numbers.draw(("student", self.freedom), lambda g, trials: g.chisquare(self.freedom, (trials, n)))
        square /= self.freedom - 2.0
        return noise / np.sqrt(square)[:, None]
