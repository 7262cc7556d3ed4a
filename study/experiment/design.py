"""From a study to its cells, and to the batches of trials that are drawn together."""

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np

from study.experiment.conditions import GridDesign, RandomDesign
from study.experiment.config import Study
from study.experiment.laws import LogUniform, Uniform
from study.experiment.streams import Name, stream

BLOCK_SAMPLES = 2**15
BLOCK_TRIALS = 1000
_DESIGN_BLOCK = 1024
_TRIALS_PER_UNIT = 25
_SAMPLES_PER_UNIT = 8_000_000


class Level(NamedTuple):
    """Where draws are placed: noise σ, radius r and centre c, in a unit of its own."""

    noise: float
    radius: float
    center: tuple[float, ...]


@dataclass(frozen=True)
class Cell:
    """One condition.

    Attributes:
        samples: number of samples N.
        noise: σ, standard deviation of each coordinate.
        angle: confinement half-angle φ in degrees.
        radius: r, in the unit of the noise.
        center: c (d,).
        scale: the unit in which its points are formed and fitted. Fits do not depend on it but for rounding, so cells
            of a grid whose radii are a power of ten apart are fitted once.
    """

    samples: int
    noise: float
    angle: float
    radius: float
    center: tuple[float, ...]
    scale: float = 1.0

    @cached_property
    def name(self) -> str:
        """Ten hexadecimal digits that stand for the condition, wherever it occurs."""
        numbers = [self.samples, *(float(v).hex() for v in (self.noise, self.angle, self.radius, *self.center))]
        return hashlib.blake2b(repr(numbers).encode(), digest_size=5).hexdigest()

    @cached_property
    def level(self) -> Level:
        """Noise, radius and centre in units of ``scale``."""
        if self.scale == 1.0:
            return Level(self.noise, self.radius, self.center)
        center = tuple(_rounded(v / self.scale) for v in self.center)
        return Level(_rounded(self.noise / self.scale), _rounded(self.radius / self.scale), center)

    @property
    def distance(self) -> float:
        """Distance |c| of the centre from the origin."""
        return math.hypot(*self.center)


@dataclass(frozen=True)
class Batch:
    """Trials drawn together, from one pair of streams, and the cells that are served from the draw.

    Attributes:
        stream: name of the draw.
        first: number of the first trial.
        trials: how many there are.
        cells: conditions, all of the same number of samples and angle.
    """

    stream: Name
    first: int
    trials: int
    cells: tuple[Cell, ...]

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


def units(study: Study) -> Iterator[Unit]:
    """The study's work, in the order of its tables; depends on nothing but the config."""
    if isinstance(study.design, RandomDesign):
        yield from _random_units(study, study.design)
    else:
        yield from _grid_units(study, study.design)


def diagonal_center(distance: float, dimension: int) -> tuple[float, ...]:
    """Centre of a grid's cells: at a distance from the origin, along the main diagonal."""
    return (distance / math.sqrt(dimension),) * dimension


def block_trials(samples: int) -> int:
    """How many trials share one pair of streams; a function of the number of samples alone."""
    return max(1, min(BLOCK_TRIALS, BLOCK_SAMPLES // samples))


def _grid_units(study: Study, design: GridDesign) -> Iterator[Unit]:
    noises = design.noise or design.noise_over_radius or ()
    relative = design.noise is None
    for samples, angle in product(design.samples, design.angle):
        cells = tuple(
            Cell(
                samples,
                noise * radius if relative else noise,
                angle,
                radius,
                diagonal_center(c, study.dimension),
                scale=float(f"1e{math.floor(math.log10(radius))}"),
            )
            for noise, radius, c in product(noises, design.radius, design.center)
        )
        groups = [cells] if design.draws == "shared" else [(cell,) for cell in cells]
        for group in groups:
            name: Name = ("draw", samples, angle, study.dimension)
            if design.draws == "independent":
                name = (*name, group[0].name)
            size = block_trials(samples)
            batches: list[Batch] = []
            load, most = 0, math.inf if study.keep == "summary" else _SAMPLES_PER_UNIT
            trials = design.trials_of(samples)
            levels = 1 if study.route == "moments" else len({cell.level for cell in group})
            for block, first in enumerate(range(0, trials, size)):
                batches.append(Batch((*name, block), first, min(size, trials - first), group))
                load += batches[-1].trials * samples * levels
                if load >= most:
                    yield Unit(tuple(batches))
                    batches, load = [], 0
            if batches:
                yield Unit(tuple(batches))


def _random_units(study: Study, design: RandomDesign) -> Iterator[Unit]:
    for first in range(0, design.trials, _TRIALS_PER_UNIT):
        trials = range(first, min(design.trials, first + _TRIALS_PER_UNIT))
        yield Unit(tuple(Batch(("trial", i), i, 1, (random_cell(study, design, i),)) for i in trials))


def random_cell(study: Study, design: RandomDesign, trial: int) -> Cell:
    """The condition that a trial of a random design drew. Every quantity has a stream of its own."""
    block, index = divmod(trial, _DESIGN_BLOCK)

    def value(quantity: str) -> float:
        law = getattr(design, quantity)
        number: float = law.at(_uniforms(study.seed, quantity, block)[index])
        return _rounded(number) if isinstance(law, Uniform | LogUniform) else number

    radius = value("radius")
    noise = value("noise") if design.noise is not None else value("noise_over_radius") * radius
    heading = stream(study.seed, "design", "heading", trial).standard_normal(study.dimension)
    center = value("center") * heading / np.linalg.norm(heading)
    return Cell(round(value("samples")), noise, value("angle"), radius, tuple(_rounded(v) for v in center))


def _rounded(value: float) -> float:
    """Twelve digits: readable, and the same on machines whose exp differs in the last bit. -0.0 is 0.0."""
    return float(f"{value:.12g}") + 0.0


@lru_cache(maxsize=64)
def _uniforms(seed: int, quantity: str, block: int) -> tuple[float, ...]:
    """Uniform numbers of a quantity for a block of trials."""
    return tuple(stream(seed, "design", quantity, block).random(_DESIGN_BLOCK).tolist())
