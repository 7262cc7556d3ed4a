"""Verification of a run: every table by its digest, and a share of its numbers by computing them again.

Units, rows of the summary and chains are chosen at random, computed again, and compared with the stored rows to the
last bit.
"""

import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from heapq import nsmallest
from typing import TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from threadpoolctl import threadpool_limits

from study.files import RunError, TableRows
from study.simulation.analysis.summary import Grouped, rows_of_groups
from study.simulation.experiment.compute import compute
from study.simulation.experiment.designs import Batch
from study.simulation.experiment.sampling import units
from study.simulation.posterior.run import chain_tasks
from study.simulation.runs import jobs, schemas
from study.simulation.runs.jobs import tables
from study.simulation.runs.provenance import other_version
from study.simulation.runs.run_folder import Run
from study.text import columns

T = TypeVar("T")
_SHOWN = 40


def chosen(seed: str, things: Sequence[T], share: float) -> list[T]:
    """Choose a share of some things, at least one, in their order.

    The choice looks random, and follows from the seed alone: things are ranked by a digest of the seed and their place.

    Args:
        seed: any text.
        things: the things.
        share: in [0, 1]; 0 chooses none.
    """
    count = min(len(things), math.ceil(share * len(things)))
    rank = {i: hashlib.blake2b(f"{seed} {i}".encode(), digest_size=16).digest() for i in range(len(things))}
    return [things[i] for i in sorted(nsmallest(count, rank, key=rank.__getitem__))]


def difference(stored: pa.Table, computed: pa.Table) -> str | None:
    """The first difference between stored and computed rows, in words; None if they are equal to the bit.

    All values that are not a number count as equal. Columns that an older table lacks are not compared, nor values that
    rows lack because they are older than the column.
    """
    if stored.num_rows != computed.num_rows:
        return f"{stored.num_rows:,} rows are stored, and {computed.num_rows:,} computed"
    for name in (name for name in computed.schema.names if name in stored.schema.names):
        ours, theirs = _bits(stored[name]), _bits(computed[name])
        unequal = np.flatnonzero(ours != theirs)
        if name in schemas.NEWER and pa.types.is_floating(stored[name].type):
            unequal = unequal[~pc.is_nan(stored[name]).to_numpy()[unequal]]
        if len(unequal):
            at = int(unequal[0])
            where = " ".join(str(stored[key][at]) for key in _IDENTITY if key in stored.schema.names)
            values = [repr(table[name][at].as_py())[:_SHOWN] for table in (stored, computed)]
            return f"{where}: {name} is {values[0]}, and {values[1]} when computed again"
    return None


_IDENTITY = ("group", "cell", "trial", "estimator", "likelihood", "noise_is")
"""Columns that tell a reader which row it is."""


def _bits(column: pa.ChunkedArray) -> np.ndarray:
    """Values of a column that are equal where their bits are."""
    if pa.types.is_dictionary(column.type):
        column = column.cast(pa.string())
    values: np.ndarray = column.to_numpy()
    if not np.issubdtype(values.dtype, np.floating):
        return values
    whole = np.ascontiguousarray(values, dtype=np.float64)
    return np.where(np.isnan(whole), np.nan, whole).view(np.int64)


@dataclass
class Recomputed:
    """Result of computing some things of a table again.

    Attributes:
        done: number of things that were computed again.
        total: number of things that there are.
        unit: the things in words, in the plural.
        faults: differences, in words.
    """

    done: int
    total: int
    unit: str
    faults: list[str] = field(default_factory=list)


