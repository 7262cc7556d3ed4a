"""Rows of the summary table: for each group of fits and estimator, counts of each status and performance measures.

A group is a cell, or, in a random design, a decade of σ/r. Failures count: no planned fit is left out of a measure of
all fits, and one without a number counts as infinite.
"""

import numpy as np

from study.estimators import Status
from study.experiment.conditions import STORED
from study.experiment.errors import Columns, Errors
from study.statistics.performance import MEASURES, Fits

Row = dict[str, str | float]
"""A row of the summary table: a value for each column."""
NEEDED = ["error", "error_1", "bound", "status"]
"""Columns of the error table that a row of the summary is made of, besides the conditions."""


def row(group: str, estimator: str, fits: Columns) -> Row:
    """Summarise the fits of one estimator in one group.

    Args:
        group: name of the group.
        estimator: name of the estimator.
        fits: rows of the error table: the conditions, the columns `NEEDED`, and ``decade``.

    Returns:
        A value for each column of the summary table.
    """
    status = fits["status"]
    found: Row = {
        "group": group,
        "estimator": estimator,
        "decade": fits["decade"][0],
        "planned": len(status),
    }
    for condition in STORED:
        if condition.name in fits:
            values = fits[condition.name]
            varying = "" if condition.kind is str else np.nan
            found[condition.name] = values[0] if np.all(values == values[0]) else varying
    found |= {s.name.lower(): int(np.sum(status == s)) for s in Status}
    measures = Fits(fits)
    for name, measure in MEASURES.items():
        found[name], found[f"{name}_error"] = measure.of(measures)
    return found


def of_errors(errors: Errors) -> Columns:
    """Summarise whole cells of a grid from their errors in memory, for a study that keeps no error table.

    Args:
        errors: all trials of some cells.

    Returns:
        Columns of the summary table, with the rows that the stored errors would have.
    """
    distance, bound, rows = errors.distance, errors.center_bound, []
    for place, cell in enumerate(errors.cells):
        of_cell = {name: np.array([cell.values[name]]) for name in errors.conditions}
        for index, estimator in enumerate(errors.estimators):
            of_fits = {
                "error": distance[place, index],
                "error_1": errors.center[place, index, :, 0],
                "bound": bound[place],
                "status": errors.status[place, index],
                "decade": np.array([np.nan]),
            }
            rows.append(row(cell.name, estimator, of_cell | of_fits))
    return as_columns(rows)


def as_columns(rows: list[Row]) -> Columns:
    """Turn rows of the summary table into columns."""
    columns = {name: [row[name] for row in rows] for name in rows[0]} if rows else {}
    return {
        name: np.array(values, dtype=object if isinstance(values[0], str) else None) for name, values in columns.items()
    }
