"""Rankings: estimators compared on the same trials, with all marked that cannot be told from the best.

A run is one mechanism, or the errors of a table that say so. In each of its cells an estimator has two losses: the
median of its errors and their root mean square. A fit without a number is infinitely far off. A ranking is of the mean
log loss over the cells, so that a cell counts the same whatever its noise; the ranking over all runs is of the mean
over them, first of those of a kind of data. An estimator's loss is given as its ratio to the loss of the first of those
that are given the same.

Estimators that may be the best are found by multiple comparisons with the best (Hsu 1984): one stays if its log loss
exceeds that of no other by more than c standard errors of their paired difference. c is the quantile of the largest of
all these differences where the errors of both are swapped in half of the trials, chosen at random: that changes nothing
if the estimators are equal. So an estimator that is the best, alone or with others, loses its mark with a probability
of about 1 - level at most; each comparison in one cell, in one run and over all runs has this level. A trial is swapped
in all cells together, because cells may share draws; runs are independent if their seeds differ.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from study.arrays import Bools, Floats, Ints
from study.files import RunError
from study.fits.loops.random import stream
from study.simulation.analysis.losses import GIVEN, WORDS, Losses
from study.simulation.analysis.regret import by_trial
from study.text import columns, listed

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

    def only(self, rows: Ints) -> "Logs":
        """Those of some estimators."""
        return Logs(self.values[rows], self.swapped[:, rows][:, :, rows], self.deviations[:, rows])


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
    (one, other), squares = np.triu_indices(len(place), 1), square[place]
    with np.errstate(invalid="ignore"):
        shares = squares[one] / (squares[one] + squares[other])
        pairs = of_ratio[:, one] * shares - of_ratio[:, other] * (1.0 - shares)
    contrast = np.zeros((len(flips), len(place), len(place)))
    contrast[:, one, other] = np.arctanh(np.clip(np.nan_to_num(pairs), -_LARGEST, _LARGEST))
    contrast[:, other, one] = -contrast[:, one, other]
    return {
        "median": Logs(median[place], of_median[:, :, None] - of_median[:, None, :], of_median),
        "rms": Logs(0.5 * np.log(squares), contrast, 0.5 * of_ratio),
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
    result = np.full(len(logs.values), not len(finite))
    if len(finite):
        values, swapped = logs.values[finite], logs.swapped[:, finite][:, :, finite]
        spread = np.sqrt(np.mean(swapped**2, axis=0))
        other = spread > _ROUNDING
        largest = np.where(other, swapped / np.where(other, spread, 1.0), -np.inf).max(axis=2)
        critical = np.quantile(np.where(other.any(axis=1), largest, 0.0), level, axis=0)
        result[finite] = (values[:, None] - values <= critical[:, None] * spread + _ROUNDING).all(axis=1)
    return result


@dataclass(frozen=True)
class Mechanism:
    """A mechanism's methods, compared.

    Attributes:
        name: of the mechanism.
        estimators: names of the k estimators.
        cells: number of its cells.
        trials: largest number of trials of a cell.
        logs: mean log losses over the cells, by loss.
        marked: of each cell the estimators that may be the best of those that are given the same (cells, k), by loss.
        failures: share of each estimator's fits without a number (k,).
        seconds: per fit, the median over the units of work (k,); not a number where it is not known.
        given: what each estimator is given (k,), a key of `losses.GIVEN`; empty where it is not known.
        dimension: 2 for circles, 3 for spheres, 0 if it is not known.
        kind: of the data, such as clutter; empty if it is not known.
    """

    name: str
    estimators: list[str]
    cells: int
    trials: int
    logs: dict[str, Logs]
    marked: dict[str, Bools]
    failures: Floats
    seconds: Floats
    given: list[str]
    dimension: int = 0
    kind: str = ""


def _classes(given: Sequence[str]) -> dict[str, Ints]:
    """Numbers of the estimators that are given the same, by what that is: points alone first."""
    order = [*(name for name in GIVEN if name in given), *sorted(set(given) - set(GIVEN))]
    return {name: np.flatnonzero(np.array(given) == name) for name in order}


def compared(losses: Losses, level: float = 0.95) -> Mechanism:
    """Compare the methods of a mechanism with the best, in each cell and over the cells.

    Args:
        losses: of the methods.
        level: of each comparison with the best.

    Raises:
        RunError: if a cell has fewer than ten trials.
        ValueError: if the level is no share.
    """
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level}: give a number between 0 and 1, such as 0.95")
    names, flips = list(losses.methods), signs(losses.draws or losses.name)
    given = [losses.given.get(name, "") for name in names]
    means, marked = {loss: MeanLog() for loss in LOSSES}, {loss: list[Bools]() for loss in LOSSES}
    lost, counts = np.zeros(len(names)), list[int]()
    for cell, distances, trials in chain.from_iterable(by_trial(part, names) for part in losses.parts):
        if len(trials) < _FEWEST:
            raise RunError(f"cell {cell}: {len(trials)} trials; a ranking needs at least {_FEWEST}")
        for loss, logs in log_losses(distances, trials, flips).items():
            means[loss].add(logs)
            best = np.zeros(len(names), dtype=bool)
            for rows in _classes(given).values():
                best[rows] = may_be_best(logs.only(rows), level)
            marked[loss].append(best)
        lost += np.isinf(distances).sum(axis=1)
        counts.append(len(trials))
    return Mechanism(
        losses.name,
        names,
        len(counts),
        max(counts),
        {loss: mean.mean() for loss, mean in means.items()},
        {loss: np.array(cells) for loss, cells in marked.items()},
        lost / sum(counts),
        np.array([losses.seconds.get(name, np.nan) for name in names]),
        given,
        losses.dimension,
        losses.kind,
    )


def over_all(mechanisms: Sequence[Mechanism], name: str = ALL) -> Mechanism | None:
    """The mechanisms as one, each of the same weight, for the estimators of all of them; None if these are too few."""
    first, *others = mechanisms
    shared = [name for name in first.estimators if all(name in one.estimators for one in others)]
    if len(shared) < 2:
        return None
    rows = [np.array([one.estimators.index(name) for name in shared]) for one in mechanisms]
    means = {loss: MeanLog() for loss in LOSSES}
    for one, row in zip(mechanisms, rows, strict=True):
        for loss, logs in one.logs.items():
            means[loss].add(logs.only(row))
    marked = {
        loss: np.concatenate([one.marked[loss][:, row] for one, row in zip(mechanisms, rows, strict=True)])
        for loss in LOSSES
    }
    weights = np.array([one.cells for one in mechanisms], dtype=float)
    failures = np.array([one.failures[row] for one, row in zip(mechanisms, rows, strict=True)])
    seconds = np.array([one.seconds[row] for one, row in zip(mechanisms, rows, strict=True)])
    return replace(
        first,
        name=name,
        estimators=shared,
        cells=int(weights.sum()),
        trials=max(one.trials for one in mechanisms),
        logs={loss: mean.mean() for loss, mean in means.items()},
        marked=marked,
        failures=np.average(failures, axis=0, weights=weights),
        seconds=seconds.mean(axis=0),
        given=[first.given[row] for row in rows[0]],
    )


def _with_wholes(mechanisms: Sequence[Mechanism]) -> Iterator[Mechanism]:
    """The mechanisms, those of each kind as one, and all, each kind counting the same; circles and spheres apart."""
    yield from mechanisms
    dimensions = list(dict.fromkeys(one.dimension for one in mechanisms))
    for dimension in dimensions:
        of = {2: "circles", 3: "spheres"}.get(dimension, "others") if len(dimensions) > 1 else ""
        kinds: dict[str, list[Mechanism]] = {}
        for one in mechanisms:
            if one.dimension == dimension:
                kinds.setdefault(one.kind or one.name, []).append(one)
        wholes = []
        for kind, same in kinds.items():
            whole = over_all(same, ", ".join(filter(None, [kind, of]))) if len(same) > 1 else same[0]
            wholes += [whole] if whole else []
            yield from [whole] if whole and len(same) > 1 else []
        if len(wholes) > 1 and (whole := over_all(wholes, ", ".join(filter(None, [ALL, of])))):
            yield whole


def _ranking(mechanism: Mechanism, level: float) -> Iterator[pd.DataFrame]:
    """A row per estimator, the first by its median before the others given the same; see `ranked` for the columns."""
    for given, rows in _classes(mechanism.given).items():
        names = np.array(mechanism.estimators)[rows]
        table: dict[str, object] = {"run": mechanism.name, "estimator": names, "cells": mechanism.cells}
        table["trials"] = mechanism.trials
        for loss in LOSSES:
            logs, marked = mechanism.logs[loss].only(rows), mechanism.marked[loss][:, rows]
            first = int(np.argmin(logs.values))
            with np.errstate(invalid="ignore", over="ignore"):
                ratio = np.exp(logs.values - logs.values[first])
            known = np.isfinite(ratio)
            table[loss] = np.where(known, ratio, np.inf)
            table[f"{loss}_error"] = np.where(known, ratio * logs.error(first), np.inf)
            table[f"{loss}_best"] = may_be_best(logs, level)
            table[f"{loss}_cells"] = marked.sum(axis=0)
            table[f"{loss}_alone"] = (marked & (marked.sum(axis=1) == 1)[:, None]).sum(axis=0)
        table |= {"failures": mechanism.failures[rows], "seconds": mechanism.seconds[rows], "given": given}
        yield pd.DataFrame(table).sort_values(["median", "rms", "failures"], kind="stable", ignore_index=True)


def ranked(mechanisms: Sequence[Mechanism], level: float = 0.95) -> pd.DataFrame:
    """Rank estimators over the cells of each mechanism and, of several, over those of a kind and over all.

    Args:
        mechanisms: of one run or table each.
        level: of each comparison with the best.

    Returns:
        A row per run and estimator, best first of those that are given the same: ``run`` ("all" for all runs),
        ``estimator``, ``cells``, ``trials``,
        and of the ``median`` and the ``rms`` the geometric mean over the cells over that of the first estimator, its
        Monte-Carlo standard error (``…_error``), whether the estimator may be the best (``…_best``), the number of
        cells in which it may be (``…_cells``) and in which it alone may be (``…_alone``); then the share of
        ``failures``, fits without a number, ``seconds`` per fit, and what it is ``given``, where that is known.

    Raises:
        RunError: if a run is given twice.
    """
    names = [one.name for one in mechanisms]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise RunError(f"{listed(twice)}: given twice; a ranking over all runs takes each once")
    tables = [table for one in _with_wholes(mechanisms) for table in _ranking(one, level)]
    result = pd.concat(tables, ignore_index=True)
    return result if result["given"].any() else result.drop(columns="given")


def _words(row: Mapping[Any, Any]) -> list[str]:
    """Losses with their marks, cells, failures and time of a row of `ranked`."""
    texts = []
    for loss in LOSSES:
        number = f"{row[loss]:.3f} ± {row[f'{loss}_error']:.3f}" if np.isfinite(row[loss]) else "inf"
        mark = " *" if row[f"{loss}_best"] else "  "
        texts += [number + mark, f"{row[f'{loss}_cells']} ({row[f'{loss}_alone']})"]
    cost = f"{1e3 * row['seconds']:.3g} ms" if np.isfinite(row["seconds"]) else "-"
    return [*texts, f"{100.0 * row['failures']:.2g} %", cost]


TITLES = ["median", "cells", "rms", "cells", "failures", "a fit"]


def explained(by: str, level: float) -> list[str]:
    """Sentences on the numbers and marks of a ranking."""
    loss = WORDS.get(by, f"{by} (the least is the best; a failure has no finite number of it)")
    marks = (
        f"*: cannot be told from the best at {100.0 * level:g} %; cells: where that holds, in brackets where it alone"
    )
    return [f"{loss}: geometric means over cells, divided by the least, ± Monte-Carlo error", marks]


def _each(table: pd.DataFrame) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """The rankings of `ranked`: name, what the methods are given, and rows."""
    known = table if "given" in table else table.assign(given="")
    for (name, given), part in known.groupby(["run", "given"], sort=False):
        yield str(name), str(given), part


def tables(table: pd.DataFrame) -> Iterator[tuple[str, list[list[str]]]]:
    """Each ranking of `ranked` in words: its title, and a row of cells per estimator, beside `TITLES`."""
    for name, given, part in _each(table):
        count, trials = int(part["cells"].iloc[0]), int(part["trials"].iloc[0])
        words = f", {GIVEN.get(given, given)}" if given else ""
        title = f"{name}{words}: {count} cell{'s' * (count != 1)}, {trials:,} trials"
        yield title, [[str(row["estimator"]), *_words(row)] for row in part.to_dict("records")]


def printed(table: pd.DataFrame, by: str, level: float) -> Iterator[str]:
    """The table of `ranked` for a terminal."""
    yield from explained(by, level)
    for title, rows in tables(table):
        yield ""
        yield title
        yield from columns(rows, ["", *TITLES], "<>")
    part = table[table["run"] == ALL]
    if len(part) and (others := set(table["estimator"]) - set(part["estimator"])):
        yield f"not in every run: {', '.join(sorted(others))}"


def places(table: pd.DataFrame, name: str) -> list[list[str]]:
    """The places of an estimator by its median: a row of cells per ranking, with the first of those given the same."""
    rows = []
    for run, _, part in _each(table):
        for row in part[part["estimator"] == name].to_dict("records"):
            place = 1 + int((part["median"] < row["median"]).sum())
            rows.append([run, f"{place} of {len(part)}", *_words(row), str(part["estimator"].iloc[0])])
    return rows


PLACES = ["", "place", *TITLES, "the first"]
"""Titles of the columns of `places`."""


def printed_places(table: pd.DataFrame, by: str, level: float, names: Sequence[str]) -> Iterator[str]:
    """The places of some estimators for a terminal."""
    yield from explained(by, level)
    for name in names:
        yield ""
        yield f"{name}, among the methods that are given the same:"
        yield from columns(places(table, name), PLACES, "<>")