def recompute_units(run: Run, names: list[str], seed: str, share: float) -> dict[str, Recomputed]:
    """Compute a share of a run's units again, and compare their rows to the bit.

    Units whose worker died are left out, since they might do it again.

    Args:
        run: the finished run.
        names: its tables whose digests are right.
        seed: text that determines the choice.
        share: of the units, in [0, 1].

    Returns:
        Results by table: errors or summary, points, failures.
    """
    study = run.study
    main: str = study.keep
    columns = schemas.of_units(study.dimension, study.conditions())
    compared: list[str] = [name for name in (main, "points", "failures") if name in names]
    if main not in compared:
        return {}
    there = _Stored(run, compared)
    found = {name: Recomputed(0, len(there.places), "units") for name in compared}
    if there.expected != there.main.count:
        words = f"{there.main.count:,} rows are stored, and {there.expected:,} belong to the config"
        found[main].faults.append(words)
        return found
    use, seen = chosen(seed, there.places, share), Counter[str]()
    for unit, begin, end in use:
        if there.lost(unit):
            seen.update({name: there.of(name, unit).num_rows for name in compared if name != main})
            continue
        computed = tables(study, compute(study, unit))
        for name in compared:
            empty = schemas.schema(columns[name]).empty_table()
            rows = schemas.table(columns[name], computed[name]) if computed[name] else empty
            if name != "points":
                rows = rows.take(pa.array(jobs.order(study.estimators, unit, rows)))
            rows = there.kept(rows)
            stored = there.main.rows(begin, end) if name == main else there.of(name, unit)
            seen[name] += stored.num_rows
            found[name].done += 1
            if (fault := difference(stored, rows)) is not None:
                found[name].faults.append(fault)
    for name in compared if len(use) == len(there.places) else ():  # of some units nothing can be said about all rows
        if name != main and (strays := pq.read_metadata(run.path(name)).num_rows - seen[name]):
            found[name].faults.append(f"{strays:,} rows are of no unit")
    return found


class _Stored:
    """The stored rows of a run's units.

    Attributes:
        main: the table that the study keeps.
        places: the units that have rows, each with the number of its first row there, and the one after its last.
        expected: number of rows that the table has by its config, and its precision table.
    """

    def __init__(self, run: Run, names: list[str]) -> None:
        self._run, self._trials = run, run.trials()
        self.main = TableRows(run.path(run.study.keep))
        self._failures = run.arrow("failures") if "failures" in names else None
        self.places: list[tuple[Batch, int, int]] = []
        row = 0
        for unit, count in self._units():
            if count:
                self.places.append((unit, row, row + count))
            row += count
        self.expected = row

    def _units(self) -> Iterator[tuple[Batch, int]]:
        """The units, cut to the trials that their cells have, and their numbers of rows."""
        study = self._run.study
        each = len(study.estimators)
        for unit in units(study):
            if study.keep == "summary":
                yield unit, len(unit.cells) * each
            elif not self._trials:
                yield unit, unit.rows * each
            else:
                counts = {c: min(self._trials[c.name], unit.last) - unit.first for c in unit.cells}
                open_cells = [cell for cell, count in counts.items() if count > 0]
                if open_cells:
                    last = unit.first + max(counts.values())
                    rows = each * sum(counts[c] for c in open_cells)
                    yield Batch(unit.group.only(open_cells), unit.first, last), rows

    def kept(self, rows: pa.Table) -> pa.Table:
        """Leave out rows of trials that an adaptive run did not give to their cells."""
        if not self._trials or not rows.num_rows or "trial" not in rows.schema.names:
            return rows
        cells, trials = rows["cell"].cast(pa.string()).to_pylist(), rows["trial"].to_pylist()
        return rows.filter(pa.array([t < self._trials[c] for c, t in zip(cells, trials, strict=True)]))

    def lost(self, unit: Batch) -> bool:
        """Tell whether a unit's worker died."""
        if self._failures is None:
            return False
        return "worker" in pc.unique(self.of("failures", unit)["cause"].cast(pa.string())).to_pylist()

    def of(self, name: str, unit: Batch) -> pa.Table:
        """Stored rows of a unit in the table of failures or of points."""
        use = (pc.field("trial") >= unit.first) & (pc.field("trial") < unit.last)
        if unit.cells:
            use &= pc.field("cell").cast(pa.string()).isin([cell.name for cell in unit.cells])
        if name == "failures" and self._failures is not None:
            return self._failures.filter(use)
        return pq.read_table(self._run.path(name), filters=use)


