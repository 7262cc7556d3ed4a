"""The search for modes of a posterior apart from the best sphere, and a start of walkers that reaches them."""

import math
from collections.abc import Callable

import numpy as np

from study.experiment.streams import OldStream
from study.posterior.ray_coordinates import RayCoordinates
from study.sphere.types import Floats

_NEAREST = 0.1
"""Least distance of a trial centre from the centroid, in units of the points' extent √Tr C."""
_CENTERS = 60
"""Trial centres on each ray."""
_APART = 6.0
"""A centre farther than this from the best sphere, in its standard deviations, is apart from it ..."""
_VALLEY = 2.0
"""... and so is one across the centroid, where the log-density at the centroid is lower than its own by this."""
_LEAST_MASS = 0.1
"""Least mass in units of the best sphere's, by a crude bound, that counts as a possible mode."""
_TINY = 1e-300


def other_modes_possible(rays: RayCoordinates, width: float, log_density: Callable[[Floats], Floats]) -> bool:
    """True if there may be mass apart from the best sphere.

    The density is computed on lines through the centroid: towards the best centre, and along the points' main axes. A
    centre at m standard deviations counts with m^d times the best sphere's volume. That overrates its mass about ten
    times in the plane and more in space, so modes with less than about a percent of the mass may be missed.

    Args:
        rays: coordinates of the posterior.
        width: half-width of the prior's box.
        log_density: log-posterior of walkers (k, p).
    """
    d, n = rays.points.shape
    main = rays.origin[:d] - rays.centroid
    axes = [*np.linalg.eigh(np.cov(rays.points))[1].T, main / max(float(np.linalg.norm(main)), _TINY)]
    steps = np.geomspace(_NEAREST * rays.extent, 2.0 * math.sqrt(d) * width, _CENTERS)
    lines = [sign * steps[:, None] * axis for axis in axes for sign in (-1.0, 1.0)]
    center = rays.centroid + np.concatenate([*lines, np.zeros((1, d))])
    with np.errstate(all="ignore"):  # the density is zero where no sphere exists
        mean, root = rays.distances(center)
        rest = [mean] if len(rays.origin) == d + 1 else [mean, np.log(root / math.sqrt(n))]
        walkers = rays.walkers_at(np.column_stack([center, *rest]))
        walkers[~np.isfinite(walkers).all(axis=1)] = np.inf
        covariance = rays.spread[:d] @ rays.spread[:d].T
        away = np.linalg.solve(np.linalg.cholesky(covariance), (center - rays.origin[:d]).T)
        size = np.sqrt((away**2).sum(axis=0))
        density = log_density(walkers)
        across = ((center - rays.centroid) @ main < 0.0) & (density > density[-1] + _VALLEY)
        mass = density + d * np.log(np.maximum(size, 1.0))
        best = log_density(np.zeros((1, len(rays.origin))))[0]
    return bool((mass[across | (size > _APART)] > best + math.log(_LEAST_MASS)).any())


def spread_out(rays: RayCoordinates, walkers: Floats, width: float, random: OldStream) -> Floats:
    """Move every second walker along its line through the centroid, uniformly in log-distance on either side.

    Args:
        rays: coordinates of the posterior.
        walkers: (k, p).
        width: half-width of the prior's box, the largest distance.
        random: source of random numbers.
    """
    d, result = len(rays.points), walkers.copy()
    places, _ = rays.coordinates(walkers[1::2])
    length = random.uniform(-1.0, 1.0, len(places)) * math.log1p(width / (0.5 * rays.extent))
    places[:, :d] *= (length / np.maximum(np.linalg.norm(places[:, :d], axis=1), _TINY))[:, None]
    result[1::2] = rays.walkers(places)[0]
    return result
