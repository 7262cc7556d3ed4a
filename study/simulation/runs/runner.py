"""The runner: computes what is missing of a study's run, stores it as it comes back, and joins it to tables.

More trials, cells or estimators leave the rows of a smaller study as they are, bit for bit. So if a finished run of a
smaller study, of the same name, lies next to a new one or in its folder, the new one's units are cut into pieces that
the earlier run has and pieces that it has not. Rows of an estimator of another version, and of units whose worker died,
are computed again. A run of the very same config in another folder is not used, because a study is run again to check
it. An adaptive study neither takes rows of another run nor gives any.

Jobs that know nothing of each other compute a share of a run each, into folders of their own. The parts of all shares,
copied to one folder, are a run that has nothing left to compute.
"""

import contextlib
import json
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from itertools import chain, islice
from operator import attrgetter
from pathlib import Path

import pyarrow.compute as pc
import pyarrow.parquet as pq
from threadpoolctl import threadpool_limits

from study.files import RunError, TableRows, explained, write, writing
from study.fits import ESTIMATORS
from study.fits.loops.random import Name
from study.fits.registry import only_here
from study.simulation.experiment import laws, measures
from study.simulation.experiment.config import Study
from study.simulation.runs import provenance, schemas
from study.simulation.runs.adaptive import BUDGET, TARGET, Rounds, TimeBudget
from study.simulation.runs.parts import (
    FORMAT,
    Layout,
    Packet,
    Parts,
    Share,
    ShareLayout,
    UnitTask,
    among,
    dealt,
    estimators_of,
    execute,
    give_up,
    of_batch,
    order,
    related,
)
from study.simulation.runs.run_folder import Run
from study.simulation.runs.workers import Dispatch, Threads, Workers


def budget_message(run: Run) -> str | None:
    """Message for a run that its budget stopped; None for another."""
    if (seconds := run.stopped()) is None:
        return None
    reasons, all_cells = run.manifest()["precision"], run.manifest()["cells"]
    done = f"{reasons.get(TARGET, 0):,} of {all_cells:,} cells reached the target"
    return f"{run.folder}: stopped by its budget of {seconds:g} s: {done}; {run.again()} resumes it"


def failure_message(run: Run) -> str | None:
    """Message for a finished run whose share of failed fits is larger than its config tolerates; None for another."""
    manifest, tolerated = run.manifest(), run.study.tolerate_failures
    failures, fits = manifest["failures"], manifest["fits"]
    if failures <= tolerated * fits:
        return None
    words = f"{failures:,} of {fits:,} fits raised an exception or killed their worker"
    first = run.arrow("failures").slice(0, 1).to_pylist()[0]
    words += f", the first of them {first['name']} by {first['estimator']}: {first['message'].splitlines()[0]}"
    return f"{run.path('failures')}: {words}; tolerate_failures = {tolerated:g}"


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
        if "errors" not in run.digests() or {"errors", "failures"} & set(run.damaged()) or not run.same_code():
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
        use = among("estimator", estimators_of(outputs)) & of_batch(unit)
        rows = {"errors": whole.filter(use)}
        if rows["errors"].num_rows != unit.rows * len(outputs):
            return None
        if self._failures is not None:
            cells = pc.unique(rows["errors"]["cell"]).to_pylist()
            rows["failures"] = self._failures.filter(use & among("cell", cells))
            if "worker" in pc.unique(rows["failures"]["cause"]).to_pylist():
                return None
        ordered = {name: table.take(order(estimators_of(outputs), unit, table)) for name, table in rows.items()}
        return Packet.of([(task.key, outputs)], [ordered])


def neighbour(study: Study, folder: Path) -> Run | None:
    """Find the finished run of the same name, next to a folder, that has most rows of a study."""
    earlier: list[tuple[int, Run]] = []
    for path in sorted(folder.parent.glob(f"{study.name}-*")):
        if path == folder or not re.fullmatch(r"[0-9a-f]{10}", path.name.removeprefix(f"{study.name}-")):
            continue
        try:
            run = Run.open(path)
        except RunError:
            continue
        if run.study.digest() != study.digest() and related(study, run.study):
            shared = set(run.study.estimators) & set(study.estimators)
            earlier.append((sum(item.rows for item in run.study.units()) * len(shared), run))
    earlier.sort(key=lambda entry: -entry[0])
    return next((run for rows, run in earlier if rows and EarlierRun.of(run)), None)


Progress = Callable[[float, int, int], None]
"""Callback for progress: called with the share of all work, in [0, 1], that was done since the last call, and with the
numbers of units that are done, and of all that are known."""
Warn = Callable[[str], None]
"""Callback for warnings, each a line."""


