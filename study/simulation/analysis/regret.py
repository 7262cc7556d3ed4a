"""Regret: the error of an estimator over that of the best estimator in each cell of a grid, and its mean over cells.

No estimator is the best in every cell, and a user does not know which cell the data are from; an estimator of small
regret is never far from the best. Errors are taken as they come, whatever the status; a fit without a number counts as
worse than any. Means over cells are geometric. Monte-Carlo errors are those of a jackknife over groups of trials:
trials that share draws are left out together, in all cells.
"""

import math
from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd

from study.arrays import Floats, Ints
from study.files import RunError
from study.simulation.analysis.error_table import Grouped
from study.simulation.analysis.summary import chosen_rows
from study.simulation.experiment.conditions import named_in
from study.simulation.runs.run_folder import Run
from study.text import columns

NEEDED = ("cell", "samples", "trial", "estimator", "error")
"""Columns of the error table that regret is made of."""
QUANTILES = {"median": 0.5, "q95": 0.95}
_GROUPS = 10
"""Groups of trials, one of which is left out at a time."""


def each_cell(errors: Iterable[pd.DataFrame]) -> Iterator[tuple[str, pd.DataFrame]]:
    """Names and rows of the cells of an error table in parts of whole cells."""
    for part in errors:
        for cell, rows in part.groupby("cell", observed=True, sort=False):
            yield str(cell), rows


def by_trial(part: pd.DataFrame, estimators: list[str]) -> Iterator[tuple[str, Floats, Ints]]:
    """Of each cell of a part its name, its errors (estimators, trials), infinite where there is none, and its trials.

    The columns become arrays once for all cells: pandas takes longer for a cell than its numbers do.
    """
    place, cells = pd.factorize(part["cell"])
    named = pd.Categorical(part["estimator"])
    row = pd.Index(estimators).get_indexer(named.categories)[named.codes]
    used = np.flatnonzero(row >= 0)
    used = used[np.argsort(place[used], kind="stable")]
    ends = np.searchsorted(place[used], np.arange(len(cells) + 1))
    row, trial = row[used], part["trial"].to_numpy()[used]
    error = np.nan_to_num(part["error"].to_numpy(dtype=float)[used], nan=np.inf, posinf=np.inf)
    for cell, rows in zip(cells, map(slice, ends, ends[1:]), strict=False):
        trials, column = np.unique(trial[rows], return_inverse=True)
        distances = np.full((len(estimators), len(trials)), np.inf)
        distances[row[rows], column] = error[rows]
        yield str(cell), distances, trials


def by_cell(errors: Iterable[pd.DataFrame], estimators: list[str]) -> pd.DataFrame:
    """Regret in each cell.

    Args:
        errors: the error table in parts of whole cells: the columns `NEEDED`.
        estimators: names of the estimators that are compared.

    Returns:
        A row per cell and estimator: ``cell``, ``samples``, ``estimator``, and the median and the 95 % quantile of the
        error over the least among the estimators (``median``, ``q95``), also without each group of trials
        (``median_0`` …). Cells in which no estimator has an answer at the quantile are not a number.
    """
    cells, levels = list[tuple[str, int]](), list[Floats]()
    for part in errors:
        samples = part.drop_duplicates("cell").set_index("cell")["samples"]
        for cell, distances, trials in by_trial(part, estimators):
            if len(np.unique(trials % _GROUPS)) < 2:
                raise RunError(f"cell {cell}: {len(trials)} trials; regret needs at least 2")
            cells.append((cell, int(samples[cell])))
            levels.append(_levels(distances, trials % _GROUPS))
    with np.errstate(invalid="ignore"):
        ratios = np.array([level / level.min(axis=2, keepdims=True) for level in levels])
    names = np.repeat([cell for cell, _ in cells], len(estimators))
    result = {"cell": names, "samples": np.repeat([samples for _, samples in cells], len(estimators))}
    result["estimator"] = np.tile(estimators, len(cells))
    for number, ending in enumerate(["", *(f"_{group}" for group in range(_GROUPS))]):
        result |= {f"{name}{ending}": ratios[:, number, place].ravel() for place, name in enumerate(QUANTILES)}
    return pd.DataFrame(result)


def _levels(distances: Floats, groups: Ints) -> Floats:
    """Quantiles of the errors in a cell, of all trials and without each group (1 + groups, quantiles, estimators)."""
    order = np.argsort(distances, axis=1)
    ordered, group_of = np.take_along_axis(distances, order, axis=1), groups[order]
    result = []
    for left_out in (-1, *range(_GROUPS)):
        kept = ordered[group_of != left_out].reshape(len(ordered), -1)
        ranks = [int(p * (kept.shape[1] - 1)) for p in QUANTILES.values()]
        result.append(kept[:, ranks].T)
    return np.array(result)


