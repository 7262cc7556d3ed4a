"""Style of every figure: width, type, one colour and mark per estimator, the stamp, reproducible files."""

import colorsys
import contextlib
import io
import math
import textwrap
import zlib
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import scipy
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from study.arrays import Floats
from study.files import RunError, explained, write

Marks = dict[str, Any]
"""Keywords of a function of Matplotlib, which several calls share."""

PAGE = 6.8
"""Width of a full page, in inches."""

_ON_SCREEN = 120
"""Dots per inch in a notebook."""

SMALL = 7.0
"""Size of the smallest type, in points: notes and direct labels."""

INK = "#222222"
FAINT = "#8a8a8a"

# Okabe & Ito's colours, which colour-blind readers can tell apart, for what is compared most, without the yellow that
# white paper swallows; then Tol's muted ones; variants are near to what they vary. Black is the truth and the bound.
_LOOKS: dict[str, tuple[str, str, str]] = {
    "mle": ("MLE", "#0072b2", "o"),
    "mle_centroid": ("MLE (centroid)", "#004d80", "o"),
    "mle_mirror": ("MLE (mirror)", "#5a88a8", "o"),
    "mle_early": ("MLE (early stop)", "#8fb4cc", "o"),
    "lls": ("LLS", "#e69f00", "s"),
    "lls_nr": ("LLS (NR)", "#a87b1e", "s"),
    "lls_nr_raw": ("LLS (NR, raw)", "#6f5300", "s"),
    "lls_single": ("LLS (single)", "#c4a35a", "s"),
    "gdke": ("GDKE", "#d55e00", "^"),
    "ugdk": ("UGDK", "#009e73", "D"),
    "ugdk_cov": ("UGDK (Σ̂)", "#5b7f14", "d"),
    "als": ("ALS", "#332288", "p"),
    "fuller": ("ALS (Fuller)", "#6655cc", "p"),
    "corrected": ("corrected", "#c1121f", "H"),
    "corrected_01": ("corrected (ν = 0)", "#e8705f", "H"),
    "corrected_02": ("corrected (ν = ½)", "#f0a090", "H"),
    "corrected_12": ("corrected (ν = 1)", "#6a0610", "H"),
    "hinge": ("hinge", "#c43a9c", "*"),
    "taubin": ("Taubin", "#cc79a7", "v"),
    "pratt": ("Pratt", "#56b4e9", "<"),
    "hyper": ("Hyper", "#882255", ">"),
    "mgdk": ("MGDK", "#999933", "h"),
    "igdk": ("IGDK", "#7a3b3b", "P"),
    "robust": ("robust", "#1f6f78", "X"),
}

_SETTINGS: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#555555",
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": SMALL,
    "savefig.dpi": 200,
    "svg.fonttype": "path",
    "svg.hashsalt": "study",
}


