"""Groups of cells that are served from the same draws, and the units of work that they are cut into."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Protocol, Self

from study.experiment.designs.cells import Batch, Cell, Unit
from study.experiment.streams import Name


class Group(Protocol):
    """Cells that are served from the same draws, or the trials of a random design, each of them a cell of its own."""

    @property
    def stream(self) -> Name:
        """Name of the draws, but for the number of the block."""

    @property
    def cells(self) -> tuple[Cell, ...]:
        """The cells; none where every trial draws its own."""

    @property
    def samples(self) -> int:
        """Number of samples of each trial; 0 where every trial draws its own."""

    @property
    def width(self) -> int:
        """Data sets of a trial: one for each cell that it is placed in."""

    @property
    def size(self) -> int:
        """Trials in a block, which share one pair of streams."""

    @property
    def levels(self) -> int:
        """How many times the draws are placed and fitted."""

    @property
    def digest(self) -> bytes:
        """Stands for all that determines the draws and conditions, but for the study's seed."""

    def trials_per_unit(self, levels: int) -> int:
        """Number of trials that make a unit, where each is fitted at so many levels."""

    def batches(self, first: int, last: int) -> Iterator[Batch]:
        """The batches that hold the trials from first to before last."""

    def places(self, first: int, last: int) -> Iterator[tuple[Cell, int, int]]:
        """The cells of the trials from first to before last, each with its own first and last."""

    def load(self, first: int, last: int) -> tuple[int, int]:
        """Samples drawn for these trials, and batches."""

    def only(self, cells: Collection[Cell]) -> Self:
        """The group with some of its cells, in its own order."""

    def shared(self, other: Self) -> tuple[Self | None, Self | None]:
        """The part whose cells another group of the same stream has too, and the rest; None for what is empty."""


@dataclass(frozen=True)
class Span:
    """A unit before its batches are made, so light that a million of them may wait: trials of a group.

    Attributes:
        group: the conditions.
        first: number of the first trial.
        last: one more than that of the last.
    """

    group: Group
    first: int
    last: int

    @property
    def rows(self) -> int:
        """Data sets: trials times cells."""
        return (self.last - self.first) * self.group.width

    def unit(self) -> Unit:
        """The unit."""
        return Unit(tuple(self.group.batches(self.first, self.last)))
