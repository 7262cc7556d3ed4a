"""The interface of a departure from normal noise: another law of the same covariance, or outliers."""

from typing import Protocol

from study.experiment.noise.further_numbers import FurtherNumbers
from study.sphere.types import Floats


class Departure(Protocol):
    """A step that turns noise at σ = 1 into noise of another law."""

    def applied(self, noise: Floats, numbers: FurtherNumbers) -> Floats:
        """The noise of the other law (b, d, n), in fresh memory.

        A law, which `study.experiment.noise.laws` lists, has the covariance I, so that σ means the same in all.

        Args:
            noise: at σ = 1 (b, d, n); standard normal numbers, if no other step came before.
            numbers: further random numbers of the same trials.
        """
