"""Cells, each of them one condition of the experiment, and the batches of trials that are drawn together for them."""

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
    """How draws are placed: noise σ, radius r and centre c, in a unit of its own, and the conditions besides."""

    sigma: float
    radius: float
    center: tuple[float, ...]
    further: Further = ()


@dataclass(frozen=True)
class Cell:
    """One condition of the experiment.

    Attributes:
        samples: number of samples N.
        noise: σ, standard deviation of each coordinate.
        angle: confinement half-angle φ in degrees.
        radius: r, in the unit of the noise.
        center: c (d,).
        scale: the unit in which its points are formed and fitted. Fits do not depend on it but for rounding, so cells
            of a grid whose radii are a power of ten apart are fitted once.
        further: conditions besides these, see `Further`.
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
        """Ten hexadecimal digits that stand for the condition, wherever it occurs."""
        numbers = [self.samples, *(float(v).hex() for v in (self.noise, self.angle, self.radius, *self.center))]
        return hashlib.blake2b(repr([*numbers, *self.further]).encode(), digest_size=5).hexdigest()

    @cached_property
    def level(self) -> Level:
        """How its draws are placed, in units of ``scale``."""
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
        """The value of every stored condition by name."""
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
    """Trials drawn together, from one pair of streams, and the cells that are served from the draw.

    Attributes:
        stream: name of the draw.
        first: number of the first trial.
        trials: how many there are.
        cells: conditions that share draws.
        skip: how many trials of the same streams come before the first: they are drawn and left out.
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
    """What a worker is given: batches, in order."""

    batches: tuple[Batch, ...]


def further(values: Mapping[str, Value]) -> Further:
    """The silent conditions among some values that are not at their defaults."""
    return tuple((c.name, values[c.name]) for c in SILENT if values.get(c.name, c.default) != c.default)


def rounded(value: float) -> float:
    """Twelve digits: readable, and the same on machines whose exp differs in the last bit. -0.0 is 0.0."""
    return float(f"{value:.12g}") + 0.0
