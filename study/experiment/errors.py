"""What came of a block of trials: the errors of every estimator in every cell, and their rows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from study.estimators import Fit
from study.experiment.design import Cell
from study.sphere.types import Floats

Columns = dict[str, NDArray[Any]]


class Truth(NamedTuple):
    """A sphere that fits are compared with, in the unit in which they were made."""

    center: tuple[float, ...]
    radius: float


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
    def of(
        cls, cells: tuple[Cell, ...], estimators: tuple[str, ...], first: int, blocks: tuple[int, ...], bound: Floats,
        fits: Sequence[Sequence[Fit]], truths: Sequence[Truth],
    ) -> "Errors":  # fmt: skip
        """From the ``fits`` of all trials, and the ``truths`` of their levels, as `levels` has these.

        Levels may have been fitted together: for each such group there is a fit per estimator, of each trial's levels
        one after the other. The other arguments are those of the class.
        """
        places = list(levels(cells))
        level = np.empty(len(cells), dtype=np.intp)
        for index, some in enumerate(places):
            level[some] = index
        scale = np.array([cell.scale for cell in cells])[:, None, None]
        true_center = np.array([truth.center for truth in truths])[:, None, None]
        true_radius = np.array([truth.radius for truth in truths])[:, None, None]

        def found(name: str) -> NDArray[Any]:
            groups = []
            for some in fits:
                values = np.stack([getattr(fit, name) for fit in some])
                by_level = values.reshape(len(some), len(bound), -1, *values.shape[2:])
                groups.append(np.moveaxis(by_level, 2, 0))
            return np.concatenate(groups)

        return cls(
            cells, estimators, first, blocks, bound,
            center=(found("center") - true_center)[level] * scale[..., None],
            radius=(found("radius") - true_radius)[level] * scale,
            noise_variance=found("noise_variance")[level] * scale**2,
            status=found("status").astype(np.int8)[level], condition=found("condition")[level],
            iterations=found("iterations").astype(np.int32)[level],
        )  # fmt: skip

    @classmethod
    def joined(cls, blocks: Sequence["Errors"]) -> "Errors":
        """Blocks of consecutive trials of the same cells as one."""
        if len(blocks) == 1:
            return blocks[0]
        of_fits: dict[str, Any] = {
            name: np.concatenate([getattr(b, name) for b in blocks], axis=2) for name in Fit._fields
        }
        sizes = tuple(size for b in blocks for size in b.blocks)
        return replace(blocks[0], blocks=sizes, bound=np.concatenate([b.bound for b in blocks]), **of_fits)

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
