"""When the model is wrong: median error under each law of the noise, over that under white noise of the same σ.

A column of panels per cap angle, a row per law of the directions. The unit is the estimator's own median with white
noise, in the same directions; 1 means that nothing is lost. An estimator's ± is that of white noise: if the error is
three times as large, the ± is a third of what it should be. Medians are of all trials, whatever the fit's status; a fit
without a number counts as infinite. Bars are 95 % intervals, as if the laws had draws of their own. They have the same
normal numbers behind them, so differences are more precise than the bars.

Look at: tails do no harm (Laplace), nor does noise along the radius alone, as the error across it does not count. Noise
with memory (AR(1), with its correlation) costs most on a path, and on large caps in any order: there the error is that
of a mean. An error of form (its length in half-angles of the cap, its size in σ) costs most if its length is some 0.4
of the cap: it looks like another sphere. GDKE loses less on a small cap, because its bias is there in any case.
"""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from study import style
from study.simulation.experiment.conditions import DIRECTIONS, LAW
from study.simulation.experiment.laws import has_equal_covariance
from study.simulation.figures import figure as shared
from study.simulation.figures.figure import Frame, NotApplicable, Tables

_MOST = 4
"""Angles and laws of directions that are shown, the first ones."""
_WORDS = {LAW.default: "white", "laplace": "Laplace", "memory": "AR(1)"}
"""What a law is called in the figure, if not by its name."""
_DODGE = 0.14
"""Distance between the marks of two estimators at one place."""


def prepare(tables: Tables) -> Frame:
    """Medians from the summary, at the first number of samples, noise, radius and centre, without outliers.

    Returns:
        medians: a row per law of directions, angle, law of the noise and estimator: median error over that with normal
            noise, and its Monte-Carlo error; infinite where half of the fits have no number.
        samples: N.
        noise: σ/r.
        stamp: the run's name and trials.

    Raises:
        NotApplicable: unless the design is a grid of several laws of the noise, the normal one and one with structure
            among them.
    """
    tables.require_grid()
    laws = set(tables.summary[LAW.name]) if LAW.name in tables.summary else set()
    if LAW.default not in laws or all(map(has_equal_covariance, laws)):
        raise NotApplicable(
            f"needs {LAW.name} with {LAW.default} and one of structure, such as memory(0.9), in the grid"
        )
    tables.require_all_trials("relative_median")
    rows = shared.at_first(tables.summary, besides=("angle", LAW.name, DIRECTIONS.name))
    if DIRECTIONS.name not in rows:
        rows = rows.assign(directions=DIRECTIONS.default)
    words = ["directions", "law", "estimator"]
    medians = rows[["angle", *words]].astype(dict.fromkeys(words, str))
    share = rows["relative_median_error"] / rows["relative_median"]
    medians = medians.assign(median=rows["relative_median"], share=share)
    keys = ["directions", "angle", "estimator"]
    normal = medians[medians["law"] == LAW.default].set_index(keys)
    unit = normal.loc[pd.MultiIndex.from_frame(medians[keys])]
    ratio = medians["median"].to_numpy() / unit["median"].to_numpy()
    error = ratio * np.hypot(medians["share"].to_numpy(), unit["share"].to_numpy())
    error = np.where(medians["law"] == LAW.default, 0.0, error)
    return Frame(
        medians=medians.drop(columns=["median", "share"]).assign(ratio=ratio, error=error).reset_index(drop=True),
        samples=int(rows["samples"].iloc[0]),
        noise=float(rows["noise"].iloc[0] / rows["radius"].iloc[0]),
        stamp=shared.behind_medians(tables, int(rows["planned"].min())),
    )


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw a panel per law of directions and angle, with one legend above."""
    angles = list(frame.medians["angle"].unique())[:_MOST]
    directions = list(frame.medians["directions"].unique())[:_MOST]
    laws, names = (list(frame.medians[column].unique()) for column in ("law", "estimator"))
    height = 1.35 + 1.9 * len(directions)
    figure = style.Picture(figsize=(style.PAGE, height))
    axes = figure.subplots(len(directions), len(angles), sharex=True, sharey=True, squeeze=False)
    figure.subplots_adjust(
        left=0.105, right=0.99, bottom=0.95 / height, top=1.0 - 0.5 / height, wspace=0.06, hspace=0.2
    )
    for row, law in zip(axes, directions, strict=True):
        for ax, angle in zip(row, angles, strict=True):
            part = frame.medians[(frame.medians["directions"] == law) & (frame.medians["angle"] == angle)]
            part = part.assign(at=part["law"].map(laws.index))
            shared.side_by_side(ax, part, names, _DODGE, 3.2, linestyle="")
            ax.set_title(f"$φ$ = {angle:g}°, directions: {law}", loc="left")
            ax.set_xticks(range(len(laws)), list(map(_named, laws)), rotation=50, ha="right", rotation_mode="anchor")
        row[0].set_ylabel("median error,\nwhite noise = 1")
    largest = float(np.nanmax(shared.finite(frame.medians["ratio"])))
    shared.plain_ticks(axes[0, 0], (0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0), 0.0, max(3.0, 1.2 * largest))
    figure.legend(handles=list(map(shared.handle, names)), loc="upper center", ncols=8, columnspacing=1.2)
    style.stamp(figure, f"$N$ = {frame.samples:,}, $σ/r$ = {frame.noise:g} · {frame.stamp}")
    return figure


def _named(law: str) -> str:
    """A law of the noise in words: ``memory(0.9)`` is AR(1), 0.9; a form has its length and its size in σ."""
    name, _, numbers = law.partition("(")
    words = [_WORDS.get(name, name), *numbers.removesuffix(")").split(", ")]
    return ", ".join(filter(None, words)) + " σ" * (name == "form")
