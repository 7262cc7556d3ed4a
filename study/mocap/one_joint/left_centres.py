"""Joint centres that other programs left in a recording as points, and their distances from a joint fitted here.

Gait software writes its centres beside the markers: LHJC, RHJC (Vicon's Plug-in Gait, Visual3D), L_HipCentre,
RightHipCenter and the like. They are another method's answer, not the truth.
"""

import re
from typing import NamedTuple

import numpy as np

from study.mocap.io.recording import Recording
from study.sphere.types import Floats

_PATTERN = re.compile(r"(hip|knee|ankle|shoulder|elbow|wrist)[\s_.-]*(joint)?[\s_.-]*cent(re|er)|[hkaswe]jc$", re.I)
NEAR = 0.1
"""Metres within which another program's centre may be of this joint, and not of the other side's."""


class LeftCentre(NamedTuple):
    """A point of a recording that another program calls a joint's centre.

    Attributes:
        label: of the point.
        distance: median over the frames of its distance from the joint, across the axis of a hinge, metres.
        frames: number of frames with both.
    """

    label: str
    distance: float
    frames: int


def is_centre(label: str) -> bool:
    """True for the label of a joint's centre, such as LHJC, rkjc or Left_HipCentre."""
    return _PATTERN.search(label.strip()) is not None


def left_centres(recording: Recording, joint: Floats, axis: Floats | None = None) -> tuple[LeftCentre, ...]:
    """Measure the distances of other programs' centres from a joint.

    Args:
        recording: that may hold such points.
        joint: the joint's place in the recording (3, frames), metres; NaN where unknown.
        axis: direction of a hinge's axis in the recording (3, frames), of length 1; None for a ball.

    Returns:
        One for each such point that is seen together with the joint, the nearest first.
    """
    found = []
    for label in filter(is_centre, recording.markers):
        off = recording.of(label) - joint
        off = off if axis is None else off - (off * axis).sum(axis=0) * axis
        distance = np.linalg.norm(off, axis=0)
        distance = distance[~np.isnan(distance)]
        if len(distance):
            found.append(LeftCentre(label, float(np.median(distance)), len(distance)))
    return tuple(sorted(found, key=lambda each: each.distance))
