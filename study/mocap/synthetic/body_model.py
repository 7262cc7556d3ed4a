"""An articulated figure: fifteen rigid segments, the joints between them, and CMU's 41 markers on them.

Axes: x forward, y to the left, z up. At rest the figure stands with hanging arms, all segments turned as the world is;
a segment's origin is the joint on which it hangs, the pelvis's the middle between the hips. Lengths are in units of the
body's height; those of limbs follow Winter, Biomechanics and Motor Control of Human Movement, fig. 4.1. The right side
is the left one's mirror image, but for the markers that are placed unevenly in order to tell the sides apart.
"""

from dataclasses import dataclass

import numpy as np

from study.sphere.types import Floats

Triple = tuple[float, float, float]
Range = tuple[float, float]


@dataclass(frozen=True)
class Part:
    """A segment and the joint on which it hangs."""

    name: str
    parent: str | None
    joint: str | None
    at: Triple
    """Where the joint is in the parent's frame, heights."""
    turns: tuple[Range, Range, Range]
    """Least and greatest angle about y, x and z, degrees, applied in this order (about axes that turn along)."""
    markers: dict[str, Triple]
    """Where each is in the segment's frame, heights."""
    axis: Triple | None = None
    """Of a hinge, in the parent's frame; it turns by the angle about y, and the other two do not count."""

    @property
    def kind(self) -> str:
        """Ball or hinge."""
        return "ball" if self.axis is None else "hinge"


_STILL = (0.0, 0.0)

_TRUNK = (
    Part(
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
    Part(
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
    Part(
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
    Part(
        "left_upper_arm",
        "thorax",
        "left_shoulder",
        (-0.005, 0.110, 0.195),
        ((-130, 40), (-5, 85), (-50, 50)),
        {"LUPA": (0.005, 0.030, -0.070), "LELB": (0, 0.028, -0.180)},
    ),
    Part(
        "left_forearm",
        "left_upper_arm",
        "left_elbow",
        (0, 0, -0.186),
        ((-130, -5), _STILL, _STILL),
        {"LFRM": (0.010, 0.022, -0.055), "LWRA": (0.035, 0.010, -0.140), "LWRB": (-0.035, 0.010, -0.140)},
        (0.06, 1, 0.12),
    ),
    Part(
        "left_hand",
        "left_forearm",
        "left_wrist",
        (0, 0, -0.146),
        ((-25, 25), (-60, 60), _STILL),
        {"LFIN": (0.005, 0.020, -0.055)},
    ),
    Part(
        "left_thigh",
        "pelvis",
        "left_hip",
        (0, 0.050, 0),
        ((-90, 20), (-15, 40), (-35, 35)),
        {"LTHI": (0.010, 0.055, -0.150), "LKNE": (0, 0.035, -0.240)},
    ),
    Part(
        "left_shank",
        "left_thigh",
        "left_knee",
        (0, 0, -0.245),
        ((3, 120), _STILL, _STILL),
        {"LSHN": (0.020, 0.030, -0.110), "LANK": (0, 0.025, -0.240)},
        (-0.05, 1, 0.08),
    ),
    Part(
        "left_foot",
        "left_shank",
        "left_ankle",
        (0, 0, -0.246),
        ((-25, 40), (-20, 20), (-15, 15)),
        {"LHEE": (-0.045, 0, -0.015), "LTOE": (0.085, 0, -0.025), "LMT5": (0.065, 0.030, -0.028)},
    ),
)

_UNEVEN = {"RUPA": -0.110, "RFRM": -0.085, "RTHI": -0.110, "RSHN": -0.150}
"""Heights above the origin of the right side's markers that differ from the left's."""


def _mirrored(part: Part) -> Part:
    """The right side's segment. Turns about x and z change their sign, and so do those parts of a hinge's axis."""

    def name(text: str | None) -> str | None:
        return text and text.replace("left_", "right_")

    def flip(place: Triple) -> Triple:
        return place[0], -place[1], place[2]

    markers = {}
    for label, place in part.markers.items():
        right = "R" + label[1:]
        x, y, z = flip(place)
        markers[right] = (x, y, _UNEVEN.get(right, z))
    y_turn, *others = part.turns
    x_turn, z_turn = ((-high, -low) for low, high in others)
    axis = part.axis and (-part.axis[0], part.axis[1], -part.axis[2])
    joint, parent = name(part.joint), name(part.parent)
    return Part(str(name(part.name)), parent, joint, flip(part.at), (y_turn, x_turn, z_turn), markers, axis)


PARTS: tuple[Part, ...] = (*_TRUNK, *_LEFT, *map(_mirrored, _LEFT))
"""All segments, parents before children."""
MARKERS: tuple[str, ...] = tuple(label for part in PARTS for label in part.markers)
JOINTS: tuple[str, ...] = tuple(part.joint for part in PARTS if part.joint)


def unit(axis: Triple) -> Floats:
    """A direction at length one (3,)."""
    vector = np.array(axis, dtype=np.float64)
    length: float = np.linalg.norm(vector).item()
    return vector / length


def neighbours() -> list[tuple[str, str]]:
    """Each marker with the one nearest to it when the figure stands, each pair once: those that get swapped."""
    origins: dict[str | None, Floats] = {None: np.zeros(3)}
    for part in PARTS:
        origins[part.name] = origins[part.parent] + np.array(part.at)
    places = np.array([origins[part.name] + np.array(at) for part in PARTS for at in part.markers.values()])
    distance = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    pairs = {tuple(sorted((i, int(j)))) for i, j in enumerate(distance.argmin(axis=1))}
    return [(MARKERS[i], MARKERS[j]) for i, j in sorted(pairs)]
