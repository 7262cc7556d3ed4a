"""Draws, points, fits and errors of a batch: the only code that runs in a worker; it returns rows and writes nothing.

A unit's batches are drawn, placed on the spheres of their cells, fitted, and compared with the truth. One draw of unit
directions u and unit noise z serves every σ, r and c. An exception in an estimator, or an exit, costs the trials that
raise it, and no others; so does one in a measure.
"""

import math
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, islice
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from study.arrays import Floats, Words
from study.fits import ESTIMATORS, Estimates, Samples, Status
from study.fits.loops.jit import CHUNK, Scratch, always_compiled, compiled, compiled_as_written, fill, fma, zeros
from study.fits.loops.random import Name, lanes, stream
from study.fits.points import cap
from study.fits.points.information import scatter_all
from study.fits.points.moments import JointMoments
from study.fits.points.samples import blank
from study.fits.registry import SimpleForm
from study.simulation.experiment import measures
from study.simulation.experiment.conditions import CONDITIONS, Value
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch, Cell
from study.simulation.experiment.laws import COORDINATES, DIRECTIONS, PLAIN, cell_noise, changed
from study.simulation.experiment.measures import Truth
from study.simulation.experiment.noise import GaussianNoise, Trials, bound_of_heights

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


@compiled_as_written
def _coordinate(i: int, u: float, z: float, center: float, radius: float, sigma: float) -> float:
    """The i-th coordinate of a sample."""
    cosine = 1.0 - u if i == 0 else u
    return fma(sigma, z, fma(radius, cosine, center))


@compiled
def form(directions: Floats, noise: Floats, center: Floats, radius: float, sigma: float, points: Floats) -> None:
    """Write the points x = c + r u + σ z of directions with the height 1 - u₁ in place of u₁, all (b, d, n)."""
    b, d, n = points.shape
    for t in range(b):
        for i in range(d):
            u, z, x, c = directions[t, i], noise[t, i], points[t, i], center[i]
            for k in range(n):
                x[k] = _coordinate(i, u[k], z[k], c, radius, sigma)


@compiled
def draw_points(
    states: Words, size: int, levels: Floats, points: Floats, sums: tuple[Floats, ...], scratch: Scratch
) -> None:
    """Draw the points of trials (b, d, n) of one level each, a few at a time, which stay in a processor's cache.

    Args:
        states: of the generators of each block of trials, as `cap.draw` takes them.
        size: number of trials of a block.
        levels: centre, radius, σ and height of the cap, of each block (blocks, d + 3).
        points: receives the points.
        sums: receive the sums of `weighted_scatter`, of directions with the height 1 - u₁ in place of u₁.
        scratch: its rows are memory for the directions of a few trials.
    """
    (b, d, _), (whole, mean, scatter), (directions, zero, square) = points.shape, sums, scratch
    weights = np.empty((1, CHUNK))
    fill(weights[0], 1.0)
    for block in range(len(states)):
        level, last = levels[block], min(b, (block + 1) * size)
        for first in range(block * size, last, len(directions)):
            few = slice(first, min(last, first + len(directions)))
            x, u = points[few], directions[: few.stop - first]
            cap.draw_block(states[block], level[d + 2], u, x)
            scatter_all(u, weights, whole[few], mean[few], scatter[few], zero, square)
            form(u, x, level[:d], level[d], level[d + 1], x)


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

    def place(self, level: Cell, points: Floats | None = None) -> Samples:
        """Form the points x = c + r u + σ z of a level (b, d, n), with the noise as estimators take it.

        Args:
            level: the level.
            points: receives the points; a fresh array, if there is none.
        """
        values = level.values
        trials = Trials(self.unit_noise, self.directions, math.radians(level.angle), self.further)
        noise, center, radius = cell_noise(trials, values), np.array(level.center), float(level.radius)
        points = np.empty(noise.shape) if points is None else points
        form(self.directions, noise, center, radius, float(level.noise), points)
        if (law := str(values["coordinates"])) != PLAIN[COORDINATES]:
            about = trials._replace(values=(points - center[:, None]) / radius)
            points[...] = center[:, None] + radius * changed(COORDINATES, law, about)
        return Samples(points, self.law.given(level.stated_noise))

    def unit_bound(self) -> Floats:
        """The Cramér-Rao bound of (c, r) at σ = 1, for the realised directions (b, d+1, d+1), of normal noise."""
        return self.law.unit_bound(self.directions)


