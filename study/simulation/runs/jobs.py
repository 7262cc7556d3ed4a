"""Tasks of a run: outputs to compute of units, the function with which a worker computes them, and their tables.

A study's units may be cut into pieces that are computed by themselves. The stored rows of each unit are joined in the
order of the tables, however the unit was cut.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from study.arrays import Ints
from study.files import RunError
from study.fits import ESTIMATORS
from study.simulation import statistics
from study.simulation.experiment.compute import Columns, Errors, Result, compute, lost, stack
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch, Unit
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
    """Outputs to compute of a unit.

    Attributes:
        unit: the unit.
        key: a digest of all that determines the unit's rows; see `study.simulation.runs.parts`.
        outputs: estimators with their versions, and perhaps points.
    """

    unit: Unit
    key: str
    outputs: tuple[str, ...]

    @property
    def weight(self) -> float:
        """Work in samples: those drawn and fitted, an overhead per batch and level, and a cost per row."""
        samples, batches = self.unit.group.load(self.unit.first, self.unit.last)
        levels = self.unit.group.levels
        rows = self.unit.rows * len(self.outputs)
        return samples * (1.0 + levels) + _OVERHEAD * batches * (1 + levels) + _ROW * rows


class UnitTasks:
    """The tasks of a study.

    Args:
        study: the config.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        measures = " ".join(MEASURES) if study.keep == "summary" else ""  # rows of a summary have a column for each
        self._stem = hashlib.sha256(f"{FORMAT} {study.stem()}{measures}".encode()).digest()
        self.estimators = tuple(output(name) for name in study.estimators)

    def task(self, unit: Unit) -> UnitTask:
        """The task of a unit, with all of its outputs."""
        content = self._stem + unit.group.digest + f"{unit.first}-{unit.last}".encode()
        points = (f"{POINTS}:{self.study.keep_points}",) if unit.first < self.study.keep_points else ()
        return UnitTask(unit, hashlib.blake2b(content, digest_size=12).hexdigest(), self.estimators + points)

    def missing(self, units: Iterable[Unit], stored: Callable[[str], set[str]]) -> Iterator[UnitTask]:
        """The tasks of units, with the outputs that are not stored; tasks that have none are left out.

        Args:
            units: the units.
            stored: gives the outputs that are stored under a key.
        """
        for unit in units:
            task = self.task(unit)
            there = stored(task.key)
            if missing := tuple(o for o in task.outputs if o not in there):
                yield UnitTask(unit, task.key, missing)


def takes_long(study: Study) -> bool:
    """Tell whether processes compute a study sooner than threads, which start at once but share one interpreter."""
    tasks, weight = UnitTasks(study), 0.0
    for unit in units(study):
        weight += tasks.task(unit).weight
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


def give_up(study: Study, tasks: tuple[UnitTask, ...], message: str) -> Packet:
    """Rows of tasks whose worker died twice: every fit failed.

    Args:
        study: the config.
        tasks: the tasks.
        message: how the worker died.
    """
    return _packed(study, tasks, lambda part, batches: lost(part, batches, message))


def _packed(study: Study, tasks: tuple[UnitTask, ...], result: Callable[[Study, tuple[Batch, ...]], Result]) -> Packet:
    of_tasks = []
    for outputs, together in groupby(tasks, key=lambda task: task.outputs):
        kept = study.keep_points if any(o.startswith(POINTS) for o in outputs) else 0
        part = study.model_copy(update={"estimators": estimators_of(outputs), "keep_points": kept})
        for task in together:
            of_tasks.append(tables(part, result(part, task.unit.batches)))
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
        result.clock.read("summary", samples, sum(block.radius.size for block in result.blocks))
    return table | {"timings": result.timings}


