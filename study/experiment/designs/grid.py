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
    """A grid, of which `GridDesign` adds the axes."""

    kind: Literal["grid"]
    """Every combination of the values is a cell."""
    draws: Literal["shared", "independent"] = "shared"
    """Cells of equal samples and angle share their draws, so that differences are precise; or each cell has its own."""
    most_samples: Annotated[int, Field(ge=1)] | None = None
    """Limit of trials times samples: cells of many samples have fewer trials."""
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
        """The values that a condition takes: also those of σ if σ/r is listed, and the reverse."""
        given: dict[str, tuple[Value, ...]] = self.given()
        if condition.name in given:
            return given[condition.name]
        if condition.alternative:
            change = operator.mul if condition is NOISE else operator.truediv
            other = given.get(condition.alternative, ())
            return tuple(change(float(v), float(r)) for v, r in product(other, given[RADIUS.name]))
        return () if condition.default is None else (condition.default,)

    def independent(self) -> bool:
        """True if every cell has draws of its own."""
        return self.draws == "independent" or self.cells() == 1

    def same_draws(self, other: Design) -> bool:
        """True if the other is a grid whose cells share draws in the same way."""
        return _sharing(self) == _sharing(other)

    def groups(self, seed: int, dimension: int) -> Iterator["GridGroup"]:
        """A group for each number of samples, angle and other drawn condition; or one for each cell, if independent."""
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
"""A grid with all of its entries: kind and trials, then the axes, then the others. The digest needs this order."""


@dataclass(frozen=True)
class GridGroup:
    """Cells of a grid that share draws.

    Attributes:
        stream: name of the draws, without the number of the block.
        cells: the cells, all of the same number of samples and angle.
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
        """Number of trials in a block, which are drawn from one pair of streams."""
        return block_trials(self.samples)

    @cached_property
    def levels(self) -> int:
        """Number of levels at which the draws are placed and fitted."""
        return len({cell.level for cell in self.cells}) if len(self.cells) > 1 else 1

    @cached_property
    def digest(self) -> bytes:
        """Digest of all that determines the draws and the cells, without the study's seed."""
        values = [(c.samples, c.noise, c.angle, c.radius, c.center, *c.further) for c in self.cells]
        return hashlib.blake2b(repr((self.stream, self.size, values)).encode(), digest_size=16).digest()

    def trials_per_unit(self, levels: int) -> int:
        """Whole blocks: enough for a worker to be busy, and so few that the unit's rows fit in memory."""
        enough = -(-_SAMPLES_PER_UNIT // (self.size * self.samples * levels))
        return self.size * min(enough, max(1, _FITS_PER_UNIT // (self.size * self.width)))

    def batches(self, first: int, last: int) -> Iterator[Batch]:
        """The batches that hold the trials from first to before last."""
        for block in range(first // self.size, -(-last // self.size)):
            begin, start = block * self.size, max(first, block * self.size)
            trials = min(last, begin + self.size) - start
            yield Batch((*self.stream, block), start, trials, self.cells, skip=start - begin)

    def places(self, first: int, last: int) -> Iterator[tuple[Cell, int, int]]:
        """Every cell, each with all of these trials."""
        return ((cell, first, last) for cell in self.cells)

    def sizes(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        """The one number of samples, with the number of trials from first to before last."""
        yield self.samples, last - first

    def load(self, first: int, last: int) -> tuple[int, int]:
        """Numbers of samples and of batches that are drawn for the trials from first to before last."""
        return (last - first) * self.samples, -(-last // self.size) - first // self.size

    def only(self, cells: Collection[Cell]) -> "GridGroup":
        """The same group with some of its cells."""
        return GridGroup(self.stream, tuple(cell for cell in self.cells if cell in cells))

    def shared(self, other: Group) -> tuple["GridGroup | None", "GridGroup | None"]:
        """Split off the cells that another group of the same stream has too: those and the rest, None if empty."""
        known = frozenset(other.cells)
        some, rest = self.only(known), self.only(frozenset(self.cells) - known)
        if some.cells and rest.cells:
            return some, rest
        return (self, None) if some.cells else (None, self)


def block_trials(samples: int) -> int:
    """Number of trials that are drawn from one pair of streams; it depends on the number of samples alone."""
    return max(1, min(BLOCK_TRIALS, BLOCK_SAMPLES // samples))


def diagonal_center(distance: float, dimension: int) -> tuple[float, ...]:
    """Centre of a grid's cells: on the main diagonal, at a distance from the origin."""
    return (distance / math.sqrt(dimension),) * dimension


def _cell(values: Mapping[str, Value], dimension: int) -> Cell:
    """Make the cell of a combination of values; it is fitted in a unit of about its radius."""
    scale = float(f"1e{math.floor(math.log10(float(values[RADIUS.name])))}")
    return Cell.of(values, diagonal_center(float(values[CENTER.name]), dimension), scale)


def _sharing(design: Design) -> dict[str, object]:
    return design.model_dump(include={"kind", "draws"})
