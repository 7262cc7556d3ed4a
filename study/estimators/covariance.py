"""Covariances of fits: the Cramér-Rao bound with the estimates plugged in, or an estimator's own rule; ellipsoids."""

from collections.abc import Callable

import numpy as np

from study.estimators.estimates import Estimates
from study.estimators.samples import Samples
from study.sphere.bounds import bound_from_scatter, normal_weights, unit_covariance, weighted_scatter
from study.sphere.linalg import eigenbasis
from study.sphere.types import Bools, Floats, Ints


def plug_in_bound(directions: Floats, present: Bools, noise: float | Floats | None, variance: Floats) -> Floats:
    """The Cramér-Rao bound (b, d+1, d+1) with estimates in place of the truth.

    Args:
        directions: of the points from ĉ (b, d, n).
        present: False for missing samples (b, n).
        noise: σ or Σ as given, None if it was estimated.
        variance: σ̂² (b,), used if no noise was given.
    """
    b, d, _ = directions.shape
    with np.errstate(all="ignore"):
        covariance, unit = (np.eye(d), variance) if noise is None else unit_covariance(noise, d)
        weights = np.where(present, normal_weights(directions.swapaxes(1, 2), covariance), 0.0)
        sums, mean, scatter = weighted_scatter(np.where(present[:, None], directions, 0.0), weights)
        return np.asarray(bound_from_scatter(sums, mean, scatter) * np.broadcast_to(unit, b)[:, None, None])


def unless_missing(
    covariance_of: Callable[[Samples, Estimates], Floats], samples: Samples, estimates: Estimates
) -> Floats:
    """Covariances (b, d+1, d+1) by an estimator's own rule, without the missing samples; NaN at fewer than d + 1."""
    b, d, _ = samples.shape
    found = np.full((b, d + 1, d + 1), np.nan)
    with np.errstate(all="ignore"):
        for sets, present in samples.by_count():
            if present.shape[2] > d:
                found[sets] = covariance_of(present, Estimates._make([array[sets] for array in estimates]))
    return found


def semi_axes(covariance: Floats, level: float, spare: Ints | None) -> Floats:
    """Semi-axes of confidence ellipsoids, as columns (b, d, d).

    Args:
        covariance: of each estimate (b, d, d); where it is not finite, the axes are NaN.
        level: nominal coverage, in (0, 1).
        spare: degrees of freedom of the noise that the covariance stands on (b,), at least 1, for lengths by F; None
            where the noise is known, for lengths by χ².
    """
    from scipy.special import chdtri, fdtri  # imported here, as it takes as long as the rest of the library

    b, d, _ = covariance.shape
    scale = np.full(b, chdtri(d, 1.0 - level)) if spare is None else d * fdtri(d, spare, level)
    values, vectors = eigenbasis(covariance)
    with np.errstate(all="ignore"):
        lengths = np.sqrt(np.maximum(values, 0.0) * scale[:, None])
        return np.asarray(vectors * lengths[:, None, :])
