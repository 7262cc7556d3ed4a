"""Shared drawing of figures 3 and 4: the whole circle on the left, its centre with error ellipses on the right.

The ellipses are centred on the estimate, as the paper draws them, and have the size of the estimator's spread over
all trials of the cell (`study.figures.paper.arc_data`). The dots are the centres fitted to other trials, so that the
ellipse can be judged by eye; they lie about the estimator's own median, not about the truth.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, Rectangle
from matplotlib.ticker import MaxNLocator

from study.figures import style
from study.figures.inputs import Tables
from study.figures.paper.arc_data import LEVELS, DataSet, Spread, choose, reach

Window = tuple[float, float, float, float]

_SHOWN_TRIALS = 500
_SHAPE = 0.36  # height over width


@dataclass(frozen=True)
class EllipseFrame:
    """Content of figure 3 or 4.

    Attributes:
        data: the data set.
        estimator: the one shown.
        window: left, right, bottom, top of the enlarged part, in radii from the true centre.
    """

    data: DataSet
    estimator: str
    window: Window

    @property
    def spread(self) -> Spread:
        """The estimator's spread."""
        return self.data.spreads[self.estimator]

    @property
    def distance(self) -> float:
        """From the estimate to the true centre, in standard deviations of the estimator."""
        fit = self.data.fits[self.estimator]
        return self.spread.distance(fit.x, fit.y)


