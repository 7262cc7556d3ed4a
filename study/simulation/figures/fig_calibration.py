"""Calibration: coverage of the truth by posteriors, and by the estimators' own error ellipsoids.

Left: the share of trials in which the rank of the truth in its posterior is below p, minus p. There is a curve for each
parameter and one for the likelihood, whose rank also sees a posterior that ignores the data (Modrák et al. 2023). The
grey band is simultaneous: if all ranks are uniform, all curves stay within it in at least 95 of 100 cases (Kolmogorov's
law). Right: the share of trials whose true centre lies in sets of nominal 68 % and 95 %, with exact binomial 95 %
intervals. If the nominal level is true, the band holds the share with a probability of 95 %. Fits that are not ok count
as outside.

Only cells with σ²/v < 0.02 count, where the likelihood is nearly quadratic.

Look at: posteriors lie within the band, and every method on its line. GDKE leaves it where its bias is seen (more
noise, a smaller cap), since its ellipsoids do not include the bias.
"""

from typing import Any

import numpy as np
import pandas as pd
import scipy
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from study import style
from study.simulation.figures.figure import Frame, NotApplicable, Tables
from study.simulation.posterior.run import FLAT, LEVELS, coverage, trials

_LEAST_TRIALS = 20
_BAND = "#ececec"
_NAMES = {
    "1": "$c_1$, along the axis",
    "2": "$c_2$, across it",
    "radius": "radius",
    "noise": "σ",
    "likelihood": "likelihood",
}
_COLORS = {
    "geometric": dict(zip(_NAMES, ("#222222", "#0072b2", "#d55e00", "#009e73", "#882255"), strict=True)),
    "whole_sphere": dict(zip(_NAMES, ("#888888", "#56b4e9", "#e69f00", "#7fc9b4", "#cc79a7"), strict=True)),
}
_LINES: style.Marks = {"known": "-", "unknown": (0, (4, 2))}


