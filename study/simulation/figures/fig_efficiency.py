"""Efficiency: median error over the Cramér-Rao bound against relative noise, per estimator.

One panel per cap angle. The unit is the median of an estimator with Gaussian errors at the Cramér-Rao bound. That bound
treats the directions as known. The dashed line is the attainable bound, which does not: an estimator on it is
efficient. Medians are of all trials, whatever the fit's status, so curves compare the same trials. A fit without a
number counts as infinite. Of a run with many estimators five are drawn, the default and the paper's first; the stamp
names the others, which `study summary` has.

Marks below the curves are the changes that theory predicts. GDKE's bias exceeds its scatter at s* = r √(Kₐ/N) / m₁.
UGDK leaves the bound at σ² = v/2, with v = r²Kₐ the variance of the points along the axis. UGDK's matrix begins to fail
at κ = (v/σ²) √(N/2) = 3.

Look at: GDKE leaves the bound first, by a factor that grows as √N. To subtract the known noise (UGDK) costs more than
to estimate it from the same points (ALS). Past κ = 3 the noise hides the sphere, and no estimator works; those whose
errors are bounded err least. Curves fall below 1 there only because the bound does not hold for biased estimators.
"""

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study import style
from study.fits.points.cap import cap_moments
from study.simulation.analysis.theory import gdke_leaves, median_attainable, noise_at_kappa, ugdk_leaves
from study.simulation.figures import figure as shared
from study.simulation.figures.figure import Frame, NotApplicable, Tables

_LEAST_LEVELS = 4
_MOST_PANELS = 6
_MOST_CURVES = 5
_FIRST = ("gdke", "ugdk", "mle", "als", "corrected")
"""Estimators that are drawn before any others."""
_LOW, _HIGH = 0.5, 10.0  # shown at least


