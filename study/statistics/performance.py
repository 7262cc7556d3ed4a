"""The summary's measures by name: each from the fits of one estimator in one group, with its Monte-Carlo error."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

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
        """Which fits are ok."""
        return np.asarray(self.columns["status"] == Status.OK)

    @cached_property
    def relative(self) -> Floats:
        """Error over radius."""
        with np.errstate(all="ignore"):
            return np.asarray(self.columns["error"] / self.columns["radius"])

    @cached_property
    def ratio(self) -> Floats:
        """Error over bound: where the directions do not determine the centre, it says nothing: worse than any."""
        bound = self.columns["bound"]
        with np.errstate(all="ignore"):
            return np.where(np.isfinite(bound), self.columns["error"] / bound, np.inf)

    @cached_property
    def axis(self) -> Floats:
        """Error along the cap's axis over bound, of the fits that are ok."""
        with np.errstate(all="ignore"):
            return np.asarray((self.columns["error_1"] / self.columns["bound"])[self.ok])

    @cached_property
    def tail(self) -> Measure:
        """Index of the tail of error over bound, of the fits that are ok."""
        return tail_index(self.ratio[self.ok])


def _quantile_ok(name: str, p: float, fits: Fits) -> Measure:
    values: Floats = getattr(fits, name)
    return quantile(values[fits.ok], p)


def _quantile_all(name: str, p: float, fits: Fits) -> Measure:
    return quantile(np.where(fits.ok, getattr(fits, name), np.inf), p)


def _far_ok(fits: Fits) -> Measure:
    return share(int(np.sum((fits.ratio > FAR) & fits.ok)), int(np.sum(fits.ok)))


def _far_all(fits: Fits) -> Measure:
    return share(int(np.sum((fits.ratio > FAR) | ~fits.ok)), len(fits.ok))


MEASURES: dict[str, Callable[[Fits], Measure]] = {
    f"{name}_{part}_{of}": partial(function, name, p)
    for name in ("relative", "ratio")
    for part, p in (("median", 0.5), ("q05", 0.05), ("q95", 0.95))
    for of, function in (("ok", _quantile_ok), ("all", _quantile_all))
} | {
    "far_ok": _far_ok,
    "far_all": _far_all,
    "axis_median_ok": lambda fits: quantile(fits.axis, 0.5),
    "tail_index": lambda fits: fits.tail,
    "bias": lambda fits: mean(fits.axis) if moments_exist(fits.tail) else UNKNOWN,
    "rmse": lambda fits: root_mean_square(fits.ratio[fits.ok]) if moments_exist(fits.tail) else UNKNOWN,
}
"""Every measure of the summary; what each means, `study.runs.storage.schemas.summary` says."""


def measured(name: str, columns: Columns) -> Measure:
    """One measure of fits of one estimator.

    Args:
        name: the measure's.
        columns: as `Fits` takes them.
    """
    return MEASURES[name](Fits(columns))
