"""Pictures of a skeleton with matplotlib: figure 1, one frame with its markers, bones and joints; and a video.

The view is a parallel projection: lengths across it keep their scale. A bone has the colour of its side of the body,
and doubtful joints have one of their own. For the next frame of a video the artists move; the ffmpeg of imageio-ffmpeg
encodes the pictures as MP4 with H.264, which browsers and players show.

The paper shows a skeleton during a karate exercise. Here each joint has its 95 % error ellipsoid, enlarged by a factor
that the figure states. That of a hinge is a disc, and a line shows its axis, along which the data do not place it.
"""

import importlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from study import style
from study.arrays import Bools, Bytes, Floats
from study.recordings.recording import RecordingError, written
from study.recordings.skeleton.draw import Flag
from study.recordings.skeleton.scene import Scene, known_mean


@dataclass(frozen=True)
class Camera:
    """The direction of view, z up: ``azimuth`` from x to y and ``elevation`` above the horizon, degrees."""

    azimuth: float = 30.0
    elevation: float = 10.0

    @property
    def axes(self) -> Floats:
        """Directions to the right, up, and towards the viewer, as rows (3, 3)."""
        a, e = np.radians([self.azimuth, self.elevation])
        up = [-np.cos(a) * np.sin(e), -np.sin(a) * np.sin(e), np.cos(e)]
        towards = [np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)]
        return np.array([[-np.sin(a), np.cos(a), 0.0], up, towards])

    def project(self, x: Floats) -> Floats:
        """Coordinates of points (…, 3) to the right, up and towards the viewer (…, 3), metres."""
        return x @ self.axes.T


def outlines(half: Floats, directions: Floats, camera: Camera, corners: int = 48) -> Floats:
    """Outlines of ellipsoids about zero (ellipsoids, corners, 2), metres right and up.

    The parallel projection P of an ellipsoid {M u : |u| ≤ 1} is {P M u}, the ellipse of the matrix P M Mᵀ Pᵀ.

    Args:
        half: lengths of the half axes (ellipsoids, 3); one of zero gives a disc.
        directions: of these axes, as columns (ellipsoids, 3, 3).
        camera: the direction of view.
        corners: of the polygons.
    """
    matrix = camera.axes[:2] @ (directions * half[:, None])
    values, vectors = np.linalg.eigh(matrix @ matrix.transpose(0, 2, 1))
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    ellipse: Floats = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None]) @ circle
    return ellipse.transpose(0, 2, 1)


LEVEL = 0.95
"""Probability that an ellipsoid contains its joint, if the standard errors are right."""
_FACTORS = (1, 2, 3, 5, 10, 20, 30, 50, 100)
_SIZE, _LONGEST = 0.045, 0.4
"""Largest half axis, as drawn, of the median ellipsoid, and of the longest; metres."""


def surface(known: int) -> float:
    """Distance from centre to surface in standard errors, for a joint that is known in this many directions."""
    return float(np.sqrt(chdtri(known, 1.0 - LEVEL))) if known else 0.0


def half_axes(scene: Scene) -> Floats:
    """Half axes of the ellipsoids (joints, 3), metres; zero in a direction without a standard error."""
    known = ~np.isnan(scene.errors)
    factors = np.array([surface(int(row.sum())) for row in known])
    return np.asarray(np.where(known, scene.errors, 0.0) * factors[:, None])


def exaggeration(scene: Scene) -> int:
    """The factor by which ellipsoids are drawn larger, so that they are visible."""
    longest = half_axes(scene).max(axis=1)
    longest = longest[longest > 0.0]
    if not len(longest):
        return 1
    most = min(_SIZE / np.median(longest), _LONGEST / longest.max())
    return max([factor for factor in _FACTORS if factor <= most], default=1)


def hinges(scene: Scene) -> Bools:
    """True for joints that are known across an axis, but not along it (joints,)."""
    return np.isnan(scene.errors[:, 2]) & ~np.isnan(scene.errors[:, 0])


