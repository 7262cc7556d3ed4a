"""What a study asks for, unit by unit, and what a worker does about it: outputs of a unit, as a packet."""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby

from study.estimators import ESTIMATORS
from study.experiment.compute_unit import Reduce, Result, compute, lost, stack
from study.experiment.config import Study
from study.experiment.designs.groups import Span
from study.experiment.units import spans
from study.runs.storage import schemas
from study.runs.storage.parts import FORMAT, Packet, encode

POINTS = "points"
_OVERHEAD = 10_000.0
"""Samples that take as long to draw as a call takes without any."""
_ROW = 40.0
"""Samples for which a row counts: more than take as long to draw, because packets of many rows are read whole."""
_LONG = 1e9
"""Weight, some ten seconds of one worker, that is worth the two seconds in which processes start."""


@dataclass(frozen=True)
class Job:
    """Outputs to compute of a unit.

    Attributes:
        span: the unit.
        key: stands for it; see `study.runs.storage.parts`.
        outputs: estimators with their versions, and perhaps points.
    """

    span: Span
    key: str
    outputs: tuple[str, ...]

    @property
    def weight(self) -> float:
        """Work in comparable numbers: samples drawn and fitted, an overhead per batch and level, and rows."""
        samples, batches = self.span.group.load(self.span.first, self.span.last)
        levels = self.span.group.levels
        rows = self.span.rows * len(self.outputs)
        return samples * (1.0 + levels) + _OVERHEAD * batches * (1 + levels) + _ROW * rows


class Asked:
    """What a study asks for.

    Args:
        study: the config.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        self._stem = hashlib.sha256(f"{FORMAT} {study.stem()}".encode()).digest()
        self.estimators = tuple(output(name) for name in study.estimators)

    def job(self, span: Span) -> Job:
        """All that is asked of a unit."""
        content = self._stem + span.group.digest + f"{span.first}-{span.last}".encode()
        points = (f"{POINTS}:{self.study.keep_points}",) if span.first < self.study.keep_points else ()
        return Job(span, hashlib.blake2b(content, digest_size=12).hexdigest(), self.estimators + points)

    def lacking(self, units: Iterable[Span], have: Callable[[str], set[str]]) -> Iterator[Job]:
        """What is asked of units and is not there."""
        for span in units:
            job = self.job(span)
            there = have(job.key)
            if missing := tuple(o for o in job.outputs if o not in there):
                yield Job(span, job.key, missing)


def long(study: Study) -> bool:
    """Whether processes compute a study sooner than threads, which start at once but share one interpreter."""
    asked, weight = Asked(study), 0.0
    for span in spans(study):
        weight += asked.job(span).weight
        if weight > _LONG:
            return True
    return False


def output(estimator: str) -> str:
    """What an estimator's rows are called: its name and its version."""
    return f"{estimator}@{ESTIMATORS[estimator].version}"


def estimators_of(outputs: Iterable[str]) -> tuple[str, ...]:
    """Names of the estimators among outputs."""
    return tuple(o.rpartition("@")[0] for o in outputs if "@" in o)


@dataclass(frozen=True)
class Order:
    """What every job of a run has in common.

    Attributes:
        study: the config.
        reduce: makes the rows of a summary, where the study keeps no errors.
    """

    study: Study
    reduce: Reduce | None = None


def execute(order: Order, jobs: tuple[Job, ...]) -> Packet:
    """Compute jobs; this is what a worker runs."""
    return _packed(order.study, jobs, lambda part, job: compute(part, job.span.unit(), order.reduce))


def give_up(order: Order, jobs: tuple[Job, ...], message: str) -> Packet:
    """What is stored of jobs that no worker survived: every fit of them failed."""
    return _packed(order.study, jobs, lambda part, job: lost(part, job.span.unit(), message, order.reduce))


def _packed(study: Study, jobs: tuple[Job, ...], result: Callable[[Study, Job], Result]) -> Packet:
    found = []
    for outputs, together in groupby(jobs, key=lambda job: job.outputs):
        kept = study.keep_points if any(o.startswith(POINTS) for o in outputs) else 0
        part = study.model_copy(update={"estimators": estimators_of(outputs), "keep_points": kept})
        found += [vars(result(part, job)) for job in together]
    stacked, rows = {}, {}
    for name, columns in schemas.of_units(study.dimension, study.conditions()).items():
        some = [each[name] for each in found if each[name]]
        if some:
            stacked[name] = schemas.table(columns, stack(some))
            rows[name] = [len(next(iter(each[name].values()))) if each[name] else 0 for each in found]
    return Packet([(job.key, job.outputs) for job in jobs], rows, {k: encode(t) for k, t in stacked.items()})
