"""Errors of the estimators in any condition, without a run: an emulator over a table of cells that comes along.

Each cell of the table is what a study of its conditions gives: the summary's ``ratio_median`` of many trials, with its
Monte-Carlo error. For each estimator the logarithm of it is taken for a Gaussian process over the conditions, whose
covariance is Matérn's with ν = 5/2 (Rasmussen & Williams 2006: eq. 4.17, predictions by 2.25 and 2.26). Features of the
conditions are logarithms, and what has a bend where bias exceeds scatter.

An interval is the standard deviation of the process times a factor for each estimator: 95 % of the cells that were
drawn evenly lie within it when they are left out, with their Monte-Carlo errors (conformal prediction, normalised:
Papadopoulos, Vovk & Gammerman 2011). `benchmarks/ask.py` makes the table, and stores how good it is.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import pyarrow.parquet as pq
import scipy
from numpy.typing import ArrayLike

from study.arrays import Floats
from study.fits.errors.attainable import one_number
from study.simulation.analysis.theory import median_attainable
from study.simulation.experiment.conditions import ANGLE, NOISE_OVER_RADIUS, SAMPLES
from study.text import columns

TABLE = Path(__file__).with_suffix(".parquet")
METADATA = b"study.ask"
"""Key of the table's metadata: where it is from, its range, and the parameters of each process."""
ASKED = (SAMPLES, NOISE_OVER_RADIUS, ANGLE)
"""The conditions, in the order in which functions take them."""
LEVEL = 0.95
"""Share of the intervals that hold the median of a run."""
DIMENSION = 3
NEAREST = 300
"""Cells that a prediction of one place uses. Beside all of them, it differs by less than a tenth of the interval in
150 places drawn at random for each estimator, and takes a hundredth of the time."""


def features(conditions: ArrayLike) -> Floats:
    """Features of conditions, over which the logarithms of the errors are smooth.

    Args:
        conditions: N, σ/r, and φ in degrees (n, 3).

    Returns:
        Nine numbers of each (n, 9).
    """
    samples, noise, angle = np.asarray(conditions, dtype=float).T
    height, mean = 2.0 * np.sin(0.5 * np.radians(angle)) ** 2, np.cos(0.5 * np.radians(angle)) ** 2  # of a cap's points
    n, s, v = np.log(samples), np.log(noise), np.log(height)
    flat = [n, s, v, s - v, s - v - 0.5 * n, s - v + 0.5 * n, mean, noise]
    return np.stack([*flat, 0.5 * np.log1p(samples * (noise * mean) ** 2)], axis=1)


def correlation(one: Floats, other: Floats) -> Floats:
    """Matérn's correlation, ν = 5/2, of places (n, k) and (m, k) in units of the lengths: (n, m)."""
    distance = math.sqrt(5.0) * scipy.spatial.distance.cdist(one, other)
    return np.asarray((1.0 + distance + distance**2 / 3.0) * np.exp(-distance))


@dataclass(frozen=True)
class Process:
    """The Gaussian process of one estimator.

    Attributes:
        lengths: of the features (k,).
        variance: of the process.
        roughness: variance that belongs to each cell alone.
        places: features of the cells (m, k).
        values: logarithms of their medians (m,).
        noise: variances of their Monte-Carlo errors (m,).
        factor: of the intervals.
    """

    lengths: Floats
    variance: float
    roughness: float
    places: Floats
    values: Floats
    noise: Floats
    factor: float

    @cached_property
    def root(self) -> Floats:
        """Cholesky's factor of the covariance of the values (m, m)."""
        scaled = self.places / self.lengths
        whole = self.variance * correlation(scaled, scaled) + np.diag(self.noise + self.roughness)
        return np.asarray(np.linalg.cholesky(whole))

    @cached_property
    def weights(self) -> Floats:
        """Inverse covariance times the values' deviations from their mean (m,)."""
        return np.asarray(scipy.linalg.cho_solve((self.root, True), self.values - self.values.mean()))

    def near(self, place: Floats) -> "Process":
        """The process given the cells nearest to a place (k,) alone, by whose distances their weights fall."""
        squares = np.sum(((self.places - place) / self.lengths) ** 2, axis=1)
        cells = np.argsort(squares, kind="stable")[:NEAREST]
        return replace(self, places=self.places[cells], values=self.values[cells], noise=self.noise[cells])

    def predict(self, places: Floats) -> tuple[Floats, Floats]:
        """Logarithm of the median, and half of its interval (n,), at features (n, k)."""
        near = correlation(places / self.lengths, self.places / self.lengths)
        known = scipy.linalg.solve_triangular(self.root, self.variance * near.T, lower=True)
        variance = np.maximum(self.variance - np.sum(known**2, axis=0), 0.0) + self.roughness
        value = self.values.mean() + self.variance * near @ self.weights
        return value, self.factor * np.sqrt(variance)


