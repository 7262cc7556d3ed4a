"""Coverage of the radius against the noise: over all fits, and over the fits that are called ok.

A point is a cell; its colour is the number of samples. The band is .93 to .97. Look at: the interval within the band
up to σ = .2 r and near it up to .5 r, above and below; and the standard errors, which leave it where the noise grows,
most of all among the fits that the estimators call ok.
"""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study.coverage.measure import INTERVAL
from study.figures import style

_LEVEL, _LOW, _HIGH = 0.95, 0.93, 0.97
_LEAST_OK = 0.2
"""Cells in which fewer fits are ok are left out of the lower row."""
_COLORS = ("#56b4e9", "#0072b2", "#009e73", "#e69f00", "#d55e00", "#882255")


@style.journal()
def draw(table: pd.DataFrame, stamp: str) -> Figure:
    """Draw the table of `study.coverage.measure.measure`: a column of panels per method."""
    methods = list(dict.fromkeys(table["method"]))
    numbers = sorted(table["samples"].unique())
    figure = Figure(figsize=(style.PAGE, 4.4), layout="constrained")
    axes = figure.subplots(2, len(methods), sharex=True, sharey="row", squeeze=False)
    for column, method in enumerate(methods):
        part = table[table["method"] == method]
        often = part[part["ok"] >= _LEAST_OK]
        _points(axes[0, column], part, "radius", numbers)
        _points(axes[1, column], often, "radius_ok", numbers)
        title = "interval" if method == INTERVAL else f"{style.label(method)} ± t s.e."
        axes[0, column].set_title(title, loc="left")
        axes[1, column].set_xlabel("noise σ / radius")
    axes[0, 0].set_ylabel("coverage, all fits")
    axes[1, 0].set_ylabel("coverage, fits that are ok")
    handles = [
        Line2D([], [], linestyle="", marker="o", markersize=4, color=_COLORS[k % len(_COLORS)], label=f"N = {n:,}")
        for k, n in enumerate(numbers)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    style.stamp(figure, stamp)
    return figure


def _points(ax: Axes, part: pd.DataFrame, column: str, numbers: list[int]) -> None:
    """Cells of one method; log-odds would hide a coverage of zero, so the axis is linear."""
    ax.axhspan(_LOW, _HIGH, color="#dddddd", linewidth=0.0, zorder=0)
    ax.axhline(_LEVEL, color="black", linewidth=0.6, zorder=1)
    for k, n in enumerate(numbers):
        rows = part[part["samples"] == n]
        ax.errorbar(
            rows["sigma"],
            rows[column],
            yerr=rows[f"{column}_error"],
            fmt="o",
            markersize=2.6,
            linewidth=0.6,
            color=_COLORS[k % len(_COLORS)],
        )
    ax.set_xscale("log")
    ax.set_ylim(-0.03, 1.03)
    ax.set_yticks(np.arange(0.0, 1.01, 0.2))
