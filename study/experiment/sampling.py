"""From a batch to its points: one draw of unit directions u and normals z serves every σ, r and c."""

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from study.estimators import Samples
from study.experiment.config import Study
from study.experiment.design import Batch, Level
from study.experiment.streams import lanes
from study.sphere import cap
from study.sphere.bounds import bound_from_scatter, normal_weights, weighted_scatter
from study.sphere.layouts import Placed, form
from study.sphere.types import Floats

Array = Callable[[str, tuple[int, ...]], Floats]
"""Gives an array of a name and shape, with any content."""


def new(name: str, shape: tuple[int, ...]) -> Floats:
    """A fresh array, whatever its name."""
    return np.empty(shape)


class Workspace(threading.local):
    """Arrays of one thread that are used again: fresh memory costs as much as the arithmetic on it.

    What is taken from it is valid until an array of the same name is asked for again.
    """

    def __init__(self) -> None:
        self._arrays: dict[str, Floats] = {}

    def __call__(self, name: str, shape: tuple[int, ...]) -> Floats:
        """An array of a shape, perhaps used before."""
        size = math.prod(shape)
        if name not in self._arrays or self._arrays[name].size < size:
            self._arrays[name] = np.empty(size)
        return self._arrays[name][:size].reshape(shape)


@dataclass(frozen=True)
class Draws:
    """What a batch draws, before it is placed on any sphere.

    Attributes:
        directions: unit vectors (b, d, n) about the first axis, with the height 1 - u₁ in place of u₁.
        noise: noise of unit size (b, d, n), of covariance ``shape``.
        shape: covariance of the noise in units of σ² (d, d).
    """

    directions: Floats
    noise: Floats
    shape: Floats

    def place(self, level: Level, array: Array = new) -> Samples:
        """The points x = c + r u + σ z of a level, (b, d, n), and the noise that estimators are told of them."""
        return Samples(form(self._placed([level]), array("points", self.noise.shape)), self.told(level.noise))

    def place_each(self, levels: Sequence[Level]) -> Samples:
        """The points of several levels, which are formed where they are read: each trial's first, then the next one's.

        The noise must be isotropic.
        """
        return Samples(self._placed(levels), np.tile([level.noise for level in levels], len(self.noise)))

    def _placed(self, levels: Sequence[Level]) -> Placed:
        center, radius, sigma = (np.array(values) for values in zip(*((c, r, s) for s, r, c in levels), strict=True))
        return Placed(self.directions, self.noise, center, radius, sigma)

    def told(self, noise: float) -> float | Floats:
        """The noise that estimators are told: σ, or a covariance (d, d) if it is not isotropic."""
        return noise if np.array_equal(self.shape, np.eye(len(self.shape))) else noise**2 * self.shape

    def only(self, trial: int) -> "Draws":
        """One trial of the batch, counted from its first."""
        return Draws(self.directions[trial : trial + 1], self.noise[trial : trial + 1], self.shape)

    def unit_bound(self) -> Floats:
        """The Cramér-Rao bound at σ = 1 of the realised directions (b, d+1, d+1).

        It is exact at tiny angles, because it is formed from heights: the sign of u₁ drops out of the variances,
        and its offset from the mean.
        """
        _, d, n = self.directions.shape
        if np.array_equal(self.shape, np.eye(d)):
            weights = np.ones((1, n))
        else:
            u = self.directions.swapaxes(1, 2).copy()
            u[:, :, 0] = 1.0 - u[:, :, 0]
            weights = normal_weights(u, self.shape)
        sums, mean, scatter = weighted_scatter(self.directions, weights)
        scatter[:, 0, 1:] *= -1.0
        scatter[:, 1:, 0] *= -1.0
        mean[:, 0] = 1.0 - mean[:, 0]
        return bound_from_scatter(sums, mean, scatter)


def draw(study: Study, batches: Sequence[Batch], array: Array = new) -> Draws:
    """Draw batches of equal cells from their named streams."""
    d, samples, angle = study.dimension, batches[0].samples, math.radians(batches[0].angle)
    trials = sum(batch.skip + batch.trials for batch in batches)
    directions, noise = array("directions", (trials, d, samples)), array("noise", (trials, d, samples))
    used = np.ones(trials, dtype=bool)
    first = 0
    for batch in batches:
        part = slice(first, first + batch.skip + batch.trials)
        cap.draw(lanes(study.seed, *batch.stream), angle, directions[part], noise[part])
        used[first : first + batch.skip] = False
        first = part.stop
    if not used.all():
        directions, noise = directions[used], noise[used]
    covariance = np.eye(d)
    if study.noise_shape is not None:
        covariance = np.array(study.noise_shape)
        noise = np.linalg.cholesky(covariance) @ noise
    return Draws(directions, noise, covariance)
