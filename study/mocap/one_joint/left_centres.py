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


class LeftCentre(NamedTuple):
    """A point of a recording that another program calls a joint's centre.

    Attributes:
        label: of the point.
        distance: median over the frames of its distance from the joint, metres.
        frames: number of frames with both.
    """

    label: str
    distance: float
    frames: int


def is_centre(label: str) -> bool:
    """True for the label of a joint's centre, such as LHJC, rkjc or Left_HipCentre."""
    return _PATTERN.search(label.strip()) is not None


def left_centres(recording: Recording, joint: Floats) -> tuple[LeftCentre, ...]:
    """Measure the distances of other programs' centres from a joint.

    Args:
        recording: that may hold such points.
        joint: the joint's place in the recording (3, frames), metres; NaN where unknown.

    Returns:
        One for each such point that is seen together with the joint, the nearest first.
    """
    found = []
    for label in filter(is_centre, recording.markers):
        distance = np.linalg.norm(recording.of(label) - joint, axis=0)
        distance = distance[~np.isnan(distance)]
        if len(distance):
            found.append(LeftCentre(label, float(np.median(distance)), len(distance)))
    return tuple(sorted(found, key=lambda each: each.distance))
