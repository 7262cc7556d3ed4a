"""Tasks of a run: outputs to compute of units, the function with which a worker computes them, and their tables.

A study's units may be cut into pieces that are computed by themselves. The stored rows of each unit are joined in the
order of the tables, however the unit was cut.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from study.arrays import Ints
from study.files import RunError
from study.fits import ESTIMATORS
from study.simulation import statistics
from study.simulation.experiment.compute import Columns, Errors, Result, compute, lost, stack
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch
from study.simulation.experiment.sampling import units
from study.simulation.runs import schemas
from study.simulation.runs.parts import FORMAT, Packet, Parts, encode
from study.simulation.statistics import MEASURES

POINTS = "points"
_OVERHEAD = 10_000.0
"""Overhead of a call, in samples that could be drawn meanwhile."""
_ROW = 40.0
"""Cost of a row, in samples; high, because packets of many rows are read whole."""
_LONG = 1e9
"""Weight, some ten seconds of one worker, from which processes are worth the two seconds in which they start."""


@dataclass(frozen=True)
class UnitTask:
    """Outputs to compute of a batch of trials.

    Attributes:
        batch: the trials.
        key: a digest of all that determines their rows; see `study.simulation.runs.parts`.
        outputs: estimators with their versions, and perhaps points.
    """

    batch: Batch
    key: str
    outputs: tuple[str, ...]

    @property
    def weight(self) -> float:
        """Work in samples: those drawn and fitted, an overhead per block and level, and a cost per row."""
        batch, levels = self.batch, len(self.batch.group.levels)
        samples = sum(samples * trials for samples, trials in batch.group.sizes(batch.first, batch.last))
        blocks = -(-batch.last // batch.group.size) - batch.first // batch.group.size
        return samples * (1.0 + levels) + _OVERHEAD * blocks * (1 + levels) + _ROW * batch.rows * len(self.outputs)


def takes_long(study: Study) -> bool:
    """Tell whether processes compute a study sooner than threads, which start at once but share one interpreter."""
    layout, weight = Layout(study), 0.0
    for unit in units(study):
        weight += layout.task(unit).weight
        if weight > _LONG:
            return True
    return False


def output(estimator: str) -> str:
    """Name of an estimator's rows among the outputs: its name and its version."""
    return f"{estimator}@{ESTIMATORS[estimator].version}"


def estimators_of(outputs: Iterable[str]) -> tuple[str, ...]:
    """Names of the estimators among outputs."""
    return tuple(o.rpartition("@")[0] for o in outputs if "@" in o)


def execute(study: Study, tasks: tuple[UnitTask, ...]) -> Packet:
    """Compute tasks of a study; workers run this."""
    return _packed(study, tasks, compute)


def give_up(study: Study, task: UnitTask, message: str) -> Packet:
    """Rows of a task whose worker died twice: every fit failed.

    Args:
        study: the config.
        task: the task.
        message: how the worker died.
    """
    return _packed(study, (task,), lambda part, batch: lost(part, batch, message))


def _packed(study: Study, tasks: tuple[UnitTask, ...], result: Callable[[Study, Batch], Result]) -> Packet:
    of_tasks = []
    for task in tasks:
        points = study.keep_points if any(o.startswith(POINTS) for o in task.outputs) else 0
        part = study.model_copy(update={"estimators": estimators_of(task.outputs), "keep_points": points})
        of_tasks.append(tables(part, result(part, task.batch)))
    stacked, rows = {}, {}
    for name, columns in schemas.of_units(study.dimension, study.conditions()).items():
        filled = [unit[name] for unit in of_tasks if unit[name]]
        if filled:
            stacked[name] = schemas.table(columns, stack(filled))
            rows[name] = [len(next(iter(unit[name].values()))) if unit[name] else 0 for unit in of_tasks]
    return Packet([(task.key, task.outputs) for task in tasks], rows, {k: encode(t) for k, t in stacked.items()})


def tables(study: Study, result: Result) -> dict[str, Columns]:
    """Columns of each table that a unit fills; none of those that the study does not keep.

    Args:
        study: the config.
        result: of the unit; where the study keeps summaries alone, the unit holds all trials of its cells.
    """
    table: dict[str, Columns] = {"errors": {}, "summary": {}, "points": result.points, "failures": result.failures}
    if study.keep == "errors":
        table["errors"] = result.errors
    elif result.blocks:
        table["summary"] = statistics.of_errors(Errors.joined(result.blocks))
        samples = result.blocks[0].cells[0].samples
        result.clock("summary", samples, sum(block.radius.size for block in result.blocks))
    return table | {"timings": result.timings}


