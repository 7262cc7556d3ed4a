"""A figure: an object with ``prepare(tables) -> frame`` and ``draw(frame) -> Figure``; its tables, and its pictures.

All computing is in ``prepare``; ``draw`` reads no files. `NotApplicable` says why a run cannot feed a figure.
"""

import math
import traceback
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, Protocol

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study import style
from study.arrays import Floats, Ints
from study.files import RunError, TableRows
from study.fits.points.cap import cap_moments
from study.simulation.analysis.error_table import Grouped
from study.simulation.analysis.regret import NEEDED, by_cell
from study.simulation.analysis.summary import stored_summary, worst_of_run
from study.simulation.analysis.theory import median_at_bound
from study.simulation.experiment.conditions import DIRECTIONS, STORED, bound_law, distinguishing
from study.simulation.runs.run_folder import NO_TRIAL, Run

FEWEST_CELLS, MOST_CELLS = 4, 400
"""Cells that can be drawn side by side."""
LOOP_HEIGHT = 0.36
"""Inches of the height of a figure that a condition has."""
_NAMED = 8
"""Values of a condition that are named."""
Frame = SimpleNamespace
"""Content of a figure by name: ``prepare`` computes it, and says what it has; ``draw`` shows it."""
PACKAGE = Path(__file__).parents[2]
FAILED = "failed: "
"""Beginning of the reason why a figure that failed was not drawn; other reasons say that a run cannot feed it."""


def failure(error: Exception) -> str:
    """A figure's failure in one line.

    Args:
        error: the exception, in the function that caught it.

    Returns:
        "failed: KeyError('noise') at study/simulation/figures/fig_map.py, line 31, in prepare": the innermost line of
        this package, whatever library it called; the innermost line of all, if the figure is not of this package.
    """
    frames = traceback.extract_tb(error.__traceback__)[1:]  # the first caught it
    own = [frame for frame in frames if PACKAGE in Path(frame.filename).parents]
    words = FAILED + " ".join(repr(error).split())
    if not frames:
        return words
    place = (own or frames)[-1]
    path = Path(place.filename)
    name = path.relative_to(PACKAGE.parent).as_posix() if own else path.name
    return f"{words} at {name}, line {place.lineno}, in {place.name}"


def gathered(reasons: Mapping[str, str], runs: int) -> str:
    """Reasons by the runs' names in words, each once, with its runs unless it holds for all of so many."""
    names_of: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        names_of.setdefault(reason, []).append(name)
    return "; ".join(
        reason if len(names) == runs else f"{reason} ({', '.join(names)})" for reason, names in names_of.items()
    )


class NotApplicable(Exception):  # noqa: N818  not an error: most runs cannot feed some figure
    """A figure that cannot be drawn from a run; the message is the reason, in words for a user."""


