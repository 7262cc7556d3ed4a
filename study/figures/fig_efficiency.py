"""Efficiency: how far above the Cramér-Rao bound each estimator's median error lies, over relative noise.

One panel per cap angle. The unit is what an estimator with Gaussian errors at the bound would have, so 1 is efficient.
Medians are of all fits as they come, whatever their status, for the paper's UGDK among them; a fit without a number
counts as worse than any. Marks below the curves are where theory puts the changes: GDKE's bias overtakes its scatter
at s* = r √(Kₐ/N) / m₁, UGDK leaves the bound at σ² = v/2, and UGDK's matrix begins to fail at κ = (v/σ²) √(N/2) = 3,
with v = r²Kₐ the variance of the points along the axis.

Look at: GDKE parts first, by a factor that grows as √N; knowing the noise (UGDK) costs more than measuring it in the
same points (ALS); where the noise hides the sphere, past κ = 3, nothing works, and what is bounded is least bad: the
curves there fall below 1 only because the bound does not bound a biased estimator.
"""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.analysis.measures import quantile
from study.figures import style
from study.figures.expected import median_at_bound
from study.figures.inputs import NotApplicable, Tables
from study.sphere.cap import cap_moments

_LEAST_LEVELS = 4
_MOST_PANELS = 6
_TOP = 100.0


@dataclass(frozen=True)
class Frame:
    """What the figure shows.

    Attributes:
        curves: a row per angle, noise and estimator: the median error in units of an efficient estimator's.
        marks: a row per angle: σ/r at which GDKE leaves the bound, UGDK leaves it, and UGDK fails.
        samples: N.
        stamp: the run's name and trials.
    """

    curves: pd.DataFrame
    marks: pd.DataFrame
    samples: int
    stamp: str


def prepare(tables: Tables) -> Frame:
    """Medians over the bound, at the greatest number of samples, and at the first radius and centre.

    Raises:
        NotApplicable: unless the design is a grid with at least four levels of isotropic noise.
    """
    if tables.design != "grid":
        raise NotApplicable('needs many trials of each condition: kind = "grid" in the config')
    if not np.array_equal(tables.noise_shape, np.eye(tables.dimension)):
        raise NotApplicable("compares with an isotropic bound: needs a config without noise_shape")
    errors = tables.errors
    for axis, value in (("samples", errors["samples"].max()), *((a, errors[a].iloc[0]) for a in ("radius", "center"))):
        errors = errors[errors[axis] == value]
    level = errors["noise"] / errors["radius"]
    if level.nunique() < _LEAST_LEVELS:
        raise NotApplicable(f"needs at least {_LEAST_LEVELS} levels of noise in the grid, not {level.nunique()}")
    samples = int(errors["samples"].iloc[0])
    ratio = (errors["error"] / errors["bound"]).fillna(np.inf)
    rows = []
    groups = errors.assign(level=level, ratio=ratio).groupby(["angle", "estimator", "level"], observed=True, sort=False)
    caps = {angle: cap_moments(math.radians(angle), tables.dimension) for angle in errors["angle"].unique()}
    for (angle, estimator, noise), part in groups:
        unit = median_at_bound(caps[angle], tables.dimension)
        median = quantile(part["ratio"].to_numpy(), 0.5)
        rows.append((angle, str(estimator), noise, median.value / unit, median.error / unit, len(part)))
    columns = ["angle", "estimator", "level", "ratio", "error", "trials"]
    curves = pd.DataFrame(rows, columns=columns)
    return Frame(
        curves=curves,
        marks=pd.DataFrame(
            [{"angle": angle, **_marks(moments.mean, moments.along, samples)} for angle, moments in caps.items()]
        ),
        samples=samples,
        stamp=f"{tables.name} · at least {curves['trials'].min():,} trials behind each median",
    )


def _marks(mean: float, along: float, samples: int) -> dict[str, float]:
    """Relative noise at which theory expects the changes."""
    return {
        "gdke": math.sqrt(along / samples) / mean if mean > 1e-9 else math.inf,
        "ugdk": math.sqrt(along / 2.0),
        "fails": math.sqrt(along * math.sqrt(samples / 2.0) / 3.0),
    }


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw a panel per angle, two in a row, with one legend above."""
    angles = list(frame.marks["angle"])[:_MOST_PANELS]
    rows = math.ceil(len(angles) / 2)
    figure = Figure(figsize=(style.PAGE, 0.55 + 2.35 * rows), layout="constrained")
    axes = figure.subplots(rows, 2 if len(angles) > 1 else 1, sharex=True, sharey=True, squeeze=False)
    for ax, angle in zip(axes.flat, angles, strict=False):
        _panel(ax, frame, angle)
    for ax in axes.flat[len(angles) :]:
        ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("noise over radius, $σ/r$")
    for ax in axes[:, 0]:
        ax.set_ylabel("median error,\nefficient = 1")
    names = list(dict.fromkeys(frame.curves["estimator"]))
    handles = [
        axes[0, 0].plot([], [], color=style.color(n), marker=style.marker(n), markersize=3.5, label=style.label(n))[0]
        for n in names
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=min(len(names), 5))
    style.stamp(figure, frame.stamp)
    return figure


def _panel(ax: Axes, frame: Frame, angle: float) -> None:
    """One angle."""
    mine = frame.curves[frame.curves["angle"] == angle]
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(0.3, _TOP)
    ax.axhline(1.0, color="black", linewidth=0.8)
    for name, curve in mine.groupby("estimator", sort=False):
        shown = curve.sort_values("level")
        ax.plot(
            shown["level"], shown["ratio"], color=style.color(str(name)), marker=style.marker(str(name)),
            markersize=2.6, linewidth=0.9, zorder=3,
        )  # fmt: skip
    marks = frame.marks[frame.marks["angle"] == angle].iloc[0]
    low, high = mine["level"].min(), mine["level"].max()
    ax.set_xlim(low / 1.3, high * 1.3)
    for key, words, name in (("gdke", "$s^*$", "gdke"), ("ugdk", "$σ^2=v/2$", "ugdk"), ("fails", "$κ=3$", "ugdk")):
        if low <= marks[key] <= high:
            ax.plot([marks[key]] * 2, [0.3, 0.62], color=style.color(name), linewidth=1.0, clip_on=False)
            ax.annotate(
                words, (marks[key], 0.3), (2, 2), textcoords="offset points",
                fontsize=style.SMALL, color=style.color(name),
            )  # fmt: skip
    ax.set_title(f"$φ$ = {angle:g}°, $N$ = {frame.samples:,}", loc="left")
