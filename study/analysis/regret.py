"""Regret of an estimator: its error over that of the best estimator in each cell of a grid, and the mean over cells.

No estimator is the best in every cell, and a user does not know which cell the data are from. An estimator of small
regret is never far from the best. Errors are taken as they come, whatever the status; a fit without a number counts as
worse than any. Means over cells are geometric. Monte-Carlo errors are those of a jackknife over groups of trials:
trials that share draws are left out together, in all cells.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from study.experiment.conditions import named_in
from study.runs.storage.atomic_write import RunError
from study.runs.storage.run_folder import Run
from study.sphere.types import Floats, Ints
from study.text.columns import columns

QUANTILES = {"median": 0.5, "q95": 0.95}
_GROUPS = 10
"""Groups of trials, one of which is left out at a time."""


class CellErrors(NamedTuple):
    """Errors of all estimators in a cell.

    Attributes:
        cell: name of the cell.
        samples: number of samples N.
        errors: distances of the fitted from the true centre (estimators, trials), infinite where there is none.
        groups: number of each trial's group (trials,).
    """

    cell: str
    samples: int
    errors: Floats
    groups: Ints


def cells_of(errors: pd.DataFrame, estimators: list[str]) -> Iterator[CellErrors]:
    """The cells of an error table that has a row per trial and estimator."""
    for name, part in errors.groupby("cell", observed=True, sort=False):
        trials, column = np.unique(part["trial"].to_numpy(), return_inverse=True)
        row = pd.Index(estimators).get_indexer(pd.Index(part["estimator"].astype(str)))
        values = np.full((len(estimators), len(trials)), np.inf)
        found, known = part["error"].to_numpy(dtype=float), row >= 0
        values[row[known], column[known]] = np.nan_to_num(found[known], nan=np.inf, posinf=np.inf)
        yield CellErrors(str(name), int(part["samples"].iloc[0]), values, trials % _GROUPS)


def by_cell(errors: pd.DataFrame, estimators: list[str]) -> pd.DataFrame:
    """Regret in each cell.

    Args:
        errors: the error table: cell, samples, trial, estimator and error.
        estimators: names of the estimators that are compared.

    Returns:
        A row per cell and estimator: ``cell``, ``samples``, ``estimator``, and the median and the 95 % quantile of the
        error over the least among the estimators (``median``, ``q95``), also without each group of trials
        (``median_0`` …). Cells in which no estimator has an answer at the quantile are not a number.
    """
    rows = []
    for cell in cells_of(errors, estimators):
        kept = [np.ones(len(cell.groups), dtype=bool), *(cell.groups != g for g in range(_GROUPS))]
        if min(map(np.sum, kept)) == 0:
            raise RunError(f"cell {cell.cell}: {len(cell.groups)} trials; regret needs at least 2")
        found: dict[str, Floats] = {}
        for place, chosen in enumerate(kept):
            levels = np.quantile(cell.errors[:, chosen], list(QUANTILES.values()), axis=1, method="lower")
            with np.errstate(invalid="ignore"):
                ratios = levels / levels.min(axis=1, keepdims=True)
            for name, values in zip(QUANTILES, ratios, strict=True):
                found[name if place == 0 else f"{name}_{place - 1}"] = values
        for index, estimator in enumerate(estimators):
            numbers = {name: float(values[index]) for name, values in found.items()}
            rows.append({"cell": cell.cell, "samples": cell.samples, "estimator": estimator, **numbers})
    return pd.DataFrame(rows)


def regret(cells: pd.DataFrame) -> pd.DataFrame:
    """Mean regret of each estimator, over all cells and over those of each number of samples.

    Args:
        cells: the table of `by_cell`.

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
                means = np.array([_geometric(used[column]) for column in [name, *_left_out(name)]])
                error = math.inf
                if np.isfinite(means).all():
                    error = math.sqrt(np.sum((means[1:] - means[1:].mean()) ** 2) * (_GROUPS - 1.0) / _GROUPS)
                row |= {name: means[0], f"{name}_error": error, f"{name}_worst": used[name].max()}
            rows.append(row)
    return pd.DataFrame(rows)


def _left_out(name: str) -> list[str]:
    return [f"{name}_{group}" for group in range(_GROUPS)]


def _geometric(ratios: "pd.Series[float]") -> float:
    return float(np.exp(np.log(ratios).mean()))


def of_run(run: Run) -> pd.DataFrame:
    """The table of `by_cell` of a finished run.

    Raises:
        RunError: if the run is not finished, has no error table, is not a grid, or has one estimator only.
    """
    if run.study.design.kind != "grid":
        raise RunError(f'{run.folder}: regret needs many trials of each condition: kind = "grid" in the config')
    if run.study.keep != "errors":
        raise RunError(f'{run.folder}: regret needs every error: keep = "errors" in the config')
    if len(run.study.estimators) < 2:
        raise RunError(f"{run.folder}: regret compares estimators: list more than one in the config")
    used = ["cell", "samples", "trial", "estimator", "error"]
    return by_cell(run.table("errors", used), list(run.study.estimators))


def printed(run: Run, table: pd.DataFrame) -> Iterator[str]:
    """The table of `regret` for a terminal."""
    whole, conditions = table[table["samples"] == 0], named_in([c.name for c in run.study.conditions()])
    varied = ", ".join(condition.symbol for condition in conditions)
    yield f"{run.study.run_name()}: error of the centre over that of the best estimator in each cell of {varied}"
    yield f"geometric means over {whole['cells'].max()} cells; the largest in brackets"
    sizes = [int(n) for n in table["samples"].unique() if n]
    rows = []
    for row in whole.sort_values("median", kind="stable").to_dict("records"):
        mine = table[table["estimator"] == row["estimator"]].set_index("samples")
        texts = [f"{row[name]:.3f} ± {row[f'{name}_error']:.3f} ({row[f'{name}_worst']:.2f})" for name in QUANTILES]
        by_samples = [f"{mine.loc[n, 'median']:.3f} / {mine.loc[n, 'q95']:.3f}" for n in sizes]
        rows.append([row["estimator"], *texts, *by_samples])
    yield from columns(rows, ["", "median", "95 % quantile", *(f"N = {n}" for n in sizes)], "<>")
