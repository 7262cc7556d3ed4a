"""An estimator as the registry lists it: the function, its source, and what is known about it."""

from collections.abc import Callable
from dataclasses import dataclass

from study.estimators.estimates import Estimates
from study.estimators.samples import Samples
from study.sphere.types import Floats


@dataclass(frozen=True)
class Estimator:
    """An estimator as the registry lists it.

    Attributes:
        function: computes `Estimates` from `Samples`. It never raises on data, only on a noise that it cannot use.
        reference: publication that it follows.
        needs: argument of `study.fit` without which it raises; empty if points are enough.
        flops: floating-point operations per sample in d dimensions, counted as in `study.analysis.cost`.
        flops_of: the part of a fit that ``flops`` counts; empty for all of it.
        caution: warning for the user that holds whatever the status; empty if there is none.
        moments_suffice: the function reads ``Samples.moments`` alone.
        by_window: the function reads samples only through `study.sphere.layouts.window`, so that points need not lie
            in memory.
        covariance: covariance of (ĉ, r̂) (b, d+1, d+1), unit squared, of its answers, from samples without missing ones
            and with the noise that they show; None for the Cramér-Rao bound with the estimates plugged in.
        without_outliers: the function leaves out the points that `study.estimators.robust.outliers.outliers` names, so
            that intervals are to be formed without them.
        version: to be raised with every change of its numbers, so that runs do not mix old rows with new ones; a digest
            of its code, for an estimator that is not shipped.
    """

    function: Callable[[Samples], Estimates]
    reference: str = ""
    needs: str = ""
    flops: Callable[[int], float] | None = None
    flops_of: str = ""
    caution: str = ""
    moments_suffice: bool = False
    by_window: bool = False
    covariance: Callable[[Samples, Estimates], Floats] | None = None
    without_outliers: bool = False
    version: int | str = 1

    def __call__(self, samples: Samples) -> Estimates:
        """Fit each set of the batch."""
        return self.function(samples)
