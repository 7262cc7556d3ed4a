"""Statistics of a sample of errors, each with its Monte-Carlo standard error (Morris, White & Crowther 2019).

Medians and quantiles are the headline, because the errors of sphere fits have heavy tails: UGDK's have no mean at any
number of samples, GDKE's no variance at n ≤ d + 2. Moments are given only where they exist (`moments_exist`).

Performance measures have names (`PERFORMANCE`). They are those of Morris, White & Crowther as far as they exist for
errors with heavy tails. A quantile, and the share of outliers, comes three times:

- ``ratio_median`` is of all fits as computed, whatever their status; one without a number counts as infinite. It is of
  the same trials for all estimators, so they are compared by it.
- ``ratio_median_ok`` is of the estimator's own ok fits. These are other trials for each estimator, and often the easier
  ones, so it compares nothing.
- ``ratio_median_all`` is of all fits, with those that are not ok counted as infinite.

The summary table has a row for each group of fits and estimator, with counts of each status and all measures. A group
is a cell, or, in a random design, a decade of σ/r. Failures count: no planned fit is left out of a measure of all fits.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import scipy

from study.arrays import Bools, Floats
from study.fits import Status
from study.simulation.experiment.compute import Columns, Errors
from study.simulation.experiment.conditions import STORED
from study.simulation.experiment.measures import MeasureColumn


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
    return _quantile_of_ordered(np.sort(values), p)


def _quantile_of_ordered(ordered: Floats, p: float) -> Measure:
    n = len(ordered)
    if n == 0:
        return UNKNOWN
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


def tail_index(ordered: Floats, part: float = 0.05) -> Measure:
    """Hill's estimate of α in P(X > x) ~ x^-α, from the largest values of the sample (Hill 1975).

    Args:
        ordered: the sample, in ascending order.
        part: the share of the sample that is taken for its tail.

    Returns:
        Index and standard error α/√k; unknown if fewer than ten values are in the tail.
    """
    count = int(part * len(ordered))
    if count < 10:
        return UNKNOWN
    last = ordered[-count - 1 :]
    excess = float(np.mean(np.log(last[1:] / last[0]))) if last[0] > 0.0 else 0.0
    return Measure(1.0 / excess, 1.0 / excess / math.sqrt(count)) if 0.0 < excess < math.inf else UNKNOWN


def moments_exist(values: Floats) -> bool:
    """True if a mean square exists as far as a sample can tell.

    The tail index of the largest 5 % is above 2 by two standard errors, and that of the largest 0.5 % is not below 2 by
    two: the geometric fit has Gaussian errors up to where a set in a thousand has its centre run away, and a tail
    of index 1 from there on (theory 0.4).
    """
    return _moments_exist(np.sort(values))


def _moments_exist(ordered: Floats) -> bool:
    index, further = tail_index(ordered), tail_index(ordered, _FURTHER)
    return index.value - 2.0 * index.error > 2.0 and not further.value + 2.0 * further.error < 2.0


def power_law(x: Floats, y: Floats, y_error: Floats) -> tuple[Measure, float]:
    """Fit y = factor · x^exponent by least squares in the logarithms, weighted by Monte-Carlo errors.

    Returns:
        The exponent with its error, and the factor. The error follows from the weights; it is enlarged by √(χ²/dof) if
        the points scatter more than that.
    """
    use = np.isfinite(y) & (y > 0.0) & np.isfinite(y_error) & (y_error > 0.0)
    if use.sum() < 3:
        return UNKNOWN, math.nan
    lx, ly, weight = np.log(x[use]), np.log(y[use]), (y[use] / y_error[use]) ** 2
    middle = np.average(lx, weights=weight)
    spread = float(np.sum(weight * (lx - middle) ** 2))
    exponent = float(np.sum(weight * (lx - middle) * ly)) / spread
    level = float(np.average(ly, weights=weight))
    misfit = float(np.sum(weight * (ly - level - exponent * (lx - middle)) ** 2)) / (use.sum() - 2)
    return Measure(exponent, math.sqrt(max(misfit, 1.0) / spread)), math.exp(level - exponent * middle)


FAR = 10.0
"""Error over √tr CRLB beyond which a fit is an outlier."""


@dataclass(frozen=True)
class Fits:
    """Fits of one estimator.

    Args:
        columns: error, error_1, bound, radius and status, as the error table has them (n,).
    """

    columns: Columns

    @cached_property
    def ok(self) -> Bools:
        """True for fits whose status is ok (n,)."""
        return np.asarray(self.columns["status"] == Status.OK)

    @cached_property
    def relative(self) -> Floats:
        """Error over radius (n,)."""
        with np.errstate(all="ignore"):
            return np.asarray(self.columns["error"] / self.columns["radius"])

    @cached_property
    def ratio(self) -> Floats:
        """Error over bound (n,); infinite where the directions do not determine the centre and there is no bound."""
        bound = self.columns["bound"]
        with np.errstate(all="ignore"):
            return np.where(np.isfinite(bound), self.columns["error"] / bound, np.inf)

    @cached_property
    def axis(self) -> Floats:
        """Error along the cap's axis over bound (n,); infinite where there is no bound."""
        bound = self.columns["bound"]
        with np.errstate(all="ignore"):
            return np.where(np.isfinite(bound), self.columns["error_1"] / bound, np.inf)

    def ordered(self, name: str, which: str) -> Floats:
        """Ordered values of relative, ratio or axis, each sorted once.

        They are of all fits as computed, of the ok ones (``_ok``), or with those that are not as infinite (``_all``).
        """
        if (name, which) not in self._ordered:
            values: Floats = getattr(self, name)
            if which == "_ok":
                chosen = values[self.ok]
            else:
                chosen = np.where(self.ok if which == "_all" else ~np.isnan(values), values, np.inf)
            self._ordered[name, which] = np.sort(chosen)
        return self._ordered[name, which]

    @cached_property
    def _ordered(self) -> dict[tuple[str, str], Floats]:
        return {}

    @cached_property
    def tail(self) -> Measure:
        """Tail index of error over bound, of the fits that are ok."""
        return tail_index(self.ordered("ratio", "_ok"))

    @cached_property
    def moments_exist(self) -> bool:
        """True if the mean square of error over bound exists, as far as the fits that are ok can tell."""
        return _moments_exist(self.ordered("ratio", "_ok"))


