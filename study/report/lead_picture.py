"""Picture at the top of the page: error over the Cramér-Rao bound on one cap, with the attainable bound."""

import numpy as np
from matplotlib.figure import Figure

from study.figures import style
from study.figures.fig_efficiency import EfficiencyFrame

_SHOWN = ("gdke", "lls", "ugdk", "mle", "als", "corrected")
"""Estimators of the paper, and those to use instead, in the order of drawing."""


@style.journal()
def draw(frame: EfficiencyFrame, angle: float) -> Figure:
    """Draw one panel: few estimators, both bounds, the legend where no curve is.

    Args:
        frame: medians over the bound.
        angle: half-angle of the cap, in degrees, one of the frame's.
    """
    figure = Figure(figsize=(4.7, 3.7), layout="constrained")
    ax = figure.subplots()
    ax.set_xscale("log")
    ax.set_yscale("log")
    mine = frame.curves[frame.curves["angle"] == angle]
    names = [name for name in _SHOWN if name in set(mine["estimator"])] or list(dict.fromkeys(mine["estimator"]))[:6]
    for name in names:
        curve = mine[mine["estimator"] == name].sort_values("level")
        (line,) = ax.plot(curve["level"], curve["ratio"], linewidth=1.3, label=style.label(name))
        line.set(color=style.color(name), marker=style.marker(name), markersize=4, markeredgewidth=0.0)
    reached = frame.attainable[frame.attainable["angle"] == angle].sort_values("level")
    (line,) = ax.plot(reached["level"], reached["ratio"], color="black", zorder=4, label="attainable bound")
    line.set(linewidth=1.3, linestyle=(0, (4, 2)))
    ax.axhline(1.0, color="black", linewidth=0.9, label="Cramér-Rao bound", zorder=1)
    shown = mine["ratio"][mine["estimator"].isin(names) & np.isfinite(mine["ratio"])]
    ax.set_ylim(min(0.7, 0.8 * shown.min()), 1.5 * shown.max())
    ax.set_xlabel("noise over radius, $σ/r$")
    ax.set_ylabel("median error, Cramér-Rao bound = 1")
    ax.legend(loc="upper left", fontsize=8.0)
    return figure
