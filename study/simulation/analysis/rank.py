"""Rankings: estimators compared on the same trials, with all marked that cannot be told from the best.

A run is one mechanism. In each of its cells an estimator has two losses: the median of its errors and their root mean
square. A fit without a number is infinitely far off. A ranking is of the mean log loss over the cells, so that a cell
counts the same whatever its noise; the ranking over all runs is of the mean over them. An estimator's loss is given as
its ratio to the loss of the first.

Estimators that may be the best are found by multiple comparisons with the best (Hsu 1984): one stays if its log loss
exceeds that of no other by more than c standard errors of their paired difference. c is the quantile of the largest of
all these differences where the errors of both are swapped in half of the trials, chosen at random: that changes nothing
if the estimators are equal. So an estimator that is the best, alone or with others, loses its mark with a probability
of about 1 - level at most; each comparison in one cell, in one run and over all runs has this level. A trial is swapped
in all cells together, because cells may share draws; runs are independent if their seeds differ.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from study.arrays import Bools, Floats, Ints
from study.files import RunError
from study.fits.random import stream
from study.simulation.analysis.error_table import Grouped
from study.simulation.analysis.regret import by_trial, check_comparable, each_cell
from study.simulation.experiment.measures import jaccard_index
from study.simulation.runs.run_folder import Run
from study.text import columns, listed

WORDS: dict[str, str] = {
    "center": "error of the centre",
    "radius": "error of the radius",
    "disc": "1 - Jaccard index of the fitted and the true disc",
}
"""The errors that estimators may be ranked by, besides the numbers of a study's measures."""
LOSSES = ("median", "rms")
ALL = "all"
"""Name of the ranking over all runs."""
_DRAWS = 1000
"""Draws from which a critical value is found: its own error is 0.06, of a value between 1.6 and 3."""
_GROUPS = 200
"""Groups of trials, by their numbers, that are swapped together, if there are more trials."""
_LARGEST, _LEAST = 1.0 - 1e-12, 1e-300
_ROUNDING = 1e-4
"""Difference of log losses that is none: estimators with the same answer differ by rounding, and by where they stop."""
_FEWEST = 10
"""Trials of a cell that its quantiles need."""


def disc_loss(distance: Floats, radius: Floats, true_radius: Floats) -> Floats:
    """One less the area of the intersection of two discs over that of their union; infinite without a radius.

    Args:
        distance: of the centres.
        radius: of the fitted disc, not a number or infinite where there is none.
        true_radius: of the true disc.
    """
    a, r, s = np.asarray(distance, dtype=float), np.asarray(radius, dtype=float), np.asarray(true_radius, dtype=float)
    known = np.isfinite(a) & np.isfinite(r) & (r > 0.0)
    a, r = np.where(known, a, 0.0), np.where(known, r, s)
    return np.where(known, 1.0 - jaccard_index(a, r, s, 2), np.inf)


def rankings(run: Run) -> list[str]:
    """Losses by which a run's estimators may be ranked: errors, and columns of numbers of the study's measures."""
    return [*WORDS, *(column.name for column in run.study.measured() if column.kind is float)]


def _losses(errors: pd.DataFrame, by: str) -> Floats:
    """The loss of each row of an error table."""
    if by not in WORDS:
        values = errors[by].to_numpy(dtype=float)
        if np.any(values < 0.0):
            least, words = int(np.nanargmin(values)), "losses are 0 or more, and the least is the best"
            raise RunError(f"{by} = {values[least]:g} in cell {errors['cell'].iloc[least]}: {words}")
        return values
    if by == "center":
        return errors["error"].to_numpy(dtype=float)
    away, radius = errors["radius_error"].to_numpy(dtype=float), errors["radius"].to_numpy(dtype=float)
    return np.abs(away) if by == "radius" else disc_loss(errors["error"].to_numpy(dtype=float), radius + away, radius)


class Logs(NamedTuple):
    """Log losses of k estimators, and what they are in random repetitions.

    Attributes:
        values: log losses (k,); infinite where there is none.
        swapped: difference of the log losses of each pair with the errors of both swapped at random (draws, k, k).
        deviations: deviation of each log loss in a repetition of the trials, up to one that all share (draws, k).
    """

    values: Floats
    swapped: Floats
    deviations: Floats

    def error(self, first: int) -> Floats:
        """Standard error of the difference of each log loss to that of one estimator (k,)."""
        return np.asarray(np.std(self.deviations - self.deviations[:, [first]], axis=0))