def _quantile(name: str, p: float, which: str, fits: Fits) -> Measure:
    """Quantile of fits, of which as in `Fits.ordered`."""
    return _quantile_of_ordered(fits.ordered(name, which), p)


def _far(which: str, fits: Fits) -> Measure:
    """Share of the fits beyond `FAR` bounds, of which fits as in `Fits.ordered`."""
    far = fits.ratio > FAR
    if which == "_ok":
        return share(int(np.sum(far & fits.ok)), int(np.sum(fits.ok)))
    return share(int(np.sum(far | ~fits.ok if which == "_all" else ~(fits.ratio <= FAR))), len(far))


def _moment(moment: Callable[[Floats], Measure], name: str, fits: Fits) -> Measure:
    """A moment of the ok fits, where it exists as far as they can tell."""
    values: Floats = getattr(fits, name)
    return moment(values[fits.ok]) if fits.moments_exist else UNKNOWN


class Performance(NamedTuple):
    """A performance measure: its title in a few words, its meaning, and the function that computes it."""

    title: str
    meaning: str
    of: Callable[[Fits], Measure]


_OF_ALL = "of all fits as computed, whatever their status; one without a number counts as infinite"
_OF_OK = "of the estimator's own ok fits, so not of the same trials as another's"
_FAILED_LAST = "of all fits, with those that are not ok counted as infinite"
_WHICH = {"": ("", _OF_ALL), "_ok": (", ok fits", _OF_OK), "_all": (", not ok as infinite", _FAILED_LAST)}
_GUARD = "of the estimator's own ok fits; only where the tail index exceeds 2 by two errors"
_AXIS = "median of the error along the cap's axis, over the bound"
_RMSE = "root mean square of error over bound"
_SHARE = "share beyond 10 bounds"
_OF_FITS = "share of all fits that are"
_ON_AXIS = "error along the axis over the bound"
_BEYOND = "beyond 10 times the bound"
_HILL = "Hill's index of the error's tail, of the estimator's own ok fits; no moments exist of that order and above"
PERFORMANCE: dict[str, Performance] = {
    f"{name}_{part}{which}": Performance(
        f"{words} of {quantity}{short}", f"{words} of {quantity}, {of_which}", partial(_quantile, name, p, which)
    )
    for name, quantity in (("relative", "error over radius"), ("ratio", "error over √tr CRLB"))
    for part, p, words in (("median", 0.5, "median"), ("q05", 0.05, "5 % quantile"), ("q95", 0.95, "95 % quantile"))
    for which, (short, of_which) in _WHICH.items()
}
_on_axis = partial(_quantile, "axis", 0.5)
PERFORMANCE |= {
    "far": Performance(_SHARE, f"{_OF_FITS} {_BEYOND} or without a number", partial(_far, "")),
    "far_ok": Performance(f"{_SHARE}, ok fits", f"share of the ok fits with an error {_BEYOND}", partial(_far, "_ok")),
    "far_all": Performance(f"{_SHARE} or not ok", f"{_OF_FITS} {_BEYOND} or not ok", partial(_far, "_all")),
    "axis_median": Performance(f"median {_ON_AXIS}", f"{_AXIS}, {_OF_ALL}", partial(_on_axis, "")),
    "axis_median_ok": Performance(f"median {_ON_AXIS}, ok fits", f"{_AXIS}, {_OF_OK}", partial(_on_axis, "_ok")),
    "tail_index": Performance("tail index of error over bound, ok fits", _HILL, lambda fits: fits.tail),
    "bias": Performance(f"mean {_ON_AXIS}, ok fits", f"mean {_ON_AXIS}, {_GUARD}", partial(_moment, mean, "axis")),
    "rmse": Performance(f"{_RMSE}, ok fits", f"{_RMSE}, {_GUARD}", partial(_moment, root_mean_square, "ratio")),
}
"""Every performance measure of the summary, in the order of its columns."""


