"""What several claims measure alike: errors as computed, their medians, levels of noise, estimators side by side.

Errors are as computed: of every fit, whatever its status, as figure 2 shows them; one without a number counts as
infinite. A measure of fewer than `LEAST` data sets is unknown.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from study.analysis.claims.medians import ratio
from study.analysis.measures import UNKNOWN, Measure, quantile

Floats = NDArray[np.float64]

LEAST = 20
"""Data sets behind a median that may be shown."""


def level(errors: pd.DataFrame) -> "pd.Series[float]":
    """Relative noise σ/r of each row."""
    return errors["noise"] / errors["radius"]


def decade(errors: pd.DataFrame) -> Floats:
    """Lower end of the decade of σ/r that each row lies in, as a power of ten."""
    return np.asarray(np.floor(np.log10(level(errors).to_numpy(dtype=float)) + 1e-9))


def over(errors: pd.DataFrame, unit: str) -> "pd.Series[float]":
    """Error of each row over a column, ``radius`` or ``bound``; infinite if there is no number, or no finite bound."""
    return (errors["error"] / errors[unit]).where(np.isfinite(errors[unit]), math.inf).fillna(math.inf)


def median(values: NDArray[Any], least: int = LEAST) -> Measure:
    """Median with its Monte-Carlo error; unknown if there are too few values."""
    return quantile(np.asarray(values, dtype=float), 0.5) if len(values) >= least else UNKNOWN


def beside(errors: pd.DataFrame, values: "pd.Series[float]") -> pd.DataFrame:
    """A row per data set, in the order of the table, and a column per estimator."""
    table = errors.assign(value=values).pivot(index=["cell", "trial"], columns="estimator", values="value")
    table.columns = [str(name) for name in table.columns]
    return table.sort_index(level="trial")


def quotient(above: Measure, below: Measure) -> Measure:
    """Quotient of two medians; infinite where most of what is above has no number."""
    if above.value == math.inf and math.isfinite(below.value):
        return Measure(math.inf, math.nan)
    return ratio(above, below)


def cells(errors: pd.DataFrame, estimator: str) -> Iterator[tuple[float, float, pd.DataFrame]]:
    """Angle, σ/r and rows of an estimator in each condition of a grid."""
    rows = errors[errors["estimator"] == estimator]
    for _, part in rows.groupby([rows["angle"], level(rows)]):
        yield float(part["angle"].iloc[0]), float(level(part).iloc[0]), part


def with_all(errors: pd.DataFrame, *estimators: str) -> bool:
    """Whether the table has rows of each of these estimators."""
    return set(estimators) <= {str(name) for name in errors["estimator"].unique()}


def with_trials(labels: Floats, least: int = LEAST) -> NDArray[np.bool_]:
    """Which values belong to a group, named by its label, that has enough of them."""
    _, place, count = np.unique(labels, return_inverse=True, return_counts=True)
    return np.asarray(count[place] >= least)
