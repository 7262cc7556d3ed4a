"""Random motion of the articulated body within its natural range: smooth, in strides, or each frame drawn anew."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from study.experiment.streams import stream
from study.mocap.synthetic.body_model import PARTS, BodyPart, unit
from study.sphere.types import Floats

_WEIGHTS = np.array([0.5, 0.3, 0.2])  # of three sinusoids; their sum is 1, so that no angle leaves its range
_SLOW, _FAST = 0.1, 0.7  # hertz: periods of 1.4 to 10 seconds
_STRIDE = np.array([0.6, 0.18, 0.07])  # of a stride and its harmonics, in gait; the rest of the course is smooth
_STRIDES = 0.8, 1.1  # hertz
_GAIT = np.array([0.5, 0.3, 0.3])  # share of the range of motion about y, x and z that gait uses, near standing
_ROOM = np.array([1.2, 1.2, 0.12])  # metres: largest excursion of the pelvis to either side

Style = Literal["smooth", "independent", "gait"]
"""Smooth courses; each frame drawn anew, with angles uniform over their ranges; or strides of a part of the range."""


@dataclass(frozen=True, eq=False)
class Motion:
    """The pose of each segment in each frame."""

    rotations: Floats
    """(segments, frames, 3, 3), from the segment's axes to the world's."""
    origins: Floats
    """(segments, 3, frames), metres."""
    phases: Floats
    """(segments, frames): angle about y of the joint to the parent, -1 to 1 over its range."""


def draw_motion(frames: int, rate: float, seed: int, *, height: float, reach: float, style: Style) -> Motion:
    """Draw a motion of the body.

    Args:
        frames: number of frames.
        rate: frames per second.
        seed: of the motion; each angle has a stream of its own.
        height: of the body, metres.
        reach: share of each joint's natural range of motion, about its middle; 0 for a stiff body.
        style: of the courses in time.
    """
    rotations = np.empty((len(PARTS), frames, 3, 3))
    origins = np.empty((len(PARTS), 3, frames))
    phases = np.empty((len(PARTS), frames))
    row = {part.name: i for i, part in enumerate(PARTS)}
    for i, part in enumerate(PARTS):
        courses = np.array([_course(frames, rate, style, seed, part.name, a) for a in "yxz"])
        phases[i] = courses[0]
        rotation = _rotations(part, courses, reach, style)
        if part.parent is None:
            wander = np.array([_course(frames, rate, style, seed, part.name, f"to {a}") for a in "xyz"])
            rotations[i] = rotation
            origins[i] = wander * _ROOM[:, None] + np.array([[0.0], [0.0], [0.53 * height]])
            continue
        parent = row[part.parent]
        rotations[i] = rotations[parent] @ rotation
        origins[i] = origins[parent] + rotations[parent].dot(height * np.array(part.at)).T
    return Motion(rotations, origins, phases)


def _course(frames: int, rate: float, style: Style, seed: int, *name: str) -> Floats:
    """Draw a random course between -1 and 1 (frames,) from the stream of this name."""
    rng = stream(seed, "synthetic", "motion", *name)
    if style == "independent":
        return rng.uniform(-1, 1, frames)
    frequency = np.exp(rng.uniform(np.log(_SLOW), np.log(_FAST), len(_WEIGHTS)))
    start = rng.uniform(0, 2 * np.pi, len(_WEIGHTS))
    time = np.arange(frames) / rate
    course: Floats = _WEIGHTS @ np.sin(2 * np.pi * frequency[:, None] * time + start[:, None])
    if style == "gait":  # strides of one rate in the whole body, and a smooth course that tells one from the next
        stride = stream(seed, "synthetic", "motion", "stride").uniform(*_STRIDES)
        harmonics = stride * np.arange(1, 1 + len(_STRIDE))
        start = stream(seed, "synthetic", "motion", "strides", *name).uniform(0, 2 * np.pi, len(_STRIDE))
        course = (1 - _STRIDE.sum()) * course + _STRIDE @ np.sin(2 * np.pi * harmonics[:, None] * time + start[:, None])
    return course


def _rotations(part: BodyPart, courses: Floats, reach: float, style: Style) -> Floats:
    """Rotations of a segment in its parent's axes (frames, 3, 3), from courses (3, frames) about y, x and z."""
    low, high = np.radians(np.array(part.ranges)).T[:, :, None]
    middle, half = (low + high) / 2, reach * (high - low) / 2
    if style == "gait":
        half = _GAIT[:, None] * half
        middle = np.clip(0.0, low + half, high - half)
    angles = middle + half * courses
    if part.axis is not None:
        rotation = Rotation.from_rotvec(angles[0][:, None] * unit(part.axis))
    elif part.parent is None:  # heading first, then lean, so that the lean does not depend on the heading
        rotation = Rotation.from_euler("ZYX", angles[[2, 0, 1]].T)
    else:
        rotation = Rotation.from_euler("YXZ", angles.T)
    matrices: Floats = rotation.as_matrix()
    return matrices
