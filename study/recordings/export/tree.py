"""A skeleton as other programs want it: rest pose, joint angles, and a hierarchy of joints.

Rest pose: other programs expect a T-pose (arms sideways, legs down, toes forward), joint angles a standing pose with
hanging arms. Markers say neither. Each segment starts from the mean pose relative to its parent, and is rotated the
shortest way until its bone, from its joint to the next one, points where its name says: an arm sideways, a leg down, a
trunk up. A segment whose name has none of the words keeps its mean pose. A trunk with joints on both sides is also
rotated until these are level. Axes: x to the left, y backward, z up, as Blender and others have them.

Joint angles: the rotation of each child segment relative to its parent. Where points of the body give both segments
anatomical axes (`skeleton.anatomy`), hips, knees and ankles have the three angles of Grood and Suntay between these:
about the parent's z, the floating axis, and the child's y, which are the Cardan angles z, x, y. A knee bends
positively, an ankle lifts the foot. The rotation of a root with such axes is theirs.

The other joints' angles are zero in the standing pose, about axes that lie as in anatomy there. They are OpenSim's: x
forward, y up, z to the right. A ball joint has three angles, about z, x and y in this order:
flexion, adduction and rotation of a limb (flexion forward; adduction and rotation to the inside on both sides),
extension, bending and rotation of the trunk and the head (backward, to the right, to the left). A hinge has the angle
about its own axis; the sign of the axis is such that the median angle is positive, as knees and elbows bend one way.
Rotations about the long axis of a limb are relative to its mean pose: markers alone do not show their zero. Source:
Rajagopal et al. 2016, Full-body musculoskeletal model; its coordinates have these signs.

Hierarchy: a node is a joint, rotated as the segment that moves about it; its offset is the bone to it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from study.arrays import Bytes, Floats, Ints
from study.recordings.joints.estimate import ANATOMICAL as UNMOVED
from study.recordings.joints.find import Calibration, JointPlace, SegmentShape
from study.recordings.markersets import side
from study.recordings.recording import Recording, RecordingError
from study.recordings.rigid import relative_rotation, skew, to_world, zxy_angles
from study.recordings.skeleton.anatomy import legs
from study.recordings.skeleton.draw import LARGEST_ERROR as FARTHEST
from study.recordings.skeleton.draw import Flag, Skeleton
from study.recordings.skeleton.scene import TIP, Scene, up_of

_WORDS = {
    "arm": ("forearm", "arm", "hand", "humerus", "ulna", "radius", "clavicle", "scapula", "finger"),
    "foot": ("foot", "calcn", "toe", "talus"),
    "leg": ("thigh", "shank", "shin", "leg", "femur", "tibia"),
    "trunk": ("pelvis", "thorax", "trunk", "torso", "spine", "chest", "abdomen", "lumbar", "neck", "head"),
}
"""Words in the names of segments, by the part of the body that they belong to."""
_LEFT, _FORWARD, _UP = np.eye(3)[0], -np.eye(3)[1], np.eye(3)[2]
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Rotation from axes with z up to those with y up."""


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
    rotations: dict[str, Floats] = {}
    for name in (segment.name for segment in calibration.markerset.segments):
        rotations[name] = upright
        if rest != RestPose.RECORDED:
            place = above.get(name)
            start = upright if place is None else rotations[place.joint.parent] @ place.mean_rotation
            rotations[name] = _posed(name, start, calibration, rest)
    return rotations


def _posed(name: str, start: Floats, calibration: Calibration, rest: RestPose) -> Floats:
    """The rotation of a segment in the rest pose, from its rotation (3, 3) in the mean pose."""
    part = next((part for part, words in _WORDS.items() if any(word in name.lower() for word in words)), "")
    below = [(side(place.joint.name), place.in_parent) for place in calibration.joints if place.joint.parent == name]
    below = [(one, point) for one, point in below if not np.isnan(point).any()]
    bone = _bone(name, below, calibration)
    if part == "trunk" and {"left", "right"} <= {one for one, _ in below}:
        left, right = (np.mean([point for one, point in below if one == which], axis=0) for which in ("left", "right"))
        if np.linalg.norm(left - right) > 0.0:  # left to the left, and the bone up as far as that leaves it free
            up = start.T @ _UP if bone is None else bone
            x = (left - right) / np.linalg.norm(left - right)
            z = up - (up @ x) * x
            if np.linalg.norm(z) < 1e-3 * np.linalg.norm(up):
                return start
            z = z / np.linalg.norm(z)
            return np.stack([x, np.cross(z, x), z])
    if bone is None or not part:
        return start
    if part == "foot":  # keeps its pitch
        return _shortest(*(vector * [1.0, 1.0, 0.0] for vector in (start @ bone, _FORWARD))) @ start
    sideways = {"left": _LEFT, "right": -_LEFT}.get(side(name))
    target = {"trunk": _UP, "leg": -_UP, "arm": sideways if rest == RestPose.T_POSE else -_UP}[part]
    return start if target is None else _shortest(start @ bone, target) @ start


