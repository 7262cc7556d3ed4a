"""The summary table: measures per cell, or per decade of relative noise, and estimator; and the worst trials of a run.

The headline is ``ratio_median``, of all trials, so that columns of one row are of the same trials. For quantiles of the
fits whose status is ok (``_ok``), and with failures last (``_all``), see `study.simulation.statistics`. The error table
is read a part at a time, see `study.simulation.analysis.error_table`.

In print the medians are in units of the bound. With them go the medians that an efficient estimator would have, at the
Cramér-Rao and at the attainable bound. A user chooses rows; of these as many are printed as fit a screen.
"""

import math
import re
from collections.abc import Collection, Container, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from study.arrays import Bools, Floats
from study.files import RunError, writing
from study.fits import Status
from study.fits.points.cap import cap_moments
from study.simulation import statistics
from study.simulation.analysis.error_table import Grouped, Key, decade, label
from study.simulation.analysis.theory import median_at_bound, median_attainable
from study.simulation.experiment.conditions import (
    ANGLE,
    CENTER,
    CONDITIONS,
    DIRECTIONS,
    NOISE,
    NOISE_OVER_RADIUS,
    RADIUS,
    STORED,
    Condition,
    RowValues,
    Value,
    bound_law,
    distinguishing,
    named_in,
)
from study.simulation.experiment.config import Study
from study.simulation.runs import schemas
from study.simulation.runs.run_folder import Run
from study.text import columns, did_you_mean
from study.words import estimator_remedy


def stored_summary(run: Run) -> pd.DataFrame:
    """Read the summary of a run, with the measures of all trials even if an earlier version stored it without them.

    They are computed from the errors. Without errors they are those with failures last where every fit is ok, and
    elsewhere not a number.
    """
    stored = run.table("summary")
    missing = [name for name in schemas.OF_ALL_TRIALS if name not in stored]
    if not missing:
        return stored
    if run.has("errors"):
        computed: pd.DataFrame = pa.concat_tables(rows_of_groups(run, Grouped(run))).to_pandas()
        return computed[[c.name for c in schemas.summary([c for c in STORED if c.name in stored])]]
    # the column of a measure with failures last, or of its Monte-Carlo error
    known = {name: f"{name.removesuffix('_error')}_all" + "_error" * name.endswith("_error") for name in missing}
    all_ok = stored["ok"] == stored["planned"]
    return stored.assign(
        **{name: stored[other].where(all_ok) if other in stored else np.nan for name, other in known.items()}
    )


def up_to_date(run: Run) -> bool:
    """True if the summary of a finished run need not be made from its errors again."""
    if not run.valid("summary"):
        return False
    stored = pq.read_schema(run.path("summary")).names
    return run.study.keep == "summary" or set(schemas.OF_ALL_TRIALS) <= set(stored)


def summarise(run: Run) -> None:
    """Summarise a run's error table and store the summary beside it, with few groups in memory at a time."""
    columns, grouped = schemas.summary(*run.study.columns()[1:]), Grouped(run)
    with writing(run.folder):
        run.join("summary", columns, rows_of_groups(run, grouped), {"study.config": run.study.canonical()})
        run.record("summary")


def rows_of_groups(run: Run, grouped: Grouped, keys: Collection[Key] | None = None) -> Iterator[pa.Table]:
    """Compute rows of a run's summary from its error table, some at a time.

    Args:
        run: the run.
        grouped: its error table.
        keys: groups and estimators; all if None.
    """
    _, conditions, measured = run.study.columns()
    columns = schemas.summary(conditions, measured)
    needed = [*(c.name for c in conditions), *statistics.NEEDED, *(c.name for c in measured)]
    for batch in grouped.batches(needed, keys):
        fits = grouped.read(batch, needed)
        rows = [statistics.row(*key, fits[key], measured) for key in batch]
        yield schemas.table(columns, statistics.as_columns(rows))


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
_COMMA = re.compile(r",(?![^()]*\))")
"""A comma that is not between the numbers of a law."""
_SAME = 1e-3
"""Medians that differ by less than this share are printed alike."""


