"""The interface of a departure from normal noise: another law of the same covariance, or outliers."""

from typing import Protocol

from study.experiment.noise.further_numbers import FurtherNumbers
from study.sphere.types import Floats


class Departure(Protocol):
    """A step that turns noise at σ = 1 into noise of another law."""

    def applied(self, noise: Floats, numbers: FurtherNumbers) -> Floats:
        """The noise of the other law (b, d, n), in fresh memory.

        Args:
            noise: at σ = 1 (b, d, n); standard normal numbers, if no other step came before.
            numbers: further random numbers of the same trials.
        """


class OtherLaw(Departure, Protocol):
    """A law of noise that is not normal, of covariance I: σ means the same in all."""

    @property
    def excess_kurtosis(self) -> float:
        """The excess kurtosis of a coordinate."""