def draw(study: Study, batch: Batch, array: Array = new) -> Draws:
    """Draw a batch from the named streams of its blocks."""
    cell, law, blocks = batch.cells[0], study.noise_law, batch.blocks()
    angle, unused = math.radians(cell.angle), blocks[0][1]  # a batch may begin within a block
    shape = (unused + batch.trials, study.dimension, cell.samples)
    directions, normals, first = array("directions", shape), array("normals", shape), 0
    for name, skip, count in blocks:
        part = slice(first, first + skip + count)
        cap.draw(lanes(study.seed, *name), angle, directions[part], normals[part])
        first = part.stop
    directions, normals = directions[unused:], normals[unused:]
    draws = Draws(batch, study.seed, directions, law.unit_noise(normals), law)
    if cell.directions != PLAIN[DIRECTIONS]:
        drawn = Trials(directions, directions, angle, draws.further)
        directions[...] = changed(DIRECTIONS, cell.directions, drawn)
    return draws


Columns = dict[str, NDArray[Any]]
"""Columns of a table by name."""
_KINDS: dict[str, type] = {"status": np.int8, "iterations": np.int32}
"""Types of the numbers of a fit, besides floating point."""


class Fitted(NamedTuple):
    """Fits of trials that were fitted together.

    Attributes:
        batches: the trials, of the same levels, or each of a cell of its own.
        bound: the Cramér-Rao bound at σ = 1 of each trial's directions (T, d+1, d+1).
        fits: for each level a fit per estimator, of all trials.
        measured: for each level the columns of the measures (T,) of each estimator; none if they are not known.
    """

    batches: Sequence[Batch]
    bound: Floats
    fits: Sequence[Sequence[Estimates]]
    measured: Sequence[Sequence[Columns]] = ()