class Layout:
    """A run whose units are all known, and computed whole.

    Args:
        study: the config.
    """

    def __init__(self, study: Study) -> None:
        self.study = study

    def units(self) -> Iterator[Unit]:
        """The units, in the order of the tables."""
        return units(self.study)

    def cut(self, unit: Unit) -> Iterator[Unit]:
        """Cut a unit into pieces."""
        yield unit

    def pieces(self) -> Iterator[Unit]:
        """All pieces of all units."""
        return (piece for unit in self.units() for piece in self.cut(unit))

    def pending(self) -> Iterator[Unit]:
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


def rows(study: Study, parts: Parts, layout: Layout, name: str) -> Iterator[pa.Table]:
    """Read a table's rows, unit by unit.

    Args:
        study: the config.
        parts: the stored rows.
        layout: the units, and how each is cut.
        name: the table: errors, points, failures, timings or summary.

    Raises:
        RunError: if rows are missing.
    """
    tasks = UnitTasks(study)
    if not parts.holds(name):
        return
    for unit in layout.units():
        result: list[pa.Table] = []
        first: tuple[str, ...] = ()
        datasets = 0
        for piece in layout.cut(unit):
            datasets += piece.rows
            for outputs, table in stored_rows(tasks, parts, piece, name):
                first = first or outputs
                result.append(table)
        expected = {"errors": datasets, "summary": len(unit.group.cells)}.get(name, 0) * len(study.estimators)
        if expected and sum(table.num_rows for table in result) != expected:
            raise RunError(f"{parts.folder}: rows of trials {unit.first} to {unit.last - 1} are missing; run again")
        whole = len(result) == 1 and (name == "points" or estimators_of(first) == study.estimators)
        if whole or (result and name == "timings"):
            yield from result
        elif result:
            table = pa.concat_tables(result)
            yield table.take(order(study.estimators, unit, table))


def stored_rows(tasks: UnitTasks, parts: Parts, piece: Unit, name: str) -> Iterator[tuple[tuple[str, ...], pa.Table]]:
    """Read the stored rows of a piece, without those of outputs that the study does not have.

    Rows that were taken from another study's run have its columns. They get those of this one: a condition that it did
    not give is at its default, and one that this study does not give is left out.

    Args:
        tasks: the study's.
        parts: the stored rows.
        piece: of a unit.
        name: the table.

    Yields:
        Outputs, and their rows.
    """
    task, study = tasks.task(piece), tasks.study
    columns = schemas.of_units(study.dimension, study.conditions())[name]
    for outputs, fresh, table in parts.tables(task.key, name):
        wanted = tuple(output for output in fresh if output in task.outputs)
        if not wanted or (name == "points" and not any(o.startswith(POINTS) for o in wanted)):
            continue
        if wanted != outputs and name in ("errors", "failures", "summary"):
            table = table.filter(pc.is_in(_words(table, "estimator"), pa.array(estimators_of(wanted))))
        yield wanted, schemas.completed(table, columns)


def order(estimators: tuple[str, ...], unit: Unit, table: pa.Table) -> Ints:
    """The order of a unit's rows in the table.

    Args:
        estimators: their names, in the order of the config.
        unit: the unit.
        table: its rows, of errors, failures, points or summary, in any order.
    """
    if "group" in table.schema.names:  # a summary, of the cells of a grid
        cells = _places(table, "group", [cell.name for cell in unit.group.cells])
        return np.lexsort([_places(table, "estimator", estimators), cells])
    trial = table["trial"].to_numpy()
    keys = [trial]
    if "estimator" in table.schema.names:
        keys.append(_places(table, "estimator", estimators))
    if unit.group.cells:
        keys.append(_places(table, "cell", [cell.name for cell in unit.group.cells]))
    return np.lexsort([*keys, trial // unit.group.size])  # the last counts most


def _places(table: pa.Table, column: str, words: Iterable[str]) -> Ints:
    """Place of each row's word among others."""
    return np.asarray(pc.index_in(_words(table, column), pa.array(list(words))).to_numpy())


def _words(table: pa.Table, column: str) -> pa.ChunkedArray:
    """A column of words, without its dictionary."""
    return table[column].cast(pa.string())
