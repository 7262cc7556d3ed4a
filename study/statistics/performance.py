"""Performance measures of an estimator in one group of fits, by name, each with its Monte-Carlo error.

They are those of Morris, White & Crowther (2019) as far as they exist for errors with heavy tails. A quantile, and the
share of outliers, comes three times:

- ``ratio_median`` is of all fits as computed, whatever their status; one without a number counts as infinite. It is of
  the same trials for all estimators, so they are compared by it.
- ``ratio_median_ok`` is of the estimator's own ok fits. These are other trials for each estimator, and often the easier
  ones, so it compares nothing.
- ``ratio_median_all`` is of all fits, with those that are not ok counted as infinite.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from study.estimators import Status
from study.experiment.errors import Columns
from study.sphere.types import Bools, Floats
from study.statistics.measures import (
    UNKNOWN,
    Measure,
    mean,
    moments_exist,
    quantile,
    root_mean_square,
    share,
    tail_index,
)

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

    @cached_property
    def tail(self) -> Measure:
        """Tail index of error over bound, of the fits that are ok."""
        return tail_index(self.ratio[self.ok])

    @cached_property
    def moments_exist(self) -> bool:
        """True if the mean square of error over bound exists, as far as the fits that are ok can tell."""
        return moments_exist(self.ratio[self.ok])


def _quantile(name: str, p: float, fits: Fits) -> Measure:
    values: Floats = getattr(fits, name)
    return quantile(np.where(np.isnan(values), np.inf, values), p)


def _quantile_ok(name: str, p: float, fits: Fits) -> Measure:
    values: Floats = getattr(fits, name)
    return quantile(values[fits.ok], p)


def _quantile_all(name: str, p: float, fits: Fits) -> Measure:
    return quantile(np.where(fits.ok, getattr(fits, name), np.inf), p)


def _far(fits: Fits) -> Measure:
    return share(int(np.sum(~(fits.ratio <= FAR))), len(fits.ok))


def _far_ok(fits: Fits) -> Measure:
    return share(int(np.sum((fits.ratio > FAR) & fits.ok)), int(np.sum(fits.ok)))


def _far_all(fits: Fits) -> Measure:
    return share(int(np.sum((fits.ratio > FAR) | ~fits.ok)), len(fits.ok))


class Performance(NamedTuple):
    """A performance measure: its title in a few words, its meaning, and the function that computes it."""

    title: str
    meaning: str
    of: Callable[[Fits], Measure]


_OF_ALL = "of all fits as computed, whatever their status; one without a number counts as infinite"
_OF_OK = "of the estimator's own ok fits, so not of the same trials as another's"
_FAILED_LAST = "of all fits, with those that are not ok counted as infinite"


def _quantiles() -> dict[str, Performance]:
    found = {}
    for name, quantity in (("relative", "error over radius"), ("ratio", "error over √tr CRLB")):
        for part, p, words in (
            ("median", 0.5, "median"),
            ("q05", 0.05, "5 % quantile"),
            ("q95", 0.95, "95 % quantile"),
        ):
            title = f"{words} of {quantity}"
            for suffix, title_of, of_which, function in (
                ("", "", _OF_ALL, _quantile),
                ("_ok", ", ok fits", _OF_OK, _quantile_ok),
                ("_all", ", not ok as infinite", _FAILED_LAST, _quantile_all),
            ):
                meaning = f"{title}, {of_which}"
                found[f"{name}_{part}{suffix}"] = Performance(title + title_of, meaning, partial(function, name, p))
    return found


_GUARD = "of the estimator's own ok fits; only where the tail index exceeds 2 by two errors"
_AXIS = "median of the error along the cap's axis, over the bound"
MEASURES = _quantiles() | {
    "far": Performance(
        "share beyond 10 bounds", "share of all fits that are beyond 10 times the bound or without a number", _far
    ),
    "far_ok": Performance(
        "share beyond 10 bounds, ok fits", "share of the ok fits with an error beyond 10 times the bound", _far_ok
    ),
    "far_all": Performance(
        "share beyond 10 bounds or not ok",
        "share of all fits that are beyond 10 times the bound or not ok",
        _far_all,
    ),
    "axis_median": Performance(
        "median error along the axis over the bound", f"{_AXIS}, {_OF_ALL}", partial(_quantile, "axis", 0.5)
    ),
    "axis_median_ok": Performance(
        "median error along the axis over the bound, ok fits", f"{_AXIS}, {_OF_OK}", partial(_quantile_ok, "axis", 0.5)
    ),
    "tail_index": Performance(
        "tail index of error over bound, ok fits",
        "Hill's index of the error's tail, of the estimator's own ok fits; no moments exist of that order and above",
        lambda fits: fits.tail,
    ),
    "bias": Performance(
        "mean error along the axis over the bound, ok fits",
        f"mean error along the axis over the bound, {_GUARD}",
        lambda fits: mean(fits.axis[fits.ok]) if fits.moments_exist else UNKNOWN,
    ),
    "rmse": Performance(
        "root mean square of error over bound, ok fits",
        f"root mean square of error over bound, {_GUARD}",
        lambda fits: root_mean_square(fits.ratio[fits.ok]) if fits.moments_exist else UNKNOWN,
    ),
}
"""Every performance measure of the summary, in the order of its columns."""


def measured(name: str, columns: Columns) -> Measure:
    """Compute one performance measure.

    Args:
        name: the measure's.
        columns: rows of one estimator, as `Fits` takes them.
    """
    return MEASURES[name].of(Fits(columns))