def signs(name: str) -> Floats:
    """Random signs of a run's groups of trials (draws, groups)."""
    return np.where(stream(0, "rank", name).random((_DRAWS, _GROUPS)) < 0.5, -1.0, 1.0)


def log_losses(distances: Floats, trials: Ints, flips: Floats) -> dict[str, Logs]:
    """The logs of median and root mean square of the errors in a cell.

    If errors are swapped, the sum of a pair's mean squares m and m' stays; half the log of their ratio is the area
    hyperbolic tangent of (m - m')/(m + m'). The median is linearised: a trial contributes (½ - 1{e ≤ median}) times the
    slope of the log quantile function, the difference quotient over ± Bofinger's (1975) width.

    Args:
        distances: errors of k estimators (k, trials), infinite where there is none.
        trials: the trials' numbers.
        flips: signs (draws, groups).
    """
    distances, place = np.unique(distances, axis=0, return_inverse=True)  # equal estimators have equal answers
    place, count = place.ravel(), distances.shape[1]
    width = min(0.648 * count**-0.2, 0.49)
    with np.errstate(divide="ignore", invalid="ignore"):
        levels = np.quantile(distances, [0.5 - width, 0.5, 0.5 + width], axis=1, method="lower")
        low, median, high = np.log(np.maximum(levels, _LEAST))
        slope = np.where(np.isfinite(high), 0.5 * (high - low), median - low) / width
        steps = (0.5 - (distances <= levels[1][:, None])) * slope[:, None] / count
        square = np.maximum(np.mean(distances**2, axis=1), _LEAST)
        ratios = distances**2 / square[:, None] / count
    parts = np.vstack([steps, ratios])
    parts = np.array(
        [np.bincount(trials % _GROUPS, row, _GROUPS) for row in np.nan_to_num(parts, posinf=0.0, neginf=0.0)]
    )
    draws = flips @ np.ascontiguousarray(parts.T)
    of_median, of_ratio = draws[:, place], draws[:, len(steps) + place]
    with np.errstate(invalid="ignore"):
        shares = square[place, None] / (square[place, None] + square[place])
        contrast = of_ratio[:, :, None] * shares - of_ratio[:, None, :] * (1.0 - shares)
    contrast = np.arctanh(np.clip(np.nan_to_num(contrast), -_LARGEST, _LARGEST))
    return {
        "median": Logs(median[place], of_median[:, :, None] - of_median[:, None, :], of_median),
        "rms": Logs(0.5 * np.log(square[place]), contrast, 0.5 * of_ratio),
    }


class MeanLog:
    """The mean of log losses over cells, or over runs, which are added one by one.

    One in which no estimator has a loss is left out; other infinite values stay infinite.
    """

    def __init__(self) -> None:
        self._total, self._count = list[Floats](), 0

    def add(self, part: Logs) -> None:
        """Add a cell or a run."""
        known = bool(np.isfinite(part.values).any())
        if known and self._count:
            self._total = [np.add(*pair) for pair in zip(self._total, part, strict=True)]
        elif known or not self._total:
            self._total = list(part)
        self._count += known

    def mean(self) -> Logs:
        """The mean of what was added."""
        return Logs(*(total / max(self._count, 1) for total in self._total))


def may_be_best(logs: Logs, level: float = 0.95) -> Bools:
    """The estimators that cannot be told from the best at a level (k,).

    If no estimator has a loss, all may be.
    """
    finite = np.flatnonzero(np.isfinite(logs.values))
    if not len(finite):
        return np.ones(len(logs.values), dtype=bool)
    result = np.zeros(len(logs.values), dtype=bool)
    values = logs.values[finite]
    for i, estimator in enumerate(finite):
        draws = logs.swapped[:, estimator, finite]
        spread = np.sqrt(np.mean(draws**2, axis=0))
        other = spread > _ROUNDING
        critical = np.quantile((draws[:, other] / spread[other]).max(axis=1), level) if other.any() else 0.0
        result[estimator] = np.all(values[i] - values <= critical * spread + _ROUNDING)
    return result


