"""Coverage: how often intervals and standard errors hold the true radius, from little noise to much.

A point is a cell; its colour is the number of samples, its bar the Monte-Carlo standard error. A column of panels is
for an estimator ± t of its own standard errors, the last for the interval from the points alone. Above are all fits,
below those that the estimator calls ok by its own status; of the interval, those that the points identify. Cells with
fewer than a fifth of such fits are left out below. The grey band is 0.93 to 0.97.

Look at: the interval within the band up to σ = 0.2 r and near it up to 0.5 r, above and below; and the standard errors,
which leave it where the noise grows, most of all among the fits that the estimators call ok.
"""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from study import style
from study.arrays import Bools
from study.fits import Status
from study.simulation import statistics
from study.simulation.analysis.error_table import Grouped
from study.simulation.experiment.compute import Columns
from study.simulation.experiment.conditions import KAPPA
from study.simulation.experiment.measures import LEVEL
from study.simulation.figures.figure import Frame, NotApplicable, Tables

BAND = 0.93, 0.97
"""Coverage that counts as near the level."""
INTERVAL = "interval"
_NEEDS = (INTERVAL, "own_errors")
_GREY = "#dddddd"
_LEAST_OK = 0.2
"""Cells in which fewer fits are ok are left out of the lower row."""


def prepare(tables: Tables) -> Frame:
    """Shares and median widths of every cell, from the errors, some cells at a time.

    Returns:
        cells: a row per cell and method, an estimator or "interval": ``samples``, ``angle``, ``sigma`` (over the
            radius), ``kappa`` if the config has it, ``trials``; ``radius``, ``axis``, ``across``: share of all trials
            in which the truth is covered, of the radius, of the centre along the cap's axis and across it; ``ok``:
            share of fits that are ok by the estimator's own status, and of intervals that are identified;
            ``radius_ok``: coverage of the radius of those; ``open``: share without an upper end; ``width``: median
            width over that of ± t standard deviations of the bound. Beside each its Monte-Carlo error, ``…_error``.
        stamp: the run's name and trials.

    Raises:
        NotApplicable: unless the design is a grid with its errors and both measures of intervals.
    """
    tables.require_grid()
    tables.require_errors()
    study = tables.run.study
    if not set(_NEEDS) <= set(study.measures):
        raise NotApplicable(f"needs measures = {list(_NEEDS)} in the config")
    kappa = [KAPPA.name] if KAPPA in study.conditions() else []
    known = ["samples", "angle", *kappa, "noise", "radius", "status", *(column.name for column in study.measured())]
    grouped, rows = Grouped(tables.run), []
    for keys in grouped.batches(known):
        for (_, estimator), fits in grouped.read(keys, known).items():
            cell = {name: fits[name][0] for name in ("samples", "angle", *kappa)}
            cell |= {"sigma": fits["noise"][0] / fits["radius"][0], "trials": len(fits["status"])}
            rows.append(cell | {"method": estimator} | _measured(fits, "own_errors", fits["status"] == Status.OK))
            if estimator == study.estimators[-1]:  # the intervals are the same beside each
                rows.append(cell | {"method": INTERVAL} | _measured(fits, INTERVAL, fits["interval_identified"]))
    cells = pd.DataFrame(rows)
    return Frame(cells=cells, stamp=f"{tables.name} · at least {cells['trials'].min():,} trials a cell")


def _measured(fits: Columns, name: str, ok: Bools) -> dict[str, float]:
    """Shares of a cell by one method, and the median width, each with its error."""
    held, width = fits[f"{name}_radius"], fits[f"{name}_width"]
    hits = {"radius": held, "axis": fits[f"{name}_center_1"], "across": fits[f"{name}_center_2"], "ok": ok}
    hits |= {"open": np.isinf(width), "radius_ok": held[ok]}
    measured = {column: statistics.share(int(np.sum(values)), len(values)) for column, values in hits.items()}
    measured["width"] = statistics.quantile(width, 0.5)
    values = {column: measure.value for column, measure in measured.items()}
    return values | {f"{column}_error": measure.error for column, measure in measured.items()}


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw a column of panels per method, with one legend above."""
    cells: pd.DataFrame = frame.cells
    methods, numbers = list(dict.fromkeys(cells["method"])), sorted(cells["samples"].unique())
    figure = style.Picture(figsize=(style.PAGE, 4.4), layout="constrained")
    axes = figure.subplots(2, len(methods), sharex=True, sharey="row", squeeze=False)
    for column, method in enumerate(methods):
        part = cells[cells["method"] == method]
        _points(axes[0, column], part, "radius", numbers)
        _points(axes[1, column], part[part["ok"] >= _LEAST_OK], "radius_ok", numbers)
        title = "interval" if method == INTERVAL else f"{style.label(method)} ± t s.e."
        axes[0, column].set_title(title, loc="left")
        axes[1, column].set_xlabel("noise σ / radius")
    axes[0, 0].set_ylabel("coverage, all fits")
    axes[1, 0].set_ylabel("coverage, fits that are ok")
    handles = [
        Line2D([], [], ls="", marker="o", ms=4, color=color, label=f"N = {n:,}")
        for n, color in zip(numbers, style.shades(len(numbers)), strict=True)
    ]
    grey = Patch(color=_GREY, label=f"{BAND[0]:.3g} to {BAND[1]:.3g}")
    figure.legend(handles=[*handles, grey], loc="outside upper center", ncols=min(len(handles) + 1, 7))
    style.stamp(figure, frame.stamp)
    return figure


def _points(ax: Axes, part: pd.DataFrame, column: str, numbers: list[int]) -> None:
    """Cells of one method; log-odds would hide a coverage of zero, so the axis is linear."""
    ax.axhspan(*BAND, color=_GREY, linewidth=0.0, zorder=0)
    ax.axhline(LEVEL, color="black", linewidth=0.6, zorder=1)
    for n, color in zip(numbers, style.shades(len(numbers)), strict=True):
        rows = part[part["samples"] == n]
        ax.errorbar(rows["sigma"], rows[column], rows[f"{column}_error"], fmt="o", ms=2.6, lw=0.6, color=color)
    ax.set_xscale("log")
    ax.set_ylim(-0.03, 1.03)
    ax.set_yticks(np.arange(0.0, 1.01, 0.2))
