"""The summary table: per cell, or per decade of relative noise, and estimator.

Failures count: every quantile comes twice, of the fits whose status is ok (``_ok``) and of all planned fits with the
others counted as worse than any (``_all``).
"""

from collections.abc import Collection, Iterator

import pandas as pd
import pyarrow as pa

from study.analysis.error_groups import Grouped, Key, label
from study.experiment.conditions import STORED
from study.runs.storage import schemas
from study.runs.storage.lock import writing
from study.runs.storage.run_folder import Run
from study.statistics.summary_rows import NEEDED, as_columns, row


def summarise(run: Run) -> None:
    """Summarise a run's error table and store the summary beside it, with few groups in memory at a time."""
    columns, grouped = schemas.summary(run.study.conditions()), Grouped(run)
    with writing(run.folder):
        run.join("summary", columns, rows_of_groups(run, grouped), {"study.config": run.study.canonical()})
        run.record("summary")


def rows_of_groups(run: Run, grouped: Grouped, keys: Collection[Key] | None = None) -> Iterator[pa.Table]:
    """Compute rows of a run's summary from its error table, some at a time.

    Args:
        run: the run.
        grouped: its error table.
        keys: groups and estimators; all if None.
    """
    conditions = run.study.conditions()
    columns, needed = schemas.summary(conditions), [*(condition.name for condition in conditions), *NEEDED]
    for some in grouped.batches(keys):
        found = grouped.read(some, needed)
        yield schemas.table(columns, as_columns([row(*key, found[key]) for key in some]))


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
    needed = [*(condition.name for condition in STORED if condition.name in errors), *NEEDED, "decade"]
    groups = errors.groupby(["group", "estimator"], sort=False, observed=True)
    parts = (((str(g), str(e)), {name: part[name].to_numpy() for name in needed}) for (g, e), part in groups)
    return pd.DataFrame([row(*key, columns) for key, columns in parts])
