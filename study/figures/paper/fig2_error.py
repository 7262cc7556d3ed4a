"""Figure 2: relative error against relative noise, over 28 decades, one panel per estimator.

The paper's figure 2 overlays four estimators and rings the outliers; it is read there as one straight line, error =
noise, for all of them, with UGDK closest to the Cramér-Rao bound. Here every trial is a dot, every estimator has its
panel, and nothing is left out: a fit whose error is beyond ten times its own bound is ringed, one whose status is not
ok is a cross, and what lies off the scale is counted.

Look at: the straight line over most decades; the shoulder of LLS and GDKE, which rises above the bound for σ from
10⁻⁴ r to r (their bias, of order σ²); UGDK's crosses to the right of σ ≈ r, where the noise exceeds the extent of the
sphere; and the slopes, which are of the ok fits alone.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy import stats

from study.analysis.error_groups import decade
from study.estimators import Status
from study.figures import style
from study.figures.inputs import NotApplicable, Tables
from study.sphere.types import Floats
from study.statistics.performance import FAR

_MOST_FOR_SLOPE = 2000  # Theil and Sen's slope takes memory of their square
_LEAST_PER_DECADE = 10


@dataclass(frozen=True)
class ErrorFrame:
    """Content of figure 2.

    Attributes:
        dots: a row per fit: estimator, noise and error over the radius, kind ("ok", "far" or "not ok").
        bound: the running median of bound over radius: noise, bound, trials behind it.
        panels: a row per estimator: slope with its 95 % interval, and counts of fits.
        noise_limits: ends of the horizontal axis, in powers of ten.
        error_limits: ends of the vertical axis, in powers of ten.
        stamp: the run's name and trials.
    """

    dots: pd.DataFrame
    bound: pd.DataFrame
    panels: pd.DataFrame
    noise_limits: tuple[int, int]
    error_limits: tuple[int, int]
    stamp: str


def prepare(tables: Tables) -> ErrorFrame:
    """Relative errors, the running median of the bound, slopes and counts.

    Raises:
        NotApplicable: unless the design is random, over at least a decade of relative noise.
    """
    if tables.design != "random":
        raise NotApplicable('needs a random design (kind = "random"), in which every trial draws its own noise')
    errors = tables.errors
    ok = errors["status"] == Status.OK
    kind = np.where(ok, np.where(errors["error"] > FAR * errors["bound"], "far", "ok"), "not ok")
    dots = pd.DataFrame(
        {
            "estimator": errors["estimator"].astype(str),
            "noise": errors["noise"] / errors["radius"],
            "error": errors["error"] / errors["radius"],
            "bound": errors["bound"] / errors["radius"],
            "kind": kind,
        }
    )
    low, high = math.floor(np.log10(dots["noise"].min())), math.ceil(np.log10(dots["noise"].max()))
    if dots["noise"].max() < 10.0 * dots["noise"].min():
        raise NotApplicable("needs relative noise σ/r over at least a decade: widen the law of the noise in the config")
    limits = _robust_limits(dots["error"].to_numpy())
    panels = pd.DataFrame([_panel(str(name), part, limits) for name, part in dots.groupby("estimator", sort=False)])
    bound = _running_bound(dots[dots["estimator"] == panels["estimator"].iloc[0]])
    stamp = f"{tables.name} · {panels['planned'].min():,} trials"
    if len(bound):
        stamp += f", at least {bound['trials'].min()} in each decade of the CRLB's median"
    return ErrorFrame(dots, bound, panels, (low, high), limits, stamp)


def _robust_limits(error: Floats) -> tuple[int, int]:
    """Powers of ten around all but the outermost 0.2 % of errors at each end, and a decade more."""
    usable = error[np.isfinite(error) & (error > 0.0)]
    if not len(usable):
        raise NotApplicable("no fit has a finite error")
    low, high = np.quantile(np.log10(usable), [0.002, 0.998])
    return math.floor(low) - 1, math.ceil(high) + 1


def _panel(name: str, part: pd.DataFrame, limits: tuple[int, int]) -> dict[str, object]:
    """One estimator's slope and counts."""
    usable = part[(part["kind"] != "not ok") & (part["error"] > 0.0) & np.isfinite(part["error"])]
    some = usable.iloc[:_MOST_FOR_SLOPE]  # trials are exchangeable
    slope = low = high = math.nan
    if len(some) >= 3:
        slope, _, low, high = stats.theilslopes(np.log10(some["error"]), np.log10(some["noise"]), alpha=0.95)
    on_scale = (part["error"] >= 10.0 ** limits[0]) & (part["error"] <= 10.0 ** limits[1])
    return {
        "estimator": name,
        "slope": slope,
        "slope_low": low,
        "slope_high": high,
        "planned": len(part),
        "far": int((part["kind"] == "far").sum()),
        "not_ok": int((part["kind"] == "not ok").sum()),
        "off_scale": int((~on_scale).sum()),  # zero and non-finite errors count too
    }


