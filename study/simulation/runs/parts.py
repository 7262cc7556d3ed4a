"""Rows of a run that is not finished: tasks that compute them, part files that hold them, their order in tables.

A *unit* is the range of trials that is computed at once. A *piece* is a part of a unit. A *task* is a piece with the
outputs that are still to be computed. However a unit was cut, its rows are joined in the order of the tables. A part
file has a header, and is named by its own digest.

    parts/units-<SHA-256 of the file's bytes>.part
        one line of JSON: the format, the software, seconds since the part before, and the packets with their keys;
            where rows were taken from another run, the software that computed them
        the packets, one after the other: each a stream of Arrow's IPC format for each of its tables

A *key* is a digest of all that determines some rows, except their place in the grid, so that a part means the same to
every config that needs its rows. The *outputs* of a key are what was computed under it, such as an estimator with its
version. So a new estimator, or a new version of one, is computed beside the others. A *packet* holds the tables of a
few keys, encoded by a worker; the parent writes it as it is. A file holds many packets. Those that wait are written at
32 MiB, or after a second or a hundredth of the run's time so far, whichever is longer. The number of files then grows
with the logarithm of time, and a killed run loses no more than this interval of work.
"""

import hashlib
import math
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate, chain, pairwise
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pydantic import BaseModel, ValidationError

from study.arrays import Ints
from study.files import RunError, explained, write
from study.fits import ESTIMATORS
from study.simulation import statistics
from study.simulation.experiment.compute import Columns, Result, begin, compute, lost
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch, Group
from study.simulation.runs import schemas

FORMAT = 5
"""Format of parts and tables. Raise it when rows of the same key would change, or files would be read wrongly."""
DAMAGED = "damaged"
_BYTES = 32 << 20
_SECONDS = 1.0
_SHARE = 0.01
_SMALL = 1 << 16


class PacketHeader(BaseModel):
    """Description of a packet in a file: keys with outputs, rows of each key by table, bytes of each table."""

    keys: list[tuple[str, tuple[str, ...]]]
    rows: dict[str, list[int]]
    sizes: dict[str, int]


class Packet(NamedTuple):
    """Tables of several keys, encoded one after the other, and their description."""

    header: PacketHeader
    data: bytes

    @classmethod
    def of(cls, keys: Sequence[tuple[str, Sequence[str]]], of_keys: Sequence[Mapping[str, pa.Table]]) -> "Packet":
        """Encode the tables of each key; a table without rows may be left out."""
        names = dict.fromkeys(name for tables in of_keys for name in tables)
        rows = {name: [tables[name].num_rows if name in tables else 0 for tables in of_keys] for name in names}
        whole = {name: encode(pa.concat_tables([t[name] for t in of_keys if name in t])) for name in names}
        sizes = {name: len(table) for name, table in whole.items()}
        header = PacketHeader(keys=[(key, tuple(outputs)) for key, outputs in keys], rows=rows, sizes=sizes)
        return cls(header, b"".join(whole.values()))


def encode(table: pa.Table) -> bytes:
    """Encode a table as one stream of Arrow's IPC format."""
    table = table.replace_schema_metadata(None).unify_dictionaries().combine_chunks()
    options = pa.ipc.IpcWriteOptions(compression="zstd" if table.nbytes > _SMALL else None)
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema, options=options) as writer:
        writer.write_table(table)
    return bytes(sink.getvalue())


class Header(BaseModel):
    """First line of a file. An older format may have less than this one."""

    format: int
    software: dict[str, Any]
    seconds: float = 0.0
    note: str = ""
    sources: list[dict[str, Any]] = []
    packets: list[PacketHeader] = []


_Rows = tuple[Path, int, int, list[int]]
"""Place of a table of a packet: its file, first byte and size, and the first row of each key."""


@lru_cache(maxsize=2)
def _decoded(path: Path, begin: int, size: int) -> pa.Table:
    with open(path, "rb") as file:
        file.seek(begin)
        return pa.ipc.open_stream(file.read(size)).read_all()


