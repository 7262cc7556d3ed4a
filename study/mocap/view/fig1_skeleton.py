"""Figure 1: one natural pose with its markers, the bones, and how well each joint is known.

The paper shows a skeleton in the middle of a karate exercise. Here each joint has the ellipsoid that holds it 95 % of
the time, drawn larger by a factor that the figure states; a hinge's is a disc, and a line shows the axis along which
its place shows in nothing.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from study.figures import style
from study.mocap.io.recording import RecordingError
from study.mocap.skeleton.scene import Flag, Scene
from study.mocap.view import palette
from study.mocap.view.camera import Camera
from study.mocap.view.drawing import Drawing, Sizes
from study.mocap.view.ellipsoids import LEVEL, exaggeration, hinges
from study.sphere.types import Floats

Numbers = NDArray[np.intp]

_ELEVATION = 8.0
_TRIED = 60
"""Frames among which a pose is looked for, from as many directions as..."""
_AZIMUTHS = np.arange(0.0, 360.0, 15.0)
_HEIGHT = 4.9
"""Inches of the picture."""
_REACH = 0.06
"""From the skeleton to the words beside it, in parts of the picture's width."""
_LETTER = 0.058
"""Inches that a letter of these takes, on average."""


@dataclass(frozen=True, eq=False)
class Frame:
    """What the figure shows.

    Attributes:
        scene: the motion.
        frame: number of the pose, from 0.
        camera: from where it is seen.
        factor: by which ellipsoids are drawn larger.
        words: beside each joint.
    """

    scene: Scene
    frame: int
    camera: Camera
    factor: int
    words: tuple[str, ...]


def prepare(scene: Scene, frame: int | None = None, azimuth: float | None = None, factor: int | None = None) -> Frame:
    """Choose a pose and a side to see it from.

    Args:
        scene: the motion.
        frame: number of the pose, from 0; if None, one in which the joints are known and lie well apart.
        azimuth: direction to see it from, degrees from x to y; if None, the one from which they do.
        factor: of the ellipsoids; if None, one by which they are seen.

    Raises:
        RecordingError: if there is no such frame.
    """
    if frame is not None and not 0 <= frame < scene.frames:
        raise RecordingError(f"{scene.name}: no frame {frame}; there are 0 to {scene.frames - 1}")
    tried = _complete(scene) if frame is None else np.array([frame])
    azimuths = _AZIMUTHS if azimuth is None else np.array([azimuth])
    pose, camera = max(
        ((int(t), Camera(float(a), _ELEVATION)) for t in tried for a in azimuths),
        key=lambda pair: _apart(scene.points[:, :, pair[0]], pair[1]),
    )
    words = tuple(_words(scene, joint, pose) for joint in range(len(scene.joints)))
    return Frame(scene, pose, camera, exaggeration(scene) if factor is None else factor, words)


def _complete(scene: Scene) -> Numbers:
    """Some of the frames in which the most is known."""
    bad = (scene.flags != Flag.SEEN).sum(axis=0) + np.isnan(scene.places[:, 0]).sum(axis=0)
    best = np.flatnonzero(bad == bad.min())
    some: Numbers = best[np.unique(np.linspace(0, len(best) - 1, _TRIED).astype(int))]
    return some


def _apart(points: Floats, camera: Camera) -> float:
    """How far apart points are seen: the mean logarithm of their distances, so that none hides another."""
    seen = camera.see(points[~np.isnan(points[:, 0])])[:, :2]
    i, j = np.triu_indices(len(seen), 1)
    return float(np.log(np.linalg.norm(seen[i] - seen[j], axis=1) + 0.02).mean()) if len(seen) > 1 else 0.0