def _running_bound(trials: pd.DataFrame) -> pd.DataFrame:
    """Median of the bound in each decade of noise; each trial has its own N and φ, hence its own bound."""
    decades = trials.groupby(decade(trials["noise"]))
    medians = decades.agg(noise=("noise", "median"), bound=("bound", "median"), trials=("bound", "size"))
    return medians[medians["trials"] >= _LEAST_PER_DECADE].reset_index(drop=True)


@style.journal()
def draw(frame: ErrorFrame) -> Figure:
    """Draw the panels, on shared axes."""
    count = len(frame.panels)
    columns = 1 if count == 1 else 2 if count <= 4 else 3
    rows = math.ceil(count / columns)
    height = {1: 4.6, 2: 2.6, 3: 2.3}[columns] * rows + 0.7
    figure = Figure(figsize=(style.PAGE, height), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for ax, (_, panel) in zip(axes, frame.panels.iterrows(), strict=False):
        _draw_panel(ax, frame, panel, narrow=columns > 2)
    for ax in axes[count:]:
        ax.remove()
    _label_lines(axes[0], frame)
    for i, ax in enumerate(axes[:count]):
        below_is_empty = i + columns >= count
        ax.tick_params(labelbottom=below_is_empty)
        ax.set_xlabel("noise over radius, $σ/r$" if below_is_empty else "")
        ax.set_ylabel("error over radius, $|ĉ − c|/r$" if i % columns == 0 else "")
    figure.legend(handles=_key(), loc="outside upper center", ncols=3, handletextpad=0.2, columnspacing=2.0)
    style.stamp(figure, frame.stamp)
    return figure


def _draw_panel(ax: Axes, frame: ErrorFrame, panel: "pd.Series[Any]", narrow: bool) -> None:
    name = panel["estimator"]
    color = style.color(name)
    dots = frame.dots[frame.dots["estimator"] == name]
    plain, far, bad = (dots[dots["kind"] == kind] for kind in ("ok", "far", "not ok"))
    cloud: dict[str, Any] = {"linewidths": 0.0, "rasterized": True}  # thousands of dots would swell the SVG
    ax.scatter(
        bad["noise"], bad["error"], s=7, marker="x", color=style.FAINT, alpha=0.45, linewidths=0.6, rasterized=True
    )
    ax.scatter(plain["noise"], plain["error"], s=5, color=color, alpha=0.45, zorder=3, **cloud)
    ax.scatter(far["noise"], far["error"], s=5, color=color, zorder=3, **cloud)
    ax.scatter(far["noise"], far["error"], s=24, facecolors="none", edgecolors=style.INK, linewidths=0.6, zorder=5)
    low, high = (10.0**power for power in frame.noise_limits)
    ax.plot([low, high], [low, high], color=style.FAINT, linewidth=0.8, dashes=(5, 2.5), zorder=4)
    ax.plot(frame.bound["noise"], frame.bound["bound"], color="black", linewidth=1.0, zorder=4)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlim(low, high)
    ax.set_ylim(*(10.0**power for power in frame.error_limits))
    ax.set_xticks(_ticks(frame, frame.noise_limits, narrow), minor=False)
    ax.set_yticks(_ticks(frame, frame.error_limits, narrow), minor=False)
    ax.minorticks_off()
    words = _words(panel)
    at: dict[str, Any] = {"xy": (0.0, 1.0), "xycoords": "axes fraction", "textcoords": "offset points"}
    if narrow:  # the corner that the diagonal leaves free is too small
        above = 5.0 + 1.35 * style.SMALL * (1 + words.count("\n"))
        ax.annotate(style.label(name), xytext=(0, above), va="bottom", fontsize=9, weight="bold", **at)
        ax.annotate(words, xytext=(0, 3), va="bottom", fontsize=style.SMALL, linespacing=1.35, **at)
    else:
        ax.annotate(style.label(name), xytext=(6, -2), va="top", fontsize=9, weight="bold", **at)
        ax.annotate(words, xytext=(6, -18), va="top", fontsize=style.SMALL, linespacing=1.35, **at)


def _words(panel: "pd.Series[Any]") -> str:
    if math.isfinite(panel["slope"]):
        lines = [f"slope {panel['slope']:.3f}  [{panel['slope_low']:.3f}, {panel['slope_high']:.3f}]"]
    else:
        lines = ["too few ok fits for a slope"]
    lines.append(f"{panel['far']:,} beyond 10 × √tr CRLB")
    lines.append(f"{panel['not_ok']:,} of {panel['planned']:,} not ok")
    if panel["off_scale"]:
        lines.append(f"{panel['off_scale']:,} off the scale")
    return "\n".join(lines)


def _label_lines(ax: Axes, frame: ErrorFrame) -> None:
    """Name the two lines, once, in the corners that the diagonal leaves free."""
    at = frame.noise_limits[1] - 0.09 * (frame.noise_limits[1] - frame.noise_limits[0])
    ax.text(10.0**at, 10.0**at, "error = noise  ", ha="right", va="bottom", fontsize=style.SMALL, color="#666666")
    if len(frame.bound):
        row = frame.bound.iloc[round(0.55 * (len(frame.bound) - 1))]
        ax.annotate(
            "√tr CRLB,\nmedian in each decade",
            (row["noise"], row["bound"]),
            (0.97, 0.16),
            textcoords="axes fraction",
            ha="right",
            va="center",
            fontsize=style.SMALL,
            arrowprops={"arrowstyle": "-", "linewidth": 0.6, "color": "black", "relpos": (0.6, 1.0), "shrinkB": 0},
        )


def _ticks(frame: ErrorFrame, limits: tuple[int, int], narrow: bool) -> list[float]:
    """Powers of ten, as many decades apart on one axis as on the other."""
    step = max(1, round((frame.noise_limits[1] - frame.noise_limits[0]) / (3 if narrow else 6)))
    return [10.0**power for power in range(math.ceil(limits[0] / step) * step, limits[1] + 1, step)]


def _key() -> list[Line2D]:
    """Legend entries of the three marks."""
    plain: dict[str, Any] = {"linestyle": "none", "markeredgewidth": 0.6}
    return [
        Line2D([], [], marker="o", markersize=2.5, color="#555555", label="a fit that is ok", **plain),
        Line2D(
            [],
            [],
            marker="o",
            markersize=5,
            markerfacecolor="none",
            color=style.INK,
            label="ok, error beyond 10 × its own √tr CRLB",
            **plain,
        ),
        Line2D([], [], marker="x", markersize=3.5, color=style.FAINT, label="a fit whose status is not ok", **plain),
    ]
