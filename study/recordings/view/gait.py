"""The gait report: curves of pelvis and legs over the cycle, as a figure and as one page without a network.

Thin lines are single cycles, the thick line is their mean, and the band is one standard deviation of three cycles or
more. Rings mark points that are suspect: a segment is bridged, or a value is a spike. Where a curve is missing its
reason stands in the panel.
"""

import html
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study import style
from study.recordings.events import SIDES
from study.recordings.gait import FEW, PANELS, TOTAL, Gait, Sticks, angle_rows, parameter_rows
from study.recordings.view.figure import SIDES as COLORS
from study.style import encode, journal, save_bytes

_WORDS = {
    ("pelvis", "tilt"): "Pelvic tilt: back − / front +",
    ("pelvis", "obliquity"): "Pelvic obliquity: down − / up +",
    ("pelvis", "rotation"): "Pelvic rotation: back − / front +",
    ("hip", "flexion"): "Hip: extension − / flexion +",
    ("hip", "adduction"): "Hip: abduction − / adduction +",
    ("hip", "rotation"): "Hip rotation: out − / in +",
    ("knee", "flexion"): "Knee: extension − / flexion +",
    ("knee", "adduction"): "Knee: abduction − / adduction +",
    ("knee", "rotation"): "Knee rotation: out − / in +",
    ("ankle", "flexion"): "Ankle: plantar − / dorsiflexion +",
    ("ankle", "adduction"): "Ankle: eversion − / inversion +",
    ("ankle", "rotation"): "Foot rotation: out − / in +",
    ("foot", "progression"): "Foot progression: out − / in +",
}
"""The titles of the panels."""
_STYLES = {"left": "-", "right": (0, (5, 1.5))}
_RING: dict[str, Any] = {"linestyle": "", "marker": "o", "fillstyle": "none", "markersize": 2.6, "zorder": 4}


def _draw(ax: Axes, means: pd.DataFrame, gait: Gait, panel: tuple[str, str]) -> None:
    """Draw one angle over the cycle: single cycles, mean, its band, suspect points, and the end of stance."""
    joint, angle = panel
    reasons = []
    for side in SIDES:
        rows = _of(means, side, panel)
        if rows.empty:
            reasons.append((side, gait.reasons.get((side, joint, angle), _NONE)))
            continue
        wide = rows.set_index("percent").reindex(range(101))
        curves = _of(gait.curves, side, panel).groupby(["recording", "cycle"], sort=False)
        for _, curve in curves if len(curves) > 1 else ():
            ax.plot(curve["percent"], curve["value"], color=COLORS[side], linewidth=0.4, alpha=0.55, zorder=1)
        ax.plot(wide.index, wide["mean"], color=COLORS[side], linestyle=_STYLES[side], label=side, zorder=3)
        if wide["cycles"].max() >= FEW:
            below, above = (wide["mean"] + sign * wide["sd"] for sign in (-1.0, 1.0))
            ax.fill_between(wide.index, below, above, color=COLORS[side], alpha=0.15, linewidth=0.0, zorder=0)
        doubt = _of(gait.curves, side, panel).query("suspect")
        ax.plot(doubt["percent"], doubt["value"], color=COLORS[side], **_RING)
        stance = gait.cycles.loc[gait.cycles["side"] == side, "stance"].mean()
        ax.axvline(stance, color=COLORS[side], linewidth=0.6, linestyle=_STYLES[side])
    low, high = ax.get_ylim()
    if len(reasons) < len(SIDES) and high - low < _LEAST:  # a small range is no large motion
        ax.set_ylim(0.5 * (low + high - _LEAST), 0.5 * (low + high + _LEAST))
    if len(reasons) == 1:  # room for its words
        low, high = ax.get_ylim()
        ax.set_ylim(low - 0.4 * (high - low), high)
    ax.axhline(0.0, color=style.FAINT, linewidth=0.6, zorder=0)
    ax.set(xlim=(0, 100), xticks=(0, 20, 40, 60, 80, 100))
    ax.set_title(_WORDS[panel], fontsize=style.SMALL + 0.5)
    if len(reasons) == len(SIDES):
        ax.set_yticks([])
    if reasons:
        both = len({why for _, why in reasons}) == 1 and len(reasons) == len(SIDES)
        texts = [f"missing: {reasons[0][1]}"] if both else [f"{side} is missing: {why}" for side, why in reasons]
        text = "\n".join(line for one in texts for line in textwrap.wrap(one, 34))
        place: dict[str, Any] = {"transform": ax.transAxes, "ha": "center", "va": "center" if both else "bottom"}
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
        ax.text(0.5, 0.5 if both else 0.03, text, fontsize=style.SMALL - 0.5, color="0.25", bbox=box, zorder=5, **place)


