"""Choice of rows of a summary: those that a user asks for, and of these as many as fit a screen."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import pandas as pd

from study.analysis.error_groups import decade
from study.experiment.conditions import CENTER, CONDITIONS, NOISE, NOISE_OVER_RADIUS, RADIUS, Condition, Value
from study.runs.storage.run_folder import Run
from study.text.nearest import did_you_mean

_SAME = 1e-3
"""Medians that differ by less than this share are printed alike."""


@dataclass(frozen=True)
class RowChoice:
    """The rows of a summary that a user asks for.

    Attributes:
        where: for each condition the values that it may have; all cells, if empty.
        estimators: names of estimators; all, if empty.
    """

    where: dict[str, list[Value]] = field(default_factory=dict)
    estimators: tuple[str, ...] = ()

    @classmethod
    def of(cls, run: Run, where: Iterable[str], estimators: str | None) -> Self:
        """Read a choice as the command line has it.

        Args:
            run: the run to choose from.
            where: texts like ``angle=45,samples=1000``; a condition stands with its name or its symbol.
            estimators: names with commas between; None for all.

        Raises:
            ValueError: if a text cannot be read, or the run does not have the condition or the estimator.
        """
        named = tuple(name.strip() for name in estimators.split(",")) if estimators is not None else ()
        if unknown := [name for name in named if name not in run.study.estimators]:
            words = f"not in this run; {did_you_mean(unknown, run.study.estimators)}"
            raise ValueError(f"--estimators {', '.join(unknown)}: {words}")
        wanted: dict[str, list[Value]] = {}
        for text in (part.strip() for words in where for part in words.split(",")):
            key, equals, value = map(str.strip, text.partition("="))
            if not equals or not value:
                raise ValueError(f"--where {text!r}: not CONDITION=VALUE, such as angle=45")
            condition = _condition(run, key)
            wanted.setdefault(condition.name, []).append(_value(condition, value))
        return cls(wanted, named)

    def rows(self, summary: pd.DataFrame) -> pd.DataFrame:
        """The chosen rows of a summary table.

        In a random design a value of σ/r chooses the decade that it lies in.

        Raises:
            ValueError: if no cell has the values.
        """
        use = np.ones(len(summary), dtype=bool)
        for name, wanted in self.where.items():
            condition = CONDITIONS[name]
            if len(summary) and condition is NOISE_OVER_RADIUS and np.isfinite(summary["decade"]).all():
                found = pd.Series([f"1e{power:+03.0f}" for power in summary["decade"]], index=summary.index)
                here = found.isin([f"1e{power:+03.0f}" for power in decade([float(value) for value in wanted])])
            else:
                found = pd.Series([condition.written(value) for value in _values(condition, summary)], summary.index)
                here = found.isin([condition.written(value) for value in wanted])
            if len(summary) and not here.any():
                texts = " or ".join(condition.written(value) for value in wanted)
                raise ValueError(f"--where {name}={texts}: no cell has it; there are {_some(found)}")
            use &= here.to_numpy()
        if len(summary) and not use.any():
            raise ValueError(f"--where: no cell has these values of {', '.join(self.where)} together")
        chosen = summary[use]
        return chosen[chosen["estimator"].isin(self.estimators)] if self.estimators else chosen


def once_by_scaling(summary: pd.DataFrame) -> pd.DataFrame:
    """Rows of a grid's summary without the cells that repeat another one in a larger or shifted space.

    Errors over the bound do not depend on the radius and the centre if σ/r is the same, as all estimators follow a
    change of scale and a shift. With shared draws the numbers are the same, but for rounding. A cell is left out if
    its counts are equal to those of an earlier one, and its medians and their errors agree to a thousandth.
    """
    free = {NOISE.name, RADIUS.name, CENTER.name}
    fixed = [c.name for c in CONDITIONS.values() if c.stored and c.name in summary and c.name not in free]
    numbers = [*fixed, "ok", "planned", "ratio_median", "ratio_median_error"]
    ratios = (f"{value:.9g}" for value in _values(NOISE_OVER_RADIUS, summary))
    known: dict[tuple[object, ...], list[list[float]]] = {}
    by_group: dict[str, list[tuple[str, tuple[object, ...]]]] = {}
    for group, ratio, row in zip(summary["group"], ratios, summary[numbers].itertuples(index=False), strict=True):
        by_group.setdefault(str(group), []).append((ratio, tuple(row)))
    kept = set()
    for group, rows in by_group.items():
        ratio, first = rows[0]
        measured = [[float(str(value)) for value in row[len(fixed) :]] for _, row in rows]
        flat = [value for values in measured for value in values]
        others = known.setdefault((ratio, *first[: len(fixed)]), [])
        if not any(np.allclose(flat, other, rtol=_SAME, atol=0.0, equal_nan=True) for other in others):
            others.append(flat)
            kept.add(group)
    return summary[summary["group"].astype(str).isin(kept)]


def evenly_spread(keys: Sequence[tuple[Value, ...]], most: int, weights: Sequence[float] = ()) -> list[bool]:
    """Choose at most so many of the cells of a grid, evenly spread over its conditions, with both ends of each.

    Values are left out of the condition that has most of them for its weight, one after another, until the cells are
    few enough.

    Args:
        keys: the values of the conditions of each cell.
        most: largest number of cells to choose.
        weights: of the conditions; twice the weight keeps twice the values. 1 each, if empty.

    Returns:
        True for each cell that is chosen.
    """
    if len(keys) <= most:
        return [True] * len(keys)
    axes = [list(dict.fromkeys(values)) for values in zip(*keys, strict=True)]
    axes = [axis if isinstance(axis[0], str) else sorted(axis) for axis in axes]
    counts, weights = [len(axis) for axis in axes], weights or [1.0] * len(axes)
    while max(counts) > 1:
        shares = [count / weight if count > 1 else 0.0 for count, weight in zip(counts, weights, strict=True)]
        longest = shares.index(max(shares))
        counts[longest] -= 1
        shown = [set(_spread(axis, count)) for axis, count in zip(axes, counts, strict=True)]
        chosen = [all(value in some for value, some in zip(key, shown, strict=True)) for key in keys]
        if sum(chosen) <= most:
            if any(chosen):
                return chosen
            break
    places = set(_spread(range(len(keys)), most))  # cells that are no grid
    return [place in places for place in range(len(keys))]


def _spread(values: Sequence[Value], count: int) -> list[Value]:
    """Choose so many of some values in equal steps, the first and the last one included."""
    return [values[int(place)] for place in np.linspace(0, len(values) - 1, count).round()]


def _condition(run: Run, key: str) -> Condition:
    """The condition of a run with a name or a symbol."""
    known = {NOISE_OVER_RADIUS.name: NOISE_OVER_RADIUS}
    if not run.study.design.one_trial_a_cell:  # otherwise a row has many values of the others
        known = {c.name: c for c in run.study.conditions()} | known
    by_symbol = {condition.symbol: condition for condition in known.values()}
    if key not in known and key not in by_symbol:
        raise ValueError(f"--where {key}: not a condition of the rows; {did_you_mean(key, known)}")
    return known.get(key) or by_symbol[key]


def _value(condition: Condition, text: str) -> Value:
    """A value of a condition, given as text."""
    if condition.kind is str:
        return text
    try:
        value = float(text.removesuffix(condition.mark) if condition.mark else text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or not condition.allowed(value):
        raise ValueError(f"--where {condition.name}={text}: must be {condition.rule}")
    return value


def _values(condition: Condition, summary: pd.DataFrame) -> list[Value]:
    """The values of a condition in the rows of a summary."""
    if condition is NOISE_OVER_RADIUS:
        return [float(value) for value in summary[NOISE.name] / summary[RADIUS.name]]
    return list(summary[condition.name])


def _some(values: "pd.Series[str]", most: int = 12) -> str:
    """The different values, or the first of them."""
    texts = [str(value) for value in values.unique()]
    return ", ".join(texts[:most]) + (f" and {len(texts) - most} others" if len(texts) > most else "")
