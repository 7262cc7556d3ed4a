"""A summary of an error table in memory, for tests: made group by group, without the parts that a stored one has."""

import pandas as pd

from study.simulation import statistics
from study.simulation.analysis.error_table import label
from study.simulation.experiment.conditions import STORED


def summary(errors, by_decade):
    """Performance measures: a row per group (decade of σ/r, else cell) and estimator, in the order of the table."""
    errors = label(errors, by_decade)
    if by_decade:
        errors = errors.sort_values("decade", kind="stable")
    needed = [*(condition.name for condition in STORED if condition.name in errors), *statistics.NEEDED, "decade"]
    groups = errors.groupby(["group", "estimator"], sort=False, observed=True)
    parts = (((str(g), str(e)), {name: part[name].to_numpy() for name in needed}) for (g, e), part in groups)
    return pd.DataFrame([statistics.row(*key, columns) for key, columns in parts])