class Tables:
    """Tables of a finished run, each read when it is first asked for, and once.

    Args:
        run: the run, of which all tables are checked.

    Attributes:
        run: the run.
        name: its name, which is printed on every figure, and the law that the bound is of, if that is in doubt.
        dimension: d of the spheres.
        design: "grid" or "random".
        noise_law: the law of the noise of a sample.
        independent: True if no two cells share their directions and noise.
        stored: names of the tables.

    Raises:
        RunError: if a table is missing, because the run did not finish, or its budget ended before any trial.
    """

    def __init__(self, run: Run) -> None:
        study = run.study
        names = ["errors"] if study.keep == "errors" else []
        names += ["summary", *(["points"] if study.keep_points else [])]
        names += ["posterior", "answers", "draws"] if run.has("posterior") else []
        for name in names:
            run.require(name)
        self.run, self.stored = run, frozenset(names)
        self.name = " · ".join(filter(None, [study.run_name(), bound_law(study.design.given())]))
        self.dimension, self.design = study.dimension, study.design.kind
        self.noise_law, self.independent = study.noise_law, study.independent()
        if self.summary.empty:
            raise RunError(f"{run.folder}: {NO_TRIAL}")

    def cells(self, columns: Collection[str]) -> Iterator[pd.DataFrame]:
        """Columns of the error table of a grid, some whole cells at a time: it may be larger than the memory."""
        return Grouped(self.run).cells(columns)

    def first_trials(self, most: int) -> pd.DataFrame:
        """The first trials of the error table of a random design, at most so many."""
        path = self.run.require("errors")
        rows: pd.DataFrame = TableRows(path).rows(0, most * len(self.estimators)).to_pandas()
        return rows

    def require_grid(self, isotropic: bool = False) -> None:
        """Raise `NotApplicable` unless the design is a grid, and the noise isotropic where a figure's bound is."""
        if self.design != "grid":
            raise NotApplicable('needs many trials of each condition: kind = "grid" in the config')
        if isotropic and not self.noise_law.isotropic:
            raise NotApplicable("compares with an isotropic bound: needs a config without noise_shape")

    def efficient(self, angles: "pd.Series[float]") -> "pd.Series[float]":
        """For each half-angle in degrees the median over √tr CRLB of Gaussian errors at the bound: figures' unit."""
        d = self.dimension
        unit = {angle: median_at_bound(cap_moments(math.radians(angle), d), d) for angle in angles.unique()}
        return angles.map(unit)

    def require_errors(self) -> None:
        """Raise `NotApplicable` if the study kept its summary alone."""
        if "errors" not in self.stored:
            raise NotApplicable('needs every error: keep = "errors" in the config')

    @cached_property
    def summary(self) -> pd.DataFrame:
        """The summary table; see `study.simulation.runs.schemas.summary`."""
        return stored_summary(self.run)

    def require_all_trials(self, name: str) -> None:
        """Raise `NotApplicable` if a measure of all trials is not known in some cell."""
        if self.summary[name].isna().any():
            words = "the run is of an earlier version, which kept no medians of all trials"
            raise NotApplicable(f"{words}: run its config again, in another folder (--out)")

    def by_area(self) -> pd.DataFrame:
        """The summary's rows of directions by area, which have an attainable bound.

        Raises:
            NotApplicable: if there are none.
        """
        if DIRECTIONS.name not in self.summary:
            return self.summary
        rows = self.summary[self.summary[DIRECTIONS.name] == DIRECTIONS.default]
        if rows.empty:
            raise NotApplicable(f'compares with bounds of directions by area: {DIRECTIONS.name} has no "area"')
        return rows

    def require_directions_by_area(self) -> None:
        """Raise `NotApplicable` if directions have another law than the bounds that a figure draws."""
        if DIRECTIONS.name in self.summary and set(self.summary[DIRECTIONS.name]) != {DIRECTIONS.default}:
            raise NotApplicable(f"compares with bounds of directions by area: needs a config without {DIRECTIONS.name}")

    @cached_property
    def points(self) -> pd.DataFrame | None:
        """The points of the trials that were kept; None if none were."""
        return self._if_stored("points")

    @cached_property
    def posterior(self) -> pd.DataFrame | None:
        """A row per chain; None if none was run. See `study.simulation.runs.schemas.posterior`."""
        return self._if_stored("posterior")

    @cached_property
    def answers(self) -> pd.DataFrame | None:
        """The estimators' answers beside the chains, likewise."""
        return self._if_stored("answers")

    @cached_property
    def draws(self) -> pd.DataFrame | None:
        """Draws of the chains that were kept, likewise."""
        return self._if_stored("draws")

    def _if_stored(self, name: str) -> pd.DataFrame | None:
        return self.run.table(name) if name in self.stored else None

    @cached_property
    def regret(self) -> pd.DataFrame:
        """The table of `study.simulation.analysis.regret.by_cell` of a grid with its errors."""
        return by_cell(self.cells(NEEDED), self.estimators)

    @cached_property
    def trials(self) -> int:
        """Number of data sets of all cells."""
        return int(self._of_one["planned"].sum())

    @cached_property
    def samples(self) -> int:
        """Number of points in the data sets of all cells."""
        if self.design == "random" and "errors" in self.stored:  # a row of the summary has many numbers of samples
            return int(self.run.table("errors", ["samples"], self.estimators[:1])["samples"].sum())
        return int((self._of_one["planned"] * self._of_one["samples"]).sum())

    @property
    def _of_one(self) -> pd.DataFrame:
        return self.summary[self.summary["estimator"] == self.estimators[0]]

    @cached_property
    def worst(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """The worst trials, and the worst of each group of the summary and estimator; see `worst_of_run`."""
        self.require_errors()
        return worst_of_run(self.run)

    def release(self) -> None:
        """Forget all tables but the summary, which may be large."""
        for name in ("points", "posterior", "answers", "draws"):
            vars(self).pop(name, None)

    @cached_property
    def estimators(self) -> list[str]:
        """Names of the estimators, in the order of the config."""
        return [str(name) for name in self.summary["estimator"].unique()]


class FigureModule(Protocol):
    """Protocol of a figure: a module, or an object with a docstring of its own."""

    def prepare(self, tables: Tables) -> Any:
        """Compute the frame; raise `NotApplicable` if the run lacks what it needs."""

    def draw(self, frame: Any) -> Figure:
        """Draw the frame."""


def own_folder(run: Run) -> Path:
    """A run's own folder of pictures."""
    return run.folder / "figures"


def at_first(table: pd.DataFrame, besides: Collection[str]) -> pd.DataFrame:
    """Rows in which every condition has the value of the first row.

    Args:
        table: errors or their summary.
        besides: names of conditions that may have any value.
    """
    for condition in STORED:
        if condition.name in table and condition.name not in besides:
            chosen = table[condition.name] == table[condition.name].iloc[0]
            table = table if chosen.all() else table[chosen]  # a copy of millions of rows takes seconds
    return table


def look(estimator: str, size: float) -> dict[str, Any]:
    """Colour and mark of an estimator's curve, for marks of a size in points."""
    colour, marker = style.color(estimator), style.marker(estimator)
    return {"color": colour, "marker": marker, "markersize": size, "markeredgewidth": 0.0}


def handle(estimator: str) -> Line2D:
    """Legend entry of an estimator."""
    return Line2D([], [], **look(estimator, 3.5) | {"markeredgewidth": 1.0}, label=style.label(estimator))


def finite(values: "pd.Series[float]") -> Floats:
    """Values for a curve: NaN, which leaves a gap, where they are infinite."""
    return np.where(np.isfinite(values), values, np.nan)


def behind_medians(tables: Tables, trials: int, medians: pd.DataFrame | None = None) -> str:
    """A stamp: the run, the least number of trials, and the usual standard error of medians (ratio, error)."""
    words = f"{tables.name} · at least {trials:,} trials behind each median"
    if medians is None:
        return words
    relative = finite(medians["error"] / finite(medians["ratio"]))
    known = relative[~np.isnan(relative)]
    return words + (f", usual standard error {100.0 * np.median(known):.1f} %" if len(known) else "")


def side_by_side(ax: Axes, rows: pd.DataFrame, names: Sequence[str], dodge: float, size: float, **line: Any) -> None:
    """Draw medians (ratio) at their places (at) with 95 % intervals (error), those of several estimators apart."""
    ax.axhline(1.0, color="black", linewidth=0.8)
    ax.grid(visible=False, axis="x")
    for number, name in enumerate(names):
        mine = rows[rows["estimator"] == name]
        x = mine["at"] + dodge * (number - 0.5 * (len(names) - 1))
        bars = 1.96 * finite(mine["error"])
        ax.errorbar(x, finite(mine["ratio"]), yerr=bars, elinewidth=1.0, **look(name, size), **line)


def plain_ticks(ax: Axes, ticks: Iterable[float], low: float, high: float) -> None:
    """Make the vertical axis logarithmic; of these ticks it has those within the limits, written as they are."""
    shown = [tick for tick in ticks if low <= tick <= high]
    ax.set_yscale("log")
    ax.set_yticks(shown, [f"{tick:g}" for tick in shown])
    ax.minorticks_off()


def log_axes(ax: Axes) -> None:
    """Make both axes logarithmic."""
    ax.set_xscale("log")
    ax.set_yscale("log")


class NestedCondition(NamedTuple):
    """A condition that varies in a grid.

    Attributes:
        symbol: of the condition.
        values: its values in words, in the order of the config.
        place: of its value in them, for each cell in the order of the loops (cells,).
    """

    symbol: str
    values: list[str]
    place: Ints


def loops(tables: Tables, most: int = MOST_CELLS) -> tuple[list[NestedCondition], dict[str, int]]:
    """The conditions that vary in a grid, those of few values outermost, and the place of each group in their order.

    Args:
        tables: of the run.
        most: largest number of cells.

    Raises:
        NotApplicable: if the design is no grid, or has too few or too many cells.
    """
    tables.require_grid()
    cells = tables.summary.drop_duplicates("group").set_index("group")
    if not FEWEST_CELLS <= len(cells) <= most:
        raise NotApplicable(f"the grid has {len(cells):,} cells; {FEWEST_CELLS} to {most} can be drawn side by side")
    words = {c: [c.label(row) for _, row in cells.iterrows()] for c in distinguishing(cells)}
    varying = {c: list(dict.fromkeys(labels)) for c, labels in words.items() if len(set(labels)) > 1}
    nested = sorted(varying, key=lambda c: len(varying[c]))
    codes = [np.array([varying[c].index(label) for label in words[c]]) for c in nested]
    order = np.lexsort(codes[::-1])
    result = [
        NestedCondition(c.symbol, [value.removeprefix(f"{c.symbol} = ") for value in varying[c]], code[order])
        for c, code in zip(nested, codes, strict=True)
    ]
    return result, {str(cells.index[cell]): place for place, cell in enumerate(order)}


def draw_loops(ax: Axes, nested: Sequence[NestedCondition]) -> None:
    """Draw a line for each condition, which steps up with its value, and name its values."""
    for number, loop in enumerate(nested):
        base, count = -float(number), len(loop.place)
        height = base + 0.1 + 0.5 * loop.place / (len(loop.values) - 1)
        ax.stairs(height, np.arange(count + 1) - 0.5, baseline=None, color=style.INK, linewidth=0.9)
        values = loop.values if len(loop.values) <= _NAMED else [*loop.values[: _NAMED - 2], "…", loop.values[-1]]
        words = f"{loop.symbol}: {', '.join(values)}"
        ax.text(-0.5, base + 0.68, words, fontsize=style.SMALL, va="bottom", color=style.INK)
    ax.set_ylim(0.0 - len(nested) + 1.0, 1.05)
    ax.set_xlim(-0.5, len(nested[0].place) - 0.5)
    ax.set_axis_off()
