"""Cells, each of them one combination of conditions, and the batches of trials that are drawn together."""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from study.experiment.conditions import SILENT, Value
from study.experiment.streams import Name

Further = tuple[tuple[str, Value], ...]
"""Names and values of silent conditions that are not at their defaults, in the order of the table."""


class Level(NamedTuple):
    """The noise σ, radius r and centre c with which draws are placed, in the unit of a cell, and further conditions."""

    sigma: float
    radius: float
    center: tuple[float, ...]
    further: Further = ()


@dataclass(frozen=True)
class Cell:
    """One combination of the conditions of the experiment.

    Attributes:
        samples: number of samples N.
        noise: σ, standard deviation of each coordinate.
        angle: confinement half-angle φ in degrees.
        radius: r, in the unit of the noise.
        center: c (d,).
        scale: the unit in which the points are formed and fitted. Fits depend on it by rounding alone, so cells of a
            grid whose radii differ by a power of ten are fitted once.
        further: the silent conditions, see `Further`.
    """

    samples: int
    noise: float
    angle: float
    radius: float
    center: tuple[float, ...]
    scale: float = 1.0
    further: Further = ()

    @classmethod
    def of(cls, values: Mapping[str, Value], center: tuple[float, ...], scale: float = 1.0) -> "Cell":
        """Make a cell from the values of its conditions by name, of which the noise may be relative to the radius."""
        radius = float(values["radius"])
        sigma = float(values["noise"]) if "noise" in values else float(values["noise_over_radius"]) * radius
        return cls(int(values["samples"]), sigma, float(values["angle"]), radius, center, scale, further(values))

    @cached_property
    def name(self) -> str:
        """Digest of the conditions, ten hexadecimal digits; it is the same in every study."""
        numbers = [self.samples, *(float(v).hex() for v in (self.noise, self.angle, self.radius, *self.center))]
        return hashlib.blake2b(repr([*numbers, *self.further]).encode(), digest_size=5).hexdigest()

    @cached_property
    def level(self) -> Level:
        """The level at which draws are placed, in units of ``scale``."""
        if self.scale == 1.0:
            return Level(self.noise, self.radius, self.center, self.further)
        center = tuple(rounded(v / self.scale) for v in self.center)
        return Level(rounded(self.noise / self.scale), rounded(self.radius / self.scale), center, self.further)

    @property
    def distance(self) -> float:
        """Distance |c| of the centre from the origin."""
        return math.hypot(*self.center)

    @property
    def values(self) -> dict[str, Value]:
        """The values of all stored conditions by name."""
        known = {
            "samples": self.samples,
            "noise": self.noise,
            "angle": self.angle,
            "radius": self.radius,
            "center": self.distance,
        }
        return known | {c.name: c.default for c in SILENT if c.default is not None} | dict(self.further)


@dataclass(frozen=True)
class Batch:
    """Trials drawn together from one pair of streams, and the cells in which they are placed.

    Attributes:
        stream: name of the draw.
        first: number of the first trial.
        trials: number of trials.
        cells: the cells.
        skip: number of trials before the first, which are drawn from the same streams and left out.
    """

    stream: Name
    first: int
    trials: int
    cells: tuple[Cell, ...]
    skip: int = 0

    @property
    def samples(self) -> int:
        """Number of samples of each trial."""
        return self.cells[0].samples

    @property
    def angle(self) -> float:
        """Confinement half-angle in degrees."""
        return self.cells[0].angle


@dataclass(frozen=True)
class Unit:
    """The work that is given to a worker at once: batches in order."""

    batches: tuple[Batch, ...]


def further(values: Mapping[str, Value]) -> Further:
    """Select the silent conditions that are not at their defaults."""
    return tuple((c.name, values[c.name]) for c in SILENT if values.get(c.name, c.default) != c.default)


def rounded(value: float) -> float:
    """Round to twelve digits: readable, and the same on machines whose exp differs in the last bit. -0.0 is 0.0."""
    return float(f"{value:.12g}") + 0.0
