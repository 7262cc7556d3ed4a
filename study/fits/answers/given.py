"""Knowledge beforehand: a radius, the noise of each point, or its law; and the fits that use it.

`study.fit` checks here what it is given. The noise of all points is such knowledge, too, for estimators that find it by
themselves: it fixes σ, errors, intervals and the status, while centre and radius stay. Which estimators take which is
in `Estimator.given`.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from study.arrays import Floats, real_array
from study.fits.errors.prior import believed
from study.fits.errors.weighted import closed, corrected_equations, estimates, least_squares
from study.fits.estimators.robust import find
from study.fits.points.noise import is_per_point, noise_covariance, point_noise
from study.fits.points.samples import Estimates, Estimator, Given, GivenWay, Samples, StatedRadius, Status, careful_fit

RADIUS, UNCERTAIN = "known radius", "uncertain radius"
NOISE, COVARIANCE, LAW = "noise for each point", "covariance for each point", "law = 'radial'"
RADIUS_AND_COVARIANCE = "known radius and a covariance for each point"
_CLOSED = frozenset([RADIUS, UNCERTAIN, NOISE])
_ALL = _CLOSED | {COVARIANCE, LAW, RADIUS_AND_COVARIANCE}
"""Knowledge that estimators may take, as messages name it."""
MLE, CORRECTED = (GivenWay(partial(estimates, form), _ALL) for form in (least_squares, corrected_equations))
ROBUST = GivenWay(MLE.fit, frozenset([RADIUS, UNCERTAIN]))
GDKE = GivenWay(partial(estimates, closed), _CLOSED | {COVARIANCE})
UGDK = GivenWay(partial(estimates, partial(closed, subtract=True)), _CLOSED | {COVARIANCE})
ALS = GivenWay(partial(estimates, partial(closed, find=True)), _CLOSED)
"""What shipped estimators take, and their ways to fit it."""
_EXACT = 1e-9
"""Uncertainty of a radius, in radii, below which rounding leaves no less of it."""


def given_samples(
    points: Floats,
    noise: ArrayLike | None,
    radius: ArrayLike | tuple[ArrayLike, ArrayLike] | None,
    scale: str,
    radial: bool,
) -> Samples:
    """Check what is given for points (…, n, d), and bring both to the flat batch; a point without a noise is missing.

    Raises:
        TypeError: if a value is no real number.
        ValueError: if a shape or value cannot be used; the message says which.
    """
    *lead, n, d = points.shape
    b, x = math.prod(lead), np.array(points.reshape(-1, n, d).swapaxes(1, 2), dtype=float, order="C")
    if scale not in ("given", "estimated"):
        raise ValueError(f"scale = {scale!r}: 'given' takes the noise as it is, 'estimated' its ratios alone")
    known, stated = np.full(b, np.nan), None
    radius, uncertain = radius if isinstance(radius, tuple) and len(radius) == 2 else (radius, None)
    if radius is not None:
        value = real_array(radius, "radius").astype(float)
        if value.shape not in ((), tuple(lead)):
            raise ValueError(f"radius has shape {value.shape}: give one number, or one for each set, {tuple(lead)}")
        if (wrong := value[~((value > 0.0) & (value < 1e150))]).size:
            raise ValueError(f"radius = {wrong[0]:g}: a known radius must be positive and finite")
        known = np.broadcast_to(value, lead).reshape(b).astype(float)
    if uncertain is not None:
        value = real_array(uncertain, "radius").astype(float)
        if value.shape not in ((), tuple(lead)) or not ((value > 0.0) & (value < 1e150)).all():
            remedy = "must be positive and finite; give an exact radius alone, as one number"
            raise ValueError(f"radius = (…, {uncertain}): a standard uncertainty {remedy}")
        stated = StatedRadius(known, np.maximum(np.broadcast_to(value, lead).reshape(b), _EXACT * known))
    array = real_array(np.nan if noise is None else noise, "noise").astype(float)
    each = is_per_point(array.shape, n, d)
    if scale == "estimated" and not each:
        raise ValueError("scale = 'estimated' needs a noise for each point: (n,), (n, d) or (n, d, d)")
    if array.ndim == 0:
        return Samples(x, given=Given(known, np.full(b, float(array) ** 2), prior=stated, radial=radial))
    variance = point_noise(array if each else np.broadcast_to(noise_covariance(array, d), (n, d, d)), points.shape)
    covariances = variance if variance.ndim == 4 else None
    if covariances is not None:
        variance = np.einsum("bnii->bn", covariances) / d
        if np.array_equal(covariances, covariances[..., :1, :1] * np.eye(d), equal_nan=True):  # isotropic
            variance, covariances = covariances[..., 0, 0], None
    x[np.broadcast_to(~(variance > 0.0)[:, None], x.shape)] = np.nan
    there = np.isfinite(x).all(axis=1)
    with np.errstate(all="ignore"):
        weights = np.where(there, 1.0 / variance, 0.0)
        mean = weights.sum(axis=1) / there.sum(axis=1)
        covariances = None if covariances is None else covariances * mean[:, None, None, None]
        given = Given(known, 1.0 / mean, scale == "estimated", covariances, stated, radial)
        return Samples(x, weights=weights / mean[:, None], given=given)


def check_way(estimator: str, samples: Samples, entries: Mapping[str, Estimator]) -> None:
    """Raise a ValueError, which names those that can, if an estimator does not take what is known.

    Args:
        estimator: its name.
        samples: the points with what is known.
        entries: the estimators by their names.
    """
    entry, given, weights = entries[estimator], samples.given, samples.weights
    assert given is not None
    radius = bool(np.isfinite(given.radius).any())
    if given.radial and given.covariances is not None:
        raise ValueError("law = 'radial': the noise has one size at a point, no covariance; give σ of each, (n,)")
    wanted = [LAW] if given.radial else []
    if radius:
        wanted.append(RADIUS if given.prior is None else UNCERTAIN)
    if weights is not None:
        wanted += [RADIUS_AND_COVARIANCE] * (radius and given.covariances is not None)
        wanted.append(NOISE if given.covariances is None else COVARIANCE)
    if not entry.given.takes.issuperset(wanted):
        able = [name for name, other in entries.items() if other.given.takes.issuperset(wanted)]
        names = " and ".join([", ".join(able[:-1]), able[-1]])
        if given.radial and LAW not in entry.given.takes:
            wanted = [LAW]
        said = " and ".join(word for word in wanted if word != RADIUS_AND_COVARIANCE)
        raise ValueError(f"estimator = {estimator!r}: takes no {said}; {names} do")
    if entry.needs == "noise" and given.relative:
        raise ValueError(f"estimator = {estimator!r}: subtracts the noise, whose scale must be given; als finds it")
    if entry.needs == "noise" and weights is None and np.isnan(given.size).any():
        raise ValueError(f"estimator = {estimator!r}: subtracts the known noise: pass noise=σ, or use als")


def fit_given(entry: Estimator, samples: Samples) -> tuple[Estimates, Samples]:
    """Fit points of which something is known: the numbers and the samples.

    A radius that is stated with an uncertainty is fitted first, by points and statement together.
    """
    given = samples.given
    assert given is not None
    if samples.sigma_alone:
        samples = replace(samples, noise=math.sqrt(given.size[0]))
        answer = careful_fit(entry, samples)
        answer.noise_variance[np.isfinite(answer.noise_variance)] = given.size[0]
        return answer, samples
    found, used = None, samples
    if entry.without_outliers:
        found = find(samples, known=None if given.prior is not None else given.radius)
        used = samples.without(found.named)
    if given.prior is not None:
        radius = believed(used).at(np.full((len(given.radius), 1), 0.5))[0][:, 0]
        radius = np.where(np.isfinite(radius), radius, given.radius)
        samples, used = samples.with_radius(radius), used.with_radius(radius)
    answer = careful_fit(entry, used)
    if found is not None and given.prior is None:  # with an uncertain radius the points that are left are fitted
        weighed = np.isfinite(found.radius) & (answer.status == Status.OK)
        answer.center[weighed], answer.noise_variance[weighed] = found.center[weighed], found.variance[weighed]
    answer.status[np.isinf(samples.x).any(axis=(1, 2))] = Status.NOT_FINITE
    return answer, samples
