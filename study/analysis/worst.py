"""The worst trials of a run: where an estimator said ok and yet was farthest from the truth."""

import numpy as np
import pandas as pd

from study.estimators import Status


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