def prepare(tables: Tables, estimator: str) -> EllipseFrame:
    """Choose the data set, and a window that holds both figures' ellipses, so that they can be compared.

    Raises:
        NotApplicable: see `study.figures.paper.arc_data.choose`.
    """
    data = choose(tables, [estimator])
    shown = [name for name in ("gdke", "ugdk") if name in data.spreads]
    half = reach(LEVELS[-1]) * np.array([data.spreads[name].sd for name in shown])
    centers = np.array([[data.fits[name].x, data.fits[name].y] for name in shown])
    corners = np.vstack([centers - half, centers + half, [[0.0, 0.0]]])
    (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
    return EllipseFrame(data, estimator, window([left, right], [bottom, top], pad=0.1, spare=0.3))


def window(x: Sequence[float], y: Sequence[float], pad: float, spare: float, below: float = 0.5) -> Window:
    """Left, right, bottom and top of a window of fixed shape, with room for the words below it.

    Args:
        x: positions that must be inside.
        y: likewise.
        pad: margin left and right, in parts of what must be inside.
        spare: least share of the height for labels above and below.
        below: share of the spare height that is below.
    """
    wide, tall = (1.0 + 2.0 * pad) * (max(x) - min(x)), (max(y) - min(y)) / (1.0 - spare)
    wide = max(wide, tall / _SHAPE)
    tall = _SHAPE * wide
    left, bottom = 0.5 * (min(x) + max(x) - wide), min(y) - below * (tall - max(y) + min(y))
    return left, left + wide, bottom, bottom + tall


@style.journal()
def draw(frame: EllipseFrame) -> Figure:
    """Draw the two panels."""
    figure = Figure(figsize=(style.PAGE, 2.95), layout="constrained")
    whole, zoom = figure.subplots(1, 2, width_ratios=[1.0, 1.45])
    _draw_whole(whole, frame)
    _draw_zoom(zoom, frame)
    style.stamp(figure, f"{frame.data.stamp}; spread over {frame.spread.known:,} trials")
    return figure


def draw_data(ax: Axes, data: DataSet) -> None:
    """The points, the true circle and its centre, on axes of equal scale."""
    ax.add_patch(Circle((0.0, 0.0), 1.0, fill=False, linewidth=0.8, linestyle=(0, (4, 2.5)), edgecolor="black"))
    ax.scatter(data.points["x"], data.points["y"], s=4, color="#777777", linewidths=0.0, zorder=3)
    ax.plot(0.0, 0.0, marker="+", color="black", markersize=7, markeredgewidth=1.0, zorder=6)
    ax.text(0.02, 0.015, "dashed: true circle", transform=ax.transAxes, va="bottom", fontsize=style.SMALL)
    frame_axes(ax)


def frame_axes(ax: Axes) -> None:
    """Name the axes and give them one scale; no grid, which would run through the words."""
    ax.grid(False)
    ax.set_aspect("equal", anchor="N")
    ax.set_xlabel("$(x_1 − c_1)/r$, along the arc's axis")
    ax.set_ylabel("$(x_2 − c_2)/r$")


def _draw_whole(ax: Axes, frame: EllipseFrame) -> None:
    data, color = frame.data, style.color(frame.estimator)
    fit = data.fits[frame.estimator]
    draw_data(ax, data)
    ax.add_patch(Circle((fit.x, fit.y), fit.radius, fill=False, linewidth=1.3, edgecolor=color, zorder=4))
    ax.plot(fit.x, fit.y, marker=style.marker(frame.estimator), color=color, markersize=4, zorder=5)
    left, right, bottom, top = frame.window
    ax.add_patch(
        Rectangle((left, bottom), right - left, top - bottom, fill=False, linewidth=0.6, edgecolor=style.FAINT)
    )
    span = max(1.25, abs(fit.x) + fit.radius + 0.1)
    ax.set_xlim(-span, span)
    ax.set_ylim(-span, span)
    ax.set_title(f"{style.label(frame.estimator)}'s circle", loc="left")


def _draw_zoom(ax: Axes, frame: EllipseFrame) -> None:
    data, spread, color = frame.data, frame.spread, style.color(frame.estimator)
    fit = data.fits[frame.estimator]
    others = data.errors[data.errors["estimator"] == frame.estimator].iloc[:_SHOWN_TRIALS]
    ax.scatter(others["x"], others["y"], s=3, color=style.FAINT, alpha=0.35, linewidths=0.0, zorder=2, rasterized=True)
    for level in LEVELS:
        width, height = (2.0 * reach(level) * sd for sd in spread.sd)
        ax.add_patch(Ellipse((fit.x, fit.y), width, height, fill=False, edgecolor=color, linewidth=1.0, zorder=4))
    ax.plot(fit.x, fit.y, marker=style.marker(frame.estimator), color=color, markersize=4, zorder=5)
    ax.plot(0.0, 0.0, marker="+", color="black", markersize=9, markeredgewidth=1.2, zorder=6)
    wide, tall = (reach(LEVELS[-1]) * sd for sd in spread.sd)
    left, right, bottom, top = frame.window
    ax.set_xlim(left, right)
    ax.set_ylim(bottom, top)
    beside: dict[str, Any] = {"textcoords": "offset points", "fontsize": style.SMALL, "zorder": 7}
    text = f"68 % and 95 % of {style.label(frame.estimator)}'s spread"
    if fit.x > 0.5 * (left + right) + wide:  # there is no room to its right
        ax.annotate(text, (fit.x + wide, fit.y + tall), (0, 4), ha="right", va="bottom", color=color, **beside)
    else:
        ax.annotate(text, (fit.x, fit.y + tall), (0, 4), ha="center", va="bottom", color=color, **beside)
    ax.annotate("true centre", (0.0, min(0.0, fit.y - tall)), (0, -6), ha="center", va="top", **beside)
    frame_axes(ax)
    ax.yaxis.set_major_locator(MaxNLocator(3))
    ax.set_title("the framed part", loc="left")
    write_below(ax, [data.caption, *_words(frame), _dots_words(others, frame.window)])


def write_below(ax: Axes, lines: list[str]) -> None:
    """Lines of words below a panel and its label."""
    wrapped = [part for line in lines for part in textwrap.wrap(line, 68, subsequent_indent="    ")]
    for row, words in enumerate(wrapped):
        below = (0, -40 - 11 * row)
        ax.annotate(words, (0.0, 0.0), below, "axes fraction", "offset points", va="top", fontsize=style.SMALL)


def _words(frame: EllipseFrame) -> list[str]:
    """Lines that give the bias and the coverage in numbers."""
    spread, trials = frame.spread, frame.data.trials
    bias, sd = style.number(spread.bias[0]), style.number(spread.sd[0])
    in_sd = style.decimals(spread.bias[0] / spread.sd[0], 1)
    return [
        f"median bias along the axis: {bias} r = {in_sd} sd (sd = {sd} r)",
        f"true centre: {frame.distance:.1f} sd from this estimate (the 95 % ellipse: {reach(LEVELS[-1]):.2f} sd)",
        f"95 % ellipses with the true centre inside: {spread.covered:,} of {trials:,} ({spread.covered / trials:.0%})",
    ]


def _dots_words(dots: pd.DataFrame, window: Window) -> str:
    left, right, bottom, top = window
    outside = int((~(dots["x"].between(left, right) & dots["y"].between(bottom, top))).sum())
    return f"dots: centres of {len(dots)} trials" + (f", {outside} of them off the scale" if outside else "")
