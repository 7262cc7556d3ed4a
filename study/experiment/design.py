"""From a study to its cells, and to the batches of trials that are drawn together."""

import hashlib
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np

from study.experiment.conditions import GridDesign, RandomDesign
from study.experiment.config import Study
from study.experiment.distributions import LogUniform, Uniform
from study.experiment.streams import Name, stream

BLOCK_SAMPLES = 2**15
BLOCK_TRIALS = 1000
_DESIGN_BLOCK = 1024
_TRIALS_PER_UNIT = 25
_SAMPLES_PER_UNIT = 8_000_000
_FITS_PER_UNIT = 20_000
"""Data sets of a unit, of any number of samples: its rows lie in memory until they are written."""


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


@dataclass(frozen=True)
class GridGroup:
    """Cells of a grid that are served from the same draws.

    Attributes:
        stream: name of their draws, but for the number of the block.
        cells: conditions, all of the same number of samples and angle.
    """

    stream: Name
    cells: tuple[Cell, ...]

    @cached_property
    def size(self) -> int:
        """Trials in a block, which share one pair of streams."""
        return block_trials(self.cells[0].samples)

    @cached_property
    def levels(self) -> int:
        """How many times the draws are placed and fitted."""
        return len({cell.level for cell in self.cells}) if len(self.cells) > 1 else 1

    @cached_property
    def digest(self) -> bytes:
        """Stands for all that determines the draws and conditions, but for the study's seed."""
        values = [(c.samples, c.noise, c.angle, c.radius, c.center) for c in self.cells]
        return _digest((self.stream, self.size, values))

    def batches(self, first: int, last: int) -> Iterator[Batch]:
        """The batches that hold the trials from first to before last."""
        for block in range(first // self.size, -(-last // self.size)):
            begin, start = block * self.size, max(first, block * self.size)
            trials = min(last, begin + self.size) - start
            yield Batch((*self.stream, block), start, trials, self.cells, skip=start - begin)

    def load(self, first: int, last: int) -> tuple[int, int]:
        """Samples drawn for these trials, and batches."""
        return (last - first) * self.cells[0].samples, -(-last // self.size) - first // self.size

    def only(self, cells: Collection[Cell]) -> "GridGroup":
        """The group with some of its cells, in its own order."""
        return GridGroup(self.stream, tuple(cell for cell in self.cells if cell in cells))


@dataclass(frozen=True)
class RandomGroup:
    """The trials of a random design, each of which is a cell of its own.

    Attributes:
        study: the study, of which the seed and the dimension count.
        design: its laws; the number of trials does not count.
    """

    study: Study
    design: RandomDesign

    size = levels = 1

    @cached_property
    def digest(self) -> bytes:
        """Stands for the laws, but for the study's seed."""
        return _digest((_DESIGN_BLOCK, self.design.model_dump_json(exclude={"trials"})))

    @property
    def cells(self) -> tuple[None]:
        """Each trial has one cell, which `batches` draws."""
        return (None,)

    def batches(self, first: int, last: int) -> Iterator[Batch]:
        """A batch for each of the trials from first to before last."""
        for i in range(first, last):
            yield Batch(("trial", i), i, 1, (random_cell(self.study, self.design, i),))

    def load(self, first: int, last: int) -> tuple[int, int]:
        """Samples drawn for these trials, and batches."""
        samples = (_samples(self.study.seed, self.design, i) for i in range(first, last))
        return sum(samples), last - first


@dataclass(frozen=True)
class Span:
    """A unit before its batches are made, so light that a million of them may wait: trials of a group.

    Attributes:
        group: the conditions.
        first: number of the first trial.
        last: one more than that of the last.
    """

    group: GridGroup | RandomGroup
    first: int
    last: int

    @property
    def rows(self) -> int:
        """Data sets: trials times cells."""
        return (self.last - self.first) * len(self.group.cells)

    def unit(self) -> Unit:
        """The unit."""
        return Unit(tuple(self.group.batches(self.first, self.last)))


def units(study: Study) -> Iterator[Unit]:
    """The study's work, in the order of its tables; depends on nothing but the config."""
    return (span.unit() for span in spans(study))


def spans(study: Study) -> Iterator[Span]:
    """The study's units, in the order of its tables, before they are made."""
    return (span for group in groups(study) for span in spans_of(study, group))


def spans_of(study: Study, group: GridGroup | RandomGroup, below: int | None = None) -> Iterator[Span]:
    """The units of a group; those that have trials below a number, if one is given."""
    trials = trials_of(study, group)
    step = _TRIALS_PER_UNIT if isinstance(group, RandomGroup) else group.size * _blocks(study, group)
    for first in range(0, trials if below is None else min(below, trials), step):
        yield Span(group, first, min(trials, first + step))


def trials_of(study: Study, group: GridGroup | RandomGroup) -> int:
    """Number of trials of a group's cells, in a study that may not be the group's own."""
    if isinstance(study.design, RandomDesign) or isinstance(group, RandomGroup):
        return study.design.trials
    return study.design.trials_of(group.cells[0].samples)


def _blocks(study: Study, group: GridGroup) -> int:
    """Blocks of trials in a unit of a group; a summary is made of whole cells, so all are in one."""
    if study.keep == "summary":
        return -(-trials_of(study, group) // group.size)
    levels = 1 if study.route == "moments" else group.levels
    enough = -(-_SAMPLES_PER_UNIT // (group.size * group.cells[0].samples * levels))
    return min(enough, max(1, _FITS_PER_UNIT // (group.size * len(group.cells))))


def diagonal_center(distance: float, dimension: int) -> tuple[float, ...]:
    """Centre of a grid's cells: at a distance from the origin, along the main diagonal."""
    return (distance / math.sqrt(dimension),) * dimension


def block_trials(samples: int) -> int:
    """How many trials share one pair of streams; a function of the number of samples alone."""
    return max(1, min(BLOCK_TRIALS, BLOCK_SAMPLES // samples))


def groups(study: Study) -> Iterator[GridGroup | RandomGroup]:
    """The study's groups of cells that are served from the same draws, in the order of its tables."""
    design = study.design
    if isinstance(design, RandomDesign):
        yield RandomGroup(study, design)
    else:
        yield from _grid_groups(study, design)


def _grid_groups(study: Study, design: GridDesign) -> Iterator[GridGroup]:
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
        name: Name = ("draw", samples, angle, study.dimension)
        if design.draws == "shared":
            yield GridGroup(name, cells)
        else:
            yield from (GridGroup((*name, cell.name), (cell,)) for cell in cells)


def random_cell(study: Study, design: RandomDesign, trial: int) -> Cell:
    """The condition that a trial of a random design drew. Every quantity has a stream of its own."""

    def value(quantity: str) -> float:
        return _value(study.seed, design, quantity, trial)

    radius = value("radius")
    noise = value("noise") if design.noise is not None else value("noise_over_radius") * radius
    heading = stream(study.seed, "design", "heading", trial).standard_normal(study.dimension)
    center = value("center") * heading / np.linalg.norm(heading)
    samples = _samples(study.seed, design, trial)
    return Cell(samples, noise, value("angle"), radius, tuple(_rounded(v) for v in center))


def _samples(seed: int, design: RandomDesign, trial: int) -> int:
    """Number of samples that a trial of a random design drew."""
    return round(_value(seed, design, "samples", trial))


def _value(seed: int, design: RandomDesign, quantity: str, trial: int) -> float:
    law = getattr(design, quantity)
    block, index = divmod(trial, _DESIGN_BLOCK)
    number: float = law.at(_uniforms(seed, quantity, block)[index])
    return _rounded(number) if isinstance(law, Uniform | LogUniform) else number


def _digest(content: object) -> bytes:
    return hashlib.blake2b(repr(content).encode(), digest_size=16).digest()


def _rounded(value: float) -> float:
    """Twelve digits: readable, and the same on machines whose exp differs in the last bit. -0.0 is 0.0."""
    return float(f"{value:.12g}") + 0.0


@lru_cache(maxsize=64)
def _uniforms(seed: int, quantity: str, block: int) -> tuple[float, ...]:
    """Uniform numbers of a quantity for a block of trials."""
    return tuple(stream(seed, "design", quantity, block).random(_DESIGN_BLOCK).tolist())
