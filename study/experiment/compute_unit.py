"""Compute one unit of work. This is the only code that runs in a worker; it returns rows and writes nothing."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from study.estimators import ESTIMATORS, Estimates, Samples, Status
from study.estimators.estimates import blank
from study.experiment.config import Study
from study.experiment.designs.cells import Batch, Cell, Unit
from study.experiment.errors import Columns, Errors, Truth, levels
from study.experiment.guarded_fit import Failures, attempt
from study.experiment.sampling import Workspace, draw
from study.sphere.joint_moments import JointMoments
from study.sphere.types import Floats

TOGETHER = 2**17
"""Samples drawn at once: several batches, so that calls cost little, and few enough for a cache."""

_SETS = 2**15
"""Point sets fitted at once: the moments of so many stay in a cache."""

_workspace = Workspace()


class Clock:
    """Seconds spent in each step since the last reading, as rows of the timing table."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, int, int, float]] = []
        self._last = perf_counter()

    def read(self, step: str, samples: int, fits: int) -> None:
        """Close a step that served so many data sets of so many samples."""
        now = perf_counter()
        self.rows.append((step, samples, fits, now - self._last))
        self._last = perf_counter()

    def columns(self) -> Columns:
        """The rows, with the seconds of equal steps and sizes added up; no columns if there are none."""
        if not self.rows:
            return {}
        totals: dict[tuple[str, int], list[float]] = {}
        for step, samples, fits, seconds in self.rows:
            entry = totals.setdefault((step, samples), [0, 0.0])
            entry[0] += fits
            entry[1] += seconds
        return {
            "step": np.array([step for step, _ in totals], dtype=object),
            "samples": np.array([samples for _, samples in totals], dtype=np.int64),
            "fits": np.array([int(fits) for fits, _ in totals.values()], dtype=np.int64),
            "seconds": np.array([seconds for _, seconds in totals.values()]),
        }


@dataclass(frozen=True)
class Result:
    """Result of a unit.

    Attributes:
        blocks: errors of consecutive trials of the same cells.
        clock: seconds of each step.
        points: columns of the points that the study keeps, none if it keeps none.
        failures: columns of the fits that failed, none if none did.
    """

    blocks: tuple[Errors, ...]
    clock: Clock
    points: Columns
    failures: Columns

    @property
    def errors(self) -> Columns:
        """Columns of the error table; none without estimators."""
        return stack(block.columns() for block in self.blocks)

    @property
    def timings(self) -> Columns:
        """Columns of the timing table."""
        return self.clock.columns()


def compute(study: Study, unit: Unit) -> Result:
    """Draw a unit's batches, place them on their cells' spheres, fit them, and compare with the truth.

    Args:
        study: the config.
        unit: the work.
    """
    clock, points, failures = Clock(), StoredPoints(study), Failures(study.estimators)
    if study.route == "moments":
        found = _from_moments(study, unit, clock, failures)
    else:
        found = _from_points(study, unit, clock, points, failures)
    return Result(tuple(found), clock, stack(points.columns()), failures.columns())


def lost(study: Study, unit: Unit, message: str) -> Result:
    """Result of a unit whose worker died: every fit failed, and no bound is known."""
    d, blocks, failures = study.dimension, [], Failures(study.estimators, "worker")
    for batch in unit.batches:
        on, bound = list(levels(batch.cells)), np.full((batch.trials, d + 1, d + 1), np.nan)
        fit = blank(batch.trials * len(on), d)
        fit.status[:] = Status.FAILED
        for name in study.estimators:
            failures.note(name, range(len(batch.cells)), [batch], dict.fromkeys(range(batch.trials), message))
        truths = [Truth((0.0,) * d, 0.0) for _ in on]
        blocks.append(Errors.of(study, [batch], bound, [[fit] * len(study.estimators)], truths))
    return Result(tuple(blocks), Clock(), {}, failures.columns())


