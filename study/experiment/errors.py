"""What came of a block of trials: the errors of every estimator in every cell, and their rows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from study.estimators import Fit
from study.experiment.design import Cell

Columns = dict[str, NDArray[Any]]
Floats = NDArray[np.float64]


_OF_FITS = ("center", "radius", "noise_variance", "status", "condition", "iterations")


@dataclass(frozen=True)
class Errors:
    """Errors of E estimators on T trials of each of C cells, which share their draws.

    Attributes:
        cells: the conditions.
        estimators: the names.
        first: number of the first trial.
        blocks: numbers of trials, which add up to T: rows of the table come block by block.
        bound: the Cramér-Rao bound at σ = 1 of each trial's directions (T, d+1, d+1).
        center: estimated minus true centre (C, E, T, d), in the unit of the cells.
        radius: estimated minus true radius (C, E, T).
        noise_variance: as the fit has it (C, E, T); so are ``status``, ``condition`` and ``iterations``.
    """

    cells: tuple[Cell, ...]
    estimators: tuple[str, ...]
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
    def blank(
        cls, cells: tuple[Cell, ...], estimators: tuple[str, ...], first: int, blocks: tuple[int, ...], bound: Floats
    ) -> "Errors":
        """To be filled by `record`."""
        shape, d = (len(cells), len(estimators), len(bound)), bound.shape[1] - 1
        return cls(
            cells, estimators, first, blocks, bound,
            center=np.empty((*shape, d)), radius=np.empty(shape), noise_variance=np.empty(shape),
            status=np.empty(shape, dtype=np.int8), condition=np.empty(shape),
            iterations=np.empty(shape, dtype=np.int32),
        )  # fmt: skip

    @classmethod
    def joined(cls, blocks: Sequence["Errors"]) -> "Errors":
        """Blocks of consecutive trials of the same cells as one."""
        if len(blocks) == 1:
            return blocks[0]
        of_fits: dict[str, Any] = {
            name: np.concatenate([getattr(b, name) for b in blocks], axis=2) for name in _OF_FITS
        }
        sizes = tuple(size for b in blocks for size in b.blocks)
        return replace(blocks[0], blocks=sizes, bound=np.concatenate([b.bound for b in blocks]), **of_fits)

    def record(self, cells: Sequence[int], estimator: int, fit: Fit, center: Floats, radius: float) -> None:
        """Store the fits of one level's trials for the cells of that level, which differ by their scale alone.

        ``center`` and ``radius`` are the truth in the unit of the fits.
        """
        away, larger = fit.center - center, fit.radius - radius
        for index in cells:
            place, scale = (index, estimator), self.cells[index].scale
            self.center[place], self.radius[place] = away * scale, larger * scale
            self.noise_variance[place] = fit.noise_variance * scale**2
            self.status[place], self.condition[place] = fit.status, fit.condition
            self.iterations[place] = fit.iterations

    @property
    def noise(self) -> Floats:
        """σ of each cell (C,)."""
        return np.array([cell.noise for cell in self.cells])

    @property
    def distance(self) -> Floats:
        """Distance from the estimated to the true centre (C, E, T)."""
        return np.asarray(np.linalg.norm(self.center, axis=3))

    @property
    def center_bound(self) -> Floats:
        """√tr CRLB of the centre (C, T)."""
        return np.asarray(self.noise[:, None] * np.sqrt(np.einsum("tii->ti", self.bound)[:, :-1].sum(axis=1)))

    @property
    def radius_bound(self) -> Floats:
        """√CRLB of the radius (C, T)."""
        return np.asarray(self.noise[:, None] * np.sqrt(self.bound[:, -1, -1]))

    def columns(self) -> Columns:
        """Rows of the error table: block by block, cell by cell, estimator by estimator, trial by trial."""
        c, e, t = self.radius.shape
        places, ends = np.arange(c * e * t).reshape(c, e, t), np.cumsum(self.blocks)[:-1]
        place = np.concatenate([part.ravel() for part in np.split(places, ends, axis=2)])
        cell, estimator, trial = np.unravel_index(place, (c, e, t))
        conditions = {
            "samples": np.array([cell.samples for cell in self.cells]),
            "noise": self.noise,
            "angle": np.array([cell.angle for cell in self.cells]),
            "radius": np.array([cell.radius for cell in self.cells]),
            "center": np.array([cell.distance for cell in self.cells]),
        }
        error = self.center.reshape(c * e * t, self.center.shape[3])[place]
        return {
            "cell": np.array([cell.name for cell in self.cells], dtype=object)[cell],
            "trial": self.first + trial,
            **{name: values[cell] for name, values in conditions.items()},
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


def levels(cells: tuple[Cell, ...]) -> Iterator[list[int]]:
    """The places of the cells of each level, in the order in which levels first come."""
    places: dict[Any, list[int]] = {}
    for place, cell in enumerate(cells):
        places.setdefault(cell.level, []).append(place)
    yield from places.values()
