"""Figure 1: the skeleton in one frame, with its markers, bones and joints, and the error ellipsoid of each joint.

The paper shows a skeleton during a karate exercise. Here each joint has its 95 % error ellipsoid, enlarged by a factor
that the figure states. That of a hinge is a disc, and a line shows its axis, along which the data do not place it.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from study.figures import style
from study.mocap.io.recording import RecordingError
from study.mocap.skeleton.scene import Flag, Scene
from study.mocap.view import palette
from study.mocap.view.camera import Camera
from study.mocap.view.drawing import DrawingSizes, SkeletonDrawing
from study.mocap.view.ellipsoids import LEVEL, exaggeration, hinges
from study.sphere.types import Floats, Ints

_ELEVATION = 8.0
_CANDIDATES = 60
"""Number of frames among which `prepare` chooses."""
_AZIMUTHS = np.arange(0.0, 360.0, 15.0)
"""Directions of view among which `prepare` chooses, degrees."""
_HEIGHT = 4.9
"""Height of the picture, inches."""
_REACH = 0.06
"""Distance from the skeleton to the labels beside it, in parts of the picture's width."""
_LETTER = 0.058
"""Mean width of a letter of the labels, inches."""


@dataclass(frozen=True, eq=False)
class SkeletonView:
    """One frame of a motion from one direction.

    Attributes:
        scene: the motion.
        frame: number of the frame, from 0.
        camera: the direction of view.
        factor: by which ellipsoids are drawn larger.
        labels: text beside each joint.
    """

    scene: Scene
    frame: int
    camera: Camera
    factor: int
    labels: tuple[str, ...]


def prepare(
    scene: Scene, frame: int | None = None, azimuth: float | None = None, factor: int | None = None
) -> SkeletonView:
    """Choose a frame and a direction of view.

    Args:
        scene: the motion.
        frame: number of the frame, from 0; if None, one in which all joints are known and appear well apart.
        azimuth: direction of view, degrees from x to y; if None, one from which they appear well apart.
        factor: by which ellipsoids are drawn larger; if None, one that makes them visible.

    Raises:
        RecordingError: if there is no such frame.
    """
    if frame is not None and not 0 <= frame < scene.frames:
        raise RecordingError(f"{scene.name}: no frame {frame}; there are 0 to {scene.frames - 1}")
    frames = _complete(scene) if frame is None else np.array([frame])
    azimuths = _AZIMUTHS if azimuth is None else np.array([azimuth])
    best, camera = max(
        ((int(t), Camera(float(a), _ELEVATION)) for t in frames for a in azimuths),
        key=lambda pair: _apart(scene.points[:, :, pair[0]], pair[1]),
    )
    labels = tuple(_label(scene, joint, best) for joint in range(len(scene.joints)))
    return SkeletonView(scene, best, camera, exaggeration(scene) if factor is None else factor, labels)


def _complete(scene: Scene) -> Ints:
    """Some of the frames with the fewest missing markers and bridged joints."""
    bad = (scene.flags != Flag.SEEN).sum(axis=0) + np.isnan(scene.places[:, 0]).sum(axis=0)
    best = np.flatnonzero(bad == bad.min())
    some: Ints = best[np.unique(np.linspace(0, len(best) - 1, _CANDIDATES).astype(int))]
    return some


def _apart(points: Floats, camera: Camera) -> float:
    """Mean logarithm of the distances between projected points; it is low if one hides another."""
    seen = camera.project(points[~np.isnan(points[:, 0])])[:, :2]
    i, j = np.triu_indices(len(seen), 1)
    return float(np.log(np.linalg.norm(seen[i] - seen[j], axis=1) + 0.02).mean()) if len(seen) > 1 else 0.0


def _label(scene: Scene, joint: int, frame: int) -> str:
    """Name of a joint and its largest standard error."""
    name = scene.joints[joint].replace("_", " ")
    errors = scene.errors[joint]
    known = errors[~np.isnan(errors)]
    text = f"{name} {1000 * known.max():.1f} mm" if len(known) else name
    return text + " (bridged)" * bool(scene.flags[joint, frame] == Flag.BRIDGED) + "*" * bool(scene.doubts[joint])


