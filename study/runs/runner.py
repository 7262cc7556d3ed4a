"""From a study to its finished run: what is missing is computed, stored as it comes back, and joined at the end."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from threadpoolctl import threadpool_limits

from study.experiment.compute_unit import Reduce
from study.experiment.config import Study
from study.runs import provenance
from study.runs.adaptive.cell_measures import Judge
from study.runs.adaptive.checkpoint_rounds import Rounds
from study.runs.adaptive.time_budget import Budget
from study.runs.finish import finish
from study.runs.jobs import Asked, Job, Order, execute, give_up
from study.runs.layout import Layout
from study.runs.reuse import Cut, Earlier, beside, damaged, finished, up_to_date
from study.runs.storage.lock import writing
from study.runs.storage.parts import Parts
from study.runs.storage.run_folder import Run
from study.runs.workers.dispatch import Crew, Pool, Workers, kept

Progress = Callable[[float], None]
"""Told the share of the work, in [0, 1], that was done since it was told last."""
Warn = Callable[[str], None]
"""Told, in a line, what a user should know and can do nothing about at the moment."""


def weight(job: Job) -> float:
    """Work of a job; the heaviest are computed first."""
    return job.weight


def run(
    study: Study,
    config: str,
    folder: Path,
    jobs: Workers | int = 2,
    progress: Progress | None = None,
    warn: Warn | None = None,
    reduce: Reduce | None = None,
    judge: Judge | None = None,
    budget: Budget | None = None,
) -> Run:
    """Run a study, as far as it has not been run.

    Args:
        study: the config.
        config: its text, stored beside the tables.
        folder: the run's folder.
        jobs: number of threads, or who else computes.
        progress: called with each share of the work.
        warn: called with lines for the user.
        reduce: makes the rows of the summary (`study.analysis.summary.of_errors`) of a study that keeps nothing else.
        judge: finds a measure (`study.statistics.performance.measured`) for a study that asks for a precision.
        budget: how long such a study may go on; the config's, if None.

    Returns:
        The finished run, or one that its budget stopped (`Run.stopped`), and that goes on when it is run again. The
        error table of a finished one does not depend on the workers, on the order in which they finish, or on what was
        interrupted before.

    Raises:
        RunError: if the folder belongs to another config, is being written to, or cannot be written, or the workers
            cannot be had. What was finished is kept.
        ValueError: if the study keeps summaries alone and nothing makes them, or asks for a precision and nothing finds
            it, or has a budget and no precision.
    """
    if study.keep == "summary" and reduce is None:
        raise ValueError(f'{study.run_name()}: keep = "summary" needs a function that makes a summary; give reduce')
    if study.precision is not None and judge is None:
        raise ValueError(f"{study.run_name()}: [precision] needs a function that finds a measure; give judge")
    if study.precision is None and budget is not None:
        raise ValueError(f"{study.run_name()}: a budget is for a config with [precision]")
    budget = budget or Budget(study.precision.seconds if study.precision else None)
    crew = Workers(jobs=jobs) if isinstance(jobs, int) else jobs
    with contextlib.ExitStack() as stack:
        pool = stack.enter_context(crew.open())
        stack.enter_context(threadpool_limits(limits=1))
        store = Run.create(folder, study)
        stack.enter_context(writing(folder))
        parts = Parts(folder, "units", provenance.software())
        started = datetime.now(UTC)
        store.begin(config)
        if finished(store) and up_to_date(store):
            parts.remove()  # of a run that was killed after its last step but this
            return store
        work = _Work(store, parts, progress or (lambda share: None), warn or _say, Order(study, reduce), budget)
        work.prepare(judge)
        work.compute(pool)
        while work.layout.advance(parts) or not work.whole():
            work.compute(pool)
        finish(store, parts, work.layout, started, crew, budget)
        return store


def _say(line: str) -> None:
    print(line, file=sys.stderr)


class _Work:
    """A run on its way."""

    def __init__(self, store: Run, parts: Parts, progress: Progress, warn: Warn, order: Order, budget: Budget) -> None:
        self.order, self.budget = order, budget
        self.store, self.parts, self.progress, self.warn = store, parts, progress, warn
        self.study = store.study
        self.asked = Asked(self.study)
        self.layout = Layout(self.study)
        self.told = 0
        self.left = 1.0

    def prepare(self, judge: Judge | None) -> None:
        """Read what is there, and take what an earlier run has."""
        for name in damaged(self.store):
            self.warn(f"{self.store.path(name)}: damaged; set aside in parts/damaged, and made again")
            self.store.set_aside(name)
        self.parts.load()
        self.tell_of_damage()
        for made in self.parts.made_by:
            self.warn(f"{self.store.folder}: goes on with what {provenance.described(made)} computed")
        if judge is not None and self.study.precision is not None:
            self.layout = Rounds(self.study, judge)
            return
        source = self._source()
        if source is None:
            return
        self.layout = Cut(self.study, source.run.study)
        self.parts.note = source.run.study.canonical()
        taken = total = 0
        for job in self._missing():
            total += 1
            if (packet := source.take(job)) is not None:
                taken += 1
                self.parts.add(packet)
        self.parts.commit()
        if taken:
            self.warn(f"{self.store.folder}: rows of {taken:,} of {total:,} units are taken from {source.run.folder}")

    def _source(self) -> Earlier | None:
        """The run that rows are taken from; what is begun goes on with the one that it began with."""
        before = Study.model_validate_json(self.parts.note) if self.parts.note else None
        self.layout = Cut(self.study, before)
        if self.parts.count and before is None:
            return None
        for run in (self.store, beside(self.study, self.store.folder)):
            if run is None or (before is not None and run.study.canonical() != before.canonical()):
                continue
            if (source := Earlier.of(run)) is not None:
                return source
        return None

    def tell_of_damage(self) -> None:
        """Name the parts that were set aside."""
        for name in self.parts.damaged[self.told :]:
            self.warn(f"{self.parts.folder / name}: damaged; set aside in parts/damaged, and computed again")
        self.told = len(self.parts.damaged)

    def whole(self) -> bool:
        """Whether all parts still are as they were written; if not, what they held is pending again."""
        if self.parts.whole():
            return True
        self.tell_of_damage()
        self.layout.restart()
        return False

    def _missing(self) -> Iterator[Job]:
        return self.asked.lacking(self.layout.pending(), self.parts.outputs)

    def compute(self, pool: Pool) -> None:
        """Compute what is missing, as far as the budget goes, and store it as it comes back."""
        whole = sum(weight(job) for job in self._missing())
        share = self.left * self.layout.ahead() if whole else 0.0
        self.left -= share
        lost: list[tuple[Job, str]] = []
        crew: Crew[Job] = Crew(pool, execute, self.order)
        with kept(crew, self.parts):
            for done in crew.results(self._missing(), weight, self.parts.patience, self.budget.spent):
                if done is None:
                    self.parts.commit()
                    continue
                if done.packet is None:
                    lost += [(job, done.message) for job in done.items]
                else:
                    self.parts.add(done.packet)
                self.progress(share * sum(weight(job) for job in done.items) / whole)
        for job, message in lost:  # stored at the end: an interrupted run tries them again
            self.parts.add(give_up(self.order, (job,), message))
        self.parts.commit()
