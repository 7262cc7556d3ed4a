"""The simple form of an estimator: a function from one set of points to a centre and a radius."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from study.estimators.estimates import Estimates, blank
from study.estimators.samples import Samples
from study.estimators.status import Status
from study.sphere.types import Floats

Function = Callable[..., object]
_LONGEST = 500


@dataclass(frozen=True)
class SimpleForm:
    """A function of points (n, d) as an estimator of batches.

    The function is called once for each set, with a copy of its points; not for points whose fourth powers are not
    finite. Where it raises or returns something else than a centre (d,) and a radius, the fit has the status
    ``FAILED``; where it returns numbers that are not finite, the points did not determine a sphere. The noise variance
    is that of the residuals, over n - d - 1.

    Attributes:
        function: takes points (n, d), and the noise if it needs it; returns a centre (d,) and a radius.
        needs: ``noise`` if the function takes the noise as its second argument: σ, or a covariance (d, d).
    """

    function: Function
    needs: str = ""

    def __call__(self, samples: Samples) -> Estimates:
        """Fit each set."""
        return self.attempt(samples)[0]

    def attempt(self, samples: Samples) -> tuple[Estimates, dict[int, str]]:
        """Fit each set; also the messages of the sets that failed, by number."""
        if self.needs and samples.noise is None:
            raise ValueError("noise = None: this estimator needs the standard deviation of a coordinate")
        b, d, n = samples.shape
        result, failed = blank(b, d), dict[int, str]()
        with np.errstate(all="ignore"):
            usable = np.isfinite((samples.points**4).sum(axis=(1, 2)))
        for t, points in enumerate(samples.points):
            if not usable[t]:  # linear algebra may not even return
                result.status[t] = Status.NOT_FINITE
                continue
            try:
                center, radius = self._one(np.array(points, order="C"), samples.noise, t)
            except (Exception, SystemExit) as error:
                failed[t] = one_line(error)[:_LONGEST]
                result.status[t] = Status.FAILED
                continue
            if not (np.all(np.isfinite(center)) and np.isfinite(radius)):
                result.status[t] = Status.SINGULAR
                continue
            result.center[t], result.radius[t] = center, radius
            with np.errstate(all="ignore"):
                square = (np.linalg.norm(points - center, axis=1) - radius) ** 2
                result.noise_variance[t] = square.sum() / (n - d - 1) if n > d + 1 else np.nan
        return result, failed

    def _one(self, points: Floats, noise: float | Floats | None, place: int) -> tuple[Floats, float]:
        """Call the function for one set, and check what it returns."""
        own = noise[place] if isinstance(noise, np.ndarray) and noise.ndim == 1 else noise
        answer = self.function(points, own) if self.needs else self.function(points)
        if not isinstance(answer, tuple | list) or len(answer) != 2:
            raise TypeError(f"returned {_described(answer)}, expected a centre and a radius")
        center, radius = (np.asarray(part, dtype=float) for part in answer)
        d = points.shape[1]
        if center.shape != (d,):
            raise ValueError(f"returned a centre of shape {center.shape}, expected {(d,)}")
        if radius.shape != ():
            raise ValueError(f"returned a radius of shape {radius.shape}, expected one number")
        return center, float(radius)


def one_line(error: BaseException) -> str:
    """An exception in one line: its type and the first line of its message."""
    words = str(error).strip().split("\n")[0]
    return f"{type(error).__name__}: {words}" if words else type(error).__name__


def _described(answer: object) -> str:
    """Describe what a function returned, in a few words."""
    if isinstance(answer, tuple | list):
        return f"{len(answer)} values"
    shape = f" of shape {answer.shape}" if isinstance(answer, np.ndarray) else ""
    return f"{type(answer).__name__}{shape}"
