"""Figure 2: relative error against relative noise, over 28 decades; below, each error over its own bound.

The paper's figure 2 overlays four estimators and rings the outliers. The paper reads it as one straight line, error =
noise, for all of them, with UGDK closest to the Cramér-Rao bound. Here every trial is a dot, and every estimator has
its panels. No fit is left out. A ring is a fit whose error is beyond ten times its own bound, a cross one whose status
is not ok; fits off the scale are counted. LLS and GDKE are one fit by two programs, which the paper draws as two. Above
is the paper's view. Each trial has its own N and φ, and so its own bound: a dot above the line of the bound's median
need not be far from its own bound. Below is the error over the trial's own √tr CRLB, with its median in each decade.

Slopes, medians and counts are of all trials, whatever the fit's status, so panels compare the same trials. A fit
without a number is infinitely far. A trial in which an estimator has none is left out of every panel's slope. Of a run
of more than 20,000 trials the figure is of the first 20,000, as it says; trials of a random design are exchangeable.

Look at: above, the straight line over most decades, and UGDK's crosses to the right of σ ≈ r, where the noise exceeds
the extent of the sphere. Below, the shoulder of LLS and GDKE for σ from 10⁻⁴ r to r (their bias, of order σ²); UGDK
beyond; and how an efficient estimator's dots scatter about 0.8.
"""

import math
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study import style
from study.arrays import Floats
from study.fits import Status
from study.simulation.analysis.error_table import decade
from study.simulation.figures.figure import Frame, NotApplicable, Tables, log_axes
from study.simulation.statistics import FAR, theil_sen

_MOST_COLUMNS = 4
_MOST_TRIALS = 20_000
_MOST_FOR_SLOPE = 2000  # Theil and Sen's slope takes memory of their square
_LEAST_PER_DECADE = 10
_LEFT_OUT = 0.02
"""Share of the ratios at each end that may lie off the scale: UGDK's run over many decades."""


def prepare(tables: Tables) -> Frame:
    """Relative errors, the running median of the bound, slopes and counts.

    Returns:
        dots: a row per fit: cell, trial, estimator, noise, error and bound over the radius, error over bound (ratio),
            kind ("ok", "far" or "not ok").
        bound: the running median of bound over radius: noise, bound, trials behind it.
        medians: median of the ratio over all fits: estimator, noise, ratio, in decades of at least ten trials.
        panels: a row per estimator: slope with its 95 % interval, of the same trials in all of them; counts of fits.
        noise_limits: ends of the horizontal axis, in powers of ten.
        error_limits: ends of the vertical axis of the errors, in powers of ten.
        ratio_limits: likewise, of the ratios.
        stamp: the run's name and trials.

    Raises:
        NotApplicable: unless the design is random, over at least a decade of relative noise.
    """
    if tables.design != "random":
        raise NotApplicable('needs a random design (kind = "random"), in which every trial draws its own noise')
    tables.require_errors()
    errors = tables.first_trials(_MOST_TRIALS)
    ok = errors["status"] == Status.OK
    kind = np.where(ok, np.where(errors["error"] > FAR * errors["bound"], "far", "ok"), "not ok")
    over_radius = errors[["noise", "error", "bound"]].div(errors["radius"], axis=0)
    dots = errors[["cell", "trial", "estimator"]].astype({"cell": str, "estimator": str}).join(over_radius)
    dots = dots.assign(ratio=errors["error"] / errors["bound"], kind=kind)
    low, high = math.floor(np.log10(dots["noise"].min())), math.ceil(np.log10(dots["noise"].max()))
    if dots["noise"].max() < 10.0 * dots["noise"].min():
        raise NotApplicable("needs relative noise σ/r over at least a decade: widen the law of the noise in the config")
    limits = _robust_limits(dots["error"].to_numpy())
    usable = (dots["error"] > 0.0) & np.isfinite(dots["error"])
    sloped = dots[usable.groupby([dots["cell"], dots["trial"]]).transform("all")]
    groups = dots.groupby("estimator", sort=False)
    panels = pd.DataFrame([_panel(str(n), part, sloped[sloped["estimator"] == n], limits) for n, part in groups])
    bound = _running_bound(dots[dots["estimator"] == panels["estimator"].iloc[0]])
    shown = int(panels["planned"].min())
    stamp = f"{tables.name} · {shown:,} trials"
    if shown < tables.trials:
        stamp = f"{tables.name} · the first {shown:,} of {tables.trials:,} trials"
    if len(bound):
        stamp += f", at least {bound['trials'].min():,} in each decade of the CRLB's median"
    ends = {"noise_limits": (low, high), "error_limits": limits}
    ends["ratio_limits"] = _robust_limits(dots["ratio"].to_numpy(), _LEFT_OUT)
    return Frame(dots=dots, bound=bound, medians=_medians(dots), panels=panels, stamp=stamp, **ends)