@style.journal()
def draw(view: SkeletonView) -> Figure:
    """Draw the skeleton with labels beside its joints."""
    scene = view.scene
    figure = Figure(figsize=(style.PAGE, _HEIGHT))
    ax = figure.add_axes((0.0, 0.1, 1.0, 0.9))
    drawing = SkeletonDrawing(ax, scene, view.camera, DrawingSizes(), view.factor)
    drawing.show(view.frame)
    shown = np.concatenate([scene.points[:, :, view.frame], scene.places[:, :, view.frame]])
    shown = np.concatenate([shown, np.column_stack([shown[:, :2], np.full(len(shown), drawing.ground)])])
    seen = view.camera.project(shown[~np.isnan(shown[:, 0])])[:, :2]
    low, high = seen.min(axis=0), seen.max(axis=0)
    margin = _REACH * style.PAGE + _LETTER * (max(map(len, view.labels)) + 1)
    width = max(
        1.08 * (high[1] - low[1]) * style.PAGE / (0.9 * _HEIGHT),
        (high[0] - low[0]) * style.PAGE / (style.PAGE - 2.0 * margin),
    )
    height = width * 0.9 * _HEIGHT / style.PAGE
    middle = 0.5 * (low + high)
    ax.set_xlim(middle[0] - 0.5 * width, middle[0] + 0.5 * width)
    ax.set_ylim(middle[1] - 0.5 * height, middle[1] + 0.5 * height)
    _draw_labels(ax, view, (float(low[0]), float(high[0])))
    _scale(ax)
    _draw_legend(figure, view)
    style.stamp(figure, f"{scene.name}, frame {view.frame + 1:,} of {scene.frames:,}; {scene.source}")
    return figure


def _draw_labels(ax: Axes, view: SkeletonView, sides: tuple[float, float]) -> None:
    """Draw labels in two columns beside the skeleton, each with a thin line to its joint."""
    seen = view.camera.project(view.scene.centers[:, :, view.frame])[:, :2]
    known = np.flatnonzero(~np.isnan(seen[:, 0]))
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    reach = _REACH * (right - left)
    columns = _columns(seen[:, 0], view.scene.sides(), known)
    for part, at, align in zip(columns, (sides[0] - reach, sides[1] + reach), ("right", "left"), strict=True):
        if not len(part):
            continue
        wanted = (seen[part, 1] - bottom) / (top - bottom)
        heights = bottom + (top - bottom) * style.spread(list(wanted), [0.042] * len(part))
        for joint, height in zip(part, heights, strict=True):
            elbow = at + (0.35 if align == "right" else -0.35) * reach
            x, y = seen[joint]
            ax.plot([at, elbow, x], [height, height, y], color=style.FAINT, linewidth=0.45, zorder=3.5)
            color = palette.FLAGGED if view.labels[joint].endswith(("*", ")")) else style.INK
            ax.text(at, height, f" {view.labels[joint]} ", ha=align, va="center", fontsize=style.SMALL, color=color)


def _columns(across: Floats, sides: tuple[str, ...], known: Ints) -> tuple[Ints, Ints]:
    """Joints with labels on the left of the picture, and those with labels on the right.

    The joints of one side of the body are on one side of the picture, so that few lines cross; the others are on the
    side with more room.
    """
    means = {side: np.mean([across[i] for i in known if sides[i] == side] or [np.nan]) for side in ("left", "right")}
    first = "right" if means["right"] < means["left"] else "left"
    columns: tuple[list[int], list[int]] = ([], [])
    for i in sorted(known, key=lambda i: sides[i] == ""):
        fewer = int(len(columns[1]) < len(columns[0]))
        columns[fewer if sides[i] == "" else int(sides[i] != first)].append(int(i))
    return np.array(columns[0], dtype=int), np.array(columns[1], dtype=int)


def _scale(ax: Axes) -> None:
    """Draw a scale bar of half a metre."""
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    x, y = left + 0.03 * (right - left), bottom + 0.03 * (top - bottom)
    ax.plot([x, x + 0.5], [y, y], color=style.INK, linewidth=1.2, solid_capstyle="butt")
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
    place = {"ha": "center", "va": "bottom", "zorder": 2.0}
    ax.text(x + 0.25, y + 0.012 * (top - bottom), "0.5 m", fontsize=style.SMALL, bbox=box, **place)  # type: ignore[arg-type]


def _draw_legend(figure: Figure, view: SkeletonView) -> None:
    """Draw the legend below the picture."""
    scene = view.scene
    larger = f", enlarged {view.factor} times" if view.factor > 1 else ", in true size"
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
        handles.append(Line2D([], [], marker="o", label="* not reliable", **look))  # type: ignore[arg-type]
    figure.legend(
        handles=handles,
        loc="lower center",
        bbox_to_anchor=(0.5, 0.055),
        ncols=len(handles),
        columnspacing=1.4,
        handlelength=1.4,
    )
    words = "Numbers: largest standard error of the joint in its segment; for a hinge across its axis."
    figure.text(0.5, 0.04, words, ha="center", va="bottom", fontsize=style.SMALL)
