"""The arrays that an estimator fills in, as kernels take them."""

from typing import NamedTuple

import numpy as np

from study.sphere.types import Floats, Ints


class Estimates(NamedTuple):
    """Results of a batch of fits: the centres, then arrays with a number per point set, floating-point ones first.

    An estimator returns them. Everything that handles fits field by field reads this list.

    Attributes:
        center: ĉ (b, d), in the unit of the points.
        radius: r̂ (b,), in the unit of the points. NaN where no radius is real, which the status then says.
        noise_variance: σ² of one coordinate (b,), unit squared: as given to an estimator that uses it (the mean over
            coordinates, for a covariance), else estimated from the residuals. NaN at n = d + 1, which leaves none.
        condition: the paper's Leontief condition ρ (b,), the spectral radius of Σ̂C⁻¹, which must be below 1. NaN for
            an estimator that subtracts no noise.
        status: number of the `Status` of each fit (b,).
        iterations: steps taken (b,); 0 for a closed form.
    """

    center: Floats
    radius: Floats
    noise_variance: Floats
    condition: Floats
    status: Ints
    iterations: Ints

    def reshape(self, *lead: int) -> "Estimates":
        """Return the same numbers with other leading axes."""
        center, *others = self
        return Estimates._make([center.reshape(*lead, center.shape[-1]), *(array.reshape(lead) for array in others)])


_NUMBERS = list(Estimates.__annotations__.values()).count(Floats) - 1
"""Arrays of one floating-point number per set."""


def blank(batch: int, dimension: int) -> Estimates:
    """Return estimates of NaN with status ok, for an estimator to fill in."""
    # two allocations: one for each array would cost more than fitting one small set
    numbers = np.empty(batch * (dimension + _NUMBERS))
    whole = np.zeros((len(Estimates._fields) - _NUMBERS - 1, batch), dtype=np.int64)
    numbers.fill(np.nan)
    rest = numbers[batch * dimension :].reshape(_NUMBERS, batch)
    return Estimates(numbers[: batch * dimension].reshape(batch, dimension), *rest, *whole)