def _robust_limits(error: Floats, left_out: float = 0.002) -> tuple[int, int]:
    """Powers of ten around all but an outermost share of errors at each end, and a decade more."""
    usable = error[np.isfinite(error) & (error > 0.0)]
    if not len(usable):
        raise NotApplicable("no fit has a finite error")
    low, high = np.quantile(np.log10(usable), [left_out, 1.0 - left_out])
    return math.floor(low) - 1, math.ceil(high) + 1


def _panel(name: str, part: pd.DataFrame, sloped: pd.DataFrame, limits: tuple[int, int]) -> dict[str, object]:
    """One estimator's slope, of its fits in trials that all estimators share, and counts of all of its fits."""
    used = sloped.iloc[:_MOST_FOR_SLOPE]  # trials are exchangeable
    slope = low = high = math.nan
    if len(used) >= 3:
        slope, low, high = theil_sen(np.log10(used["noise"].to_numpy()), np.log10(used["error"].to_numpy()))
    on_scale = (part["error"] >= 10.0 ** limits[0]) & (part["error"] <= 10.0 ** limits[1])
    counts = {
        "far": int((~(part["ratio"] <= FAR)).sum()),  # of all fits; one without a number is far
        "not_ok": int((part["kind"] == "not ok").sum()),
        "off_scale": int((~on_scale).sum()),  # zero and non-finite errors count too
    }
    law = {"estimator": name, "slope": slope, "slope_low": low, "slope_high": high}
    return law | {"planned": len(part)} | counts


def _running_bound(trials: pd.DataFrame) -> pd.DataFrame:
    """Median of the bound in each decade of noise; each trial has its own N and φ, hence its own bound."""
    decades = trials.groupby(decade(trials["noise"]))
    medians = decades.agg(noise=("noise", "median"), bound=("bound", "median"), trials=("bound", "size"))
    return medians[medians["trials"] >= _LEAST_PER_DECADE].reset_index(drop=True)


def _medians(dots: pd.DataFrame) -> pd.DataFrame:
    """Median of error over own bound in each decade of noise, of all fits; one without a number counts as infinite."""
    groups = dots.assign(ratio=dots["ratio"].fillna(np.inf)).groupby(["estimator", decade(dots["noise"])], sort=False)
    medians = groups.agg(noise=("noise", "median"), ratio=("ratio", "median"), trials=("ratio", "size")).reset_index(0)
    return medians[medians["trials"] >= _LEAST_PER_DECADE].sort_values("noise").reset_index(drop=True)


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw for each estimator the paper's view, and below it the errors over their own bounds."""
    count = len(frame.panels)
    columns = min(count, _MOST_COLUMNS)
    rows = math.ceil(count / columns)
    figure = style.Picture(figsize=(style.PAGE, 4.3 * rows + 0.7), layout="constrained")
    axes = figure.subplots(2 * rows, columns, sharex=True, squeeze=False, height_ratios=[1.25, 1.0] * rows)
    places = [(2 * row, column) for row in range(rows) for column in range(columns)]
    for (row, column), (_, panel) in zip(places, frame.panels.iterrows(), strict=False):
        _draw_panel(axes[row, column], frame, panel, narrow=columns > 1)
        _draw_ratios(axes[row + 1, column], frame, panel["estimator"])
        words = "error over radius, $|ĉ − c|/r$", "error over own √tr CRLB"
        for ax, label in zip(axes[row : row + 2, column], words, strict=True):
            ax.tick_params(labelleft=column == 0, labelbottom=ax is axes[row + 1, column])
            ax.set_ylabel(label if column == 0 else "")
        axes[row + 1, column].set_xlabel("noise over radius, $σ/r$")
    for ax in [ax for row, column in places[count:] for ax in axes[row : row + 2, column]]:
        ax.remove()
    _label_lines(axes[0, 0], frame)
    figure.legend(handles=_key(), loc="outside upper center", ncols=3, handletextpad=0.2, columnspacing=2.0)
    style.stamp(figure, frame.stamp)
    return figure


