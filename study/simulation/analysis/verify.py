"""Verification of a run: every table by its digest, and a share of its numbers by computing them again.

Units, rows of the summary and chains are chosen at random, computed again, and compared with the stored rows to the
last bit.
"""

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import nsmallest
from typing import TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from threadpoolctl import threadpool_limits

from study.files import RunError, TableRows
from study.simulation.analysis.error_table import Grouped
from study.simulation.analysis.summary import rows_of_groups
from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch
from study.simulation.posterior.run import chain_tasks
from study.simulation.runs import parts, schemas
from study.simulation.runs.parts import tables
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
        total: number of things that there are.
        unit: the things in words, in the plural.
        done: number of things that were computed again.
        rows: number of rows that are stored of the things that were looked at.
        faults: differences, in words.
    """

    total: int
    unit: str
    done: int = 0
    rows: int = 0
    faults: list[str] = field(default_factory=list)

    def compare(self, stored: pa.Table, computed: pa.Table, things: int = 1) -> None:
        """Compare the stored rows of some things with those computed again."""
        self.done += things
        self.rows += stored.num_rows
        if (fault := difference(stored, computed)) is not None:
            self.faults.append(fault)

    def count(self, rows: int, thing: str) -> None:
        """Compare the number of all rows with those looked at, where all things were."""
        if strays := rows - self.rows:
            self.faults.append(f"{strays:,} rows are of no {thing}")


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
    study, trials = run.study, run.trials()
    main: str = study.keep
    others: list[str] = [name for name in ("points", "failures") if name in names]
    if main not in names:
        return {}
    columns = schemas.of_units(*study.columns())
    table, places = TableRows(run.path(main)), _places(study, trials)
    results = {name: Recomputed(len(places), "units") for name in (main, *others)}
    if (expected := places[-1][2] if places else 0) != table.count:
        results[main].faults.append(f"{table.count:,} rows are stored, and {expected:,} belong to the config")
        return results
    use = chosen(seed, places, share)
    for unit, begin, end in use:
        stored = {name: pq.read_table(run.path(name), filters=parts.of_batch(unit)) for name in others}
        if "failures" in others and "worker" in stored["failures"]["cause"].to_pylist():
            for name in others:
                results[name].rows += stored[name].num_rows
            continue
        computed, stored[main] = tables(study, compute(study, unit)), table.rows(begin, end)
        for name, result in results.items():
            rows = schemas.schema(columns[name]).empty_table()
            if computed[name]:
                rows = schemas.table(columns[name], computed[name])
            if name != "points":
                rows = rows.take(parts.order(study.estimators, unit, rows))
            result.compare(stored[name], _of_cells(rows, trials))
    for name in others if len(use) == len(places) else ():  # of some units nothing can be said about all rows
        results[name].count(pq.read_metadata(run.path(name)).num_rows, "unit")
    return results


def _places(study: Study, trials: Mapping[str, int]) -> list[tuple[Batch, int, int]]:
    """The units of a run, each with the numbers of its first row in the main table and of the one after its last.

    Args:
        study: the config.
        trials: number of trials of each cell of an adaptive run, to which units are cut; empty for another.
    """
    places: list[tuple[Batch, int, int]] = []
    for unit in study.units():
        rows = len(unit.cells) if study.keep == "summary" else unit.rows
        if trials:
            counts = {c: min(trials[c.name], unit.last) - unit.first for c in unit.cells}
            counts = {cell: count for cell, count in counts.items() if count > 0}
            if not counts:
                continue
            rows = sum(counts.values())
            unit = Batch(unit.group.only(counts), unit.first, unit.first + max(counts.values()))
        begin = places[-1][2] if places else 0
        places.append((unit, begin, begin + rows * len(study.estimators)))
    return places


def _of_cells(rows: pa.Table, trials: Mapping[str, int]) -> pa.Table:
    """Leave out rows of trials that an adaptive run did not give to their cells."""
    if not trials or not rows.num_rows or "trial" not in rows.schema.names:
        return rows
    pairs = zip(rows["cell"].cast(pa.string()).to_pylist(), rows["trial"].to_pylist(), strict=True)
    return rows.filter(pa.array([trial < trials[cell] for cell, trial in pairs]))


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
    result = Recomputed(len(keys), "rows")
    if stored.num_rows != len(keys):
        result.faults.append(f"{stored.num_rows:,} rows are stored, and {len(keys):,} belong to the error table")
    elif use := chosen(seed, range(len(keys)), share):
        computed = pa.concat_tables(rows_of_groups(run, grouped, [keys[i] for i in use])).unify_dictionaries()
        result.compare(stored.take(np.array(use)), computed, len(use))
    return result


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
    if not set(CHAIN_TABLES) <= set(names):
        return {}
    tasks = chain_tasks(run.study)
    results = {name: Recomputed(len(tasks), "chains") for name in CHAIN_TABLES}
    if json.loads(run.metadata("posterior").get("study.posterior", "[]")) != [task.part for task in tasks]:
        words = f"not the chains that config.toml asks for; `study posterior {run.folder}` computes those"
        results["posterior"].faults.append(words)
        return results
    stored = {name: run.arrow(name) for name in CHAIN_TABLES}
    if stored["posterior"].num_rows != len(tasks):
        words = f"{stored['posterior'].num_rows:,} of {len(tasks):,} chains are stored"
        results["posterior"].faults.append(words)
    use = chosen(seed, tasks, share)
    for task in use:
        computed = task.compute()
        for name, result in results.items():
            result.compare(task.of(stored[name]), computed[name])
    for name, result in results.items() if len(use) == len(tasks) else ():
        result.count(stored[name].num_rows, "chain")
    return results


DIGEST_ONLY = {
    "timings": "measured times cannot be computed again",
    "precision": "written while trials were added; the numbers of trials are checked with the errors",
    "claims": "depends on all the runs that `study claims` was given",
}


class Verification:
    """All tables of a finished run, checked by their digests, and a share of its numbers, computed again.

    The units, rows of the summary and chains that are computed again follow from the digest of the manifest.

    Args:
        run: the run.
        share: of all units, rows and chains, in [0, 1]; at least one of each, unless it is 0.

    Attributes:
        run: the run.
        digests: for each table, its fault in words, or None if its digest and its columns are right.
        counts: numbers of the manifest that are not those of the config and the tables, in words.
        again: for each table of which something was computed again, the result.
        remarks: warnings about software and about files of a user's own that are not those that made the run.

    Raises:
        RunError: if the run is not finished, or its manifest is damaged.
    """

    def __init__(self, run: Run, share: float = 0.01) -> None:
        manifest = run.manifest()
        if run.study.keep not in manifest["tables"]:
            raise RunError(f"{run.folder}: not finished, so there is nothing to verify; {run.again()} finishes it")
        declared = schemas.declared(*run.study.columns())
        stored = [name for name in declared if run.has(name) or name in manifest["tables"]]
        self.run, self.digests = run, {name: _fault(run, name) for name in stored}
        good = [name for name, fault in self.digests.items() if fault is None]
        seed = str(manifest["digest"])
        self.again: dict[str, Recomputed] = {}
        if share > 0.0:
            with threadpool_limits(limits=1):
                if run.study.precision is None or "precision" in good:  # the trials of each cell are known
                    self.again |= recompute_units(run, good, seed, share)
                if {"errors", "summary"} <= set(good):
                    self.again["summary"] = recompute_summary(run, seed, share)
                self.again |= recompute_chains(run, good, seed, share)
        changed = (
            f"{name}: changed since the run was made: numbers computed now may differ" for name in run.changed_code()
        )
        self.counts, self.remarks = _wrong_counts(run, good), [*filter(None, [other_version(run.maker())]), *changed]

    @property
    def faults(self) -> list[str]:
        """Everything that is wrong, a line each."""
        again = [f"{self.run.path(name)}: {fault}" for name, result in self.again.items() for fault in result.faults]
        return [fault for fault in self.digests.values() if fault] + self.counts + again


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


def printed(result: Verification) -> Iterator[str]:
    """A verification for a terminal: a line for each table, the faults, and the verdict."""
    run = result.run
    yield f"{run.folder}: {run.study.run_name()}"
    rows = []
    for name, fault in result.digests.items():
        again = result.again.get(name)
        words = DIGEST_ONLY.get(name, "")
        if again is not None:
            count = f"{again.done:,} of {again.total:,} {again.unit} computed again"
            words = f"{count}: {'different' if again.faults else 'equal to the bit' if again.done else 'none'}"
        rows.append([name, "SHA-256 as written" if fault is None else "damaged", words])
    yield from columns(rows, indent=2)
    yield from (f"  {remark}" for remark in result.remarks)
    for fault in result.faults[:10]:
        yield f"  {fault}"
    if result.faults:
        count = f"{len(result.faults):,} faults" if len(result.faults) > 1 else "1 fault"
        odd = [run.path(name).name for name, again in result.again.items() if again.faults]
        odd += ["manifest.json"] * bool(result.counts)
        remedy = f"; remove {', '.join(odd)}, and {run.again()} makes it again" if odd else ""
        yield f"not verified: {count}{remedy}"
    elif not any(again.done for again in result.again.values()):
        yield f"not verified: {len(result.digests):,} tables are as written, but nothing was computed again"
    else:
        done = [f"{r.done:,} of {r.total:,} {r.unit}" for r in result.again.values() if r.done]
        equal = ", ".join(dict.fromkeys(done))
        yield f"verified: {len(result.digests):,} tables are as written; {equal}, computed again, are equal to the bit"
