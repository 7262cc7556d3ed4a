"""Rounds of an adaptive run: from checkpoint to checkpoint, trials are added to the cells that are still open.

In each round, every group of cells that share their draws goes on to its next checkpoint, with only those cells whose
measure is not known well enough. These decisions are not stored. They follow from the parts, and a resumed run finds
them again. So they depend neither on the workers nor on interruptions.
"""

from collections import Counter
from collections.abc import Iterator
from itertools import chain

import pyarrow as pa

from study.experiment.config import Study
from study.experiment.designs.groups import Span
from study.experiment.precision_config import Precision
from study.experiment.units import groups, spans_of, trials_of
from study.runs.adaptive.cell_measures import measure_cells
from study.runs.adaptive.group_progress import NOTHING, GroupProgress
from study.runs.jobs import Jobs
from study.runs.layout import Layout
from study.runs.storage import schemas
from study.runs.storage.parts import Parts


class Rounds(Layout):
    """The layout of an adaptive run, as far as it is known.

    Args:
        study: the config of a grid, with a precision.
    """

    def __init__(self, study: Study) -> None:
        assert study.precision is not None
        super().__init__(study)
        self._jobs = Jobs(study)
        self.precision: Precision = study.precision
        self.progress = {
            group.stream: GroupProgress(group, self.precision.checkpoints(trials_of(study, group)))
            for group in groups(study)
        }

    def units(self) -> Iterator[Span]:
        """The units that hold trials, in the order of the tables."""
        for progress in self.progress.values():
            if progress.stages:
                yield from spans_of(self.study, progress.group, progress.stages[-1].last)

    def cut(self, span: Span) -> Iterator[Span]:
        """Cut a unit into the pieces that the stages have of it."""
        for stage in self.progress[span.group.stream].stages:
            yield from _within(span, stage)

    def pending(self) -> Iterator[Span]:
        """Pieces of the stages that are not measured yet."""
        return chain.from_iterable(self._pieces(progress)[1] for progress in self.progress.values() if progress.open)

    def advance(self, parts: Parts) -> bool:
        """Measure the stages that are complete, and begin the next ones; false if no group goes on.

        Args:
            parts: the stored rows.
        """
        places = {}
        for stream, progress in self.progress.items():
            if progress.open:
                before, now = self._pieces(progress)
                if next(self._jobs.missing(now, parts.outputs), None) is None:
                    places[stream] = before + now
        found = dict(measure_cells(self._jobs, parts, list(places.values()), self.precision))
        further = False
        for stream in places:
            progress = self.progress[stream]
            for cell in progress.stages[-1].group.cells:
                progress.take(cell, found[cell])
            if progress.open:
                progress.go_on()
                further = True
        return further

    def _pieces(self, progress: GroupProgress) -> tuple[list[Span], list[Span]]:
        """Pieces of the stages that are measured, and of the last one."""
        found: tuple[list[Span], list[Span]] = [], []
        for stage in progress.stages:
            for span in spans_of(self.study, progress.group, stage.last):
                found[stage is progress.stages[-1]].extend(_within(span, stage))
        return found

    def restart(self) -> None:
        """Forget all measures, because some of the rows are lost."""
        for progress in self.progress.values():
            progress.restart()

    def stop(self) -> None:
        """Go no further: the open cells stay as they were at their last checkpoint."""
        for progress in self.progress.values():
            if progress.open:
                progress.stop()

    def ahead(self) -> float:
        """Share of the pending trials in all that may still be added."""
        now = possible = 0
        for progress in self.progress.values():
            if progress.open:
                stage = progress.stages[-1]
                now += stage.rows
                possible += len(stage.group.cells) * (progress.checkpoints[-1] - stage.first)
        return now / possible if possible else 1.0

    def reasons(self) -> Counter[str]:
        """Numbers of closed cells by their reason."""
        return Counter(chain.from_iterable(progress.reasons.values() for progress in self.progress.values()))

    def table(self) -> pa.Table:
        """The precision table, with a row per cell, of a run that goes no further."""
        rows = []
        for progress in self.progress.values():
            for cell in progress.group.cells:
                found = progress.found.get(cell, NOTHING)
                rows.append(
                    {
                        "cell": cell.name,
                        **cell.values,
                        "trials": found.trials,
                        "checkpoints": sum(point <= found.trials for point in progress.checkpoints),
                        **{name: getattr(found, name) for name in ("estimator", "value", "error", "goal")},
                        "reason": progress.reasons[cell],
                    }
                )
        columns = schemas.precision(self.study.conditions())
        return schemas.table(columns, {c.name: [row[c.name] for row in rows] for c in columns})


def _within(span: Span, stage: Span) -> Iterator[Span]:
    """Cut a unit to the trials that a stage has of it."""
    first, last = max(span.first, stage.first), min(span.last, stage.last)
    if first < last:
        yield Span(stage.group, first, last)
