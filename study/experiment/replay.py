"""Draw one trial again from its name: the same points to the last bit, on whatever machine its run was computed."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

from study.estimators import Samples
from study.experiment.config import Study
from study.experiment.designs.cells import Batch, Cell
from study.experiment.designs.groups import Span
from study.experiment.sampling import draw
from study.experiment.units import groups, spans_of, trials_of
from study.sphere.types import Floats
from study.text.nearest import nearest

_MOST_COMPARED = 20_000


class ReplayError(Exception):
    """A trial that a study does not have; the message says which ones it has."""


@dataclass(frozen=True)
class Address:
    """The place of a trial in a study.

    Attributes:
        batch: the trials that are drawn from the same streams.
        cell: its condition, one of the batch's.
        trial: its number.
    """

    batch: Batch
    cell: Cell
    trial: int


@dataclass(frozen=True)
class Trial:
    """One data set, with the truth.

    Attributes:
        cell: its condition.
        trial: its number.
        samples: the points (1, d, n) and the noise.
        level: the same in units of the cell's scale, as the estimators take them.
        unit_bound: Cramér-Rao bound of (c, r) at σ = 1, for the realised directions (d+1, d+1).
    """

    cell: Cell
    trial: int
    samples: Samples
    level: Samples
    unit_bound: Floats


def addresses(study: Study, below: int | None = None) -> Iterator[Address]:
    """The places of a study's trials, cell by cell in the order of its tables.

    Args:
        study: the config.
        below: only trials with a number below this one are listed, if it is given.
    """
    for span in chain.from_iterable(spans_of(study, group, below) for group in groups(study)):
        for batch in span.unit().batches:
            last = batch.first + batch.trials
            for cell in batch.cells:
                for trial in range(batch.first, last if below is None else min(below, last)):
                    yield Address(batch, cell, trial)


def locate(study: Study, cell: str) -> tuple[Cell, list[Span]]:
    """Find a cell of a study by its name.

    Args:
        study: the config.
        cell: the cell's name, or enough of its beginning to tell it from all others.

    Returns:
        The cell, and the spans of its trials: in a random design, one for each trial.

    Raises:
        ReplayError: if there is no such cell, or more than one.
    """
    found: dict[str, tuple[Cell, list[Span]]] = {}
    names: list[str] = []
    for group in groups(study):
        for each, first, last in group.places(0, trials_of(study, group)):
            names += [each.name] * (len(names) < _MOST_COMPARED)
            if each.name.startswith(cell):
                found.setdefault(each.name, (each, []))[1].append(Span(group, first, last))
    if not found:
        close = nearest(cell, names)
        hint = "the" if close is None else f"did you mean {close}? The"
        raise ReplayError(
            f"cell {cell!r}: no such cell in {study.run_name()}; {hint} error table's first column has them"
        )
    if len(found) > 1:
        raise ReplayError(f"cell {cell!r}: not one cell but {len(found)}: {', '.join(sorted(found)[:5])} …")
    return next(iter(found.values()))


def parse_name(cell: str, trial: int | None) -> tuple[str, int]:
    """Read a cell's name and a trial's number, which a user gives one by one or as ``CELL/TRIAL``.

    Raises:
        ReplayError: if the two are given in neither way.
    """
    name, _, number = cell.partition("/")
    if trial is None and number.isascii() and number.isdigit():
        return name, int(number)
    if trial is None or number:
        raise ReplayError(f"trial {cell!r}: give a cell and the number of a trial, or both as CELL/TRIAL")
    return cell, trial


def find(study: Study, cell: str, trial: int) -> Address:
    """Find a trial of a study.

    Args:
        study: the config.
        cell: the cell's name, or enough of its beginning to tell it from all others.
        trial: number of the trial.

    Raises:
        ReplayError: if there is no such cell, more than one, or no such trial in it.
    """
    place, where = locate(study, cell)
    for span in where:
        if span.first <= trial < span.last:
            batches = span.group.batches(span.first, span.last)
            return Address(next(b for b in batches if b.first <= trial < b.first + b.trials), place, trial)
    first, last = where[0].first, where[-1].last - 1
    whole = 1 < sum(span.last - span.first for span in where) == last - first + 1
    numbers = f"{first} to {last}" if whole else ", ".join(str(i) for s in where for i in range(s.first, s.last))
    raise ReplayError(f"trial {trial}: cell {place.name} has trial {numbers}")


def replay(study: Study, address: Address) -> Trial:
    """Draw a trial again."""
    batch, cell = address.batch, address.cell
    draws = draw(study, [batch]).only(address.trial - batch.first)
    level = draws.place(cell.level)
    samples = Samples(cell.scale * level.x, draws.law.given(cell.noise))
    return Trial(cell, address.trial, samples, level, draws.unit_bound()[0])