class Parts:
    """The part files of one kind in a run's folder.

    Args:
        folder: the run's.
        kind: the beginning of their names.
        software: the software that computes, stored beside the rows.

    Attributes:
        damaged: names of files that were torn or changed.
        seconds: time in which the stored rows were computed.
        made_by: other software that computed some of them.
        note: a text stored in each file; read from the files if one has it.
        sources: software that computed the rows that are added now, if they are taken from another run.
        count: number of files of this format; others are not used.
    """

    def __init__(self, folder: Path, kind: str, software: Mapping[str, object] | None = None) -> None:
        self.folder = folder / "parts"
        self.kind = kind
        self.software = dict(software or {})
        self.damaged: list[str] = []
        self.note = ""
        self.sources: list[dict[str, object]] = []
        self._forget()
        self._waiting: list[Packet] = []
        self._since = self._began = time.monotonic()

    def load(self, set_aside: bool = True) -> list[str]:
        """Read the headers of all files.

        Args:
            set_aside: move damaged files to ``parts/damaged``, so that their rows are computed again.

        Returns:
            Names of the files that were torn or changed.

        Raises:
            RunError: if a part is of a newer version, or cannot be read at all.
        """
        self._forget()
        before = len(self.damaged)
        for path in self.files():
            try:
                data = path.read_bytes()
            except FileNotFoundError:  # a run that finishes removes its parts
                continue
            except OSError as error:
                remedy = "make it readable, or remove it: its rows are computed again"
                raise RunError(f"{path}: cannot be read: {error.strerror or error}; {remedy}") from None
            line, end, _ = data.partition(b"\n")
            if path == self._path(data):
                try:
                    self._index(path, len(line + end), Header.model_validate_json(line))
                    continue
                except ValidationError:
                    pass
            self.damaged.append(path.name)
            if set_aside:
                with explained(path):
                    (self.folder / DAMAGED).mkdir(exist_ok=True)
                    path.rename(self.folder / DAMAGED / path.name)
        return self.damaged[before:]

    def _path(self, data: bytes) -> Path:
        """Path of a file, which its bytes give."""
        return self.folder / f"{self.kind}-{hashlib.sha256(data).hexdigest()}.part"

    def files(self) -> list[Path]:
        """The part files, whole or not."""
        return sorted(path for path in self.folder.glob(f"{self.kind}-*.part") if path.is_file())

    def _forget(self) -> None:
        self.seconds = 0.0
        self.made_by: list[dict[str, object]] = []
        self.count = 0
        self._where: dict[str, list[tuple[dict[str, _Rows], int, tuple[str, ...]]]] = {}

    def outputs(self, key: str) -> set[str]:
        """The stored outputs of a key."""
        return {output for *_, outputs in self._where.get(key, ()) for output in outputs}

    def tables(self, key: str, name: str) -> Iterator[tuple[tuple[str, ...], tuple[str, ...], pa.Table]]:
        """Read a table's rows of a key, in the order in which they were written.

        Yields:
            All outputs of a packet, those that no earlier packet has, and its rows.
        """
        before: set[str] = set()
        for stored, place, outputs in self._where.get(key, ()):
            fresh = tuple(output for output in outputs if output not in before)
            before.update(fresh)
            if fresh and name in stored:
                path, begin, size, starts = stored[name]
                if count := starts[place + 1] - starts[place]:
                    yield outputs, fresh, _decoded(path, begin, size).slice(starts[place], count)

    def add(self, packet: Packet) -> None:
        """Take a packet; write it with the waiting ones when it is time."""
        self._waiting.append(packet)
        if self.patience() == 0.0 or sum(len(p.data) for p in self._waiting) >= _BYTES:
            self.commit()

    def patience(self) -> float | None:
        """Seconds until the waiting packets should be written; None if none waits."""
        if not self._waiting:
            return None
        now = time.monotonic()
        return max(0.0, self._since + max(_SECONDS, _SHARE * (now - self._began)) - now)

    def commit(self) -> None:
        """Write the waiting packets."""
        if not self._waiting:
            return
        packets, self._waiting = self._waiting, []
        now = time.monotonic()
        header = Header(
            format=FORMAT,
            software=self.software,
            seconds=round(now - self._since, 3),
            note=self.note,
            sources=self.sources,
            packets=[packet.header for packet in packets],
        )
        line = header.model_dump_json().encode() + b"\n"
        data = b"".join([line, *(packet.data for packet in packets)])
        path = self._path(data)
        with explained(self.folder.parent):
            self.folder.mkdir(exist_ok=True)
            write(path, data)
        self._since = now
        self._index(path, len(line), header)

    def remove(self) -> None:
        """Remove the files, since their rows are in tables now."""
        with explained(self.folder.parent):
            for path in self.files():
                path.unlink()
            if self.folder.is_dir() and not any(self.folder.iterdir()):
                self.folder.rmdir()
        self._forget()

    def _index(self, path: Path, begin: int, header: Header) -> None:
        """Note the place of each key's rows in a file, whose tables begin after the header."""
        if header.format > FORMAT:
            words = f"made by a newer version of this program ({header.software.get('study', 'unknown')})"
            raise RunError(f"{path}: {words}; update it, or choose another folder with --out")
        if header.format < FORMAT:  # its rows are not used, so it does not count
            return
        self.count += 1
        self.note = self.note or header.note
        self.seconds += header.seconds
        for software in (header.software, *header.sources):
            if software != self.software and software not in self.made_by:
                self.made_by.append(software)
        for packet in header.packets:
            stored: dict[str, _Rows] = {}
            for name, size in packet.sizes.items():
                stored[name] = path, begin, size, [0, *accumulate(packet.rows[name])]
                begin += size
            for place, (key, outputs) in enumerate(packet.keys):
                self._where.setdefault(key, []).append((stored, place, outputs))