SIDES = {"left": "#0072b2", "right": "#c2580a", "": "#4a4a4a"}
"""Bones of the left side, of the right side, and between them."""
MARKER = "#7d8a94"
ELLIPSOID = "#009e73"
FLAGGED = "#c2187e"
"""A joint that is not reliable, in all frames or in this one."""
FLOOR = "#dde2e6"
SHADOW = "#e9ecee"
GHOST = "#7a5fb5"
"""A second motion beside or over the first one."""

_SQUARE = 0.5
"""Distance between the lines on the floor, metres."""
_ROD = 0.06
"""Distance from a hinge to either end of the line along its axis, metres."""


IN_PRINT = {"bone": 2.8, "casing": 1.3, "joint": 3.6, "marker": 2.6}
"""Widths of bones, of the white margin of a bone that passes in front of another, of joints and markers, in points."""


class SkeletonDrawing:
    """The artists of a skeleton, and their places in each frame."""

    def __init__(self, ax: Axes, scene: Scene, camera: Camera, sizes: dict[str, float]) -> None:
        self.scene, self.camera, self.sizes = scene, camera, sizes
        self.factor = exaggeration(scene)
        self._points, self._sides = scene.points, scene.sides()
        self._half = self.factor * half_axes(scene)
        self._with_ellipsoid = [i for i, row in enumerate(self._half) if row.any()]
        self._hinges = hinges(scene)
        self._doubtful = np.array([bool(doubt) for doubt in scene.doubts])
        self.ground = scene.floor
        width = sizes["bone"] + 2.0 * sizes["casing"]
        self._floor = LineCollection([], colors=FLOOR, linewidths=0.6, zorder=0)
        self._shadow = LineCollection([], colors=SHADOW, linewidths=width, capstyle="round", zorder=1)
        (self._markers,) = ax.plot([], [], "o", color=MARKER, markersize=sizes["marker"], markeredgewidth=0.0, zorder=4)
        self._bones = LineCollection([], capstyle="round", zorder=3)
        self._rods = LineCollection([], colors=ELLIPSOID, linewidths=1.0, zorder=4)
        face = to_rgba(ELLIPSOID, 0.3)
        self._ellipsoids = PolyCollection([], facecolors=face, edgecolors=ELLIPSOID, linewidths=0.7, zorder=5)
        for collection in (self._floor, self._shadow, self._bones, self._rods, self._ellipsoids):
            ax.add_collection(collection)
        self._joints = ax.scatter([], [], s=sizes["joint"] ** 2, linewidths=0.9, zorder=6)
        ax.set_aspect("equal")
        ax.set_axis_off()

    def show(self, frame: int, around: Floats | None = None) -> None:
        """Show a frame.

        Args:
            frame: number of the frame, from 0.
            around: centre of the lines on the floor (2,); the skeleton's middle if None.
        """
        scene, camera = self.scene, self.camera
        x = self._points[:, :, frame]
        seen = camera.project(x)
        flat = x.copy()
        flat[:, 2] = self.ground
        below = camera.project(flat)[:, :2]
        known = [bone for bone in scene.bones if not np.isnan(x[list(bone), 0]).any()]
        known.sort(key=lambda bone: float(seen[list(bone), 2].sum()))  # the farthest first
        self._shadow.set_segments([below[list(bone)] for bone in known])
        self._draw_bones(known, seen, frame)
        self._markers.set_data(*camera.project(scene.places[:, :, frame])[:, :2].T)
        self._draw_joints(seen, frame)
        middle = np.nanmean(x[:, :2], axis=0) if len(known) else np.zeros(2)
        self._floor.set_segments(list(_grid(middle if around is None else around, self.ground, camera)))

    def _draw_bones(self, bones: list[tuple[int, int]], seen: Floats, frame: int) -> None:
        """Draw each bone on a wider white one, so that the nearer of two crossing bones is visible."""
        lines, colors, widths, styles = [], [], [], []
        for bone in bones:
            lines += [seen[list(bone), :2]] * 2
            ends = {self._sides[i] for i in bone} - {""}
            bridged = any(i < len(self.scene.joints) and self.scene.flags[i, frame] != Flag.SEEN for i in bone)
            colors += ["white", SIDES[ends.pop() if len(ends) == 1 else ""]]
            widths += [self.sizes["bone"] + 2.0 * self.sizes["casing"], self.sizes["bone"]]
            styles += ["solid", (0.0, (0.8, 1.4)) if bridged else "solid"]
        self._bones.set_segments(lines)
        self._bones.set(color=colors, linewidths=widths, linestyles=styles or "solid")

    def _draw_joints(self, seen: Floats, frame: int) -> None:
        """Draw the joints, their ellipsoids, and the axes of hinges."""
        scene = self.scene
        count = len(scene.joints)
        flagged = self._doubtful | (scene.flags[:, frame] != Flag.SEEN)
        self._joints.set_offsets(seen[:count, :2])
        self._joints.set_facecolor(["white" if flag else SIDES[""] for flag in flagged])
        self._joints.set_edgecolor([FLAGGED if flag else "white" for flag in flagged])
        known = [i for i in self._with_ellipsoid if not np.isnan(scene.orientations[i, frame]).any()]
        rotations = Rotation.from_quat(scene.orientations[known, frame]).as_matrix() if known else np.empty((0, 3, 3))
        shapes = outlines(self._half[known], rotations, self.camera) if known else np.empty((0, 1, 2))
        self._ellipsoids.set_verts(list(shapes + seen[known, None, :2]))
        across, ends = self.camera.axes[:2], np.array([[-_ROD], [_ROD]])
        rods = zip(known, rotations, strict=True)
        self._rods.set_segments([seen[i, :2] + ends * (across @ r[:, 2]) for i, r in rods if self._hinges[i]])