def _draw_panel(ax: Axes, frame: Frame, panel: "pd.Series[Any]", narrow: bool) -> None:
    name = panel["estimator"]
    _scales(ax, frame, frame.error_limits, narrow)
    _draw_dots(ax, frame, name, "error")
    low, high = (10.0**power for power in frame.noise_limits)
    ax.plot([low, high], [low, high], color=style.FAINT, linewidth=0.8, dashes=(5, 2.5), zorder=4)
    ax.plot(frame.bound["noise"], frame.bound["bound"], color="black", linewidth=1.0, zorder=4)
    words = _words(panel)
    words += "\n" * (max(_words(other).count("\n") for _, other in frame.panels.iterrows()) - words.count("\n"))
    at: style.Marks = {"xy": (0.0, 1.0), "xycoords": "axes fraction", "textcoords": "offset points"}
    # the corner that the diagonal leaves free is too small in a narrow panel
    above = 5.0 + 1.35 * style.SMALL * (1 + words.count("\n"))
    side, of_name, of_words = ("bottom", (0, above), (0, 3)) if narrow else ("top", (6, -2), (6, -18))
    title = (
        f"{style.label(name)} (GDKE's fit)"
        if name == "lls" and "gdke" in set(frame.panels["estimator"])
        else style.label(name)
    )
    ax.annotate(title, xytext=of_name, va=side, fontsize=9, weight="bold", **at)
    ax.annotate(words, xytext=of_words, va=side, fontsize=style.SMALL, linespacing=1.35, **at)


def _draw_dots(ax: Axes, frame: Frame, name: str, column: str) -> None:
    """Draw the fits of one estimator: ok, beyond ten times their bound, not ok."""
    color = style.color(name)
    dots = frame.dots[frame.dots["estimator"] == name]
    plain, far, bad = (dots[dots["kind"] == kind] for kind in ("ok", "far", "not ok"))
    cloud: style.Marks = {"linewidths": 0.0, "rasterized": True}  # thousands of dots would swell the SVG
    crosses: style.Marks = {"marker": "x", "color": style.FAINT, "alpha": 0.45, "rasterized": True}
    ax.scatter(bad["noise"], bad[column], s=7, linewidths=0.6, **crosses)
    ax.scatter(plain["noise"], plain[column], s=4, color=color, alpha=0.4, zorder=3, **cloud)
    ax.scatter(far["noise"], far[column], s=4, color=color, zorder=3, **cloud)
    ax.scatter(far["noise"], far[column], s=18, facecolors="none", edgecolors=style.INK, linewidths=0.5, zorder=5)


