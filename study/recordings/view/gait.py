"""The gait report: curves of hips, knees and ankles over the cycle, as a figure and as one page without a network."""

import html
import textwrap
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study import style
from study.recordings.gait import ANGLES, JOINTS, SIDES, Gait, parameter_rows
from study.recordings.view.figure import SIDES as COLORS
from study.style import encode, journal, save_bytes

_WORDS = {
    ("hip", "flexion"): "Hip: extension − / flexion +",
    ("hip", "adduction"): "Hip: abduction − / adduction +",
    ("hip", "rotation"): "Hip rotation: out − / in +",
    ("knee", "flexion"): "Knee: extension − / flexion +",
    ("knee", "adduction"): "Knee: abduction − / adduction +",
    ("knee", "rotation"): "Knee rotation: out − / in +",
    ("ankle", "flexion"): "Ankle: plantar − / dorsiflexion +",
    ("ankle", "adduction"): "Ankle: eversion − / inversion +",
    ("ankle", "rotation"): "Foot rotation: out − / in +",
}
"""The panels in their order: rows are joints, columns are planes."""
_STYLES = {"left": "-", "right": (0, (5, 1.5))}


def _draw(ax: Axes, means: pd.DataFrame, gait: Gait, joint: str, angle: str) -> bool:
    """Draw one angle over the cycle: mean, its band of one standard deviation, and the end of stance; false if none."""
    drawn = False
    for side in SIDES:
        rows = means[(means["side"] == side) & (means["joint"] == joint) & (means["angle"] == angle)]
        if rows.empty:
            continue
        drawn, wide = True, rows.set_index("percent").reindex(range(101))
        ax.plot(wide.index, wide["mean"], color=COLORS[side], linestyle=_STYLES[side], label=side)
        low, high = (wide["mean"] + sign * wide["sd"].fillna(0.0) for sign in (-1.0, 1.0))
        ax.fill_between(wide.index, low, high, color=COLORS[side], alpha=0.18, linewidth=0.0)
        stance = gait.cycles.loc[gait.cycles["side"] == side, "stance"].mean()
        ax.axvline(stance, color=COLORS[side], linewidth=0.6, linestyle=_STYLES[side])
    ax.axhline(0.0, color=style.FAINT, linewidth=0.6, zorder=0)
    ax.set(xlim=(0, 100), xticks=(0, 20, 40, 60, 80, 100))
    ax.set_title(_WORDS[joint, angle], fontsize=style.SMALL + 0.5)
    if not drawn:
        reasons = dict.fromkeys(text for (_, own), text in gait.missing.items() if own == joint)
        words = "\n".join(textwrap.fill(text, 34) for text in reasons) or "not known"
        ax.text(0.5, 0.5, words, transform=ax.transAxes, ha="center", va="center", color=style.FAINT, fontsize=5)
        ax.set_yticks([])
    return drawn


@journal()
def draw(gait: Gait) -> Figure:
    """Draw the nine angles over the gait cycle, left and right: mean over the cycles ± one standard deviation."""
    figure, means = style.Picture(figsize=(style.PAGE, 6.2), layout="constrained"), gait.means()
    axes = figure.subplots(len(JOINTS), len(ANGLES), sharex=True)
    for row, joint in zip(axes, JOINTS, strict=True):
        for ax, angle in zip(row, ANGLES, strict=True):
            _draw(ax, means, gait, joint, angle)
        row[0].set_ylabel("angle / °")
    for ax in axes[-1]:
        ax.set_xlabel("gait cycle / %")
    handles = {text: line for ax in axes.flat for line, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    counted = {side: int((gait.cycles["side"] == side).sum()) for side in handles}
    cycles = {side: f"{count} cycle" + "s" * (count != 1) for side, count in counted.items()}
    labels = [f"{side}, {cycles[side]}: mean ± sd; upright: toes off" for side in handles]
    figure.align_ylabels(axes[:, 0])
    figure.legend(handles.values(), labels, loc="outside upper center", ncols=2)
    return figure


@journal()
def _panels(gait: Gait) -> list[str]:
    """The nine panels as SVG, for a page on which they wrap."""
    means, panels = gait.means(), []
    for joint in JOINTS:
        for angle in ANGLES:
            figure = Figure(figsize=(2.9, 2.1), layout="constrained")
            ax = figure.subplots()
            _draw(ax, means, gait, joint, angle)
            ax.set(xlabel="gait cycle / %", ylabel="angle / °")
            text = encode(figure, "svg").decode()
            label = html.escape(_WORDS[joint, angle])
            svg = text[text.index("<svg") :].replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
            panels.append(unique_ids(svg, f"{joint}-{angle}-"))
    return panels


def unique_ids(svg: str, prefix: str) -> str:
    """An SVG whose ids begin with a prefix, so that several stand in one page."""
    for before in ('id="', 'xlink:href="#', "url(#"):
        svg = svg.replace(before, before + prefix)
    return svg


_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; margin: 1.2rem auto; max-width: 66rem; padding: 0 1rem; }
h1 { font-size: 1.35rem; margin: 0 0 .2rem; } p { margin: .3rem 0; }
.panels { display: grid; grid-template-columns: repeat(auto-fit, minmax(17rem, 1fr)); gap: .6rem; margin: .8rem 0; }
.panels svg { width: 100%; height: auto; }
table { border-collapse: collapse; margin: .6rem 0; } th, td { padding: .15rem .8rem .15rem 0; text-align: right; }
th:first-child, td:first-child { text-align: left; } tr { border-bottom: 1px solid #ddd; }
.key span { display: inline-block; width: 1.8em; border-top: 2px solid; vertical-align: middle; margin-right: .4em; }
@media print {
  @page { size: A4; margin: 12mm; } body { font-size: 10.5px; max-width: none; margin: 0; padding: 0; }
  .panels { grid-template-columns: repeat(3, 1fr); gap: .2rem; } .panels svg { break-inside: avoid; }
}
"""


def page(gait: Gait, title: str) -> str:
    """The report as one page: parameters of the cycles, the nine curves, and the notes."""
    rows = "".join(
        "<tr>"
        + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for tag, cell in zip(("th", "td", "td"), row, strict=True))
        for row in parameter_rows(gait)
    )
    walks = ", ".join(dict.fromkeys(gait.cycles["recording"]))
    dashes = {"left": "solid", "right": "dashed"}
    key = " &emsp; ".join(
        f'<span style="border-color: {COLORS[s]}; border-style: {dashes[s]}"></span>{s}' for s in SIDES
    )
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in gait.notes)
    error = gait.means()["error"].median()
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>
<h1>Gait: {html.escape(title)}</h1>
<p>Walks: {html.escape(walks)}.</p>
<table><tr><th></th><th>left</th><th>right</th></tr>{rows}</table>
<p class="key">{key} &emsp; line: mean over the cycles; band: ± one standard deviation; upright line: toes off</p>
<div class="panels">{"".join(_panels(gait))}</div>
<p>The median standard error of an angle in one frame, from markers, skin and anatomical axes, is {error:.1f}°.
Strikes and toe-offs come from the feet's markers (Zeni et al. 2008).</p>
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