_NONE = "its segment has no anatomical axes, or is not in the marker set"
_LEAST = 10.0
"""Degrees: least height of a panel."""


def _of(table: pd.DataFrame, side: str, panel: tuple[str, str]) -> pd.DataFrame:
    """The rows of a side and an angle."""
    return table[(table["side"] == side) & (table["joint"] == panel[0]) & (table["angle"] == panel[1])]


def _draw_sticks(ax: Axes, sticks: Sticks) -> None:
    """Draw the body at equal steps of one cycle, from its right side; arms and legs in the colours of their sides."""
    percent = np.linspace(0, 100, len(sticks.places))
    for number, shown in enumerate(sticks.places):
        for one, other in sticks.bones:
            side = sticks.sides[one] or sticks.sides[other]
            x, z = shown[[one, other]].T
            look: dict[str, Any] = {"color": COLORS.get(side, "0.45"), "linestyle": _STYLES.get(side, "-")}
            ax.plot(x + _APART * number, z, linewidth=0.9, zorder=2 + (side == "right"), **look)
    ax.set_aspect("equal")
    ax.set_title(f"{sticks.title}, seen from the right", fontsize=style.SMALL + 0.5)
    ax.set(xticks=_APART * np.arange(len(percent)), xticklabels=[f"{p:.0f}" for p in percent])
    ax.set(xlabel="gait cycle / %", ylabel="height / m")


_APART = 0.55
"""Metres between two bodies of the stick figure."""


