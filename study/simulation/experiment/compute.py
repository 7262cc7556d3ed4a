"""Errors of every estimator in every cell: the only code that runs in a worker; it returns rows and writes nothing.

A unit's batches are drawn, placed on the spheres of their cells, fitted, and compared with the truth. An exception in
an estimator, or an exit, costs the trials that raise it, and no others.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from study.arrays import Floats
from study.fits import ESTIMATORS, Estimates, Samples, Status
from study.fits.moments import JointMoments
from study.fits.registry import SimpleForm
from study.fits.samples import blank
from study.simulation.experiment.conditions import CONDITIONS, Value
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch, Cell
from study.simulation.experiment.sampling import Workspace, draw

Columns = dict[str, NDArray[Any]]
"""Columns of a table by name."""


@dataclass(frozen=True)
class Errors:
    """Errors of E estimators on T trials of each of C cells, which share their draws.

    Attributes:
        cells: the conditions.
        estimators: the names.
        conditions: names of the conditions that are columns of the table.
        first: number of the first trial.
        blocks: numbers of trials, with the sum T: rows of the table are ordered block by block.
        bound: the Cramér-Rao bound at σ = 1 of each trial's directions (T, d+1, d+1).
        center: estimated minus true centre (C, E, T, d), in the unit of the cells.
        radius: estimated minus true radius (C, E, T).
        noise_variance: as the fit has it (C, E, T); so are ``status``, ``condition`` and ``iterations``.
    """

    cells: tuple[Cell, ...]
    estimators: tuple[str, ...]
    conditions: tuple[str, ...]
    first: int
    blocks: tuple[int, ...]
    bound: Floats
    center: Floats
    radius: Floats
    noise_variance: Floats
    status: NDArray[np.int8]
    condition: Floats
    iterations: NDArray[np.int32]

    @classmethod
    def of(
        cls,
        study: Study,
        batches: Sequence[Batch],
        bound: Floats,
        fits: Sequence[list[Estimates]],
        of_spheres: bool = True,
    ) -> "Errors":
        """Compare fits with the truth.

        Args:
            study: the config, of which the estimators and the stored conditions count.
            batches: consecutive trials of the same cells.
            bound: the Cramér-Rao bound at σ = 1 of each trial's directions (T, d+1, d+1).
            fits: of all trials. Levels may have been fitted together: for each such group of levels there is a fit per
                estimator, of each trial's levels one after the other.
            of_spheres: true if the fits are spheres; false if they are their errors already.
        """
        cells = batches[0].cells
        level = np.empty(len(cells), dtype=np.intp)
        for index, places in enumerate(levels(cells)):
            level[places] = index
        scale = np.array([cell.scale for cell in cells])[:, None, None]
        true_center = np.where(of_spheres, [cell.level.center for cell in cells], 0.0)[:, None, None]
        true_radius = np.where(of_spheres, [cell.level.radius for cell in cells], 0.0)[:, None, None]

        def by_cell(name: str, kind: type = float) -> NDArray[Any]:
            groups = []
            for at_once in fits:
                # np.stack and np.moveaxis would take three times as long, and a tenth of a unit of few samples
                values: NDArray[Any] = np.array([getattr(fit, name) for fit in at_once], dtype=kind)
                by_level = values.reshape(len(at_once), len(bound), -1, *values.shape[2:])
                groups.append(by_level.swapaxes(1, 2).swapaxes(0, 1))
            return np.asarray(np.concatenate(groups)[level])

        return cls(
            cells=cells,
            estimators=study.estimators,
            conditions=tuple(condition.name for condition in study.conditions()),
            first=batches[0].first,
            blocks=tuple(batch.trials for batch in batches),
            bound=bound,
            center=(by_cell("center") - true_center) * scale[..., None],
            radius=(by_cell("radius") - true_radius) * scale,
            noise_variance=by_cell("noise_variance") * scale**2,
            status=by_cell("status", np.int8),
            condition=by_cell("condition"),
            iterations=by_cell("iterations", np.int32),
        )

    @classmethod
    def joined(cls, blocks: Sequence["Errors"]) -> "Errors":
        """Join blocks of consecutive trials of the same cells."""
        if len(blocks) == 1:
            return blocks[0]
        of_fits: dict[str, Any] = {
            name: np.concatenate([getattr(b, name) for b in blocks], axis=2) for name in Estimates._fields
        }
        sizes = tuple(size for b in blocks for size in b.blocks)
        return replace(blocks[0], blocks=sizes, bound=np.concatenate([b.bound for b in blocks]), **of_fits)

    @property
    def sigma(self) -> Floats:
        """σ of each cell (C,)."""
        return np.array([cell.noise for cell in self.cells])

    @property
    def distance(self) -> Floats:
        """Distance from the estimated to the true centre (C, E, T)."""
        return np.asarray(np.linalg.norm(self.center, axis=3))

    @property
    def center_bound(self) -> Floats:
        """√tr CRLB of the centre (C, T)."""
        return np.asarray(self.sigma[:, None] * np.sqrt(np.einsum("tii->ti", self.bound)[:, :-1].sum(axis=1)))

    @property
    def radius_bound(self) -> Floats:
        """√CRLB of the radius (C, T)."""
        return np.asarray(self.sigma[:, None] * np.sqrt(self.bound[:, -1, -1]))

    def columns(self) -> Columns:
        """Rows of the error table: block by block, cell by cell, estimator by estimator, trial by trial."""
        c, e, t = self.radius.shape
        places, ends = np.arange(c * e * t).reshape(c, e, t), np.cumsum(self.blocks)[:-1]
        place = np.concatenate([part.ravel() for part in np.split(places, ends, axis=2)])
        cell, estimator, trial = np.unravel_index(place, (c, e, t))
        of_cells = [cell.values for cell in self.cells]
        error = self.center.reshape(c * e * t, self.center.shape[3])[place]
        return {
            "cell": np.array([cell.name for cell in self.cells], dtype=object)[cell],
            "trial": self.first + trial,
            **{name: _column(name, of_cells)[cell] for name in self.conditions},
            "estimator": np.array(self.estimators, dtype=object)[estimator],
            **{f"error_{i + 1}": error[:, i] for i in range(error.shape[1])},
            "error": self.distance.ravel()[place],
            "radius_error": self.radius.ravel()[place],
            "bound": self.center_bound[cell, trial],
            "radius_bound": self.radius_bound[cell, trial],
            "noise_variance": self.noise_variance.ravel()[place],
            "status": self.status.ravel()[place],
            "condition": self.condition.ravel()[place],
            "iterations": self.iterations.ravel()[place],
        }


def _column(name: str, of_cells: Sequence[Mapping[str, Value]]) -> NDArray[Any]:
    """A condition of each cell; words as objects, which tables are made of."""
    values = [cell[name] for cell in of_cells]
    return np.array(values, dtype=object) if CONDITIONS[name].kind is str else np.array(values)


def levels(cells: tuple[Cell, ...]) -> Iterator[list[int]]:
    """The places of the cells of each level, in the order in which levels first come."""
    places: dict[Cell, list[int]] = {}
    for place, cell in enumerate(cells):
        places.setdefault(cell.level, []).append(place)
    yield from places.values()


_LONGEST_MESSAGE = 500


def attempt(name: str, samples: Samples) -> tuple[Estimates, dict[int, str]]:
    """Call an estimator; a trial on which it raises has the status FAILED.

    Returns:
        The estimates, and the messages of exceptions by the number of the trial, from 0.
    """
    b, d, _ = samples.shape
    if isinstance(function := ESTIMATORS[name].function, SimpleForm):
        return function.attempt(samples)
    try:
        return _called(name, samples), {}
    except (Exception, SystemExit):  # trying each trial by itself shows which of them raise
        fit = blank(b, d)
    raised = {}
    for trial in range(b):
        try:
            one = _called(name, samples.only(trial))
        except (Exception, SystemExit) as error:
            raised[trial] = f"{type(error).__name__}: {error}"[:_LONGEST_MESSAGE]
            fit.status[trial] = Status.FAILED
            continue
        for whole, part in zip(fit, one, strict=True):
            whole[trial] = part[0]
    return fit, raised


def _called(name: str, samples: Samples) -> Estimates:
    """Call an estimator; ValueError if it does not answer once for each set of points."""
    fit, (b, d, _) = ESTIMATORS[name](samples), samples.shape
    for field in Estimates._fields:
        expected, shape = (b, d) if field == "center" else (b,), getattr(fit, field).shape
        if shape != expected:
            raise ValueError(f"{field} has shape {shape}, expected {expected}")
    return fit


class Failures:
    """Fits that failed, as rows in the order of the error table's.

    Args:
        estimators: names, in the order of the study.
        cause: the cause of all of them, exception or worker.
    """

    def __init__(self, estimators: Sequence[str], cause: str = "exception") -> None:
        self._places = {name: place for place, name in enumerate(estimators)}
        self._cause = cause
        self._rows: list[tuple[int, int, int, int, Cell, str, str]] = []

    def note(self, name: str, cells: Sequence[int], batches: Sequence[Batch], raised: dict[int, str]) -> None:
        """Note the exceptions of an estimator.

        Args:
            name: the estimator's.
            cells: places, in their batches, of the cells that were fitted.
            batches: the batches that were fitted, their trials one after the other.
            raised: messages by the number of the trial, from 0.
        """
        if not raised:
            return
        start = 0
        for batch in batches:
            for trial in range(batch.trials):
                if (message := raised.get(start + trial)) is not None:
                    for cell in cells:
                        place = (batch.first, cell, self._places[name], batch.first + trial)
                        self._rows.append((*place, batch.cells[cell], name, message))
            start += batch.trials

    def columns(self) -> Columns:
        """The rows; no columns if there are none."""
        if not self._rows:
            return {}
        self._rows.sort(key=lambda row: row[:4])
        *_, trials, cells, names, messages = zip(*self._rows, strict=True)
        return {
            "cell": np.array([cell.name for cell in cells], dtype=object),
            "trial": np.array(trials, dtype=np.int64),
            "estimator": np.array(names, dtype=object),
            "name": np.array([f"{c.name}/{t}" for c, t in zip(cells, trials, strict=True)], dtype=object),
            "cause": np.full(len(names), self._cause, dtype=object),
            "message": np.array(messages, dtype=object),
        }


TOGETHER = 2**17
"""Samples drawn at once: several batches, so that calls cost little, and few enough for a cache."""

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


def compute(study: Study, batches: Sequence[Batch]) -> Result:
    """Draw batches, place them on their cells' spheres, fit them, and compare with the truth.

    Args:
        study: the config.
        batches: of a unit, in order.
    """
    clock, points, failures = Clock(), StoredPoints(study), Failures(study.estimators)
    if study.route == "moments":
        blocks = _from_moments(study, batches, clock, failures)
    else:
        blocks = _from_points(study, batches, clock, points, failures)
    return Result(tuple(blocks), clock, stack(points.columns()), failures.columns())


def lost(study: Study, batches: Sequence[Batch], message: str) -> Result:
    """Result of a unit whose worker died: every fit failed, and no bound is known."""
    d, blocks, failures = study.dimension, [], Failures(study.estimators, "worker")
    for batch in batches:
        on, bound = list(levels(batch.cells)), np.full((batch.trials, d + 1, d + 1), np.nan)
        fit = blank(batch.trials * len(on), d)
        fit.status[:] = Status.FAILED
        for name in study.estimators:
            failures.note(name, range(len(batch.cells)), [batch], dict.fromkeys(range(batch.trials), message))
        blocks.append(Errors.of(study, [batch], bound, [[fit] * len(study.estimators)]))
    return Result(tuple(blocks), Clock(), {}, failures.columns())


def _from_points(
    study: Study, unit: Sequence[Batch], clock: Clock, points: "StoredPoints", failures: Failures
) -> Iterator[Errors]:
    """Form the points of each level and fit them, as the paper did: rounding is included."""
    for batches in together(unit):
        n, cells = batches[0].samples, batches[0].cells
        draws = draw(study, batches, _workspace)
        trials = len(draws.unit_noise)
        clock.read("draw", n, trials)
        bound = draws.unit_bound()
        fits: list[list[Estimates]] = []
        clock.read("bound", n, trials)
        for places in levels(cells):
            level = cells[places[0]].level
            samples = draws.place(level, _workspace)
            clock.read("points", n, trials)
            samples.spectrum  # noqa: B018  computed now, so that no estimator's time includes what all use
            clock.read("moments", n, trials)
            fits.append([])
            for name in study.estimators:
                fit, raised = attempt(name, samples)
                fits[-1].append(fit)
                if raised:
                    failures.note(name, places, batches, raised)
                clock.read(name, n, trials)
            for place in places if study.keep_points else ():
                points.add(cells[place], batches, samples)
        if study.estimators:  # if all fits are known already, a run may need points or timings alone
            yield Errors.of(study, batches, bound, fits)


def _from_moments(study: Study, unit: Sequence[Batch], clock: Clock, failures: Failures) -> Iterator[Errors]:
    """Reduce the draws to their joint moments, and fit all levels of all trials from those, without rounding."""
    parts, bounds, cells = [], [], unit[0].cells
    for batches in together(unit):
        n = batches[0].samples
        draws = draw(study, batches, _workspace)
        clock.read("draw", n, len(draws.unit_noise))
        parts.append(JointMoments.of(draws.directions, draws.unit_noise))
        clock.read("moments", n, len(draws.unit_noise))
        bounds.append(draws.unit_bound())
        clock.read("bound", n, len(draws.unit_noise))
    joint = JointMoments.joined(parts)
    fits: list[list[Estimates]] = []
    trials = len(joint.count)
    for places in levels(cells):
        level = cells[places[0]].level
        regression = joint.regression(np.array([level.noise]), np.array([level.radius]))
        samples = Samples.of_regression(regression, level.noise)
        samples.spectrum  # noqa: B018
        clock.read("points", n, trials)
        fits.append([])
        for name in study.estimators:
            fit, raised = attempt(name, samples)
            fits[-1].append(fit)
            failures.note(name, places, unit, raised)
            clock.read(name, n, trials)
    if study.estimators:
        yield Errors.of(study, unit, np.concatenate(bounds), fits, of_spheres=False)


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
        self._rows: dict[tuple[int, int], Columns] = {}

    def add(self, cell: Cell, batches: Sequence[Batch], samples: Samples) -> None:
        """Add the points of a cell, as far as they are to be stored, from the points of its level in some batches."""
        start = 0
        for batch in batches:
            count = min(batch.trials, self._below - batch.first)
            if count > 0:
                points = _point_columns(cell, batch.first, cell.scale * samples.x[start : start + count])
                self._rows[batch.first, batch.cells.index(cell)] = points
            start += batch.trials

    def columns(self) -> list[Columns]:
        """The rows, of each batch and cell."""
        return [self._rows[place] for place in sorted(self._rows)]


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