POINTS = "points"
_OVERHEAD = 10_000.0
"""Overhead of a call, in samples that could be drawn meanwhile."""
_ROW = 40.0
"""Cost of a row, in samples; high, because packets of many rows are read whole."""
_LONG = 1e9
"""Weight above which processes are faster than threads: some ten seconds of one worker; they start in two."""
_PIECE = 5e7
"""Weight, some half a second, above which a unit of dear fits is cut: workers get equal work, a stop comes soon."""
_DEAR: dict[str, tuple[float, float]] = {
    "robust": (1e5, 1e3),
    "mle_early": (2e4, 20.0),
    "mle_mirror": (4e3, 60.0),
    "ugdk_cov": (1e4, 8.0),
    "lls_nr": (400.0, 6.0),
    "lls_nr_raw": (400.0, 6.0),
    "igdk": (200.0, 6.0),
}
"""Cost of a fit and of each of its points, in samples that could be drawn meanwhile, where it is more than the draw's.

Measured with N = 10 to 1000 in 2 and 3 dimensions, σ = 0.05 r, on caps of 60° and 180°. No run measures its own costs:
its units must be cut alike on every machine, and when it is resumed.
"""
_OWN = (2e4, 10.0)
"""Cost of an estimator of a user's own, which is called for one set of points after the other."""


def _cost(estimators: Iterable[str]) -> tuple[float, float]:
    """Cost of the dear fits of a set of points, and of each of its points; both are 0 if none is dear."""
    costs = [_OWN if isinstance(ESTIMATORS[name].version, str) else _DEAR.get(name, (0.0, 0.0)) for name in estimators]
    return sum(fit for fit, _ in costs), sum(point for _, point in costs)