def _from_points(
    study: Study, unit: Unit, clock: Clock, points: "StoredPoints", failures: Failures
) -> Iterator[Errors]:
    """Form the points of each level and fit them, as the paper did: rounding is included."""
    for batches in together(unit.batches):
        n, cells = batches[0].samples, batches[0].cells
        draws = draw(study, batches, _workspace)
        trials = len(draws.unit_noise)
        clock.read("draw", n, trials)
        bound, truths = draws.unit_bound(), []
        fits: list[list[Estimates]] = []
        clock.read("bound", n, trials)
        for some in _side_by_side(study, cells, trials):
            on = [cells[places[0]].level for places in some]
            samples = draws.place(on[0], _workspace) if len(on) == 1 else draws.place_each(on)
            clock.read("points", n, trials * len(on))
            samples.spectrum  # noqa: B018  computed now, so that no estimator's time includes what all use
            clock.read("moments", n, trials * len(on))
            fits.append([])
            for name in study.estimators:
                fit, raised = attempt(name, samples)
                fits[-1].append(fit)
                for k, places in enumerate(some) if raised else ():
                    of_level = {t // len(on): message for t, message in raised.items() if t % len(on) == k}
                    failures.note(name, places, batches, of_level)
                clock.read(name, n, trials * len(on))
            truths += [Truth(level.center, level.radius) for level in on]
            for place in some[0] if study.keep_points else ():
                points.add(cells[place], batches, samples)
        if study.estimators:  # if all fits are known already, a run may need points or timings alone
            yield Errors.of(study, batches, bound, fits, truths)


def _side_by_side(study: Study, cells: tuple[Cell, ...], trials: int) -> Iterator[list[list[int]]]:
    """Places of the cells of each level, in groups of levels that are computed at once.

    A level is computed alone if its points are formed in memory: for an estimator that needs them there, to store them,
    for noise that is not isotropic, or for conditions besides σ, r and c.
    """
    entries = [ESTIMATORS[name] for name in study.estimators]
    alone = study.keep_points or not study.noise_law.isotropic or any(cell.further for cell in cells)
    alone = alone or not all(entry.moments_suffice or entry.by_window for entry in entries)
    count, places = 1 if alone else max(1, _SETS // trials), list(levels(cells))
    for first in range(0, len(places), count):
        yield places[first : first + count]


def _from_moments(study: Study, unit: Unit, clock: Clock, failures: Failures) -> Iterator[Errors]:
    """Reduce the draws to their joint moments, and fit all levels of all trials from those, without rounding."""
    parts, bounds, cells = [], [], unit.batches[0].cells
    for batches in together(unit.batches):
        n = batches[0].samples
        draws = draw(study, batches, _workspace)
        clock.read("draw", n, len(draws.unit_noise))
        parts.append(JointMoments.of(draws.directions, draws.unit_noise))
        clock.read("moments", n, len(draws.unit_noise))
        bounds.append(draws.unit_bound())
        clock.read("bound", n, len(draws.unit_noise))
    joint, truths = JointMoments.joined(parts), []
    fits: list[list[Estimates]] = []
    trials, d = len(joint.count), study.dimension
    for places in levels(cells):
        level = cells[places[0]].level
        regression = joint.regression(np.array([level.sigma]), np.array([level.radius]))
        samples = Samples.of_regression(regression, level.sigma)
        samples.spectrum  # noqa: B018
        clock.read("points", n, trials)
        truths.append(Truth((0.0,) * d, 0.0))  # fits from joint moments are errors already
        fits.append([])
        for name in study.estimators:
            fit, raised = attempt(name, samples)
            fits[-1].append(fit)
            failures.note(name, places, unit.batches, raised)
            clock.read(name, n, trials)
    if study.estimators:
        yield Errors.of(study, unit.batches, np.concatenate(bounds), fits, truths)


def together(batches: Sequence[Batch]) -> Iterator[list[Batch]]:
    """Group batches of the same cells that are computed at once, in order."""
    group: list[Batch] = []
    for batch in batches:
        full = sum(b.trials for b in group) * batch.samples + batch.trials * batch.samples > TOGETHER
        if group and (full or batch.cells != group[0].cells):
            yield group
            group = []
        group.append(batch)
    if group:
        yield group


def stack(parts: Iterable[Columns]) -> Columns:
    """Concatenate columns."""
    parts = list(parts)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} if parts else {}


class StoredPoints:
    """Points of the trials whose points the study stores, batch by batch and cell by cell."""

    def __init__(self, study: Study) -> None:
        self._below = study.keep_points
        self._found: dict[tuple[int, int], Columns] = {}

    def add(self, cell: Cell, batches: Sequence[Batch], samples: Samples) -> None:
        """Add the points of a cell, as far as they are to be stored, from the points of its level in some batches."""
        start = 0
        for batch in batches:
            count = min(batch.trials, self._below - batch.first)
            if count > 0:
                points = _point_columns(cell, batch.first, cell.scale * samples.x[start : start + count])
                self._found[batch.first, batch.cells.index(cell)] = points
            start += batch.trials

    def columns(self) -> list[Columns]:
        """The rows, of each batch and cell."""
        return [self._found[place] for place in sorted(self._found)]


def _point_columns(cell: Cell, first: int, x: Floats) -> Columns:
    """Rows of the points of a cell's trials (b, d, n), with the truth beside them."""
    b, d, n = x.shape
    return {
        "cell": np.full(b * n, cell.name, dtype=object),
        "trial": np.repeat(np.arange(first, first + b), n),
        "sample": np.tile(np.arange(n), b),
        **{f"x_{i + 1}": x[:, i].flatten() for i in range(d)},
        **{f"center_{i + 1}": np.full(b * n, cell.center[i]) for i in range(d)},
        "radius": np.full(b * n, cell.radius),
    }