@dataclass(frozen=True)
class Errors:
    """Errors of E estimators on T trials of each of C cells, which share their draws.

    Attributes:
        batch: the trials.
        cells: their cells; in a random design, where C = 1, that of each trial.
        estimators: the names.
        conditions: names of the conditions that are columns of the table.
        bound: the Cramér-Rao bound at σ = 1 of each trial's directions (T, d+1, d+1).
        fits: estimated minus true centre (C, E, T, d) and radius (C, E, T), in the unit of the cells; the rest as the
            fits have it (C, E, T).
        measured: columns of the study's measures (C, E, T), by name.
    """

    batch: Batch
    cells: tuple[Cell, ...]
    estimators: tuple[str, ...]
    conditions: tuple[str, ...]
    bound: Floats
    fits: Estimates
    measured: Columns

    @classmethod
    def of(cls, study: Study, batch: Batch, fitted: Sequence[Fitted], of_spheres: bool = True) -> "Errors":
        """Compare fits with the truth.

        Args:
            study: the config, of which the estimators and the stored conditions count.
            batch: the trials and their cells.
            fitted: the fits of all trials, in order.
            of_spheres: true if the fits are spheres; false if they are their errors already.
        """
        cells = batch.cells or tuple(part.cells[0] for one in fitted for part in one.batches)
        level = np.empty(batch.group.width, dtype=np.intp)
        for index, places in enumerate(batch.group.levels):
            level[list(places)] = index

        def by_cell(numbers: Iterable[list[list[NDArray[Any]]]], kind: Any) -> NDArray[Any]:
            return np.concatenate([np.array(part, dtype=kind) for part in numbers], axis=2)[level]

        def of_fits(name: str) -> NDArray[Any]:
            parts = ([[getattr(fit, name) for fit in fits] for fits in one.fits] for one in fitted)
            return by_cell(parts, _KINDS.get(name, float))

        def of_cells(values: list[Any]) -> Floats:
            numbers = np.array(values)
            return numbers[:, None, None] if batch.cells else numbers[None, None]

        scale = of_cells([cell.scale for cell in cells])
        true_center = np.where(of_spheres, of_cells([cell.level.center for cell in cells]), 0.0)
        true_radius = np.where(of_spheres, of_cells([cell.level.radius for cell in cells]), 0.0)
        whole = Estimates(*map(of_fits, Estimates._fields))
        errors = whole._replace(
            center=(whole.center - true_center) * scale[..., None],
            radius=(whole.radius - true_radius) * scale,
            noise_variance=whole.noise_variance * scale**2,
        )
        columns = measures.missing(study.measures, study.dimension, errors.radius.shape)
        for name in columns if fitted[0].measured else ():
            parts = ([[fit[name] for fit in fits] for fits in one.measured] for one in fitted)
            columns[name] = by_cell(parts, columns[name].dtype)
        bound, conditions = np.concatenate([one.bound for one in fitted]), tuple(c.name for c in study.conditions())
        return cls(batch, cells, study.estimators, conditions, bound, errors, columns)

    @property
    def distance(self) -> Floats:
        """Distance from the estimated to the true centre (C, E, T)."""
        return np.asarray(np.linalg.norm(self.fits.center, axis=3))

    @property
    def sigma(self) -> Floats:
        """σ of each cell (C, 1), or of each trial (1, T)."""
        sigma = np.array([cell.noise for cell in self.cells])
        return sigma[:, None] if self.batch.cells else sigma[None]

    @property
    def center_bound(self) -> Floats:
        """√tr CRLB of the centre (C, T)."""
        return np.asarray(self.sigma * np.sqrt(np.einsum("tii->ti", self.bound)[:, :-1].sum(axis=1)))

    @property
    def radius_bound(self) -> Floats:
        """√CRLB of the radius (C, T)."""
        return np.asarray(self.sigma * np.sqrt(self.bound[:, -1, -1]))

    def columns(self) -> Columns:
        """Rows of the error table: block by block, cell by cell, estimator by estimator, trial by trial."""
        fits = self.fits
        c, e, t = fits.radius.shape
        places, ends = np.arange(c * e * t).reshape(c, e, t), np.cumsum([n for *_, n in self.batch.blocks()])[:-1]
        place = np.concatenate([part.ravel() for part in np.split(places, ends, axis=2)])
        cell, estimator, trial = np.unravel_index(place, (c, e, t))
        own = cell if self.batch.cells else trial
        of_cells = [cell.values for cell in self.cells]
        error = fits.center.reshape(c * e * t, fits.center.shape[3])[place]
        return {
            "cell": np.array([cell.name for cell in self.cells], dtype=object)[own],
            "trial": self.batch.first + trial,
            **{name: _column(name, of_cells)[own] for name in self.conditions},
            "estimator": np.array(self.estimators, dtype=object)[estimator],
            **{f"error_{i + 1}": error[:, i] for i in range(error.shape[1])},
            "error": self.distance.ravel()[place],
            "radius_error": fits.radius.ravel()[place],
            "bound": self.center_bound[cell, trial],
            "radius_bound": self.radius_bound[cell, trial],
            "noise_variance": fits.noise_variance.ravel()[place],
            "status": fits.status.ravel()[place],
            "condition": fits.condition.ravel()[place],
            "iterations": fits.iterations.ravel()[place],
            **{name: values.ravel()[place] for name, values in self.measured.items()},
        }


def _column(name: str, of_cells: Sequence[Mapping[str, Value]]) -> NDArray[Any]:
    """A condition of each cell; words as objects, which tables are made of."""
    values = [cell[name] for cell in of_cells]
    return np.array(values, dtype=object) if CONDITIONS[name].kind is str else np.array(values)


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


TOGETHER = 2**19
"""Samples drawn at once: several blocks, so that calls cost little beside the fits. Arrays of three axes take 13 MB."""

_A_FEW = 2**12
"""Samples whose directions, noise and points stay in a second-level cache."""