def _grid(middle: Floats, height: float, camera: Camera, squares: int = 5) -> Floats:
    """Lines of a grid that is fixed to the floor, projected (lines, 2, 2): squares about a point (2,)."""
    first = np.round(middle / _SQUARE) - squares // 2 - 0.5 * (squares % 2)
    marks = _SQUARE * (first[:, None] + np.arange(squares + 1))
    low, high = marks[:, 0], marks[:, -1]
    lines = [[[x, low[1], height], [x, high[1], height]] for x in marks[0]]
    lines += [[[low[0], y, height], [high[0], y, height]] for y in marks[1]]
    return camera.project(np.array(lines))[..., :2]


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


def prepare(scene: Scene, frame: int | None = None) -> tuple[int, Camera]:
    """Choose a frame, and a direction of view from which the joints appear well apart.

    Args:
        scene: the motion.
        frame: number of the frame, from 0; if None, one in which all joints are known and appear well apart.

    Raises:
        RecordingError: if there is no such frame.
    """
    if frame is not None and not 0 <= frame < scene.frames:
        raise RecordingError(f"{scene.name}: no frame {frame}; there are 0 to {scene.frames - 1}")
    # some of the frames with the fewest missing markers and bridged joints
    bad = (scene.flags != Flag.SEEN).sum(axis=0) + np.isnan(scene.places[:, 0]).sum(axis=0)
    best = np.flatnonzero(bad == bad.min())
    best = best[np.unique(np.linspace(0, len(best) - 1, _CANDIDATES).astype(int))]

    def apart(view: tuple[int, Camera]) -> float:
        """Mean logarithm of the distances between projected points; it is low if one hides another."""
        x = scene.points[:, :, view[0]]
        seen = view[1].project(x[~np.isnan(x[:, 0])])[:, :2]
        i, j = np.triu_indices(len(seen), 1)
        return float(np.log(np.linalg.norm(seen[i] - seen[j], axis=1) + 0.02).mean()) if len(seen) > 1 else 0.0

    views = [Camera(float(azimuth), _ELEVATION) for azimuth in _AZIMUTHS]
    return max(((int(t), view) for t in (best if frame is None else [frame]) for view in views), key=apart)


def label(scene: Scene, joint: int, frame: int) -> str:
    """Name of a joint and its largest standard error."""
    name = scene.joints[joint].replace("_", " ")
    error = np.fmax.reduce(scene.errors[joint])
    text = name if np.isnan(error) else f"{name} {1000 * error:.1f} mm"
    return text + " (bridged)" * bool(scene.flags[joint, frame] == Flag.BRIDGED) + "*" * bool(scene.doubts[joint])


