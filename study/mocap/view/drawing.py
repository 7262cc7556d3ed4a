"""Draw a skeleton with matplotlib; for the next frame its artists move."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from scipy.spatial.transform import Rotation

from study.mocap.skeleton.scene import Flag, Scene
from study.mocap.view import palette
from study.mocap.view.camera import Camera, outlines
from study.mocap.view.ellipsoids import exaggeration, half_axes, hinges
from study.sphere.types import Floats

_SQUARE = 0.5
"""Distance between the lines on the floor, metres."""
_ROD = 0.06
"""Distance from a hinge to either end of the line along its axis, metres."""


@dataclass(frozen=True)
class DrawingSizes:
    """Widths of lines and marks, in points."""

    bone: float = 2.8
    casing: float = 1.3
    """White margin of a bone where it passes in front of another."""
    joint: float = 3.6
    marker: float = 2.6


class SkeletonDrawing:
    """The artists of a skeleton, and their places in each frame."""

    def __init__(self, ax: Axes, scene: Scene, camera: Camera, sizes: DrawingSizes, factor: int | None = None) -> None:
        self.scene, self.camera, self.sizes = scene, camera, sizes
        self.factor = exaggeration(scene) if factor is None else factor
        self._points, self._sides = scene.points, scene.sides()
        self._half = self.factor * half_axes(scene)
        self._with_ellipsoid = [i for i, row in enumerate(self._half) if row.any()]
        self._hinges = hinges(scene)
        self._doubtful = np.array([bool(doubt) for doubt in scene.doubts])
        self.ground = scene.floor
        width = sizes.bone + 2.0 * sizes.casing
        self._floor = LineCollection([], colors=palette.FLOOR, linewidths=0.6, zorder=0)
        self._shadow = LineCollection([], colors=palette.SHADOW, linewidths=width, capstyle="round", zorder=1)
        (self._markers,) = ax.plot(
            [], [], "o", color=palette.MARKER, markersize=sizes.marker, markeredgewidth=0.0, zorder=4
        )
        self._bones = LineCollection([], capstyle="round", zorder=3)
        self._rods = LineCollection([], colors=palette.ELLIPSOID, linewidths=1.0, zorder=4)
        self._ellipsoids = PolyCollection(
            [], facecolors=to_rgba(palette.ELLIPSOID, 0.3), edgecolors=palette.ELLIPSOID, linewidths=0.7, zorder=5
        )
        for collection in (self._floor, self._shadow, self._bones, self._rods, self._ellipsoids):
            ax.add_collection(collection)
        self._joints = ax.scatter([], [], s=sizes.joint**2, linewidths=0.9, zorder=6)
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
            colors += ["white", palette.SIDES[ends.pop() if len(ends) == 1 else ""]]
            widths += [self.sizes.bone + 2.0 * self.sizes.casing, self.sizes.bone]
            styles += ["solid", (0.0, (0.8, 1.4)) if bridged else "solid"]
        self._bones.set_segments(lines)
        self._bones.set(color=colors, linewidths=widths, linestyles=styles or "solid")

    def _draw_joints(self, seen: Floats, frame: int) -> None:
        """Draw the joints, their ellipsoids, and the axes of hinges."""
        scene = self.scene
        count = len(scene.joints)
        flagged = self._doubtful | (scene.flags[:, frame] != Flag.SEEN)
        self._joints.set_offsets(seen[:count, :2])
        self._joints.set_facecolor(["white" if flag else palette.SIDES[""] for flag in flagged])
        self._joints.set_edgecolor([palette.FLAGGED if flag else "white" for flag in flagged])
        known = [i for i in self._with_ellipsoid if not np.isnan(scene.orientations[i, frame]).any()]
        rotations = Rotation.from_quat(scene.orientations[known, frame]).as_matrix() if known else np.empty((0, 3, 3))
        shapes = outlines(self._half[known], rotations, self.camera) if known else np.empty((0, 1, 2))
        self._ellipsoids.set_verts(list(shapes + seen[known, None, :2]))
        rods = [
            seen[i, :2] + np.array([[-_ROD], [_ROD]]) * (self.camera.axes[:2] @ rotation[:, 2])
            for i, rotation in zip(known, rotations, strict=True)
            if self._hinges[i]
        ]
        self._rods.set_segments(rods)


def _grid(middle: Floats, height: float, camera: Camera, squares: int = 5) -> Floats:
    """Lines of a grid that is fixed to the floor, projected (lines, 2, 2): squares about a point (2,)."""
    first = np.round(middle / _SQUARE) - squares // 2 - 0.5 * (squares % 2)
    marks = _SQUARE * (first[:, None] + np.arange(squares + 1))
    low, high = marks[:, 0], marks[:, -1]
    lines = [[[x, low[1], height], [x, high[1], height]] for x in marks[0]]
    lines += [[[low[0], y, height], [high[0], y, height]] for y in marks[1]]
    return camera.project(np.array(lines))[..., :2]
