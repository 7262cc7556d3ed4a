"""Figure 7: median error against the number of samples, with the exponent of the power law that describes it.

The paper's figure 7 plots the spread of joint centres from motion capture against the number of samples analysed, and
reads a power law close to 1/√N. Here it is a Monte-Carlo experiment with known truth. A curve is the median of error
over radius of all of an estimator's fits, whatever their status, so curves compare the same trials. A fit without a
number counts as infinite. Error bars are Monte-Carlo standard errors. A run with other axes than N is shown at its
first angle, radius and centre, and at up to four levels of relative noise.

Look at: the slopes of the curves against the bound's, and GDKE, which is LLS. It leaves the others where its bias
exceeds its scatter, and more samples do not help it; theory puts its limit at the dashed line. An exponent is printed
if a power law describes the medians, each within 15 % or three Monte-Carlo errors.

The bound is a root mean square: an efficient estimator's median runs below it, by the factor in the key.
"""

import math
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study import style
from study.fits.points.cap import cap_moments
from study.simulation.analysis.theory import gdke_bias, median_at_bound
from study.simulation.figures.figure import Frame, NotApplicable, Tables, at_first, behind_medians, log_axes, look
from study.simulation.statistics import power_law

_LEAST_SAMPLES = 4
_MOST_PANELS = 4
_TOLERANCE = 0.15
_DASHES = (0, (2, 2))


def prepare(tables: Tables) -> Frame:
    """Medians, exponents, bounds and the bias that theory predicts.

    Returns:
        curves: a row per noise, estimator and N: median error and its Monte-Carlo error, over the radius. Infinite
            where half of the fits have no number.
        laws: a row per noise and group of estimators that coincide: their names, exponent, half of its 95 % interval,
            whether the law describes the medians, and in words for which N there is no median.
        bounds: a row per noise and N: median of √tr CRLB over the radius.
        limits: per noise: GDKE's bias for many samples, over the radius (not a number if no estimator has it).
        at_bound: median over √tr CRLB of a Gaussian at the bound; not a number if the noise is not isotropic.
        fixed: what is held fixed, in words.
        stamp: the run's name and trials.

    Raises:
        NotApplicable: unless the design is a grid with at least four numbers of samples.
    """
    tables.require_grid()
    tables.require_directions_by_area()
    tables.require_all_trials("relative_median")
    summary = at_first(tables.summary, besides=("samples", "noise"))
    summary = summary.assign(level=summary["noise"] / summary["radius"])
    if summary["samples"].nunique() < _LEAST_SAMPLES:
        raise NotApplicable(f"needs at least {_LEAST_SAMPLES} numbers of samples in the grid")
    levels = np.sort(summary["level"].unique())
    picked = levels[np.unique(np.linspace(0, len(levels) - 1, min(len(levels), _MOST_PANELS)).round().astype(int))]
    summary = summary[summary["level"].isin(picked)].sort_values("samples", kind="stable")
    columns = {"relative_median": "median", "relative_median_error": "error"}
    curves = summary[["group", "level", "estimator", "samples", *columns, "planned"]].rename(columns=columns)
    curves = curves.astype({"estimator": str}).reset_index(drop=True)
    angle = float(summary["angle"].iloc[0])
    moments = cap_moments(math.radians(angle), tables.dimension)
    shape = tables.noise_law.covariance(1.0)
    biased = curves["estimator"].isin(["gdke", "lls"]).any()
    return Frame(
        curves=curves,
        laws=pd.DataFrame([row for level, part in curves.groupby("level") for row in _laws(level, part)]),
        bounds=_bounds(tables, curves),
        limits=pd.Series({v: gdke_bias(v, moments, shape) if biased else math.nan for v in picked}),
        at_bound=median_at_bound(moments, tables.dimension) if tables.noise_law.isotropic else math.nan,
        fixed=f"$φ$ = {angle:g}°",
        stamp=behind_medians(tables, curves["planned"].min()),
    )


def _bounds(tables: Tables, curves: pd.DataFrame) -> pd.DataFrame:
    """Median of the bound in each cell shown; every estimator sees the same trials, so one of them serves."""
    tables.require_errors()
    cells = curves.drop_duplicates("group")
    columns = ["cell", "estimator", "bound", "radius"]
    one = tables.run.table("errors", columns, tables.estimators[:1], cells["group"])
    medians = (one["bound"] / one["radius"]).groupby(one["cell"].astype(str)).median()
    return cells[["level", "samples"]].assign(bound=medians.loc[cells["group"]].to_numpy())


