"""Rest poses: the rotation of each segment in the pose in which a file's hierarchy has no rotations.

Other programs expect a T-pose there (arms sideways, legs down, toes forward), joint angles a standing pose with hanging
arms. Markers say neither. Each segment starts from the mean pose relative to its parent, and is rotated the shortest
way until its bone, from its joint to the next one, points where its name says: an arm sideways, a leg down, a trunk up.
A segment whose name has none of the words keeps its mean pose. A trunk with joints on both sides is also rotated until
these are level.

Axes of the rest pose: x to the left, y backward, z up, as Blender and others have them.
"""

from enum import Enum

import numpy as np
from scipy.spatial.transform import Rotation

from study.mocap.skeleton.bones import side
from study.mocap.skeleton.calibration import Calibration, SegmentShape
from study.sphere.types import Floats

_WORDS = {
    "arm": ("forearm", "arm", "hand", "humerus", "ulna", "radius", "clavicle", "scapula", "finger"),
    "foot": ("foot", "calcn", "toe", "talus"),
    "leg": ("thigh", "shank", "shin", "leg", "femur", "tibia"),
    "trunk": ("pelvis", "thorax", "trunk", "torso", "spine", "chest", "abdomen", "lumbar", "neck", "head"),
}
"""Words in the names of segments, by the part of the body that they belong to."""
_LEFT, _FORWARD, _UP = np.eye(3)[0], -np.eye(3)[1], np.eye(3)[2]
_TIP = 0.7
"""A limb ends in the middle of its markers that are at least this share of the farthest one's distance away."""


class RestPose(Enum):
    """The poses without rotations."""

    T_POSE = "t-pose"
    """Arms sideways, legs down."""
    STANDING = "standing"
    """Arms and legs down: the zero of joint angles."""
    RECORDED = "recorded"
    """As the frame of the calibrated recording with the most markers."""


def rest_rotations(calibration: Calibration, upright: Floats, rest: RestPose) -> dict[str, Floats]:
    """Rotations of all segments in a rest pose.

    Args:
        calibration: shapes of the segments and joints between them.
        upright: rotation (3, 3) of the recording's axes after which z points up.
        rest: the pose.

    Returns:
        For each segment the rotation (3, 3) from its axes to those of the rest pose.
    """
    above = {place.joint.child: place for place in calibration.joints}
    found: dict[str, Floats] = {}
    for segment in calibration.markerset.segments:
        place = above.get(segment.name)
        start = upright
        if rest != RestPose.RECORDED and place is not None:
            start = found[place.joint.parent] @ place.mean_rotation
        found[segment.name] = start if rest == RestPose.RECORDED else _posed(segment.name, start, calibration, rest)
    return found


def _posed(name: str, start: Floats, calibration: Calibration, rest: RestPose) -> Floats:
    """The rotation of a segment in the rest pose, from its rotation (3, 3) in the mean pose."""
    part = next((part for part, words in _WORDS.items() if any(word in name.lower() for word in words)), "")
    bone, across = _bone(name, calibration), _across(name, calibration)
    if part == "trunk" and across is not None:
        return _level(start, across, bone)
    if bone is None or not part:
        return start
    if part == "foot":  # keeps its pitch
        return _shortest(*(vector * [1.0, 1.0, 0.0] for vector in (start @ bone, _FORWARD))) @ start
    sideways = {"left": _LEFT, "right": -_LEFT}.get(side(name))
    directions = {"trunk": _UP, "leg": -_UP, "arm": sideways if rest == RestPose.T_POSE else -_UP}
    target = directions[part]
    return start if target is None else _shortest(start @ bone, target) @ start


def _bone(name: str, calibration: Calibration) -> Floats | None:
    """Direction of a segment (3,), in its axes: from its joint to the next one, or to the end of its markers."""
    above = next((place.in_child for place in calibration.joints if place.joint.child == name), None)
    below = {place.joint.name: place.in_parent for place in calibration.joints if place.joint.parent == name}
    below = {joint: point for joint, point in below.items() if not np.isnan(point).any()}
    middle = [point for joint, point in below.items() if not side(joint)]
    if above is None or np.isnan(above).any():  # a root starts between the joints on both sides
        sides = [point for joint, point in below.items() if side(joint)]
        above = np.mean(sides, axis=0) if sides else None
        ends = middle
    else:
        ends = middle or list(below.values()) or _tip(calibration, name, above)
    if above is None or not ends:
        return None
    bone = np.mean(ends, axis=0) - above
    return bone if np.linalg.norm(bone) > 0.0 else None


def _tip(calibration: Calibration, name: str, joint: Floats) -> list[Floats]:
    tip = limb_end(calibration.shape(name), joint)
    return [] if tip is None else [tip]


def limb_end(shape: SegmentShape, joint: Floats) -> Floats | None:
    """End of a segment (3,), in its axes: the middle of its markers farthest from its joint; None without markers."""
    away = np.linalg.norm(shape.places - joint, axis=1)
    return np.asarray(shape.places[away >= _TIP * away.max()].mean(axis=0)) if len(away) else None


def _across(name: str, calibration: Calibration) -> Floats | None:
    """Direction from the right to the left (3,), in a segment's axes, from its joints on both sides; None without."""
    below = {place.joint.name: place.in_parent for place in calibration.joints if place.joint.parent == name}
    pairs = {
        one: [p for j, p in below.items() if side(j) == one and not np.isnan(p).any()] for one in ("left", "right")
    }
    if not (pairs["left"] and pairs["right"]):
        return None
    across = np.mean(pairs["left"], axis=0) - np.mean(pairs["right"], axis=0)
    return across if np.linalg.norm(across) > 0.0 else None


def _level(start: Floats, across: Floats, bone: Floats | None) -> Floats:
    """Rotation (3, 3) that puts left to the left, and the bone up as far as that leaves it free."""
    up = start.T @ _UP if bone is None else bone
    x = across / np.linalg.norm(across)
    z = up - (up @ x) * x
    if np.linalg.norm(z) < 1e-3 * np.linalg.norm(up):
        return start
    z = z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _shortest(vector: Floats, target: Floats) -> Floats:
    """The shortest rotation (3, 3) of a direction onto another; the identity if one of them has no length."""
    lengths = np.linalg.norm(vector), np.linalg.norm(target)
    if min(lengths) == 0.0:
        return np.eye(3)
    a, b = vector / lengths[0], target / lengths[1]
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < -1.0 + 1e-9:  # half a turn, about any axis across
        axis = np.cross(a, np.eye(3)[np.abs(a).argmin()])
        return np.asarray(Rotation.from_rotvec(np.pi * axis / np.linalg.norm(axis)).as_matrix())
    k = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + k + k @ k / (1.0 + cosine))