@dataclass(frozen=True)
class Mechanism:
    """The losses of one run's estimators.

    Attributes:
        name: of the run.
        estimators: names of the k estimators.
        cells: number of its cells.
        trials: largest number of trials of a cell.
        logs: mean log losses over the cells, by loss.
        marked: of each cell the estimators that may be the best (cells, k), by loss.
        failures: share of each estimator's fits without a number (k,).
        seconds: per fit, the median over the units of work (k,); not a number where it is not known.
    """

    name: str
    estimators: list[str]
    cells: int
    trials: int
    logs: dict[str, Logs]
    marked: dict[str, Bools]
    failures: Floats
    seconds: Floats


def compared(
    errors: Iterable[pd.DataFrame], estimators: Sequence[str], name: str = "", level: float = 0.95
) -> Mechanism:
    """Compare the estimators of an error table with the best, in each cell and over the cells.

    Args:
        errors: cell, trial, estimator and error, which is the loss of a fit; in parts of whole cells.
        estimators: names of the estimators that are compared.
        name: of the run.
        level: of each comparison with the best.

    Raises:
        RunError: if a cell has fewer than ten trials.
    """
    names, flips = list(estimators), signs(name)
    means, marked = {loss: MeanLog() for loss in LOSSES}, {loss: list[Bools]() for loss in LOSSES}
    lost, counts = np.zeros(len(names)), list[int]()
    for cell, part in each_cell(errors):
        distances, trials = by_trial(part, names)
        if len(trials) < _FEWEST:
            raise RunError(f"cell {cell}: {len(trials)} trials; a ranking needs at least {_FEWEST}")
        for loss, logs in log_losses(distances, trials, flips).items():
            means[loss].add(logs)
            marked[loss].append(may_be_best(logs, level))
        lost += np.isinf(distances).sum(axis=1)
        counts.append(len(trials))
    return Mechanism(
        name,
        names,
        len(counts),
        max(counts),
        {loss: mean.mean() for loss, mean in means.items()},
        {loss: np.array(cells) for loss, cells in marked.items()},
        lost / sum(counts),
        np.full(len(names), np.nan),
    )


def of_run(run: Run, by: str = "center", level: float = 0.95) -> Mechanism:
    """Compare the estimators of a finished run; see `compared`.

    Raises:
        RunError: if the run is not a grid of several estimators with its errors, or not of circles for discs, or a
            measure is negative.
        ValueError: if errors cannot be ranked by that, or the level is no share.
    """
    if by not in (known := rankings(run)):
        raise ValueError(f"by = {by!r}: errors are ranked by {', '.join(map(repr, known))}")
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level}: give a number between 0 and 1, such as 0.95")
    check_comparable(run, "a ranking")
    if by == "disc" and run.study.dimension != 2:
        raise RunError(
            f"{run.folder}: dimension = {run.study.dimension}: discs are of circles; rank by center or radius"
        )
    needed = ["error", "radius_error", "radius"] if by in WORDS else [by]
    parts = Grouped(run).cells(["cell", "trial", "estimator", *needed])
    losses = (part.assign(error=_losses(part, by)) for part in parts)
    result = compared(losses, run.study.estimators, run.study.run_name(), level)
    timings = run.table("timings", ["step", "fits", "seconds"]).astype({"step": str})
    seconds = (timings["seconds"] / timings["fits"]).groupby(timings["step"]).median()  # one may have waited
    result.seconds[:] = seconds.reindex(result.estimators).to_numpy(dtype=float)
    return result


def over_all(mechanisms: Sequence[Mechanism]) -> Mechanism | None:
    """The mechanisms as one, each of the same weight, for the estimators of all of them; None if these are too few."""
    first, *others = mechanisms
    shared = [name for name in first.estimators if all(name in one.estimators for one in others)]
    if len(shared) < 2:
        return None
    rows = [[one.estimators.index(name) for name in shared] for one in mechanisms]
    means = {loss: MeanLog() for loss in LOSSES}
    for one, row in zip(mechanisms, rows, strict=True):
        for loss, (values, swapped, deviations) in one.logs.items():
            means[loss].add(Logs(values[row], swapped[:, row][:, :, row], deviations[:, row]))
    logs = {loss: mean.mean() for loss, mean in means.items()}
    marked = {
        loss: np.concatenate([one.marked[loss][:, row] for one, row in zip(mechanisms, rows, strict=True)])
        for loss in LOSSES
    }
    weights = np.array([one.cells for one in mechanisms], dtype=float)
    failures = np.array([one.failures[row] for one, row in zip(mechanisms, rows, strict=True)])
    seconds = np.array([one.seconds[row] for one, row in zip(mechanisms, rows, strict=True)])
    cells, trials = int(weights.sum()), max(one.trials for one in mechanisms)
    return Mechanism(
        ALL, shared, cells, trials, logs, marked, np.average(failures, axis=0, weights=weights), seconds.mean(axis=0)
    )


