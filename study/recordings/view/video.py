"""Write a motion as a video: MP4 with H.264, which browsers and players show.

matplotlib draws the pictures; the ffmpeg of imageio-ffmpeg encodes them.
"""

import contextlib
import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from scipy.ndimage import uniform_filter1d

from study import style
from study.arrays import Bytes, Floats
from study.recordings.recording import RecordingError
from study.recordings.skeleton.draw import Flag
from study.recordings.skeleton.scene import Scene
from study.recordings.view import figure
from study.recordings.view.figure import LEVEL, Camera, DrawingSizes, SkeletonDrawing, hinges

_PIXELS = 960, 720
_DPI = 120
_SIZES = DrawingSizes(bone=4.0, casing=1.5, joint=5.0, marker=3.2)
_SMOOTHING = 1.5
"""Duration over which the centre of the view is averaged, seconds."""
_QUALITY = "23"
"""Constant rate factor of x264: a lower one gives better pictures and a larger file."""


def write_video(
    scene: Scene,
    path: str | Path,
    *,
    camera: Camera | None = None,
    rate: float = 30.0,
    factor: int | None = None,
    advance: Callable[[float], None] = lambda _: None,
) -> Path:
    """Write a motion as MP4; the view follows the skeleton.

    Args:
        scene: the motion; it plays at its own speed.
        path: of the video; the folder is made if there is none.
        camera: the direction of view.
        rate: largest number of frames per second; a faster motion keeps every second, third, ... frame.
        factor: by which ellipsoids are drawn larger; if None, one that makes them visible.
        advance: callback for progress; its argument is the share of the work since the last call.

    Returns:
        The path.

    Raises:
        RecordingError: if imageio-ffmpeg is not installed, or the video cannot be written.
    """
    path = Path(path)
    imageio_ffmpeg = encoder()
    if path.suffix.lower() != ".mp4":
        raise RecordingError(f"{path}: a video is written to a file whose name ends in .mp4")
    film = _Film(scene.at_most(rate), camera or Camera(30.0, 12.0), factor)
    partial = path.with_name(f".{path.stem}.partial.mp4")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        writer = imageio_ffmpeg.write_frames(
            str(partial),
            _PIXELS,
            pix_fmt_in="rgba",
            fps=film.scene.rate,
            codec="libx264",
            quality=None,
            macro_block_size=1,
            output_params=["-crf", _QUALITY, "-preset", "medium", "-movflags", "+faststart", "-tune", "animation"],
        )
        writer.send(None)
        try:
            for frame in range(film.scene.frames):
                writer.send(film.picture(frame))
                advance(1.0 / film.scene.frames)
        finally:
            writer.close()
        partial.replace(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
    return path


def encoder() -> ModuleType:
    """The module imageio_ffmpeg, which brings ffmpeg.

    Raises:
        RecordingError: if it is not installed.
    """
    try:
        return importlib.import_module("imageio_ffmpeg")
    except ModuleNotFoundError:
        raise RecordingError("a video needs imageio-ffmpeg: pip install '.[mocap]'") from None


class _Film:
    """A matplotlib figure that shows one frame after the other."""

    @style.journal()
    def __init__(self, scene: Scene, camera: Camera, factor: int | None) -> None:
        self.scene, self.camera = scene, camera
        self.figure = Figure(figsize=(_PIXELS[0] / _DPI, _PIXELS[1] / _DPI), dpi=_DPI)
        self.canvas = FigureCanvasAgg(self.figure)
        self.ax = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.drawing = SkeletonDrawing(self.ax, scene, camera, _SIZES, factor)
        self.middle = _smooth_middle(scene)
        self.box = self._box()
        name = self._text(0.02, 0.975, scene.name, fontsize=10.0)
        legend = self._text(0.02, 0.935, self._legend())
        self.fixed = self._drawn()  # once, because drawing text takes longer than all the rest
        name.remove()
        legend.remove()
        self.time = self._text(0.98, 0.975, "", fontsize=10.0)
        self.flags = self._text(0.98, 0.935, "")
        self.flags.set_color(figure.FLAGGED)

    def _text(self, x: float, y: float, text: str, fontsize: float = style.SMALL) -> Text:
        """Text in the upper left or right corner; ``x`` and ``y`` in parts of the figure."""
        side = "left" if x < 0.5 else "right"
        place = self.figure.transFigure
        return self.ax.text(x, y, text, fontsize=fontsize, transform=place, ha=side, va="top", linespacing=1.5)

    def picture(self, frame: int) -> Bytes:
        """Pixels of a frame (height, width, 4): red, green, blue, opacity."""
        middle = self.middle[:, frame]
        self.drawing.show(frame, middle[:2])
        right, up = self.camera.project(middle)[:2]
        left, bottom, width, height = self.box
        self.ax.set_xlim(right + left, right + left + width)
        self.ax.set_ylim(up + bottom, up + bottom + height)
        self.time.set_text(f"{frame / self.scene.rate:.1f} s")
        names = {flag.value: flag.name.lower() for flag in Flag}
        flags = zip(self.scene.joints, self.scene.flags[:, frame], strict=True)
        lines = [f"{joint.replace('_', ' ')} {names[flag]}" for joint, flag in flags if flag != Flag.SEEN]
        self.flags.set_text("\n".join(lines))
        return np.minimum(self._drawn(), self.fixed)

    def _drawn(self) -> Bytes:
        self.canvas.draw()  # type: ignore[no-untyped-call]
        return np.array(self.canvas.buffer_rgba())  # type: ignore[no-untyped-call]

    def _box(self) -> tuple[float, float, float, float]:
        """Left, bottom, width and height of the view about the middle, metres; nearly all frames fit into it."""
        projected = np.einsum("ij,pjt->pit", self.camera.axes[:2], self.scene.points - self.middle)
        lowest = np.array([*self.middle[:2].mean(axis=1), self.drawing.ground])
        floor = float(self.camera.project(lowest - self.middle.mean(axis=1))[1])
        low = np.nanquantile(np.fmin.reduce(projected, axis=0), 0.002, axis=1)
        high = np.nanquantile(np.fmax.reduce(projected, axis=0), 0.998, axis=1)
        bottom, top = min(float(low[1]), floor) - 0.15, float(high[1]) + 0.25
        width = max(float(high[0] - low[0]) + 0.2, (top - bottom) * _PIXELS[0] / _PIXELS[1])
        height = width * _PIXELS[1] / _PIXELS[0]
        return 0.5 * float(low[0] + high[0]) - 0.5 * width, bottom, width, height

    def _legend(self) -> str:
        """The meaning of the colours, and the joints that are not reliable."""
        lines = ["blue: left, orange: right"]
        if not np.isnan(self.scene.errors).all():
            larger = f"enlarged {self.drawing.factor} times" if self.drawing.factor > 1 else "in true size"
            axes = "; axes of hinges" if hinges(self.scene).any() else ""
            lines.append(f"green: {100 * LEVEL:.0f} % error ellipsoids, {larger}{axes}")
        for joint, doubt in zip(self.scene.joints, self.scene.doubts, strict=True):
            if doubt:
                lines.append(f"not reliable: {joint.replace('_', ' ')}")
        return "\n".join(lines)


def _smooth_middle(scene: Scene) -> Floats:
    """The smoothed middle of the skeleton (3, frames), metres."""
    with np.errstate(invalid="ignore"):
        known = ~np.isnan(scene.centers[:, 0])
        middle = np.where(known[:, None], scene.centers, 0.0).sum(axis=0) / known.sum(axis=0)
    times = np.arange(scene.frames)
    present = np.flatnonzero(~np.isnan(middle[0]))
    filled = np.stack([np.interp(times, present, row[present]) for row in middle])
    course: Floats = uniform_filter1d(filled, max(int(_SMOOTHING * scene.rate), 1), axis=1, mode="nearest")
    course[2] = course[2].mean()
    return course
