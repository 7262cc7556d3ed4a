"""Draw a batch and form its points: one draw of unit directions u and unit noise z serves every σ, r and c.

A study is cut into units of work here: batches of trials of the cells that share draws. One trial can be drawn again
from its name: the same points to the last bit, on whatever machine its run was computed.
"""

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np

from study.arrays import Floats
from study.fits import Samples, cap
from study.fits.jit import form
from study.fits.random import Name, lanes, stream
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch, Cell, Group
from study.simulation.experiment.noise import GaussianNoise, departures, place_directions
from study.text import nearest

Array = Callable[[str, tuple[int, ...]], Floats]
"""Makes an array of a name and shape, with any content."""


def new(name: str, shape: tuple[int, ...]) -> Floats:
    """A fresh array; the name does not matter."""
    return np.empty(shape)


class Workspace(threading.local):
    """Reuse arrays within a thread: fresh memory costs as much as the arithmetic on it.

    An array is valid until the next one of the same name is requested.
    """

    def __init__(self) -> None:
        self._arrays: dict[str, Floats] = {}

    def __call__(self, name: str, shape: tuple[int, ...]) -> Floats:
        """An array of a shape, with any content."""
        size = math.prod(shape)
        if name not in self._arrays or self._arrays[name].size < size:
            self._arrays[name] = np.empty(size)
        return self._arrays[name][:size].reshape(shape)


@dataclass(frozen=True)
class Draws:
    """The draws of a batch, before they are placed on any sphere.

    Attributes:
        batch: the trials, of the same cells.
        seed: the study's.
        directions: unit vectors (b, d, n) about the first axis, with the height 1 - u₁ in place of u₁.
        unit_noise: noise at σ = 1 (b, d, n).
        law: the Gaussian law of the noise.
    """

    batch: Batch
    seed: int
    directions: Floats
    unit_noise: Floats
    law: GaussianNoise

    def further(self, kind: Name, numbers: Callable[[np.random.Generator, int], Floats]) -> Floats:
        """Draw further random numbers for each trial (b, …), always the same ones, which changes no others.

        Args:
            kind: last part of the names of the streams, which distinguishes these numbers from others.
            numbers: gives numbers of so many trials (trials, …) from a generator.
        """
        blocks = self.batch.blocks()
        parts = [numbers(stream(self.seed, *name, *kind), skip + count)[skip:] for name, skip, count in blocks]
        return np.concatenate(parts)

    def place(self, level: Cell, array: Array = new) -> Samples:
        """Form the points x = c + r u + σ z of a level (b, d, n), with the noise as estimators take it."""
        noise = self.unit_noise
        for step, numbers in departures({"angle": level.angle} | dict(level.further)):
            noise = step(noise, self.directions, self.further, *numbers)
        points = array("points", noise.shape)
        form(self.directions, noise, np.array(level.center), float(level.radius), float(level.noise), points)
        return Samples(points, self.law.given(level.stated_noise))

    def unit_bound(self) -> Floats:
        """The Cramér-Rao bound of (c, r) at σ = 1, for the realised directions (b, d+1, d+1), of normal noise."""
        return self.law.unit_bound(self.directions)


def draw(study: Study, batch: Batch, array: Array = new) -> Draws:
    """Draw a batch from the named streams of its blocks."""
    d, cell, blocks = study.dimension, batch.cells[0], batch.blocks()
    angle, trials = math.radians(cell.angle), sum(skip + count for _, skip, count in blocks)
    shape = (trials, d, cell.samples)
    directions, normals = array("directions", shape), array("normals", shape)
    used = np.ones(trials, dtype=bool)
    first = 0
    for name, skip, count in blocks:
        part = slice(first, first + skip + count)
        cap.draw(lanes(study.seed, *name), angle, directions[part], normals[part])
        used[first : first + skip] = False
        first = part.stop
    if not used.all():
        directions, normals = directions[used], normals[used]
    law = study.noise_law
    draws = Draws(batch, study.seed, directions, law.unit_noise(normals), law)
    place_directions(cell.directions, angle, directions, draws.further)
    return draws


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


def units(study: Study) -> Iterator[Batch]:
    """The study's units of work, in the order of its tables; they depend on nothing but the config."""
    return (unit for group in groups(study) for unit in units_of(study, group))


def units_of(study: Study, group: Group, below: int | None = None) -> Iterator[Batch]:
    """The units of a group; only those with trials below a number, if one is given."""
    trials = trials_of(study, group)
    if study.keep == "summary":
        yield from (Batch(part, 0, trials if below is None else min(below, trials)) for part in _few(study, group))
        return
    step = _step(study, group)
    for first in range(0, trials if below is None else min(below, trials), step):
        yield Batch(group, first, min(trials, first + step))


def sizes_of(study: Study, group: Group) -> Iterator[tuple[Batch, int]]:
    """The units of a group, of equal ones the first alone; each with the number of those that are equal in size."""
    if study.keep == "summary" or study.design.one_trial_a_cell:
        yield from ((unit, 1) for unit in units_of(study, group))
        return
    trials, step = trials_of(study, group), _step(study, group)
    whole, rest = divmod(trials, step)
    if whole:
        yield Batch(group, 0, step), whole
    if rest:
        yield Batch(group, trials - rest, trials), 1