@style.journal()
def draw(scene: Scene, frame: int | None = None) -> Figure:
    """Draw the skeleton in a frame, with labels beside its joints.

    Args:
        scene: the motion.
        frame: number of the frame; if None, one that `prepare` chooses.

    Raises:
        RecordingError: if there is no such frame.
    """
    frame, camera = prepare(scene, frame)
    labels = [label(scene, joint, frame) for joint in range(len(scene.joints))]
    figure = Figure(figsize=(style.PAGE, _HEIGHT))
    ax = figure.add_axes((0.0, 0.1, 1.0, 0.9))
    drawing = SkeletonDrawing(ax, scene, camera, IN_PRINT)
    drawing.show(frame)
    shown = np.concatenate([scene.points[:, :, frame], scene.places[:, :, frame]])
    shown = np.concatenate([shown, np.column_stack([shown[:, :2], np.full(len(shown), drawing.ground)])])
    seen = camera.project(shown[~np.isnan(shown[:, 0])])[:, :2]
    low, high = seen.min(axis=0), seen.max(axis=0)
    margin = _REACH * style.PAGE + _LETTER * (max(map(len, labels)) + 1)
    across = (high[0] - low[0]) * style.PAGE / (style.PAGE - 2.0 * margin)
    width = max(1.08 * (high[1] - low[1]) * style.PAGE / (0.9 * _HEIGHT), across)
    height = width * 0.9 * _HEIGHT / style.PAGE
    middle = 0.5 * (low + high)
    ax.set_xlim(middle[0] - 0.5 * width, middle[0] + 0.5 * width)
    ax.set_ylim(middle[1] - 0.5 * height, middle[1] + 0.5 * height)
    seen = camera.project(scene.centers[:, :, frame])[:, :2]
    _draw_labels(ax, seen, labels, scene.sides(), (float(low[0]), float(high[0])))
    _scale(ax)
    _draw_legend(figure, scene, drawing.factor)
    style.stamp(figure, f"{scene.name}, frame {frame + 1:,} of {scene.frames:,}; {scene.source}")
    return figure


def _draw_labels(
    ax: Axes, seen: Floats, labels: Sequence[str], sides: Sequence[str], ends: tuple[float, float]
) -> None:
    """Draw labels in two columns beside the skeleton, each with a thin line to its joint (joints, 2).

    The joints of one side of the body are on one side of the picture, so that few lines cross; the others are on the
    side with more room.
    """
    known = np.flatnonzero(~np.isnan(seen[:, 0])).tolist()
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    reach = _REACH * (right - left)
    means = {side: np.mean([seen[i, 0] for i in known if sides[i] == side] or [np.nan]) for side in ("left", "right")}
    first = "right" if means["right"] < means["left"] else "left"
    columns: tuple[list[int], list[int]] = ([], [])
    for i in sorted(known, key=lambda i: sides[i] == ""):
        fewer = int(len(columns[1]) < len(columns[0]))
        columns[fewer if sides[i] == "" else int(sides[i] != first)].append(i)
    for part, at, align in zip(columns, (ends[0] - reach, ends[1] + reach), ("right", "left"), strict=True):
        if not part:
            continue
        wanted = (seen[part, 1] - bottom) / (top - bottom)
        heights = bottom + (top - bottom) * style.spread(list(wanted), [0.042] * len(part))
        for joint, height in zip(part, heights, strict=True):
            elbow = at + (0.35 if align == "right" else -0.35) * reach
            x, y = seen[joint]
            ax.plot([at, elbow, x], [height, height, y], color=style.FAINT, linewidth=0.45, zorder=3.5)
            color = FLAGGED if labels[joint].endswith(("*", ")")) else style.INK
            ax.text(at, height, f" {labels[joint]} ", ha=align, va="center", fontsize=style.SMALL, color=color)


def _scale(ax: Axes) -> None:
    """Draw a scale bar of half a metre."""
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    x, y = left + 0.03 * (right - left), bottom + 0.03 * (top - bottom)
    ax.plot([x, x + 0.5], [y, y], color=style.INK, linewidth=1.2, solid_capstyle="butt")
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
    place = {"ha": "center", "va": "bottom", "zorder": 2.0}
    ax.text(x + 0.25, y + 0.012 * (top - bottom), "0.5 m", fontsize=style.SMALL, bbox=box, **place)  # type: ignore[arg-type]


