"""Measures and rules that several claims share.

Rows of error tables are chosen, divided by a unit, and arranged in a column per estimator. Every fit counts with its
error as computed, whatever its status, and one without a number as infinite (`error_over`): so estimators are compared
on the same trials, where a status would select other trials for each of them. Medians have their Monte-Carlo errors, as
have the power laws, quotients and extremes that are made of them.
"""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

from study.arrays import Bools, Floats, Ints
from study.simulation.claims.claim import Number, Verdict
from study.simulation.statistics import UNKNOWN, Measure, power_law, quantile


def within(number: Number, target: float, distance: float) -> bool:
    """True if a number and two standard errors on either side lie within a distance of a target.

    A number without an error, such as a time, is taken as exact.
    """
    error = 0.0 if math.isnan(number.error) else number.error
    return abs(number.value - target) + 2.0 * error <= distance


def is_one(number: Number) -> bool:
    """True if a number is 1 within .1 or three standard errors."""
    return abs(number.value - 1.0) <= max(0.1, 3.0 * number.error)


def on_par(most: Number, least_noise: Number) -> Verdict:
    """Verdict on a ratio that should be 1 everywhere.

    Args:
        most: the greatest ratio; the claim is reproduced if it is at most 1.1, three standard errors allowed.
        least_noise: the ratio at the smallest noise; the claim is partly reproduced if it is 1.
    """
    if most.value - 3.0 * most.error <= 1.1:
        return Verdict.REPRODUCED
    return Verdict.PARTLY if is_one(least_noise) else Verdict.NOT_REPRODUCED


LEAST = 20
"""Least number of data sets behind a median that is shown."""
WHOLE = 180.0
"""Half-angle of a cap that is the whole sphere."""


def rows_of(errors: pd.DataFrame, estimator: str) -> pd.DataFrame:
    """The rows of one estimator; nothing is copied where they stand together."""
    names = errors["estimator"].astype("category").cat
    if estimator not in names.categories:
        return errors.iloc[:0]
    where = np.flatnonzero(names.codes == names.categories.get_loc(estimator))
    return errors.iloc[where[0] : where[-1] + 1] if _together(where) else errors.iloc[where]


def _together(places: Ints) -> bool:
    return len(places) > 0 and int(places[-1] - places[0]) == len(places) - 1


def has_estimators(errors: pd.DataFrame, *estimators: str) -> bool:
    """True if the table has rows of each of these estimators."""
    return all(len(rows_of(errors, name)) for name in estimators)


def cells(errors: pd.DataFrame, estimator: str) -> Iterator[tuple[float, float, pd.DataFrame]]:
    """Angle, σ/r and rows of an estimator in each condition of a grid, in the order of angle and σ/r."""
    rows = rows_of(errors, estimator)
    angle, noise = rows["angle"].to_numpy(), relative_noise(rows).to_numpy()
    changes = (angle[1:] != angle[:-1]) | (noise[1:] != noise[:-1])
    places = [0, *np.flatnonzero(changes) + 1, len(rows)] if len(rows) else []
    blocks: dict[tuple[float, float], list[pd.DataFrame]] = {}
    for start, end in pairwise(places):
        blocks.setdefault((float(angle[start]), float(noise[start])), []).append(rows.iloc[start:end])
    for (at, level), parts in sorted(blocks.items(), key=lambda block: block[0]):
        yield at, level, parts[0] if len(parts) == 1 else pd.concat(parts)


def relative_noise(errors: pd.DataFrame) -> "pd.Series[float]":
    """Relative noise σ/r of each row."""
    return errors["noise"] / errors["radius"]


def error_over(errors: pd.DataFrame, unit: str) -> "pd.Series[float]":
    """Error of each row over a column, ``radius`` or ``bound``; infinite if there is no number, or no finite bound."""
    return (errors["error"] / errors[unit]).where(np.isfinite(errors[unit]), math.inf).fillna(math.inf)


def by_estimator(errors: pd.DataFrame, values: "pd.Series[float]") -> pd.DataFrame:
    """Values as a table: a row per data set, in the order of the errors, and a column per estimator."""
    table = errors.assign(value=values).pivot(index=["cell", "trial"], columns="estimator", values="value")
    table.columns = [str(name) for name in table.columns]
    return table.sort_index(level="trial")


def in_large_groups(labels: Floats, least: int = LEAST) -> Bools:
    """True for each value whose group, named by its label, has at least this many values."""
    _, place, count = np.unique(labels, return_inverse=True, return_counts=True)
    return np.asarray(count[place] >= least)


def center_errors(rows: pd.DataFrame) -> Floats:
    """Error vectors of the centre (trials, d); rows with NaN are left out."""
    return rows[[name for name in rows.columns if name.startswith("error_")]].dropna().to_numpy()


def median(values: "Floats | pd.Series[float]", least: int = LEAST) -> Measure:
    """Median with its Monte-Carlo error; unknown below the least number of values."""
    return quantile(np.asarray(values, dtype=float), 0.5) if len(values) >= least else UNKNOWN


def exponent(words: str, x: Floats, values: Floats, groups: Floats) -> Number:
    """Exponent of x in the power law of the groups' medians.

    It is NaN with fewer than three groups, and infinite if a median is infinite.

    Args:
        words: name of the exponent.
        x: condition of each value.
        values: the values; some may be infinite.
        groups: group of each value; a group's x is its median.
    """
    labels = np.unique(groups)
    medians = [quantile(values[groups == label], 0.5) for label in labels]
    at = np.array([np.median(x[groups == label]) for label in labels])
    trials = min((int(np.sum(groups == label)) for label in labels), default=0)
    if any(m.value == math.inf for m in medians):
        return Number(words, math.inf, math.nan, trials)
    results = power_law(at, np.array([m.value for m in medians]), np.array([m.error for m in medians]))
    return Number(words, results.exponent, results.error, trials)


def ratio(above: Measure, below: Measure) -> Measure:
    """Quotient of two measures; its error is that of independent ones, too large if both are of the same data.

    An infinite measure over a finite one is infinite. The quotient is unknown if the lower measure is not finite and
    positive.
    """
    if not (math.isfinite(below.value) and below.value > 0.0) or math.isnan(above.value):
        return UNKNOWN
    value = above.value / below.value
    if value == math.inf:
        return Measure(value, math.nan)
    return Measure(value, math.hypot(above.error, value * below.error) / below.value)


class CellMeasure(NamedTuple):
    """A measure in one condition of a grid: half-angle, σ/r, and the number of data sets behind it."""

    measure: Measure
    angle: float
    relative_noise: float
    trials: int

    def __str__(self) -> str:
        """The condition in words."""
        return f"φ = {self.angle:g}°, σ = {self.relative_noise:.2g} r"


def greatest(results: Iterable[CellMeasure]) -> CellMeasure:
    """The condition with the greatest measure."""
    return max(results, key=lambda at: at.measure.value)


def furthest_from_one(results: list[CellMeasure]) -> CellMeasure:
    """Of the conditions at the smallest noise, the one whose measure is furthest from 1."""
    least = min(at.relative_noise for at in results)
    return max((at for at in results if at.relative_noise == least), key=lambda at: abs(at.measure.value - 1.0))