def _bone(name: str, below: Sequence[tuple[str, Floats]], calibration: Calibration) -> Floats | None:
    """Direction of a segment (3,), in its axes: from its joint to the next one, or to the end of its markers.

    ``below`` are the joints that it carries, each with its side and its place (3,).
    """
    above = next((place.in_child for place in calibration.joints if place.joint.child == name), None)
    ends = [point for one, point in below if not one]
    if above is None or np.isnan(above).any():  # a root starts between the joints on both sides
        sides = [point for one, point in below if one]
        above = np.mean(sides, axis=0) if sides else None
    elif not ends:
        tip = limb_end(calibration.shape(name), above)
        ends = [point for _, point in below] or ([] if tip is None else [tip])
    if above is None or not ends:
        return None
    bone = np.mean(ends, axis=0) - above
    return bone if np.linalg.norm(bone) > 0.0 else None


def limb_end(shape: SegmentShape, joint: Floats) -> Floats | None:
    """End of a segment (3,), in its axes: the middle of its markers farthest from its joint; None without markers."""
    away = np.linalg.norm(shape.places - joint, axis=1)
    return np.asarray(shape.places[away >= TIP * away.max()].mean(axis=0)) if len(away) else None


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
    k = skew(axis)
    return np.asarray(np.eye(3) + k + k @ k / (1.0 + cosine))


LARGEST_ANGLE_ERROR = 10.0
"""Degrees: standard error above which an angle is missing, if no other is given."""


@dataclass(frozen=True, eq=False)
class ExportedMotion:
    """A skeleton with all that is known of it.

    Attributes:
        skeleton: of phase 2, in the recording's axes.
        recording: the whole recording that it was drawn from; its axes, labels and markers are the file's.
        scene: the same skeleton with z up, with errors and doubts.
        source: the recording's file, or None.
        rest: the pose in which files with a hierarchy have no rotations.
        largest_angle_error: standard error above which an angle is missing, degrees.
    """

    skeleton: Skeleton
    recording: Recording
    scene: Scene
    source: Path | None = None
    rest: RestPose = RestPose.T_POSE
    largest_angle_error: float = LARGEST_ANGLE_ERROR

    @cached_property
    def upright(self) -> Floats:
        """Rotation (3, 3) of the recording's axes after which z points up."""
        return up_of(self.recording)[0]

    @cached_property
    def rest_rotations(self) -> dict[str, Floats]:
        """Rotation (3, 3) of each segment's axes in the pose without rotations, z up."""
        return rest_rotations(self.skeleton.calibration, self.upright, self.rest)

    def with_joints(self) -> Recording:
        """The recording with the joint centres as points behind its markers, in its own axes; NaN where unknown.

        ``_regression`` or ``_landmark`` is added to the name of a joint that is not by motion, ``_joint`` where a
        marker has the name.
        """
        taken = {marker.lower() for marker in self.recording.markers}
        known = np.flatnonzero(~np.isnan(self.skeleton.centers[:, 0]).all(axis=1))
        places = [self.skeleton.calibration.joints[number] for number in known]
        names = [p.joint.name + (f"_{p.status.name.lower()}" if p.status in UNMOVED else "") for p in places]
        labels = [name + "_joint" * (name.lower() in taken) for name in names]
        points = np.concatenate([self.recording.positions, self.skeleton.centers[known]])
        return Recording(self.recording.name, (*self.recording.markers, *labels), points, self.recording.rate)


ANATOMICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Rotation from the axes of rest poses, x to the left and z up, to x forward, y up, z to the right."""
_LIMB, _TRUNK = ("flexion", "adduction", "rotation"), ("extension", "bending", "rotation")


def joint_angles(motion: ExportedMotion) -> pd.DataFrame:
    """Compute the angles of all joints.

    Returns:
        A row per frame. Columns: time, seconds; the root's place, ``<root>_tx``, ``_ty``, ``_tz``, metres, and its
        rotation in the world, ``_tilt`` about z, ``_list`` about x, ``_rotation`` about y, degrees; the angles of each
        joint, ``<joint>_flexion``, …, degrees (`angle_lines` says what they are). The world's axes are the recording's
        with y up.

        Each angle has its standard error in ``<angle>_error``, degrees: that of both poses in the frame, from the
        markers' noise and skin, or from interpolation, and that of the anatomical axes, which all frames share.
        ``<joint>_flag`` and ``<root>_flag`` are 0 where markers show both segments, 1 where one
        is bridged, 2 where all angles are missing. An angle is NaN where a segment is not known, the gate bars the
        joint (``motion.skeleton.barred``), or the error of the poses alone is above ``motion.largest_angle_error``.
    """
    skeleton = motion.skeleton
    standing = rest_rotations(skeleton.calibration, motion.upright, RestPose.STANDING)
    turns = {name: _rotation(motion, name, standing[name].T @ ANATOMICAL.T) for name in skeleton.segments}
    axes = {s.segment: s.anatomy for s in skeleton.calibration.shapes if not np.isnan(s.anatomy).any()}
    clinical = {name: _rotation(motion, name, columns) for name, columns in axes.items()}
    root = skeleton.segments[0]
    world = Y_UP @ motion.upright
    turn = np.einsum("ij,jkt->ikt", world @ motion.upright.T, (turns | clinical)[root])
    names = [f"{root}_{name}" for name in ("tilt", "list", "rotation")]
    errors = zxy_errors(turn, world @ skeleton.turning[0] @ world.T)
    errors = np.where(any(found.name == "up" for found in skeleton.barred), np.nan, errors)
    places = dict(zip([f"{root}_{axis}" for axis in ("tx", "ty", "tz")], world @ skeleton.origins[0], strict=True))
    columns: dict[str, Floats | Ints] = {"time": np.arange(skeleton.frames) / skeleton.rate}
    columns |= places
    tilts, of_root = (
        dict(zip(names, known_angles(turn), strict=True)),
        angles_errors(skeleton.calibration, turn, None, root),
    )
    columns |= flagged(motion, root, tilts, errors, skeleton.segment_flags[0], of_root)
    between, segments = clinical_joints(skeleton.calibration), legs(skeleton.calibration.markerset)
    shanks = {segments.get("left shank"), segments.get("right shank")}
    for place in skeleton.calibration.joints:
        joint, anatomical = place.joint, place.joint.name in between
        rotations = clinical if anatomical else turns
        turn = relative_rotation(rotations[joint.parent], rotations[joint.child])
        parent, child = (skeleton.segments.index(name) for name in (joint.parent, joint.child))
        of_axes = np.zeros(1)
        back = np.moveaxis(rotations[joint.parent], 2, 0).swapaxes(1, 2) @ motion.upright
        covariance = back @ (skeleton.turning[parent] + skeleton.turning[child]) @ back.swapaxes(1, 2)
        if joint.kind == "hinge" and place.axis is not None and not anatomical:
            axis = ANATOMICAL @ standing[joint.parent] @ place.axis / np.linalg.norm(place.axis)
            angles = {f"{joint.name}_flexion": _about(axis, turn)}
            errors = np.degrees(np.sqrt(np.einsum("i,tij,j->t", axis, covariance, axis)))[None]
        else:
            angles = _ball(joint.name, turn, -1.0 if anatomical and joint.child in shanks else 1.0)
            errors = zxy_errors(turn, covariance)
            if anatomical:
                of_axes = angles_errors(skeleton.calibration, turn, joint.parent, joint.child)
        flags = np.maximum(*(skeleton.segment_flags[[parent, child]]))
        errors = np.where(skeleton.barred_at(joint)[0], np.nan, errors)
        columns |= flagged(motion, joint.name, angles, errors, flags, of_axes)
    return pd.DataFrame(columns)


def angles_errors(calibration: Calibration, turn: Floats, parent: str | None, child: str) -> Floats:
    """Standard errors of a joint's angles (3, frames), degrees, or of a root's without a parent, from those of axes."""
    own = []
    for shape in (calibration.shape(name) for name in (parent, child) if name is not None):
        own.append(np.nan_to_num(shape.anatomy.T @ shape.anatomy_covariance @ shape.anatomy))
    turned = np.einsum("ijt,jk,lkt->til", turn, own[-1], turn)
    return zxy_errors(turn, turned + own[0] if parent is not None else turned)


def flagged(
    motion: ExportedMotion, name: str, angles: dict[str, Floats], errors: Floats, flags: Bytes, axes: Floats
) -> dict[str, Floats | Ints]:
    """Angles of a joint that are sure enough by the errors of its poses, their whole errors, and the joint's flag.

    ``errors`` of the poses and of the ``axes`` are (angles, frames), degrees.
    """
    with np.errstate(invalid="ignore"):
        sure = dict(zip(angles, errors <= motion.largest_angle_error, strict=True))
    columns: dict[str, Floats | Ints] = {key: np.where(sure[key], angle, np.nan) for key, angle in angles.items()}
    whole = zip(angles, np.hypot(errors, axes), strict=True)
    columns |= {f"{key}_error": np.where(sure[key], row, np.nan) for key, row in whole}
    return columns | {f"{name}_flag": np.where(np.any([*sure.values()], axis=0), flags, Flag.UNKNOWN).astype(int)}


def zxy_errors(turn: Floats, covariance: Floats) -> Floats:
    """Standard errors of the angles about z, x and y (3, frames), degrees, of R = Rz Rx Ry (3, 3, frames).

    A small rotation δ before R, of covariance C (frames, 3, 3), rad², has in the axes after Rz the components δ'. The
    angle about x changes by δ'_x, that about y by δ'_y / cos x, that about z by δ'_z - δ'_y tan x.
    """
    x, z = np.arcsin(np.clip(turn[2, 1], -1.0, 1.0)), np.arctan2(-turn[0, 1], turn[1, 1])
    cosine, sine = np.cos(z), np.sin(z)
    a, b, d = np.zeros((3, 3, len(x)))
    a[:2], b[:2], d[2] = (cosine, sine), (-sine, cosine), 1.0  # axes x, y and z after Rz

    def between(one: Floats, other: Floats) -> Floats:
        return np.asarray(np.einsum("it,tij,jt->t", one, covariance, other))

    with np.errstate(divide="ignore", invalid="ignore"):
        about_z = d - b * np.tan(x)
        squares = between(about_z, about_z), between(a, a), between(b, b) / np.cos(x) ** 2
        return np.degrees(np.sqrt(np.maximum(squares, 0.0)))


def clinical_joints(calibration: Calibration) -> list[str]:
    """Names of the joints whose angles are those of Grood and Suntay: both segments, of a leg, have anatomical axes."""
    segments = set(legs(calibration.markerset).values())
    segments = {name for name in segments if not np.isnan(calibration.shape(name).anatomy).any()}
    return [place.joint.name for place in calibration.joints if {place.joint.parent, place.joint.child} <= segments]


def angle_lines(calibration: Calibration) -> list[str]:
    """The lines that say what the angles of the joints are."""
    clinical = clinical_joints(calibration)
    others = [place.joint.name for place in calibration.joints if place.joint.name not in clinical]
    lines = [f"angles of {', '.join(clinical)}: Grood and Suntay, between anatomical axes"] * bool(clinical)
    words = "zero where bones hang straight down, for want of points of the body that show anatomical axes"
    return [*lines, *[f"angles of {', '.join(others)}: {words}"] * bool(others)]


def _rotation(motion: ExportedMotion, name: str, axes: Floats) -> Floats:
    """Rotation (3, 3, frames) of axes (3, 3), columns x, y, z, in a segment's axes, to the upright world."""
    return np.asarray(np.einsum("ij,jkt,kl->ilt", motion.upright, motion.skeleton.rotation(name), axes))


