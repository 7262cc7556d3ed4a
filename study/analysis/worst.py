"""The worst trials of a run: the largest errors among the fits whose status is ok."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from study.analysis.error_groups import decade, label
from study.estimators import Status
from study.experiment.conditions import bound_law, named_in
from study.runs.storage.atomic_write import RunError
from study.runs.storage.run_folder import Run
from study.sphere.types import Floats
from study.text.columns import columns
from study.text.nearest import did_you_mean

_GROUPS = 8
"""Row groups of an error table in memory at a time: a million rows."""


def worst(errors: pd.DataFrame, count: int = 5, estimator: str | None = None) -> pd.DataFrame:
    """The trials with the largest error over the bound, among the fits that are ok.

    A trial counts once, with the estimator that errs most on it: LLS and GDKE are the same fit, and would list every
    trial twice. Trials whose directions do not determine the centre have an infinite bound and are left out.

    Args:
        errors: the error table.
        count: number of trials.
        estimator: the estimator whose fits are used; all estimators if None.

    Returns:
        At most ``count`` rows of the error table, the worst first, with a column ``ratio``, error over bound, and an
        index from 0. Equal ratios are in the order of cell, trial and estimator by name.
    """
    ratio = _ratios(errors)
    if estimator is not None:
        ratio[(errors["estimator"] != estimator).to_numpy()] = np.nan
    # a trial has a row per estimator: among so many rows are the trials asked for, and those as bad as the last
    most = min(count * max(1, errors["estimator"].nunique()), int(np.sum(~np.isnan(ratio))))
    least = np.partition(ratio[~np.isnan(ratio)], -most)[-most] if most else np.inf
    where = np.flatnonzero(ratio >= least)
    found = errors.iloc[where].assign(ratio=ratio[where])
    # sorted by name, not by the code of a dictionary
    found = found.assign(cell=found["cell"].astype(str), estimator=found["estimator"].astype(str))
    found = found.sort_values(["ratio", "cell", "trial", "estimator"], ascending=[False, True, True, True])
    return found.drop_duplicates(["cell", "trial"]).head(count).reset_index(drop=True)


def worst_of_groups(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """The trial with the largest error over the bound of each group and estimator, among the fits that are ok.

    Args:
        errors: the error table.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid), as the summary does.

    Returns:
        A row per group and estimator that has such a trial: ``group``, ``estimator``, ``cell``, ``trial`` and
        ``ratio``, error over bound. Of equal ratios the first of the table counts.
    """
    ratio = pd.Series(_ratios(errors)).dropna()
    groups = decade(errors["noise"] / errors["radius"]) if by_decade else pd.factorize(errors["cell"])[0]
    keys = [groups[ratio.index], pd.factorize(errors["estimator"])[0][ratio.index]]
    where = ratio.groupby(keys, sort=True).idxmax().to_numpy()
    named = errors[["cell", "trial", "estimator", "noise", "radius"]].iloc[where]
    found = label(named, by_decade).astype({"group": str, "cell": str, "estimator": str})
    return found.assign(ratio=ratio[where].to_numpy())[["group", "estimator", "cell", "trial", "ratio"]]


def _ratios(errors: pd.DataFrame) -> Floats:
    """Error over bound of each row; NaN where the fit is not ok or there is no finite bound."""
    bound = errors["bound"].to_numpy()
    use = (errors["status"] == Status.OK).to_numpy() & np.isfinite(bound)
    with np.errstate(all="ignore"):
        return np.where(use, errors["error"].to_numpy() / bound, np.nan)


def of_run(run: Run, count: int, estimator: str | None = None) -> pd.DataFrame:
    """The worst trials of a run, as `worst` finds them in its error table.

    Raises:
        RunError: if the run did not finish, or does not have the estimator.
    """
    known = run.study.estimators
    if estimator is not None and estimator not in known:
        raise RunError(f"{run.folder}: no estimator {estimator!r} in this run; {did_you_mean(estimator, known)}")
    return worst(pd.concat([worst(part, count, estimator) for part in _parts(run)], ignore_index=True), count)


class WorstOfRun(NamedTuple):
    """The worst trials of a run, and the worst of each group and estimator; see `worst` and `worst_of_groups`."""

    trials: pd.DataFrame
    of_groups: pd.DataFrame


def worst_of_run(run: Run, count: int = 5) -> WorstOfRun:
    """Find the worst trials in one pass through a run's error table.

    Raises:
        RunError: if the run did not finish.
    """
    by_decade = run.study.design.one_trial_a_cell
    found = [WorstOfRun(worst(part, count), worst_of_groups(part, by_decade)) for part in _parts(run)]
    groups = pd.concat([part.of_groups for part in found], ignore_index=True)
    first = groups.groupby(["group", "estimator"], sort=False)["ratio"].idxmax()
    return WorstOfRun(worst(pd.concat([part.trials for part in found], ignore_index=True), count), groups.loc[first])


def _parts(run: Run) -> Iterator[pd.DataFrame]:
    """A run's error table, some rows at a time: new memory for millions of rows takes longer than reading them."""
    conditions = [condition.name for condition in run.study.conditions()]
    columns = ["cell", "trial", *conditions, "estimator", "error", "bound", "status"]
    file: pq.ParquetFile = run.read("errors", pq.ParquetFile)
    for first in range(0, max(1, file.num_row_groups), _GROUPS):  # a table without rows is a part without rows
        groups = range(first, min(first + _GROUPS, file.num_row_groups))
        yield file.read_row_groups(list(groups), columns=columns).to_pandas()


def as_data(run: Run, found: pd.DataFrame) -> dict[str, object]:
    """The worst trials for other programs: the run's name, the bound in words, and a mapping per trial."""
    conditions = [condition.name for condition in run.study.conditions()]
    trials = [
        {
            "name": f"{row['cell']}/{row['trial']}",
            **{name: row[name] for name in ("cell", "trial", "estimator", "ratio", "error", "bound", *conditions)},
        }
        for row in found.to_dict("records")
    ]
    return {"run": run.study.run_name(), "bound": bound_law(conditions) or "Cramér-Rao bound", "trials": trials}


def printed(run: Run, found: pd.DataFrame) -> Iterator[str]:
    """The worst trials for a terminal, each by the name that `study replay RUN NAME` takes."""
    conditions = [condition.name for condition in run.study.conditions()]
    shown = named_in(conditions)
    bound = bound_law(conditions) or "Cramér-Rao bound"
    yield f"{run.study.run_name()}: the largest errors over the {bound} of fits that are ok"
    rows = [
        [
            f"{row['cell']}/{row['trial']}",
            row["estimator"],
            f"{row['ratio']:.4g}",
            f"{row['error'] / row['radius']:.3g}",
            *(condition.written(condition.of(row)) for condition in shown),
        ]
        for row in found.to_dict("records")
    ]
    titles = ["trial", "estimator", "over bound", "error/r", *(condition.symbol for condition in shown)]
    yield from columns(rows, titles, "<<>")
    if len(found):
        yield f"to see the first: study replay {run.folder} {found['cell'][0]}/{found['trial'][0]} --plot worst.png"
