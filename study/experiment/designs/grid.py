"""A grid: every combination of the listed values is a cell of so many trials."""

import hashlib
import math
import operator
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, product
from typing import Annotated, Any, Literal

from pydantic import Field, create_model

from study.experiment.conditions import CENTER, CONDITIONS, NOISE, RADIUS, SAMPLES, Condition, Value
from study.experiment.designs.cells import Batch, Cell, further
from study.experiment.designs.design import Design
from study.experiment.designs.fields import axes
from study.experiment.designs.groups import Group
from study.experiment.streams import Name

BLOCK_SAMPLES = 2**15
BLOCK_TRIALS = 1000
_SAMPLES_PER_UNIT = 8_000_000
_FITS_PER_UNIT = 20_000
"""Data sets of a unit, of any number of samples: its rows lie in memory until they are written."""


class Grid(Design):
    """A grid's entries besides its axes, and what may be asked of it."""

    kind: Literal["grid"]
    draws: Literal["shared", "independent"] = "shared"
    most_samples: Annotated[int, Field(ge=1)] | None = None
    """Cells of many samples have fewer trials: so many that trials times samples do not exceed this."""
    one_trial_a_cell = False

    def cells(self) -> int:
        """Number of combinations."""
        return math.prod(len(values) for values in self.given().values())

    def trials_of(self, samples: int) -> int:
        """Number of trials of each cell of so many samples."""
        return self.trials if self.most_samples is None else max(1, min(self.trials, self.most_samples // samples))

    def least_samples(self) -> int:
        """The smallest number of samples listed."""
        return min(map(int, self.given()[SAMPLES.name]))

    def values(self, condition: Condition) -> tuple[Value, ...]:
        """The values that a condition takes, also those of σ where σ/r is listed, and the reverse."""
        given: dict[str, tuple[Value, ...]] = self.given()
        if condition.name in given:
            return given[condition.name]
        if condition.alternative:
            change = operator.mul if condition is NOISE else operator.truediv
            other = given.get(condition.alternative, ())
            return tuple(change(float(v), float(r)) for v, r in product(other, given[RADIUS.name]))
        return () if condition.default is None else (condition.default,)

    def independent(self) -> bool:
        """Whether every cell has draws of its own."""
        return self.draws == "independent" or self.cells() == 1

    def same_draws(self, other: Design) -> bool:
        """Whether the other is a grid whose cells share their draws in the same way."""
        return _sharing(self) == _sharing(other)

    def groups(self, seed: int, dimension: int) -> Iterator["GridGroup"]:
        """The cells of equal numbers of samples and angles, and whatever else is drawn; each by itself if need be."""
        given = self.given()
        apart = [name for name in given if CONDITIONS[name].own_draws]
        together = [name for name in given if name not in apart]
        for drawn in product(*(given[name] for name in apart)):
            common = dict(zip(apart, drawn, strict=True))
            placed = product(*(given[name] for name in together))
            cells = tuple(_cell(common | dict(zip(together, values, strict=True)), dimension) for values in placed)
            name: Name = ("draw", cells[0].samples, cells[0].angle, dimension, *chain(*further(common)))
            if self.draws == "shared":
                yield GridGroup(name, cells)
            else:
                yield from (GridGroup((*name, cell.name), (cell,)) for cell in cells)

    def _unwritten(self) -> set[str]:
        return super()._unwritten() | ({"most_samples"} if self.most_samples is None else set())


Axes: Any = create_model("Axes", __base__=Design, __module__=__name__, **axes())
GridDesign: type[Grid] = create_model("GridDesign", __base__=(Grid, Axes), __module__=__name__)
"""The entries of a grid: kind and trials, the axes, and the others, in which order they are in the canonical config."""


@dataclass(frozen=True)
class GridGroup:
    """Cells of a grid that are served from the same draws.

    Attributes:
        stream: name of their draws, but for the number of the block.
        cells: conditions, all of the same number of samples and angle.
    """

    stream: Name
    cells: tuple[Cell, ...]

    @property
    def samples(self) -> int:
        """Number of samples of each trial."""
        return self.cells[0].samples

    @property
    def width(self) -> int:
        """Number of cells."""
        return len(self.cells)

    @cached_property
    def size(self) -> int:
        """Trials in a block, which share one pair of streams."""
        return block_trials(self.samples)

    @cached_property
    def levels(self) -> int:
        """How many times the draws are placed and fitted."""
        return len({cell.level for cell in self.cells}) if len(self.cells) > 1 else 1

    @cached_property
    def digest(self) -> bytes:
        """Stands for all that determines the draws and conditions, but for the study's seed."""
        values = [(c.samples, c.noise, c.angle, c.radius, c.center, *c.further) for c in self.cells]
        return hashlib.blake2b(repr((self.stream, self.size, values)).encode(), digest_size=16).digest()

    def trials_per_unit(self, levels: int) -> int:
        """Whole blocks, so many that a unit is worth being sent to a worker and its rows fit in memory."""
        enough = -(-_SAMPLES_PER_UNIT // (self.size * self.samples * levels))
        return self.size * min(enough, max(1, _FITS_PER_UNIT // (self.size * self.width)))

    def batches(self, first: int, last: int) -> Iterator[Batch]:
        """The batches that hold the trials from first to before last."""
        for block in range(first // self.size, -(-last // self.size)):
            begin, start = block * self.size, max(first, block * self.size)
            trials = min(last, begin + self.size) - start
            yield Batch((*self.stream, block), start, trials, self.cells, skip=start - begin)

    def places(self, first: int, last: int) -> Iterator[tuple[Cell, int, int]]:
        """Every cell, with all of these trials."""
        return ((cell, first, last) for cell in self.cells)

    def load(self, first: int, last: int) -> tuple[int, int]:
        """Samples drawn for these trials, and batches."""
        return (last - first) * self.samples, -(-last // self.size) - first // self.size

    def only(self, cells: Collection[Cell]) -> "GridGroup":
        """The group with some of its cells, in its own order."""
        return GridGroup(self.stream, tuple(cell for cell in self.cells if cell in cells))

    def shared(self, other: Group) -> tuple["GridGroup | None", "GridGroup | None"]:
        """The part whose cells another group of the same stream has too, and the rest; None for what is empty."""
        known = frozenset(other.cells)
        some, rest = self.only(known), self.only(frozenset(self.cells) - known)
        if some.cells and rest.cells:
            return some, rest
        return (self, None) if some.cells else (None, self)


def block_trials(samples: int) -> int:
    """How many trials share one pair of streams; a function of the number of samples alone."""
    return max(1, min(BLOCK_TRIALS, BLOCK_SAMPLES // samples))


def diagonal_center(distance: float, dimension: int) -> tuple[float, ...]:
    """Centre of a grid's cells: at a distance from the origin, along the main diagonal."""
    return (distance / math.sqrt(dimension),) * dimension


def _cell(values: Mapping[str, Value], dimension: int) -> Cell:
    """A combination of values as a cell, fitted in a unit of about its radius."""
    scale = float(f"1e{math.floor(math.log10(float(values[RADIUS.name])))}")
    return Cell.of(values, diagonal_center(float(values[CENTER.name]), dimension), scale)


def _sharing(design: Design) -> dict[str, object]:
    return design.model_dump(include={"kind", "draws"})
