"""Calibration for `study plan`: seconds per trial on this machine, measured on a study's own conditions."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from study.experiment.compute_unit import TOGETHER, compute
from study.experiment.config import Study
from study.experiment.designs.cells import Batch, Cell, Unit
from study.experiment.errors import levels
from study.runs.jobs import tables
from study.sphere.types import Floats

_SIZES = 7
_MOST_PROBED = 250_000
"""Largest number of samples that is measured; beyond it, time is proportional to the number."""
_CELLS = 6
_LEVELS = 5
_REPEATS = 3
_LONG = 0.05
"""A measurement that takes longer than so many seconds is not repeated, unless it is the first."""
_MOST_SUMMARISED = 20_000
"""Largest number of trials whose summary is measured; beyond it, time is proportional to the number."""
_PER_TRIAL = ("draw", "bound")


class Kind(NamedTuple):
    """Trials of equal cost: with the same number of samples N, and of levels and cells that share each draw."""

    samples: int
    levels: int
    cells: int


@dataclass(frozen=True)
class Pace:
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

    def of(self, work: Mapping[Kind, int]) -> float:
        """Predict the seconds of some work: numbers of trials by their kind."""
        return sum(
            trials * (self._at(self.draw, kind.samples) + kind.levels * self._at(self.level, kind.samples))
            for kind, trials in work.items()
        )

    def _at(self, seconds: Floats, samples: int) -> float:
        """Interpolate linearly between the measured sizes, and in proportion beyond the last."""
        beyond = max(1.0, samples / float(self.samples[-1]))
        return float(beyond * np.interp(samples, self.samples, seconds))


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
    with ThreadPoolExecutor(jobs) as pool:  # outside the main thread: see `study.runs.workers.threads`
        found = list(pool.map(lambda _: [_timed(bare, units) for units in probes], range(jobs)))
        summary = pool.submit(_time_of_summary, study, cells).result() if study.keep == "summary" else 0.0
    draw, level = np.median(np.array(found), axis=0).T
    if study.route == "moments":  # a fit takes as long at any size, and a run makes those of all trials at once
        level = np.full(len(level), level.min())
    return Pace(sizes.astype(float), draw, level, summary)


def _probes(study: Study, cells: Sequence[Cell], size: int) -> list[Unit]:
    """Units of so many samples, of conditions far apart, each as large as a run computes at once."""
    most = max(_CELLS * _LEVELS, len(cells) // _SIZES)
    near = sorted(cells, key=lambda cell: abs(np.log(cell.samples / size)))[:most]
    chosen = [near[i] for i in np.linspace(0, len(near) - 1, min(_CELLS, len(near))).astype(int)]
    if study.design.one_trial_a_cell:
        batches = (Batch(("probe", i), 0, 1, (replace(cell, samples=size),)) for i, cell in enumerate(chosen))
        return [Unit((batch,)) for batch in batches]
    trials = min(study.design.trials_of(size), max(1, TOGETHER // size))
    units = []
    for i, cell in enumerate(chosen):
        alike = [replace(c, samples=size) for c in near if c.angle == cell.angle]
        places = [group[0] for group in levels(tuple(alike))]
        some = tuple(alike[places[k]] for k in np.linspace(0, len(places) - 1, min(_LEVELS, len(places))).astype(int))
        units.append(Unit((Batch(("probe", i), 0, trials, some),)))
    return units


def _timed(study: Study, units: list[Unit]) -> tuple[float, float]:
    """Seconds per trial, and per trial and level, averaged over units."""
    shared = {*_PER_TRIAL, "moments"} if study.route == "moments" else set(_PER_TRIAL)
    found = []
    for unit in units:
        ((batch,), best) = unit.batches, (np.inf, np.inf)
        for repeat in range(_REPEATS):
            began = perf_counter()
            timings = tables(study, unit, compute(study, unit))["timings"]
            whole = perf_counter() - began
            drawing = timings["seconds"][np.isin(timings["step"].astype(str), list(shared))].sum()
            best = min(best, (whole - drawing, drawing))
            if repeat and whole > _LONG:  # the first one may have loaded compiled code
                break
        count = len(list(levels(batch.cells)))
        found.append((best[1] / batch.trials, best[0] / (batch.trials * count)))
    draw, level = np.mean(found, axis=0)
    return float(draw), float(level)


def _time_of_summary(study: Study, cells: Sequence[Cell]) -> float:
    """Seconds to summarise a cell, measured at the smallest number of samples."""
    smallest = min(cells, key=lambda cell: cell.samples)
    trials = study.design.trials_of(smallest.samples)
    few = min(trials, _MOST_SUMMARISED)
    unit = Unit((Batch(("probe", 0), 0, few, (smallest,)),))
    best = np.inf
    for _ in range(_REPEATS):
        timings = tables(study, unit, compute(study, unit))["timings"]
        best = min(best, timings["seconds"][timings["step"] == "summary"].sum())
    return float(best) * trials / few
