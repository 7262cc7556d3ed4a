"""Modes of a flat cap's posterior: a search for them, and coordinates in which they are neighbours.

Points on a flat cap, whose noise is about its height or above, are explained about as well by a sphere on the other
side, by one of any larger radius up to a plane, and some of them by a small one. These modes differ widely in size, and
walkers in (c, r) hardly ever find a way between them. All have their centres on rays from the points' centroid x̄, along
which the sphere's tangent near the points keeps its direction. So the centre is given as

    w = u log(1 + D/ε),    c - x̄ = D u,    dc/dw = (D + ε) (D/|w|)^(d-1),

with half the points' extent for ε; then both sides, near and far, are a few units apart. Given the centre, the
geometric radius is normal about the mean distance R̄(c) with variance σ²/n, and an unknown σ is proportional to √S(c),
S = Σ(R - R̄)². So (r - R̄)/√S and log σ - log √S take their places; r - R̄ takes that of r if σ is known.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from study.arrays import Floats
from study.fits.random import OldStream

_LEAST = 1e-12
"""Least √S in units of the points' extent: far away rounding makes S zero, and √S is divided by."""
_NO_LENGTH = 1e-300
"""Guard against division by zero."""
_FARTHEST = 100.0
"""Length |w| above which the distance is cut off: far outside any box, and still finite."""


@dataclass(frozen=True)
class RayCoordinates:
    """The map between walkers and coordinates along rays from the points' centroid.

    A walker is an offset from the best sphere's parameters, scaled by a matrix.

    Attributes:
        points: (d, n).
        origin: parameters of the best sphere: centre, radius, and log σ if σ is unknown (p,).
        spread: matrix from walkers to offsets from the origin (p, p).
    """

    points: Floats
    origin: Floats
    spread: Floats

    @property
    def centroid(self) -> Floats:
        """The points' centroid (d,)."""
        return np.asarray(self.points.mean(axis=1))

    @property
    def extent(self) -> float:
        """The points' root mean square distance from the centroid."""
        return math.sqrt(self.points.var(axis=1).sum())

    def coordinates(self, walkers: Floats) -> tuple[Floats, Floats]:
        """Coordinates of walkers (k, p), and log-volumes of parameters per volume of coordinates (k,)."""
        d = len(self.points)
        result = self.origin + walkers @ self.spread.T
        mean, root = self.distances(result[:, :d])
        away = result[:, :d] - self.centroid
        distance = np.linalg.norm(away, axis=1)
        length = np.log1p(distance / (0.5 * self.extent))
        result[:, :d] = away * (length / np.maximum(distance, _NO_LENGTH))[:, None]
        result[:, d] = (result[:, d] - mean) / root
        if len(self.origin) > d + 1:
            result[:, d + 1] -= np.log(root)
        return result, self._volume(distance, length, root)

    def walkers(self, coordinates: Floats) -> tuple[Floats, Floats]:
        """Walkers at coordinates (k, p), and log-volumes of parameters per volume of coordinates (k,)."""
        d = len(self.points)
        result = coordinates.copy()
        length = np.linalg.norm(result[:, :d], axis=1)
        distance = 0.5 * self.extent * np.expm1(np.minimum(length, _FARTHEST))
        result[:, :d] = self.centroid + result[:, :d] * (distance / np.maximum(length, _NO_LENGTH))[:, None]
        mean, root = self.distances(result[:, :d])
        result[:, d] = mean + result[:, d] * root
        if len(self.origin) > d + 1:
            result[:, d + 1] += np.log(root)
        return self.walkers_at(result), self._volume(distance, length, root)

    def walkers_at(self, parameters: Floats) -> Floats:
        """Walkers at parameters (k, p)."""
        return np.asarray(np.linalg.solve(self.spread, (parameters - self.origin).T).T)

    def distances(self, center: Floats) -> tuple[Floats, Floats]:
        """Mean R̄ of the points' distances from centres (k, d), and √S; 1 in place of √S if σ is known."""
        distance = np.sqrt(((center[:, :, None] - self.points) ** 2).sum(axis=1))
        mean = distance.mean(axis=1)
        if len(self.origin) == len(self.points) + 1:
            return mean, np.ones(len(mean))
        root = np.sqrt(((distance - mean[:, None]) ** 2).sum(axis=1))
        return mean, np.maximum(root, _LEAST * self.extent)

    def _volume(self, distance: Floats, length: Floats, root: Floats) -> Floats:
        """Log of dc/dw times √S."""
        d, near = len(self.points), 0.5 * self.extent
        stretch = np.where(length > 1e-9, distance / np.maximum(length, _NO_LENGTH), near)
        return np.asarray(np.log(distance + near) + (d - 1) * np.log(stretch) + np.log(root))


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
_NO_DENSITY = 1e-300


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
    axes = [*np.linalg.eigh(np.cov(rays.points))[1].T, main / max(float(np.linalg.norm(main)), _NO_DENSITY)]
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
    places[:, :d] *= (length / np.maximum(np.linalg.norm(places[:, :d], axis=1), _NO_DENSITY))[:, None]
    result[1::2] = rays.walkers(places)[0]
    return result
