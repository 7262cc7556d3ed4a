"""One unit of work: the only code that runs in a worker. It computes rows and writes nothing."""

from collections.abc import Iterable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from study.estimators import ESTIMATORS, Fit, Samples
from study.experiment.config import Study
from study.experiment.design import Batch, Cell, Unit
from study.experiment.sampling import Workspace, draw

Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Result:
    """What a unit computes: columns of equal length for each table."""

    errors: Columns
    timings: Columns
    points: Columns


_workspace = Workspace()


class WorkError(Exception):
    """An estimator raised; the message names it and the data."""


class Clock:
    """Seconds spent in each step since the last reading, as rows of the timing table."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, int, int, int, float]] = []
        self._last = perf_counter()

    def read(self, step: str, batch: Batch, levels: int) -> None:
        """Close a step that served so many levels of a batch."""
        now = perf_counter()
        self.rows.append((step, batch.samples, batch.trials, levels, now - self._last))
        self._last = perf_counter()

    def columns(self) -> Columns:
        """The rows, summed over what only differs by time."""
        totals: dict[tuple[str, int], list[float]] = {}
        for step, samples, trials, levels, seconds in self.rows:
            entry = totals.setdefault((step, samples), [0, 0.0])
            entry[0] += trials * levels
            entry[1] += seconds
        return {
            "step": np.array([step for step, _ in totals], dtype=object),
            "samples": np.array([samples for _, samples in totals], dtype=np.int64),
            "fits": np.array([int(fits) for fits, _ in totals.values()], dtype=np.int64),
            "seconds": np.array([seconds for _, seconds in totals.values()]),
        }


def compute(study: Study, unit: Unit) -> Result:
    """Draw a unit's batches, place them on their cells' spheres, fit them, and compare with the truth."""
    clock = Clock()
    errors: list[Columns] = []
    kept: list[Columns] = []
    for batch in unit.batches:
        draws = draw(study, batch, _workspace)
        clock.read("draw", batch, 1)
        bound = draws.unit_bound()
        clock.read("bound", batch, 1)
        for cell in batch.cells:
            samples = Samples(draws.place(cell, _workspace), draws.told(cell))
            clock.read("points", batch, 1)
            samples.moments  # noqa: B018  computed here, so that no estimator is charged for what all share
            clock.read("moments", batch, 1)
            for name in study.estimators:
                fit = _fit(name, samples, cell, batch)
                errors.append(_error_columns(name, cell, batch, fit, bound))
                clock.read(name, batch, 1)
            if batch.first < study.keep_points:
                kept.append(_point_columns(cell, batch, samples.x[: study.keep_points - batch.first]))
    return Result(stack(errors), clock.columns(), stack(kept))


def _fit(name: str, samples: Samples, cell: Cell, batch: Batch) -> Fit:
    """Call an estimator; what it raises is told with the data that it raised on."""
    try:
        return ESTIMATORS[name](samples)
    except Exception as error:
        last = batch.first + batch.trials - 1
        raise WorkError(f"{name} on cell {cell.name}, trials {batch.first} to {last}: {error!r}") from error


def stack(parts: Iterable[Columns]) -> Columns:
    """Concatenate columns."""
    parts = list(parts)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} if parts else {}


def _error_columns(name: str, cell: Cell, batch: Batch, fit: Fit, bound: NDArray[np.float64]) -> Columns:
    """Rows of one estimator on one cell of a batch."""
    b, d = fit.center.shape
    vector = fit.center - np.array(cell.center)
    variances = np.einsum("bii->bi", bound)
    return {
        **_condition_columns(cell, batch, b),
        "estimator": np.full(b, name, dtype=object),
        **{f"error_{i + 1}": vector[:, i] for i in range(d)},
        "error": np.linalg.norm(vector, axis=1),
        "radius_error": fit.radius - cell.radius,
        "bound": cell.noise * np.sqrt(variances[:, :d].sum(axis=1)),
        "radius_bound": cell.noise * np.sqrt(variances[:, d]),
        "noise_variance": fit.noise_variance,
        "status": fit.status.astype(np.int8),
        "condition": fit.condition,
        "iterations": fit.iterations.astype(np.int32),
    }


def _condition_columns(cell: Cell, batch: Batch, trials: int) -> Columns:
    return {
        "cell": np.full(trials, cell.name, dtype=object),
        "trial": np.arange(batch.first, batch.first + trials),
        "samples": np.full(trials, cell.samples),
        "noise": np.full(trials, cell.noise),
        "angle": np.full(trials, cell.angle),
        "radius": np.full(trials, cell.radius),
        "center": np.full(trials, cell.distance),
    }


def _point_columns(cell: Cell, batch: Batch, x: NDArray[np.float64]) -> Columns:
    """Rows of the points of a cell's trials (b, d, n), with the truth beside them."""
    b, d, n = x.shape
    return {
        "cell": np.full(b * n, cell.name, dtype=object),
        "trial": np.repeat(np.arange(batch.first, batch.first + b), n),
        "sample": np.tile(np.arange(n), b),
        **{f"x_{i + 1}": x[:, i].flatten() for i in range(d)},
        **{f"center_{i + 1}": np.full(b * n, cell.center[i]) for i in range(d)},
        "radius": np.full(b * n, cell.radius),
    }
