"""Coordinates in which the humps of a flat cap's posterior are neighbours, and whether there may be other humps at all.

Points on a flat cap, whose noise is about its height or above, are as well explained by a sphere on the other side, by
one of any larger radius up to a plane, and some by a small one among them: humps of very different sizes, between which
walkers in (c, r) hardly ever find a way. All have their centres on rays from the points' centroid x̄, along which the
sphere's tangent near the points keeps its direction. So the centre is given as

    w = u log(1 + D/ε),    c - x̄ = D u,    dc/dw = (D + ε) (D/|w|)^(d-1),

with half the points' extent for ε: sides, near and far are then a few units apart. Given the centre, the geometric
radius is normal about the mean distance R̄(c) with variance σ²/n, and a σ that is not known goes with √S(c),
S = Σ(R - R̄)²; so (r - R̄)/√S and log σ - log √S take their places, the former as r - R̄ where σ is known.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from study.experiment.streams import OldStream
from study.sphere.types import Floats

_NEAREST = 0.1
"""Least distance from the centroid that is looked at, in units of the points' extent √Tr C."""
_PLACES = 60
_LEAST = 1e-12
"""Least √S, in that unit: far away, rounding leaves none, and what is divided by it must not be 0."""
_APART = 6.0
"""What lies farther from the best sphere, in its standard deviations, is apart from it ..."""
_VALLEY = 2.0
"""... and so is what lies across the centroid, where the log-density is lower by this."""
_WORTH = 0.1
"""Least share of the best sphere's mass, by a crude bound, for which other places are looked for."""


@dataclass(frozen=True)
class Rays:
    """Parameters of spheres, and their coordinates along rays from the points' centroid.

    Attributes:
        points: (d, n).
        origin: parameters of the best sphere: centre, radius, and log σ where that is not known (p,).
        spread: matrix by which walkers are offsets from it (p, p).
    """

    points: Floats
    origin: Floats
    spread: Floats

    @property
    def middle(self) -> Floats:
        """The points' centroid (d,)."""
        return np.asarray(self.points.mean(axis=1))

    @property
    def extent(self) -> float:
        """The points' root mean square distance from it."""
        return math.sqrt(self.points.var(axis=1).sum())

    def coordinates(self, walkers: Floats) -> tuple[Floats, Floats]:
        """Coordinates of walkers (k, p), and log-volumes of parameters per volume of coordinates (k,)."""
        d = len(self.points)
        result = self.origin + walkers @ self.spread.T
        mean, root = self._distances(result[:, :d])
        away = result[:, :d] - self.middle
        distance = np.linalg.norm(away, axis=1)
        length = np.log1p(distance / (0.5 * self.extent))
        result[:, :d] = away * (length / np.maximum(distance, 1e-300))[:, None]
        result[:, d] = (result[:, d] - mean) / root
        if len(self.origin) > d + 1:
            result[:, d + 1] -= np.log(root)
        return result, self._volume(distance, length, root)

    def walkers(self, coordinates: Floats) -> tuple[Floats, Floats]:
        """Walkers of coordinates (k, p), and log-volumes of parameters per volume of coordinates (k,)."""
        d = len(self.points)
        result = coordinates.copy()
        length = np.linalg.norm(result[:, :d], axis=1)
        distance = 0.5 * self.extent * np.expm1(np.minimum(length, 100.0))  # far beyond any box, yet a number
        result[:, :d] = self.middle + result[:, :d] * (distance / np.maximum(length, 1e-300))[:, None]
        mean, root = self._distances(result[:, :d])
        result[:, d] = mean + result[:, d] * root
        if len(self.origin) > d + 1:
            result[:, d + 1] += np.log(root)
        return self._scaled(result), self._volume(distance, length, root)

    def spread_out(self, walkers: Floats, width: float, random: OldStream) -> Floats:
        """Every second walker anywhere on its line through the centroid, near and far alike, on either side."""
        d, result = len(self.points), walkers.copy()
        places, _ = self.coordinates(walkers[1::2])
        length = random.uniform(-1.0, 1.0, len(places)) * math.log1p(width / (0.5 * self.extent))
        places[:, :d] *= (length / np.maximum(np.linalg.norm(places[:, :d], axis=1), 1e-300))[:, None]
        result[1::2] = self.walkers(places)[0]
        return result

    def needed(self, width: float, log_probability: Callable[[Floats], Floats]) -> bool:
        """Whether there may be mass apart from the best sphere: on lines towards it and along the points' main axes.

        A place at m standard deviations is taken to stand for a volume of m^d times the best sphere's. That overrates
        its mass some ten times in the plane and more in space: humps of less than about a percent are not looked for.
        """
        d, n = self.points.shape
        main = self.origin[:d] - self.middle
        axes = [*np.linalg.eigh(np.cov(self.points))[1].T, main / max(float(np.linalg.norm(main)), 1e-300)]
        steps = np.geomspace(_NEAREST * self.extent, 2.0 * math.sqrt(d) * width, _PLACES)
        lines = [sign * steps[:, None] * axis for axis in axes for sign in (-1.0, 1.0)]
        center = self.middle + np.concatenate([*lines, np.zeros((1, d))])
        with np.errstate(all="ignore"):  # places where a sphere is none have no density
            mean, root = self._distances(center)
            rest = [mean] if len(self.origin) == d + 1 else [mean, np.log(root / math.sqrt(n))]
            scaled = self._scaled(np.column_stack([center, *rest]))
            scaled[~np.isfinite(scaled).all(axis=1)] = np.inf
            covariance = self.spread[:d] @ self.spread[:d].T
            away = np.linalg.solve(np.linalg.cholesky(covariance), (center - self.origin[:d]).T)
            size = np.sqrt((away**2).sum(axis=0))
            density = log_probability(scaled)
            across = ((center - self.middle) @ main < 0.0) & (density > density[-1] + _VALLEY)
            mass = density + d * np.log(np.maximum(size, 1.0))
            best = log_probability(np.zeros((1, len(self.origin))))[0]
        return bool((mass[across | (size > _APART)] > best + math.log(_WORTH)).any())

    def _volume(self, distance: Floats, length: Floats, root: Floats) -> Floats:
        """Log of dc/dw, and of what the radius is divided by."""
        d, near = len(self.points), 0.5 * self.extent
        stretch = np.where(length > 1e-9, distance / np.maximum(length, 1e-300), near)
        return np.asarray(np.log(distance + near) + (d - 1) * np.log(stretch) + np.log(root))

    def _distances(self, center: Floats) -> tuple[Floats, Floats]:
        """Mean of the points' distances from centres (k, d), and √S there; 1 for that where σ is known."""
        distance = np.sqrt(((center[:, :, None] - self.points) ** 2).sum(axis=1))
        mean = distance.mean(axis=1)
        if len(self.origin) == len(self.points) + 1:
            return mean, np.ones(len(mean))
        root = np.sqrt(((distance - mean[:, None]) ** 2).sum(axis=1))
        return mean, np.maximum(root, _LEAST * self.extent)

    def _scaled(self, parameters: Floats) -> Floats:
        return np.asarray(np.linalg.solve(self.spread, (parameters - self.origin).T).T)