def chosen_rows(run: Run, where: Iterable[str] = (), estimators: str | None = None) -> pd.DataFrame:
    """The rows of a run's summary that a user asks for.

    Args:
        run: a finished run.
        where: texts like ``angle=45,samples=100,1000``; a condition stands with its name or its symbol. In a random
            design a value of σ/r chooses the decade that it lies in. All cells, if there are none.
        estimators: names with commas between; None for all.

    Raises:
        ValueError: if a text cannot be read, the run does not have the condition or the estimator, or no cell has the
            values.
    """
    named = [name.strip() for name in estimators.split(",")] if estimators is not None else []
    if unknown := [name for name in named if name not in run.study.estimators]:
        words = f"not in this run; {estimator_remedy(unknown, run.study.estimators)}"
        raise ValueError(f"--estimators {', '.join(unknown)}: {words}")
    wanted: dict[Condition, list[Value]] = {}
    for words in where:
        condition = None
        for text in map(str.strip, _COMMA.split(words)):
            key, equals, value = map(str.strip, text.rpartition("="))
            if not value or not (equals or condition) or (not equals and value in CONDITIONS):
                raise ValueError(f"--where {text!r}: not CONDITION=VALUE, such as angle=45")
            condition = _condition(run, key) if equals or condition is None else condition
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
    """True for the rows of a summary whose condition has one of the values; ValueError if no row has one."""
    rows, asked = (list(map(condition.written, some)) for some in (_values(condition, summary), values))
    texts = list(asked)  # as the message has them
    if len(summary) and condition is NOISE_OVER_RADIUS and np.isfinite(summary["decade"]).all():
        powers = summary["decade"], decade([float(value) for value in values])
        rows, asked = ([f"1e{power:+03.0f}" for power in some] for some in powers)
    here = np.isin(rows, asked)
    if len(summary) and (missing := [text for text, word in zip(texts, asked, strict=True) if word not in rows]):
        there = list(dict.fromkeys(rows))
        words = " or ".join(missing)
        others = f" and {len(there) - _SHOWN} others" if len(there) > _SHOWN else ""
        raise ValueError(
            f"--where {condition.name}={words}: no cell has it; there are {', '.join(there[:_SHOWN])}{others}"
        )
    return here


def once_by_scaling(summary: pd.DataFrame) -> pd.DataFrame:
    """Rows of a grid's summary without the cells that repeat another one in a larger or shifted space.

    Errors over the bound do not depend on the radius and the centre if σ/r is the same, as all estimators follow a
    change of scale and a shift. With shared draws the numbers are the same, but for rounding. A cell is left out if
    its counts are equal to those of an earlier one, and its medians and their errors agree to a thousandth.
    """
    free = {NOISE, RADIUS, CENTER}
    first = summary.drop_duplicates("group")
    ratios = (f"{value:.9g}" for value in _values(NOISE_OVER_RADIUS, first))
    alike = zip(ratios, *(first[c.name] for c in STORED if c.name in summary and c not in free), strict=True)
    numbers = ["ok", "planned", "ratio_median", "ratio_median_error"]
    wide = summary.pivot(index="group", columns="estimator", values=numbers).loc[first["group"]].to_numpy(dtype=float)
    known: dict[tuple[object, ...], list[Floats]] = {}
    shown = []
    for conditions, measured in zip(alike, wide, strict=True):
        others = known.setdefault(conditions, [])
        new = not any(np.allclose(measured, other, rtol=_SAME, atol=0.0, equal_nan=True) for other in others)
        others += [measured] * new
        shown.append(new)
    return summary[summary["group"].isin(first["group"][shown])]


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
        raise ValueError(f"--where {condition.name}={text}: must be {condition.must_be}")
    return value


def _values(condition: Condition, summary: pd.DataFrame) -> list[Value]:
    """The values of a condition in the rows of a summary."""
    if condition is NOISE_OVER_RADIUS:
        return [float(value) for value in summary[NOISE.name] / summary[RADIUS.name]]
    return list(summary[condition.name])


ROWS = 32
"""Most rows of a table that, with the lines about it, fits 40 lines."""
_BRACKETS = "Brackets: share not ok."
_NOTES = {
    "ratio_median": "Medians of all trials, whatever the status; a fit without a number is infinitely far. ",
    "ratio_median_ok": "Medians of each estimator's own ok fits, not to be compared: trials differ. ",
}
"""Notes on the medians of error over bound."""


def _meanings(run: Run) -> dict[str, str]:
    """Meanings of the measures of a run's summary by name."""
    declared = {column.name: column.meaning for column in schemas.summary(*run.study.columns()[1:])}
    return {name: meaning for name, meaning in declared.items() if f"{name}_error" in declared}


