"""Map of efficiency: median error over the Cramér-Rao bound for every noise, angle and number of samples.

A row of panels per estimator, a panel per number of samples N; in each, relative noise to the right and the cap's
half-angle upwards. Relative noise is shown from 10⁻⁴, below which all are efficient but for rounding, to 10², above
which nothing changes. The unit is the median of an estimator with Gaussian errors at the bound. White is efficient, red
is worse. Pale blue beats the bound by being biased: do not read it as good. Medians are of all trials, whatever the
fit's status, so panels compare the same trials. A fit without a number counts as infinite. In hatched cells more than
half of the fits have no number, or the bound itself is infinite.

Look at: white ends where the noise reaches the cap's height, at small angles first. GDKE and LLS leave the bound at
less noise, and at even less with more samples, because a bias does not average out.
"""

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure

from study import style
from study.simulation.figures.figure import Frame, NotApplicable, Tables, at_first, behind_medians

_LEAST = 2
_FAR = 100.0
"""The scale ends here; below, at its inverse."""
_COLORS = LinearSegmentedColormap.from_list(
    "efficiency", ["#b4cfe4", "#c9ddec", "#e2edf5", "#ffffff", "#fdd0a2", "#e6550d", "#7f0000"]
)
_NOTHING = "#f2f2f2"
_SHOWN = (0.99e-4, 1.01e2)
"""Relative noise that is shown, if the run has at least two levels there."""


def prepare(tables: Tables) -> Frame:
    """Medians from the summary, at the first radius and centre.

    Returns:
        ratios: a row per estimator, N, angle and σ/r: the median error in units of an efficient estimator's; infinite
            where there is none.
        stamp: the run's name, trials and Monte-Carlo error.

    Raises:
        NotApplicable: unless the design is a grid with at least two angles and two levels of isotropic noise.
    """
    tables.require_grid(isotropic=True)
    tables.require_directions_by_area()
    tables.require_all_trials("ratio_median")
    result = at_first(tables.summary, besides=("samples", "noise", "angle"))
    # twelve digits: one level of a logspace may differ in its last bit from radius to radius
    level = np.array([float(f"{v:.12g}") for v in result["noise"] / result["radius"]])
    inside = (level >= _SHOWN[0]) & (level <= _SHOWN[1])
    if len(np.unique(level[inside])) >= _LEAST:
        result, level = result[inside], level[inside]
    for name, values in (("levels of noise", level), ("angles", result["angle"])):
        if len(np.unique(values)) < _LEAST:
            raise NotApplicable(f"needs at least {_LEAST} {name} in the grid")
    ratio = result["ratio_median"] / tables.efficient(result["angle"])
    ratios = result[["estimator", "samples", "angle"]].astype({"estimator": str, "samples": int})
    ratios = ratios.assign(level=level, ratio=ratio).reset_index(drop=True)
    medians = result[["ratio_median", "ratio_median_error"]].set_axis(["ratio", "error"], axis=1)
    return Frame(ratios=ratios, stamp=behind_medians(tables, int(result["planned"].min()), medians))


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw a row of panels per estimator, a column per number of samples, and one colour scale."""
    names = list(dict.fromkeys(frame.ratios["estimator"]))
    counts = sorted(frame.ratios["samples"].unique())
    figure = style.Picture(figsize=(style.PAGE, 0.9 + 0.95 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), len(counts), sharex=True, sharey=True, squeeze=False)
    norm = LogNorm(1.0 / _FAR, _FAR)
    for row, name in zip(axes, names, strict=True):
        for ax, count in zip(row, counts, strict=True):
            mine = frame.ratios[(frame.ratios["estimator"] == name) & (frame.ratios["samples"] == count)]
            mesh = _panel(ax, mine, norm)
        row[0].set_ylabel(f"{style.label(name)}\n$φ$", color=style.color(name), fontsize=8.5)
    for ax, count in zip(axes[0], counts, strict=True):
        power = round(math.log10(count))
        short = f"$10^{power}$" if count >= 1000 and 10**power == count else f"{count:,}"
        ax.set_title(f"$N$ = {short}", fontsize=8.0)
    axes[-1, len(counts) // 2].set_xlabel("noise over radius, $σ/r$")
    bar = figure.colorbar(mesh, ax=axes, extend="both", aspect=30, pad=0.01, fraction=0.03)
    bar.set_label("median error, efficient = 1; hatched: no number", fontsize=8.0)
    bar.set_ticks([0.01, 0.1, 1.0, 10.0, 100.0], labels=["≤0.01", "0.1", "1", "10", "≥100"])
    style.stamp(figure, frame.stamp)
    return figure


def _panel(ax: Axes, mine: pd.DataFrame, norm: LogNorm) -> QuadMesh:
    """Draw the panel of one estimator at one number of samples."""
    table = mine.pivot(index="angle", columns="level", values="ratio").sort_index().sort_index(axis=1)
    values = np.ma.masked_invalid(table.to_numpy())
    edges = np.arange(len(table) + 1)
    levels = np.log10(table.columns.to_numpy(dtype=float))
    half = 0.5 * np.diff(levels)
    borders = np.concatenate([[levels[0] - half[0]], levels[:-1] + half, [levels[-1] + half[-1]]])
    ax.set_facecolor(_NOTHING)
    ax.patch.set(hatch="//////", edgecolor="#b0b0b0", linewidth=0.0)
    ax.grid(visible=False)
    mesh = ax.pcolormesh(10.0**borders, edges, values, norm=norm, cmap=_COLORS, rasterized=True, linewidth=0)
    ax.set_xscale("log")
    ax.set_xlim(10.0 ** borders[0], 10.0 ** borders[-1])
    ax.set_yticks(edges[:-1] + 0.5, [f"{angle:g}°" for angle in table.index], fontsize=style.SMALL)
    first, last = math.ceil(levels[0]), math.floor(levels[-1])
    step = max(1, round((last - first) / 3))
    ax.set_xticks([10.0**k for k in range(first, last + 1) if k % step == 0], minor=False)
    ax.minorticks_off()
    ax.tick_params(axis="x", labelsize=6.5)
    ax.tick_params(length=2.0)
    return mesh