def _ball(name: str, turn: Floats, bends: float = 1.0) -> dict[str, Floats]:
    """The three angles of a joint, degrees; ``bends`` is the sign of the first."""
    names, signs = (_LIMB if side(name) else _TRUNK), np.array([bends, 1.0, 1.0])
    if side(name) == "left":  # mirrored
        signs[1:] = -1.0
    return {f"{name}_{one}": sign * angle for one, sign, angle in zip(names, signs, known_angles(turn), strict=True)}


def _about(axis: Floats, turn: Floats) -> Floats:
    """The angle of rotations (3, 3, frames) about an axis (3,), degrees, positive in the median."""
    known = ~np.isnan(turn[0, 0])
    angle = np.full(turn.shape[2], np.nan)
    if known.any():
        quaternions = Rotation.from_matrix(turn[:, :, known].transpose(2, 0, 1)).as_quat()
        about = 2.0 * np.arctan2(quaternions[:, :3] @ axis, quaternions[:, 3])
        about = (about + np.pi) % (2.0 * np.pi) - np.pi
        angle[known] = np.degrees(about if np.median(about) >= 0.0 else -about)
    return angle


def known_angles(turn: Floats) -> Floats:
    """Angles about z, x and y (3, frames), degrees, without jumps; NaN where the rotation is not known."""
    known = ~np.isnan(turn[0, 0])
    angles = np.full((3, turn.shape[2]), np.nan)
    angles[:, known] = np.degrees(zxy_angles(turn[:, :, known]))
    return angles


