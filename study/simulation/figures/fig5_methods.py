"""Figure 5: the circles of MLE, UGDK and GDKE on the data set of figures 3 and 4.

The paper's figure 5 overlays the three and concludes that UGDK removes the bias of GDKE and is close to MLE.

Look at: the order of the centres, GDKE's pulled towards the points by half a radius, the other two near the truth. One
data set cannot say which of those two is better; the spreads in figure 4 and the run's summary can.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from study import style
from study.simulation.figures.arc import (
    DataSet,
    FittedCircle,
    choose,
    draw_data,
    frame_axes,
    panels,
    window,
    write_below,
)
from study.simulation.figures.figure import Tables

METHODS = ["mle", "ugdk", "gdke"]


@dataclass(frozen=True)
class MethodsFrame:
    """Content of figure 5.

    Attributes:
        data: the data set.
        circles: each method's, in the order of their centres along the axis.
        same: for each method the other estimators that give the same circle.
    """

    data: DataSet
    circles: dict[str, FittedCircle]
    same: dict[str, list[str]]


def prepare(tables: Tables) -> MethodsFrame:
    """Choose the data set and collect the circles.

    Raises:
        NotApplicable: see `study.simulation.figures.arc.choose`.
    """
    data = choose(tables, METHODS)
    circles = {name: data.fits[name] for name in sorted(METHODS, key=lambda name: data.fits[name].x)}
    others = {name: fit for name, fit in data.fits.items() if name not in METHODS}
    same = {
        name: [other for other, fit in others.items() if np.allclose(fit, circle, atol=1e-9)]
        for name, circle in circles.items()
    }
    return MethodsFrame(data, circles, same)


@style.journal()
def draw(frame: MethodsFrame) -> Figure:
    """Draw the circles on the left, their centres enlarged on the right."""
    figure, whole, zoom = panels()
    draw_data(whole, frame.data)
    zoom.plot(0.0, 0.0, marker="+", color="black", markersize=9, markeredgewidth=1.2, zorder=6)
    for name, circle in frame.circles.items():
        color, marker = style.color(name), style.marker(name)
        center = circle.x, circle.y
        whole.add_patch(Circle(center, circle.radius, fill=False, linewidth=1.2, edgecolor=color, zorder=4))
        for ax in (whole, zoom):
            ax.plot(*center, marker=marker, color=color, markersize=4, zorder=5)
    span = max(1.25, *(max(abs(c.x), abs(c.y)) + c.radius + 0.05 for c in frame.circles.values()))
    whole.set_xlim(-span, span)
    whole.set_ylim(-span, span)
    whole.set_title("fitted circles", loc="left")
    _enlarge(zoom, frame)
    style.stamp(figure, frame.data.stamp)
    return figure


def _enlarge(ax: Axes, frame: MethodsFrame) -> None:
    """Show the centres alone, each named beside its mark, with numbers below."""
    x, y = ([getattr(circle, axis) for circle in frame.circles.values()] + [0.0] for axis in "xy")
    left, right, bottom, top = window(x, y, pad=0.25, spare=0.67, below=0.3)  # room above for the names
    ax.set_xlim(left, right)
    ax.set_ylim(bottom, top)
    frame_axes(ax)
    ax.yaxis.set_major_locator(MaxNLocator(3))
    # names at different heights, the leftmost highest, so that neighbours do not overlap
    small: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "fontsize": style.SMALL}
    line = {"arrowstyle": "-", "linewidth": 0.6, "color": style.FAINT, "shrinkA": 0, "shrinkB": 3}
    for rung, (name, circle) in enumerate(reversed(frame.circles.items())):
        at = circle.x, circle.y
        ax.annotate(style.label(name), at, (0, 10 + 11 * rung), color=style.color(name), arrowprops=line, **small)
    ax.annotate("true centre", (0.0, 0.0), (0, -7), va="top", **small)
    ax.set_title("their centres", loc="left")
    write_below(ax, [frame.data.caption, *_words(frame)])


def _words(frame: MethodsFrame) -> list[str]:
    """The circles in numbers, the best first, each with the estimators that coincide with it."""
    lines = []
    for name, circle in sorted(frame.circles.items(), key=lambda item: item[1].off):
        off, wider = style.number(circle.off), style.number(circle.radius - 1.0)
        lines.append(f"{style.label(name)}: centre {off} r off, radius off by {wider} r")
        if same := frame.same[name]:
            lines[-1] += f"; the same: {', '.join(map(style.label, same))}"
    return lines
