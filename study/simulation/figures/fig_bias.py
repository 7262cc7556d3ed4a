"""Bias and empirical error: of each estimator in all cells of a grid, with their Monte-Carlo intervals.

Above is the mean error along the cap's axis, below the root mean square error, both over the bound. They are of the
fits that are ok. Bars are 95 % Monte-Carlo intervals (Morris, White & Crowther 2019). Each condition has a line at the
bottom that steps with its value. A moment that does not exist, as far as the tail of the errors tells, has no mark.

Look at: bars that leave zero. An estimator whose bias is as large as its error has intervals that miss the truth.
"""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study import style
from study.simulation.figures.figure import (
    LOOP_HEIGHT,
    Frame,
    NotApplicable,
    Tables,
    behind_medians,
    draw_loops,
    finite,
    handle,
    look,
    loops,
    plain_ticks,
)

_MOST = 60
"""Cells beside which several estimators have room."""
_LARGE = 5.0
"""Bounds above which an axis is logarithmic beyond one bound."""
_TICKS = [0.3, *(digit * 10.0**power for power in range(6) for digit in (1, 3))]
_MOMENTS = {"bias": "mean axial error\nover √tr CRLB", "rmse": "rms error\nover √tr CRLB"}


def prepare(tables: Tables) -> Frame:
    """Moments of the errors in the order of the loops.

    Returns:
        loops: the conditions that vary, outermost first.
        moments: a row per estimator and cell: ``estimator``, ``at`` (its place), ``bias``, ``rmse`` and their errors.
        stamp: the run's name and trials.

    Raises:
        NotApplicable: if no moment is known; see `study.simulation.figures.figure.loops`.
    """
    nested, places = loops(tables, _MOST)
    columns = [f"{name}{end}" for name in _MOMENTS for end in ("", "_error")]
    moments = tables.summary[["estimator", *columns]].assign(at=tables.summary["group"].map(places))
    if moments["rmse"].isna().all():
        raise NotApplicable("no estimator's errors have a mean square, as far as their tails tell")
    stamp = behind_medians(tables, int(tables.summary["planned"].min())).replace("median", "moment")
    return Frame(loops=nested, moments=moments.astype({"estimator": str}).sort_values("at", kind="stable"), stamp=stamp)


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw two panels of bars above the steps of the conditions."""
    below = LOOP_HEIGHT * len(frame.loops)
    figure = style.Picture(figsize=(style.PAGE, 3.6 + below), layout="constrained")
    *axes, of_loops = figure.subplots(3, 1, sharex=True, height_ratios=[1.6, 1.6, below])
    table: pd.DataFrame = frame.moments
    names = list(dict.fromkeys(table["estimator"]))
    for ax, (moment, words) in zip(axes, _MOMENTS.items(), strict=True):
        for number, name in enumerate(names):
            mine = table[table["estimator"] == name]
            x = mine["at"] + 0.7 / len(names) * (number - 0.5 * (len(names) - 1))
            bars = 1.96 * finite(mine[f"{moment}_error"])
            ax.errorbar(x, finite(mine[moment]), yerr=bars, elinewidth=0.9, linestyle="none", **look(name, 3.0))
        ax.axhline(0.0 if moment == "bias" else 1.0, color="black", linewidth=0.8)
        ax.grid(visible=False, axis="x")
        ax.set_ylabel(words)
        ax.tick_params(axis="x", bottom=False)
        if float(np.nanmax(np.abs(table[moment]))) > _LARGE:
            _widen(ax, signed=moment == "bias")
    figure.legend(handles=[handle(name) for name in names], loc="outside upper center", ncols=6)
    draw_loops(of_loops, frame.loops)
    style.stamp(figure, frame.stamp)
    return figure


def _widen(ax: Axes, signed: bool) -> None:
    """Make the vertical axis logarithmic; one with a sign is linear within a bound of zero."""
    low, high = ax.get_ylim()
    if not signed:
        ax.set_yscale("log")
        plain_ticks(ax, _TICKS, *ax.get_ylim())
        return
    ax.set_yscale("symlog", linthresh=1.0)
    low, high = ax.set_ylim(1.3 * low, 1.3 * high)
    ticks = [tick for tick in (*(-tick for tick in _TICKS), 0.0, *_TICKS) if low <= tick <= high and abs(tick) != 0.3]
    ax.set_yticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
    ax.minorticks_off()
