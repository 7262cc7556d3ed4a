"""The errors of every estimator in every cell over a block of trials, and their rows in the error table."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from study.estimators import Estimates
from study.experiment.conditions import CONDITIONS, Value
from study.experiment.config import Study
from study.experiment.designs.cells import Batch, Cell, Level
from study.sphere.types import Floats

Columns = dict[str, NDArray[Any]]
"""Columns of a table by name."""


class Truth(NamedTuple):
    """A sphere that fits are compared with, in the unit of the fits."""

    center: tuple[float, ...]
    radius: float


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
        truths: Sequence[Truth],
    ) -> "Errors":
        """Compare fits with the truth.

        Args:
            study: the config, of which the estimators and the stored conditions count.
            batches: consecutive trials of the same cells.
            bound: the Cramér-Rao bound at σ = 1 of each trial's directions (T, d+1, d+1).
            fits: of all trials. Levels may have been fitted together: for each such group of levels there is a fit per
                estimator, of each trial's levels one after the other.
            truths: of the levels, in the order of `levels`.
        """
        cells = batches[0].cells
        places = list(levels(cells))
        level = np.empty(len(cells), dtype=np.intp)
        for index, some in enumerate(places):
            level[some] = index
        scale = np.array([cell.scale for cell in cells])[:, None, None]
        true_center = np.array([truth.center for truth in truths])[:, None, None]
        true_radius = np.array([truth.radius for truth in truths])[:, None, None]

        def found(name: str, kind: type = float) -> NDArray[Any]:
            groups = []
            for some in fits:
                # np.stack and np.moveaxis would take three times as long, and a tenth of a unit of few samples
                values: NDArray[Any] = np.array([getattr(fit, name) for fit in some], dtype=kind)
                by_level = values.reshape(len(some), len(bound), -1, *values.shape[2:])
                groups.append(by_level.swapaxes(1, 2).swapaxes(0, 1))
            return np.asarray(np.concatenate(groups)[level])

        return cls(
            cells=cells,
            estimators=study.estimators,
            conditions=tuple(condition.name for condition in study.conditions()),
            first=batches[0].first,
            blocks=tuple(batch.trials for batch in batches),
            bound=bound,
            center=(found("center") - true_center[level]) * scale[..., None],
            radius=(found("radius") - true_radius[level]) * scale,
            noise_variance=found("noise_variance") * scale**2,
            status=found("status", np.int8),
            condition=found("condition"),
            iterations=found("iterations", np.int32),
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
        of_cells = [each.values for each in self.cells]
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
    values = [each[name] for each in of_cells]
    return np.array(values, dtype=object) if CONDITIONS[name].kind is str else np.array(values)


def levels(cells: tuple[Cell, ...]) -> Iterator[list[int]]:
    """The places of the cells of each level, in the order in which levels first come."""
    places: dict[Level, list[int]] = {}
    for place, cell in enumerate(cells):
        places.setdefault(cell.level, []).append(place)
    yield from places.values()
