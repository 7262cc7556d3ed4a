"""The summary table: per cell, or per decade of relative noise, and estimator.

Failures count: every quantile comes twice, of the fits whose status is ok (``_ok``) and of all planned fits with the
others counted as worse than any (``_all``). Nothing is left out silently.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from study.analysis.error_groups import Grouped, label
from study.estimators import Status
from study.experiment.conditions import CONDITIONS, NOISE_OVER_RADIUS, STORED, Condition, distinguishing
from study.experiment.errors import Columns, Errors
from study.runs.storage import schemas
from study.runs.storage.run_folder import Run
from study.statistics.performance import MEASURES, Fits

_COLUMNS = ["error", "error_1", "bound", "status"]


def summarise(run: Run) -> None:
    """Summarise a run's error table, and store the summary beside it; a few groups are in memory at a time."""
    grouped, conditions = Grouped(run), run.study.conditions()
    names = [condition.name for condition in conditions]

    def parts() -> Iterator[pa.Table]:
        for keys in grouped.batches():
            found = grouped.read(keys, [*names, *_COLUMNS])
            rows = [_row(*key, _arrays(found[key], names), names) for key in keys]
            yield schemas.table(schemas.summary(conditions), _stacked(rows, names))

    run.join("summary", schemas.summary(conditions), parts(), {"study.config": run.study.canonical()})


def summary(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """Performance measures of an error table.

    Args:
        errors: the error table.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid).

    Returns:
        A row per group and estimator, in the order of the table; columns as `tables.summary` declares them.
    """
    errors = label(errors, by_decade)
    if by_decade:
        errors = errors.sort_values("decade", kind="stable")
    names = [condition.name for condition in STORED if condition.name in errors]
    groups = errors.groupby(["group", "estimator"], sort=False, observed=True)
    rows = [_row(str(group), str(name), _arrays(part, names), names) for (group, name), part in groups]
    return pd.DataFrame(rows)


def of_errors(errors: Errors) -> Columns:
    """Rows of the summary table from the errors of whole cells of a grid, which no table needs to hold.

    Args:
        errors: all trials of some cells.

    Returns:
        Columns as `tables.summary` declares them; the rows are those that `summary` makes of the same errors.
    """
    distance, bound, rows = errors.distance, errors.center_bound, []
    for place, cell in enumerate(errors.cells):
        known = {name: np.array([cell.values[name]]) for name in errors.conditions}
        for index, estimator in enumerate(errors.estimators):
            found = {
                "error": distance[place, index],
                "error_1": errors.center[place, index, :, 0],
                "bound": bound[place],
                "status": errors.status[place, index],
                "decade": np.array([np.nan]),
            }
            rows.append(_row(cell.name, estimator, known | found, errors.conditions))
    return _stacked(rows, errors.conditions)


def _stacked(rows: list[dict[str, Any]], conditions: Sequence[str]) -> Columns:
    """Rows as columns of the summary table."""
    frame = pd.DataFrame(rows)
    return {c.name: frame[c.name].to_numpy() for c in schemas.summary([CONDITIONS[name] for name in conditions])}


def _arrays(part: pd.DataFrame, conditions: Sequence[str]) -> Columns:
    return {name: part[name].to_numpy() for name in [*conditions, *_COLUMNS, "decade"]}


def _row(group: str, estimator: str, column: Columns, conditions: Sequence[str]) -> dict[str, Any]:
    """One group of one estimator."""
    status = column["status"]
    row: dict[str, Any] = {
        "group": group,
        "estimator": estimator,
        "decade": column["decade"][0],
        "planned": len(status),
    }
    for name in conditions:
        varies = np.any(column[name] != column[name][0])
        row[name] = column[name][0] if not varies else "" if CONDITIONS[name].kind is str else np.nan
    row |= {s.name.lower(): int(np.sum(status == s)) for s in Status}
    fits = Fits(column)
    for name, measure in MEASURES.items():
        row[name], row[f"{name}_error"] = measure(fits)
    return row


def printed(run: Run) -> Iterator[str]:
    """The summary in short, for a terminal.

    Yields:
        A title, a header, and a line per group: for each estimator the median error over the bound with its
        Monte-Carlo error, of the fits that are ok, and the share of those that are not.
    """
    frame = run.table("summary")
    estimators = list(dict.fromkeys(frame["estimator"]))
    groups = list(frame.groupby("group", sort=False))
    conditions = distinguishing(frame)
    labels = [_label(part.iloc[0], conditions) for _, part in groups]
    yield f"{run.study.run_name()}: median error of the centre over the Cramér-Rao bound ± Monte-Carlo error (not ok)"
    if frame.empty:
        yield "no cell has a trial yet"
        return
    wide = max(map(len, labels))
    yield " " * wide + "".join(f"  {name:<26}" for name in estimators).rstrip()
    for text, (_, part) in zip(labels, groups, strict=True):
        yield f"{text:<{wide}}" + "".join(f"  {_short(row):<26}" for _, row in part.iterrows()).rstrip()


def _label(row: "pd.Series[Any]", conditions: list[Condition]) -> str:
    """A group in words: its decade, or the conditions of its cell."""
    if np.isfinite(row["decade"]):
        return f"{NOISE_OVER_RADIUS.symbol} = 1e{int(row['decade']):+03d} …"
    return ", ".join(condition.label(row) for condition in conditions)


def _short(row: "pd.Series[Any]") -> str:
    if row["ok"] == 0:
        return "none ok"
    failed = 1.0 - row["ok"] / row["planned"]
    text = f"{row['ratio_median_ok']:.3g} ± {row['ratio_median_ok_error']:.2g}"
    return text + (f" ({failed:.1%})" if failed > 0 else "")