def _laws(level: Any, part: pd.DataFrame) -> list[dict[str, Any]]:
    """Power laws at one noise, of estimators or groups of them that coincide."""
    rows: list[dict[str, Any]] = []
    medians: list[np.ndarray[Any, Any]] = []
    for name, curve in part.groupby("estimator", sort=False):
        median = curve["median"].to_numpy()
        same = [i for i, other in enumerate(medians) if np.allclose(median, other, rtol=1e-6, atol=0.0)]
        if same:
            rows[same[0]]["estimators"].append(str(name))
            continue
        medians.append(median)
        samples, error = curve["samples"].to_numpy(), curve["error"].to_numpy()
        law, factor = power_law(samples, median, error)
        there = np.isfinite(median) & (median > 0.0)
        off = np.abs(np.log(median[there] / (factor * samples[there] ** law.value)))
        allowed = np.maximum(_TOLERANCE, 3.0 * error[there] / median[there])
        lost = samples[~there]
        which = f"$N$ = {', '.join(f'{n:.0f}' for n in lost)}" if there.any() else "every $N$"
        failed = f"half of the fits\nwithout a number at {which}" if len(lost) else ""
        row = {"level": level, "estimators": [str(name)], "exponent": law.value, "interval": 1.96 * law.error}
        describes = bool(np.isfinite(law.value) and np.all(off <= allowed))
        rows.append(row | {"describes": describes, "failed": failed})
    return rows


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw a panel per noise."""
    levels = list(frame.limits.index)
    columns = min(2, len(levels))
    rows = math.ceil(len(levels) / columns)
    figure = style.Picture(figsize=(style.PAGE, 4.2 if len(levels) == 1 else 3.0 * rows + 0.5), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    biased = [_draw_panel(ax, frame, level, short=len(levels) > 1) for ax, level in zip(axes, levels, strict=False)]
    for ax in axes[len(levels) :]:
        ax.remove()
    figure.legend(handles=_key(frame, any(biased)), loc="outside upper left", ncols=2, columnspacing=2.0)
    style.stamp(figure, frame.stamp)
    return figure


def _key(frame: Frame, biased: bool) -> list[Line2D]:
    """Legend entries of the bound, its median and GDKE's bias."""
    words = "√tr CRLB"
    if math.isfinite(frame.at_bound):
        words += f"; the median of a Gaussian at the bound is {frame.at_bound:.2f} of it"
    handles = [Line2D([], [], color="black", linewidth=1.0, label=words)]
    if biased:
        words = "bias of GDKE for many samples, by theory"
        handles.append(Line2D([], [], color=style.color("gdke"), linewidth=0.9, linestyle=_DASHES, label=words))
    if len(frame.limits) > 1:
        words = "numbers: exponents of $N$ ± 95 % interval"
        handles.append(Line2D([], [], linestyle="none", label=words))
    return handles


def _draw_panel(ax: Axes, frame: Frame, level: float, short: bool) -> bool:
    """Draw the curves at one noise; True if GDKE's bias is drawn too."""
    log_axes(ax)
    curves = frame.curves[(frame.curves["level"] == level) & np.isfinite(frame.curves["median"])]
    laws = frame.laws[frame.laws["level"] == level]
    bound = frame.bounds[frame.bounds["level"] == level]
    ax.plot(bound["samples"], bound["bound"], color="black", linewidth=1.0, zorder=2)
    ends = [(float(bound["bound"].iloc[-1]), _bound_words(bound, short), "black")]
    names = [name for law in laws["estimators"] for name in law]
    for place, name in enumerate(names):
        curve, size = curves[curves["estimator"] == name], 1.0 - place / len(names)  # later ones do not hide these
        marks = {"linewidth": 0.6 + 1.5 * size, "elinewidth": 0.9, "zorder": 3} | look(name, 2.5 + 4.0 * size)
        ax.errorbar(curve["samples"], curve["median"], yerr=curve["error"].where(np.isfinite(curve["error"])), **marks)
    for _, law in laws.iterrows():
        last = curves.loc[curves["estimator"] == law["estimators"][0], "median"]
        if len(last):
            ends.append((float(last.iloc[-1]), _law_words(law, short), style.color(law["estimators"][-1])))
    low, high = ax.get_ylim()
    biased = bool(low < frame.limits[level] < high)
    if biased:
        ax.axhline(frame.limits[level], color=style.color("gdke"), linewidth=0.9, linestyle=_DASHES, zorder=1)
    _label_ends(ax, ends, line=0.055 if short else 0.038)
    failed = [f"{style.joined(law['estimators'])}: {law['failed']}" for _, law in laws.iterrows() if law["failed"]]
    notes = [] if short else ["±: 95 % interval", "bars: Monte-Carlo standard errors"]
    ax.text(0.02, 0.02, "\n".join(notes + failed), transform=ax.transAxes, va="bottom", fontsize=style.SMALL)
    ax.set_xlabel("number of samples $N$")
    ax.set_ylabel("median error over radius")
    ax.set_title(f"$σ/r$ = {style.number(level)}, {frame.fixed}", loc="left")
    return biased


def _bound_words(bound: pd.DataFrame, short: bool) -> str:
    x, y = bound["samples"].to_numpy(), bound["bound"].to_numpy()
    exponent = power_law(x, y, 0.01 * y)[0].value  # equal weights
    return "√tr CRLB: " + (style.decimals(exponent, 2) if short else f"exponent {style.decimals(exponent, 3)}")


def _law_words(law: "pd.Series[Any]", short: bool) -> str:
    words = "" if short else ": no power law"
    if law["describes"]:
        digits = 2 if short else 3
        words = (
            f": {'' if short else 'exponent '}{style.decimals(law['exponent'], digits)} ± {law['interval']:.{digits}f}"
        )
    return style.joined(law["estimators"], words, width=26 if short else 32)


def _label_ends(ax: Axes, ends: list[tuple[float, str, str]], line: float) -> None:
    """Write names to the right of the curves' ends; ``line`` is the height of a line, a share of the axis."""
    low, high = np.log10(ax.get_ylim())
    wanted = [(math.log10(value) - low) / (high - low) for value, _, _ in ends]
    places = style.spread(wanted, [line * (1 + words.count("\n")) for _, words, _ in ends])
    for (_, words, color), at in zip(ends, places, strict=True):
        ax.text(1.02, at, words, transform=ax.transAxes, va="center", fontsize=style.SMALL, color=color)
