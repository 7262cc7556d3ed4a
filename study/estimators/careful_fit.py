"""Fits of sets that need preparation: with missing samples, or so large or small that their powers leave float64."""

import numpy as np

from study.estimators.estimates import Estimates, blank
from study.estimators.estimator import Estimator
from study.estimators.samples import Samples
from study.estimators.status import Status
from study.sphere.types import Floats, Ints

_LEAST_FOURTH, _MOST_FOURTH = 1e-160, 1e160
"""Range of Σ|x - x̄|⁴ in which nothing that an estimator computes overflows or loses digits to underflow."""
_ORDINARY = 1e-40, 1e40
"""Sizes of point sets that are fitted as they are."""
FARTHEST = 430
"""Binary exponent of the largest and smallest points, 1e±129, whose answers and variances float64 holds."""
_LARGEST_NOISE = 1e70
"""Noise beside points of size 1 beyond which it makes no difference."""


def is_ordinary(fourth: Floats) -> bool:
    """True if no set has missing samples, or needs scaling, by the fourth moments Σ|x - x̄|⁴ (b,)."""
    if len(fourth) == 1:
        return bool(_LEAST_FOURTH < float(fourth[0]) < _MOST_FOURTH)
    return len(fourth) == 0 or bool(fourth.min() > _LEAST_FOURTH and fourth.max() < _MOST_FOURTH)


def careful_fit(estimator: Estimator, samples: Samples) -> Estimates:
    """Fit each set without its missing samples, in a unit of its own size where it is very large or small.

    The unit is a power of two, so that points of ordinary size keep their bits. Sets with equally many samples and of
    one unit are fitted together.
    """
    b, d, _ = samples.shape
    result = blank(b, d)
    for sets, present in samples.by_count():
        if present.shape[2] < d + 1:
            result.status[sets] = Status.TOO_FEW_POINTS
            continue
        powers = binary_size(present.x)
        for power in np.unique(powers):
            some = np.flatnonzero(powers == power)
            if abs(power) > FARTHEST:
                result.status[sets[some]] = Status.NOT_FINITE
                continue
            part = present if len(some) == len(sets) else present.take(some)
            found = estimator(part if power == 0 else scaled(part, -int(power)))
            for whole, values in zip(result, found if power == 0 else _rescaled(found, int(power)), strict=True):
                whole[sets[some]] = values
    return result


def binary_size(x: Floats) -> Ints:
    """Binary exponent of the extent of each set (b, d, n), 0 where it is ordinary, nil or not finite."""
    with np.errstate(all="ignore"):
        extent = np.abs(x - x[:, :, :1]).max(axis=(1, 2))
    usual = ~np.isfinite(extent) | (extent == 0.0) | ((extent > _ORDINARY[0]) & (extent < _ORDINARY[1]))
    return np.asarray(np.where(usual, 0, np.frexp(extent)[1]), dtype=np.int64)


def scaled(samples: Samples, power: int) -> Samples:
    """The samples times 2^power, with their noise."""
    with np.errstate(all="ignore"):
        return Samples(np.ldexp(samples.x, power), scaled_noise(samples.noise, power))


def scaled_noise(noise: float | Floats | None, power: int) -> float | Floats | None:
    """A noise times 2^power, or its covariance times the square."""
    if noise is None:
        return None
    with np.errstate(all="ignore"):
        if np.ndim(noise) < 2:
            sigma = np.minimum(np.ldexp(noise, power), _LARGEST_NOISE)
            return np.asarray(sigma) if np.ndim(noise) else float(sigma)
        largest = float(np.sqrt(np.max(noise)))
        factor = min(np.ldexp(1.0, power), _LARGEST_NOISE / largest)
        return np.asarray(noise * factor * factor)


def _rescaled(found: Estimates, power: int) -> Estimates:
    """The estimates times 2^power."""
    with np.errstate(all="ignore"):
        return found._replace(
            center=np.ldexp(found.center, power),
            radius=np.ldexp(found.radius, power),
            noise_variance=np.ldexp(found.noise_variance, 2 * power),
        )
