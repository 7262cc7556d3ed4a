"""The scene: a moving skeleton as every picture shows it - figure, video and viewer.

It holds plain arrays in metres, z up, and nothing of the fits. `make_scene` makes it.
"""

from dataclasses import dataclass, replace

import numpy as np

from study.estimators.status import Worded
from study.mocap.io.recording import RecordingError
from study.mocap.skeleton.bones import side
from study.sphere.types import Bytes, Floats


class Flag(Worded):
    """Source of a joint's place in one frame."""

    SEEN = 0, "from markers"
    BRIDGED = 1, "bridged: too few markers seen"
    UNKNOWN = 2, "unknown"


@dataclass(frozen=True, eq=False)
class Scene:
    """A skeleton with its markers over time.

    Attributes:
        name: of the recording.
        source: origin of the joints, in words.
        rate: frames per second.
        markers: their labels.
        places: of the markers (markers, 3, frames), NaN where missing.
        joints: their names.
        centers: of the joints (joints, 3, frames), NaN where unknown.
        tips: names of the ends of limbs, which are no joints.
        ends: places of the tips (tips, 3, frames).
        bones: pairs of numbers of points: joints first, then tips.
        flags: `Flag` of each joint in each frame (joints, frames).
        doubts: reason to doubt each joint, or "".
        errors: standard errors of the joints along their principal directions (joints, 3), metres; NaN for a direction
            in which a joint is not known, such as the axis of a hinge.
        orientations: of the principal directions, as quaternions x, y, z, w (joints, frames, 4); NaN where unknown.
        notes: remarks for the viewer.
    """

    name: str
    source: str
    rate: float
    markers: tuple[str, ...]
    places: Floats
    joints: tuple[str, ...]
    centers: Floats
    tips: tuple[str, ...]
    ends: Floats
    bones: tuple[tuple[int, int], ...]
    flags: Bytes
    doubts: tuple[str, ...]
    errors: Floats
    orientations: Floats
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        frames = self.centers.shape[-1]
        count = len(self.joints)
        wanted = {
            "places": (len(self.markers), 3, frames),
            "centers": (count, 3, frames),
            "ends": (len(self.tips), 3, frames),
            "flags": (count, frames),
            "errors": (count, 3),
            "orientations": (count, frames, 4),
        }
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                raise RecordingError(
                    f"{self.name}: {name} of the scene have shape {getattr(self, name).shape}, not {shape}"
                )
        points = count + len(self.tips)
        lost = [bone for bone in self.bones if not (len(bone) == 2 and min(bone) >= 0 and max(bone) < points)]
        if lost or len(self.doubts) != count:
            doubts = f"{len(self.doubts)} doubts for {count} joints"
            words = f"bone {lost[0]} is not between two of {points} points" if lost else doubts
            raise RecordingError(f"{self.name}: {words}")

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.centers.shape[2])

    @property
    def points(self) -> Floats:
        """Joints, then tips (points, 3, frames)."""
        return np.concatenate([self.centers, self.ends])

    @property
    def floor(self) -> float:
        """Height of the floor, metres: just below the lowest markers, or the lowest points if there are no markers."""
        heights = self.places[:, 2] if len(self.markers) else self.points[:, 2]
        return float(np.nanquantile(np.fmin.reduce(heights, axis=0), 0.02)) - 0.02

    def at_most(self, rate: float) -> "Scene":
        """The scene with every second, third, ... frame, for at most this many frames per second."""
        step = max(int(np.ceil(self.rate / rate - 1e-9)), 1)
        return self if step == 1 else self.part(slice(None, None, step), self.rate / step)

    def part(self, frames: slice, rate: float | None = None) -> "Scene":
        """The scene in some of the frames; at ``rate`` frames per second, if that changes."""
        return replace(
            self,
            rate=rate or self.rate,
            places=self.places[:, :, frames],
            centers=self.centers[:, :, frames],
            ends=self.ends[:, :, frames],
            flags=self.flags[:, frames],
            orientations=self.orientations[:, frames],
        )

    def sides(self) -> tuple[str, ...]:
        """Side of each point: "left", "right" or ""."""
        return tuple(map(side, (*self.joints, *self.tips)))