def _draw_legend(figure: Figure, scene: Scene, factor: int) -> None:
    """Draw the legend below the picture."""
    doubted = {"markerfacecolor": "white", "markeredgecolor": FLAGGED, "markersize": 4.5, "linestyle": "none"}
    words = f"{100 * LEVEL:.0f} % error ellipsoid of a joint, {_enlarged(factor)}"
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=SIDES[side], linewidth=3.0, solid_capstyle="round", label=side)
        for side in ("left", "right")
    ]
    handles.append(Line2D([], [], color=MARKER, marker="o", markersize=3.5, linestyle="none", label="marker"))
    if not np.isnan(scene.errors).all():
        handles.append(Patch(facecolor=to_rgba(ELLIPSOID, 0.3), edgecolor=ELLIPSOID, label=words))
    if hinges(scene).any():
        handles.append(Line2D([], [], color=ELLIPSOID, linewidth=1.0, label="axis of a hinge"))
    if any(scene.doubts):
        handles.append(Line2D([], [], marker="o", label="* not reliable", **doubted))  # type: ignore[arg-type]
    place = {"bbox_to_anchor": (0.5, 0.055), "ncols": len(handles), "columnspacing": 1.4, "handlelength": 1.4}
    figure.legend(handles=handles, loc="lower center", **place)
    words = "Numbers: largest standard error of the joint in its segment; for a hinge across its axis."
    figure.text(0.5, 0.04, words, ha="center", va="bottom", fontsize=style.SMALL)


def _enlarged(factor: int) -> str:
    return f"enlarged {factor} times" if factor > 1 else "in true size"


_PIXELS = 960, 720
_DPI = 120
_RATE = 30.0
"""Largest number of frames per second."""
_ON_SCREEN = {"bone": 4.0, "casing": 1.5, "joint": 5.0, "marker": 3.2}
_SMOOTHING = 1.5
"""Duration over which the centre of the view is averaged, seconds."""
_QUALITY = "23"
"""Constant rate factor of x264: a lower one gives better pictures and a larger file."""


def write_video(scene: Scene, path: str | Path, advance: Callable[[float], None] = lambda _: None) -> Path:
    """Write a motion as MP4, at its own speed; the view follows the skeleton.

    Args:
        scene: the motion; of one with more than 30 frames per second every second, third, ... frame is kept.
        path: of the video; the folder is made if there is none.
        advance: callback for progress; its argument is the share of the work since the last call.

    Returns:
        The path.

    Raises:
        RecordingError: if imageio-ffmpeg is not installed, or the video cannot be written.
    """
    path, module = Path(path), encoder()
    if path.suffix.lower() != ".mp4":
        raise RecordingError(f"{path}: a video is written to a file whose name ends in .mp4")
    scene = scene.at_most(_RATE)
    output = ["-crf", _QUALITY, "-preset", "medium", "-movflags", "+faststart", "-tune", "animation"]
    options = {"codec": "libx264", "quality": None, "macro_block_size": 1, "output_params": output}

    def fill(temporary: Path) -> None:
        writer = module.write_frames(str(temporary), _PIXELS, pix_fmt_in="rgba", fps=scene.rate, **options)
        writer.send(None)
        try:
            for picture in _film(scene):
                writer.send(picture)
                advance(1.0 / scene.frames)
        finally:
            writer.close()

    return written(path, fill)


def encoder() -> ModuleType:
    """The module imageio_ffmpeg, which brings ffmpeg.

    Raises:
        RecordingError: if it is not installed.
    """
    try:
        return importlib.import_module("imageio_ffmpeg")
    except ModuleNotFoundError:
        raise RecordingError("a video needs imageio-ffmpeg: pip install '.[mocap]'") from None


