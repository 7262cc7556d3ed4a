"""The summary of a run for a terminal and for other programs: median errors in units of the bound.

With them go the medians that an efficient estimator would have, at the Cramér-Rao and at the attainable bound. A user
chooses rows; of these as many are printed as fit a screen.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd

from study.arrays import Bools
from study.fits.cap import cap_moments
from study.simulation.analysis.summary import decade, stored_summary
from study.simulation.analysis.theory import median_at_bound, median_attainable
from study.simulation.experiment.conditions import (
    ANGLE,
    CENTER,
    CONDITIONS,
    DIRECTIONS,
    NOISE,
    NOISE_OVER_RADIUS,
    RADIUS,
    Condition,
    RowValues,
    Value,
    bound_law,
    distinguishing,
)
from study.simulation.experiment.config import Study
from study.simulation.runs.run_folder import Run
from study.text import columns, did_you_mean


def has_bounds(study: Study) -> bool:
    """True if every cell of a study has both bounds: a grid of isotropic Gaussian noise, directions by area."""
    given = [condition.name for condition in study.conditions()]
    departs = bound_law(given) != "" or DIRECTIONS.name in given
    return study.noise_law.isotropic and not departs and not study.design.one_trial_a_cell


def medians_at_bounds(study: Study, row: RowValues) -> tuple[float, float]:
    """Medians of error over √tr CRLB, for Gaussian errors, in the cell of a row of the summary.

    Returns:
        The median at the Cramér-Rao bound, which treats the directions as known, and that at the attainable bound,
        which does not; NaN where that cannot be formed.
    """
    angle, noise = float(ANGLE.of(row)), float(f"{NOISE_OVER_RADIUS.of(row):.12g}")  # cells alike but for scale: once
    at_bound = median_at_bound(cap_moments(math.radians(angle), study.dimension), study.dimension)
    return at_bound, median_attainable(angle, noise, study.dimension)


_SHOWN = 12
"""Values that a message lists."""
_SAME = 1e-3
"""Medians that differ by less than this share are printed alike."""


def chosen_rows(run: Run, where: Iterable[str] = (), estimators: str | None = None) -> pd.DataFrame:
    """The rows of a run's summary that a user asks for.

    Args:
        run: a finished run.
        where: texts like ``angle=45,samples=1000``; a condition stands with its name or its symbol. In a random design
            a value of σ/r chooses the decade that it lies in. All cells, if there are none.
        estimators: names with commas between; None for all.

    Raises:
        ValueError: if a text cannot be read, the run does not have the condition or the estimator, or no cell has the
            values.
    """
    named = [name.strip() for name in estimators.split(",")] if estimators is not None else []
    if unknown := [name for name in named if name not in run.study.estimators]:
        words = f"not in this run; {did_you_mean(unknown, run.study.estimators)}"
        raise ValueError(f"--estimators {', '.join(unknown)}: {words}")
    wanted: dict[Condition, list[Value]] = {}
    for text in (part.strip() for words in where for part in words.split(",")):
        key, equals, value = map(str.strip, text.partition("="))
        if not equals or not value:
            raise ValueError(f"--where {text!r}: not CONDITION=VALUE, such as angle=45")
        condition = _condition(run, key)
        wanted.setdefault(condition, []).append(_value(condition, value))
    summary = stored_summary(run)
    use = np.ones(len(summary), dtype=bool)
    for condition, values in wanted.items():
        use &= _having(summary, condition, values)
    if len(summary) and not use.any():
        raise ValueError(f"--where: no cell has these values of {', '.join(c.name for c in wanted)} together")
    chosen = summary[use]
    return chosen[chosen["estimator"].isin(named)] if named else chosen


def _having(summary: pd.DataFrame, condition: Condition, values: list[Value]) -> Bools:
    """True for the rows of a summary whose condition has one of the values; ValueError if none has."""
    if len(summary) and condition is NOISE_OVER_RADIUS and np.isfinite(summary["decade"]).all():
        result = pd.Series([f"1e{power:+03.0f}" for power in summary["decade"]], index=summary.index)
        here = result.isin([f"1e{power:+03.0f}" for power in decade([float(value) for value in values])])
    else:
        result = pd.Series([condition.written(value) for value in _values(condition, summary)], summary.index)
        here = result.isin([condition.written(value) for value in values])
    if len(summary) and not here.any():
        texts, there = " or ".join(condition.written(value) for value in values), list(result.unique())
        others = f" and {len(there) - _SHOWN} others" if len(there) > _SHOWN else ""
        raise ValueError(
            f"--where {condition.name}={texts}: no cell has it; there are {', '.join(there[:_SHOWN])}{others}"
        )
    return here.to_numpy()


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
    shown = set()
    for group, rows in by_group.items():
        ratio, first = rows[0]
        measured = [[float(str(value)) for value in row[len(fixed) :]] for _, row in rows]
        flat = [value for values in measured for value in values]
        others = known.setdefault((ratio, *first[: len(fixed)]), [])
        if not any(np.allclose(flat, other, rtol=_SAME, atol=0.0, equal_nan=True) for other in others):
            others.append(flat)
            shown.add(group)
    return summary[summary["group"].astype(str).isin(shown)]


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


ROWS = 32
"""Most rows of a table that, with the lines about it, fits 40 lines."""
_ALL_TRIALS = (
    "Medians of all trials, whatever the status; a fit without a number is infinitely far. Brackets: share not ok."
)
_OK_FITS = "Medians of each estimator's own ok fits, not to be compared: trials differ. Brackets: share not ok."


def printed(run: Run, rows: pd.DataFrame, every: bool = False, only_ok: bool = False) -> Iterator[str]:
    """The medians of error over bound of a run.

    Args:
        run: a finished run.
        rows: the rows, see `chosen_rows`.
        every: print each of them; otherwise cells that are the same by scaling are printed once, and of more than
            `ROWS` rows some that are evenly spread.
        only_ok: give the median of each estimator's own ok fits, instead of all trials.

    Yields:
        A title, a legend, a header, and a line per group: for each estimator the median error of all trials over the
        bound with its Monte-Carlo error, and in brackets the share of fits that are not ok, if there are any. Before
        them stand the medians of estimators with Gaussian errors at the two bounds, where the cells have them. Last
        come the numbers of rows that were left out.
    """
    yield f"{run.study.run_name()}: median error of the centre over the {_bound(rows)} ± its Monte-Carlo error"
    yield _OK_FITS if only_ok else _ALL_TRIALS
    if rows.empty:
        yield "no cell has a trial yet"
        return
    chosen, notes = (rows, []) if every else _fitting(run, rows)
    named, bounded = distinguishing(chosen), has_bounds(run.study)
    yield _legend(chosen, named)
    if bounded:
        yield "CRLB and attainable: the median of Gaussian errors at the Cramér-Rao bound and at the attainable bound."
    lines = []
    for _, part in chosen.groupby("group", sort=False):
        fits = part.to_dict("records")
        bounds = [f"{value:.3g}" for value in medians_at_bounds(run.study, fits[0])] if bounded else []
        medians = [_median(fit, "ratio_median_ok" if only_ok else "ratio_median") for fit in fits]
        lines.append([_conditions(fits[0], named), *bounds, *medians])
    yield from columns(lines, ["", *(["CRLB", "attainable"] if bounded else []), *dict.fromkeys(chosen["estimator"])])
    yield from notes


def as_data(run: Run, frame: pd.DataFrame) -> dict[str, Any]:
    """Rows of a summary for other programs: run, bound, names of the conditions, and a mapping per row."""
    bounded = has_bounds(run.study)
    rows: list[dict[str, Any]] = []
    for _, part in frame.groupby("group", sort=False):
        fits = part.to_dict("records")
        more: dict[str, float] = {}
        if not run.study.design.one_trial_a_cell:
            more["noise_over_radius"] = NOISE_OVER_RADIUS.of(fits[0])
        if bounded:
            more |= zip(("median_cramer_rao", "median_attainable"), medians_at_bounds(run.study, fits[0]), strict=True)
        rows += [{str(name): value for name, value in fit.items()} | more for fit in fits]
    conditions = [condition.name for condition in run.study.conditions()]
    return {"run": run.study.run_name(), "bound": _bound(frame), "conditions": conditions, "rows": rows}


def _bound(frame: pd.DataFrame) -> str:
    return bound_law(frame.columns) or "Cramér-Rao bound"


def _fitting(run: Run, frame: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """The rows that fit a screen, and lines about the rows that are left out."""
    total, notes = frame["group"].nunique(), []
    if not run.study.design.one_trial_a_cell:
        frame = once_by_scaling(frame)
    if same := total - (different := frame["group"].nunique()):
        cells = "1 cell has" if same == 1 else f"{same:,} cells have"
        notes.append(f"{cells} the numbers of one above, as only scale or centre differ; --all shows them.")
    first = frame.drop_duplicates("group")
    named = distinguishing(first)
    keys: list[tuple[Value, ...]]
    if np.isfinite(first["decade"]).all():
        keys = [(value,) for value in first["decade"]]
    else:  # nine digits, since values may be rounded differently
        rows = first.to_dict("records")
        keys = [tuple(v if isinstance(v := c.of(r), str) else float(f"{v:.9g}") for c in named) for r in rows]
    weights = [2.0 if condition is NOISE_OVER_RADIUS else 1.0 for condition in named]  # estimators part along it
    use = evenly_spread(keys, ROWS, weights[: len(keys[0])])
    if not all(use):
        frame = frame[frame["group"].isin(first["group"][use])]
        more = "--all shows all, --where and --estimators choose, --csv is for other programs."
        notes.append(f"{sum(use):,} of {different:,} rows, evenly spread; {more}")
    return frame, notes


def _legend(frame: pd.DataFrame, named: list[Condition]) -> str:
    """The meaning of the symbols in the first column."""
    if np.isfinite(frame["decade"].iloc[0]):
        first = int(frame["decade"].iloc[0])
        return f"{NOISE_OVER_RADIUS.symbol} = 1e{first:+03d} …: the trials with σ/r from 1e{first:+03d} to ten times it"
    return "; ".join(f"{c.symbol}: {c.meaning.removesuffix(f' {c.symbol}')}" for c in named)


def _conditions(row: RowValues, named: list[Condition]) -> str:
    """The conditions of a group."""
    if np.isfinite(row["decade"]):
        return f"{NOISE_OVER_RADIUS.symbol} = 1e{int(row['decade']):+03d} …"
    return ", ".join(condition.label(row) for condition in named)


def _median(row: RowValues, name: str) -> str:
    """A median with its error, and in brackets the share of fits that are not ok."""
    failed = 1.0 - row["ok"] / row["planned"]
    if np.isnan(row[name]):
        return "none ok" if name.endswith("_ok") else "unknown"
    text = f"{row[name]:.3g} ± {row[f'{name}_error']:.2g}" if np.isfinite(row[name]) else "inf"
    return text + (f" ({failed:.1%})" if failed > 0 else "")
