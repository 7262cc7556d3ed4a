"""An articulated body: fifteen rigid segments, the joints between them, and the 41 markers of CMU's set on them.

Axes: x forward, y to the left, z up. At rest the body stands with hanging arms, and the axes of all segments are the
world's. The origin of a segment is the joint to its parent; that of the pelvis is the middle between the hips. Lengths
are in units of the body's height; those of limbs follow Winter, Biomechanics and Motor Control of Human Movement, fig.
4.1. The right side mirrors the left one, except for the markers that are placed unevenly so that the sides differ.
"""

from dataclasses import dataclass

import numpy as np

from study.arrays import Floats

Triple = tuple[float, float, float]
Interval = tuple[float, float]


@dataclass(frozen=True)
class BodyPart:
    """A segment, its markers, and the joint to its parent."""

    name: str
    parent: str | None
    joint: str | None
    at: Triple
    """The joint in the parent's axes, in heights."""
    ranges: tuple[Interval, Interval, Interval]
    """Range of motion: least and greatest angle about y, x and z, degrees, in this order, about the rotated axes."""
    markers: dict[str, Triple]
    """Each marker in the segment's axes, in heights."""
    axis: Triple | None = None
    """Axis of a hinge in the parent's axes; the angle about y is the angle about it, and the other two do not count."""

    @property
    def kind(self) -> str:
        """Ball or hinge."""
        return "ball" if self.axis is None else "hinge"


_STILL = (0.0, 0.0)

_TRUNK = (
    BodyPart(
        "pelvis",
        None,
        None,
        (0, 0, 0),
        ((-10, 20), (-12, 12), (-180, 180)),
        {
            "LFWT": (0.055, 0.070, 0.055),
            "RFWT": (0.055, -0.070, 0.055),
            "LBWT": (-0.065, 0.030, 0.065),
            "RBWT": (-0.065, -0.030, 0.065),
        },
    ),
    BodyPart(
        "thorax",
        "pelvis",
        "waist",
        (-0.015, 0, 0.070),
        ((-20, 45), (-25, 25), (-40, 40)),
        {
            "C7": (-0.050, 0, 0.235),
            "T10": (-0.065, 0, 0.080),
            "CLAV": (0.035, 0, 0.190),
            "STRN": (0.065, 0, 0.090),
            "RBAC": (-0.075, -0.055, 0.150),
            "LSHO": (-0.005, 0.110, 0.225),
            "RSHO": (-0.005, -0.110, 0.225),
        },
    ),
    BodyPart(
        "head",
        "thorax",
        "neck",
        (-0.015, 0, 0.230),
        ((-40, 40), (-30, 30), (-60, 60)),
        {
            "LFHD": (0.055, 0.040, 0.105),
            "RFHD": (0.055, -0.040, 0.105),
            "LBHD": (-0.050, 0.028, 0.105),
            "RBHD": (-0.050, -0.028, 0.105),
        },
    ),
)

_LEFT = (
    BodyPart(
        "left_upper_arm",
        "thorax",
        "left_shoulder",
        (-0.005, 0.110, 0.195),
        ((-130, 40), (-5, 85), (-50, 50)),
        {"LUPA": (0.005, 0.030, -0.070), "LELB": (0, 0.028, -0.180)},
    ),
    BodyPart(
        "left_forearm",
        "left_upper_arm",
        "left_elbow",
        (0, 0, -0.186),
        ((-130, -5), _STILL, _STILL),
        {"LFRM": (0.010, 0.022, -0.055), "LWRA": (0.035, 0.010, -0.140), "LWRB": (-0.035, 0.010, -0.140)},
        (0.06, 1, 0.12),
    ),
    BodyPart(
        "left_hand",
        "left_forearm",
        "left_wrist",
        (0, 0, -0.146),
        ((-25, 25), (-60, 60), _STILL),
        {"LFIN": (0.005, 0.020, -0.055)},
    ),
    BodyPart(
        "left_thigh",
        "pelvis",
        "left_hip",
        (0, 0.050, 0),
        ((-90, 20), (-15, 40), (-35, 35)),
        {"LTHI": (0.010, 0.055, -0.150), "LKNE": (0, 0.035, -0.240)},
    ),
    BodyPart(
        "left_shank",
        "left_thigh",
        "left_knee",
        (0, 0, -0.245),
        ((3, 120), _STILL, _STILL),
        {"LSHN": (0.020, 0.030, -0.110), "LANK": (0, 0.025, -0.240)},
        (-0.05, 1, 0.08),
    ),
    BodyPart(
        "left_foot",
        "left_shank",
        "left_ankle",
        (0, 0, -0.246),
        ((-25, 40), (-20, 20), (-15, 15)),
        {"LHEE": (-0.045, 0, -0.015), "LTOE": (0.085, 0, -0.025), "LMT5": (0.065, 0.030, -0.028)},
    ),
)

_UNEVEN = {"RUPA": -0.110, "RFRM": -0.085, "RTHI": -0.110, "RSHN": -0.150}
"""z of the right side's markers that differ from the left's, in heights."""


def _mirrored(part: BodyPart) -> BodyPart:
    """The segment of the right side: rotations about x and z change their sign, as do those components of an axis."""

    def name(text: str | None) -> str | None:
        return text and text.replace("left_", "right_")

    def flip(place: Triple) -> Triple:
        return place[0], -place[1], place[2]

    markers = {}
    for label, place in part.markers.items():
        right = "R" + label[1:]
        x, y, z = flip(place)
        markers[right] = (x, y, _UNEVEN.get(right, z))
    about_y, *others = part.ranges
    about_x, about_z = ((-high, -low) for low, high in others)
    axis = part.axis and (-part.axis[0], part.axis[1], -part.axis[2])
    joint, parent = name(part.joint), name(part.parent)
    return BodyPart(str(name(part.name)), parent, joint, flip(part.at), (about_y, about_x, about_z), markers, axis)


PARTS: tuple[BodyPart, ...] = (*_TRUNK, *_LEFT, *map(_mirrored, _LEFT))
"""All segments, parents before children."""
MARKERS: tuple[str, ...] = tuple(label for part in PARTS for label in part.markers)
JOINTS: tuple[str, ...] = tuple(part.joint for part in PARTS if part.joint)


def unit(axis: Triple) -> Floats:
    """A direction as a unit vector (3,)."""
    vector = np.array(axis, dtype=np.float64)
    length: float = np.linalg.norm(vector).item()
    return vector / length


def nearest_pairs() -> list[tuple[str, str]]:
    """Each marker with the one nearest to it on the standing body, each pair once; these get swapped."""
    origins: dict[str | None, Floats] = {None: np.zeros(3)}
    for part in PARTS:
        origins[part.name] = origins[part.parent] + np.array(part.at)
    places = np.array([origins[part.name] + np.array(at) for part in PARTS for at in part.markers.values()])
    distance = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    pairs = {tuple(sorted((i, int(j)))) for i, j in enumerate(distance.argmin(axis=1))}
    return [(MARKERS[i], MARKERS[j]) for i, j in sorted(pairs)]
