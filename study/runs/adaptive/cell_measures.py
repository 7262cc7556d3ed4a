"""Precision of cells, from their stored rows: a performance measure of each estimator and its Monte-Carlo error."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from study.experiment.designs.cells import Cell
from study.experiment.designs.groups import Span
from study.experiment.errors import Columns
from study.experiment.precision_config import Precision
from study.runs.assemble import stored_rows
from study.runs.jobs import Jobs
from study.runs.storage.parts import Parts
from study.sphere.types import Ints
from study.statistics.measures import Measure
from study.statistics.performance import measured

CellBatch = list[tuple[list[Span], list[Cell]]]
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
    jobs: Jobs, parts: Parts, places: Sequence[list[Span]], precision: Precision
) -> Iterator[tuple[Cell, CellPrecision]]:
    """Find the precision of cells from all of their trials.

    Args:
        jobs: the study's.
        parts: the stored rows, which have all of these trials.
        places: for each group of cells the pieces of its trials, in order; the last one has the cells to measure.
        precision: the config's section.
    """
    names = precision.estimators or jobs.study.estimators
    for batch in _batches(places, len(jobs.study.estimators)):
        cells = [cell for _, some in batch for cell in some]
        trials = [pieces[-1].last for pieces, some in batch for _ in some]
        rows = _split(_read(jobs, parts, batch), [cell.name for cell in cells], names)
        for cell, count, found in zip(cells, trials, rows, strict=True):
            measures = {name: measured(precision.measure, each) for name, each in zip(names, found, strict=True)}
            yield cell, _worst(precision, count, measures)


def _read(jobs: Jobs, parts: Parts, batch: CellBatch) -> pa.Table:
    """Read the rows of some cells, those of each in the order of its trials."""
    found: list[pa.Table] = []
    order = sorted((index, number) for number, (pieces, _) in enumerate(batch) for index in range(len(pieces)))
    for index, number in order:  # across groups first: what was computed together is stored together
        pieces, cells = batch[number]
        wanted = pa.array([cell.name for cell in cells])
        for _, table in stored_rows(jobs, parts, pieces[index], "errors"):
            rows = table.select(["cell", "estimator", *COLUMNS])
            if len(cells) < len(pieces[index].group.cells):
                rows = rows.filter(pc.is_in(rows["cell"].cast(pa.string()), wanted))
            found.append(rows)
    return pa.concat_tables(found)


def _worst(precision: Precision, trials: int, measures: dict[str, Measure]) -> CellPrecision:
    """Precision of the estimator that is farthest from the target."""

    def distance(name: str) -> float:
        value, error = measures[name]
        goal = precision.goal(value)
        return error / goal if np.isfinite(error) and goal > 0.0 else np.inf

    worst = max(measures, key=distance)  # the first of equals
    value, error = measures[worst]
    reached = all(precision.reached(*each) for each in measures.values())
    return CellPrecision(trials, worst, value, error, precision.goal(value), reached)


def _batches(places: Sequence[list[Span]], estimators: int) -> Iterator[CellBatch]:
    """Take as many groups at a time, or cells of one, as memory should hold."""
    batch: CellBatch = []
    held = 0
    for pieces in places:
        each = pieces[-1].last * estimators
        cells = list(pieces[-1].group.cells)
        while cells:
            room = max((_ROWS - held) // each, 0 if batch else 1)
            if room:
                some = cells[:room]
                batch.append((pieces, some))
                held += each * len(some)
                cells = cells[room:]
            if cells:
                yield batch
                batch, held = [], 0
    if batch:
        yield batch


def _split(table: pa.Table, cells: list[str], estimators: Sequence[str]) -> Iterator[list[Columns]]:
    """Split rows by cell and estimator, each in the order of its trials."""
    cell, estimator = _codes(table, "cell", cells), _codes(table, "estimator", estimators)
    use = np.flatnonzero((cell >= 0) & (estimator >= 0))
    code = cell[use] * len(estimators) + estimator[use]
    use = use[np.argsort(code, kind="stable")]
    ends = np.cumsum(np.bincount(code, minlength=len(cells) * len(estimators)))
    columns = {name: table[name].to_numpy()[use] for name in COLUMNS}
    begin = 0
    for place in range(len(cells)):
        found = []
        for end in ends[place * len(estimators) : (place + 1) * len(estimators)]:
            found.append({name: values[begin:end] for name, values in columns.items()})
            begin = int(end)
        yield found


def _codes(table: pa.Table, column: str, words: Sequence[str]) -> Ints:
    """Place of each row's word among others; -1 for a word that is not among them."""
    known = {word: place for place, word in enumerate(words)}
    found = [
        np.array([known.get(word, -1) for word in chunk.dictionary.to_pylist()], dtype=np.int64)[chunk.indices]
        for chunk in table[column].chunks
    ]
    return np.concatenate(found) if found else np.empty(0, dtype=np.int64)
