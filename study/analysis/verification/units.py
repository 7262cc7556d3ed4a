"""Units of a finished run, computed again and compared with the rows that are stored of them."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from study.analysis.verification.bits import chosen, difference
from study.experiment.compute_unit import compute
from study.experiment.designs.groups import Span
from study.experiment.units import spans
from study.runs import assemble
from study.runs.jobs import tables
from study.runs.storage import schemas
from study.runs.storage.run_folder import Run
from study.runs.storage.table_rows import TableRows


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
    for span, begin, end in use:
        if there.lost(span):
            seen.update({name: there.of(name, span).num_rows for name in compared if name != main})
            continue
        computed = tables(study, span.unit(), compute(study, span.unit()))
        for name in compared:
            rows = schemas.table(columns[name], computed[name]) if computed[name] else _empty(columns[name])
            if name != "points":
                rows = rows.take(pa.array(assemble.order(study.estimators, span, rows)))
            rows = there.kept(rows)
            stored = there.main.rows(begin, end) if name == main else there.of(name, span)
            seen[name] += stored.num_rows
            found[name].done += 1
            if (fault := difference(stored, rows)) is not None:
                found[name].faults.append(fault)
    for name in compared if len(use) == len(there.places) else ():  # of some units nothing can be said about all rows
        if name != main and (strays := pq.read_metadata(run.path(name)).num_rows - seen[name]):
            found[name].faults.append(f"{strays:,} rows are of no unit")
    return found


def _empty(columns: list[schemas.Column]) -> pa.Table:
    return schemas.schema(columns).empty_table()


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
        self.places: list[tuple[Span, int, int]] = []
        row = 0
        for span, count in self._spans():
            if count:
                self.places.append((span, row, row + count))
            row += count
        self.expected = row

    def _spans(self) -> Iterator[tuple[Span, int]]:
        """The units, cut to the trials that their cells have, and their numbers of rows."""
        study = self._run.study
        each = len(study.estimators)
        for span in spans(study):
            if study.keep == "summary":
                yield span, len(span.group.cells) * each
            elif not self._trials:
                yield span, span.rows * each
            else:
                counts = {c: min(self._trials[c.name], span.last) - span.first for c in span.group.cells}
                open_cells = [cell for cell, count in counts.items() if count > 0]
                if open_cells:
                    last = span.first + max(counts.values())
                    yield Span(span.group.only(open_cells), span.first, last), each * sum(counts[c] for c in open_cells)

    def kept(self, rows: pa.Table) -> pa.Table:
        """Leave out rows of trials that an adaptive run did not give to their cells."""
        if not self._trials or not rows.num_rows or "trial" not in rows.schema.names:
            return rows
        cells, trials = rows["cell"].cast(pa.string()).to_pylist(), rows["trial"].to_pylist()
        return rows.filter(pa.array([t < self._trials[c] for c, t in zip(cells, trials, strict=True)]))

    def lost(self, span: Span) -> bool:
        """Tell whether a unit's worker died."""
        if self._failures is None:
            return False
        return "worker" in pc.unique(self.of("failures", span)["cause"].cast(pa.string())).to_pylist()

    def of(self, name: str, span: Span) -> pa.Table:
        """Stored rows of a unit in the table of failures or of points."""
        use = (pc.field("trial") >= span.first) & (pc.field("trial") < span.last)
        if span.group.cells:
            use &= pc.field("cell").cast(pa.string()).isin([cell.name for cell in span.group.cells])
        if name == "failures" and self._failures is not None:
            return self._failures.filter(use)
        return pq.read_table(self._run.path(name), filters=use)
