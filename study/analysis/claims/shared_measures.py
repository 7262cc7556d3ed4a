"""What several claims measure alike: rows of the error tables, and medians of errors, how they grow and compare.

There are two ways to count fits that are not ok. As computed (`over`, `median`): every fit counts with the error that
it has, whatever its status, as figure 2 shows them; one without a number is infinite. Failures last (`failures_last`):
a fit that is not ok is worse than any.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from study.analysis.claims.claim import Number, Verdict
from study.estimators import Status
from study.sphere.types import Bools, Floats
from study.statistics.measures import UNKNOWN, Measure, power_law, quantile

LEAST = 20
"""Data sets behind a median that may be shown."""
WHOLE = 180.0
"""Half-angle of a cap that is the whole sphere."""


def of(errors: pd.DataFrame, estimator: str) -> pd.DataFrame:
    """The rows of one estimator."""
    return errors[errors["estimator"] == estimator]


def with_all(errors: pd.DataFrame, *estimators: str) -> bool:
    """Whether the table has rows of each of these estimators."""
    return set(estimators) <= {str(name) for name in errors["estimator"].unique()}


def cells(errors: pd.DataFrame, estimator: str) -> Iterator[tuple[float, float, pd.DataFrame]]:
    """Angle, σ/r and rows of an estimator in each condition of a grid."""
    rows = of(errors, estimator)
    for _, part in rows.groupby([rows["angle"], level(rows)]):
        yield float(part["angle"].iloc[0]), float(level(part).iloc[0]), part


def level(errors: pd.DataFrame) -> "pd.Series[float]":
    """Relative noise σ/r of each row."""
    return errors["noise"] / errors["radius"]


def over(errors: pd.DataFrame, unit: str) -> "pd.Series[float]":
    """Error of each row over a column, ``radius`` or ``bound``; infinite if there is no number, or no finite bound."""
    return (errors["error"] / errors[unit]).where(np.isfinite(errors[unit]), math.inf).fillna(math.inf)


def failures_last(part: pd.DataFrame, values: "pd.Series[float]") -> Floats:
    """Values of all fits; one that is not ok counts as worse than any."""
    return np.where(part["status"] == Status.OK, values.fillna(math.inf), math.inf)


def beside(errors: pd.DataFrame, values: "pd.Series[float]") -> pd.DataFrame:
    """A row per data set, in the order of the table, and a column per estimator."""
    table = errors.assign(value=values).pivot(index=["cell", "trial"], columns="estimator", values="value")
    table.columns = [str(name) for name in table.columns]
    return table.sort_index(level="trial")


def with_trials(labels: Floats, least: int = LEAST) -> Bools:
    """Which values belong to a group, named by its label, that has enough of them."""
    _, place, count = np.unique(labels, return_inverse=True, return_counts=True)
    return np.asarray(count[place] >= least)


def vectors(rows: pd.DataFrame) -> Floats:
    """Errors of the centre (trials, d), without those that are no numbers."""
    return rows[[name for name in rows.columns if name.startswith("error_")]].dropna().to_numpy()


def median(values: "NDArray[Any] | pd.Series[float]", least: int = LEAST) -> Measure:
    """Median with its Monte-Carlo error; unknown if there are too few values."""
    return quantile(np.asarray(values, dtype=float), 0.5) if len(values) >= least else UNKNOWN


def law(words: str, x: NDArray[Any], values: NDArray[Any], groups: NDArray[Any]) -> Number:
    """Exponent of x in the power law of the groups' medians.

    It is not a number below three groups, and infinite if a median is: an error without limit falls with nothing.

    Args:
        words: what it is.
        x: the condition, of each value.
        values: may be infinite.
        groups: a label for each value; a group's x is its median.
    """
    labels = np.unique(groups)
    medians = [quantile(values[groups == label], 0.5) for label in labels]
    at = np.array([np.median(x[groups == label]) for label in labels])
    trials = min((int(np.sum(groups == label)) for label in labels), default=0)
    if any(m.value == math.inf for m in medians):
        return Number(words, math.inf, math.nan, trials)
    found = power_law(at, np.array([m.value for m in medians]), np.array([m.error for m in medians]))
    return Number(words, found.exponent, found.error, trials)


def ratio(above: Measure, below: Measure) -> Measure:
    """Quotient of two measures; the error is that of independent ones, too large where both are of the same data.

    An infinite measure over a finite one is infinite, as the median is where most fits fail. Over an infinite one
    nothing can be said.
    """
    if not (math.isfinite(below.value) and below.value > 0.0) or math.isnan(above.value):
        return UNKNOWN
    value = above.value / below.value
    if value == math.inf:
        return Measure(value, math.nan)
    return Measure(value, math.hypot(above.error, value * below.error) / below.value)


def within(number: Number, target: float, distance: float) -> bool:
    """Whether a number is within a distance of a target, two standard errors included.

    A number without an error, as a time is, is taken as it is.
    """
    error = 0.0 if math.isnan(number.error) else number.error
    return abs(number.value - target) + 2.0 * error <= distance


class At(NamedTuple):
    """A measure in one condition of a grid: half-angle, σ/r, and the data sets behind it."""

    measure: Measure
    angle: float
    noise: float
    trials: int

    def __str__(self) -> str:
        """The condition in words."""
        return f"φ = {self.angle:g}°, σ = {self.noise:.2g} r"


def greatest(found: Iterable[At]) -> At:
    """The one with the greatest measure."""
    return max(found, key=lambda at: at.measure.value)


def odd_in_quiet(found: list[At]) -> At:
    """Of those at the smallest noise, the one whose measure is furthest from 1."""
    least = min(at.noise for at in found)
    return max((at for at in found if at.noise == least), key=lambda at: abs(at.measure.value - 1.0))


def is_one(number: Number) -> bool:
    """Whether a number is 1, within .1 or three standard errors."""
    return abs(number.value - 1.0) <= max(0.1, 3.0 * number.error)


def on_par(most: Number, quiet: Number) -> Verdict:
    """Verdict on a ratio that should be 1 everywhere.

    Args:
        most: where it is greatest: at most 1.1, three standard errors allowed, and the claim holds.
        quiet: at the smallest noise: 1, and it holds in part.
    """
    if most.value - 3.0 * most.error <= 1.1:
        return Verdict.REPRODUCED
    return Verdict.PARTLY if is_one(quiet) else Verdict.NOT_REPRODUCED


def formed(numbers: Iterable[Number]) -> list[Number]:
    """Those that could be formed: for numbers that explain and are not judged, and need not exist for a verdict."""
    return [number for number in numbers if not math.isnan(number.value)]
