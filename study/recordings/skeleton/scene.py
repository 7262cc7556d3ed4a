"""The scene: a moving skeleton as every picture shows it - figure, video and viewer.

It holds plain arrays in metres, z up, and nothing of the fits. `make_scene` makes it.

Bones are the lines between joints and ends of limbs that are fixed in one segment. Files do not say which way is up,
but a body's parts are above one another: the rotation that makes z point up follows from that.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from study.arrays import Bytes, Floats
from study.fits.samples import Worded
from study.recordings.recording import Recording, RecordingError


def bones(fixed: Sequence[Sequence[int]], points: Floats, sides: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Choose the lines that show segments as bones.

    Two points in one segment make a bone and three a triangle, as in a pelvis. Of four or more, as in a chest, one is
    linked with all others: the one nearest to them, of those on neither side of the body if there are any.

    Args:
        fixed: for each segment, the numbers of the joints and ends of limbs that are fixed in it.
        points: their places (points, 3, frames), metres.
        sides: side of each point, "left", "right" or "".

    Returns:
        Pairs of numbers, each once.
    """
    found: dict[tuple[int, int], None] = {}
    for group in fixed:
        pairs = [(i, j) for place, i in enumerate(group) for j in group[place + 1 :]]
        if len(group) > 3:
            total = dict(zip(group, _distances(points[list(group)]), strict=True))
            middle = min(group, key=lambda i: (sides[i] != "", total[i]))
            pairs = [(middle, other) for other in group if other != middle]
        found |= dict.fromkeys(pairs)
    return tuple(found)


def _distances(points: Floats) -> list[float]:
    """Sum of the median distances of each point to the others, metres; large for one that is never known."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    distance[np.isnan(distance).all(axis=2)] = 1e3
    return [float(total) for total in np.nanmedian(distance, axis=2).sum(axis=1)]


def side(name: str) -> str:
    """Side of the body that a point's name shows: "left", "right", or "" if it shows none."""
    words = name.lower().replace("-", "_").replace(" ", "_").split("_")
    return next((word for word in ("left", "right") if word in words), "")


def mirrored(name: str) -> str:
    """A joint's name on the other side of the body, with its capitals; the same if it tells no side."""
    own = side(name)
    return re.sub(rf"(?<![^_ -])({own})(?![^_ -])", _other_side, name, flags=re.IGNORECASE) if own else name


def _other_side(word: re.Match[str]) -> str:
    found = word[0]
    other = "right" if found.lower() == "left" else "left"
    return other.upper() if found.isupper() else other.capitalize() if found[0].isupper() else other


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
        bridging: variances along x, y and z of what interpolation adds to the error of bridged joints (joints, 3,
            frames), m².
        orientations: of the principal directions, as quaternions x, y, z, w (joints, frames, 4); NaN where unknown.
        notes: remarks for the viewer.
        anatomy: orientations of the anatomical axes of the segments that rotate about the joints (joints, frames, 4);
            NaN where there are none.
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
    bridging: Floats
    orientations: Floats
    notes: tuple[str, ...] = ()
    anatomy: Floats = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        frames = self.centers.shape[-1]
        count = len(self.joints)
        if not self.anatomy.size:
            object.__setattr__(self, "anatomy", np.full((count, frames, 4), np.nan))
        wanted = {
            "places": (len(self.markers), 3, frames),
            "centers": (count, 3, frames),
            "ends": (len(self.tips), 3, frames),
            "flags": (count, frames),
            "errors": (count, 3),
            "bridging": (count, 3, frames),
            "orientations": (count, frames, 4),
            "anatomy": (count, frames, 4),
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
            bridging=self.bridging[:, :, frames],
            orientations=self.orientations[:, frames],
            anatomy=self.anatomy[:, frames],
        )

    def sides(self) -> tuple[str, ...]:
        """Side of each point: "left", "right" or ""."""
        return tuple(map(side, (*self.joints, *self.tips)))


_Y_UP = 1.3
"""The recording's y points up if its markers' mean places extend along it by this factor more than along z."""


def upright_rotation(recording: Recording) -> Floats:
    """Rotation (3, 3) after which z points up: the identity, or (z, x, y) of a recording whose y points up."""
    middle = _mean(recording.positions, axis=0)
    # a body that rotates about the vertical has little mean extent to the sides; that from foot to head stays
    mean = _mean(recording.positions - middle, axis=2)
    _, y, z = np.nanstd(mean[~np.isnan(mean[:, 0])], axis=0)
    if y > _Y_UP * z:
        return np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return np.eye(3)


def _mean(x: Floats, axis: int) -> Floats:
    """Mean of the values that are not NaN; NaN where there are none."""
    known = ~np.isnan(x)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(known, x, 0.0).sum(axis=axis) / known.sum(axis=axis))