def _draw_ratios(ax: Axes, frame: Frame, name: str) -> None:
    """Draw each error over its own bound, and the median in each decade."""
    _scales(ax, frame, frame.ratio_limits, True)
    _draw_dots(ax, frame, name, "ratio")
    ax.axhline(1.0, color="black", linewidth=1.0, zorder=4)
    ax.axhline(FAR, color=style.FAINT, linewidth=0.8, dashes=(5, 2.5), zorder=4)
    mine = frame.medians[frame.medians["estimator"] == name]
    ax.plot(mine["noise"], mine["ratio"], color="white", linewidth=2.6, zorder=5)
    ax.plot(mine["noise"], mine["ratio"], color=style.INK, linewidth=1.2, zorder=6, dashes=(2, 1))
    low, high = (10.0**power for power in frame.ratio_limits)
    ratio = frame.dots.loc[frame.dots["estimator"] == name, "ratio"]
    off = int((~((ratio >= low) & (ratio <= high))).sum())
    if off:
        words: style.Marks = {"transform": ax.transAxes, "va": "top", "fontsize": style.SMALL, "zorder": 8}
        behind = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}  # rings may lie there
        ax.text(0.03, 0.97, f"{off:,} off the scale", bbox=behind, **words)


def _scales(ax: Axes, frame: Frame, limits: tuple[int, int], narrow: bool) -> None:
    """Set logarithmic axes with ticks at the same powers of ten in all panels."""
    log_axes(ax)
    low, high = frame.noise_limits
    ax.set(xlim=(10.0**low, 10.0**high), ylim=(10.0 ** limits[0], 10.0 ** limits[1]))
    ax.set_xticks(_ticks(frame.noise_limits, narrow), minor=False)
    ax.set_yticks(_ticks(limits, narrow), minor=False)
    ax.minorticks_off()


def _words(panel: "pd.Series[Any]") -> str:
    slope = f"slope {panel['slope']:.3f} [{panel['slope_low']:.3f}, {panel['slope_high']:.3f}]"
    lines = [slope if math.isfinite(panel["slope"]) else "too few fits for a slope"]
    lines.append(f"{panel['far']:,} far, {panel['not_ok']:,} of {panel['planned']:,} not ok")
    if panel["off_scale"]:
        lines.append(f"{panel['off_scale']:,} off the scale")
    return "\n".join(lines)


def _label_lines(ax: Axes, frame: Frame) -> None:
    """Name the two lines, once, in the corners that the diagonal leaves free."""
    at = frame.noise_limits[1] - 0.09 * (frame.noise_limits[1] - frame.noise_limits[0])
    ax.text(10.0**at, 10.0**at, "error = noise  ", ha="right", va="bottom", fontsize=style.SMALL, color="#666666")
    if len(frame.bound):
        row = frame.bound.iloc[round(0.55 * (len(frame.bound) - 1))]
        arrow = {"arrowstyle": "-", "linewidth": 0.6, "color": "black", "relpos": (0.6, 1.0), "shrinkB": 0}
        small: style.Marks = {"textcoords": "axes fraction", "ha": "right", "va": "center", "fontsize": style.SMALL}
        words = "√tr CRLB,\nmedian in each decade"
        ax.annotate(words, (row["noise"], row["bound"]), (0.97, 0.16), arrowprops=arrow, **small)


def _ticks(limits: tuple[int, int], narrow: bool) -> list[float]:
    """A few powers of ten within the limits, 1 among them."""
    step = max(1, round((limits[1] - limits[0]) / (3 if narrow else 6)))
    return [10.0**power for power in range(math.ceil(limits[0] / step) * step, limits[1] + 1, step)]


def _key() -> list[Line2D]:
    """Legend entries of the three marks."""
    plain: style.Marks = {"linestyle": "none", "markeredgewidth": 0.6}
    ring: style.Marks = {"marker": "o", "markersize": 5, "markerfacecolor": "none", "color": style.INK}
    return [
        Line2D([], [], marker="o", markersize=2.5, color="#555555", label="a fit that is ok", **plain),
        Line2D([], [], label="ok, but far: error beyond 10 × its own √tr CRLB", **ring, **plain),
        Line2D([], [], marker="x", markersize=3.5, color=style.FAINT, label="a fit whose status is not ok", **plain),
        Line2D([], [], linewidth=1.2, color=style.INK, dashes=(2, 1), label="median in each decade"),
        Line2D([], [], linewidth=0.8, color=style.FAINT, dashes=(5, 2.5), label=f"below: {FAR:g} × its own √tr CRLB"),
    ]