class Layout:
    """The tasks of a run whose units are all known, and computed whole.

    Args:
        study: the config.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        measures = " ".join(MEASURES) if study.keep == "summary" else ""  # rows of a summary have a column for each
        self._stem = hashlib.sha256(f"{FORMAT} {study.stem()}{measures}".encode()).digest()
        self._estimators = tuple(output(name) for name in study.estimators)

    def task(self, batch: Batch) -> UnitTask:
        """The task of a batch, with all of its outputs."""
        content = self._stem + batch.group.digest + f"{batch.first}-{batch.last}".encode()
        points = (f"{POINTS}:{self.study.keep_points}",) if batch.first < self.study.keep_points else ()
        return UnitTask(batch, hashlib.blake2b(content, digest_size=12).hexdigest(), self._estimators + points)

    def missing(self, parts: Parts, batches: Iterable[Batch] | None = None) -> Iterator[UnitTask]:
        """Tasks with the outputs that parts do not have; tasks that have none are left out.

        Args:
            parts: the stored rows.
            batches: the trials; those that may have to be computed, by default.
        """
        for batch in self.pending() if batches is None else batches:
            task = self.task(batch)
            there = parts.outputs(task.key)
            if missing := tuple(o for o in task.outputs if o not in there):
                yield replace(task, outputs=missing)

    def units(self) -> Iterator[Batch]:
        """The units, in the order of the tables."""
        return units(self.study)

    def cut(self, unit: Batch) -> Iterator[Batch]:
        """Cut a unit into pieces."""
        yield unit

    def pieces(self) -> Iterator[Batch]:
        """All pieces of all units."""
        return (piece for unit in self.units() for piece in self.cut(unit))

    def pending(self) -> Iterator[Batch]:
        """The pieces that may have to be computed."""
        return self.pieces()

    def advance(self, parts: Parts) -> bool:
        """Find further units, once the parts hold all that was pending; false if there are none."""
        return False

    def restart(self) -> None:
        """Forget what was concluded from the parts, because some of them are lost."""

    def ahead(self) -> float:
        """Share of the pending pieces in all that may still have to be computed."""
        return 1.0

    def rows(self, parts: Parts, name: str) -> Iterator[pa.Table]:
        """Read a table's rows, unit by unit.

        Args:
            parts: the stored rows.
            name: the table: errors, points, failures, timings or summary.

        Raises:
            RunError: if rows are missing.
        """
        estimators = self.study.estimators
        for unit in self.units() if parts.holds(name) else ():
            pieces = list(self.cut(unit))
            stored = [entry for piece in pieces for entry in self.stored(parts, piece, name)]
            result = [table for _, table in stored]
            datasets = {"errors": sum(piece.rows for piece in pieces), "summary": len(unit.cells)}.get(name, 0)
            if datasets and sum(table.num_rows for table in result) != datasets * len(estimators):
                raise RunError(f"{parts.folder}: rows of trials {unit.first} to {unit.last - 1} are missing; run again")
            in_order = len(result) == 1 and (name == "points" or estimators_of(stored[0][0]) == estimators)
            if in_order or name == "timings":
                yield from result
            elif result:
                table = pa.concat_tables(result)
                yield table.take(order(estimators, unit, table))

    def stored(self, parts: Parts, piece: Batch, name: str) -> Iterator[tuple[tuple[str, ...], pa.Table]]:
        """Read the stored rows of a piece, without those of outputs that the study does not have.

        Rows that were taken from another study's run have its columns. They get those of this one: a condition that it
        did not give is at its default, and one that this study does not give is left out.

        Args:
            parts: the stored rows.
            piece: of a unit.
            name: the table.

        Yields:
            Outputs, and their rows.
        """
        task = self.task(piece)
        columns = schemas.of_units(self.study.dimension, self.study.conditions())[name]
        for outputs, fresh, table in parts.tables(task.key, name):
            wanted = tuple(output for output in fresh if output in task.outputs)
            if not wanted or (name == "points" and not any(o.startswith(POINTS) for o in wanted)):
                continue
            if wanted != outputs and name in ("errors", "failures", "summary"):
                table = table.filter(pc.is_in(_words(table, "estimator"), pa.array(estimators_of(wanted))))
            yield wanted, schemas.completed(table, columns)


def order(estimators: tuple[str, ...], unit: Batch, table: pa.Table) -> Ints:
    """The order of a unit's rows in the table.

    Args:
        estimators: their names, in the order of the config.
        unit: the unit.
        table: its rows, of errors, failures, points or summary, in any order.
    """
    if "group" in table.schema.names:  # a summary, of the cells of a grid
        cells = _places(table, "group", [cell.name for cell in unit.cells])
        return np.lexsort([_places(table, "estimator", estimators), cells])
    trial = table["trial"].to_numpy()
    keys = [trial]
    if "estimator" in table.schema.names:
        keys.append(_places(table, "estimator", estimators))
    if unit.cells:
        keys.append(_places(table, "cell", [cell.name for cell in unit.cells]))
    return np.lexsort([*keys, trial // unit.group.size])  # the last counts most


def _places(table: pa.Table, column: str, words: Iterable[str]) -> Ints:
    """Place of each row's word among others."""
    return np.asarray(pc.index_in(_words(table, column), pa.array(list(words))).to_numpy())


def _words(table: pa.Table, column: str) -> pa.ChunkedArray:
    """A column of words, without its dictionary."""
    return table[column].cast(pa.string())