_workspace = Workspace()


class Result:
    """Result of a unit: errors, seconds of each step, points that the study keeps, and fits that failed.

    Args:
        study: the config.
        cause: cause of all failures: exception, or worker.

    Attributes:
        of_fits: the errors; None without estimators.
    """

    def __init__(self, study: Study, cause: str = "exception") -> None:
        self.of_fits: Errors | None = None
        self._study, self._cause = study, cause
        self._seconds: dict[tuple[str, int], list[float]] = {}
        self._points: dict[tuple[int, int], Columns] = {}
        self._failures: dict[tuple[int, int, int, int], tuple[Cell, str, str]] = {}
        self._last = perf_counter()

    def clock(self, step: str, samples: int, fits: int) -> None:
        """Close a step that served so many data sets of so many samples."""
        entry = self._seconds.setdefault((step, samples), [0, 0.0])
        now = perf_counter()
        entry[0] += fits
        entry[1] += now - self._last
        self._last = perf_counter()

    def fail(self, name: str, cells: Sequence[int], batches: Sequence[Batch], raised: Mapping[int, str]) -> None:
        """Note the exceptions of an estimator, or of a measure of its fits; of each fit the first.

        Args:
            name: the estimator's.
            cells: places, in the batches, of the cells that were fitted.
            batches: the trials that were fitted.
            raised: messages by the number of the trial, from 0.
        """
        estimator = self._study.estimators.index(name)
        trials = [(batch, trial) for batch in batches for trial in range(batch.first, batch.last)] if raised else []
        for place, message in raised.items():
            batch, trial = trials[place]
            for cell in cells:
                key = trial // batch.group.size, cell, estimator, trial
                self._failures.setdefault(key, (batch.cells[cell], name, message))

    def add_points(self, places: Sequence[int], batches: Sequence[Batch], x: Floats) -> None:
        """Add the points of the cells of a level (b, d, n), as far as the study keeps them."""
        start = 0
        for batch in batches if self._study.keep_points else ():
            first = batch.first
            for *_, trials in batch.blocks():
                count = min(trials, self._study.keep_points - first)
                for place in places if count > 0 else ():
                    cell = batch.cells[place]
                    points = _point_columns(cell, first, cell.scale * x[start : start + count])
                    self._points[first, place] = points
                start, first = start + trials, first + trials

    @property
    def errors(self) -> Columns:
        """Columns of the error table; none without estimators."""
        return {} if self.of_fits is None else self.of_fits.columns()

    @property
    def timings(self) -> Columns:
        """Columns of the timing table: the seconds of equal steps and sizes added up."""
        if not self._seconds:
            return {}
        steps, samples = zip(*self._seconds, strict=True)
        fits, seconds = np.array(list(self._seconds.values())).T
        words = {"step": np.array(steps, dtype=object), "samples": np.array(samples, dtype=np.int64)}
        return words | {"fits": fits.astype(np.int64), "seconds": seconds}

    @property
    def points(self) -> Columns:
        """Columns of the points that the study keeps, block by block and cell by cell; none if it keeps none."""
        return stack(self._points[place] for place in sorted(self._points))

    @property
    def failures(self) -> Columns:
        """Columns of the fits that failed, in the order of the error table; none if none did."""
        if not self._failures:
            return {}
        places = sorted(self._failures)
        trials = [trial for *_, trial in places]
        cells, names, messages = zip(*map(self._failures.__getitem__, places), strict=True)
        return {
            "cell": np.array([cell.name for cell in cells], dtype=object),
            "trial": np.array(trials, dtype=np.int64),
            "estimator": np.array(names, dtype=object),
            "name": np.array([f"{c.name}/{t}" for c, t in zip(cells, trials, strict=True)], dtype=object),
            "cause": np.full(len(names), self._cause, dtype=object),
            "message": np.array(messages, dtype=object),
        }


@always_compiled()
def compute(study: Study, unit: Batch) -> Result:
    """Draw the trials of a unit, place them on their cells' spheres, fit them, and compare with the truth."""
    result = Result(study)
    (_from_moments if study.route == "moments" else _from_points)(study, unit, result)
    return result


