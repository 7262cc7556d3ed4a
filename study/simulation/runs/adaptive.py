"""Rounds of an adaptive run: from checkpoint to checkpoint, trials are added to the cells that are still open.

In each round, every group of cells that share their draws goes on to its next checkpoint, with only those cells whose
performance measure is not known well enough: its Monte-Carlo error, for every estimator, is above the target. These
decisions are not stored. They follow from the parts, and a resumed run finds them again. So they depend neither on the
workers nor on interruptions. Once a time budget is spent, a run starts no new work.
"""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from study.simulation.experiment.config import Precision, Study
from study.simulation.experiment.designs import Batch, Cell, Group
from study.simulation.experiment.measures import MeasureColumn
from study.simulation.runs import schemas
from study.simulation.runs.parts import Layout, Parts, shorter
from study.simulation.statistics import Measure, measured

CellBatch = list[tuple[list[Batch], list[Cell]]]
"""Groups of cells, each with the pieces of its trials and the cells to measure."""
COLUMNS = ("radius", "error", "error_1", "bound", "status")
_ROWS = 1 << 20
"""Rows read at a time; those of a single cell if it has more."""


@dataclass(frozen=True)
class CellPrecision:
    """Precision of a cell at a checkpoint.

    Attributes:
        trials: number of its trials.
        estimator: the one that is farthest from the target.
        value: its measure.
        error: the Monte-Carlo error of the measure.
        goal: the largest error that is small enough.
        reached: true if the error of every estimator is small enough.
    """

    trials: int
    estimator: str
    value: float
    error: float
    goal: float
    reached: bool


def measure_cells(
    layout: Layout, parts: Parts, places: Sequence[list[Batch]], precision: Precision
) -> Iterator[tuple[Cell, CellPrecision]]:
    """Find the precision of cells from all of their trials.

    Args:
        layout: the run.
        parts: the stored rows, which have all of these trials.
        places: for each group of cells the pieces of its trials, in order; the last one has the cells to measure.
        precision: the config's section.
    """
    names = precision.estimators or layout.study.estimators
    further = [column for column in layout.study.measured() if precision.measure in column.summaries]
    for batch in _batches(places, len(layout.study.estimators)):
        table = _read(layout, parts, batch, further).to_pandas()
        rows = table.groupby(["cell", "estimator"], observed=True, sort=False).indices
        columns = {name: table[name].to_numpy() for name in table.columns if name not in ("cell", "estimator")}
        for pieces, cells in batch:
            for cell in cells:
                measures: dict[str, Measure] = {}
                for name in names:
                    of_name = {key: values[rows[cell.name, name]] for key, values in columns.items()}
                    measures[name] = measured(precision.measure, of_name, further)
                yield cell, _worst(precision, pieces[-1].last, measures)


def _read(layout: Layout, parts: Parts, batch: CellBatch, further: Sequence[MeasureColumn]) -> pa.Table:
    """Read the rows of some cells, those of each in the order of its trials, with further columns."""
    tables: list[pa.Table] = []
    needed = ["cell", "estimator", *COLUMNS, *(column.name for column in further)]
    order = sorted((index, number) for number, (pieces, _) in enumerate(batch) for index in range(len(pieces)))
    for index, number in order:  # across groups first: what was computed together is stored together
        pieces, cells = batch[number]
        wanted = pa.array([cell.name for cell in cells])
        for _, table in layout.stored(parts, pieces[index], "errors"):
            rows = table.select(needed)
            if len(cells) < len(pieces[index].cells):
                rows = rows.filter(pc.is_in(rows["cell"].cast(pa.string()), wanted))
            tables.append(rows)
    return pa.concat_tables(tables)


def _worst(precision: Precision, trials: int, measures: dict[str, Measure]) -> CellPrecision:
    """Precision of the estimator that is farthest from the target."""

    def distance(name: str) -> float:
        value, error = measures[name]
        goal = precision.goal(value)
        return error / goal if np.isfinite(error) and goal > 0.0 else np.inf

    worst = max(measures, key=distance)  # the first of equals
    value, error = measures[worst]
    reached = all(precision.reached(*measure) for measure in measures.values())
    return CellPrecision(trials, worst, value, error, precision.goal(value), reached)


