"""Cut a study into units of work: its groups of cells that share draws, and spans of their trials."""

from collections.abc import Iterator

from study.experiment.config import Study
from study.experiment.designs.cells import Unit
from study.experiment.designs.groups import Group, Span

_FITS_IN_MEMORY = 4_000_000
"""Fits of a unit whose summary alone is kept: their errors take some 190 bytes each until they are summed up."""
_SAMPLES_IN_SUMMARY = 20_000_000_000
"""Samples that such a unit draws and fits, over its levels: some minutes, which a kill costs."""


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
    if study.keep == "summary":
        yield from (Span(some, 0, trials if below is None else min(below, trials)) for some in _few(study, group))
        return
    step = _step(study, group)
    for first in range(0, trials if below is None else min(below, trials), step):
        yield Span(group, first, min(trials, first + step))


def sizes_of(study: Study, group: Group) -> Iterator[tuple[Span, int]]:
    """The units of a group, of equal ones the first alone; each with the number of those that are equal in size."""
    if study.keep == "summary" or study.design.one_trial_a_cell:
        yield from ((span, 1) for span in spans_of(study, group))
        return
    trials, step = trials_of(study, group), _step(study, group)
    whole, rest = divmod(trials, step)
    if whole:
        yield Span(group, 0, step), whole
    if rest:
        yield Span(group, trials - rest, trials), 1


def _step(study: Study, group: Group) -> int:
    """Number of trials of each unit of a group, but the last, in a study that keeps its errors."""
    return group.trials_per_unit(1 if study.route == "moments" else group.levels)


def _few(study: Study, group: Group) -> Iterator[Group]:
    """Cut a group to so few cells that all their trials, of which a summary is made, are few enough for one unit.

    Each of these groups makes the draws of all trials again.
    """
    trials, cells, levels = trials_of(study, group), group.cells, group.levels
    at_once = max(1, _FITS_IN_MEMORY // (trials * max(1, len(study.estimators))))
    if study.route == "points":  # a level costs as much as the draw
        at_once = min(at_once, max(1, _SAMPLES_IN_SUMMARY // (trials * group.samples) - 1) * (len(cells) // levels))
    if at_once >= len(cells):
        yield group
        return
    for first in range(0, len(cells), at_once):
        yield group.only(cells[first : first + at_once])
