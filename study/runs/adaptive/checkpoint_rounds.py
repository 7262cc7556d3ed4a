"""A run whose cells have as many trials as they need: from checkpoint to checkpoint, with the cells still open.

In each round, every group of cells that share their draws goes on to its next checkpoint, with those cells alone whose
measure is not known well enough. What was decided is not stored: it follows from the parts, and is found again where a
run goes on. So it depends neither on the workers nor on what was interrupted.
"""

from collections import Counter
from collections.abc import Iterator
from itertools import chain

import pyarrow as pa

from study.experiment.config import Study
from study.experiment.designs.cells import Cell
from study.experiment.designs.groups import Group, Span
from study.experiment.precision_config import Precision
from study.experiment.units import groups, spans_of, trials_of
from study.runs.adaptive.cell_measures import Judge, Verdict, judged
from study.runs.jobs import Asked
from study.runs.layout import Layout
from study.runs.storage import schemas
from study.runs.storage.parts import Parts

TARGET, CAP, BUDGET = "target", "cap", "budget"


class Course:
    """A group of cells on its way.

    Args:
        group: all of its cells.
        checkpoints: numbers of trials at which they are looked at.

    Attributes:
        stages: trials from one checkpoint to the next, of the cells that were open then; the last is not judged yet,
            or no cell is open any more.
        verdicts: the last of each cell.
        reasons: of the cells that are not open any more, why.
    """

    def __init__(self, group: Group, checkpoints: list[int]) -> None:
        self.group, self.checkpoints = group, checkpoints
        self.restart()

    def restart(self) -> None:
        """Begin anew."""
        self.stages = [Span(self.group, 0, self.checkpoints[0])]
        self.verdicts: dict[Cell, Verdict] = {}
        self.reasons: dict[Cell, str] = {}

    @property
    def open(self) -> bool:
        """Whether a cell is to have more trials."""
        return len(self.reasons) < len(self.group.cells)

    def take(self, cell: Cell, verdict: Verdict) -> None:
        """Note a cell's verdict."""
        self.verdicts[cell] = verdict
        if verdict.reached:
            self.reasons[cell] = TARGET
        elif verdict.trials == self.checkpoints[-1]:
            self.reasons[cell] = CAP

    def go_on(self) -> None:
        """Begin the next stage, with the cells that are open."""
        left = {cell for cell in self.group.cells if cell not in self.reasons}
        last = self.stages[-1].last
        self.stages.append(Span(self.group.only(left), last, self.checkpoints[len(self.stages)]))

    def stop(self) -> None:
        """Leave out the stage that is not judged, and go no further."""
        self.stages.pop()
        for cell in self.group.cells:
            self.reasons.setdefault(cell, BUDGET)


class Rounds(Layout):
    """The layout of such a run, as far as it is known.

    Args:
        study: a config with a precision, of a grid.
        judge: finds its measure.
    """

    def __init__(self, study: Study, judge: Judge) -> None:
        assert study.precision is not None
        super().__init__(study)
        self._judge, self._asked = judge, Asked(study)
        self.precision: Precision = study.precision
        self.courses = {
            group.stream: Course(group, self.precision.checkpoints(trials_of(study, group))) for group in groups(study)
        }

    def units(self) -> Iterator[Span]:
        """The units that hold trials, in the order of the tables."""
        for course in self.courses.values():
            if course.stages:
                yield from spans_of(self.study, course.group, course.stages[-1].last)

    def __call__(self, span: Span) -> Iterator[Span]:
        """The pieces of a unit: the part of it that each stage has."""
        for stage in self.courses[span.group.stream].stages:
            yield from _within(span, stage)

    def pending(self) -> Iterator[Span]:
        """Pieces of the stages that are not judged yet."""
        return chain.from_iterable(self._pieces(course)[1] for course in self.courses.values() if course.open)

    def advance(self, parts: Parts) -> bool:
        """Judge the stages that are complete; whether any group goes on to another.

        Args:
            parts: what is stored.
        """
        places = {}
        for stream, course in self.courses.items():
            if course.open:
                before, now = self._pieces(course)
                if next(self._asked.lacking(now, parts.outputs), None) is None:
                    places[stream] = before + now
        verdicts = judged(self._asked, parts, list(places.values()), self.precision, self._judge)
        found = dict(verdicts)
        further = False
        for stream in places:
            course = self.courses[stream]
            for cell in course.stages[-1].group.cells:
                course.take(cell, found[cell])
            if course.open:
                course.go_on()
                further = True
        return further

    def _pieces(self, course: Course) -> tuple[list[Span], list[Span]]:
        """Pieces of the stages that are judged, and of the one that is not."""
        found: tuple[list[Span], list[Span]] = [], []
        for stage in course.stages:
            for span in spans_of(self.study, course.group, stage.last):
                found[stage is course.stages[-1]].extend(_within(span, stage))
        return found

    def restart(self) -> None:
        """Begin anew: of what was judged, some is lost."""
        for course in self.courses.values():
            course.restart()

    def stop(self) -> None:
        """Go no further: the cells that are open stay as they were judged last."""
        for course in self.courses.values():
            if course.open:
                course.stop()

    def ahead(self) -> float:
        """Share of the trials that may still come, as far as is known, that the stages not judged yet have."""
        now = possible = 0
        for course in self.courses.values():
            if course.open:
                stage = course.stages[-1]
                now += stage.rows
                possible += len(stage.group.cells) * (course.checkpoints[-1] - stage.first)
        return now / possible if possible else 1.0

    def reasons(self) -> Counter[str]:
        """Numbers of cells that stopped, by the reason; those that are open are not counted."""
        return Counter(chain.from_iterable(course.reasons.values() for course in self.courses.values()))

    def table(self) -> pa.Table:
        """The table of a run that goes no further: a row per cell."""
        rows = []
        for course in self.courses.values():
            for cell in course.group.cells:
                verdict = course.verdicts.get(cell, Verdict(0, "", float("nan"), float("nan"), float("nan"), False))
                rows.append(
                    {
                        "cell": cell.name,
                        **cell.values,
                        "trials": verdict.trials,
                        "checkpoints": sum(point <= verdict.trials for point in course.checkpoints),
                        **{name: getattr(verdict, name) for name in ("estimator", "value", "error", "goal")},
                        "reason": course.reasons[cell],
                    }
                )
        columns = schemas.precision(self.study.conditions())
        return schemas.table(columns, {c.name: [row[c.name] for row in rows] for c in columns})


def _within(span: Span, stage: Span) -> Iterator[Span]:
    """The trials of a unit that a stage has."""
    first, last = max(span.first, stage.first), min(span.last, stage.last)
    if first < last:
        yield Span(stage.group, first, last)