def _batches(places: Sequence[list[Batch]], estimators: int) -> Iterator[CellBatch]:
    """Take as many groups at a time, or cells of one, as memory should hold."""
    batch: CellBatch = []
    held = 0
    for pieces in places:
        rows = pieces[-1].last * estimators
        for cell in pieces[-1].cells:
            if batch and held + rows > _ROWS:
                yield batch
                batch, held = [], 0
            if not batch or batch[-1][0] is not pieces:
                batch.append((pieces, []))
            batch[-1][1].append(cell)
            held += rows
    if batch:
        yield batch


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
        last: the last precision of each cell.
        reasons: for each cell that is not open any more, why.
    """

    def __init__(self, group: Group, checkpoints: list[int]) -> None:
        self.group, self.checkpoints = group, checkpoints
        self.stages = [Batch(group, 0, checkpoints[0])]
        self.last: dict[Cell, CellPrecision] = {}
        self.reasons: dict[Cell, str] = {}

    @property
    def open(self) -> bool:
        """True if a cell is to have more trials."""
        return len(self.reasons) < len(self.group.cells)

    def take(self, precisions: Mapping[Cell, CellPrecision]) -> None:
        """Note the precision of the last stage's cells; begin the next one with those that need, and may have, more."""
        for cell in self.stages[-1].cells:
            self.last[cell] = precision = precisions[cell]
            if precision.reached or precision.trials == self.checkpoints[-1]:
                self.reasons[cell] = TARGET if precision.reached else CAP
        if self.open:
            left = {cell for cell in self.group.cells if cell not in self.reasons}
            last = self.stages[-1].last
            self.stages.append(Batch(self.group.only(left), last, self.checkpoints[len(self.stages)]))

    def stop(self) -> None:
        """Leave out the last stage, and close all cells."""
        self.stages.pop()
        for cell in self.group.cells:
            self.reasons.setdefault(cell, BUDGET)


class Rounds(Layout):
    """The layout of an adaptive run, as far as it is known.

    Args:
        study: the config of a grid, with a precision.
    """

    def __init__(self, study: Study) -> None:
        assert study.precision is not None
        super().__init__(study)
        self.precision: Precision = study.precision
        self.restart()

    def units(self) -> Iterator[Batch]:
        """The units that hold trials, in the order of the tables."""
        for progress in self.progress.values():
            if progress.stages:
                yield from self.study.units_of(progress.group, progress.stages[-1].last)

    def cut(self, unit: Batch) -> Iterator[Batch]:
        """Cut a unit into the pieces that the stages have of it."""
        for stage in self.progress[unit.group.stream].stages:
            yield from self._within(unit, stage)

    def pending(self) -> Iterator[Batch]:
        """Pieces of the stages that are not measured yet."""
        return chain.from_iterable(self._pieces(progress)[1] for progress in self.progress.values() if progress.open)

    def advance(self, parts: Parts) -> bool:
        """Measure the stages that are complete, and begin the next ones; false if no group goes on.

        Args:
            parts: the stored rows.
        """
        places = {}
        for stream, progress in self.progress.items():
            if progress.open:
                before, now = self._pieces(progress)
                if next(self.missing(parts, now), None) is None:
                    places[stream] = before + now
        precisions = dict(measure_cells(self, parts, list(places.values()), self.precision))
        for stream in places:
            self.progress[stream].take(precisions)
        return any(self.progress[stream].open for stream in places)

    def _pieces(self, progress: GroupProgress) -> tuple[list[Batch], list[Batch]]:
        """Pieces of the stages that are measured, and of the last one."""
        pieces: tuple[list[Batch], list[Batch]] = [], []
        for stage in progress.stages:
            for unit in self.study.units_of(progress.group, stage.last):
                pieces[stage is progress.stages[-1]].extend(self._within(unit, stage))
        return pieces

    def _within(self, unit: Batch, stage: Batch) -> Iterator[Batch]:
        """Cut a unit to the trials that a stage has of it."""
        first, last = max(unit.first, stage.first), min(unit.last, stage.last)
        if first < last:
            yield from shorter(self.study, Batch(stage.group, first, last))

    def restart(self) -> None:
        """Forget all measures, because some of the rows are lost, and begin at the first checkpoints."""
        points, study = self.precision.checkpoints, self.study
        self.progress = {g.stream: GroupProgress(g, points(study.trials_of(g))) for g in study.groups()}

    def stop(self) -> None:
        """Go no further: the open cells stay as they were at their last checkpoint."""
        for progress in self.progress.values():
            if progress.open:
                progress.stop()

    def ahead(self) -> float:
        """Share of the pending trials in all that may still be added."""
        now = possible = 0
        for progress in self.progress.values():
            if progress.open:
                stage = progress.stages[-1]
                now += stage.rows
                possible += len(stage.cells) * (progress.checkpoints[-1] - stage.first)
        return now / possible if possible else 1.0

    def reasons(self) -> Counter[str]:
        """Numbers of closed cells by their reason."""
        return Counter(chain.from_iterable(progress.reasons.values() for progress in self.progress.values()))

    def table(self) -> pa.Table:
        """The precision table, with a row per cell, of a run that goes no further."""
        rows = []
        for progress in self.progress.values():
            for cell in progress.group.cells:
                precision = vars(progress.last.get(cell, NOTHING))
                passed = sum(point <= precision["trials"] for point in progress.checkpoints)
                why = {"checkpoints": passed, "reason": progress.reasons[cell]}
                rows.append({"cell": cell.name} | cell.values | precision | why)
        columns = schemas.precision(self.study.conditions())
        return schemas.table(columns, {c.name: [row[c.name] for row in rows] for c in columns})


class TimeBudget:
    """Seconds from now.

    Args:
        seconds: how many; None for no limit.
        clock: gives the time in seconds.
    """

    def __init__(self, seconds: float | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.seconds, self._clock = seconds, clock
        self._end = math.inf if seconds is None else clock() + seconds

    def spent(self) -> bool:
        """Tell whether the time is over."""
        return self._clock() >= self._end
