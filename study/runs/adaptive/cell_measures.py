"""Cells judged by the rows that are stored of them: how well a measure of theirs is known."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from study.experiment.designs.cells import Cell
from study.experiment.designs.groups import Span
from study.experiment.errors import Columns
from study.experiment.precision_config import Precision
from study.runs.assemble import stored
from study.runs.jobs import Asked
from study.runs.storage.parts import Parts
from study.sphere.types import Ints

Judge = Callable[[str, Columns], tuple[float, float]]
"""A measure by its name, and its Monte-Carlo error, of one estimator's rows of a cell: `COLUMNS` of them."""
Batch = list[tuple[list[Span], list[Cell]]]
"""Pieces of groups of cells, each with the cells to judge."""
COLUMNS = ("radius", "error", "error_1", "bound", "status")
_ROWS = 1 << 20
"""As many rows are held at a time, if a single cell has not more."""


@dataclass(frozen=True)
class Verdict:
    """What was found of a cell at a checkpoint.

    Attributes:
        trials: so many it has.
        estimator: the one that is farthest from the target.
        value: its measure.
        error: its Monte-Carlo error.
        goal: what that should be at most.
        reached: whether it is.
    """

    trials: int
    estimator: str
    value: float
    error: float
    goal: float
    reached: bool


def judged(
    asked: Asked, parts: Parts, places: Sequence[list[Span]], precision: Precision, judge: Judge
) -> Iterator[tuple[Cell, Verdict]]:
    """Judge cells by all of their trials.

    Args:
        asked: what the study asks for.
        parts: where all of it is.
        places: for each group of cells, the pieces of their trials, in order; the last ones hold the cells to judge.
        precision: what is asked of them.
        judge: finds the measure.
    """
    names = precision.estimators or asked.study.estimators
    for batch in _batches(places, len(asked.study.estimators)):
        cells = [cell for _, some in batch for cell in some]
        trials = [pieces[-1].last for pieces, some in batch for _ in some]
        rows = _split(_read(asked, parts, batch), [cell.name for cell in cells], names)
        for cell, count, found in zip(cells, trials, rows, strict=True):
            measured = {name: judge(precision.measure, each) for name, each in zip(names, found, strict=True)}
            yield cell, _verdict(precision, count, measured)


def _read(asked: Asked, parts: Parts, batch: Batch) -> pa.Table:
    """The rows of some cells, those of each in the order of its trials."""
    found: list[pa.Table] = []
    order = sorted((index, number) for number, (pieces, _) in enumerate(batch) for index in range(len(pieces)))
    for index, number in order:  # across groups first: what was computed together is stored together
        pieces, cells = batch[number]
        wanted = pa.array([cell.name for cell in cells])
        for _, table in stored(asked, parts, pieces[index], "errors"):
            rows = table.select(["cell", "estimator", *COLUMNS])
            if len(cells) < len(pieces[index].group.cells):
                rows = rows.filter(pc.is_in(rows["cell"].cast(pa.string()), wanted))
            found.append(rows)
    return pa.concat_tables(found)


def _verdict(precision: Precision, trials: int, measured: dict[str, tuple[float, float]]) -> Verdict:
    def distance(name: str) -> float:
        value, error = measured[name]
        goal = precision.goal(value)
        return error / goal if np.isfinite(error) and goal > 0.0 else np.inf

    worst = max(measured, key=distance)  # the first of equals
    value, error = measured[worst]
    reached = all(precision.reached(*each) for each in measured.values())
    return Verdict(trials, worst, value, error, precision.goal(value), reached)


def _batches(places: Sequence[list[Span]], estimators: int) -> Iterator[Batch]:
    """Groups, or some cells of one, as many at a time as can be held."""
    batch: Batch = []
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
    """The rows of each of some cells, by estimator, in the order of their trials."""
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
    """Place of each row's word among others; -1 for one that is not there."""
    known = {word: place for place, word in enumerate(words)}
    found = [
        np.array([known.get(word, -1) for word in chunk.dictionary.to_pylist()], dtype=np.int64)[chunk.indices]
        for chunk in table[column].chunks
    ]
    return np.concatenate(found) if found else np.empty(0, dtype=np.int64)