def _words(scene: Scene, joint: int, frame: int) -> str:
    """A joint's name and its largest standard error."""
    name = scene.joints[joint].replace("_", " ")
    errors = scene.errors[joint]
    known = errors[~np.isnan(errors)]
    words = f"{name} {1000 * known.max():.1f} mm" if len(known) else name
    return words + " (bridged)" * bool(scene.flags[joint, frame] == Flag.BRIDGED) + "*" * bool(scene.doubts[joint])


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw the pose."""
    scene = frame.scene
    figure = Figure(figsize=(style.PAGE, _HEIGHT))
    ax = figure.add_axes((0.0, 0.1, 1.0, 0.9))
    drawing = Drawing(ax, scene, frame.camera, Sizes(), frame.factor)
    drawing.show(frame.frame)
    shown = np.concatenate([scene.points[:, :, frame.frame], scene.places[:, :, frame.frame]])
    shown = np.concatenate([shown, np.column_stack([shown[:, :2], np.full(len(shown), drawing.ground)])])
    seen = frame.camera.see(shown[~np.isnan(shown[:, 0])])[:, :2]
    low, high = seen.min(axis=0), seen.max(axis=0)
    words = _REACH * style.PAGE + _LETTER * (max(map(len, frame.words)) + 1)
    width = max(
        1.08 * (high[1] - low[1]) * style.PAGE / (0.9 * _HEIGHT),
        (high[0] - low[0]) * style.PAGE / (style.PAGE - 2.0 * words),
    )
    height = width * 0.9 * _HEIGHT / style.PAGE
    middle = 0.5 * (low + high)
    ax.set_xlim(middle[0] - 0.5 * width, middle[0] + 0.5 * width)
    ax.set_ylim(middle[1] - 0.5 * height, middle[1] + 0.5 * height)
    _label(ax, frame, (float(low[0]), float(high[0])))
    _scale(ax)
    _explain(figure, frame)
    style.stamp(figure, f"{scene.name}, frame {frame.frame + 1:,} of {scene.frames:,}; {scene.source}")
    return figure


def _label(ax: Axes, frame: Frame, sides: tuple[float, float]) -> None:
    """Words in two columns beside the skeleton, each joined with its joint by a thin line."""
    seen = frame.camera.see(frame.scene.centers[:, :, frame.frame])[:, :2]
    there = np.flatnonzero(~np.isnan(seen[:, 0]))
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    reach = _REACH * (right - left)
    columns = _columns(seen[:, 0], frame.scene.sides(), there)
    for part, at, align in zip(columns, (sides[0] - reach, sides[1] + reach), ("right", "left"), strict=True):
        if not len(part):
            continue
        wanted = (seen[part, 1] - bottom) / (top - bottom)
        heights = bottom + (top - bottom) * style.spread(list(wanted), [0.042] * len(part))
        for joint, height in zip(part, heights, strict=True):
            elbow = at + (0.35 if align == "right" else -0.35) * reach
            x, y = seen[joint]
            ax.plot([at, elbow, x], [height, height, y], color=style.FAINT, linewidth=0.45, zorder=3.5)
            color = palette.FLAGGED if frame.words[joint].endswith(("*", ")")) else style.INK
            ax.text(at, height, f" {frame.words[joint]} ", ha=align, va="center", fontsize=style.SMALL, color=color)


def _columns(across: Floats, sides: tuple[str, ...], there: Numbers) -> tuple[Numbers, Numbers]:
    """Which joints are named on the left of the picture and which on the right.

    Those of one side of the body go to one side of the picture, so that lines to them cross no more than they must;
    those on neither go where there is more room.
    """
    means = {side: np.mean([across[i] for i in there if sides[i] == side] or [np.nan]) for side in ("left", "right")}
    first = "right" if means["right"] < means["left"] else "left"
    columns: tuple[list[int], list[int]] = ([], [])
    for i in sorted(there, key=lambda i: sides[i] == ""):
        fewer = int(len(columns[1]) < len(columns[0]))
        columns[fewer if sides[i] == "" else int(sides[i] != first)].append(int(i))
    return np.array(columns[0], dtype=int), np.array(columns[1], dtype=int)


def _scale(ax: Axes) -> None:
    """A bar of half a metre."""
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    x, y = left + 0.03 * (right - left), bottom + 0.03 * (top - bottom)
    ax.plot([x, x + 0.5], [y, y], color=style.INK, linewidth=1.2, solid_capstyle="butt")
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
    place = {"ha": "center", "va": "bottom", "zorder": 2.0}
    ax.text(x + 0.25, y + 0.012 * (top - bottom), "0.5 m", fontsize=style.SMALL, bbox=box, **place)  # type: ignore[arg-type]


def _explain(figure: Figure, frame: Frame) -> None:
    """What the marks mean, below the picture."""
    scene = frame.scene
    larger = f", {frame.factor} times as large" if frame.factor > 1 else ", in true size"
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=palette.SIDES[side], linewidth=3.0, solid_capstyle="round", label=words)
        for side, words in (("left", "left"), ("right", "right"))
    ]
    handles.append(Line2D([], [], color=palette.MARKER, marker="o", markersize=3.5, linestyle="none", label="marker"))
    if not np.isnan(scene.errors).all():
        words = f"{100 * LEVEL:.0f} % error ellipsoid of a joint{larger}"
        handles.append(Patch(facecolor=to_rgba(palette.ELLIPSOID, 0.3), edgecolor=palette.ELLIPSOID, label=words))
    if hinges(scene).any():
        handles.append(Line2D([], [], color=palette.ELLIPSOID, linewidth=1.0, label="axis of a hinge"))
    if any(scene.doubts):
        look = {"markerfacecolor": "white", "markeredgecolor": palette.FLAGGED, "markersize": 4.5, "linestyle": "none"}
        handles.append(Line2D([], [], marker="o", label="* not to be relied on", **look))  # type: ignore[arg-type]
    figure.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 0.055), ncols=len(handles), columnspacing=1.4,
        handlelength=1.4,
    )  # fmt: skip
    words = "Numbers: largest standard error of the joint's place in its segment, across the axis for a hinge."
    figure.text(0.5, 0.04, words, ha="center", va="bottom", fontsize=style.SMALL)
