"""What a study will cost, told before it runs: counts, bytes, and seconds from a short calibration."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from study.experiment.config import Study
from study.experiment.design import Batch, Cell, Unit, units
from study.experiment.work import compute

_ROW_BYTES = 75.0
"""Measured size of a row of a compressed error table, by and large (doubles of noise do not compress)."""
_POINT_BYTES = 26.0
_PROBES = 8
_MOST_PROBED = 200_000
_EFFICIENCY = 0.5
"""What a second worker adds: threads share the interpreter. Measured 0.15 (small batches) to 0.8 (large ones)."""


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
        seconds: predicted time on the workers asked for, compiled code ready.
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
        """Labels and values, for a reader."""
        return [
            ("cells", f"{self.cells:,}"),
            ("trials", f"{self.trials:,}"),
            ("draws", f"{self.draws:,} samples"),
            ("samples", f"{self.samples:,} for each estimator"),
            ("fits", f"{self.fits:,}"),
            ("storage", f"{self.bytes / 1e6:,.1f} MB"),
            ("time", f"{self.seconds:,.1f} s predicted"),
        ]


def plan(study: Study, jobs: int) -> Plan:
    """Count a study's work and predict its time, without running it."""
    cells: dict[int, Cell] = {}
    n_units = trials = draws = samples = batches = calls = 0
    for unit in units(study):
        n_units += 1
        for batch in unit.batches:
            size = batch.trials * batch.samples
            batches, calls = batches + 1, calls + len(batch.cells)
            trials += batch.trials * len(batch.cells)
            draws += size
            samples += size * len(batch.cells)
            cells.setdefault(hash(batch.cells), batch.cells[len(batch.cells) // 2])
    kept = min(study.keep_points, study.design.trials) * samples / study.design.trials
    fits = trials * len(study.estimators)
    chosen = list(cells.values())
    probes = [chosen[i] for i in np.linspace(0, len(chosen) - 1, min(_PROBES, len(chosen))).astype(int)]
    with ThreadPoolExecutor(1) as pool:  # not the main thread: see `study.runs.runner`
        costs = pool.submit(_calibrate, study, probes).result()
    per_draw, per_sample, per_batch, per_call, per_trial = costs
    seconds = per_draw * draws + per_sample * samples + per_batch * batches + per_call * calls + per_trial * trials
    workers = 1.0 + _EFFICIENCY * (min(jobs, n_units) - 1)
    return Plan(
        cells=study.cells(),
        units=n_units,
        trials=trials,
        draws=draws,
        samples=samples,
        fits=fits,
        bytes=_ROW_BYTES * fits + _POINT_BYTES * kept,
        seconds=float(seconds / workers),
    )


_DRAW_STEPS = ("draw", "bound")


def _calibrate(study: Study, probes: list[Cell]) -> tuple[float, float, float, float, float]:
    """Seconds per sample drawn, per sample fitted, per batch, per cell of a batch, and per trial.

    The study's own conditions are run at three sizes - one trial of few samples, many of them, one of many samples -
    which separates what costs per call, per trial and per sample.
    """
    large = max(2000, min(_MOST_PROBED, max(cell.samples for cell in probes)))
    small = max(12, study.dimension + 1)
    sizes = [(small, 1), (small, 200), (large, 1)]
    drawing, fitting = np.zeros(len(sizes)), np.zeros(len(sizes))
    for index, (count, trials) in enumerate(sizes):
        batches = tuple(
            Batch(("probe", i), 0, trials, (replace(cell, samples=count),)) for i, cell in enumerate(probes)
        )
        seconds = []
        for _ in range(3):
            timings = compute(study.model_copy(update={"keep_points": 0}), Unit(batches)).timings
            draw = np.isin(timings["step"].astype(str), _DRAW_STEPS)
            seconds.append((timings["seconds"][draw].sum(), timings["seconds"][~draw].sum()))
        drawing[index], fitting[index] = np.median(seconds, axis=0) / len(probes)
    # call + trials (per trial + samples × per sample), solved for the three costs
    matrix = np.array([[1.0, trials, trials * count] for count, trials in sizes])
    batch, draw_trial, per_draw = np.maximum(np.linalg.solve(matrix, drawing), 0.0)
    call, trial, per_sample = np.maximum(np.linalg.solve(matrix, fitting), 0.0)
    return per_draw, per_sample, batch, call, trial + draw_trial