_begun = set[str]()
_beginning = threading.Lock()


def begin(study: Study, unit: Batch) -> None:
    """Compute one trial of a study, once in a process, and forget it.

    It compiles the study's loops, or loads them: the times of later trials are those of the work alone.
    """
    with _beginning:  # another thread would wait for the compiler while its clock runs
        if (name := study.digest()) not in _begun:
            _begun.add(name)
            compute(study, replace(unit, last=unit.first + 1))


def lost(study: Study, unit: Batch, message: str) -> Result:
    """Result of a unit whose worker died: every fit failed, and no bound is known."""
    d, result, fitted = study.dimension, Result(study, "worker"), list[Fitted]()
    for batch in unit.parts(0):
        bound = np.full((batch.trials, d + 1, d + 1), np.nan)
        fit = blank(batch.trials, d)
        fit.status[:] = Status.FAILED
        for name in study.estimators:
            result.fail(name, range(len(batch.cells)), [batch], dict.fromkeys(range(batch.trials), message))
        fitted.append(Fitted([batch], bound, [[fit] * len(study.estimators)] * len(batch.group.levels)))
    result.of_fits = Errors.of(study, unit, fitted) if study.estimators else None
    return result


def _from_points(study: Study, unit: Batch, result: Result) -> None:
    """Form the points of each level and fit them, as the paper did: rounding is included."""
    fitted = [_fitted(study, batches, result) for batches in _alike(study, unit)]
    if study.estimators:  # if all fits are known already, a run may need points or timings alone
        result.of_fits = Errors.of(study, unit, fitted)


def _alike(study: Study, unit: Batch) -> Iterator[list[Batch]]:
    """The batches of a unit; those of a random design together whose fits need nothing but points of equal number."""

    def kind(batch: Batch) -> tuple[int, bool]:
        return batch.group.samples, _plain(study, batch)

    for (samples, plain), parts in groupby(unit.parts(TOGETHER), kind):
        several = TOGETHER // samples if plain and not unit.cells else 1
        while batches := list(islice(parts, max(1, several))):
            yield batches


def _plain(study: Study, batch: Batch) -> bool:
    """True if the draws serve one level alone, and neither a law nor a covariance nor a measure is in the way."""
    further = study.dimension != 3 or study.measures or not study.noise_law.isotropic or batch.cells[0].further
    return len(batch.group.levels) == 1 and not further


def _fitted(study: Study, batches: Sequence[Batch], result: Result) -> Fitted:
    """Draw batches that are alike, and fit their trials together, level by level."""
    n, cells = batches[0].group.samples, batches[0].cells
    fits: list[list[Estimates]] = []
    measured: list[list[Columns]] = []
    levels = _drawn_at_once if _plain(study, batches[0]) else _drawn_first
    for places, samples, bound in levels(study, batches, result):
        result.clock("points", n, len(samples.x))
        samples.regression  # noqa: B018  computed now, so that no estimator's time includes what all use
        result.clock("moments", n, len(samples.x))
        fits.append(_fits(study, samples, places, batches, result))
        result.add_points(places, batches, samples.x)
        level = cells[places[0]].level
        truth = Truth(np.array(level.center), level.radius, level.noise, level.noise**2 * bound)
        measured.append(_measured(study, samples, fits[-1], truth, places, batches, result))
    return Fitted(batches, bound, fits, measured)


Level = tuple[Sequence[int], Samples, Floats]
"""Places of the cells of a level, its samples, and the bound at σ = 1 (b, d+1, d+1)."""


def _drawn_first(study: Study, batches: Sequence[Batch], result: Result) -> Iterator[Level]:
    """The levels of a batch, for all of which it is drawn first."""
    (batch,) = batches
    draws = draw(study, batch, _workspace)
    result.clock("draw", batch.group.samples, batch.trials)
    bound = draws.unit_bound()
    result.clock("bound", batch.group.samples, batch.trials)
    points = _workspace("points", draws.directions.shape)
    for places in batch.group.levels:
        yield places, draws.place(batch.cells[places[0]].level, points), bound