CHAIN_TABLES = ("posterior", "answers", "draws")


def recompute_summary(run: Run, seed: str, share: float) -> Recomputed:
    """Compute a share of the rows of a run's summary again from its error table.

    Args:
        run: a run whose error table and summary have the right digests.
        seed: text that determines the choice.
        share: of the rows, in [0, 1].
    """
    grouped, stored = Grouped(run), run.arrow("summary")
    keys = list(grouped.counts)
    found = Recomputed(0, len(keys), "rows")
    if stored.num_rows != len(keys):
        found.faults.append(f"{stored.num_rows:,} rows are stored, and {len(keys):,} belong to the error table")
        return found
    use = chosen(seed, range(len(keys)), share)
    found.done = len(use)
    if use:
        computed = pa.concat_tables(rows_of_groups(run, grouped, [keys[i] for i in use])).unify_dictionaries()
        if (fault := difference(stored.take(np.array(use)), computed)) is not None:
            found.faults.append(fault)
    return found


def recompute_chains(run: Run, names: list[str], seed: str, share: float) -> dict[str, Recomputed]:
    """Run a share of a run's chains again.

    Args:
        run: the run.
        names: tables whose digests are right.
        seed: text that determines the choice.
        share: of the chains, in [0, 1].

    Returns:
        Results by table; none if not all three tables of chains are there.
    """
    study, posterior = run.study, run.study.posterior
    if not set(CHAIN_TABLES) <= set(names):
        return {}
    tasks = chain_tasks(study, posterior) if posterior is not None else []
    found = {name: Recomputed(0, len(tasks), "chains") for name in CHAIN_TABLES}
    asked = [task.part(study, posterior) for task in tasks] if posterior is not None else []
    if json.loads(run.metadata("posterior").get("study.posterior", "[]")) != asked:
        words = f"not the chains that config.toml asks for; `study posterior {run.folder}` computes those"
        found["posterior"].faults.append(words)
        return found
    stored = {name: run.arrow(name) for name in CHAIN_TABLES}
    if stored["posterior"].num_rows != len(tasks):
        found["posterior"].faults.append(f"{stored['posterior'].num_rows:,} of {len(tasks):,} chains are stored")
    use, seen = chosen(seed, tasks, share), Counter[str]()
    for task in use:
        assert posterior is not None
        computed, mine = task.compute(study, posterior), pc.scalar(True)
        for column, value in task.key.items():
            mine = mine & (pc.field(column) == value)
        for name in CHAIN_TABLES:
            found[name].done += 1
            rows = stored[name].filter(mine)
            seen[name] += rows.num_rows
            if (fault := difference(rows, computed[name])) is not None:
                found[name].faults.append(fault)
    for name in CHAIN_TABLES if len(use) == len(tasks) else ():
        if strays := stored[name].num_rows - seen[name]:
            found[name].faults.append(f"{strays:,} rows are of no chain")
    return found


DIGEST_ONLY = {
    "timings": "measured times cannot be computed again",
    "precision": "written while trials were added; the numbers of trials are checked with the errors",
    "claims": "depends on all the runs that `study claims` was given",
}


@dataclass(frozen=True)
class Verification:
    """The result of verifying a run.

    Attributes:
        run: the run.
        digests: for each table, its fault in words, or None if its digest and its columns are right.
        counts: numbers of the manifest that are not those of the config and the tables, in words.
        again: for each table of which something was computed again, the result.
        remark: warning about the software; None if it is this one.
    """

    run: Run
    digests: dict[str, str | None]
    counts: list[str]
    again: dict[str, Recomputed]
    remark: str | None

    @property
    def faults(self) -> list[str]:
        """Everything that is wrong, a line each."""
        found = [fault for fault in self.digests.values() if fault] + self.counts
        for name, result in self.again.items():
            found += [f"{self.run.path(name)}: {fault}" for fault in result.faults]
        return found


