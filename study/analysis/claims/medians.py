"""Medians of errors with their Monte-Carlo errors: power laws, quotients, and extremes over conditions."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pandas as pd

from study.analysis.claims.claim import Number
from study.analysis.claims.error_rows import LEAST
from study.sphere.types import Floats
from study.statistics.measures import UNKNOWN, Measure, power_law, quantile


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
    found = power_law(at, np.array([m.value for m in medians]), np.array([m.error for m in medians]))
    return Number(words, found.exponent, found.error, trials)


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


class At(NamedTuple):
    """A measure in one condition of a grid: half-angle, σ/r, and the number of data sets behind it."""

    measure: Measure
    angle: float
    relative_noise: float
    trials: int

    def __str__(self) -> str:
        """The condition in words."""
        return f"φ = {self.angle:g}°, σ = {self.relative_noise:.2g} r"


def greatest(found: Iterable[At]) -> At:
    """The condition with the greatest measure."""
    return max(found, key=lambda at: at.measure.value)


def furthest_from_one(found: list[At]) -> At:
    """Of the conditions at the smallest noise, the one whose measure is furthest from 1."""
    least = min(at.relative_noise for at in found)
    return max((at for at in found if at.relative_noise == least), key=lambda at: abs(at.measure.value - 1.0))
