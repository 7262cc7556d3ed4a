"""The summary table: per cell, or per decade of relative noise, and estimator.

The headline is ``ratio_median``, of all trials, so that columns of one row are of the same trials. For quantiles of the
fits whose status is ok (``_ok``), and with failures last (``_all``), see `study.statistics.performance`.
"""

from collections.abc import Collection, Iterator
from typing import Protocol

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from study.analysis.error_groups import Grouped, Key, label
from study.experiment.conditions import STORED
from study.runs.storage import schemas
from study.runs.storage.lock import writing
from study.runs.storage.run_folder import Run
from study.statistics.summary_rows import NEEDED, as_columns, row


class TableReader(Protocol):
    """Reader of stored tables, as a run is."""

    def table(
        self, name: str, columns: Collection[str] | None = None, estimators: Collection[str] | None = None
    ) -> pd.DataFrame:
        """Read a table, or some of its columns and some estimators' rows."""


def stored_summary(run: TableReader, has_errors: bool, by_decade: bool) -> pd.DataFrame:
    """Read the summary of a run, with the measures of all trials even if an earlier version stored it without them.

    They are computed from the errors. Without errors they are those with failures last where every fit is ok, and
    elsewhere not a number.

    Args:
        run: the run.
        has_errors: True if its error table is stored.
        by_decade: as in `summary`.
    """
    found = run.table("summary")
    missing = [name for name in schemas.OF_ALL_TRIALS if name not in found]
    if not missing:
        return found
    if has_errors:
        computed = summary(run.table("errors", ["cell", "estimator", *(c.name for c in STORED), *NEEDED]), by_decade)
        return computed[[c.name for c in schemas.summary([c for c in STORED if c.name in found])]]
    known = {name: _failures_last(name) for name in missing}
    all_ok = found["ok"] == found["planned"]
    return found.assign(
        **{name: found[other].where(all_ok) if other in found else np.nan for name, other in known.items()}
    )


def _failures_last(name: str) -> str:
    """The column of a measure with failures last, or of its Monte-Carlo error."""
    return f"{name.removesuffix('_error')}_all" + "_error" * name.endswith("_error")


def up_to_date(run: Run) -> bool:
    """True if the summary of a finished run need not be made from its errors again."""
    if not run.valid("summary"):
        return False
    stored = pq.read_schema(run.path("summary")).names
    return run.study.keep == "summary" or set(schemas.OF_ALL_TRIALS) <= set(stored)


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
