"""Robustness: median error against the share of outliers, and against the tails of the noise, per estimator.

One row of panels per cap angle. Left, the noise is normal and a share of the samples is displaced in random directions.
Right, there are no outliers, and the laws of the noise stand in the order of their excess kurtosis, all with the same
covariance σ² I. The unit is the median of an estimator with Gaussian errors at the Gaussian bound of the same σ, so 1
is efficient with normal noise. Medians are of all trials, whatever the fit's status; a fit without a number counts as
infinite. Bars are 95 % intervals of the median. Every law has the same normal numbers behind it, so differences between
laws are more precise than the bars.

The dashed line is the error of an efficient estimator that takes the outliers for noise. A share p of displacements by
s σ makes the variance of a coordinate σ² (1 + p s²/d).

Look at: on the left, least-squares fits follow the dashed line, as if all samples had become noisier. The biased ones
(GDKE, LLS) leave it on a cap, because their bias grows as the variance does. On the right, on an axis of its own, next
to nothing changes: the error of least squares depends on the covariance alone.
"""

import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study import style
from study.simulation.experiment.conditions import LAW, OUTLIER_SHARE, OUTLIER_SIZE
from study.simulation.experiment.laws import excess_kurtosis, freedom, has_equal_covariance
from study.simulation.figures import figure as shared
from study.simulation.figures.figure import Frame, NotApplicable, Tables

_LEAST = 3
_MOST_ROWS = 4
_TOP, _ROW, _BOTTOM = 0.5, 2.2, 0.75  # inches
_TICKS = (0.1, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0)
_DODGE = 0.08
"""Distance between the marks of two estimators at one place."""


