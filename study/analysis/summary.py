"""The summary table: per cell, or per decade of relative noise, and estimator.

Failures count: every quantile comes twice, of the fits whose status is ok (``_ok``) and of all planned fits with the
others counted as worse than any (``_all``). Nothing is left out silently.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from study.analysis.error_groups import Grouped, label
from study.experiment.errors import Columns
from study.runs.storage import schemas
from study.runs.storage.run_folder import Run
from study.statistics.summary_rows import NEEDED, as_columns, row


def summarise(run: Run) -> None:
    """Summarise a run's error table, and store the summary beside it; a few groups are in memory at a time."""
    grouped, columns = Grouped(run), schemas.summary()

    def parts() -> Iterator[pa.Table]:
        for keys in grouped.batches():
            found = grouped.read(keys, NEEDED)
            yield schemas.table(columns, as_columns([row(*key, _arrays(found[key])) for key in keys]))

    run.join("summary", columns, parts(), {"study.config": run.study.canonical()})


def summary(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """Performance measures of an error table.

    Args:
        errors: the error table.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid).

    Returns:
        A row per group and estimator, in the order of the table; columns as in `study.runs.storage.schemas.summary`.
    """
    errors = label(errors, by_decade)
    if by_decade:
        errors = errors.sort_values("decade", kind="stable")
    groups = errors.groupby(["group", "estimator"], sort=False, observed=True)
    return pd.DataFrame([row(str(group), str(estimator), _arrays(part)) for (group, estimator), part in groups])


def _arrays(part: pd.DataFrame) -> Columns:
    return {name: part[name].to_numpy() for name in [*NEEDED, "decade"]}


def printed(run: Run) -> Iterator[str]:
    """The summary in short, for a terminal.

    Yields:
        A title, a header, and a line per group: for each estimator the median error over the bound with its
        Monte-Carlo error, of the fits that are ok, and the share of those that are not.
    """
    frame = run.table("summary")
    estimators = list(dict.fromkeys(frame["estimator"]))
    groups = list(frame.groupby("group", sort=False))
    varying = [name for name in ("radius", "center") if frame[name].nunique() > 1]
    labels = [_label(part.iloc[0], varying) for _, part in groups]
    yield f"{run.study.run_name()}: median error of the centre over the Cramér-Rao bound ± Monte-Carlo error (not ok)"
    if frame.empty:
        yield "no cell has a trial yet"
        return
    wide = max(map(len, labels))
    yield " " * wide + "".join(f"  {name:<26}" for name in estimators).rstrip()
    for text, (_, part) in zip(labels, groups, strict=True):
        yield f"{text:<{wide}}" + "".join(f"  {_short(row):<26}" for _, row in part.iterrows()).rstrip()


def _label(row: "pd.Series[Any]", varying: list[str]) -> str:
    """What a group is, in words."""
    if np.isfinite(row["decade"]):
        return f"σ/r = 1e{int(row['decade']):+03d} …"
    parts = [f"N = {row['samples']:g}", f"σ/r = {row['noise'] / row['radius']:.3g}", f"φ = {row['angle']:.4g}°"]
    return ", ".join([*parts, *(f"{'r' if name == 'radius' else '|c|'} = {row[name]:g}" for name in varying)])


def _short(row: "pd.Series[Any]") -> str:
    if row["ok"] == 0:
        return "none ok"
    failed = 1.0 - row["ok"] / row["planned"]
    text = f"{row['ratio_median_ok']:.3g} ± {row['ratio_median_ok_error']:.2g}"
    return text + (f" ({failed:.1%})" if failed > 0 else "")