def of_column(column: MeasureColumn) -> dict[str, tuple[str, Callable[[Any], Measure]]]:
    """Summaries of a column of a measure over all fits, by name: each with its meaning and its function.

    Of a column of truth values that is the share; of numbers they are the mean and the median, in which one that is not
    a number counts as infinite.
    """
    words: list[tuple[str, Callable[[Any], Measure]]]
    words = [("share", _share_of)] if column.kind is bool else [("mean", mean), ("median", _median)]
    named = zip(column.summaries, words, strict=True)
    return {name: (f"{what} of all fits; {column.meaning}", of) for name, (what, of) in named}


def measured(name: str, columns: Columns, further: Sequence[MeasureColumn] = ()) -> Measure:
    """Compute one measure of the summary.

    Args:
        name: the measure's.
        columns: rows of one estimator, as `Fits` takes them, with those of the study's measures.
        further: the columns of the study's measures, of which one may have the name among its summaries.
    """
    for column in further:
        if name in column.summaries:
            return _summarised(column, columns)[name]
    return PERFORMANCE[name].of(Fits(columns))


def _summarised(column: MeasureColumn, fits: Columns) -> dict[str, Measure]:
    """The summaries of a column of a measure by name."""
    with np.errstate(invalid="ignore"):  # a mean with infinite values has no error
        return {name: of_values(fits[column.name]) for name, (_, of_values) in of_column(column).items()}


def _share_of(values: Bools) -> Measure:
    return share(int(np.sum(values)), len(values))


def _median(values: Floats) -> Measure:
    return quantile(np.where(np.isnan(values), np.inf, values), 0.5)


Row = dict[str, str | float]
"""A row of the summary table: a value for each column."""
NEEDED = ["error", "error_1", "bound", "status"]
"""Columns of the error table that a row of the summary is made of, besides the conditions."""


def row(group: str, estimator: str, fits: Columns, measured: Sequence[MeasureColumn] = ()) -> Row:
    """Summarise the fits of one estimator in one group.

    Args:
        group: name of the group.
        estimator: name of the estimator.
        fits: rows of the error table: the conditions, the columns `NEEDED`, those measured, and ``decade``.
        measured: columns of the study's measures.

    Returns:
        A value for each column of the summary table.
    """
    status = fits["status"]
    result: Row = {"group": group, "estimator": estimator, "decade": fits["decade"][0], "planned": len(status)}
    for condition in STORED:
        if condition.name in fits:
            values = fits[condition.name]
            varying = "" if condition.kind is str else np.nan
            result[condition.name] = values[0] if np.all(values == values[0]) else varying
    result |= {s.name.lower(): int(np.sum(status == s)) for s in Status}
    measures = Fits(fits)
    for name, measure in PERFORMANCE.items():
        result[name], result[f"{name}_error"] = measure.of(measures)
    for column in measured:
        for name, (value, error) in _summarised(column, fits).items():
            result[name], result[f"{name}_error"] = value, error
    return result


def of_errors(errors: Errors, measured: Sequence[MeasureColumn] = ()) -> Columns:
    """Summarise whole cells of a grid from their errors in memory, for a study that keeps no error table.

    Args:
        errors: all trials of some cells.
        measured: columns of the study's measures.

    Returns:
        Columns of the summary table, with the rows that the stored errors would have.
    """
    distance, bound, rows = errors.distance, errors.center_bound, []
    for place, cell in enumerate(errors.cells):
        of_cell = {name: np.array([cell.values[name]]) for name in errors.conditions}
        for index, estimator in enumerate(errors.estimators):
            of_fits = {
                "error": distance[place, index],
                "error_1": errors.fits.center[place, index, :, 0],
                "bound": bound[place],
                "status": errors.fits.status[place, index],
                "decade": np.array([np.nan]),
            }
            of_fits |= {column.name: errors.measured[column.name][place, index] for column in measured}
            rows.append(row(cell.name, estimator, of_cell | of_fits, measured))
    return as_columns(rows)


def as_columns(rows: list[Row]) -> Columns:
    """Turn rows of the summary table into columns."""
    columns = {name: [row[name] for row in rows] for name in rows[0]} if rows else {}
    return {
        name: np.array(values, dtype=object if isinstance(values[0], str) else None) for name, values in columns.items()
    }


def theil_sen(x: Floats, y: Floats, level: float = 0.95) -> tuple[float, float, float]:
    """Theil and Sen's slope of y over x, the median of the slopes between all pairs of points (Sen 1968).

    Args:
        x: first coordinates of the points (n,), n ≥ 2, all finite. Pairs with the same x count for nothing.
        y: second coordinates (n,), likewise.
        level: probability that the interval contains the slope.

    Returns:
        The slope and the ends of its interval; NaN where all x are the same.
    """
    if np.ptp(x) == 0.0:
        return math.nan, math.nan, math.nan
    slope, _, low, high = scipy.stats.theilslopes(y, x, level)
    return float(slope), float(low), float(high)
