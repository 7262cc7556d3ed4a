"""Reuse of the rows of an earlier, smaller run, and repair of a run's folder.

More trials, cells or estimators leave the rows of a smaller study as they are, bit for bit. So if a finished run of a
smaller study, of the same name, lies next to a new one or in its folder, the new one's units are cut into pieces that
the earlier run has and pieces that it has not. Rows of an estimator of another version, and of units whose worker died,
are computed again. A run of the very same config in another folder is not used, because a study is run again to check
it. An adaptive study neither takes rows of another run nor gives any.

A run is finished if its tables are as its manifest says, and up to date if nothing is left to compute. Damaged files
are named and set aside, so that they are made again.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from study.files import RunError, TableRows
from study.fits.random import Name
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch, Group
from study.simulation.experiment.sampling import groups, trials_of, units
from study.simulation.runs.jobs import Layout, UnitTask, estimators_of, order, output
from study.simulation.runs.parts import FORMAT, Packet
from study.simulation.runs.run_folder import NAME, Run

DERIVED = ("posterior", "answers", "draws", "claims")
"""Tables that are not made from units, and so stay when units are computed again."""


def finished(run: Run) -> bool:
    """Tell whether a run is finished and the tables of its units have the digests of its manifest."""
    if run.study.keep not in digests(run) or run.stopped() is not None:
        return False
    apart = {*DERIVED, *({"summary"} - {run.study.keep})}
    return not set(damaged(run)) - apart


def damaged(run: Run) -> list[str]:
    """Names of the tables in a run's manifest that have changed since, are gone, or have other columns."""
    try:
        tables = run.manifest()["tables"]
    except RunError:
        return []
    return [name for name, digest in tables.items() if run.fingerprint(name) != digest or run.column_fault(name)]


def digests(run: Run) -> dict[str, str]:
    """Digests of the tables in a run's manifest, by name; none of a run that is not finished."""
    try:
        manifest = run.manifest()
    except RunError:
        return {}
    known = manifest["format"] == FORMAT and set(manifest.get("estimators", ())) == set(run.study.estimators)
    return dict(manifest["tables"]) if known else {}


def up_to_date(run: Run) -> bool:
    """Tell whether a finished run has nothing left to compute: no estimator is newer, and no unit lost its worker."""
    manifest = run.manifest()
    return not manifest["lost"] and all(f"{n}@{v}" == output(n) for n, v in manifest["estimators"].items())


def set_damaged_aside(run: Run, warn: Callable[[str], None]) -> None:
    """Move a damaged manifest and damaged tables to ``parts/damaged``.

    Args:
        run: the run, whose lock is held.
        warn: callback for warnings, a line for each file.
    """
    config = run.folder / "config.toml"
    try:
        changed = config.exists() and Run.open(run.folder).study.digest() != run.study.digest()
    except RunError:
        changed = True
    if changed:
        warn(f"{config}: not the config that the run was made of; written again")
    if (fault := run.set_manifest_aside()) is not None:
        warn(f"{fault}; set aside in parts/damaged, and its tables are made again")
    for name in _unknown(run):
        warn(f"{run.path(name)}: not in {NAME}; set aside in parts/damaged; {run.again(name)} makes it again")
        run.set_aside(name)
    for name in damaged(run):
        ours = name != "claims"  # which may need other runs
        words = "damaged; set aside in parts/damaged" if run.has(name) else "missing"
        warn(f"{run.path(name)}: {words}{', and made again' if ours else f'; {run.again(name)} makes it again'}")
        run.set_aside(name)
        if not ours:
            run.forget(name)


def _unknown(run: Run) -> list[str]:
    """Tables that no manifest vouches for, and that the run will not make again."""
    try:
        known = run.manifest()["tables"]
    except RunError:
        known = {}
    made = ("posterior", "answers", "draws") if run.study.posterior is not None else ()
    return [name for name in DERIVED if name not in made and name not in known and run.has(name)]


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

    def cut(self, unit: Batch) -> Iterator[Batch]:
        """Cut a unit into the earlier run's trials of its cells, further trials of them, and other cells."""
        earlier = self._groups.get(unit.group.stream)
        if self.earlier is None or earlier is None:
            yield unit
            return
        if self._halves is None or self._halves[0] is not unit.group:  # units of a group come one after the other
            self._halves = unit.group, *unit.group.shared(earlier)
        _, shared, others = self._halves
        if others is not None:
            yield Batch(others, unit.first, unit.last)
        if shared is not None:
            middle = min(max(trials_of(self.earlier, shared), unit.first), unit.last)
            if unit.first < middle:
                yield Batch(shared, unit.first, middle)
            if middle < unit.last:
                yield Batch(shared, middle, unit.last)


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
        for unit in units(run.study):
            self._begin.setdefault(unit.group.stream, (row, unit.group.width * estimators))
            row += unit.rows * estimators

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

    def take(self, task: UnitTask) -> Packet | None:
        """Take the rows of a task that this run has, in the order that the task gives them; None if it has none.

        Args:
            task: outputs of a piece, as `ReuseLayout` cut it.
        """
        unit = task.batch
        trials = trials_of(self.run.study, unit.group)
        if unit.last > trials:
            return None
        outputs = tuple(o for o in task.outputs if o in self.outputs)
        if not outputs or unit.group.stream not in self._begin:
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
            result.append((sum(item.rows for item in units(run.study)) * len(shared), run))
    result.sort(key=lambda entry: -entry[0])
    return next((run for rows, run in result if rows and EarlierRun.of(run)), None)


def _related(study: Study, earlier: Study) -> bool:
    """Tell whether equal conditions have equal rows in two studies, and each has as many as its design says."""
    if study.precision is not None or earlier.precision is not None:
        return False
    return study.stem() == earlier.stem() and study.design.same_draws(earlier.design)