@journal()
def draw(gait: Gait) -> Figure:
    """Draw the angles over the gait cycle, left and right, and the body over one cycle."""
    figure, means = style.Picture(figsize=(style.PAGE, 9.2), layout="constrained"), gait.means()
    rows = -(-(len(PANELS) + 2) // 3)
    grid = figure.add_gridspec(rows, 3)
    axes = [figure.add_subplot(grid[divmod(number, 3)]) for number in range(len(PANELS))]
    for ax, panel in zip(axes, PANELS, strict=True):
        _draw(ax, means, gait, panel)
    for ax in axes[::3]:
        ax.set_ylabel("angle / °")
    for ax in axes[-3:]:
        ax.set_xlabel("gait cycle / %")
    if gait.sticks is not None:
        _draw_sticks(figure.add_subplot(grid[rows - 1, 1:]), gait.sticks)
    handles = {text: line for ax in axes for line, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    counted = {side: int((gait.cycles["side"] == side).sum()) for side in handles}
    cycles = {side: f"{count} cycle" + "s" * (count != 1) for side, count in counted.items()}
    band = {
        side: ", thin: each, band: ± sd" if counted[side] >= FEW else ", thin: each" * (counted[side] > 1)
        for side in handles
    }
    labels = [f"{side}, {cycles[side]}: mean{band[side]}" for side in handles]
    figure.align_ylabels(axes[::3])
    figure.legend(handles.values(), labels, loc="outside upper center", ncols=2)
    return figure


@journal()
def _panels(gait: Gait) -> list[str]:
    """The panels and the stick figure as SVG, for a page on which they wrap."""
    means, panels = gait.means(), []
    for panel in PANELS:
        figure = Figure(figsize=(2.9, 2.1), layout="constrained")
        ax = figure.subplots()
        _draw(ax, means, gait, panel)
        ax.set(xlabel="gait cycle / %", ylabel="angle / °")
        panels.append(_svg(figure, _WORDS[panel], "-".join(panel)))
    if gait.sticks is not None:
        figure = Figure(figsize=(5.9, 2.1), layout="constrained")
        _draw_sticks(figure.subplots(), gait.sticks)
        panels.append(f'<div class="wide">{_svg(figure, "The body over one cycle", "sticks")}</div>')
    return panels


def _svg(figure: Figure, label: str, name: str) -> str:
    """A figure as SVG with a label for readers of screens; its ids begin with a name."""
    text = encode(figure, "svg").decode()
    svg = text[text.index("<svg") :].replace("<svg", f'<svg role="img" aria-label="{html.escape(label)}"', 1)
    return unique_ids(svg, f"{name}-")


def unique_ids(svg: str, prefix: str) -> str:
    """An SVG whose ids begin with a prefix, so that several stand in one page."""
    for before in ('id="', 'xlink:href="#', "url(#"):
        svg = svg.replace(before, before + prefix)
    return svg


_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; margin: 1.2rem auto; max-width: 66rem; padding: 0 1rem; }
h1 { font-size: 1.35rem; margin: 0 0 .2rem; } p { margin: .3rem 0; } h2 { font-size: 1.05rem; margin: 1rem 0 .2rem; }
.panels { display: grid; grid-template-columns: repeat(auto-fit, minmax(17rem, 1fr)); gap: .6rem; margin: .8rem 0; }
.panels svg { width: 100%; height: auto; } .wide { grid-column: span 2; }
.tables { display: flex; flex-wrap: wrap; gap: 0 3rem; align-items: flex-start; }
table { border-collapse: collapse; margin: .6rem 0; white-space: nowrap; }
th, td { padding: .15rem .8rem .15rem 0; text-align: right; }
th:first-child, td:first-child { text-align: left; font-weight: normal; } tr { border-bottom: 1px solid #ddd; }
.key span { display: inline-block; width: 1.8em; border-top: 2px solid; vertical-align: middle; margin-right: .4em; }
@media (max-width: 40rem) {
  .wide { grid-column: auto; overflow-x: auto; } .wide svg { min-width: 34rem; }
  body { padding: 0 .6rem; font-size: 14px; }
  table { font-size: 12px; } th, td { padding-right: .45rem; }
}
@media print {
  @page { size: A4; margin: 12mm; } body { font-size: 10.5px; max-width: none; margin: 0; padding: 0; }
  .panels { grid-template-columns: repeat(3, 1fr); gap: .2rem; } .panels svg { break-inside: avoid; }
  .wide { grid-column: span 2; } tr, li { break-inside: avoid; }
}
"""


def _table(head: str, rows: list[list[str]]) -> str:
    """A table of HTML with a column for each side."""
    tags = ("th", "td", "td")
    cells = ("".join(f"<{t}>{html.escape(c)}</{t}>" for t, c in zip(tags, row, strict=True)) for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return f"<table><tr><th>{head}</th><th>left</th><th>right</th></tr>{body}</table>"


def page(gait: Gait, title: str) -> str:
    """The report as one page: parameters of the cycles, the curves and the body over one cycle, and the notes."""
    walks = ", ".join(dict.fromkeys(gait.cycles["recording"]))
    walked = f"<p>Walks: {html.escape(walks)}.</p>" * (walks != title)
    dashes = {"left": "solid", "right": "dashed"}
    lines = [f'<span style="border-color: {COLORS[s]}; border-style: {dashes[s]}"></span>{s}' for s in SIDES]
    most, doubtful = int(gait.cycles["side"].value_counts().max()), int(gait.curves["suspect"].sum())
    lines += ["thick: mean; thin: single cycles"] * (most > 1)
    lines += [f"band: ± one standard deviation of {FEW} cycles or more"] * (most >= FEW)
    lines += ["upright line: toes off"]
    lines += [f"○&nbsp;suspect ({doubtful} points): a segment is bridged, or a spike"] * (doubtful > 0)
    spread = f"In the table of cycles ± is the standard deviation of {FEW} cycles or more. " * (most >= FEW)
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in gait.notes)
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>
<h1>Gait: {html.escape(title)}</h1>
{walked}
<div class="tables">{_table("", list(parameter_rows(gait)))}{_table("mean curve, range", list(angle_rows(gait)))}</div>
<p>{spread}Beside an angle ± is the standard error of its mean curve, the median over the curve, {TOTAL}.</p>
<p class="key">{" &emsp; ".join(lines)}</p>
<div class="panels">{"".join(_panels(gait))}</div>
<h2>Notes</h2>
<ul>{notes}</ul>
</body></html>
"""


def write_page(gait: Gait, title: str, path: Path) -> Path:
    """Write the report, whole or not at all.

    Returns:
        The path.

    Raises:
        RunError: if it cannot be written.
    """
    return save_bytes(path, page(gait, title).encode("utf-8", "replace"))
