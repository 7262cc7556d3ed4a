"""Rows of error tables: selections, errors in a unit, and tables with a column per estimator.

Every fit counts with its error as computed, whatever its status, and one without a number as infinite (`error_over`):
so estimators are compared on the same trials. A status would select other trials for each of them.
"""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pandas as pd

from study.sphere.types import Bools, Floats, Ints

LEAST = 20
"""Least number of data sets behind a median that is shown."""
WHOLE = 180.0
"""Half-angle of a cap that is the whole sphere."""


def rows_of(errors: pd.DataFrame, estimator: str) -> pd.DataFrame:
    """The rows of one estimator; nothing is copied where they stand together."""
    names = errors["estimator"].astype("category").cat
    if estimator not in names.categories:
        return errors.iloc[:0]
    where = np.flatnonzero(names.codes == names.categories.get_loc(estimator))
    return errors.iloc[where[0] : where[-1] + 1] if _together(where) else errors.iloc[where]


def _together(places: Ints) -> bool:
    return len(places) > 0 and int(places[-1] - places[0]) == len(places) - 1


def has_estimators(errors: pd.DataFrame, *estimators: str) -> bool:
    """True if the table has rows of each of these estimators."""
    return all(len(rows_of(errors, name)) for name in estimators)


def cells(errors: pd.DataFrame, estimator: str) -> Iterator[tuple[float, float, pd.DataFrame]]:
    """Angle, σ/r and rows of an estimator in each condition of a grid, in the order of angle and σ/r."""
    rows = rows_of(errors, estimator)
    angle, noise = rows["angle"].to_numpy(), relative_noise(rows).to_numpy()
    changes = (angle[1:] != angle[:-1]) | (noise[1:] != noise[:-1])
    places = [0, *np.flatnonzero(changes) + 1, len(rows)] if len(rows) else []
    blocks: dict[tuple[float, float], list[pd.DataFrame]] = {}
    for start, end in pairwise(places):
        blocks.setdefault((float(angle[start]), float(noise[start])), []).append(rows.iloc[start:end])
    for (at, level), parts in sorted(blocks.items(), key=lambda block: block[0]):
        yield at, level, parts[0] if len(parts) == 1 else pd.concat(parts)


def relative_noise(errors: pd.DataFrame) -> "pd.Series[float]":
    """Relative noise σ/r of each row."""
    return errors["noise"] / errors["radius"]


def error_over(errors: pd.DataFrame, unit: str) -> "pd.Series[float]":
    """Error of each row over a column, ``radius`` or ``bound``; infinite if there is no number, or no finite bound."""
    return (errors["error"] / errors[unit]).where(np.isfinite(errors[unit]), math.inf).fillna(math.inf)


def by_estimator(errors: pd.DataFrame, values: "pd.Series[float]") -> pd.DataFrame:
    """Values as a table: a row per data set, in the order of the errors, and a column per estimator."""
    table = errors.assign(value=values).pivot(index=["cell", "trial"], columns="estimator", values="value")
    table.columns = [str(name) for name in table.columns]
    return table.sort_index(level="trial")


def in_large_groups(labels: Floats, least: int = LEAST) -> Bools:
    """True for each value whose group, named by its label, has at least this many values."""
    _, place, count = np.unique(labels, return_inverse=True, return_counts=True)
    return np.asarray(count[place] >= least)


def center_errors(rows: pd.DataFrame) -> Floats:
    """Error vectors of the centre (trials, d); rows with NaN are left out."""
    return rows[[name for name in rows.columns if name.startswith("error_")]].dropna().to_numpy()