@dataclass(eq=False)
class JointNode:
    """A joint and all below it, z up.

    Attributes:
        name: of the joint; of the segment if that does not rotate about a known joint.
        offset: its place relative to the parent's node in the rest pose (3,), metres.
        rotation: relative to the parent's (3, 3, frames); the identity in the rest pose.
        course: its place relative to the parent's node over time (3, frames), metres, if it is free; None if it is
            fixed in the parent.
        end: end of the segment (3,), metres, relative to the node in the rest pose.
        children: nodes below.
    """

    name: str
    offset: Floats
    rotation: Floats
    course: Floats | None
    end: Floats
    children: list["JointNode"] = field(default_factory=list)

    def walk(self) -> "Iterator[JointNode]":
        """This node and all below it, parents before children."""
        yield self
        for child in self.children:
            yield from child.walk()


def _hangs_on(place: JointPlace, shape: SegmentShape) -> bool:
    """True if a segment hangs on its joint: if that is known well enough, or the segment has no pose without it."""
    return place.known and not (shape.has_own_pose and place.standard_error > FARTHEST)


def joint_tree(motion: ExportedMotion) -> JointNode:
    """Build the hierarchy of a skeleton.

    A segment that is known in no frame is left out, with all below it. Formats with a hierarchy cannot mark a pose as
    unknown: in such frames the segment keeps its last pose, and the skeleton's flags show these frames. A segment
    without a parent, other than the first, moves freely below the first.

    Returns:
        The first segment's node.

    Raises:
        RecordingError: if the first segment is known in no frame.
    """
    skeleton, calibration = motion.skeleton, motion.skeleton.calibration
    above = {place.joint.child: place for place in calibration.joints}
    nodes: dict[str, JointNode] = {}
    poses: dict[str, tuple[Floats, Floats, Floats]] = {}  # see `_pose`
    root = calibration.markerset.segments[0].name
    for segment, shape in zip(calibration.markerset.segments, calibration.shapes, strict=True):
        parent = segment.parent or (None if segment.name == root else root)
        known = not np.isnan(skeleton.rotation(segment.name)[0, 0]).all()
        if not known or (parent is not None and parent not in nodes):
            continue
        place = above.get(segment.name)
        place = place if place is not None and _hangs_on(place, shape) else None
        rotation, course, pivot = poses[segment.name] = _pose(motion, segment.name, place)
        offset, tip = np.zeros(3), limb_end(shape, pivot)
        if parent is not None:
            base_rotation, base_start, base_pivot = poses[parent]
            rotation = relative_rotation(base_rotation, rotation)
            course = np.einsum("jit,jt->it", base_rotation, course - base_start)
            offset = np.median(course, axis=1)
            if place is not None:
                offset = motion.rest_rotations[parent] @ (place.in_parent - base_pivot)
        name, free = (segment.name, course) if place is None else (place.joint.name, None)
        end = np.zeros(3) if tip is None else motion.rest_rotations[segment.name] @ (tip - pivot)
        nodes[segment.name] = JointNode(name, offset, rotation, free, end)
        if parent is not None:
            nodes[parent].children.append(nodes[segment.name])
    if root not in nodes:
        words = f"its {root} is known in no frame, and a hierarchy of joints starts from it"
        raise RecordingError(f"{skeleton.name}: {words}")
    return nodes[root]


def _pose(motion: ExportedMotion, name: str, place: JointPlace | None) -> tuple[Floats, Floats, Floats]:
    """The pose of a segment that is known in at least one frame, z up, held in frames in which it is unknown.

    Returns:
        Its rotation from the rest pose (3, 3, frames); the place of its joint (3, frames), metres; and the place of the
        joint in its axes (3,), metres.
    """
    number = motion.skeleton.segments.index(name)
    # for each frame the last known one up to it, or the first known one
    known = ~np.isnan(motion.skeleton.rotations[number][0, 0])
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    frames = np.where(last < 0, known.argmax(), last)
    rotation = np.einsum("ij,jkt->ikt", motion.upright, motion.skeleton.rotations[number][:, :, frames])
    origin = motion.upright @ motion.skeleton.origins[number][:, frames]
    pivot = np.zeros(3) if place is None else place.in_child
    from_rest = np.einsum("ijt,kj->ikt", rotation, motion.rest_rotations[name])
    return from_rest, to_world(rotation, origin, pivot), pivot
