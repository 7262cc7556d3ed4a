"""Jobs: outputs to compute of a unit of a study, and the function with which a worker computes them."""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby

from study.estimators import ESTIMATORS
from study.experiment.compute_unit import Result, compute, lost, stack
from study.experiment.config import Study
from study.experiment.designs.cells import Unit
from study.experiment.designs.groups import Span
from study.experiment.errors import Columns, Errors
from study.experiment.units import spans
from study.runs.storage import schemas
from study.runs.storage.parts import FORMAT, Packet, encode
from study.statistics import summary_rows
from study.statistics.performance import MEASURES

POINTS = "points"
_OVERHEAD = 10_000.0
"""Overhead of a call, in samples that could be drawn meanwhile."""
_ROW = 40.0
"""Cost of a row, in samples; high, because packets of many rows are read whole."""
_LONG = 1e9
"""Weight, some ten seconds of one worker, from which processes are worth the two seconds in which they start."""


@dataclass(frozen=True)
class Job:
    """Outputs to compute of a unit.

    Attributes:
        span: the unit.
        key: a digest of all that determines the unit's rows; see `study.runs.storage.parts`.
        outputs: estimators with their versions, and perhaps points.
    """

    span: Span
    key: str
    outputs: tuple[str, ...]

    @property
    def weight(self) -> float:
        """Work in samples: those drawn and fitted, an overhead per batch and level, and a cost per row."""
        samples, batches = self.span.group.load(self.span.first, self.span.last)
        levels = self.span.group.levels
        rows = self.span.rows * len(self.outputs)
        return samples * (1.0 + levels) + _OVERHEAD * batches * (1 + levels) + _ROW * rows


class Jobs:
    """The jobs of a study.

    Args:
        study: the config.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        measures = " ".join(MEASURES) if study.keep == "summary" else ""  # rows of a summary have a column for each
        self._stem = hashlib.sha256(f"{FORMAT} {study.stem()}{measures}".encode()).digest()
        self.estimators = tuple(output(name) for name in study.estimators)

    def job(self, span: Span) -> Job:
        """The job of a unit, with all of its outputs."""
        content = self._stem + span.group.digest + f"{span.first}-{span.last}".encode()
        points = (f"{POINTS}:{self.study.keep_points}",) if span.first < self.study.keep_points else ()
        return Job(span, hashlib.blake2b(content, digest_size=12).hexdigest(), self.estimators + points)

    def missing(self, units: Iterable[Span], stored: Callable[[str], set[str]]) -> Iterator[Job]:
        """The jobs of units, with the outputs that are not stored; jobs that have none are left out.

        Args:
            units: the units.
            stored: gives the outputs that are stored under a key.
        """
        for span in units:
            job = self.job(span)
            there = stored(job.key)
            if missing := tuple(o for o in job.outputs if o not in there):
                yield Job(span, job.key, missing)


def takes_long(study: Study) -> bool:
    """Tell whether processes compute a study sooner than threads, which start at once but share one interpreter."""
    jobs, weight = Jobs(study), 0.0
    for span in spans(study):
        weight += jobs.job(span).weight
        if weight > _LONG:
            return True
    return False


def output(estimator: str) -> str:
    """Name of an estimator's rows among the outputs: its name and its version."""
    return f"{estimator}@{ESTIMATORS[estimator].version}"


def estimators_of(outputs: Iterable[str]) -> tuple[str, ...]:
    """Names of the estimators among outputs."""
    return tuple(o.rpartition("@")[0] for o in outputs if "@" in o)


def execute(study: Study, jobs: tuple[Job, ...]) -> Packet:
    """Compute jobs of a study; workers run this."""
    return _packed(study, jobs, compute)


def give_up(study: Study, jobs: tuple[Job, ...], message: str) -> Packet:
    """Rows of jobs whose worker died twice: every fit failed.

    Args:
        study: the config.
        jobs: the jobs.
        message: how the worker died.
    """
    return _packed(study, jobs, lambda part, unit: lost(part, unit, message))


def _packed(study: Study, jobs: tuple[Job, ...], result: Callable[[Study, Unit], Result]) -> Packet:
    found = []
    for outputs, together in groupby(jobs, key=lambda job: job.outputs):
        kept = study.keep_points if any(o.startswith(POINTS) for o in outputs) else 0
        part = study.model_copy(update={"estimators": estimators_of(outputs), "keep_points": kept})
        for job in together:
            unit = job.span.unit()
            found.append(tables(part, unit, result(part, unit)))
    stacked, rows = {}, {}
    for name, columns in schemas.of_units(study.dimension, study.conditions()).items():
        some = [each[name] for each in found if each[name]]
        if some:
            stacked[name] = schemas.table(columns, stack(some))
            rows[name] = [len(next(iter(each[name].values()))) if each[name] else 0 for each in found]
    return Packet([(job.key, job.outputs) for job in jobs], rows, {k: encode(t) for k, t in stacked.items()})


def tables(study: Study, unit: Unit, result: Result) -> dict[str, Columns]:
    """Columns of each table that a unit fills; none of those that the study does not keep.

    Args:
        study: the config.
        unit: the unit; where the study keeps summaries alone, it holds all trials of its cells.
        result: what was computed of it.
    """
    found: dict[str, Columns] = {"errors": {}, "summary": {}, "points": result.points, "failures": result.failures}
    if study.keep == "errors":
        found["errors"] = result.errors
    elif result.blocks:
        found["summary"] = summary_rows.of_errors(Errors.joined(result.blocks))
        result.clock.read("summary", unit.batches[0].samples, sum(block.radius.size for block in result.blocks))
    return found | {"timings": result.timings}
