"""Nested loops: the median error of each estimator in all cells of a grid, in the order of its conditions.

Above are the medians of error over bound as steps, a step for each cell (Rücker & Schwarzer 2014). Below, each
condition has a line that steps with its value; the condition that changes fastest is the lowest. The shade is the 95 %
Monte-Carlo interval.

Look at: the conditions whose lines step where the errors do. Estimators that lie on each other are drawn in the order
of the key, the last on top.
"""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from study import style
from study.simulation.figures.figure import (
    LOOP_HEIGHT,
    Frame,
    Tables,
    behind_medians,
    draw_loops,
    finite,
    handle,
    loops,
    plain_ticks,
)

_TICKS = [digit * 10.0**power for power in range(-3, 6) for digit in (1, 2, 5)]


def prepare(tables: Tables) -> Frame:
    """Medians of all trials in the order of the loops.

    Returns:
        loops: the conditions that vary, outermost first.
        medians: a row per estimator and cell: ``estimator``, ``at`` (its place), ``ratio`` and its ``error``.
        stamp: the run's name and trials.

    Raises:
        NotApplicable: see `study.simulation.figures.figure.loops`.
    """
    nested, places = loops(tables)
    tables.require_all_trials("ratio_median")
    summary = tables.summary
    medians = pd.DataFrame({"estimator": summary["estimator"].astype(str), "at": summary["group"].map(places)})
    medians["ratio"], medians["error"] = summary["ratio_median"], summary["ratio_median_error"]
    stamp = behind_medians(tables, int(summary["planned"].min()), medians)
    return Frame(loops=nested, medians=medians.sort_values("at", kind="stable"), stamp=stamp)


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw the steps of the estimators above those of the conditions."""
    below = LOOP_HEIGHT * len(frame.loops)
    figure = style.Picture(figsize=(style.PAGE, 3.0 + below), layout="constrained")
    ax, of_loops = figure.subplots(2, 1, sharex=True, height_ratios=[2.7, below])
    names = list(dict.fromkeys(frame.medians["estimator"]))
    ax.set_yscale("log")
    for name in names:
        mine = frame.medians[frame.medians["estimator"] == name]
        ratio, error = finite(mine["ratio"]), 1.96 * finite(mine["error"])
        edges = np.append(mine["at"], mine["at"].iloc[-1] + 1) - 0.5
        ax.stairs(ratio, edges, baseline=None, color=style.color(name), linewidth=1.2)
        low = np.maximum(ratio - error, 1e-3 * ratio)
        ax.stairs(
            np.minimum(ratio + error, 1e3 * ratio),
            edges,
            baseline=low,
            fill=True,
            color=style.color(name),
            alpha=0.18,
            linewidth=0,
        )
    plain_ticks(ax, _TICKS, *ax.get_ylim())
    ax.axhline(1.0, color="black", linewidth=0.8)
    ax.grid(visible=False, axis="x")
    ax.tick_params(axis="x", bottom=False)
    ax.set_ylabel("median error over √tr CRLB")
    figure.legend(handles=[handle(name) for name in names], loc="outside upper center", ncols=6)
    draw_loops(of_loops, frame.loops)
    style.stamp(figure, frame.stamp)
    return figure
