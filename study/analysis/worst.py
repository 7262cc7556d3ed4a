"""The worst trials of a run: the largest errors among the fits whose status is ok."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from study.estimators import Status
from study.experiment.conditions import bound_law, named_in
from study.runs.storage.atomic_write import RunError
from study.runs.storage.run_folder import Run
from study.text.columns import columns
from study.text.nearest import did_you_mean


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
    use = (errors["status"] == Status.OK) & np.isfinite(errors["bound"])
    if estimator is not None:
        use &= errors["estimator"] == estimator
    found: pd.DataFrame = errors[use]
    found = found.assign(
        ratio=found["error"] / found["bound"],
        cell=found["cell"].astype(str),  # sorted by name, not by the code of a dictionary
        estimator=found["estimator"].astype(str),
    )
    found = found[found["ratio"].notna()]
    found = found.sort_values(["ratio", "cell", "trial", "estimator"], ascending=[False, True, True, True])
    return found.drop_duplicates(["cell", "trial"]).head(count).reset_index(drop=True)


def of_run(run: Run, count: int, estimator: str | None = None) -> pd.DataFrame:
    """The worst trials of a run, as `worst` finds them in its error table.

    Raises:
        RunError: if the run did not finish, or does not have the estimator.
    """
    known = run.study.estimators
    if estimator is not None and estimator not in known:
        raise RunError(f"{run.folder}: no estimator {estimator!r} in this run; {did_you_mean(estimator, known)}")
    conditions = [condition.name for condition in run.study.conditions()]
    used = ["cell", "trial", *conditions, "estimator", "error", "bound", "status"]
    return worst(run.table("errors", used), count, estimator)


def as_data(run: Run, found: pd.DataFrame) -> dict[str, Any]:
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
