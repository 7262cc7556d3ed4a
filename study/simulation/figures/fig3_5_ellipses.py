"""Figures 3, 4 and 5 of one noisy arc: two with error ellipses, one with the circles of three methods.

The paper shows one arc of 100 points with noise 0.05 and says of it that the spectral radius ρ(Σ̂C⁻¹), UGDK's Leontief
condition, is 0.557238. Of the trials whose points are stored, the one with the nearest ρ is taken, for all the figures.
Lengths are in radii, and positions are measured from the true centre. The axis of the arc is the first coordinate;
errors along and across it are uncorrelated, because the arc is its own mirror image. Spreads are robust, because UGDK's
errors have neither variance nor mean.

On the left is the whole circle, on the right its centre with error ellipses. They are centred on the estimate, as the
paper draws them, and have the size of the estimator's spread over all trials of the cell (`choose`). The dots are the
centres fitted to other trials, so that the ellipse can be judged by eye; they lie about the estimator's own median, not
about the truth.
"""

import math
import textwrap
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, Rectangle
from matplotlib.ticker import MaxNLocator

from study import style
from study.arrays import Floats
from study.fits import Status
from study.simulation.claims.ugdk import PAPER_CONDITION
from study.simulation.figures.figure import FigureModule, Frame, NotApplicable, Tables
from study.simulation.statistics import inside, quantile, robust_sd

LEVELS = (0.68, 0.95)
_LEAST_TRIALS = 50


class FittedCircle(NamedTuple):
    """A fitted circle: its centre, measured from the true one, and radius, in true radii."""

    x: float
    y: float
    radius: float

    @property
    def off(self) -> float:
        """Distance of its centre from the true one."""
        return math.hypot(self.x, self.y)


def choose(tables: Tables, estimators: list[str]) -> Frame:
    """Find the trial and measure its cell.

    Args:
        tables: the run.
        estimators: the ones that the figure is about, besides UGDK.

    Returns:
        trial: the trial's number.
        trials: how many trials its cell has.
        condition: ρ of this trial.
        points: x, y of the points.
        fits: each estimator's fit to them.
        errors: estimator, x, y of the fitted centres of all trials of the cell that have a number.
        spreads: of each estimator; see `_spread`.
        caption: the conditions in words.
        stamp: the run and its trials.

    Raises:
        NotApplicable: if the run is not of circles on a grid, kept no points, or lacks an estimator or trials.
    """
    if tables.dimension != 2:
        raise NotApplicable(f"shows circles: needs dimension = 2 in the config, not {tables.dimension}")
    tables.require_grid()
    missing = [name for name in ["ugdk", *estimators] if name not in tables.estimators]
    if missing:
        raise NotApplicable(f"needs the estimator {' and '.join(dict.fromkeys(missing))}")
    if tables.points is None:
        raise NotApplicable("needs kept points: set keep_points in the config")
    tables.require_errors()
    points, columns = tables.points, ["cell", "trial", "estimator", "status", "condition"]
    kept = points[["cell", "trial"]].astype({"cell": str}).drop_duplicates()
    fits = tables.run.table("errors", columns, ["ugdk"], kept["cell"].unique()).astype({"cell": str})
    with_points = fits.merge(kept, on=["cell", "trial"])
    with_points = with_points[with_points["status"] == Status.OK]
    if with_points.empty:
        raise NotApplicable("UGDK has no ok fit among the trials whose points were kept")
    chosen = with_points.iloc[int((with_points["condition"] - PAPER_CONDITION).abs().to_numpy().argmin())]
    cell = tables.run.table("errors", cells=[chosen["cell"]])
    row = cell[(cell["trial"] == chosen["trial"]) & (cell["estimator"] == "ugdk")].iloc[0]
    trials = cell["trial"].nunique()
    if trials < _LEAST_TRIALS:
        raise NotApplicable(f"needs at least {_LEAST_TRIALS} trials of a cell to show a spread, not {trials}")
    radius = row["radius"]
    mine = points[(points["cell"] == row["cell"]) & (points["trial"] == row["trial"])]
    fits = cell[cell["trial"] == row["trial"]]
    known = cell[np.isfinite(cell["error"])]
    conditions = f"$N$ = {int(row['samples'])}, $σ/r$ = {row['noise'] / radius:.4g}, $φ$ = {row['angle']:g}°"
    columns = (known[["error_1", "error_2"]] / radius).set_axis(["x", "y"], axis=1)
    centers = columns.assign(estimator=known["estimator"].astype(str))
    spreads = {
        str(name): _spread(part[["x", "y"]].to_numpy()) for name, part in centers.groupby("estimator", sort=False)
    }
    axes = {"x": (mine["x_1"] - mine["center_1"]) / radius, "y": (mine["x_2"] - mine["center_2"]) / radius}
    numbers = fits[["estimator", "error_1", "error_2", "radius_error"]].to_numpy()
    circles = {str(fit): FittedCircle(x / radius, y / radius, 1.0 + r / radius) for fit, x, y, r in numbers}
    words = {"caption": f"{conditions}, $ρ$ = {row['condition']:.4f}"}
    words["stamp"] = f"{tables.name} · trial {row['trial']} of {trials:,}"
    measured = {"trial": int(row["trial"]), "trials": trials, "condition": float(row["condition"]), "spreads": spreads}
    return Frame(points=pd.DataFrame(axes), fits=circles, errors=centers, **measured, **words)