def measure_shown(run: Run, name: str) -> str:
    """The name of a measure of a run's summary; ValueError if it has no such measure."""
    if name not in (known := _meanings(run)):
        raise ValueError(f"--measure {name}: not a measure of this run; {did_you_mean(name, known)}")
    return name


def printed(run: Run, rows: pd.DataFrame, every: bool = False, measure: str = "ratio_median") -> Iterator[str]:
    """The medians of error over bound of a run, or another measure.

    Args:
        run: a finished run.
        rows: the rows, see `chosen_rows`.
        every: print each of them; otherwise cells that are the same by scaling are printed once, and of more than
            `ROWS` rows some that are evenly spread.
        measure: name of the measure.

    Yields:
        A title, a legend, a header, and a line per group: for each estimator the measure with its Monte-Carlo error,
        and in brackets the share of fits that are not ok, if there are any. Before medians of error over the bound
        stand those of estimators with Gaussian errors at the two bounds, where the cells have them. Last come the
        numbers of rows that were left out.
    """
    of_bound = measure in _NOTES
    words = f"median error of the centre over the {_bound(rows.columns)}" if of_bound else _meanings(run)[measure]
    yield f"{run.study.run_name()}: {words} ± its Monte-Carlo error"
    yield _NOTES.get(measure, "") + _BRACKETS
    if rows.empty:
        yield "no cell has a trial yet"
        return
    chosen, notes = (rows, []) if every else _fitting(run, rows)
    named, bounded = distinguishing(chosen), of_bound and has_bounds(run.study)
    yield _legend(chosen, named)
    if bounded:
        yield "CRLB and attainable: the median of Gaussian errors at the Cramér-Rao bound and at the attainable bound."
    lines = []
    for _, part in chosen.groupby("group", sort=False):
        fits = part.to_dict("records")
        bounds = [f"{value:.3g}" for value in medians_at_bounds(run.study, fits[0])] if bounded else []
        medians = [_value_in_words(fit, measure) for fit in fits]
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
    return {"run": run.study.run_name(), "bound": _bound(frame.columns), "conditions": conditions, "rows": rows}


def _bound(conditions: Container[str]) -> str:
    return bound_law(conditions) or "Cramér-Rao bound"


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
    end = {c: "" if c.symbol == c.name else f" {c.symbol}" for c in named}  # law of the directions
    return "; ".join(f"{c.symbol}: {c.meaning.removesuffix(end[c])}" for c in named)


def _conditions(row: RowValues, named: list[Condition]) -> str:
    """The conditions of a group."""
    if np.isfinite(row["decade"]):
        return f"{NOISE_OVER_RADIUS.symbol} = 1e{int(row['decade']):+03d} …"
    return ", ".join(condition.label(row) for condition in named)


def _value_in_words(row: RowValues, name: str) -> str:
    """A measure with its error, and in brackets the share of fits that are not ok."""
    failed = 1.0 - row["ok"] / row["planned"]
    if np.isnan(row[name]):
        return "none ok" if name.endswith("_ok") else "unknown"
    text = f"{row[name]:.3g} ± {row[f'{name}_error']:.2g}" if np.isfinite(row[name]) else "inf"
    return text + (f" ({failed:.1%})" if failed > 0 else "")


_GROUPS = 8
"""Row groups of an error table in memory at a time: a million rows."""


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
    ratio = _ratios(errors)
    if estimator is not None:
        ratio = ratio[(errors["estimator"] == estimator).to_numpy()[ratio.index]]
    # a trial has a row per estimator: among so many rows are the trials asked for, and those as bad as the last
    ratio = ratio.nlargest(count * max(1, errors["estimator"].nunique()), keep="all")
    # sorted by name, not by the code of a dictionary
    rows = errors.iloc[ratio.index].assign(ratio=ratio.to_numpy()).astype({"cell": str, "estimator": str})
    rows = rows.sort_values(["ratio", "cell", "trial", "estimator"], ascending=[False, True, True, True])
    return rows.drop_duplicates(["cell", "trial"]).head(count).reset_index(drop=True)


