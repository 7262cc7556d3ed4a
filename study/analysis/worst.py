"""The worst trials of a run: where an estimator said ok and yet was farthest from the truth."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.estimators import Status
from study.experiment.conditions import named_in
from study.runs.storage.atomic_write import RunError
from study.runs.storage.run_folder import Run


def worst(errors: pd.DataFrame, count: int = 5, estimator: str | None = None) -> pd.DataFrame:
    """The trials with the largest error over the bound, among the fits that are ok.

    A trial counts once, with the estimator that did worst on it: LLS and GDKE are the same fit, and a list of pairs
    would be half as long. Trials whose directions do not determine the centre have an infinite bound and are left out:
    there is nothing that an estimator could have done better.

    Args:
        errors: the error table.
        count: how many trials.
        estimator: look at its fits alone.

    Returns:
        At most so many rows of the error table, the worst first, with a column ``ratio``, error over bound, and an
        index from 0. Equal ones are in the order of cell, trial and estimator by name, whatever the table's order.
    """
    use = (errors["status"] == Status.OK) & np.isfinite(errors["bound"])
    if estimator is not None:
        use &= errors["estimator"] == estimator
    found: pd.DataFrame = errors[use]
    found = found.assign(
        ratio=found["error"] / found["bound"],
        cell=found["cell"].astype(str),  # names in the order of the alphabet, not of a dictionary
        estimator=found["estimator"].astype(str),
    )
    found = found[found["ratio"].notna()]
    found = found.sort_values(["ratio", "cell", "trial", "estimator"], ascending=[False, True, True, True])
    return found.drop_duplicates(["cell", "trial"]).head(count).reset_index(drop=True)


def printed(run: Run, count: int, estimator: str | None = None) -> Iterator[str]:
    """The worst trials for a terminal, each by the name that `study replay RUN NAME` takes.

    Raises:
        RunError: if the run did not finish, or does not have the estimator.
    """
    known = run.study.estimators
    if estimator is not None and estimator not in known:
        raise RunError(f"{run.folder}: estimator {estimator!r} is not in it; it has {', '.join(known)}")
    conditions = [condition.name for condition in run.study.conditions()]
    columns = ["cell", "trial", *conditions, "estimator", "error", "bound", "status"]
    found = worst(run.table("errors", columns), count, estimator)
    shown = named_in(conditions)
    yield f"{run.study.run_name()}: the largest errors over the Cramér-Rao bound of fits that are ok"
    title = f"{'trial':<20}{'estimator':<14}{'over bound':>12}{'error/r':>10}"
    yield title + "".join(f"{condition.symbol:>10}" for condition in shown)
    for row in found.to_dict("records"):
        yield (
            f"{row['cell'] + '/' + str(row['trial']):<20}{row['estimator']:<14}{row['ratio']:>12.4g}"
            f"{row['error'] / row['radius']:>10.3g}"
            + "".join(f"{condition.written(condition.of(row)):>10}" for condition in shown)
        )
    if len(found):
        yield f"to see the first: study replay {run.folder} {found['cell'][0]}/{found['trial'][0]} --plot worst.png"
