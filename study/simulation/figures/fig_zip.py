"""Zip plot: the 95 % intervals of the radius, trial by trial, sorted by how far the truth is from the estimate.

A row is a cell. A column is an estimator ± t of its own standard errors; the last column is the interval from the
points alone. The height of an interval is its rank by that distance in its own half-widths (Morris, White & Crowther
2019). The lower half of the ranks is left out; of more than 5,000 intervals only every second, third, … is drawn. Red
intervals miss the truth. The dashed line is the rank of 95 %, and the band is its 95 % Monte-Carlo interval.

Look at: a zip that opens below the band. Red intervals on one side alone show a bias, and short ones a standard error
that is too small.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from study import style
from study.arrays import Floats
from study.simulation import statistics
from study.simulation.experiment.conditions import label
from study.simulation.experiment.measures import LEVEL
from study.simulation.figures.figure import Frame, NotApplicable, Tables

_MEASURE = "ends"
_CELLS, _ESTIMATORS = 4, 4
"""Largest numbers of rows, and of columns besides the last."""
_FEWEST = 20
_LOWEST = 0.5
"""Rank of the lowest interval that is drawn."""
_LINES = 5000
"""Intervals that a panel shows; of more, only every second, third, …"""
_WIDE = 2.5
"""Half-widths of the median interval that a panel shows on either side."""
_HELD, _MISSED, _GREY = "#7fa7c9", "#c1121f", "#dddddd"


def prepare(tables: Tables) -> Frame:
    """Ends of the intervals of each cell, sorted.

    Returns:
        panels: for each cell a list of (title, ends over the true radius (trials, 2), ranks (trials,), coverage).
        cells: words for each cell.
        stamp: the run's name and trials.

    Raises:
        NotApplicable: unless the design is a grid of few cells with its errors and the measure of the ends.
    """
    tables.require_grid()
    tables.require_errors()
    if _MEASURE not in tables.run.study.measures:
        raise NotApplicable(f'needs measures = ["{_MEASURE}"] in the config')
    cells = tables.summary.drop_duplicates("group")
    if len(cells) > _CELLS:
        raise NotApplicable(f"the grid has {len(cells):,} cells; a zip plot shows {_CELLS} at most")
    fewest, names = int(cells["planned"].min()), tables.estimators[:_ESTIMATORS]
    if fewest < _FEWEST:
        raise NotApplicable(f"a cell has {fewest} trials; ranks need {_FEWEST}")
    columns = [f"{_MEASURE}_{column}" for column in ("low", "high", "own_low", "own_high")]
    panels, words = [], []
    for _, cell in cells.iterrows():
        needed = ["cell", "estimator", "radius", "radius_error", *columns]
        here = tables.run.table("errors", needed, names, [cell["group"]])
        row = []
        for estimator in names:
            fits = here[here["estimator"].astype(str) == estimator]
            estimate = 1.0 + (fits["radius_error"] / fits["radius"]).to_numpy()
            row.append((f"{style.label(estimator)} ± t s.e.", *_sorted(estimate, fits[columns[2:]].to_numpy())))
        row.append(("interval", *_sorted(estimate, fits[columns[:2]].to_numpy())))
        panels.append(row)
        words.append(label(cell))
    return Frame(panels=panels, cells=words, stamp=f"{tables.name} · at least {fewest:,} trials in each panel")


def _sorted(estimate: Floats, ends: Floats) -> tuple[Floats, Floats, statistics.Measure]:
    """Ends by the distance of the truth, which is 1, from the estimate; their ranks; the share that holds the truth.

    Args:
        estimate: of the radius (n,).
        ends: of the intervals (n, 2).
    """
    toward = np.where(estimate < 1.0, ends[:, 1] - estimate, estimate - ends[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(toward > 0.0, np.abs(estimate - 1.0) / toward, np.inf)
    held = (ends[:, 0] <= 1.0) & (ends[:, 1] >= 1.0)
    order = np.lexsort([np.nan_to_num(distance, nan=np.inf), ~held])
    n = len(order)
    return ends[order], (np.arange(n) + 0.5) / n, statistics.share(int(held.sum()), n)


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw a panel of intervals for each cell and method."""
    rows, columns = len(frame.panels), len(frame.panels[0])
    figure = style.Picture(figsize=(style.PAGE, 0.7 + 1.9 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, sharex="row", sharey=True, squeeze=False)
    for of_cell, row, words in zip(axes, frame.panels, frame.cells, strict=True):
        width = np.median(np.concatenate([ends[:, 1] - ends[:, 0] for _, ends, _, _ in row]))
        reach = _WIDE * width if np.isfinite(width) else 1.0
        for ax, (title, ends, ranks, coverage) in zip(of_cell, row, strict=True):
            _intervals(ax, ends, ranks, (1.0 - reach, 1.0 + reach))
            share = f"{100.0 * coverage.value:.1f} ± {100.0 * coverage.error:.1f} %"
            ax.set_title(f"{title}\n{share}", loc="left", fontsize=8.0)
        of_cell[0].set_ylabel(f"{words.replace(', ', chr(10))}\nrank", fontsize=style.SMALL)
    axes[-1, columns // 2].set_xlabel("radius over true radius")
    keys = [Line2D([], [], color=_HELD, label="holds the truth"), Line2D([], [], color=_MISSED, label="misses it")]
    band = Patch(color=_GREY, label="rank of 95 %, Monte-Carlo interval")
    figure.legend(handles=[*keys, band], loc="outside upper center", ncols=3)
    style.stamp(figure, frame.stamp)
    return figure


def _intervals(ax: Axes, ends: Floats, ranks: Floats, limits: tuple[float, float]) -> None:
    """Draw the intervals of the upper ranks, cut at the limits."""
    error = 1.96 * statistics.share(round(LEVEL * len(ranks)), len(ranks)).error
    ax.axhspan(LEVEL - error, min(LEVEL + error, 1.0), color=_GREY, linewidth=0.0, zorder=0)
    ax.axhline(LEVEL, color="black", linewidth=0.6, linestyle=(0, (4, 2)), zorder=1)
    shown = np.flatnonzero((ranks >= _LOWEST) & ~np.isnan(ends).any(axis=1))
    shown = shown[:: -(-len(shown) // _LINES) or 1]
    low, high = np.clip(ends[shown], *limits).T
    held = (ends[shown, 0] <= 1.0) & (ends[shown, 1] >= 1.0)
    lines = np.stack([np.column_stack([low, ranks[shown]]), np.column_stack([high, ranks[shown]])], axis=1)
    thickness = min(2.0, 100.0 * (1.0 - _LOWEST) / max(len(shown), 1))
    colors = np.where(held, _HELD, _MISSED).tolist()
    ax.add_collection(LineCollection(list(lines), colors=colors, linewidths=thickness, rasterized=True))
    ax.axvline(1.0, color="black", linewidth=0.8)
    ax.set_xlim(*limits)
    ax.set_ylim(_LOWEST, 1.0)
    ax.grid(visible=False)