def run(
    study: Study,
    config: str,
    folder: Path,
    jobs: Workers | int = 2,
    progress: Progress | None = None,
    warn: Warn | None = None,
    budget: TimeBudget | None = None,
) -> Run:
    """Run a study, or resume its run.

    Args:
        study: the config.
        config: its text, stored beside the tables.
        folder: the run's folder.
        jobs: number of threads, or other workers.
        progress: callback for progress.
        warn: callback for warnings; they go to standard error if there is none.
        budget: time after which no new work is started, for an adaptive study; by default the config's.

    Returns:
        The finished run, or one that its budget stopped (`Run.stopped`); run it again to resume it. The error table of
        a finished run depends neither on the workers, nor on their order, nor on interruptions.

    Raises:
        RunError: if the folder belongs to another config, is being written to, or cannot be written, or the workers
            cannot be started. What was finished is kept.
        ValueError: if the study has a budget and no precision.
    """
    if study.precision is None and budget is not None:
        raise ValueError(f"{study.run_name()}: a budget is for a config with [precision]")
    budget = budget or TimeBudget(study.precision.seconds if study.precision else None)
    with _begun(study, config, folder, jobs, progress, warn, budget) as (computation, backend):
        store = computation.store
        if (known := store.share()) is not None:
            words = f"is for share {known[0]} of a run; `study merge` puts shares together"
            raise RunError(f"{folder}: {words}; choose another folder with --out")
        if store.finished() and store.up_to_date():
            computation.parts.remove()  # of a run that was killed just before this, its last step
            return store
        computation.prepare()
        computation.compute(backend)
        while computation.layout.advance(computation.parts) or not computation.whole():
            computation.compute(backend)
        computation.finish()
        return store


def run_share(
    study: Study,
    config: str,
    folder: Path,
    share: Share,
    jobs: Workers | int = 2,
    progress: Progress | None = None,
    warn: Warn | None = None,
) -> Run:
    """Compute a share of a study's units, or what is missing of it, into a folder of its own.

    Args:
        study: the config.
        config: its text.
        folder: the share's folder.
        share: the share.
        jobs: see `run`.
        progress: see `run`.
        warn: see `run`.

    Returns:
        The folder as a run that has parts and no tables; see `gather`.

    Raises:
        RunError: as `run`; also if the study is adaptive, or the folder holds anything else.
    """
    _refuse_rounds(study)
    with _begun(study, config, folder, jobs, progress, warn, TimeBudget()) as (computation, backend):
        store, mine = computation.store, (share, provenance.fingerprint())
        if (known := store.share()) is None:
            if store.known():
                raise RunError(f"{folder}: holds a run, and no share of one; choose another folder with --out")
            store.save_share(*mine)
        elif known != mine:
            differ = ", ".join(provenance.differences(known[1])) or f"share {share} instead of {known[0]}"
            raise RunError(f"{folder}: was begun otherwise: {differ}; remove it, or choose another with --out")
        computation.layout = ShareLayout(study, share)
        computation.whole()
        computation.compute(backend)
        while not computation.whole():
            computation.compute(backend)
        return store


def gather(study: Study, config: str, folder: Path, shares: Sequence[Path], warn: Warn | None = None) -> None:
    """Copy the parts of shares to the folder of their run, so that `run` has nothing left to compute.

    Args:
        study: the config.
        config: its text.
        folder: the run's folder.
        shares: folders of shares.
        warn: see `run`.

    Raises:
        RunError: if one holds no share, or one of another config or of other software; or if rows are missing: the
            message says of which shares, and how to compute them.
    """
    _refuse_rounds(study)
    if not shares:
        raise RunError(f"{folder}: no share of it is stored; `study run CONFIG --part 1/N` computes the first of N")
    places = {_share_in(place, study): place for place in shares}
    store, parts = Run.create(folder, study), Parts(folder, "units")
    with writing(folder):
        store.begin(config)
        if store.finished() and store.up_to_date():
            return
        with explained(folder):
            parts.folder.mkdir(exist_ok=True)
            for path in chain.from_iterable(Parts(place, "units").files() for place in shares):
                if not (parts.folder / path.name).exists():
                    write(parts.folder / path.name, path.read_bytes())
        for name in parts.load():
            (warn or partial(print, file=sys.stderr))(f"{parts.folder / name}: damaged; set aside in parts/damaged")
    if parts.note:
        words = "holds rows of a run that goes on with an earlier one, and has other units"
        raise RunError(f"{folder}: {words}; choose another folder with --out, or finish it with {store.again()}")
    of = max(share.of for share in places)
    tasks = enumerate(dealt(Layout(study)))
    if missing := sorted({i % of + 1 for i, task in tasks if set(task.outputs) - parts.outputs(task.key)}):
        first, numbers = Share(missing[0], of), ",".join(map(str, missing))
        command = ["study", "run", f"{folder / 'config.toml'}", "--part", str(first), *store.plugins()]
        command += ["--out", str(places[first])] if first in places else []
        words = f"`{' '.join(command)}` computes the first of them, {store.again()} all of them here"
        raise RunError(f"{folder}: not complete; missing shares: {numbers} of {of}; {words}")