def _film(scene: Scene) -> Iterator[Bytes]:
    """Draw the frames one after the other: pixels (height, width, 4), red, green, blue, opacity."""
    with style.journal():
        figure = Figure(figsize=(_PIXELS[0] / _DPI, _PIXELS[1] / _DPI), dpi=_DPI)
        canvas, ax = FigureCanvasAgg(figure), figure.add_axes((0.0, 0.0, 1.0, 1.0))
        drawing, middle = SkeletonDrawing(ax, scene, Camera(30.0, 12.0), _ON_SCREEN), _smooth_middle(scene)
        left, bottom, width, height = _box(drawing, middle)

        def text(x: float, y: float, words: str, size: float = style.SMALL) -> Text:
            """Text in the upper left or right corner, at a place in parts of the figure."""
            side, place = "left" if x < 0.5 else "right", figure.transFigure
            return ax.text(x, y, words, fontsize=size, transform=place, ha=side, va="top", linespacing=1.5)

        def drawn() -> Bytes:
            canvas.draw()  # type: ignore[no-untyped-call]
            return np.array(canvas.buffer_rgba())  # type: ignore[no-untyped-call]

        same = text(0.02, 0.975, scene.name, 10.0), text(0.02, 0.935, _film_legend(drawing))
        fixed = drawn()  # once, because drawing text takes longer than all the rest
        for part in same:
            part.remove()
        time, unseen = text(0.98, 0.975, "", 10.0), text(0.98, 0.935, "")
        unseen.set_color(FLAGGED)
        for frame, flags in enumerate(scene.flags.T):
            drawing.show(frame, middle[:2, frame])
            right, up = drawing.camera.project(middle[:, frame])[:2]
            ax.set_xlim(right + left, right + left + width)
            ax.set_ylim(up + bottom, up + bottom + height)
            time.set_text(f"{frame / scene.rate:.1f} s")
            names = zip(scene.joints, map(Flag, flags), strict=True)
            lines = [f"{joint.replace('_', ' ')} {flag.name.lower()}" for joint, flag in names if flag != Flag.SEEN]
            unseen.set_text("\n".join(lines))
            yield np.minimum(drawn(), fixed)


def _box(drawing: SkeletonDrawing, middle: Floats) -> tuple[float, float, float, float]:
    """Left, bottom, width and height of the view about the middle, metres; nearly all frames fit into it."""
    camera = drawing.camera
    projected = np.einsum("ij,pjt->pit", camera.axes[:2], drawing.scene.points - middle)
    lowest = np.array([*middle[:2].mean(axis=1), drawing.ground])
    floor = float(camera.project(lowest - middle.mean(axis=1))[1])
    low = np.nanquantile(np.fmin.reduce(projected, axis=0), 0.002, axis=1)
    high = np.nanquantile(np.fmax.reduce(projected, axis=0), 0.998, axis=1)
    bottom, top = min(float(low[1]), floor) - 0.15, float(high[1]) + 0.25
    width = max(float(high[0] - low[0]) + 0.2, (top - bottom) * _PIXELS[0] / _PIXELS[1])
    return 0.5 * float(low[0] + high[0]) - 0.5 * width, bottom, width, width * _PIXELS[1] / _PIXELS[0]


def _film_legend(drawing: SkeletonDrawing) -> str:
    """The meaning of the colours, and the joints that are not reliable."""
    scene, lines = drawing.scene, ["blue: left, orange: right"]
    if not np.isnan(scene.errors).all():
        axes = "; axes of hinges" if hinges(scene).any() else ""
        lines.append(f"green: {100 * LEVEL:.0f} % error ellipsoids, {_enlarged(drawing.factor)}{axes}")
    doubts = zip(scene.joints, scene.doubts, strict=True)
    return "\n".join([*lines, *(f"not reliable: {joint.replace('_', ' ')}" for joint, doubt in doubts if doubt)])


def _smooth_middle(scene: Scene) -> Floats:
    """The smoothed middle of the skeleton (3, frames), metres."""
    middle = known_mean(scene.centers, axis=0)
    times = np.arange(scene.frames)
    present = np.flatnonzero(~np.isnan(middle[0]))
    filled = np.stack([np.interp(times, present, row[present]) for row in middle])
    course: Floats = uniform_filter1d(filled, max(int(_SMOOTHING * scene.rate), 1), axis=1, mode="nearest")
    course[2] = course[2].mean()
    return course
