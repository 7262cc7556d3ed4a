"""Performance measures of an estimator in one group of fits, by name, each with its Monte-Carlo error.

They are those of Morris, White & Crowther (2019) as far as they exist for errors with heavy tails. Every quantile comes
twice: of the fits whose status is ok (``_ok``), and of all fits with the others counted as infinite (``_all``).
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
        """Error along the cap's axis over bound, of the fits that are ok; infinite where there is no bound."""
        bound = self.columns["bound"][self.ok]
        with np.errstate(all="ignore"):
            return np.where(np.isfinite(bound), self.columns["error_1"][self.ok] / bound, np.inf)

    @cached_property
    def tail(self) -> Measure:
        """Tail index of error over bound, of the fits that are ok."""
        return tail_index(self.ratio[self.ok])

    @cached_property
    def moments_exist(self) -> bool:
        """True if the mean square of error over bound exists, as far as the fits that are ok can tell."""
        return moments_exist(self.ratio[self.ok])


def _quantile_ok(name: str, p: float, fits: Fits) -> Measure:
    values: Floats = getattr(fits, name)
    return quantile(values[fits.ok], p)


def _quantile_all(name: str, p: float, fits: Fits) -> Measure:
    return quantile(np.where(fits.ok, getattr(fits, name), np.inf), p)


def _far_ok(fits: Fits) -> Measure:
    return share(int(np.sum((fits.ratio > FAR) & fits.ok)), int(np.sum(fits.ok)))


def _far_all(fits: Fits) -> Measure:
    return share(int(np.sum((fits.ratio > FAR) | ~fits.ok)), len(fits.ok))


class Performance(NamedTuple):
    """A performance measure: its meaning, and the function that computes it."""

    meaning: str
    of: Callable[[Fits], Measure]


def _quantiles() -> dict[str, Performance]:
    found = {}
    for name, quantity in (("relative", "error over radius"), ("ratio", "error over √tr CRLB")):
        for part, p, words in (
            ("median", 0.5, "median"),
            ("q05", 0.05, "5 % quantile"),
            ("q95", 0.95, "95 % quantile"),
        ):
            of_ok, of_all = partial(_quantile_ok, name, p), partial(_quantile_all, name, p)
            found[f"{name}_{part}_ok"] = Performance(f"{words} of {quantity}, of the fits that are ok", of_ok)
            found[f"{name}_{part}_all"] = Performance(f"{words} of {quantity}, all others counted as infinite", of_all)
    return found


_GUARD = "only where the tail index exceeds 2 by two errors"
MEASURES = _quantiles() | {
    "far_ok": Performance("share of the ok fits with an error beyond 10 times the bound", _far_ok),
    "far_all": Performance("share of all fits that are beyond 10 times the bound or not ok", _far_all),
    "axis_median_ok": Performance(
        "median of the error along the cap's axis, over the bound: the bias that always exists",
        lambda fits: quantile(fits.axis, 0.5),
    ),
    "tail_index": Performance(
        "Hill's index of the error's tail; moments of that order and above do not exist", lambda fits: fits.tail
    ),
    "bias": Performance(
        f"mean error along the axis over the bound; {_GUARD}",
        lambda fits: mean(fits.axis) if fits.moments_exist else UNKNOWN,
    ),
    "rmse": Performance(
        f"root mean square of error over bound; {_GUARD}",
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
