"""Progress of the cells that share their draws: which of them are open, and why the others are not."""

import math

from study.experiment.designs.cells import Cell
from study.experiment.designs.groups import Group, Span
from study.runs.adaptive.cell_measures import CellPrecision

TARGET, CAP, BUDGET = "target", "cap", "budget"
NOTHING = CellPrecision(0, "", math.nan, math.nan, math.nan, False)
"""Precision of a cell before its first checkpoint."""


class GroupProgress:
    """Progress of a group of cells through its checkpoints.

    Args:
        group: all of its cells.
        checkpoints: numbers of trials at which the cells are measured.

    Attributes:
        stages: trials from one checkpoint to the next, of the cells that were open then. The cells of the last one are
            not measured yet, or no cell is open any more.
        found: the last precision of each cell.
        reasons: for each cell that is not open any more, why.
    """

    def __init__(self, group: Group, checkpoints: list[int]) -> None:
        self.group, self.checkpoints = group, checkpoints
        self.restart()

    def restart(self) -> None:
        """Forget all measures, and begin at the first checkpoint."""
        self.stages = [Span(self.group, 0, self.checkpoints[0])]
        self.found: dict[Cell, CellPrecision] = {}
        self.reasons: dict[Cell, str] = {}

    @property
    def open(self) -> bool:
        """True if a cell is to have more trials."""
        return len(self.reasons) < len(self.group.cells)

    def take(self, cell: Cell, precision: CellPrecision) -> None:
        """Note a cell's precision, and close the cell if it needs, or may have, no more trials."""
        self.found[cell] = precision
        if precision.reached:
            self.reasons[cell] = TARGET
        elif precision.trials == self.checkpoints[-1]:
            self.reasons[cell] = CAP

    def go_on(self) -> None:
        """Begin the next stage, with the open cells."""
        left = {cell for cell in self.group.cells if cell not in self.reasons}
        last = self.stages[-1].last
        self.stages.append(Span(self.group.only(left), last, self.checkpoints[len(self.stages)]))

    def stop(self) -> None:
        """Leave out the last stage, and close all cells."""
        self.stages.pop()
        for cell in self.group.cells:
            self.reasons.setdefault(cell, BUDGET)
