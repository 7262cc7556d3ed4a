"""Theil and Sen's slope: the median of the slopes between all pairs of points, with its interval.

The numbers are those of `scipy.stats.theilslopes`. They are computed here because that library takes half a second to
load, a third of the time in which a figure is drawn.
"""

import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from study.sphere.types import Floats


class RobustSlope(NamedTuple):
    """A slope, and the ends of its interval."""

    value: float
    low: float
    high: float


def theil_sen(x: Floats, y: Floats, level: float = 0.95) -> RobustSlope:
    """Slope of y over x, with Sen's interval from the variance of Kendall's tau (Sen 1968, eq. 2.6).

    Args:
        x: first coordinates of the points (n,), n ≥ 2, all finite. Pairs with the same x count for nothing.
        y: second coordinates (n,), likewise.
        level: probability that the interval contains the slope.

    Returns:
        The slope and its interval; NaN where all x are the same.
    """
    right = x[:, np.newaxis] - x
    use = right > 0.0
    slopes = np.sort((y[:, np.newaxis] - y)[use] / right[use])
    if not len(slopes):
        return RobustSlope(math.nan, math.nan, math.nan)
    n, pairs = len(y), len(slopes)
    variance = (n * (n - 1) * (2 * n + 5) - _ties(x) - _ties(y)) / 18.0
    away = NormalDist().inv_cdf(0.5 + 0.5 * level) * math.sqrt(max(variance, 0.0))
    low = max(round(0.5 * (pairs - away)) - 1, 0)
    high = min(round(0.5 * (pairs + away)), pairs - 1)
    return RobustSlope(float(np.median(slopes)), float(slopes[low]), float(slopes[high]))


def _ties(values: Floats) -> int:
    """Part of the variance of Kendall's tau that is lost to values that occur more than once."""
    _, counts = np.unique(values, return_counts=True)
    return sum(int(k) * (int(k) - 1) * (2 * int(k) + 5) for k in counts)