Conditions = tuple[float, float, float]
"""N, σ/r and φ in degrees."""
Origin = Mapping[str, str | int]
"""Version of the package that made the table, its seed, its cells, those drawn evenly, and the trials of each."""


class Prediction(NamedTuple):
    """The median error of an estimator over the bound, and its interval."""

    estimator: str
    ratio_median: float
    low: float
    high: float


@dataclass(frozen=True)
class Emulator:
    """The table, and a process for each of its estimators.

    Attributes:
        origin: where the table is from.
        ranges: least and largest value of each condition, by name.
        conditions: of the cells (m, 3).
        processes: by estimator.
    """

    origin: Origin
    ranges: Mapping[str, tuple[float, float]]
    conditions: Floats
    processes: Mapping[str, Process]

    @classmethod
    @lru_cache(maxsize=1)
    def load(cls, path: Path = TABLE) -> Self:
        """Read the table, once in a program."""
        table = pq.read_table(path)
        stored = json.loads(table.schema.metadata[METADATA])
        conditions = np.stack([table[condition.name].to_numpy() for condition in ASKED], axis=1)
        places, processes = features(conditions), {}
        for name, found in stored["processes"].items():
            median, error = (table[f"{name}{ending}"].to_numpy().astype(float) for ending in ("", "_error"))
            of_cells = {"places": places, "values": np.log(median), "noise": (error / median) ** 2}
            processes[name] = Process(**found | {"lengths": np.array(found["lengths"])}, **of_cells)
        return cls(stored["origin"], stored["ranges"], conditions, processes)

    def check(self, conditions: Conditions, dimension: int = DIMENSION) -> None:
        """Raise ValueError if conditions lie beyond the table, or the points are not in three dimensions."""
        if dimension != DIMENSION:
            raise ValueError(f"dimension {dimension}: the table is of spheres in {DIMENSION}; run a study instead")
        for condition, value in zip(ASKED, conditions, strict=True):
            low, high = self.ranges[condition.name]
            if not low <= one_number(condition.name, value) <= high:
                words = f"the table reaches from {low:g} to {high:g}; run a study instead"
                raise ValueError(f"{condition.name} {value:g}: {words}")

    def ask(self, conditions: Conditions, dimension: int = DIMENSION) -> list[Prediction]:
        """Median errors of all estimators over the bound, from the least to the largest.

        Args:
            conditions: N, σ/r, and φ in degrees.
            dimension: of the points.

        Raises:
            ValueError: if the table does not reach so far.
        """
        self.check(conditions, dimension)
        place, answers = features([conditions]), []
        for name, process in self.processes.items():
            (value,), (half,) = process.near(place).predict(place)
            answers.append(Prediction(name, *(math.exp(value + step) for step in (0.0, -half, half))))
        return sorted(answers, key=lambda answer: answer.ratio_median)


def ask(samples: int, noise_over_radius: float, angle: float) -> list[Prediction]:
    """Predict each estimator's error in one condition without a run, as `study ask` does.

    Args:
        samples: number of samples N.
        noise_over_radius: standard deviation of a coordinate over the radius, σ/r.
        angle: half-angle of the cap that the directions are confined to, in degrees.

    Returns:
        For each estimator its median error of the centre over the Cramér-Rao bound, of all trials, and the interval
        that holds it in 95 % of conditions; the best first.

    Raises:
        ValueError: if the table that comes along does not reach so far.

    Examples:
        >>> import study
        >>> best = study.ask(50, 0.1, 40)[0]
        >>> print(f"{best.estimator}: {best.ratio_median:.2f}, from {best.low:.2f} to {best.high:.2f}")
        corrected: 0.78, from 0.77 to 0.79
    """
    return Emulator.load().ask((samples, noise_over_radius, angle))


def efficient(angle: float) -> float:
    """Median error over the bound of an estimator that is at the bound, which is attainable without noise."""
    return median_attainable(angle, 0.0, DIMENSION)


def as_data(conditions: Conditions, answers: list[Prediction], origin: Origin) -> dict[str, object]:
    """The answers for JSON."""
    asked = {condition.name: value for condition, value in zip(ASKED, conditions, strict=True)}
    rows = [answer._asdict() for answer in answers]
    return asked | {"level": LEVEL, "at_bound": efficient(conditions[2]), "answers": rows, "made_by": origin}


def printed(conditions: Conditions, answers: list[Prediction], origin: Origin) -> Iterator[str]:
    """The answers for a terminal."""
    asked = (f"{c.symbol} = {c.written(value)}" for c, value in zip(ASKED, conditions, strict=True))
    yield f"{', '.join(asked)}: median error of the centre over the bound"
    rows = [[name, *(f"{number:#.3g}" for number in numbers)] for name, *numbers in answers]
    rows.append(["at the bound", f"{efficient(conditions[2]):#.3g}", "", ""])
    yield from columns(rows, ["", "median", "95 % from", "to"], "<>")
    yield "from {cells:,} cells of {trials:,} trials, seed {seed}, version {version}".format(**origin)