def regret(cells: pd.DataFrame) -> pd.DataFrame:
    """Mean regret of each estimator, over all cells and over those of each number of samples.

    Args:
        cells: the table of `by_cell` or of `of_summary`.

    Returns:
        A row per number of samples and estimator: ``samples`` (0 for all), ``estimator``, ``cells``, and of the
        ``median`` and the ``q95`` the geometric mean over the cells, its Monte-Carlo standard error (``…_error``) and
        the largest (``…_worst``). They are infinite for an estimator without an answer in a cell in which another has
        one.
    """
    rows = []
    for samples in [0, *sorted(cells["samples"].unique())]:
        chosen = cells if samples == 0 else cells[cells["samples"] == samples]
        for estimator, part in chosen.groupby("estimator", observed=True, sort=False):
            row: dict[str, float | str] = {"samples": int(samples), "estimator": str(estimator), "cells": len(part)}
            for name in QUANTILES:
                used = part[part[name].notna()]
                named = [name, *(f"{name}_{group}" for group in range(_GROUPS))]
                means = np.exp(np.log(used[named if named[1] in used else [name]]).mean().to_numpy())
                error = math.inf
                if np.isfinite(means).all() and len(means) == 1:
                    error = means[0] * float(np.linalg.norm(used[f"{name}_error"] / used[name])) / len(used)
                elif np.isfinite(means).all():
                    error = math.sqrt(np.sum((means[1:] - means[1:].mean()) ** 2) * (_GROUPS - 1.0) / _GROUPS)
                row |= {name: means[0], f"{name}_error": error, f"{name}_worst": used[name].max()}
            rows.append(row)
    return pd.DataFrame(rows)


def check_comparable(run: Run, what: str) -> None:
    """Raise RunError unless a run has the errors of several estimators in many trials of each condition."""
    if run.study.design.kind != "grid":
        raise RunError(f'{run.folder}: {what} needs many trials of each condition: kind = "grid" in the config')
    if run.study.keep != "errors":
        raise RunError(f'{run.folder}: {what} needs every error: keep = "errors" in the config')
    if len(run.study.estimators) < 2:
        raise RunError(f"{run.folder}: {what} compares estimators: list more than one in the config")


def of_run(run: Run, where: Iterable[str] = ()) -> pd.DataFrame:
    """The table of `by_cell` of a finished run.

    Args:
        run: the run.
        where: texts that choose cells, see `chosen_rows`; all if there are none.

    Raises:
        RunError: if the run is not finished, has no error table, is not a grid, or has one estimator only.
        ValueError: if no cell has the values.
    """
    check_comparable(run, "regret")
    only = set(chosen_rows(run, where)["group"]) if where else None
    return by_cell(Grouped(run).cells(NEEDED, only), list(run.study.estimators))


def of_summary(summary: pd.DataFrame) -> pd.DataFrame:
    """Regret in each cell by the medians and quantiles of a summary, for a run that keeps no errors.

    Their Monte-Carlo errors (``median_error``, ``q95_error``) are taken as independent: they are too large where
    estimators had the same trials, and too small where cells share their draws.

    Args:
        summary: the summary table of a grid.

    Returns:
        A row per cell and estimator, as `by_cell`, with these errors in place of the groups.
    """
    columns = {"cell": summary["group"].astype(str), "samples": summary["samples"].astype(int)}
    table = pd.DataFrame(columns | {"estimator": summary["estimator"].astype(str)})
    for name in QUANTILES:
        value, error = summary[f"ratio_{name}"].fillna(np.inf), summary[f"ratio_{name}_error"]
        with np.errstate(invalid="ignore"):
            table[name] = value / value.groupby(table["cell"]).transform("min")
            table[f"{name}_error"] = table[name] * error / value
    return table


def printed(run: Run, table: pd.DataFrame) -> Iterator[str]:
    """The table of `regret` for a terminal."""
    whole, conditions = table[table["samples"] == 0], named_in([c.name for c in run.study.conditions()])
    varied = ", ".join(condition.symbol for condition in conditions)
    yield f"{run.study.run_name()}: error of the centre over that of the best estimator in each cell of {varied}"
    count = int(whole["cells"].max())
    yield f"geometric means over {count:,} cell{'s' * (count != 1)}; the largest in brackets"
    sizes = [int(n) for n in table["samples"].unique() if n]
    rows = []
    for row in whole.sort_values("median", kind="stable").to_dict("records"):
        mine = table[table["estimator"] == row["estimator"]].set_index("samples")
        texts = [f"{row[name]:.3f} ± {row[f'{name}_error']:.3f} ({row[f'{name}_worst']:.2f})" for name in QUANTILES]
        by_samples = [f"{mine.loc[n, 'median']:.3f} / {mine.loc[n, 'q95']:.3f}" for n in sizes]
        rows.append([row["estimator"], *texts, *by_samples])
    yield from columns(rows, ["", "median", "95 % quantile", *(f"N = {n}" for n in sizes)], "<>")