def _refuse_rounds(study: Study) -> None:
    """Raise a RunError for an adaptive study, whose units follow from the rows of all shares."""
    if study.precision is not None:
        words = "[precision] decides by all rows which units come next, so that no share can be computed alone"
        raise RunError(f"{study.run_name()}: {words}; leave it out, or use --backend dask")


def _share_in(folder: Path, study: Study) -> Share:
    """The share of a study that a folder is for; see `gather`."""
    run = Run.open(folder)
    if (known := run.share()) is None:
        raise RunError(f"{folder}: holds no share of a run; `study run CONFIG --part K/N` makes one")
    if run.study.digest() != study.digest():
        words = f"holds a share of another config ({run.study.run_name()}, not {study.run_name()})"
        raise RunError(f"{folder}: {words}; leave it out")
    if differ := provenance.differences(known[1]):
        words = f"share {known[0]} was computed by other software: here is {', '.join(differ)}"
        raise RunError(f"{folder}: {words}; merge with that software, or remove the folder and run the share again")
    return known[0]


@contextlib.contextmanager
def _begun(
    study: Study,
    config: str,
    folder: Path,
    jobs: Workers | int,
    progress: Progress | None,
    warn: Warn | None,
    budget: TimeBudget,
) -> Iterator[tuple["_Computation", Threads]]:
    """Start workers, and begin a run in its folder, which is locked; see `run`."""
    warn = warn or partial(print, file=sys.stderr)
    workers = Workers(jobs=jobs) if isinstance(jobs, int) else jobs
    names = only_here(study.estimators) + laws.only_here(study.own_laws()) + measures.only_here(study.measures)
    if workers.backend != "threads" and names:
        words = f"registered by this program alone, which {workers.backend} workers do not know"
        raise RunError(f"{', '.join(names)}: {words}; use threads, or a file with --plugin")
    with workers.open() as backend, threadpool_limits(limits=1):
        store = Run.create(folder, study)
        with writing(folder):
            computation = _Computation(store, workers, budget, progress or (lambda *numbers: None), warn)
            store.set_damaged_aside(warn)
            store.begin(config)
            yield computation, backend


