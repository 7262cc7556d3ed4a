"""Figure 7 of a recording: scatter of joint centres over the number of frames that they are fitted to.

Left, as in the paper: random subsets, and their scatter about the whole recording's centre. Right: the effective number
of independent frames, and an error that includes the standard error of the whole recording's centre. Beside it are
consecutive frames, which a shorter recording would have.

Look at the slopes, printed with their intervals, and at the outliers, named with their reasons.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study import style
from study.recordings.case_study import NEAR, SETS, CaseStudy, without_hinge_axes

_GREY, _OUT = "0.6", "#c1272d"
_MIDDLE = {"random": "#1f5fa8", "window": "#d98c1f"}


@dataclass(frozen=True)
class CaseStudyFrame:
    """The curves and texts of the figure.

    Attributes:
        curves: a row per joint and N of random subsets, every axis kept: ``joint, samples, median`` in centimetres,
            ``outlier``.
        middle: a row per ``axis`` (raw, window, effective) and N: ``x`` and ``y``, medians over joints, centimetres;
            infinite if more than half of the fits failed.
        near: a row per N: share of all fits within one centimetre.
        laws: exponents with intervals, by axis.
        reasons: a line per outlier.
        stamp: the recording's name, its frames, and the number of subsets per point.
    """

    curves: pd.DataFrame
    middle: pd.DataFrame
    near: pd.DataFrame
    laws: pd.DataFrame
    reasons: tuple[str, ...]
    stamp: str


def prepare(case: CaseStudy) -> CaseStudyFrame:
    """Collect the curves of the joints and their medians."""
    scatter = case.scatter
    plain = scatter[(scatter["way"] == "random") & ~scatter["dropped"]].merge(
        case.joints[["joint", "outlier"]], on="joint"
    )
    middle, rows = [], without_hinge_axes(scatter)
    for axis, way, x, y in (
        ("raw", "random", "samples", "median"),
        ("effective", "random", "effective", "error"),
        ("window", "window", "effective", "median"),
    ):
        part = rows[rows["way"] == way].groupby("samples", sort=True)
        middle += [{"axis": axis, "x": group[x].median(), "y": 100 * group[y].median()} for _, group in part]
    near = plain.groupby("samples", sort=True)["near"].mean().reset_index()
    outliers = case.joints[case.joints["outlier"]]
    return CaseStudyFrame(
        curves=plain.assign(median=100 * plain["median"])[["joint", "samples", "median", "outlier"]],
        middle=pd.DataFrame(middle),
        near=near,
        laws=case.laws,
        reasons=tuple(
            f"{_name(row['joint'])}: {row['reason'] or 'not explained'}" for row in outliers.to_dict("records")
        ),
        stamp=f"{case.recording} · {case.frames:,} frames · {case.subsets} subsets per point",
    )


def _name(joint: str) -> str:
    return joint.replace("_", " ")


@style.journal()
def draw(frame: CaseStudyFrame) -> Figure:
    """Draw the two panels."""
    figure = Figure(figsize=(style.PAGE, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    _draw_raw(left, frame)
    _draw_effective(right, frame)
    shown = frame.curves.loc[np.isfinite(frame.curves["median"]), "median"]
    left.set_ylim(0.5 * shown.min(), min(2.0 * shown.max(), 60.0))
    handles = [
        Line2D([], [], color=_GREY, linewidth=0.8, label="a joint"),
        Line2D([], [], color=_OUT, linewidth=0.8, label="an outlier"),
        Line2D([], [], color=_MIDDLE["random"], marker="o", markersize=4, label="random subsets, median joint"),
        Line2D([], [], color=_MIDDLE["window"], marker="s", markersize=4, label="consecutive frames"),
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=4, columnspacing=1.6)
    figure.supxlabel("\n".join(frame.reasons), fontsize=style.SMALL, x=0.01, ha="left", color=_OUT)
    style.stamp(figure, frame.stamp)
    return figure


def _draw_raw(ax: Axes, frame: CaseStudyFrame) -> None:
    """Draw the paper's figure 7."""
    ax.set_xscale("log")
    ax.set_yscale("log")
    for _, curve in frame.curves.groupby("joint", sort=False):
        color = _OUT if curve["outlier"].iloc[0] else _GREY
        shown = curve[np.isfinite(curve["median"])]
        ax.plot(shown["samples"], shown["median"], color=color, linewidth=0.8, zorder=2 if color == _GREY else 3)
    _draw_middle(ax, frame, "raw", "random", "o")
    ax.axhline(100 * NEAR, color="black", linewidth=0.6, linestyle=(0, (2, 2)))
    for row in frame.near.itertuples():
        x, share = float(str(row.samples)), f"{100 * float(str(row.near)):.0f} %"
        ax.text(x, 0.98, share, transform=ax.get_xaxis_transform(), ha="center", va="top", fontsize=style.SMALL)
    ax.set_title(
        f"as in the paper; at the top the share within {100 * NEAR:g} cm", loc="left", fontsize=style.SMALL + 1
    )
    ax.set_xlabel("number of frames $N$, taken at random")
    ax.set_ylabel("median distance from the whole recording's centre, cm")
    _draw_exponents(ax, frame, ("raw",))


def _draw_effective(ax: Axes, frame: CaseStudyFrame) -> None:
    """Draw the error over the effective number of independent frames."""
    ax.set_xscale("log")
    _draw_middle(ax, frame, "effective", "random", "o")
    _draw_middle(ax, frame, "window", "window", "s")
    ax.axhline(100 * NEAR, color="black", linewidth=0.6, linestyle=(0, (2, 2)))
    ax.set_title("with the error of the whole recording's centre", loc="left", fontsize=style.SMALL + 1)
    ax.set_xlabel("effective number of independent frames")
    _draw_exponents(ax, frame, ("effective", "window"))


def _draw_middle(ax: Axes, frame: CaseStudyFrame, axis: str, way: str, mark: str) -> None:
    """Draw the medians over joints."""
    part = frame.middle[(frame.middle["axis"] == axis) & np.isfinite(frame.middle["y"])]
    ax.plot(part["x"], part["y"], color=_MIDDLE[way], marker=mark, markersize=4, linewidth=1.6, zorder=5)


def _draw_exponents(ax: Axes, frame: CaseStudyFrame, axes: tuple[str, ...]) -> None:
    """Print the exponents with their intervals."""
    names = {"raw": "random", "effective": "random", "window": "consecutive, of $N$"}
    lines = []
    for axis in axes:
        law = frame.laws[frame.laws["axis"] == axis].iloc[0]
        if np.isfinite(law["exponent"]):
            low, high = (style.decimals(law[end], 2) for end in ("low", "high"))
            lines.append(f"{names[axis]}: exponent {style.decimals(law['exponent'], 2)} ({low} to {high})")
    ax.text(0.02, 0.02, "\n".join(lines), transform=ax.transAxes, va="bottom", fontsize=style.SMALL)


def printed(case: CaseStudy) -> list[str]:
    """The results of a case study in lines of text."""
    lines = [f"{case.recording}: {case.subsets} subsets of each size, a quarter from each of {SETS} data sets"]
    for law in case.laws.to_dict("records"):
        exponent = f"{law['exponent']:.3f} ({law['low']:.3f} to {law['high']:.3f})"
        lines.append(f"exponent, {law['axis']}: {exponent}, {law['joints']} joints")
    outliers = case.joints[case.joints["outlier"]].to_dict("records")
    lines += [f"{_name(row['joint'])}: {row['reason'] or 'not explained'}" for row in outliers]
    return lines + [f"{_name(joint)} left out: {why}" for joint, why in case.skipped.items()]