def _spread(errors: Floats) -> Frame:
    """Bias and spread of an estimator's centre, from its errors in radii (trials, 2).

    Returns:
        bias: median error along the axis and across it.
        sd: robust standard deviation along the axis and across it.
        covered: trials whose own 95 % ellipse, this spread about the estimate, has the true centre inside.
        known: trials whose fit has a number, whatever its status; the others count as not covered.
    """
    bias, sd = tuple(quantile(axis, 0.5).value for axis in errors.T), tuple(map(robust_sd, errors.T))
    return Frame(bias=bias, sd=sd, covered=int(inside(errors, np.array(sd), LEVELS[-1]).sum()), known=len(errors))


def reach(level: float) -> float:
    """Semi-axes, in standard deviations, of the ellipse that holds a bivariate normal with the given probability."""
    return math.sqrt(-2.0 * math.log1p(-level))


Window = tuple[float, float, float, float]

_SHOWN_TRIALS = 500
_SHAPE = 0.36  # height over width


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


class EllipseFigure:
    """Figure of one estimator's circle and ellipses; a subclass has its words."""

    estimator: str

    def prepare(self, tables: Tables) -> Frame:
        """Choose the data set, and a window that holds both figures' ellipses, so that they can be compared.

        Returns:
            data: the data set.
            estimator: the one shown.
            spread: the estimator's.
            distance: from the estimate to the true centre, in standard deviations of the estimator.
            window: left, right, bottom, top of the enlarged part, in radii from the true centre.

        Raises:
            NotApplicable: see `choose`.
        """
        data = choose(tables, [self.estimator])
        shown = [name for name in ("gdke", "ugdk") if name in data.spreads]
        half = reach(LEVELS[-1]) * np.array([data.spreads[name].sd for name in shown])
        centers = np.array([[data.fits[name].x, data.fits[name].y] for name in shown])
        corners = np.vstack([centers - half, centers + half, [[0.0, 0.0]]])
        (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
        spread, fit = data.spreads[self.estimator], data.fits[self.estimator]
        distance = math.hypot(fit.x / spread.sd[0], fit.y / spread.sd[1])
        shown_part = window([left, right], [bottom, top], pad=0.1, spare=0.3)
        return Frame(data=data, estimator=self.estimator, spread=spread, distance=distance, window=shown_part)

    @style.journal()
    def draw(self, frame: Frame) -> Figure:
        """Draw the two panels."""
        figure, whole, zoom = panels()
        _draw_whole(whole, frame)
        _draw_zoom(zoom, frame)
        style.stamp(figure, f"{frame.data.stamp}; spread over {frame.spread.known:,} trials")
        return figure


class GdkeEllipse(EllipseFigure):
    """Figure 3: GDKE's fit to a noisy arc, with its error ellipse: the true centre is not in it.

    The paper's figure 3 shows 100 points with noise 0.05 on an arc, and the circle that GDKE fits to them. An ellipse
    of the estimate's error is far from the true centre. That is GDKE's bias: it shrinks the circle towards the points.

    Look at: the distance from the cross (the truth) to the ellipses, and how many of all trials' ellipses hold the
    truth.
    """

    estimator = "gdke"


class UgdkEllipse(EllipseFigure):
    """Figure 4: UGDK's fit to the same noisy arc as figure 3, with its error ellipse: the true centre is in it.

    The paper's figure 4 shows the data of figure 3 with the circle of UGDK, which subtracts the known noise from the
    sample covariance. The true centre lies inside the ellipse.

    Look at: the bias is gone, and the ellipse has grown: four times as long as GDKE's, twice the bound. The dots show
    that the errors are not Gaussian: they trail off away from the points.
    """

    estimator = "ugdk"


def panels() -> tuple[Figure, Axes, Axes]:
    """A page-wide figure with a panel for the circles, and one for their centres enlarged."""
    figure = style.Picture(figsize=(style.PAGE, 2.95), layout="constrained")
    whole, zoom = figure.subplots(1, 2, width_ratios=[1.0, 1.45])
    return figure, whole, zoom


def draw_data(ax: Axes, data: Frame) -> None:
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


def _draw_whole(ax: Axes, frame: Frame) -> None:
    data, color = frame.data, style.color(frame.estimator)
    fit = data.fits[frame.estimator]
    draw_data(ax, data)
    ax.add_patch(Circle((fit.x, fit.y), fit.radius, fill=False, linewidth=1.3, edgecolor=color, zorder=4))
    ax.plot(fit.x, fit.y, marker=style.marker(frame.estimator), color=color, markersize=4, zorder=5)
    left, right, bottom, top = frame.window
    framed: style.Marks = {"fill": False, "linewidth": 0.6, "edgecolor": style.FAINT}
    ax.add_patch(Rectangle((left, bottom), right - left, top - bottom, **framed))
    span = max(1.25, abs(fit.x) + fit.radius + 0.1)
    ax.set(xlim=(-span, span), ylim=(-span, span))
    ax.set_title(f"{style.label(frame.estimator)}'s circle", loc="left")


def _draw_zoom(ax: Axes, frame: Frame) -> None:
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
    small: style.Marks = {"textcoords": "offset points", "fontsize": style.SMALL, "zorder": 7}
    text = f"68 % and 95 % of {style.label(frame.estimator)}'s spread"
    no_room = fit.x > 0.5 * (left + right) + wide  # to its right
    at, side = (fit.x + wide if no_room else fit.x, fit.y + tall), "right" if no_room else "center"
    ax.annotate(text, at, (0, 4), ha=side, va="bottom", color=color, **small)
    ax.annotate("true centre", (0.0, min(0.0, fit.y - tall)), (0, -6), ha="center", va="top", **small)
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


def _words(frame: Frame) -> list[str]:
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


METHODS = ["mle", "ugdk", "gdke"]


class MethodsFigure:
    """Figure 5: the circles of MLE, UGDK and GDKE on the data set of figures 3 and 4.

    The paper's figure 5 overlays the three and concludes that UGDK removes the bias of GDKE and is close to MLE.

    Look at: the order of the centres, GDKE's pulled towards the points by half a radius, the other two near the truth.
    One data set cannot say which of those two is better; the spreads in figure 4 and the run's summary can.
    """

    def prepare(self, tables: Tables) -> Frame:
        """Choose the data set and collect the circles.

        Returns:
            data: the data set.
            circles: each method's, in the order of their centres along the axis.
            same: for each method the other estimators that give the same circle.

        Raises:
            NotApplicable: see `choose`.
        """
        data = choose(tables, METHODS)
        circles = {name: data.fits[name] for name in sorted(METHODS, key=lambda name: data.fits[name].x)}
        others = {name: fit for name, fit in data.fits.items() if name not in METHODS}
        same = {
            name: [other for other, fit in others.items() if np.allclose(fit, circle, atol=1e-9)]
            for name, circle in circles.items()
        }
        return Frame(data=data, circles=circles, same=same)

    @style.journal()
    def draw(self, frame: Frame) -> Figure:
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
        _draw_centres(zoom, frame)
        style.stamp(figure, frame.data.stamp)
        return figure


def _draw_centres(ax: Axes, frame: Frame) -> None:
    """Show the centres alone, each named beside its mark, with numbers below."""
    x, y = ([getattr(circle, axis) for circle in frame.circles.values()] + [0.0] for axis in "xy")
    left, right, bottom, top = window(x, y, pad=0.25, spare=0.67, below=0.3)  # room above for the names
    ax.set_xlim(left, right)
    ax.set_ylim(bottom, top)
    frame_axes(ax)
    ax.yaxis.set_major_locator(MaxNLocator(3))
    # names at different heights, the leftmost highest, so that neighbours do not overlap
    small: style.Marks = {"textcoords": "offset points", "ha": "center", "fontsize": style.SMALL}
    line = {"arrowstyle": "-", "linewidth": 0.6, "color": style.FAINT, "shrinkA": 0, "shrinkB": 3}
    for rung, (name, circle) in enumerate(reversed(frame.circles.items())):
        at = circle.x, circle.y
        ax.annotate(style.label(name), at, (0, 10 + 11 * rung), color=style.color(name), arrowprops=line, **small)
    ax.annotate("true centre", (0.0, 0.0), (0, -7), va="top", **small)
    ax.set_title("their centres", loc="left")
    write_below(ax, [frame.data.caption, *_circle_words(frame)])


def _circle_words(frame: Frame) -> list[str]:
    """The circles in numbers, the best first, each with the estimators that coincide with it."""
    lines = []
    for name, circle in sorted(frame.circles.items(), key=lambda item: item[1].off):
        off, wider = style.number(circle.off), style.number(circle.radius - 1.0)
        lines.append(f"{style.label(name)}: centre {off} r off, radius off by {wider} r")
        if same := frame.same[name]:
            lines[-1] += f"; the same: {', '.join(map(style.label, same))}"
    return lines


FIGURES: dict[str, FigureModule] = {
    "fig3_gdke_ellipse": GdkeEllipse(),
    "fig4_ugdk_ellipse": UgdkEllipse(),
    "fig5_methods": MethodsFigure(),
}
