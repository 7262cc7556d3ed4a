"""A study that grew: rows are taken from an earlier run of the same name, or of the same folder, where they are equal.

More trials, cells or estimators leave the rows of a smaller study as they are, bit for bit. So where a finished run of
a smaller study lies beside a new one, the new one's units are cut into what the earlier has and what it has not. Rows
of an estimator of another version, and of units that a worker died of, are computed anew. A run of the very same config
in another folder is left alone: running a study again is how it is checked. A study with a precision neither takes rows
from another run nor gives any.
"""

import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from study.experiment.config import Study
from study.experiment.designs.groups import Group, Span
from study.experiment.streams import Name
from study.experiment.units import groups, spans, trials_of
from study.runs.jobs import Job, estimators_of, output
from study.runs.layout import Layout
from study.runs.storage.atomic_write import RunError
from study.runs.storage.parts import FORMAT, Packet
from study.runs.storage.run_folder import Run


class Cut(Layout):
    """How a study's units are cut along those of an earlier one.

    Args:
        study: the new study.
        earlier: the other; None to leave units whole.
    """

    def __init__(self, study: Study, earlier: Study | None) -> None:
        super().__init__(study)
        self.earlier = earlier if earlier is not None and _related(study, earlier) else None
        self._groups = {group.stream: group for group in groups(self.earlier)} if self.earlier is not None else {}
        self._halves: tuple[Group, Group | None, Group | None] | None = None

    def __call__(self, span: Span) -> Iterator[Span]:
        """The pieces of a unit: the earlier run's trials of its cells, more trials of them, and other cells."""
        earlier = self._groups.get(span.group.stream)
        if self.earlier is None or earlier is None:
            yield span
            return
        if self._halves is None or self._halves[0] is not span.group:  # units of a group come one after the other
            self._halves = span.group, *span.group.shared(earlier)
        _, shared, others = self._halves
        if others is not None:
            yield Span(others, span.first, span.last)
        if shared is not None:
            middle = min(max(trials_of(self.earlier, shared), span.first), span.last)
            if span.first < middle:
                yield Span(shared, span.first, middle)
            if middle < span.last:
                yield Span(shared, middle, span.last)


class Earlier:
    """The finished run that rows are taken from.

    Args:
        run: the run.
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        made = run.manifest()["estimators"]
        self.outputs = {f"{name}@{made[name]}" for name in run.study.estimators}
        self._file = pq.ParquetFile(run.path("errors"))
        counts = [self._file.metadata.row_group(i).num_rows for i in range(self._file.num_row_groups)]
        self._ends = [sum(counts[: i + 1]) for i in range(len(counts))]
        self._failures = run.arrow("failures") if run.has("failures") else None
        self._begin: dict[Name, tuple[int, int]] = {}
        row, each = 0, len(run.study.estimators)
        for span in spans(run.study):
            self._begin.setdefault(span.group.stream, (row, span.group.width * each))
            row += span.rows * each

    @classmethod
    def of(cls, run: Run) -> "Earlier | None":
        """The run, if it is finished and its rows are whole."""
        return cls(run) if "errors" in _told(run) and not {"errors", "failures"} & set(damaged(run)) else None

    def take(self, job: Job) -> Packet | None:
        """What a job asks for and this run has; None if that is nothing.

        Args:
            job: outputs of a piece, as `Cut` made it.
        """
        span = job.span
        trials = trials_of(self.run.study, span.group)
        if span.last > trials:
            return None
        outputs = tuple(o for o in job.outputs if o in self.outputs)
        if not outputs or span.group.stream not in self._begin:
            return None
        begin, per_trial = self._begin[span.group.stream]
        size = span.group.size  # whole blocks hold the cells one after the other
        low, high = span.first // size * size, -(-span.last // size) * size
        whole = self._rows(begin + per_trial * low, begin + per_trial * min(high, trials))
        use = (pc.field("trial") >= span.first) & (pc.field("trial") < span.last)
        use &= pc.field("estimator").cast(pa.string()).isin(list(estimators_of(outputs)))
        if span.group.cells:
            use &= pc.field("cell").cast(pa.string()).isin([cell.name for cell in span.group.cells])
        found = {"errors": whole.filter(use)}
        if found["errors"].num_rows != span.rows * len(outputs):
            return None
        if self._failures is not None:
            cells = pc.unique(found["errors"]["cell"]).to_pylist()
            found["failures"] = self._failures.filter(use & pc.field("cell").cast(pa.string()).isin(cells))
            if "worker" in pc.unique(found["failures"]["cause"]).to_pylist():
                return None
        return Packet.of([(job.key, outputs)], [found])

    def _rows(self, begin: int, end: int) -> pa.Table:
        """Rows of the error table from one number to before another."""
        groups = [i for i, last in enumerate(self._ends) if last > begin and (self._ends[i - 1] if i else 0) < end]
        start = self._ends[groups[0] - 1] if groups and groups[0] else 0
        return pa.concat_tables([self._group(i) for i in groups]).slice(begin - start, end - begin)

    @lru_cache(maxsize=2)  # noqa: B019  lives as long as the run that it is for
    def _group(self, index: int) -> pa.Table:
        return self._file.read_row_group(index)


def finished(run: Run) -> bool:
    """Whether a run is finished, and its tables are those that its manifest tells of."""
    return run.study.keep in _told(run) and run.stopped() is None and not damaged(run)


def damaged(run: Run) -> list[str]:
    """Names of a finished run's tables that are not any more as they were written."""
    return [name for name, digest in _told(run).items() if run.fingerprint(name) != digest]


def _told(run: Run) -> dict[str, str]:
    """Digests of the tables, as the manifest tells them; none of a run that is not finished."""
    try:
        said: dict[str, Any] = run.manifest()
        known = said["format"] == FORMAT and set(said["estimators"]) == set(run.study.estimators)
        return dict(said["tables"]) if known else {}
    except (RunError, KeyError, TypeError, ValueError):
        return {}


def up_to_date(run: Run) -> bool:
    """Whether a finished run has nothing left to compute: its estimators are of today's versions, no unit was lost."""
    said = run.manifest()
    return not said["lost"] and all(f"{n}@{v}" == output(n) for n, v in said["estimators"].items())


def beside(study: Study, folder: Path) -> Run | None:
    """The finished run of the same name, next to a folder, that has most trials and cells of a study."""
    found: list[tuple[int, Run]] = []
    for path in sorted(folder.parent.glob(f"{study.name}-*")):
        if path == folder or not re.fullmatch(r"[0-9a-f]{10}", path.name.removeprefix(f"{study.name}-")):
            continue
        try:
            run = Run.open(path)
        except RunError:
            continue
        if run.study.digest() != study.digest() and _related(study, run.study):
            shared = set(run.study.estimators) & set(study.estimators)
            found.append((sum(each.rows for each in spans(run.study)) * len(shared), run))
    found.sort(key=lambda entry: -entry[0])
    return next((run for worth, run in found if worth and Earlier.of(run)), None)


def _related(study: Study, earlier: Study) -> bool:
    """Whether equal conditions have equal rows in two studies, and each has as many as its design says."""
    if study.precision is not None or earlier.precision is not None:
        return False
    return study.stem() == earlier.stem() and study.design.same_draws(earlier.design)
