"""Draw a batch and form its points: one draw of unit directions u and unit noise z serves every σ, r and c."""

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from study.estimators import Samples
from study.experiment.config import Study
from study.experiment.designs.cells import Batch, Level
from study.experiment.noise.further_numbers import FurtherNumbers, Source
from study.experiment.noise.gaussian import NoiseLaw
from study.experiment.noise.laws import departures
from study.experiment.streams import lanes
from study.sphere import cap
from study.sphere.layouts import Placed, form
from study.sphere.types import Floats

Array = Callable[[str, tuple[int, ...]], Floats]
"""Makes an array of a name and shape, with any content."""


def new(name: str, shape: tuple[int, ...]) -> Floats:
    """A fresh array; the name does not matter."""
    return np.empty(shape)


class Workspace(threading.local):
    """Reuse arrays within a thread: fresh memory costs as much as the arithmetic on it.

    An array is valid until the next one of the same name is requested.
    """

    def __init__(self) -> None:
        self._arrays: dict[str, Floats] = {}

    def __call__(self, name: str, shape: tuple[int, ...]) -> Floats:
        """An array of a shape, with any content."""
        size = math.prod(shape)
        if name not in self._arrays or self._arrays[name].size < size:
            self._arrays[name] = np.empty(size)
        return self._arrays[name][:size].reshape(shape)


@dataclass(frozen=True)
class Draws:
    """The draws of a batch, before they are placed on any sphere.

    Attributes:
        directions: unit vectors (b, d, n) about the first axis, with the height 1 - u₁ in place of u₁.
        unit_noise: noise at σ = 1 (b, d, n).
        law: the Gaussian law of the noise.
        numbers: further random numbers, for levels with noise of another law or with outliers.
    """

    directions: Floats
    unit_noise: Floats
    law: NoiseLaw
    numbers: FurtherNumbers

    def place(self, level: Level, array: Array = new) -> Samples:
        """Form the points x = c + r u + σ z of a level (b, d, n), with the noise as estimators take it."""
        noise = self.unit_noise
        for departure in departures(dict(level.further)):
            noise = departure.applied(noise, self.numbers)
        points = form(self._placed([level], noise), array("points", noise.shape))
        return Samples(points, self.law.given(level.sigma))

    def place_each(self, levels: Sequence[Level]) -> Samples:
        """Place the draws at several levels: all levels of the first trial, then of the next one.

        The points are formed when they are read. The noise must be normal and isotropic.
        """
        return Samples(
            self._placed(levels, self.unit_noise), np.tile([level.sigma for level in levels], len(self.unit_noise))
        )

    def _placed(self, levels: Sequence[Level], noise: Floats) -> Placed:
        center = np.array([level.center for level in levels])
        radius = np.array([level.radius for level in levels])
        sigma = np.array([level.sigma for level in levels])
        return Placed(self.directions, noise, center, radius, sigma)

    def only(self, trial: int) -> "Draws":
        """One trial of the batch, counted from its first."""
        one = slice(trial, trial + 1)
        return Draws(self.directions[one], self.unit_noise[one], self.law, self.numbers.only(one))

    def unit_bound(self) -> Floats:
        """The Cramér-Rao bound of (c, r) at σ = 1, for the realised directions (b, d+1, d+1), of normal noise."""
        return self.law.unit_bound(self.directions)


def draw(study: Study, batches: Sequence[Batch], array: Array = new) -> Draws:
    """Draw batches of equal cells from their named streams."""
    d, samples, angle = study.dimension, batches[0].samples, math.radians(batches[0].angle)
    trials = sum(batch.skip + batch.trials for batch in batches)
    directions, normals = array("directions", (trials, d, samples)), array("normals", (trials, d, samples))
    used = np.ones(trials, dtype=bool)
    first = 0
    for batch in batches:
        part = slice(first, first + batch.skip + batch.trials)
        cap.draw(lanes(study.seed, *batch.stream), angle, directions[part], normals[part])
        used[first : first + batch.skip] = False
        first = part.stop
    if not used.all():
        directions, normals = directions[used], normals[used]
    law = study.noise_law
    numbers = FurtherNumbers(study.seed, [Source(batch.stream, batch.skip, batch.trials) for batch in batches])
    return Draws(directions, law.unit_noise(normals), law, numbers)