def _drawn_at_once(study: Study, batches: Sequence[Batch], result: Result) -> Iterator[Level]:
    """The only level of plain batches."""
    (n, size), d = (batches[0].group.samples, batches[0].group.size), study.dimension
    blocks = [(batch.cells[0].level, *block) for batch in batches for block in batch.blocks()]
    states = np.array([lanes(study.seed, *name) for _, name, _, _ in blocks])
    levels = [(*c.center, c.radius, c.noise, cap.top(math.radians(c.angle), d)) for c, *_ in blocks]
    unused, trials = blocks[0][2], sum(batch.trials for batch in batches)  # a batch may begin within a block
    points = _workspace("points", (unused + trials, d, n))
    scratch = Scratch(_workspace("directions", (max(1, _A_FEW // n), d, n)), zeros(d), zeros(d, d))
    sums = np.empty(len(points)), np.empty((len(points), d)), np.empty((len(points), d, d))
    draw_points(states, size, np.array(levels), points, sums, scratch)
    result.clock("draw", n, trials)
    bound = bound_of_heights(*(values[unused:] for values in sums))
    result.clock("bound", n, trials)
    stated = {level.stated_noise for level, *_ in blocks}
    sigma = stated.pop() if len(stated) == 1 else np.array([level.stated_noise for level, *_ in blocks])
    yield (0,), Samples(points[unused:], sigma), bound


def _from_moments(study: Study, unit: Batch, result: Result) -> None:
    """Reduce the draws to their joint moments, and fit all levels of all trials from those, without rounding."""
    moments, bounds, n = [], [], unit.group.samples
    for batch in unit.parts(TOGETHER):
        draws = draw(study, batch, _workspace)
        result.clock("draw", n, batch.trials)
        moments.append(JointMoments.of(draws.directions, draws.unit_noise))
        result.clock("moments", n, batch.trials)
        bounds.append(draws.unit_bound())
        result.clock("bound", n, batch.trials)
    joint = JointMoments.joined(moments)
    fits: list[list[Estimates]] = []
    for places in unit.group.levels:
        level = unit.cells[places[0]].level
        regression = joint.regression(np.array([level.noise]), np.array([level.radius]))
        samples = Samples.of_regression(regression, level.noise)
        result.clock("points", n, unit.trials)
        fits.append(_fits(study, samples, places, [unit], result))
    if study.estimators:
        result.of_fits = Errors.of(study, unit, [Fitted([unit], np.concatenate(bounds), fits)], of_spheres=False)


def _fits(
    study: Study, samples: Samples, places: Sequence[int], batches: Sequence[Batch], result: Result
) -> list[Estimates]:
    """Fits of every estimator to the samples of a level, which is that of the cells at some places of some batches."""
    fits = []
    for name in study.estimators:
        fit, raised = attempt(name, samples)
        fits.append(fit)
        result.fail(name, places, batches, raised)
        result.clock(name, batches[0].group.samples, len(samples.x))
    return fits


def _measured(
    study: Study,
    samples: Samples,
    fits: list[Estimates],
    truth: Truth,
    places: Sequence[int],
    batches: Sequence[Batch],
    result: Result,
) -> list[Columns]:
    """Columns of the study's measures of the fits of a level, for each estimator; see `_fits`.

    Standard errors are those of fits that are given no noise.
    """
    of_fits: list[Columns] = []
    samples = replace(samples, noise=None)
    for name, fit in zip(study.estimators, fits, strict=True):
        of_fits.append({})
        for measure in study.measures:
            columns, raised = measures.attempt(measure, samples, fit, name, truth)
            of_fits[-1] |= columns
            result.fail(name, places, batches, raised)
    if study.measures:
        result.clock("measures", batches[0].group.samples, len(samples.x))
    return of_fits


def stack(parts: Iterable[Columns]) -> Columns:
    """Concatenate columns."""
    parts = list(parts)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} if parts else {}


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
