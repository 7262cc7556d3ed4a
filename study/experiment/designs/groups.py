"""Groups of cells that share draws, and the units of work that they are cut into."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Protocol, Self

from study.experiment.designs.cells import Batch, Cell, Unit
from study.experiment.streams import Name


class Group(Protocol):
    """Cells that share draws; or the trials of a random design, each of which is a cell of its own."""

    @property
    def stream(self) -> Name:
        """Name of the draws, without the number of the block."""

    @property
    def cells(self) -> tuple[Cell, ...]:
        """The cells; none if every trial draws its own."""

    @property
    def samples(self) -> int:
        """Number of samples of each trial; 0 if every trial draws its own."""

    @property
    def width(self) -> int:
        """Number of data sets of a trial: one for each cell."""

    @property
    def size(self) -> int:
        """Number of trials in a block, which are drawn from one pair of streams."""

    @property
    def levels(self) -> int:
        """Number of levels at which the draws are placed and fitted."""

    @property
    def digest(self) -> bytes:
        """Digest of all that determines the draws and the cells, without the study's seed."""

    def trials_per_unit(self, levels: int) -> int:
        """Number of trials in a unit, if each is fitted at so many levels."""

    def batches(self, first: int, last: int) -> Iterator[Batch]:
        """The batches that hold the trials from first to before last."""

    def places(self, first: int, last: int) -> Iterator[tuple[Cell, int, int]]:
        """The cells of the trials from first to before last, each with its first trial and the one after its last."""

    def sizes(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        """Numbers of samples of the trials from first to before last, each with the number of such trials."""

    def load(self, first: int, last: int) -> tuple[int, int]:
        """Numbers of samples and of batches that are drawn for the trials from first to before last."""

    def only(self, cells: Collection[Cell]) -> Self:
        """The same group with some of its cells."""

    def shared(self, other: Self) -> tuple[Self | None, Self | None]:
        """Split off the cells that another group of the same stream has too: those and the rest, None if empty."""


@dataclass(frozen=True)
class Span:
    """A unit before its batches are made: some trials of a group, so light that a million of them fit in memory.

    Attributes:
        group: the cells.
        first: number of the first trial.
        last: one more than that of the last.
    """

    group: Group
    first: int
    last: int

    @property
    def rows(self) -> int:
        """Number of data sets: trials times cells."""
        return (self.last - self.first) * self.group.width

    @property
    def words(self) -> str:
        """The unit for a message: ``trials 0 to 99 of 4 cells with N = 20``."""
        cells, trials = self.group.cells, f"trials {self.first:,} to {self.last - 1:,}"
        count = "1 cell" if len(cells) == 1 else f"{len(cells):,} cells"
        return f"{trials} of {count} with N = {self.group.samples:,}" if cells else trials

    def unit(self) -> Unit:
        """The unit."""
        return Unit(tuple(self.group.batches(self.first, self.last)))
