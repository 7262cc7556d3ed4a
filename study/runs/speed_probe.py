"""How fast this machine computes a study's trials: a short calibration on the study's own conditions."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from study.experiment.compute_unit import TOGETHER, Reduce, compute
from study.experiment.config import Study
from study.experiment.designs.cells import Batch, Cell, Unit
from study.experiment.errors import levels
from study.sphere.types import Floats

_SIZES = 7
_MOST_PROBED = 250_000
"""Samples: beyond, a trial costs in proportion."""
_CELLS = 6
_LEVELS = 5
_REPEATS = 3
_PER_TRIAL = ("draw", "bound")


@dataclass(frozen=True)
class Pace:
    """Seconds of one of the workers while all are at work, at some numbers of samples (k,), ascending.

    Attributes:
        samples: the numbers of samples.
        draw: seconds to draw a trial (k,), with all that its levels share.
        level: seconds to fit a trial with all estimators at one level of noise and radius (k,).
        summary: seconds to summarise a cell for all estimators, where no errors are kept.
    """

    samples: Floats
    draw: Floats
    level: Floats
    summary: float

    def seconds(self, samples: int, trials: int, count: int) -> float:
        """Predicted time of trials of so many samples at so many levels."""
        return trials * (self._at(self.draw, samples) + count * self._at(self.level, samples))

    def _at(self, seconds: Floats, samples: int) -> float:
        """Between the measured sizes linear in the number of samples, beyond the last in proportion."""
        beyond = max(1.0, samples / float(self.samples[-1]))
        return float(beyond * np.interp(samples, self.samples, seconds))


def measure(study: Study, cells: Sequence[Cell], jobs: int, reduce: Reduce | None = None) -> Pace:
    """Run a few trials of each of several sizes, on all workers at once: they share memory and interpreter.

    Args:
        study: the config.
        cells: conditions of it, of all kinds.
        jobs: number of workers.
        reduce: makes the rows of a summary, of a study that keeps nothing else.
    """
    bare = study.model_copy(update={"keep_points": 0, "keep": "errors"})
    sizes = np.unique([min(cell.samples, _MOST_PROBED) for cell in cells])
    if len(sizes) > _SIZES:
        wanted = np.geomspace(sizes[0], sizes[-1], _SIZES)
        sizes = np.unique([sizes[np.abs(np.log(sizes / size)).argmin()] for size in wanted])
    probes = [_probes(study, cells, int(size)) for size in sizes]
    jobs = min(jobs, os.cpu_count() or 1)
    with ThreadPoolExecutor(jobs) as pool:  # not the main thread: see `study.runs.runner`
        found = list(pool.map(lambda _: [_timed(bare, units) for units in probes], range(jobs)))
        summary = pool.submit(_summarised, study, cells, reduce).result() if reduce and study.keep == "summary" else 0.0
    draw, level = np.median(np.array(found), axis=0).T
    if study.route == "moments":  # a fit takes as long at any size, and a run makes those of all trials at once
        level = np.full(len(level), level.min())
    return Pace(sizes.astype(float), draw, level, summary)


def _probes(study: Study, cells: Sequence[Cell], size: int) -> list[Unit]:
    """Units of so many samples, of conditions far apart, as large as those that a run draws together."""
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
        for _ in range(_REPEATS):
            began = perf_counter()
            timings = compute(study, unit).timings
            whole = perf_counter() - began
            drawing = timings["seconds"][np.isin(timings["step"].astype(str), list(shared))].sum()
            best = min(best, (whole - drawing, drawing))
        count = len(list(levels(batch.cells)))
        found.append((best[1] / batch.trials, best[0] / (batch.trials * count)))
    draw, level = np.mean(found, axis=0)
    return float(draw), float(level)


def _summarised(study: Study, cells: Sequence[Cell], reduce: Reduce) -> float:
    """Seconds to summarise a cell, measured where drawing and fitting take least."""
    smallest = min(cells, key=lambda cell: cell.samples)
    unit = Unit((Batch(("probe", 0), 0, study.design.trials_of(smallest.samples), (smallest,)),))
    best = np.inf
    for _ in range(_REPEATS):
        timings = compute(study, unit, reduce).timings
        best = min(best, timings["seconds"][timings["step"] == "summary"].sum())
    return float(best)
