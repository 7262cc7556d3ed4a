"""Figures embedded in the page as PNG data URIs, with alternative text."""

import base64
import inspect
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from study.figures import FIGURES, FigureModule, KeptPictures, NotApplicable, Tables, style
from study.figures.failure import failure
from study.figures.fig_efficiency import EfficiencyFrame
from study.report.blocks import Content, InlineCode, Link, Picture, Text, coded
from study.report.drawing import Artist
from study.report.findings import nearest_cap
from study.report.words import count

_LEAD = "fig_efficiency"
"""Figure that the top of the page has a part of."""
_SHOWN = ("gdke", "lls", "ugdk", "mle", "als", "corrected")
"""Estimators of the paper, and those to use instead, in the order of drawing."""


class Gallery:
    """The figures that runs can feed, each drawn from the first run that can, unless its picture was kept.

    Args:
        artist: draws the pictures; see `study.report.drawing`.

    Attributes:
        undrawn: for each figure that no run could feed so far the reasons, by the run's name.
        efficiency: content of the figure that the top of the page has a part of; None where no run can feed it.
    """

    def __init__(self, artist: Artist) -> None:
        self._artist = artist
        self._begun: dict[str, tuple[str, Callable[[], bytes | str]]] = {}
        self._lead: Callable[[], bytes | str] | None = None
        self.undrawn: dict[str, dict[str, str]] = {}
        self.efficiency: EfficiencyFrame | None = None

    def add(self, tables: Tables, pictures: KeptPictures) -> None:
        """Begin to draw the figures that a run can feed and no earlier run could.

        Args:
            tables: the run's.
            pictures: those that were drawn from them before.
        """
        for name, figure in FIGURES.items():
            if name in self._begun:
                continue
            found = pictures.find(name, figure, ["png"])
            try:
                frame = figure.prepare(tables) if found is None or name == _LEAD else None
            except NotApplicable as reason:
                self.undrawn.setdefault(name, {})[tables.name] = str(reason)
            except Exception as error:  # a figure that fails must not cost the page
                self.undrawn.setdefault(name, {})[tables.name] = failure(error)
            else:
                self.undrawn.pop(name, None)
                self._begun[name] = (
                    tables.name,
                    (_given(found["png"]) if found is not None else self._begin(pictures, name, figure, frame)),
                )
                if isinstance(frame, EfficiencyFrame):
                    self.efficiency = frame
                    top = pictures.find("lead", figure, ["png"])
                    self._lead = _given(top["png"]) if top else self._begin(pictures, "lead", figure, frame)

    def _begin(self, pictures: KeptPictures, name: str, figure: FigureModule, frame: Any) -> Callable[[], bytes | str]:
        """Begin to draw a picture; the function returned waits for it, and keeps it."""
        drawing = self._artist.begin(_drawn, name, frame)

        def wait() -> bytes | str:
            if isinstance(drawn := drawing(), bytes):
                pictures.keep(name, figure, {"png": drawn})
            return drawn

        return wait

    def finish(self) -> tuple[dict[str, Picture], Picture | None]:
        """Wait for the pictures.

        Returns:
            The figures, by name and in their order, and the picture at the top of the page; None where no run can feed
            it. A figure that fails does not cost the others; ``undrawn`` has its reason, with its place in the code.
        """
        found = {}
        for name in (name for name in FIGURES if name in self._begun):
            run, drawing = self._begun[name]
            drawn = drawing()
            if isinstance(drawn, bytes):
                found[name] = picture(name, FIGURES[name], drawn, run)
            else:
                self.undrawn[name] = {run: drawn}
        top = self._lead() if self._lead is not None and _LEAD in found else None
        return found, lead(self.efficiency, top) if self.efficiency is not None and isinstance(top, bytes) else None


def _given(picture: bytes) -> Callable[[], bytes]:
    """A function that returns a picture that was kept."""
    return lambda: picture


def lead(efficiency: EfficiencyFrame, data: bytes) -> Picture:
    """The picture at the top of the page, given as PNG."""
    angle = nearest_cap(efficiency)
    at = f"Cap of {angle:g}°, N\u00a0=\u00a0{count(efficiency.samples)}."
    words = f"Median error of each estimator over the Cramér-Rao bound, against noise. {at}"
    advice = " The closer to the lines, the better. Only a biased estimator can lie below them."
    caption = [
        Text([words, advice]),
        Text([Link("The whole figure", "fig_efficiency"), f", {efficiency.stamp}"]),
    ]
    return embedded("lead", data, words, caption)


@style.journal()
def draw_lead(frame: EfficiencyFrame) -> Figure:
    """Draw the picture at the top of the page, one panel: few estimators, both bounds, the legend where no curve is."""
    angle = nearest_cap(frame)
    figure = Figure(figsize=(4.7, 3.7), layout="constrained")
    ax = figure.subplots()
    ax.set_xscale("log")
    ax.set_yscale("log")
    mine = frame.curves[frame.curves["angle"] == angle]
    names = [name for name in _SHOWN if name in set(mine["estimator"])] or list(dict.fromkeys(mine["estimator"]))[:6]
    for name in names:
        curve = mine[mine["estimator"] == name].sort_values("level")
        (line,) = ax.plot(curve["level"], curve["ratio"], linewidth=1.3, label=style.label(name))
        line.set(color=style.color(name), marker=style.marker(name), markersize=4, markeredgewidth=0.0)
    reached = frame.attainable[frame.attainable["angle"] == angle].sort_values("level")
    (line,) = ax.plot(reached["level"], reached["ratio"], color="black", zorder=4, label="attainable bound")
    line.set(linewidth=1.3, linestyle=(0, (4, 2)))
    ax.axhline(1.0, color="black", linewidth=0.9, label="Cramér-Rao bound", zorder=1)
    shown = mine["ratio"][mine["estimator"].isin(names) & np.isfinite(mine["ratio"])]
    ax.set_ylim(min(0.7, 0.8 * shown.min()), 1.5 * shown.max())
    ax.set_xlabel("noise over radius, $σ/r$")
    ax.set_ylabel("median error, Cramér-Rao bound = 1")
    ax.legend(loc="upper left", fontsize=8.0)
    return figure


def _drawn(name: str, frame: Any) -> bytes | str:
    """Draw a figure as PNG; its failure in words if it fails."""
    try:
        return style.encode(draw_lead(frame) if name == "lead" else FIGURES[name].draw(frame), "png")
    except Exception as error:  # a figure that fails must not cost the page
        return failure(error)


def picture(name: str, figure: FigureModule, data: bytes, run: str) -> Picture:
    """A figure's PNG with its title, its advice and the name of the run as caption."""
    title, look = described(figure)
    caption = [Text(coded(title)), *([Text(coded(look))] if look else []), Text([InlineCode(name), f", run {run}"])]
    return embedded(name, data, f"{title} Run {run}.".replace("`", ""), caption)


def embedded(name: str, data: bytes, alt: str, caption: Content) -> Picture:
    """A PNG as a picture that needs no other file."""
    # a PNG begins with a signature, a length and "IHDR"; then come width and height
    width, height = (int.from_bytes(data[i : i + 4], "big") for i in (16, 20))
    return Picture(name, f"data:image/png;base64,{base64.b64encode(data).decode()}", alt, width, height, caption)


def described(figure: FigureModule) -> tuple[str, str]:
    """First paragraph of a figure's docstring and its advice on what to look at, "" if none; code in backticks."""
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n", inspect.getdoc(figure) or "")]
    paragraphs = [part.replace("``", "`") for part in paragraphs]
    return paragraphs[0], next((part for part in paragraphs[1:] if part.startswith("Look at")), "")
