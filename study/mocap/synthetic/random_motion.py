"""Motion of the articulated figure: smooth and random within natural ranges, or every frame drawn anew."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from study.experiment.streams import stream
from study.mocap.synthetic.body_model import PARTS, Part, unit
from study.sphere.types import Floats

_WEIGHTS = np.array([0.5, 0.3, 0.2])  # of three sinusoids; they sum to 1, so that no angle leaves its range
_SLOW, _FAST = 0.1, 0.7  # hertz: a movement back and forth takes 1.4 to 10 seconds
_ROOM = np.array([1.2, 1.2, 0.12])  # metres that the pelvis wanders to each side


@dataclass(frozen=True, eq=False)
class Motion:
    """Where the segments are in each frame."""

    rotations: Floats
    """(segments, frames, 3, 3), from the segment's frame to the world's."""
    origins: Floats
    """(segments, 3, frames), metres."""
    phases: Floats
    """(segments, frames): the angle about y of the joint on which the segment hangs, -1 to 1 over its range."""


def move(frames: int, rate: float, seed: int, *, height: float, reach: float, independent: bool) -> Motion:
    """Move the figure.

    Args:
        frames: how many.
        rate: frames per second.
        seed: of the motion; each angle has a stream of its own.
        height: of the body, metres.
        reach: share of each joint's natural range, about its middle, that is used; 0 for a stiff figure.
        independent: draw every frame anew, angles uniform over their ranges, instead of moving smoothly.
    """
    rotations = np.empty((len(PARTS), frames, 3, 3))
    origins = np.empty((len(PARTS), 3, frames))
    phases = np.empty((len(PARTS), frames))
    place = {part.name: i for i, part in enumerate(PARTS)}
    for i, part in enumerate(PARTS):
        courses = np.array([_course(frames, rate, independent, seed, part.name, a) for a in "yxz"])
        phases[i] = courses[0]
        turn = _turns(part, courses, reach)
        if part.parent is None:
            wander = np.array([_course(frames, rate, independent, seed, part.name, f"to {a}") for a in "xyz"])
            rotations[i] = turn
            origins[i] = wander * _ROOM[:, None] + np.array([[0.0], [0.0], [0.53 * height]])
            continue
        parent = place[part.parent]
        rotations[i] = rotations[parent] @ turn
        origins[i] = origins[parent] + rotations[parent].dot(height * np.array(part.at)).T
    return Motion(rotations, origins, phases)


def _course(frames: int, rate: float, independent: bool, seed: int, *name: str) -> Floats:
    """A random course between -1 and 1 (frames,), by its name."""
    rng = stream(seed, "synthetic", "motion", *name)
    if independent:
        return rng.uniform(-1, 1, frames)
    frequency = np.exp(rng.uniform(np.log(_SLOW), np.log(_FAST), len(_WEIGHTS)))
    start = rng.uniform(0, 2 * np.pi, len(_WEIGHTS))
    time = np.arange(frames) / rate
    course: Floats = _WEIGHTS @ np.sin(2 * np.pi * frequency[:, None] * time + start[:, None])
    return course


def _turns(part: Part, courses: Floats, reach: float) -> Floats:
    """Rotations of a segment in its parent's frame (frames, 3, 3), for courses (3, frames) about y, x and z."""
    low, high = np.radians(np.array(part.turns)).T[:, :, None]
    angles = (low + high) / 2 + reach * (high - low) / 2 * courses
    if part.axis is not None:
        turn = Rotation.from_rotvec(angles[0][:, None] * unit(part.axis))
    elif part.parent is None:  # heading first, then lean: a figure that faces anywhere leans as little
        turn = Rotation.from_euler("ZYX", angles[[2, 0, 1]].T)
    else:
        turn = Rotation.from_euler("YXZ", angles.T)
    matrices: Floats = turn.as_matrix()
    return matrices
