"""Regret: error of each estimator over that of the best estimator in each cell of a grid.

One row per estimator, the best on top; a point per cell, in a lane for each number of samples, few samples above. Left
is the median error, right its 95 % quantile. A cross is the geometric mean over all cells, written beside it. Points at
the right edge lie beyond it.

Look at: an estimator that is safe to use without knowing the cell has all of its points near 1, in both panels. If its
mean is small on the left but its points reach far on the right, it is usually good and sometimes much worse than the
best.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study import style
from study.simulation.analysis.regret import QUANTILES, regret
from study.simulation.figures.figure import Frame, NotApplicable, Tables

_FEWEST_CELLS = 6
_EDGE = 12.0
_TITLES = {"median": "median error", "q95": "95 % quantile of the error"}


def prepare(tables: Tables) -> Frame:
    """Regret in each cell, and its means.

    Returns:
        cells: a row per cell and estimator, see `study.simulation.analysis.regret.by_cell`.
        means: a row per estimator, the best first, see `study.simulation.analysis.regret.regret`.
        stamp: the run's name and its cells.

    Raises:
        NotApplicable: unless the design is a grid of at least six cells, with two estimators or more.
    """
    tables.require_grid()
    tables.require_errors()
    names, planned = tables.estimators, tables.summary.groupby("group", observed=True)["planned"].first()
    if len(planned) < _FEWEST_CELLS or len(names) < 2:
        raise NotApplicable(f"needs two estimators or more, and at least {_FEWEST_CELLS} cells in the grid")
    if planned.min() < 2:
        raise NotApplicable("needs two trials of each cell or more")
    cells = tables.regret
    means = regret(cells)
    means = means[means["samples"] == 0].sort_values("median", kind="stable")
    words = f"{len(planned)} cells in {tables.dimension} dimensions, of at least {planned.min():,} trials each"
    return Frame(cells=cells, means=means, stamp=f"{tables.name} · {words}")


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw the two panels, with one legend of the numbers of samples above."""
    names = list(frame.means["estimator"])
    figure = style.Picture(figsize=(style.PAGE, 1.1 + 0.42 * len(names)), layout="constrained")
    for ax, name in zip(figure.subplots(1, 2, sharex=True, sharey=True), QUANTILES, strict=True):
        _panel(ax, frame, name, names)
    figure.axes[0].set_yticks(range(len(names)), [style.label(name) for name in names])
    figure.axes[0].set_ylim(len(names) - 0.5, -0.5)
    sizes = sorted(frame.cells["samples"].unique())
    handles = [
        Line2D([], [], color=color, marker="o", linewidth=0, markersize=3.5, label=f"$N$ = {n:,}")
        for n, color in zip(sizes, style.shades(len(sizes)), strict=True)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=min(len(sizes), 6))
    style.stamp(figure, frame.stamp)
    return figure


def _panel(ax: Axes, frame: Frame, name: str, names: list[str]) -> None:
    """Draw the cells and the means of one quantile."""
    sizes = sorted(frame.cells["samples"].unique())
    colors = style.shades(len(sizes))
    for row, estimator in enumerate(names):
        mine = frame.cells[frame.cells["estimator"] == estimator]
        for place, samples in enumerate(sizes):
            ratios = mine[mine["samples"] == samples][name].to_numpy()
            ratios = ratios[np.logical_not(np.isnan(ratios))]
            lane = np.full(len(ratios), row + 0.64 * ((place + 0.5) / len(sizes) - 0.5))
            shown = np.minimum(ratios, _EDGE)
            ax.plot(
                shown, lane, "o", color=colors[place], markersize=2.4, markeredgewidth=0.0, alpha=0.8, clip_on=False
            )
        mean = float(frame.means.loc[frame.means["estimator"] == estimator, name].iloc[0])
        ax.plot(min(mean, _EDGE), row, "+", color=style.INK, markersize=9, markeredgewidth=1.3, zorder=4)
        at = ("axes fraction", "data"), "offset points"
        ax.annotate(style.decimals(mean, 2), (1.0, row), (6, 0), *at, va="center", fontsize=style.SMALL)
    ax.set_xscale("log")
    ax.set_xlim(1.0, _EDGE)
    ax.set_xticks([1, 2, 3, 5, 10], ["1", "2", "3", "5", "10"])
    ax.minorticks_off()
    ax.grid(visible=False, axis="y")
    cut = f"\nat the right edge: above {_EDGE:g}" if (frame.cells[name] > _EDGE).any() else ""
    ax.set_xlabel(f"over the best in the cell{cut}")
    ax.set_title(_TITLES[name], loc="left")
