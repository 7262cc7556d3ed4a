"""The estimators, by name. To add one: write a function from `Samples` to `Fit`, and a line in `ESTIMATORS`."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from study.estimators.fit import Fit, Samples, Status
from study.estimators.gdk import gdke, ugdk
from study.estimators.lls import lls
from study.estimators.mle import mle
from study.sphere.bounds import noise_covariance

Estimator = Callable[[Samples], Fit]

ESTIMATORS: dict[str, Estimator] = {
    "mle": mle,
    "lls": lls,
    "gdke": gdke,
    "ugdk": ugdk,
}

__all__ = ["ESTIMATORS", "Estimator", "Fit", "Samples", "Status", "fit"]


def fit(points: ArrayLike, estimator: str = "mle", noise: ArrayLike | None = None) -> Fit:
    """Fit a sphere (a circle, if d = 2) to each of one or many point sets.

    Args:
        points: coordinates (…, n, d): n ≥ d + 1 points in d ≥ 2 dimensions; leading axes are a batch.
        estimator: a name in `study.ESTIMATORS`.
        noise: standard deviation σ of each coordinate, a covariance Σ (d, d), or None where the estimator does not
            need it.

    Returns:
        A `Fit` whose arrays have the leading axes of ``points``. Statistics never raise: look at ``fit.status``.

    Raises:
        TypeError: if the points are not real numbers.
        ValueError: if the shape, the noise or the estimator's name cannot be used.
    """
    if estimator not in ESTIMATORS:
        raise ValueError(f"estimator = {estimator!r}: known are {', '.join(ESTIMATORS)}")
    array = np.asarray(points)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"points have dtype {array.dtype}: expected real numbers")
    if array.ndim < 2 or array.shape[-1] < 2:
        raise ValueError(f"points have shape {array.shape}: expected (…, n, d) with d ≥ 2")
    *lead, n, d = array.shape
    if n < d + 1:
        raise ValueError(f"points have shape {array.shape}: a sphere in {d} dimensions needs at least {d + 1} points")
    if noise is not None:
        noise_covariance(noise, d)
        noise = float(np.asarray(noise)) if np.ndim(noise) == 0 else np.asarray(noise, dtype=float)
    x = array.astype(float, copy=False).reshape(-1, n, d).swapaxes(1, 2)
    result = ESTIMATORS[estimator](Samples(x, noise))
    return Fit(
        center=result.center.reshape(*lead, d),
        radius=result.radius.reshape(lead),
        noise_variance=result.noise_variance.reshape(lead),
        status=result.status.reshape(lead),
        condition=result.condition.reshape(lead),
        iterations=result.iterations.reshape(lead),
    )