def prepare(tables: Tables) -> Frame:
    """Collect ranks and coverage.

    Returns:
        curves: the ranks of each parameter in each kind of chain, in order: parameter, likelihood, noise_is, ranks.
        coverage: as `study.simulation.posterior.run.coverage` gives it.
        levels: of the intervals.
        trials: the smallest number of trials behind a curve.
        stamp: the run's name and trials.

    Raises:
        NotApplicable: if there are fewer than 20 independent chains of a kind on caps that are not too flat.
    """
    if tables.posterior is None or tables.answers is None:
        raise NotApplicable("needs posteriors: [posterior] in the config, then `study posterior RUN`")
    if not tables.independent:
        raise NotApplicable('needs trials that are independent of each other: draws = "independent" in the config')
    result = trials(tables.posterior, tables.answers)
    result = result[result["flatness"] < FLAT]
    kinds = result[result["method"] == "posterior"].groupby(["likelihood", "noise_is"], sort=False, observed=True)
    least = int(kinds.size().min()) if len(result) else 0
    if least < _LEAST_TRIALS:
        raise NotApplicable(f"needs at least {_LEAST_TRIALS} chains of each kind with σ²/v < {FLAT}, not {least}")
    curves = []
    for (likelihood, noise_is), part in kinds:
        use = part[part["ok"]]
        for parameter in _NAMES:  # an older table has no ranks of the likelihood
            ranks = use.get(f"rank_{parameter}", pd.Series(dtype=float)).dropna().to_numpy()
            if len(ranks):
                kind = {"likelihood": str(likelihood), "noise_is": str(noise_is)}
                curves.append(Frame(parameter=parameter, ranks=np.sort(ranks), **kind))
    if not curves:
        raise NotApplicable("needs chains that are ok: none is; give them more steps with max_steps")
    count = min(len(curve.ranks) for curve in curves)
    failed = sum(int((~part["ok"]).sum()) for _, part in kinds)
    stamp = f"{tables.name} · {count:,} trials behind each curve" + (f", {failed} chains not ok" if failed else "")
    return Frame(curves=curves, coverage=coverage(result), levels=LEVELS, trials=count, stamp=stamp)


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw the ranks on the left, the coverage on the right, with one legend above."""
    rows = len(frame.coverage[["likelihood", "method"]].drop_duplicates())
    figure = style.Picture(figsize=(style.PAGE, 2.0 + max(1.5, 0.24 * rows)), layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_ranks(left, frame)
    _draw_coverage(right, frame)
    figure.legend(handles=_handles(frame), loc="outside upper center", ncols=6, columnspacing=1.4)
    style.stamp(figure, frame.stamp)
    return figure


def _handles(frame: Frame) -> list[Artist]:
    """Legend entries for colours, lines, marks and the band."""
    shown = list(dict.fromkeys((c.likelihood, c.parameter) for c in frame.curves))
    several = len({likelihood for likelihood, _ in shown}) > 1
    handles: list[Artist] = [
        Line2D([], [], color=_COLORS[likelihood][parameter], label=_NAMES[parameter] + _suffix(likelihood, several))
        for likelihood, parameter in shown
    ]
    for noise_is in dict.fromkeys(c.noise_is for c in frame.curves):
        look = {"linestyle": _LINES[noise_is], "marker": "o", "markerfacecolor": _fill(noise_is, style.INK)}
        handles.append(Line2D([], [], color=style.INK, markersize=4, label=f"σ {noise_is}", **look))
    return [*handles, Patch(color=_BAND, label="95 of 100 if calibrated")]


def _suffix(likelihood: str, several: bool) -> str:
    return f" ({likelihood.replace('_', ' ')})" if several else ""


def _fill(noise_is: str, color: str) -> str:
    return color if noise_is == "known" else "white"


def _draw_ranks(ax: Axes, frame: Frame) -> None:
    band = float(scipy.stats.kstwo.ppf(1.0 - 0.05 / len(frame.curves), frame.trials))
    ax.axhspan(-band, band, color=_BAND, zorder=0, linewidth=0.0)
    ax.axhline(0.0, color="black", linewidth=0.8)
    reach = band
    for curve in frame.curves:
        n = len(curve.ranks)
        x = np.concatenate([[0.0], np.repeat(curve.ranks, 2), [1.0]])
        y = np.repeat(np.arange(n + 1) / n, 2) - x
        color = _COLORS[curve.likelihood][curve.parameter]
        ax.plot(x, y, color=color, linestyle=_LINES[curve.noise_is], linewidth=1.0)
        reach = max(reach, float(np.abs(y).max()))
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(-1.1 * reach, 1.1 * reach)
    ax.set_xlabel("rank $p$ of the truth in its posterior")
    ax.set_ylabel("share of trials below $p$, less $p$")
    ax.set_title("ranks", loc="left")


def _draw_coverage(ax: Axes, frame: Frame) -> None:
    several = frame.coverage["likelihood"].nunique() > 1
    for level in frame.levels:
        low, high = scipy.stats.binom.ppf([0.025, 0.975], frame.trials, level) / frame.trials
        ax.axvspan(low, high, color=_BAND, zorder=0, linewidth=0.0)
        ax.axvline(level, color="black", linewidth=0.8, zorder=1)
    labels = []
    groups = frame.coverage.groupby(["likelihood", "method"], sort=False, observed=True)
    keys: Any
    row: Any
    for place, (keys, part) in enumerate(groups):
        likelihood, method = keys
        chain = method == "posterior"
        color, marker = (style.INK, "o") if chain else (style.color(method), style.marker(method))
        kinds = list(part["noise_is"].unique())
        for row in part.itertuples():
            at = place + 0.3 * (kinds.index(row.noise_is) - 0.5 * (len(kinds) - 1))
            ax.plot([row.low, row.high], [at, at], color=color, linewidth=1.0, zorder=3)
            face = _fill(row.noise_is, color)
            look: style.Marks = {"color": color, "markerfacecolor": face, "markeredgewidth": 0.8}
            ax.plot(row.share, at, marker=marker, markersize=4, zorder=4, **look)
        labels.append("posterior" + _suffix(likelihood, several) if chain else style.label(method))
    ax.set_yticks(range(len(labels)), labels)
    ax.set_ylim(len(labels) - 0.4, -0.6)
    ax.set_xlim(min(0.5, frame.coverage["low"].min() - 0.03), 1.0)
    ax.set_xlabel("share with the true centre inside")
    ax.set_title("sets of nominal 68 % and 95 %", loc="left")
