"""Data sets on which one's own estimators are checked: sound ones, and degenerate ones."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from study.sphere.types import Floats

NOISE = 0.01
_SETS = 6


class CheckCase(NamedTuple):
    """One sound data set about a sphere of radius 1.

    Attributes:
        dimension: d.
        number: of samples, N.
        seed: of its random numbers.
        points: with noise `NOISE` (n, d).
        exact: the same without noise (n, d).
        center: of the sphere (d,).
    """

    dimension: int
    number: int
    seed: int
    points: Floats
    exact: Floats
    center: Floats

    @property
    def rng(self) -> np.random.Generator:
        """A generator for further numbers."""
        return np.random.default_rng(1000 + self.seed)

    def __str__(self) -> str:
        return f"d = {self.dimension}, N = {self.number}, seed {self.seed}"


def sound_cases(dimension: int) -> Iterator[CheckCase]:
    """Sound data sets, small ones first: directions spread over the sphere, ten times as far as the noise at least."""
    for seed in range(_SETS):
        rng = np.random.default_rng(seed)
        n = dimension + 5 + 9 * seed
        while True:
            u = rng.standard_normal((n, dimension))
            u /= np.linalg.norm(u, axis=1, keepdims=True)
            if np.linalg.svd(u - u.mean(axis=0), compute_uv=False)[-1] > 0.3 * np.sqrt(n):
                break
        center = rng.standard_normal(dimension)
        exact = center + u
        yield CheckCase(dimension, n, seed, exact + NOISE * rng.standard_normal(u.shape), exact, center)


def degenerate_sets(dimension: int) -> Iterator[tuple[str, Floats]]:
    """Point sets that determine no sphere, or hardly, each with words for it."""
    rng = np.random.default_rng(5)
    plane = rng.standard_normal((12, dimension))
    plane[:, -1] = 0.0
    lines = np.outer(np.arange(12.0), np.ones(dimension))
    yield "12 equal points", np.ones((12, dimension))
    yield "two points, each six times", np.repeat(np.eye(2, dimension), 6, axis=0)
    yield "points on a line", lines
    yield "points in a plane" if dimension == 3 else "points on an axis", plane
    yield f"d + 1 = {dimension + 1} points", rng.standard_normal((dimension + 1, dimension))
    yield "a point at infinity", np.where(lines == 3.0, np.inf, plane)
    yield "coordinates of 1e200", 1e200 * rng.standard_normal((12, dimension))
    yield "coordinates of 1e-200", 1e-200 * rng.standard_normal((12, dimension))
