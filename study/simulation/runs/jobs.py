"""Tasks of a run: outputs to compute of units, the function with which a worker computes them, and their tables.

A study's units may be cut into pieces that are computed by themselves. The stored rows of each unit are joined in the
order of the tables, however the unit was cut.

More trials, cells or estimators leave the rows of a smaller study as they are, bit for bit. So if a finished run of a
smaller study, of the same name, lies next to a new one or in its folder, the new one's units are cut into pieces that
the earlier run has and pieces that it has not. Rows of an estimator of another version, and of units whose worker died,
are computed again. A run of the very same config in another folder is not used, because a study is run again to check
it. An adaptive study neither takes rows of another run nor gives any.
"""

import hashlib
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from study.arrays import Ints
from study.files import RunError, TableRows
from study.fits import ESTIMATORS
from study.fits.random import Name
from study.simulation import statistics
from study.simulation.experiment.compute import Columns, Errors, Result, compute, lost, stack
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch, Group
from study.simulation.runs import schemas
from study.simulation.runs.parts import FORMAT, Packet, Parts, encode
from study.simulation.runs.run_folder import Run

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
    layout = Layout(study)
    return any(weight > _LONG for weight in accumulate(layout.task(unit).weight for unit in study.units()))


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
        result.clock("summary", samples, sum(block.fits.radius.size for block in result.blocks))
    return table | {"timings": result.timings}


class Layout:
    """The tasks of a run whose units are all known, and cut along those of an earlier study.

    Args:
        study: the config.
        earlier: the earlier study; None to leave units whole.
    """

    def __init__(self, study: Study, earlier: Study | None = None) -> None:
        self.study = study
        # rows of a summary have a column for each measure
        measures = " ".join(statistics.MEASURES) if study.keep == "summary" else ""
        self._stem = hashlib.sha256(f"{FORMAT} {study.stem()}{measures}".encode()).digest()
        self._estimators = tuple(f"{name}@{ESTIMATORS[name].version}" for name in study.estimators)
        self._earlier = earlier if earlier is not None and _related(study, earlier) else None
        self._groups = {group.stream: group for group in self._earlier.groups()} if self._earlier is not None else {}
        self._halves: tuple[Group, Group | None, Group | None] | None = None

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
        return self.study.units()

    def cut(self, unit: Batch) -> Iterator[Batch]:
        """Cut a unit into the earlier run's trials of its cells, further trials of them, and other cells."""
        earlier = self._groups.get(unit.group.stream)
        if self._earlier is None or earlier is None:
            yield unit
            return
        if self._halves is None or self._halves[0] is not unit.group:  # units of a group come one after the other
            self._halves = unit.group, *unit.group.shared(earlier)
        _, shared, others = self._halves
        if others is not None:
            yield Batch(others, unit.first, unit.last)
        if shared is not None:
            middle = min(max(self._earlier.trials_of(shared), unit.first), unit.last)
            if unit.first < middle:
                yield Batch(shared, unit.first, middle)
            if middle < unit.last:
                yield Batch(shared, middle, unit.last)

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


class EarlierRun:
    """A finished run whose rows are reused.

    Args:
        run: the run.
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        made = run.manifest()["estimators"]
        self.outputs = {f"{name}@{made[name]}" for name in run.study.estimators}
        self._errors = TableRows(run.path("errors"))
        self._failures = run.arrow("failures") if run.has("failures") else None
        self._begin: dict[Name, tuple[int, int]] = {}
        row, estimators = 0, len(run.study.estimators)
        for unit in run.study.units():
            self._begin.setdefault(unit.group.stream, (row, unit.group.width * estimators))
            row += unit.rows * estimators

    @classmethod
    def of(cls, run: Run) -> "EarlierRun | None":
        """Open a run; None if it is not finished, or its rows are damaged."""
        if "errors" not in run.digests() or {"errors", "failures"} & set(run.damaged()):
            return None
        try:
            return cls(run)
        except RunError:  # it keeps no table that its manifest vouches for
            return None

    def take(self, task: UnitTask) -> Packet | None:
        """Take the rows of a task that this run has, in the order that the task gives them; None if it has none.

        Args:
            task: outputs of a piece, as `Layout` cut it along this run's study.
        """
        unit = task.batch
        trials = self.run.study.trials_of(unit.group)
        outputs = tuple(o for o in task.outputs if o in self.outputs)
        if unit.last > trials or not outputs or unit.group.stream not in self._begin:
            return None
        begin, per_trial = self._begin[unit.group.stream]
        size = unit.group.size  # whole blocks hold the cells one after the other
        low, high = unit.first // size * size, -(-unit.last // size) * size
        whole = self._errors.rows(begin + per_trial * low, begin + per_trial * min(high, trials))
        use = (pc.field("trial") >= unit.first) & (pc.field("trial") < unit.last)
        use &= pc.field("estimator").cast(pa.string()).isin(list(estimators_of(outputs)))
        if unit.cells:
            use &= pc.field("cell").cast(pa.string()).isin([cell.name for cell in unit.cells])
        result = {"errors": whole.filter(use)}
        if result["errors"].num_rows != unit.rows * len(outputs):
            return None
        if self._failures is not None:
            cells = pc.unique(result["errors"]["cell"]).to_pylist()
            result["failures"] = self._failures.filter(use & pc.field("cell").cast(pa.string()).isin(cells))
            if "worker" in pc.unique(result["failures"]["cause"]).to_pylist():
                return None
        ordered = {name: table.take(order(estimators_of(outputs), unit, table)) for name, table in result.items()}
        return Packet.of([(task.key, outputs)], [ordered])


def neighbour(study: Study, folder: Path) -> Run | None:
    """Find the finished run of the same name, next to a folder, that has most rows of a study."""
    result: list[tuple[int, Run]] = []
    for path in sorted(folder.parent.glob(f"{study.name}-*")):
        if path == folder or not re.fullmatch(r"[0-9a-f]{10}", path.name.removeprefix(f"{study.name}-")):
            continue
        try:
            run = Run.open(path)
        except RunError:
            continue
        if run.study.digest() != study.digest() and _related(study, run.study):
            shared = set(run.study.estimators) & set(study.estimators)
            result.append((sum(item.rows for item in run.study.units()) * len(shared), run))
    result.sort(key=lambda entry: -entry[0])
    return next((run for rows, run in result if rows and EarlierRun.of(run)), None)


def _related(study: Study, earlier: Study) -> bool:
    """Tell whether equal conditions have equal rows in two studies, and each has as many as its design says."""
    fixed = study.precision is None and earlier.precision is None
    return fixed and study.stem() == earlier.stem() and study.design.same_draws(earlier.design)