def prepare(tables: Tables) -> Frame:
    """Medians from the summary, at the first number of samples, noise, radius and centre.

    Returns:
        shares: a row per angle, share of outliers and estimator, with normal noise: the median error in units of an
            efficient estimator's, and its Monte-Carlo error; infinite where half of the fits have no number.
        tails: a row per angle, law and estimator, without outliers, likewise; in the order of the excess kurtosis.
        size: length of an outlier's displacement, in units of σ.
        dimension: d.
        samples: N.
        stamp: the run's name and trials.

    Raises:
        NotApplicable: unless the design is a grid of several shares of outliers, with none among them, and of several
            laws of the noise, with the normal one among them.
    """
    tables.require_grid(isotropic=True)
    law, share, size = LAW.name, OUTLIER_SHARE.name, OUTLIER_SIZE.name
    for name, least in ((law, LAW.default), (share, 0.0)):
        values = set(tables.summary[name]) if name in tables.summary else set()
        if len(values) < _LEAST or least not in values:
            raise NotApplicable(f"needs at least {_LEAST} values of {name} in the grid, with {least} among them")
    tables.require_directions_by_area()
    tables.require_all_trials("ratio_median")
    rows = shared.at_first(tables.summary, besides=("angle", law, share))
    unit = tables.efficient(rows["angle"])
    medians = rows[["angle", "estimator", law, share]].set_axis(["angle", "estimator", "law", "share"], axis=1)
    medians = medians.astype({"estimator": str, "law": str})
    medians = medians.assign(ratio=rows["ratio_median"] / unit, error=rows["ratio_median_error"] / unit)
    if others := [word for word in medians["law"].unique() if not has_equal_covariance(word)]:
        raise NotApplicable(f"compares laws of the same covariance: needs a config without {', '.join(others)}")
    order = sorted(medians["law"].unique(), key=lambda word: (excess_kurtosis(word), -(freedom(word) or 0.0)))
    tails = medians[medians["share"] == 0.0]
    return Frame(
        shares=medians[medians["law"] == LAW.default].sort_values("share", kind="stable"),
        tails=tails.sort_values("law", kind="stable", key=lambda words: words.map(order.index)),
        size=float(rows[size].iloc[0]) if size in rows else float(OUTLIER_SIZE.default or 0.0),
        dimension=tables.dimension,
        samples=int(rows["samples"].iloc[0]),
        stamp=shared.behind_medians(tables, int(rows["planned"].min())),
    )


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw a row of two panels per angle, with one legend above."""
    angles = list(frame.shares["angle"].unique())[:_MOST_ROWS]
    height = _TOP + _BOTTOM + _ROW * len(angles)
    figure = style.Picture(figsize=(style.PAGE, height))
    axes = figure.subplots(len(angles), 2, sharex="col", sharey="col", squeeze=False)
    # a layout engine's solver rounds differently from time to time, and equal figures should be equal files
    sides = {"left": 0.72 / style.PAGE, "right": 1.0 - 0.05 / style.PAGE}
    sides |= {"bottom": _BOTTOM / height, "top": 1.0 - _TOP / height}
    figure.subplots_adjust(**sides, wspace=0.14, hspace=0.2)
    names = list(dict.fromkeys(frame.shares["estimator"]))
    for (left, right), angle in zip(axes, angles, strict=True):
        shares = frame.shares[frame.shares["angle"] == angle]
        values = list(shares["share"].unique())
        marks: style.Marks = {"size": 3.6, "linewidth": 0.5, "zorder": 3}
        shared.side_by_side(left, shares.assign(at=shares["share"].map(values.index)), names, _DODGE, **marks)
        as_noise = [math.sqrt(1.0 + share * frame.size**2 / frame.dimension) for share in values]
        left.plot(range(len(values)), as_noise, color="black", linewidth=0.8, linestyle="--", zorder=2)
        left.set_xticks(range(len(values)), [f"{100.0 * share:.3g} %" for share in values])
        tails = frame.tails[frame.tails["angle"] == angle]
        laws = list(tails["law"].unique())
        shared.side_by_side(right, tails.assign(at=tails["law"].map(laws.index)), names, _DODGE, **marks)
        right.set_xticks(range(len(laws)), [_law_label(word) for word in laws])
        left.set_ylabel("median error,\nefficient = 1")
        left.set_title(f"$φ$ = {angle:g}°, $N$ = {frame.samples:,}, normal noise", loc="left")
        right.set_title(f"$φ$ = {angle:g}°, no outliers", loc="left")
    finite_shares, finite_tails = shared.finite(frame.shares["ratio"]), shared.finite(frame.tails["ratio"])
    low, high = min(0.85, 0.9 * np.nanmin(finite_shares)), max(4.0, 1.25 * np.nanmax(finite_shares))
    shared.plain_ticks(axes[0, 0], _TICKS, low, high)
    axes[0, 0].set_ylim(low, high)
    # the laws have a linear axis of their own, on which small differences can be seen
    axes[0, 1].set_ylim(min(0.85, np.nanmin(finite_tails) - 0.1), max(1.2, np.nanmax(finite_tails) + 0.1))
    axes[-1, 0].set_xlabel(f"share of outliers, each displaced by {frame.size:g} $σ$")
    axes[-1, 1].set_xlabel("law of the noise, and its excess kurtosis")
    dashed = Line2D([], [], color="black", linewidth=0.8, linestyle="--", label="outliers taken for noise")
    handles = [*map(shared.handle, names), dashed]
    rows = -(-len(handles) // 8)  # eight in a row fill the page
    figure.legend(handles=handles, loc="upper center", ncols=-(-len(handles) // rows), columnspacing=1.2)
    style.stamp(figure, frame.stamp)
    return figure


def _law_label(word: str) -> str:
    """A law for an axis, with its excess kurtosis below."""
    nu, excess = freedom(word), excess_kurtosis(word)
    name = (word.capitalize() if word == "laplace" else word) if nu is None else f"$t_{{{nu:g}}}$"
    return f"{name}\n{'∞' if math.isinf(excess) else style.number(excess)}"