@contextlib.contextmanager
def journal() -> Iterator[None]:
    """Matplotlib's defaults and this project's settings, independent of the user's; also a decorator for ``draw``."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_SETTINGS)  # type: ignore[arg-type]
        yield


def label(estimator: str) -> str:
    """Label of an estimator; one that is not shipped is labelled by its name."""
    return _LOOKS[estimator][0] if estimator in _LOOKS else estimator


def color(estimator: str) -> str:
    """Colour of an estimator in every figure; that of one that is not shipped depends on its name alone."""
    if estimator in _LOOKS:
        return _LOOKS[estimator][1]
    hue = zlib.crc32(estimator.encode()) / 2**32
    while True:  # steps of the golden ratio until the colour differs from the fixed ones
        rgb = colorsys.hsv_to_rgb(hue % 1.0, 0.85, 0.5)
        if all(math.dist(rgb, to_rgb(fixed)) > 0.2 for _, fixed, _ in _LOOKS.values()):
            return to_hex(rgb)
        hue += 0.618


def marker(estimator: str) -> str:
    """Mark of an estimator in every figure, so that no reader depends on colour."""
    return _LOOKS[estimator][2] if estimator in _LOOKS else "X"


def shades(count: int) -> list[str]:
    """Colours of an ordered condition, such as the number of samples: light for the least, dark for the largest."""
    light, dark = np.array([0.62, 0.79, 0.88]), np.array([0.03, 0.19, 0.42])
    return [to_hex((1.0 - share) * light + share * dark) for share in np.linspace(0.0, 1.0, count)]


DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (3, 1, 1, 1, 1, 1)))
"""Line styles of what is drawn together, in order, so that no reader depends on colour."""


def joined(estimators: Sequence[str], words: str = "", width: int = 80) -> str:
    """One label for estimators whose results coincide, followed by words, broken into lines between the names."""
    names = " = ".join(label(name).replace(" ", "\xa0") for name in estimators)
    return textwrap.fill(names + words.replace(" ", "\xa0"), width, break_long_words=False)


def number(value: float) -> str:
    """Format a number with three digits, a power of ten instead of an "e", and a true minus sign."""
    digits, _, power = f"{value:.3g}".partition("e")
    return f"{digits} × $10^{{{int(power)}}}$" if power else digits.replace("-", "−")


def decimals(value: float, digits: int) -> str:
    """Format a number with fixed decimals and a true minus sign; zero has none."""
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def spread(wanted: Sequence[float], heights: Sequence[float]) -> Floats:
    """Place labels beside an axis so that they do not overlap and stay near their values.

    Args:
        wanted: where the middle of each label belongs, in parts of the axis.
        heights: of the labels, in parts of the axis.

    Returns:
        Their middles, nearest in least squares, in the order of ``wanted``; within the axis if it can hold them all.
    """
    values, sizes = np.asarray(wanted, dtype=float), np.asarray(heights, dtype=float)
    order = np.argsort(values, kind="stable")
    steps = np.concatenate([[0.0], np.cumsum(0.5 * (sizes[order][1:] + sizes[order][:-1]))])
    # minus the steps, places must not decrease: isotonic regression; clipping keeps the optimum
    free = scipy.optimize.isotonic_regression(values[order] - steps).x
    low, high = 0.5 * sizes[order[0]], 1.0 - 0.5 * sizes[order[-1]] - steps[-1]
    placed = np.empty_like(values)
    placed[order] = np.clip(free, low, max(low, high)) + steps
    return placed


class Picture(Figure):
    """A figure that a notebook shows even if the program never imports pyplot."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=_ON_SCREEN)
        return buffer.getvalue()


def stamp(figure: Figure, text: str) -> None:
    """Print the run's name and its number of trials in small type in the lower right corner."""
    # below the drawing area that a layout engine fills, in a strip of its own
    strip = 0.16 / float(figure.get_size_inches()[1])
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, strip, 1.0, 1.0 - strip))
    figure.text(0.995, 0.04 * strip, text, ha="right", va="bottom", fontsize=SMALL, color=FAINT)


_ANONYMOUS: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
"""Metadata fields of each format that hold time and software; they are left empty."""


def save(figure: Figure, path: Path) -> list[Path]:
    """Write a figure as PNG and SVG, without date or software in them, so that equal figures are equal files.

    Args:
        figure: the figure.
        path: where, without a suffix.

    Returns:
        The paths written.
    """
    return [save_bytes(path.with_name(f"{path.name}.{kind}"), data) for kind, data in encoded(figure).items()]


KINDS = ("png", "svg")
"""Formats that a figure is written in."""


def encoded(figure: Figure, kinds: Collection[str] = KINDS) -> dict[str, bytes]:
    """Encode a figure in several formats; the bytes by format."""
    return {kind: encode(figure, kind) for kind in kinds}


@journal()
def encode(figure: Figure, kind: str) -> bytes:
    """Encode a figure as png, svg or pdf, without date or software, so that equal figures are equal bytes."""
    if (engine := figure.get_layout_engine()) is not None:  # it would draw the figure once more for each format
        figure.set_dpi(_SETTINGS["savefig.dpi"])
        engine.execute(figure)
        figure.set_layout_engine(None)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, metadata=_ANONYMOUS[kind])
    return buffer.getvalue()


def save_picture(figure: Figure, path: Path) -> Path:
    """Write a figure to one file, in the format that its suffix names: png, svg or pdf.

    Raises:
        RunError: if the suffix is another, or the file cannot be written.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _ANONYMOUS:
        raise RunError(f"{path}: cannot be drawn: give a name that ends in .{', .'.join(_ANONYMOUS)}")
    return save_bytes(path, encode(figure, kind))


def save_bytes(path: Path, data: bytes) -> Path:
    """Write a picture, or another file that is made as a whole, into a folder that is made if it is not there.

    Raises:
        RunError: if it cannot be written.
    """
    with explained(path, of_run=False):
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, data)
    return path