def _ranking(mechanism: Mechanism, level: float) -> pd.DataFrame:
    """A row per estimator, the first by its median before the others; see `ranked` for the columns."""
    table: dict[str, object] = {"run": mechanism.name, "estimator": mechanism.estimators, "cells": mechanism.cells}
    table["trials"] = mechanism.trials
    for loss in LOSSES:
        logs, marked = mechanism.logs[loss], mechanism.marked[loss]
        first = int(np.argmin(logs.values))
        with np.errstate(invalid="ignore", over="ignore"):
            ratio = np.exp(logs.values - logs.values[first])
        known = np.isfinite(ratio)
        table[loss] = np.where(known, ratio, np.inf)
        table[f"{loss}_error"] = np.where(known, ratio * logs.error(first), np.inf)
        table[f"{loss}_best"] = may_be_best(logs, level)
        table[f"{loss}_cells"] = marked.sum(axis=0)
        table[f"{loss}_alone"] = (marked & (marked.sum(axis=1) == 1)[:, None]).sum(axis=0)
    table |= {"failures": mechanism.failures, "seconds": mechanism.seconds}
    return pd.DataFrame(table).sort_values(["median", "rms", "failures"], kind="stable", ignore_index=True)


def ranked(mechanisms: Sequence[Mechanism], level: float = 0.95) -> pd.DataFrame:
    """Rank estimators over the cells of each mechanism and, of several, over all.

    Args:
        mechanisms: of one run each.
        level: of each comparison with the best.

    Returns:
        A row per run and estimator, best first: ``run`` ("all" for all runs), ``estimator``, ``cells``, ``trials``,
        and of the ``median`` and the ``rms`` the geometric mean over the cells over that of the first estimator, its
        Monte-Carlo standard error (``…_error``), whether the estimator may be the best (``…_best``), the number of
        cells in which it may be (``…_cells``) and in which it alone may be (``…_alone``); then the share of
        ``failures``, fits without a number, and ``seconds`` per fit.

    Raises:
        RunError: if a run is given twice.
    """
    names = [one.name for one in mechanisms]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise RunError(f"{listed(twice)}: given twice; a ranking over all runs takes each once")
    whole = over_all(mechanisms) if len(mechanisms) > 1 else None
    tables = [_ranking(one, level) for one in [*mechanisms, *([whole] if whole else [])]]
    return pd.concat(tables, ignore_index=True)


def printed(table: pd.DataFrame, by: str, level: float) -> Iterator[str]:
    """The table of `ranked` for a terminal."""
    loss = WORDS.get(by, f"{by} (the least is the best; a failure has no finite number of it)")
    yield f"{loss}: geometric means over cells, divided by the least, ± Monte-Carlo error"
    yield f"*: cannot be told from the best at {100.0 * level:g} %; cells: where that holds, in brackets where it alone"
    for name, part in table.groupby("run", sort=False):
        yield ""
        count, trials = int(part["cells"].iloc[0]), int(part["trials"].iloc[0])
        yield f"{name}: {count} cell{'s' * (count != 1)}, {trials:,} trials"
        rows = []
        for row in part.to_dict("records"):
            texts = [str(row["estimator"])]
            for loss in LOSSES:
                number = f"{row[loss]:.3f} ± {row[f'{loss}_error']:.3f}" if np.isfinite(row[loss]) else "inf"
                texts += [f"{number}{' *' if row[f'{loss}_best'] else '  '}"]
                texts += [f"{row[f'{loss}_cells']} ({row[f'{loss}_alone']})"]
            cost = f"{1e3 * row['seconds']:.3g} ms" if np.isfinite(row["seconds"]) else "-"
            rows.append([*texts, f"{100.0 * row['failures']:.2g} %", cost])
        yield from columns(rows, ["", "median", "cells", "rms", "cells", "failures", "a fit"], "<>")
        if name == ALL and (others := set(table["estimator"]) - set(part["estimator"])):
            yield f"not in every run: {', '.join(sorted(others))}"
