"""The data set of figures 3 to 5: the kept trial that is nearest to the paper's, its fits, and how they spread.

The paper shows one arc of 100 points with noise 0.05 and says of it that the spectral radius ρ(Σ̂C⁻¹), UGDK's Leontief
condition, is 0.557238. Of the trials whose points were kept, the one with the nearest ρ is taken, for all the figures.

Lengths are in radii, and positions are measured from the true centre. The axis of the arc is the first coordinate;
errors along and across it are uncorrelated, because the arc is its own mirror image. Spreads are robust, because UGDK's
errors have neither variance nor mean.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from study.analysis.claims.ugdk import PAPER_CONDITION
from study.estimators import Status
from study.figures.inputs import NotApplicable, Tables
from study.sphere.types import Floats
from study.statistics.measures import inside, quantile, robust_sd

LEVELS = (0.68, 0.95)
_LEAST_TRIALS = 50


@dataclass(frozen=True)
class Spread:
    """Bias and spread of an estimator's centre over all trials of the cell, in radii.

    Attributes:
        bias: median error along the axis and across it.
        sd: robust standard deviation along the axis and across it.
        covered: trials whose own 95 % ellipse, this spread about the estimate, has the true centre inside.
        known: trials whose fit has a number, whatever its status; the others count as not covered.
    """

    bias: tuple[float, float]
    sd: tuple[float, float]
    covered: int
    known: int

    def distance(self, x: float, y: float) -> float:
        """Length of an error in these standard deviations."""
        return math.hypot(x / self.sd[0], y / self.sd[1])


class Circle(NamedTuple):
    """A fitted circle: its centre, measured from the true one, and radius, in true radii."""

    x: float
    y: float
    radius: float

    @property
    def off(self) -> float:
        """Distance of its centre from the true one."""
        return math.hypot(self.x, self.y)


@dataclass(frozen=True)
class DataSet:
    """The chosen trial and its cell.

    Attributes:
        run: the run's name.
        trial: the trial's number.
        trials: how many trials its cell has.
        samples: N.
        noise: σ over the radius.
        angle: φ in degrees.
        condition: ρ of this trial.
        points: x, y of the points.
        fits: each estimator's fit to them.
        errors: estimator, x, y of the fitted centres of all trials of the cell that have a number.
        spreads: of each estimator.
    """

    run: str
    trial: int
    trials: int
    samples: int
    noise: float
    angle: float
    condition: float
    points: pd.DataFrame
    fits: dict[str, Circle]
    errors: pd.DataFrame
    spreads: dict[str, Spread]

    @property
    def caption(self) -> str:
        """The conditions in words."""
        return f"$N$ = {self.samples}, $σ/r$ = {self.noise:.4g}, $φ$ = {self.angle:g}°, $ρ$ = {self.condition:.4f}"

    @property
    def stamp(self) -> str:
        """Text of the stamp: the run and its trials."""
        return f"{self.run} · trial {self.trial} of {self.trials:,}"


def choose(tables: Tables, estimators: list[str]) -> DataSet:
    """Find the trial and measure its cell.

    Args:
        tables: the run.
        estimators: the ones that the figure is about, besides UGDK.

    Raises:
        NotApplicable: if the run is not of circles on a grid, kept no points, or lacks an estimator or trials.
    """
    if tables.dimension != 2:
        raise NotApplicable(f"shows circles: needs dimension = 2 in the config, not {tables.dimension}")
    if tables.design != "grid":
        raise NotApplicable('needs many trials of one condition: kind = "grid" in the config')
    missing = [name for name in ["ugdk", *estimators] if name not in tables.estimators]
    if missing:
        raise NotApplicable(f"needs the estimator {' and '.join(dict.fromkeys(missing))}")
    if tables.points is None:
        raise NotApplicable("needs kept points: set keep_points in the config")
    errors, points = tables.errors, tables.points
    kept = errors.merge(points[["cell", "trial"]].astype({"cell": str}).drop_duplicates(), on=["cell", "trial"])
    kept = kept[(kept["estimator"] == "ugdk") & (kept["status"] == Status.OK)]
    if kept.empty:
        raise NotApplicable("UGDK has no ok fit among the trials whose points were kept")
    row = kept.iloc[int((kept["condition"] - PAPER_CONDITION).abs().to_numpy().argmin())]
    cell = errors[errors["cell"] == row["cell"]]
    trials = cell["trial"].nunique()
    if trials < _LEAST_TRIALS:
        raise NotApplicable(f"needs at least {_LEAST_TRIALS} trials of a cell to show a spread, not {trials}")
    radius = row["radius"]
    mine = points[(points["cell"] == row["cell"]) & (points["trial"] == row["trial"])]
    fits = cell[cell["trial"] == row["trial"]]
    known = cell[np.isfinite(cell["error"])]
    return DataSet(
        run=tables.name,
        trial=int(row["trial"]),
        trials=trials,
        samples=int(row["samples"]),
        noise=float(row["noise"] / radius),
        angle=float(row["angle"]),
        condition=float(row["condition"]),
        points=pd.DataFrame(
            {axis: (mine[f"x_{i}"] - mine[f"center_{i}"]) / radius for i, axis in ((1, "x"), (2, "y"))}
        ),
        fits={
            str(fit["estimator"]): Circle(
                fit["error_1"] / radius, fit["error_2"] / radius, 1.0 + fit["radius_error"] / radius
            )
            for fit in fits.to_dict("records")
        },
        errors=pd.DataFrame(
            {
                "estimator": known["estimator"].astype(str),
                "x": known["error_1"] / radius,
                "y": known["error_2"] / radius,
            }
        ),
        spreads={
            str(name): _spread((part[["error_1", "error_2"]] / radius).to_numpy())
            for name, part in known.groupby("estimator", observed=True, sort=False)
        },
    )


def _spread(errors: Floats) -> Spread:
    """Median and robust standard deviation of errors (trials, 2)."""
    along, across = errors.T
    bias = quantile(along, 0.5).value, quantile(across, 0.5).value
    sd = robust_sd(along), robust_sd(across)
    return Spread(bias, sd, int(inside(errors, np.array(sd), LEVELS[-1]).sum()), len(errors))


def reach(level: float) -> float:
    """Semi-axes, in standard deviations, of the ellipse that holds a bivariate normal with the given probability."""
    return math.sqrt(-2.0 * math.log1p(-level))