class _Computation:
    """A run that is being computed, with its workers and budget, and the callbacks for progress and warnings."""

    def __init__(self, store: Run, workers: Workers, budget: TimeBudget, progress: Progress, warn: Warn) -> None:
        self.store, self.workers, self.budget, self.progress, self.warn = store, workers, budget, progress, warn
        self.study, self.started, self.left = store.study, datetime.now(UTC), 1.0
        self.parts = Parts(store.folder, "units", provenance.software())
        self.layout = Layout(self.study)

    def prepare(self) -> None:
        """Read the stored parts, and reuse the rows of an earlier run."""
        self.whole()
        for made in self.parts.made_by:
            self.warn(f"{self.store.folder}: resumes what {provenance.described(made)} computed")
        if self.study.precision is not None:
            self.layout = Rounds(self.study)
            return
        before = Study.model_validate_json(self.parts.note) if self.parts.note else None
        self.layout = Layout(self.study, before)
        if self.parts.count and before is None:
            return
        runs = [run for run in (self.store, neighbour(self.study, self.store.folder)) if run is not None]
        # a resumed run stays with the one that it began with
        fits = (run for run in runs if before is None or run.study.canonical() == before.canonical())
        source = next(filter(None, map(EarlierRun.of, fits)), None)
        if source is None:
            return
        self.layout = Layout(self.study, source.run.study)
        self.parts.note = source.run.study.canonical()
        self.parts.sources = source.run.makers()
        taken = total = 0
        for task in self.layout.missing(self.parts):
            total += 1
            if (packet := source.take(task)) is not None:
                taken += 1
                self.parts.add(packet)
        self.parts.commit()
        others = [provenance.described(made) for made in self.parts.sources if made != self.parts.software]
        self.parts.sources = []
        if taken:
            words = f"rows of {taken:,} of {total:,} units are taken from {source.run.folder}"
            by = f", made by {', '.join(others)}" if others else ""
            self.warn(f"{self.store.folder}: {words}{by}")

    def whole(self) -> bool:
        """Read all parts again; if some were damaged meanwhile, warn of them: their rows are pending again."""
        damaged = self.parts.load()
        for name in damaged:
            self.warn(f"{self.parts.folder / name}: damaged; set aside in parts/damaged, and computed again")
        if damaged:
            self.layout.restart()
        return not damaged

    def compute(self, backend: Threads) -> None:
        """Compute the missing tasks, as far as the budget goes, and store their rows."""
        missing = list(self.layout.missing(self.parts))
        whole = sum(task.weight for task in missing)
        share = self.left * self.layout.ahead() if missing else 0.0
        self.left -= share
        total = sum(1 for _ in self.layout.pieces())
        done = total - len(missing)
        lost: list[tuple[UnitTask, str]] = []

        def ended(tasks: tuple[UnitTask, ...], failure: str) -> None:
            nonlocal done
            done += len(tasks)
            if failure:
                lost.extend((task, failure) for task in tasks)
            self.progress(share * sum(task.weight for task in tasks) / whole, done, total)

        dispatch = Dispatch(backend, execute, self.study, self.parts)
        dispatch.compute(missing, attrgetter("weight"), ended, self.budget.spent)
        for task, failure in lost:  # stored at the end, so that an interrupted run tries them again
            self.parts.add(give_up(self.study, task, failure))
        if lost:
            task, failure = lost[0]
            count = "1 unit is lost" if len(lost) == 1 else f"{len(lost):,} units are lost, the first of them"
            self.warn(f"{self.store.folder}: {count}, {task.batch.words}: {failure}")
        self.parts.commit()

    def finish(self) -> None:
        """Join the parts to the run's tables, in the order of the units, and remove them, unless the budget stopped it.

        The error table's metadata hold the config and the software, but nothing of time, machine or workers, so that
        equal runs are equal to the byte. Cells that are still open stay as they were at their last checkpoint. The
        manifest comes last: a run that is killed before is finished again from its parts.

        Raises:
            RunError: if the folder cannot be written; the parts stay.
        """
        store, parts, layout, study, clock = self.store, self.parts, self.layout, self.study, time.perf_counter()
        metadata = {"study.config": study.canonical(), "study.software": json.dumps(parts.software)}
        tables = schemas.of_units(*study.columns())
        store.forget(*tables, "precision")  # they are about to be replaced
        store.remove("summary")
        written, causes, reasons = [], Counter[str](), Counter[str]()
        if isinstance(layout, Rounds):
            layout.stop()
            reasons = layout.reasons()
            store.join("precision", schemas.precision(study.conditions()), [layout.table()], metadata)
            written.append("precision")
        for name, columns in tables.items():
            rows = layout.rows(parts, name)
            first = list(islice(rows, 1))
            if first or name in (study.keep, "timings") or (name == "points" and study.keep_points):
                store.join(name, columns, chain(first, rows), metadata)
                written.append(name)
            else:
                store.remove(name)
        if "failures" in written:
            causes.update(pq.read_table(store.path("failures"), columns=["cause"])["cause"].to_pylist())
        before = store.known()
        store.save_manifest(
            {key: value for key, value in before.items() if key == "posterior"}
            | ({"precision": dict(reasons)} if reasons else {})
            | ({"stopped_after": self.budget.seconds} if reasons[BUDGET] else {})
            | {
                "format": FORMAT,
                "run": study.run_name(),
                "config": study.model_dump(mode="json"),
                "cells": study.cells(),
                "fits": sum(piece.rows for piece in layout.pieces()) * len(study.estimators),
                "failures": causes.total(),
                "lost": causes["worker"],
                "estimators": {name: ESTIMATORS[name].version for name in study.estimators},
                "tables": {name: store.fingerprint(name) for name in written} | before.get("tables", {}),
                **store.own_code(),
                **({"measures": made} if (made := study.measure_versions()) else {}),
                "started": self.started.isoformat(timespec="seconds"),
                "seconds_computing": round(parts.seconds, 3),
                "seconds": round(parts.seconds + time.perf_counter() - clock, 3),
                "jobs": self.workers.jobs,
                "backend": self.workers.backend,
                "software": parts.software,
                "also_computed_by": parts.made_by,
                "machine": provenance.machine(),
            }
        )
        if not reasons[BUDGET]:
            parts.remove()
