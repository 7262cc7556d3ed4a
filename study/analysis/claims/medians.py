"""Medians in which failures count, and what claims say of them: how they grow, how two of them compare."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from study.analysis.claims.ledger import Number
from study.analysis.measures import UNKNOWN, Measure, power_law, quantile
from study.estimators import Status

Floats = NDArray[np.float64]


def of(errors: pd.DataFrame, estimator: str) -> pd.DataFrame:
    """The rows of one estimator."""
    return errors[errors["estimator"] == estimator]


def failures_last(part: pd.DataFrame, values: "pd.Series[float]") -> Floats:
    """Values of all fits; one that is not ok counts as worse than any."""
    return np.where(part["status"] == Status.OK, values.fillna(math.inf), math.inf)


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


def formed(numbers: Iterable[Number]) -> list[Number]:
    """Those that could be formed: for numbers that explain and are not judged, and need not exist for a verdict."""
    return [number for number in numbers if not math.isnan(number.value)]
