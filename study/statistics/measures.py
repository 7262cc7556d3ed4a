"""Statistics of a sample of errors, each with its Monte-Carlo standard error (Morris, White & Crowther 2019).

Medians and quantiles are the headline, because the errors of sphere fits have heavy tails: UGDK's have no mean at any
number of samples, GDKE's no variance at n ≤ d + 2. Moments are given only where they exist (`moments_exist`).
"""

import math
from typing import NamedTuple

import numpy as np
import scipy

from study.sphere.types import Bools, Floats


class Measure(NamedTuple):
    """A number and its Monte-Carlo standard error."""

    value: float
    error: float


UNKNOWN = Measure(math.nan, math.nan)
_FURTHER = 0.005
"""Share of a sample that shows a tail which begins far out."""
_ONE_SIGMA = 0.5 * (1.0 + math.erf(math.sqrt(0.5)))  # probability below +1 sd of a Gaussian


def quantile(values: Floats, p: float) -> Measure:
    """Quantile of a sample, with an error that assumes nothing about its distribution.

    The number of values below the true quantile is binomial, so the order statistics one binomial standard deviation
    below and above enclose it with 68 % confidence; half their distance is the error.

    Args:
        values: the sample, infinities allowed.
        p: probability in (0, 1).

    Returns:
        Quantile and error; the error is infinite where the enclosing order statistics do not exist or are.
    """
    n = len(values)
    if n == 0:
        return UNKNOWN
    ordered = np.sort(values)
    spread = math.sqrt(n * p * (1.0 - p))
    low, high = n * p - spread - 0.5, n * p + spread - 0.5  # the i-th of n, from 0, has rank i + ½
    value = _order_statistic(ordered, n * p - 0.5)
    if low < 0.0 or high > n - 1.0:
        return Measure(value, math.inf)
    bottom, top = _order_statistic(ordered, low), _order_statistic(ordered, high)
    return Measure(value, 0.5 * (top - bottom) if math.isfinite(top) else math.inf)


def _order_statistic(ordered: Floats, rank: float) -> float:
    """Value at a fractional rank, counted from 0, of ordered values that may end in infinities."""
    rank = min(max(rank, 0.0), len(ordered) - 1.0)
    below = int(rank)
    share = rank - below
    if share == 0.0:
        return float(ordered[below])
    return float((1.0 - share) * ordered[below] + share * ordered[below + 1])


def robust_sd(values: Floats) -> float:
    """Half of the range from the 15.87 % to the 84.13 % quantile.

    It is one standard deviation of Gaussian errors, and exists for UGDK's, which have neither variance nor mean.
    """
    return 0.5 * (quantile(values, _ONE_SIGMA).value - quantile(values, 1.0 - _ONE_SIGMA).value)


def inside(errors: Floats, sd: Floats, level: float) -> Bools:
    """Find the error ellipsoids that contain the truth. Their centres are the estimates, their axes the coordinates'.

    Args:
        errors: of the estimates (trials, d).
        sd: their standard deviations (d,), which give all ellipsoids their size.
        level: probability that an ellipsoid contains the truth if the errors are Gaussian about 0.

    Returns:
        True for each ellipsoid that contains the truth (trials,).
    """
    return np.asarray(np.sum((errors / sd) ** 2, axis=1) <= scipy.special.chdtri(errors.shape[1], 1.0 - level))


def share(count: float, total: int) -> Measure:
    """Share of trials, with the binomial standard error of Agresti & Coull (1998), which is not 0 for none or all.

    If trials count in part, so that the count is not whole, the error is an upper bound.
    """
    if total == 0:
        return UNKNOWN
    adjusted = (count + 2.0) / (total + 4.0)
    return Measure(count / total, math.sqrt(adjusted * (1.0 - adjusted) / (total + 4.0)))


def mean(values: Floats) -> Measure:
    """Mean and its standard error."""
    n = len(values)
    return Measure(float(np.mean(values)), float(np.std(values, ddof=1)) / math.sqrt(n)) if n > 1 else UNKNOWN


def root_mean_square(values: Floats) -> Measure:
    """Root mean square, with its error by the delta method."""
    square = mean(values**2)
    if not square.value > 0.0:
        return UNKNOWN
    root = math.sqrt(square.value)
    return Measure(root, 0.5 * square.error / root)


def tail_index(values: Floats, part: float = 0.05) -> Measure:
    """Hill's estimate of α in P(X > x) ~ x^-α, from the largest values of the sample (Hill 1975).

    Args:
        values: the sample.
        part: the share of the sample that is taken for its tail.

    Returns:
        Index and standard error α/√k; unknown if fewer than ten values are in the tail.
    """
    count = int(part * len(values))
    if count < 10:
        return UNKNOWN
    ordered = np.sort(values)[-count - 1 :]
    excess = float(np.mean(np.log(ordered[1:] / ordered[0]))) if ordered[0] > 0.0 else 0.0
    return Measure(1.0 / excess, 1.0 / excess / math.sqrt(count)) if 0.0 < excess < math.inf else UNKNOWN


def moments_exist(values: Floats) -> bool:
    """True if a mean square exists as far as a sample can tell.

    The tail index of the largest 5 % is above 2 by two standard errors, and that of the largest 0.5 % is not below 2 by
    two: the geometric fit has Gaussian errors up to where a set in a thousand has its centre run away, and a tail
    of index 1 from there on (theory 0.4).
    """
    index, further = tail_index(values), tail_index(values, _FURTHER)
    return index.value - 2.0 * index.error > 2.0 and not further.value + 2.0 * further.error < 2.0


class PowerLaw(NamedTuple):
    """y = factor · x^exponent, with the exponent's standard error."""

    exponent: float
    error: float
    factor: float


def power_law(x: Floats, y: Floats, y_error: Floats) -> PowerLaw:
    """Fit a power law by least squares in the logarithms, weighted by Monte-Carlo errors.

    The exponent's error follows from the weights; it is enlarged by √(χ²/dof) if the points scatter more than that.
    """
    use = np.isfinite(y) & (y > 0.0) & np.isfinite(y_error) & (y_error > 0.0)
    if use.sum() < 3:
        return PowerLaw(math.nan, math.nan, math.nan)
    lx, ly, weight = np.log(x[use]), np.log(y[use]), (y[use] / y_error[use]) ** 2
    middle = np.average(lx, weights=weight)
    spread = float(np.sum(weight * (lx - middle) ** 2))
    exponent = float(np.sum(weight * (lx - middle) * ly)) / spread
    level = float(np.average(ly, weights=weight))
    misfit = float(np.sum(weight * (ly - level - exponent * (lx - middle)) ** 2)) / (use.sum() - 2)
    return PowerLaw(exponent, math.sqrt(max(misfit, 1.0) / spread), math.exp(level - exponent * middle))