@dataclass(frozen=True)
class UnitTask:
    """Outputs to compute of a batch of trials.

    Attributes:
        batch: the trials.
        key: a digest of all that determines their rows.
        outputs: estimators with their versions, and perhaps points.
    """

    batch: Batch
    key: str
    outputs: tuple[str, ...]

    @property
    def weight(self) -> float:
        """Work in samples: those drawn and fitted, an overhead per block and level, a cost per row, and dear fits."""
        batch, levels = self.batch, len(self.batch.group.levels)
        samples = sum(samples * trials for samples, trials in batch.group.sizes(batch.first, batch.last))
        blocks = -(-batch.last // batch.group.size) - batch.first // batch.group.size
        fit, point = _cost(estimators_of(self.outputs))
        dear = levels * (fit * batch.trials + point * samples)
        rows = _ROW * batch.rows * len(self.outputs)
        return samples * (1.0 + levels) + _OVERHEAD * blocks * (1 + levels) + rows + dear


def takes_long(study: Study) -> bool:
    """Tell whether processes compute a study sooner than threads, which start at once but share one interpreter."""
    layout = Layout(study)
    return any(weight > _LONG for weight in accumulate(layout.task(piece).weight for piece in layout.pieces()))


def estimators_of(outputs: Iterable[str]) -> tuple[str, ...]:
    """Names of the estimators among outputs."""
    return tuple(o.rpartition("@")[0] for o in outputs if "@" in o)


def execute(study: Study, tasks: tuple[UnitTask, ...]) -> Packet:
    """Compute tasks of a study; workers run this."""
    begin(study.model_copy(update={"estimators": estimators_of(tasks[0].outputs)}), tasks[0].batch)
    return _packed(study, tasks, compute)


def give_up(study: Study, task: UnitTask, message: str) -> Packet:
    """Rows of a task whose worker died twice: every fit failed.

    Args:
        study: the config.
        task: the task.
        message: how the worker died.
    """
    return _packed(study, (task,), lambda part, batch: lost(part, batch, message))


def _packed(study: Study, tasks: tuple[UnitTask, ...], answer: Callable[[Study, Batch], Result]) -> Packet:
    columns, of_tasks = schemas.of_units(*study.columns()), []
    for task in tasks:
        points = study.keep_points if any(o.startswith(POINTS) for o in task.outputs) else 0
        part = study.model_copy(update={"estimators": estimators_of(task.outputs), "keep_points": points})
        filled = tables(part, answer(part, task.batch))
        of_tasks.append({name: schemas.table(columns[name], values) for name, values in filled.items() if values})
    return Packet.of([(task.key, task.outputs) for task in tasks], of_tasks)


def tables(study: Study, result: Result) -> dict[str, Columns]:
    """Columns of each table that a unit fills; none of those that the study does not keep.

    Args:
        study: the config.
        result: of the unit; where the study keeps summaries alone, the unit holds all trials of its cells.
    """
    table: dict[str, Columns] = {"errors": {}, "summary": {}, "points": result.points, "failures": result.failures}
    if study.keep == "errors":
        table["errors"] = result.errors
    elif result.of_fits is not None:
        table["summary"] = statistics.of_errors(result.of_fits, study.measured())
        result.clock("summary", result.of_fits.cells[0].samples, result.of_fits.fits.radius.size)
    return table | {"timings": result.timings}


def shorter(study: Study, batch: Batch) -> Iterator[Batch]:
    """Cut a batch of dear fits, so that no piece takes long: by trials, or by levels where all trials are summed up.

    The tables stay as they are, because the rows of a unit are put in order when they are joined.
    """
    group, (fit, point) = batch.group, _cost(study.estimators)
    levels = group.levels
    most = group.samples or max(map(float, study.design.possible("samples")))  # a random design draws them when it runs
    if len(levels) * batch.trials * (fit + point * most) <= _PIECE:
        yield batch
        return
    count = math.ceil(UnitTask(batch, "", tuple(f"{name}@" for name in study.estimators)).weight / _PIECE)
    if study.keep == "summary":
        for part in np.array_split(np.arange(len(levels)), min(count, len(levels))):
            cells = {group.cells[place] for level in part for place in levels[level]}
            yield replace(batch, group=group.only(cells))
        return
    count = min(count, batch.trials)
    ends = [batch.first + batch.trials * i // count for i in range(count + 1)]
    yield from (Batch(group, first, last) for first, last in pairwise(ends))


class Layout:
    """The tasks of a run with a fixed list of units. A unit is cut where it overlaps that of an earlier study.

    Args:
        study: the config.
        earlier: the earlier study; None to leave units whole.
    """

    def __init__(self, study: Study, earlier: Study | None = None) -> None:
        self.study = study
        # rows of a summary have a column for each measure
        measures = " ".join(statistics.PERFORMANCE) if study.keep == "summary" else ""
        self._stem = hashlib.sha256(f"{FORMAT} {study.stem()}{measures}".encode()).digest()
        self._estimators = tuple(f"{name}@{ESTIMATORS[name].version}" for name in study.estimators)
        self._earlier = earlier if earlier is not None and related(study, earlier) else None
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
        """Cut a unit along the earlier run, and where it would take long."""
        return chain.from_iterable(shorter(self.study, batch) for batch in self._along(unit))

    def _along(self, unit: Batch) -> Iterator[Batch]:
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
        """The pending pieces as a share of all work that may remain."""
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
        for unit in self.units():
            pieces = list(self.cut(unit))
            stored = [entry for piece in pieces for entry in self.stored(parts, piece, name)]
            rows = [table for _, table in stored]
            datasets = sum(piece.rows for piece in pieces) if name == "errors" else len(unit.cells)
            if name == self.study.keep and sum(table.num_rows for table in rows) != datasets * len(estimators):
                raise RunError(f"{parts.folder}: rows of trials {unit.first} to {unit.last - 1} are missing; run again")
            in_order = len(rows) == 1 and (name == "points" or estimators_of(stored[0][0]) == estimators)
            if in_order or name == "timings":
                yield from rows
            elif rows:
                table = pa.concat_tables(rows)
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
        columns = schemas.of_units(*self.study.columns())[name]
        for outputs, fresh, table in parts.tables(task.key, name):
            wanted = tuple(output for output in fresh if output in task.outputs)
            if not wanted or (name == "points" and not any(o.startswith(POINTS) for o in wanted)):
                continue
            if wanted != outputs and name in ("errors", "failures", "summary"):
                table = table.filter(pc.is_in(_words(table, "estimator"), pa.array(estimators_of(wanted))))
            yield wanted, schemas.completed(table, columns)


class Share(NamedTuple):
    """A share of a study's units, computed by a job that knows nothing of the others.

    Attributes:
        number: its number, from 1.
        of: number of shares.
    """

    number: int
    of: int

    @classmethod
    def parse(cls, text: str) -> "Share":
        """Read a share such as ``3/40``; a ValueError says what is wrong."""
        found = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
        share = cls(*map(int, found.groups())) if found else cls(0, 0)
        if not 1 <= share.number <= share.of:
            raise ValueError(f"{text}: give K/N, the K-th of N shares, from 1/N to N/N, such as 3/40")
        return share

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


def dealt(layout: Layout) -> list[UnitTask]:
    """The tasks of a study as they are dealt to its shares, one by one: the heaviest first, so that shares weigh alike.

    The order depends on the config alone: jobs on several machines must agree about it.
    """
    return sorted(map(layout.task, layout.pieces()), key=attrgetter("weight"), reverse=True)


class ShareLayout(Layout):
    """The tasks of one share of a run. No rows of an earlier run are used, which other machines may not have.

    Args:
        study: the config.
        share: the share.
    """

    def __init__(self, study: Study, share: Share) -> None:
        super().__init__(study)
        self.share = share

    def pieces(self) -> Iterator[Batch]:
        """The pieces of the share."""
        return (task.batch for task in dealt(Layout(self.study))[self.share.number - 1 :: self.share.of])


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


def among(column: str, words: Iterable[str]) -> pc.Expression:
    """The condition that a column of words has one of these."""
    return pc.field(column).cast(pa.string()).isin(list(words))


def of_batch(batch: Batch) -> pc.Expression:
    """The condition that a row is of one of a batch's trials and cells."""
    use = (pc.field("trial") >= batch.first) & (pc.field("trial") < batch.last)
    return use & among("cell", (cell.name for cell in batch.cells)) if batch.cells else use


def _places(table: pa.Table, column: str, words: Iterable[str]) -> Ints:
    """Place of each row's word among others."""
    return np.asarray(pc.index_in(_words(table, column), pa.array(list(words))).to_numpy())


def _words(table: pa.Table, column: str) -> pa.ChunkedArray:
    """A column of words, without its dictionary."""
    return table[column].cast(pa.string())


def related(study: Study, earlier: Study) -> bool:
    """Tell whether equal conditions have equal rows in two studies, and each has as many as its design says."""
    fixed = study.precision is None and earlier.precision is None
    return fixed and study.stem() == earlier.stem() and study.design.same_draws(earlier.design)
