"""The summary table: per cell, or per decade of relative noise, and estimator.

Failures count: every quantile comes twice, of the fits whose status is ok (``_ok``) and of all planned fits with the
others counted as worse than any (``_all``).
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from study.analysis.error_groups import Grouped, label
from study.estimators import Status
from study.experiment.errors import Columns, Errors
from study.runs.storage import schemas
from study.runs.storage.run_folder import Run
from study.statistics.performance import MEASURES, Fits

_CONDITIONS = ["samples", "noise", "angle", "radius", "center"]
_COLUMNS = [*_CONDITIONS, "error", "error_1", "bound", "status"]


def summarise(run: Run) -> None:
    """Summarise a run's error table and store the summary beside it, with few groups in memory at a time."""
    grouped, columns = Grouped(run), schemas.summary()

    def parts() -> Iterator[pa.Table]:
        for keys in grouped.batches():
            found = grouped.read(keys, _COLUMNS)
            yield schemas.table(columns, _stacked([_row(*key, _arrays(found[key])) for key in keys]))

    run.join("summary", columns, parts(), {"study.config": run.study.canonical()})


def summary(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """Performance measures of an error table.

    Args:
        errors: the error table.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid).

    Returns:
        A row per group and estimator, in the order of the table; columns as `study.runs.storage.schemas.summary`
        declares them.
    """
    errors = label(errors, by_decade)
    if by_decade:
        errors = errors.sort_values("decade", kind="stable")
    groups = errors.groupby(["group", "estimator"], sort=False, observed=True)
    return pd.DataFrame([_row(str(group), str(estimator), _arrays(part)) for (group, estimator), part in groups])


def of_errors(errors: Errors) -> Columns:
    """The summary of whole cells of a grid, from their errors in memory.

    Args:
        errors: all trials of some cells.

    Returns:
        Columns as `study.runs.storage.schemas.summary` declares them; equal to those that `summary` makes of the same
        errors.
    """
    distance, bound, rows = errors.distance, errors.center_bound, []
    for place, cell in enumerate(errors.cells):
        conditions = (cell.samples, cell.noise, cell.angle, cell.radius, cell.distance)
        known = {name: np.array([value]) for name, value in zip(_CONDITIONS, conditions, strict=True)}
        for index, estimator in enumerate(errors.estimators):
            found = {
                "error": distance[place, index],
                "error_1": errors.center[place, index, :, 0],
                "bound": bound[place],
                "status": errors.status[place, index],
                "decade": np.array([np.nan]),
            }
            rows.append(_row(cell.name, estimator, known | found))
    return _stacked(rows)


def _stacked(rows: list[dict[str, Any]]) -> Columns:
    """Rows as columns of the summary table."""
    frame = pd.DataFrame(rows)
    return {column.name: frame[column.name].to_numpy() for column in schemas.summary()}


def _arrays(part: pd.DataFrame) -> Columns:
    return {name: part[name].to_numpy() for name in [*_COLUMNS, "decade"]}


def _row(group: str, estimator: str, column: Columns) -> dict[str, Any]:
    """One group of one estimator."""
    status = column["status"]
    row: dict[str, Any] = {
        "group": group,
        "estimator": estimator,
        "decade": column["decade"][0],
        "planned": len(status),
    }
    row |= {name: column[name][0] if np.all(column[name] == column[name][0]) else np.nan for name in _CONDITIONS}
    row |= {s.name.lower(): int(np.sum(status == s)) for s in Status}
    fits = Fits(column)
    for name, measure in MEASURES.items():
        row[name], row[f"{name}_error"] = measure(fits)
    return row