def worst_of_groups(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """The trial with the largest error over the bound of each group and estimator, among the fits that are ok.

    Args:
        errors: the error table.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid), as the summary does.

    Returns:
        A row per group and estimator that has such a trial: ``group``, ``estimator``, ``cell``, ``trial`` and
        ``ratio``, error over bound. Of equal ratios the first of the table counts.
    """
    ratio = _ratios(errors)
    groups = decade(errors["noise"] / errors["radius"]) if by_decade else pd.factorize(errors["cell"])[0]
    estimators, names = pd.factorize(errors["estimator"])
    keys = (groups * max(1, len(names)) + estimators)[ratio.index]  # one key: pandas takes four times as long with two
    where = ratio.groupby(keys, sort=True).idxmax().to_numpy()
    named = errors[["cell", "trial", "estimator", "noise", "radius"]].iloc[where]
    rows = label(named, by_decade).astype({"group": str, "cell": str, "estimator": str})
    return rows.assign(ratio=ratio[where].to_numpy())[["group", "estimator", "cell", "trial", "ratio"]]


def _ratios(errors: pd.DataFrame) -> "pd.Series[float]":
    """Error over bound by the number of the row, of fits that are ok and have a finite bound."""
    use = np.flatnonzero((errors["status"] == Status.OK) & np.isfinite(errors["bound"]))
    with np.errstate(all="ignore"):
        ratio = errors["error"].to_numpy()[use] / errors["bound"].to_numpy()[use]
    return pd.Series(ratio, use).dropna()


def worst_of_run(run: Run, count: int = 5, estimator: str | None = None) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Find the worst trials, and the worst of each group and estimator, in one pass through a run's error table.

    Returns:
        The tables of `worst` and `worst_of_groups`.

    Raises:
        RunError: if the run did not finish, or does not have the estimator.
    """
    known, by_decade = run.study.estimators, run.study.design.one_trial_a_cell
    if estimator is not None and estimator not in known:
        raise RunError(f"{run.folder}: no estimator {estimator!r} in this run; {estimator_remedy(estimator, known)}")
    parts = [(worst(part, count, estimator), worst_of_groups(part, by_decade)) for part in _parts(run)]
    trials, groups = (pd.concat(tables, ignore_index=True) for tables in zip(*parts, strict=True))
    first = groups.groupby(["group", "estimator"], sort=False)["ratio"].idxmax()
    return worst(trials, count), groups.loc[first]


def _parts(run: Run) -> Iterator[pd.DataFrame]:
    """A run's error table, some rows at a time: new memory for millions of rows takes longer than reading them."""
    conditions = [condition.name for condition in run.study.conditions()]
    columns = ["cell", "trial", *conditions, "estimator", "error", "bound", "status"]
    file: pq.ParquetFile = run.read("errors", pq.ParquetFile)
    for first in range(0, max(1, file.num_row_groups), _GROUPS):  # a table without rows is a part without rows
        groups = range(first, min(first + _GROUPS, file.num_row_groups))
        yield file.read_row_groups(list(groups), columns=columns).to_pandas(split_blocks=True, self_destruct=True)


def worst_as_data(run: Run, trials: pd.DataFrame) -> dict[str, object]:
    """The worst trials for other programs: the run's name, the bound in words, and a mapping per trial."""
    conditions = [condition.name for condition in run.study.conditions()]
    names = ("cell", "trial", "estimator", "ratio", "error", "bound", *conditions)
    records = trials.to_dict("records")
    rows = [{"name": f"{row['cell']}/{row['trial']}"} | {name: row[name] for name in names} for row in records]
    return {"run": run.study.run_name(), "bound": _bound(conditions), "trials": rows}


def printed_worst(run: Run, trials: pd.DataFrame) -> Iterator[str]:
    """The worst trials for a terminal, each by the name that `study replay RUN NAME` takes."""
    conditions = [condition.name for condition in run.study.conditions()]
    shown = named_in(conditions)
    yield f"{run.study.run_name()}: the largest errors over the {_bound(conditions)} of fits ok by own status"
    rows = []
    for trial in trials.to_dict("records"):
        name, over_radius = f"{trial['cell']}/{trial['trial']}", trial["error"] / trial["radius"]
        rows.append([name, trial["estimator"], f"{trial['ratio']:.4g}", f"{over_radius:.3g}"])
        rows[-1] += [condition.written(condition.of(trial)) for condition in shown]
    titles = ["trial", "estimator", "over bound", "error/r", *(condition.symbol for condition in shown)]
    yield from columns(rows, titles, "<<>")
    if len(trials):
        words = [f"{trials['cell'][0]}/{trials['trial'][0]}", "--plot worst.png", *run.plugins()]
        yield f"to see the first: study replay {run.folder} {' '.join(words)}"