def prepare(tables: Tables) -> Frame:
    """Medians over the bound, at the greatest number of samples, the first radius and centre, and directions by area.

    Returns:
        curves: a row per angle, noise and estimator: the median error in units of an efficient estimator's, and its
            Monte-Carlo error; infinite where more than half of the fits have no number.
        attainable: a row per angle and noise: the same median for Gaussian errors at the attainable bound.
        marks: a row per angle: σ/r at which GDKE leaves the bound, UGDK leaves it, and UGDK fails.
        samples: N.
        stamp: the run's name and trials.

    Raises:
        NotApplicable: unless the design is a grid with at least four levels of isotropic noise.
    """
    tables.require_grid(isotropic=True)
    tables.require_all_trials("ratio_median")
    cells = tables.by_area()
    cells = cells[cells["samples"] == cells["samples"].max()]
    cells = shared.at_first(cells, besides=("noise", "angle"))
    level = cells["noise"] / cells["radius"]
    if level.nunique() < _LEAST_LEVELS:
        raise NotApplicable(f"needs at least {_LEAST_LEVELS} levels of noise in the grid, not {level.nunique()}")
    samples = int(cells["samples"].iloc[0])
    caps = {angle: cap_moments(math.radians(angle), tables.dimension) for angle in cells["angle"].unique()}
    order = sorted(tables.estimators, key=lambda name: _FIRST.index(name) if name in _FIRST else len(_FIRST))
    shown = order[:_MOST_CURVES]
    columns = {"angle": "angle", "level": "level", "estimator": "estimator", "planned": "trials"}
    columns |= {"ratio_median": "ratio", "ratio_median_error": "error"}
    curves = cells.assign(level=level, estimator=cells["estimator"].astype(str)).rename(columns=columns)
    curves = curves.loc[curves["estimator"].isin(shown), list(columns.values())].reset_index(drop=True)
    curves[["ratio", "error"]] = curves[["ratio", "error"]].div(tables.efficient(curves["angle"]), axis=0)
    levels = curves[["angle", "level"]].drop_duplicates()
    reached = [median_attainable(row.angle, row.level, tables.dimension) for row in levels.itertuples()]
    names = [style.label(name) for name in tables.estimators if name not in shown]
    others = f" · not drawn: {', '.join(names)} · " if names else " · "
    marks = [(a, gdke_leaves(samples, m), ugdk_leaves(m), noise_at_kappa(3.0, samples, m)) for a, m in caps.items()]
    return Frame(
        curves=curves,
        attainable=levels.assign(ratio=reached / tables.efficient(levels["angle"])),
        marks=pd.DataFrame(marks, columns=["angle", "gdke", "ugdk", "fails"]),
        samples=samples,
        stamp=shared.behind_medians(tables, curves["trials"].min(), curves).replace(" · ", others, 1),
    )


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw a panel per angle, two in a row, with one legend above."""
    angles = list(frame.marks["angle"])[:_MOST_PANELS]
    rows = math.ceil(len(angles) / 2)
    figure = style.Picture(figsize=(style.PAGE, 0.7 + 2.5 * rows), layout="constrained")
    axes = figure.subplots(rows, 2 if len(angles) > 1 else 1, sharex=True, sharey=True, squeeze=False)
    for ax, angle in zip(axes.flat, angles, strict=False):
        _panel(ax, frame, angle)
    for ax in axes.flat[len(angles) :]:
        ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("noise over radius, $σ/r$")
    for ax in axes[:, 0]:
        ax.set_ylabel("median error,\nCramér-Rao = 1")
    names = list(dict.fromkeys(frame.curves["estimator"]))
    attainable = Line2D([], [], color="black", linewidth=1.0, linestyle=(0, (4, 2)), label="attainable bound")
    bound = Line2D([], [], color="black", linewidth=0.8, label="Cramér-Rao bound")
    handles = [*map(shared.handle, names), attainable, bound]
    title = (
        "marks below: where, by theory, GDKE leaves the bound ($s^*$), UGDK leaves it ($σ^2=v/2$), UGDK fails ($κ=3$)"
    )
    place: style.Marks = {"loc": "outside upper center", "ncols": min(len(handles), 5)}
    figure.legend(handles=handles, title=title, title_fontsize=style.SMALL, **place)
    style.stamp(figure, frame.stamp)
    return figure


def _panel(ax: Axes, frame: Frame, angle: float) -> None:
    """Draw the panel of one angle."""
    mine = frame.curves[frame.curves["angle"] == angle]
    shared.log_axes(ax)
    ratios = frame.curves["ratio"][np.isfinite(frame.curves["ratio"])]
    ax.set_ylim(min(_LOW, 0.9 * ratios.min()) / 1.8, max(_HIGH, 1.3 * ratios.max()))  # with room for the marks
    ax.axhline(1.0, color="black", linewidth=0.8)
    attainable = frame.attainable[frame.attainable["angle"] == angle].sort_values("level")
    ax.plot(attainable["level"], attainable["ratio"], color="black", linewidth=1.0, linestyle=(0, (4, 2)), zorder=4)
    curves = list(mine.groupby("estimator", sort=False))
    for place, (name, curve) in enumerate(curves):
        shown = curve.sort_values("level")
        size = 1.0 - place / len(curves)  # larger marks first: later ones do not hide them
        marked = shared.look(str(name), 2.2 + 2.4 * size)
        ax.plot(shown["level"], shown["ratio"], **marked, linewidth=0.7 + 0.9 * size, zorder=3)
    marks = frame.marks[frame.marks["angle"] == angle].iloc[0]
    low, high = mine["level"].min(), mine["level"].max()
    ax.set_xlim(low / 1.3, high * 1.3)
    present = set(mine["estimator"])
    small: style.Marks = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
    for key, words, side in (("gdke", "$s^*$", "left"), ("ugdk", "$σ^2=v/2$", "right"), ("fails", "$κ=3$", "left")):
        name = "ugdk" if key == "fails" else key
        if name in present and low <= marks[key] <= high:
            at, color = (marks[key], 0.035), style.color(name)
            ax.axvline(marks[key], 0.035, 0.125, color=color, linewidth=1.2, zorder=1)  # clear of the ticks of the axis
            side = "right" if marks[key] > high / 3.0 else side  # there the words would leave the panel
            away = 2 if side == "left" else -2
            ax.annotate(words, at, (away, 2), ha=side, color=color, fontsize=style.SMALL, **small)
    ax.set_title(f"$φ$ = {angle:g}°, $N$ = {frame.samples:,}", loc="left")
