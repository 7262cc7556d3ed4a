"""Cut a study into units of work: its groups of cells that share draws, and spans of their trials."""

from collections.abc import Iterator

from study.experiment.config import Study
from study.experiment.designs.cells import Unit
from study.experiment.designs.groups import Group, Span


def groups(study: Study) -> Iterator[Group]:
    """The study's groups of cells that share draws, in the order of its tables."""
    return study.design.groups(study.seed, study.dimension)


def trials_of(study: Study, group: Group) -> int:
    """Number of trials that a study gives to the cells of a group, which may be another study's."""
    return study.design.trials_of(group.samples)


def units(study: Study) -> Iterator[Unit]:
    """The study's units, in the order of its tables; they depend on nothing but the config."""
    return (span.unit() for span in spans(study))


def spans(study: Study) -> Iterator[Span]:
    """The study's units as spans, in the order of its tables."""
    return (span for group in groups(study) for span in spans_of(study, group))


def spans_of(study: Study, group: Group, below: int | None = None) -> Iterator[Span]:
    """The units of a group as spans; only those with trials below a number, if one is given."""
    trials = trials_of(study, group)
    levels = 1 if study.route == "moments" else group.levels
    step = trials if study.keep == "summary" else group.trials_per_unit(levels)  # a summary is made of whole cells
    for first in range(0, trials if below is None else min(below, trials), step):
        yield Span(group, first, min(trials, first + step))
