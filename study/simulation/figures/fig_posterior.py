"""Posterior of one trial, beside the fits and the bound.

Shaded: 68 % and 95 % of emcee's draws, σ known, geometric likelihood. Dashed: the Cramér-Rao bound's 95 % ellipse
about the truth, for this trial's directions. The trial shown is the one on the flattest cap, where the answers differ
most, of those whose draws were stored.

Look at: the posterior has the size and the tilt of the bound, and the MLE sits in its middle: two independent ways to
the same answer. GDKE is off by its bias. Along the axis and in the radius the posterior is a ridge: a larger
sphere farther away fits a cap almost as well.
"""

from typing import Any

import numpy as np
import pandas as pd
import scipy
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle

from study import style
from study.fits import Status
from study.simulation.experiment.config import ChainStatus
from study.simulation.figures.figure import Frame, NotApplicable, Tables

_LEVELS = (0.68, 0.95)
_SHADES = ("#d9d9d9", "#a6a6a6")
_GRID = 120
_SMOOTH = 1.25
"""Bandwidth over Scott's, which leaves lumps of a few draws at the 95 % line."""


def prepare(tables: Tables) -> Frame:
    """Choose the trial, and estimate the density of its draws.

    Returns:
        views: the two planes.
        names: the estimators' names.
        caption: the trial in words.
        stamp: the run and the trial.

    Raises:
        NotApplicable: if the run has no geometric chain with σ known that is ok and whose draws were kept.
    """
    if tables.posterior is None or tables.draws is None:
        raise NotApplicable("needs posteriors: [posterior] in the config, then `study posterior RUN`")
    result = tables.posterior
    kept = set(zip(tables.draws["cell"], tables.draws["trial"], strict=True))
    use = (result["status"] == ChainStatus.OK) & (result["likelihood"] == "geometric") & (result["noise_is"] == "known")
    use &= np.array([pair in kept for pair in zip(result["cell"], result["trial"], strict=True)])
    if not use.any():
        raise NotApplicable("needs a geometric chain with σ known that converged and whose draws were kept")
    row = result[use].sort_values(["flatness", "samples"], ascending=[False, True], kind="stable").iloc[0]
    draws = tables.draws
    mine = (draws["cell"] == row["cell"]) & (draws["trial"] == row["trial"]) & (draws["likelihood"] == "geometric")
    draws = draws[mine & (draws["noise_is"] == "known")]
    tables.require_errors()
    errors = tables.run.table("errors", cells=[row["cell"]])
    errors = errors[errors["trial"] == row["trial"]]
    errors = errors[np.isfinite(errors["error"]) & (errors["status"] == Status.OK)]
    radius = row["radius"]
    planes = [("across the axis", "error_2", "2"), ("radius", "radius_error", "radius")]
    views = [_view(words, draws, errors, row, column, ending) for words, column, ending in planes]
    relative = row["noise"] / radius
    return Frame(
        views=views,
        names=[str(name) for name in errors["estimator"]],
        caption=f"$N$ = {row['samples']:,}, $σ$ = {relative:g} $r$, $φ$ = {row['angle']:g}°",
        stamp=f"{tables.name}, cell {row['cell']}, trial {row['trial']}; {row['draws']:,.0f} independent draws",
    )


def _view(words: str, draws: pd.DataFrame, errors: pd.DataFrame, row: Any, column: str, ending: str) -> Frame:
    """One plane of parameters, in units of the radius, from the truth: the axis, and another parameter.

    Returns:
        words: what is along the second axis.
        x, y: the grid (m,).
        share: of the posterior that is denser than a place of the grid (m, m); rows are along y.
        bound: covariance of the bound in this plane (2, 2).
        answers: where each estimator lies (k, 2).
    """
    radius = row["radius"]
    cloud = draws[["error_1", column]].to_numpy() / radius
    sd = np.array([row["bound_1"], row[f"bound_{ending}"]]) / radius
    answers = errors[["error_1", column]].to_numpy() / radius
    shown = np.concatenate([cloud, answers, [-2.6 * sd, 2.6 * sd]])
    low, high = shown.min(axis=0) - 0.3 * sd, shown.max(axis=0) + 0.3 * sd
    x, y = (np.linspace(low[i], high[i], _GRID) for i in (0, 1))
    density = scipy.stats.gaussian_kde(cloud.T, lambda kde: _SMOOTH * kde.scotts_factor())
    place = np.stack(np.meshgrid(x, y)).reshape(2, -1)
    here, at_draws = density(place).reshape(_GRID, _GRID), np.sort(density(cloud.T))
    denser = 1.0 - np.searchsorted(at_draws, here) / len(at_draws)
    correlation = row[f"bound_with_{ending}"]
    bound = np.outer(sd, sd) * np.array([[1.0, correlation], [correlation, 1.0]])
    return Frame(words=words, x=x, y=y, share=denser, bound=bound, answers=answers)


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw the two planes side by side, with one legend above."""
    figure = style.Picture(figsize=(style.PAGE, 3.3), layout="constrained")
    for ax, view in zip(figure.subplots(1, 2), frame.views, strict=True):
        _plane(ax, view, frame.names)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), handletextpad=0.3, columnspacing=1.2)
    figure.axes[0].set_title(frame.caption, loc="left")
    style.stamp(figure, frame.stamp)
    return figure


def _plane(ax: Axes, view: Frame, names: list[str]) -> None:
    ax.grid(False)
    shaded: style.Marks = {"colors": _SHADES[::-1], "levels": [0.0, *_LEVELS], "zorder": 1}
    ax.contourf(view.x, view.y, view.share, **shaded)
    for level, shade in zip(_LEVELS, _SHADES[::-1], strict=True):
        ax.add_patch(Rectangle((0.0, 0.0), 0.0, 0.0, color=shade, label=f"posterior, {level:.0%}".replace("%", " %")))
    values, vectors = np.linalg.eigh(view.bound)
    long, short = 2.0 * np.sqrt(scipy.special.chdtri(2, 1.0 - _LEVELS[-1]) * values[::-1])
    turn = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    line = {"fill": False, "linestyle": (0, (4, 2.5)), "linewidth": 1.0, "zorder": 3, "label": "bound, 95 %"}
    ax.add_patch(Ellipse((0.0, 0.0), long, short, angle=turn, edgecolor="black", **line))
    ax.plot(0.0, 0.0, marker="+", color="black", markersize=9, markeredgewidth=1.2, linestyle="none", label="truth")
    for place, (name, (x, y)) in enumerate(zip(names, view.answers, strict=True)):
        size = 8.0 - 4.0 * place / len(names)  # larger marks first: later ones do not hide them
        look: style.Marks = {"marker": style.marker(name), "color": style.color(name), "markersize": size}
        ax.plot(x, y, linestyle="none", zorder=5, label=style.label(name), **look)
    ax.set_xlabel("centre along the axis, $(ĉ_1 − c_1)/r$")
    ax.set_ylabel("radius, $(r̂ − r)/r$" if view.words == "radius" else "centre across it, $(ĉ_2 − c_2)/r$")
    ax.locator_params(nbins=5)
