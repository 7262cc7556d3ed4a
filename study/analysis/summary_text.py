"""The summary of a run for a terminal, and for other programs: median errors in units of the bound."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from study.analysis.medians_at_bounds import AtBounds, has_bounds, medians_at_bounds
from study.analysis.summary import stored_summary
from study.analysis.summary_choice import RowChoice, evenly_spread, once_by_scaling
from study.experiment.conditions import ANGLE, NOISE_OVER_RADIUS, Condition, RowValues, bound_law, distinguishing
from study.experiment.config import Study
from study.runs.storage.run_folder import Run
from study.text.columns import columns
from study.text.spreadsheet_cell import inert_frame

ROWS = 32
"""Most rows of a table that, with the lines about it, fits 40 lines."""
_ALL_TRIALS = (
    "Medians of all trials, whatever the status; a fit without a number is infinitely far. Brackets: share not ok."
)
_OK_FITS = "Medians of each estimator's own ok fits, not to be compared: trials differ. Brackets: share not ok."


def printed(run: Run, choice: RowChoice | None = None, every: bool = False, only_ok: bool = False) -> Iterator[str]:
    """The medians of error over bound of a run.

    Args:
        run: a finished run.
        choice: the rows; all if None.
        every: print each of them; otherwise cells that are the same by scaling are printed once, and of more than
            `ROWS` rows some that are evenly spread.
        only_ok: give the median of each estimator's own ok fits, instead of all trials.

    Yields:
        A title, a legend, a header, and a line per group: for each estimator the median error of all trials over the
        bound with its Monte-Carlo error, and in brackets the share of fits that are not ok, if there are any. Before
        them stand the medians of estimators with Gaussian errors at the two bounds, where the cells have them. Last
        come the numbers of rows that were left out.

    Raises:
        ValueError: if no cell has the values of the choice.
    """
    table = _summary(run)
    frame = (choice or RowChoice()).rows(table)
    yield f"{run.study.run_name()}: median error of the centre over the {_bound(frame)} ± its Monte-Carlo error"
    yield _OK_FITS if only_ok else _ALL_TRIALS
    if frame.empty:
        yield "no cell has a trial yet"
        return
    chosen, notes = (frame, []) if every else _fitting(run, frame)
    named, bounded = distinguishing(chosen), has_bounds(run.study)
    yield _legend(chosen, named)
    if bounded:
        yield "CRLB and attainable: the median of Gaussian errors at the Cramér-Rao bound and at the attainable bound."
    rows, at_bounds = [], _AtBounds(run.study)
    for _, part in chosen.groupby("group", sort=False):
        fits = part.to_dict("records")
        bounds = [f"{value:.3g}" for value in at_bounds(fits[0])] if bounded else []
        rows.append(
            [
                _conditions(fits[0], named),
                *bounds,
                *(_median(fit, "ratio_median_ok" if only_ok else "ratio_median") for fit in fits),
            ]
        )
    yield from columns(rows, ["", *(["CRLB", "attainable"] if bounded else []), *dict.fromkeys(chosen["estimator"])])
    yield from notes


def as_data(run: Run, choice: RowChoice) -> dict[str, Any]:
    """The chosen rows for other programs: run, bound, names of the conditions, and a mapping per row.

    Raises:
        ValueError: if no cell has the values of the choice.
    """
    frame = choice.rows(_summary(run))
    bounded, at_bounds = has_bounds(run.study), _AtBounds(run.study)
    rows: list[dict[str, Any]] = []
    for _, part in frame.groupby("group", sort=False):
        fits = part.to_dict("records")
        more: dict[str, float] = {}
        if not run.study.design.one_trial_a_cell:
            more["noise_over_radius"] = NOISE_OVER_RADIUS.of(fits[0])
        if bounded:
            at = at_bounds(fits[0])
            more |= {"median_cramer_rao": at.cramer_rao, "median_attainable": at.attainable}
        rows += [{str(name): value for name, value in fit.items()} | more for fit in fits]
    conditions = [condition.name for condition in run.study.conditions()]
    return {"run": run.study.run_name(), "bound": _bound(frame), "conditions": conditions, "rows": rows}


def as_csv(run: Run, choice: RowChoice) -> str:
    """The chosen rows of the summary table as CSV, all columns, with a header; an empty field is not a number.

    Raises:
        ValueError: if no cell has the values of the choice.
    """
    return inert_frame(choice.rows(_summary(run))).to_csv(index=False, lineterminator="\n")


class _AtBounds:
    """Medians at the bounds, computed once for cells that differ by scaling alone."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.known: dict[tuple[float, str], AtBounds] = {}

    def __call__(self, row: RowValues) -> AtBounds:
        key = float(ANGLE.of(row)), f"{NOISE_OVER_RADIUS.of(row):.12g}"
        if key not in self.known:
            self.known[key] = medians_at_bounds(self.study, row)
        return self.known[key]


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
    keys = [_place(row, named) for row in first.to_dict("records")]
    weights = [2.0 if condition is NOISE_OVER_RADIUS else 1.0 for condition in named]  # estimators part along it
    use = evenly_spread(keys, ROWS, weights[: len(keys[0])])
    if not all(use):
        frame = frame[frame["group"].isin(first["group"][use])]
        more = "--all shows all, --where and --estimators choose, --csv is for other programs."
        notes.append(f"{sum(use):,} of {different:,} rows, evenly spread; {more}")
    return frame, notes


def _place(row: RowValues, named: list[Condition]) -> tuple[Any, ...]:
    """The place of a group in the design, for conditions whose values may be rounded differently."""
    if np.isfinite(row["decade"]):
        return (row["decade"],)
    return tuple(v if isinstance(v := c.of(row), str) else float(f"{v:.9g}") for c in named)


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
    text = "inf"
    if np.isfinite(row[name]):
        text = f"{row[name]:.3g} ± {row[f'{name}_error']:.2g}"
    return text + (f" ({failed:.1%})" if failed > 0 else "")


def _summary(run: Run) -> pd.DataFrame:
    return stored_summary(run, run.has("errors"), run.study.design.one_trial_a_cell)