def verify(run: Run, share: float = 0.01) -> Verification:
    """Check all tables of a finished run by their digests, and compute a share of its numbers again.

    The units, rows of the summary and chains that are computed again follow from the digest of the manifest.

    Args:
        run: the run.
        share: of all units, rows and chains, in [0, 1]; at least one of each, unless it is 0.

    Raises:
        RunError: if the run is not finished, or its manifest is damaged.
    """
    manifest = run.manifest()
    if run.study.keep not in manifest["tables"]:
        raise RunError(f"{run.folder}: not finished, so there is nothing to verify; {run.again()} finishes it")
    declared = schemas.declared(run.study.dimension, run.study.conditions())
    stored = [name for name in declared if run.has(name) or name in manifest["tables"]]
    digests = {name: _fault(run, name) for name in stored}
    good = [name for name, fault in digests.items() if fault is None]
    seed = str(manifest["digest"])
    again: dict[str, Recomputed] = {}
    if share > 0.0:
        with threadpool_limits(limits=1):
            if run.study.precision is None or "precision" in good:  # the trials of each cell are known
                again |= recompute_units(run, good, seed, share)
            if {"errors", "summary"} <= set(good):
                again["summary"] = recompute_summary(run, seed, share)
            again |= recompute_chains(run, good, seed, share)
    return Verification(run, digests, _wrong_counts(run, good), again, other_version(run.maker()))


def _fault(run: Run, name: str) -> str | None:
    try:
        if not run.has(name):
            return f"{run.path(name)}: missing; {run.again(name)} makes it again"
        run.check(name)
    except RunError as error:
        return str(error)
    return None


def _wrong_counts(run: Run, good: list[str]) -> list[str]:
    """Compare the manifest's numbers with the config and the table of failures, unless that is damaged."""
    manifest, counts = run.manifest(), {"cells": run.study.cells()}
    if "failures" in good or not (run.has("failures") or "failures" in manifest["tables"]):
        causes = run.arrow("failures")["cause"].to_pylist() if "failures" in good else []
        counts |= {"failures": len(causes), "lost": causes.count("worker")}
    path = run.folder / "manifest.json"
    wrong = [name for name, count in counts.items() if manifest[name] != count]
    return [f"{path}: {name} = {manifest[name]:,}, where the tables have {counts[name]:,}" for name in wrong]


def printed(found: Verification) -> Iterator[str]:
    """A verification for a terminal: a line for each table, the faults, and the verdict."""
    run = found.run
    yield f"{run.folder}: {run.study.run_name()}"
    rows = []
    for name, fault in found.digests.items():
        result = found.again.get(name)
        words = DIGEST_ONLY.get(name, "")
        if result is not None:
            count = f"{result.done:,} of {result.total:,} {result.unit} computed again"
            words = f"{count}: {'different' if result.faults else 'equal to the bit' if result.done else 'none'}"
        rows.append([name, "SHA-256 as written" if fault is None else "damaged", words])
    yield from columns(rows, indent=2)
    if found.remark is not None:
        yield f"  {found.remark}"
    for fault in found.faults[:10]:
        yield f"  {fault}"
    if found.faults:
        count = f"{len(found.faults):,} faults" if len(found.faults) > 1 else "1 fault"
        odd = [run.path(name).name for name, result in found.again.items() if result.faults]
        odd += ["manifest.json"] * bool(found.counts)
        remedy = f"; remove {', '.join(odd)}, and {run.again()} makes it again" if odd else ""
        yield f"not verified: {count}{remedy}"
    elif not any(result.done for result in found.again.values()):
        yield f"not verified: {len(found.digests):,} tables are as written, but nothing was computed again"
    else:
        done = [f"{r.done:,} of {r.total:,} {r.unit}" for r in found.again.values() if r.done]
        equal = ", ".join(dict.fromkeys(done))
        yield f"verified: {len(found.digests):,} tables are as written; {equal}, computed again, are equal to the bit"