def _step(study: Study, group: Group) -> int:
    """Number of trials of each unit of a group, but the last, in a study that keeps its errors."""
    return group.trials_per_unit(1 if study.route == "moments" else len(group.levels))


def _few(study: Study, group: Group) -> Iterator[Group]:
    """Cut a group to so few cells that all their trials, of which a summary is made, are few enough for one unit.

    Each of these groups makes the draws of all trials again.
    """
    trials, cells, levels = trials_of(study, group), group.cells, len(group.levels)
    at_once = max(1, _FITS_IN_MEMORY // (trials * max(1, len(study.estimators))))
    if study.route == "points":  # a level costs as much as the draw
        at_once = min(at_once, max(1, _SAMPLES_IN_SUMMARY // (trials * group.samples) - 1) * (len(cells) // levels))
    if at_once >= len(cells):
        yield group
        return
    for first in range(0, len(cells), at_once):
        yield group.only(cells[first : first + at_once])


_MOST_COMPARED = 20_000


class ReplayError(Exception):
    """A trial that a study does not have; the message says which ones it has."""


@dataclass(frozen=True)
class Trial:
    """One data set of a study, with the truth. Its points are drawn when they are asked for, always the same ones.

    Attributes:
        study: the config.
        group: the cells that share its draw.
        cell: its condition, one of them.
        trial: its number.
    """

    study: Study
    group: Group
    cell: Cell
    trial: int

    @cached_property
    def level(self) -> Samples:
        """The points (1, d, n) and the noise in units of the cell's scale, as the estimators take them."""
        return self._draws.place(self.cell.level)

    @cached_property
    def samples(self) -> Samples:
        """The points (1, d, n) and the noise."""
        return Samples(self.cell.scale * self.level.x, self._draws.law.given(self.cell.stated_noise))

    @cached_property
    def unit_bound(self) -> Floats:
        """Cramér-Rao bound of (c, r) at σ = 1, for the realised directions (d+1, d+1)."""
        bound: Floats = self._draws.unit_bound()[0]
        return bound

    @cached_property
    def _draws(self) -> Draws:
        return draw(self.study, Batch(self.group, self.trial, self.trial + 1))


def all_trials(study: Study, below: int | None = None) -> Iterator[Trial]:
    """The trials of a study, cell by cell in the order of its tables.

    Args:
        study: the config.
        below: only trials with a number below this one are listed, if it is given.
    """
    for unit in chain.from_iterable(units_of(study, group, below) for group in groups(study)):
        for batch in unit.parts(0):
            last = batch.last if below is None else min(below, batch.last)
            for cell in batch.cells:
                yield from (Trial(study, batch.group, cell, trial) for trial in range(batch.first, last))


def locate(study: Study, cell: str) -> tuple[Cell, list[Batch]]:
    """Find a cell of a study by its name.

    Args:
        study: the config.
        cell: the cell's name, or enough of its beginning to tell it from all others.

    Returns:
        The cell, and the units of its trials: in a random design, one for each trial.

    Raises:
        ReplayError: if there is no such cell, or more than one.
    """
    matches: dict[str, tuple[Cell, list[Batch]]] = {}
    names: list[str] = []
    for group in groups(study):
        for known, first, last in group.places(0, trials_of(study, group)):
            names += [known.name] * (len(names) < _MOST_COMPARED)
            if known.name.startswith(cell):
                matches.setdefault(known.name, (known, []))[1].append(Batch(group, first, last))
    if not matches:
        close = nearest(cell, names)
        hint = "the" if close is None else f"did you mean {close}? The"
        raise ReplayError(
            f"cell {cell!r}: no such cell in {study.run_name()}; {hint} error table's first column has them"
        )
    if len(matches) > 1:
        raise ReplayError(f"cell {cell!r}: not one cell but {len(matches)}: {', '.join(sorted(matches)[:5])} …")
    return next(iter(matches.values()))


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


def find(study: Study, cell: str, trial: int) -> Trial:
    """Find a trial of a study.

    Args:
        study: the config.
        cell: the cell's name, or enough of its beginning to tell it from all others.
        trial: number of the trial.

    Raises:
        ReplayError: if there is no such cell, more than one, or no such trial in it.
    """
    place, where = locate(study, cell)
    for unit in where:
        if unit.first <= trial < unit.last:
            return Trial(study, next(Batch(unit.group, trial, trial + 1).parts(0)).group, place, trial)
    first, last = where[0].first, where[-1].last - 1
    whole = 1 < sum(unit.last - unit.first for unit in where) == last - first + 1
    numbers = f"{first} to {last}" if whole else ", ".join(str(i) for s in where for i in range(s.first, s.last))
    raise ReplayError(f"trial {trial}: cell {place.name} has trial {numbers}")
