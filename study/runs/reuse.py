"""Reuse of the rows of an earlier, smaller run, of the same name or in the same folder.

More trials, cells or estimators leave the rows of a smaller study as they are, bit for bit. So if a finished run of a
smaller study lies beside a new one, the new one's units are cut into pieces that the earlier run has and pieces that it
has not. Rows of an estimator of another version, and of units whose worker died, are computed again. A run of the very
same config in another folder is not used, because a study is run again to check it. An adaptive study neither takes
rows of another run nor gives any.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from study.experiment.config import Study
from study.experiment.designs.groups import Group, Span
from study.experiment.streams import Name
from study.experiment.units import groups, spans, trials_of
from study.runs.assemble import order
from study.runs.completeness import damaged, digests
from study.runs.jobs import Job, estimators_of
from study.runs.layout import Layout
from study.runs.storage.atomic_write import RunError
from study.runs.storage.parts import Packet
from study.runs.storage.run_folder import Run
from study.runs.storage.table_rows import TableRows


class ReuseLayout(Layout):
    """A study's units, cut along those of an earlier study.

    Args:
        study: the new study.
        earlier: the earlier study; None to leave units whole.
    """

    def __init__(self, study: Study, earlier: Study | None) -> None:
        super().__init__(study)
        self.earlier = earlier if earlier is not None and _related(study, earlier) else None
        self._groups = {group.stream: group for group in groups(self.earlier)} if self.earlier is not None else {}
        self._halves: tuple[Group, Group | None, Group | None] | None = None

    def cut(self, span: Span) -> Iterator[Span]:
        """Cut a unit into the earlier run's trials of its cells, further trials of them, and other cells."""
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
        row, each = 0, len(run.study.estimators)
        for span in spans(run.study):
            self._begin.setdefault(span.group.stream, (row, span.group.width * each))
            row += span.rows * each

    @classmethod
    def of(cls, run: Run) -> "EarlierRun | None":
        """Open a run; None if it is not finished, or its rows are damaged."""
        if "errors" not in digests(run) or {"errors", "failures"} & set(damaged(run)):
            return None
        try:
            run.check("errors")
            return cls(run)
        except RunError:  # of a version with other columns
            return None

    def take(self, job: Job) -> Packet | None:
        """Take the rows of a job that this run has, in the order that the job gives them; None if it has none.

        Args:
            job: outputs of a piece, as `ReuseLayout` cut it.
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
        whole = self._errors.rows(begin + per_trial * low, begin + per_trial * min(high, trials))
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
        ordered = {name: table.take(order(estimators_of(outputs), span, table)) for name, table in found.items()}
        return Packet.of([(job.key, outputs)], [ordered])


def beside(study: Study, folder: Path) -> Run | None:
    """Find the finished run of the same name, next to a folder, that has most rows of a study."""
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
    return next((run for rows, run in found if rows and EarlierRun.of(run)), None)


def _related(study: Study, earlier: Study) -> bool:
    """Tell whether equal conditions have equal rows in two studies, and each has as many as its design says."""
    if study.precision is not None or earlier.precision is not None:
        return False
    return study.stem() == earlier.stem() and study.design.same_draws(earlier.design)
