"""Cost of a study before it runs: counts, bytes, and seconds predicted from a short calibration on its conditions."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain, islice
from time import perf_counter
from typing import NamedTuple

import numpy as np

from study.arrays import Floats
from study.files import RunError
from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch, Cell, Group
from study.simulation.runs.parts import shorter, tables, takes_long
from study.text import DAY, columns, duration, size

_SIZES = 7
_MOST_PROBED = 250_000
"""Largest number of samples that is measured; beyond it, time is proportional to the number."""
_CELLS = 6
_LEVELS = 5
_REPEATS = 3
_PROBED = 2**17
"""Samples of a batch that is timed: a quarter of those that a run draws at once, since a plan is to take a second."""
_LONG_PROBE = 0.05
"""A measurement that takes longer than so many seconds is not repeated, unless it is the first."""
_PROBE = 0.2
"""Seconds that a measurement may take."""
_FEW = 10
"""Trials that show what a trial takes beside the call."""
_MOST_SUMMARISED = 20_000
"""Largest number of trials whose summary is measured; beyond it, time is proportional to the number."""


class Pace(NamedTuple):
    """Seconds of one worker while all workers compute, at k numbers of samples.

    Attributes:
        samples: the numbers of samples, ascending (k,).
        draw: seconds per trial for the draw and all that its levels share (k,).
        level: seconds per trial and level of noise and radius, for the fits of all estimators (k,).
        summary: seconds to summarise a cell for all estimators; 0 in a study that keeps its errors.
    """

    samples: Floats
    draw: Floats
    level: Floats
    summary: float

    def of(self, samples: int, levels: int) -> float:
        """Seconds of a trial: linear between the measured numbers of samples, in proportion beyond the last."""
        draw, level = (np.interp(samples, self.samples, seconds) for seconds in (self.draw, self.level))
        return float(max(1.0, samples / self.samples[-1]) * (draw + levels * level))


def measure(study: Study, cells: Sequence[Cell], jobs: int) -> Pace:
    """Compute a few trials of several sizes, on all workers at once, since they share memory and interpreter.

    Args:
        study: the config.
        cells: conditions of it, of all sizes.
        jobs: number of workers.
    """
    bare = study.model_copy(update={"keep_points": 0, "keep": "errors"})
    sizes = np.unique([min(cell.samples, _MOST_PROBED) for cell in cells])
    if len(sizes) > _SIZES:
        wanted = np.geomspace(sizes[0], sizes[-1], _SIZES)
        sizes = np.unique([sizes[np.abs(np.log(sizes / size)).argmin()] for size in wanted])
    probes = [_probes(study, cells, int(size)) for size in sizes]
    jobs = min(jobs, os.cpu_count() or 1)
    with ThreadPoolExecutor(jobs) as pool:  # outside the main thread: see `study.simulation.runs.workers`
        seconds = list(pool.map(lambda _: [_timed(bare, batches) for batches in probes], range(jobs)))
        summary = pool.submit(_time_of_summary, study, cells).result() if study.keep == "summary" else 0.0
    draw, level = np.median(np.array(seconds), axis=0).T
    if study.route == "moments":  # a fit takes as long at any size, and a run makes those of all trials at once
        level = np.full(len(level), level.min())
    return Pace(sizes.astype(float), draw, level, summary)


def _probes(study: Study, cells: Sequence[Cell], size: int) -> list[Batch]:
    """Batches of so many samples, of conditions far apart, each large enough that calls cost little."""
    most = max(_CELLS * _LEVELS, len(cells) // _SIZES)
    near = sorted(cells, key=lambda cell: abs(np.log(cell.samples / size)))[:most]
    chosen = [near[i] for i in np.linspace(0, len(near) - 1, min(_CELLS, len(near))).astype(int)]
    if study.design.one_trial_a_cell:
        return [Batch(Group(("probe", i), 1, (replace(cell, samples=size),)), 0, 1) for i, cell in enumerate(chosen)]
    trials = min(study.design.trials_of(size), max(1, _PROBED // size))
    batches = []
    for i, cell in enumerate(chosen):
        alike = [replace(c, samples=size) for c in near if c.angle == cell.angle]
        places = [level[0] for level in Group(("probe",), 1, tuple(alike)).levels]
        part = tuple(alike[places[k]] for k in np.linspace(0, len(places) - 1, min(_LEVELS, len(places))).astype(int))
        batches.append(Batch(Group(("probe", i), trials, part), 0, trials))
    return batches


def _timed(study: Study, batches: list[Batch]) -> Floats:
    """Seconds per trial, and per trial and level, averaged over batches (2,)."""
    shared = ("draw", "bound", "moments") if study.route == "moments" else ("draw", "bound")
    per_trial = []
    for batch in (_short(study, batch) for batch in batches):
        times = []
        for repeat in range(_REPEATS):
            began = perf_counter()
            steps = _steps(study, batch)
            whole = perf_counter() - began
            drawing = sum(steps[name] for name in shared)
            times.append((whole - drawing, drawing))
            if repeat and whole > _LONG_PROBE:  # the first one may have loaded compiled code
                break
        fits, drawing = min(times)
        per_trial.append((drawing / batch.trials, fits / (batch.trials * len(batch.group.levels))))
    seconds: Floats = np.mean(per_trial, axis=0)
    return seconds


def _short(study: Study, batch: Batch) -> Batch:
    """A batch of as many trials as take a fifth of a second, by its first ones: a fit may take seconds."""

    def seconds(trials: int) -> float:
        began = perf_counter()
        _steps(study, replace(batch, last=batch.first + trials))
        return perf_counter() - began

    seconds(1)  # it may load compiled code
    a_trial = seconds(1)
    if a_trial < 0.1 * _PROBE and batch.trials > _FEW:  # most of that is the call
        a_trial = max(seconds(_FEW) - a_trial, 1e-9) / (_FEW - 1)
    return replace(batch, last=min(batch.last, batch.first + max(1, int(_PROBE / a_trial))))


def _steps(study: Study, batch: Batch) -> dict[str, float]:
    """Seconds of each step of computing a batch."""
    timings = tables(study, compute(study, batch))["timings"]
    return dict(zip(timings["step"], timings["seconds"], strict=True))


def _time_of_summary(study: Study, cells: Sequence[Cell]) -> float:
    """Seconds to summarise a cell, measured at the smallest number of samples."""
    smallest = min(cells, key=lambda cell: cell.samples)
    trials = study.design.trials_of(smallest.samples)
    few = min(trials, _MOST_SUMMARISED)
    batch = Batch(Group(("probe", 0), few, (smallest,)), 0, few)
    return min(_steps(study, batch)["summary"] for _ in range(_REPEATS)) * trials / few


_ROW_BYTES = 51.0
"""Typical measured size of a row of a compressed error table, whose doubles hardly compress."""
_POINT_BYTES = 25.0
_ROW_SECONDS = 1e-6
"""Typical time to write a row and to summarise it: five seconds for five million."""
_GROUP_SECONDS = 3e-4
"""Typical time to summarise one estimator in one cell, besides that of its rows."""
_START_SECONDS = 2.0
"""Typical time in which worker processes start."""
_MOST_COUNTED = 300_000
"""Number of cells that are counted one by one, in some seconds."""
_MOST_CELLS = 5000
"""Number of cells from which the calibration takes its conditions."""
_LONG = 7.0 * DAY
"""Seconds above which a plan comes with a warning."""


@dataclass(frozen=True)
class Plan:
    """The size of a study.

    Attributes:
        cells: conditions; in a random design, one per trial.
        units: pieces of work.
        trials: data sets, over all cells.
        draws: samples drawn from the generator.
        samples: samples fitted, per estimator: the draws, times the cells that share them.
        fits: data sets times estimators.
        bytes: predicted size of the tables.
        seconds: predicted time on so many workers, with compiled code ready.
    """

    cells: int
    units: int
    trials: int
    draws: int
    samples: int
    fits: int
    bytes: float
    seconds: float

    def lines(self) -> list[tuple[str, str]]:
        """Labels and values for the terminal."""
        return [
            ("cells", f"{self.cells:,}"),
            ("trials", f"{self.trials:,}"),
            ("draws", f"{self.draws:,} samples"),
            ("samples", f"{self.samples:,} for each estimator"),
            ("fits", f"{self.fits:,}"),
            ("storage", size(self.bytes)),
            ("time", f"{duration(self.seconds)} predicted"),
        ]


def plan(study: Study, jobs: int) -> Plan:
    """Count a study's work and predict its time, without running it.

    Args:
        study: the config.
        jobs: number of workers.

    Raises:
        RunError: if a grid has too many cells to be counted.
    """
    if study.cells() > _MOST_COUNTED:
        return _extrapolated(study, jobs)
    processes = jobs > 1 and takes_long(study)  # they do not wait for one interpreter, but take a while to start
    places = chain.from_iterable(group.places(0, study.trials_of(group)) for group in study.groups())
    cells = islice((cell for cell, _, _ in places), 0, None, max(1, study.cells() // _MOST_CELLS))  # evenly spread
    pace = measure(study, list(cells), 1 if processes else jobs)
    of_trial = cache(pace.of)
    units = trials = draws = samples = 0
    seconds = longest = 0.0
    for group in study.groups():
        for unit, count in study.sizes_of(group):
            for piece in shorter(study, unit):
                sizes = list(piece.group.sizes(piece.first, piece.last))
                width, levels = piece.group.width, len(piece.group.levels)
                of_piece = sum(number * of_trial(n, levels) for n, number in sizes)
                drawn = count * sum(number * n for n, number in sizes)
                seconds, longest = seconds + count * of_piece, max(longest, of_piece)
                units, draws, samples = units + count, draws + drawn, samples + width * drawn
                trials += count * width * piece.trials
    fits = trials * len(study.estimators)
    rows = study.cells() * len(study.estimators) if study.keep == "summary" else fits
    stored = min(study.keep_points, study.design.trials) * samples / study.design.trials
    space = (_ROW_BYTES + 8.0 * sum(c.kind is float for c in study.measured())) * rows + _POINT_BYTES * stored
    seconds = max((seconds + pace.summary * study.cells()) / min(jobs, units), longest)
    seconds += _ROW_SECONDS * rows + _START_SECONDS * processes
    if study.keep == "errors" and not study.design.one_trial_a_cell:
        seconds += _GROUP_SECONDS * study.cells() * len(study.estimators)
    return Plan(study.cells(), units, trials, draws, samples, fits, space, seconds)


def warning(study: Study, least: Plan, jobs: int) -> str | None:
    """Warning for a study that would take more than a week; None for another.

    Args:
        study: the config.
        least: the plan of the least work that it can take.
        jobs: number of workers.
    """
    if least.seconds <= _LONG:
        return None
    words = f"would take {duration(least.seconds)} with --jobs {jobs}, which is more than a week"
    remedy = "give fewer trials, samples or cells, or more workers (--jobs, or a cluster with --backend dask)"
    return f"{study.run_name()}: {words}; {remedy}"


def extremes(study: Study) -> dict[str, Study]:
    """Studies of the least and the most work that a config can take, by title; itself alone if its work is fixed."""
    if study.precision is None:
        return {"": study}
    first = min(study.precision.first, study.design.trials)
    least = study.model_copy(update={"design": study.design.model_copy(update={"trials": first})})
    return {f"up to the first checkpoint, {first:,} trials": least, "at most, with every cell at the cap": study}


def plans(study: Study, jobs: int) -> dict[str, Plan]:
    """The plans of the least and the most work that a config can take, by title; see `extremes`."""
    return {title: plan(part, jobs) for title, part in extremes(study).items()}


def printed(study: Study, parts: Mapping[str, Plan]) -> list[str]:
    """Lines for the terminal: the run's name, and its plans with their titles."""
    lines = [study.run_name()]
    for title, result in parts.items():
        lines += [f"  {title}"] * bool(title) + list(columns(result.lines(), indent=2))
    return lines


def _extrapolated(study: Study, jobs: int) -> Plan:
    """Plan a random design by its first trials, which are like the others; RunError for a grid."""
    if not study.design.one_trial_a_cell:
        words = f"{study.cells():,} cells are too many to plan; at most {_MOST_COUNTED:,} are counted"
        hint = "plan it with fewer values of a condition: size and time grow with their number"
        raise RunError(f"{study.run_name()}: {words}; {hint}")
    few = _MOST_COUNTED // 10
    design = study.design.model_copy(update={"trials": few})
    small, times = plan(study.model_copy(update={"design": design}), jobs), study.design.trials / few
    return Plan(*(round(value * times) if isinstance(value, int) else value * times for value in vars(small).values()))
