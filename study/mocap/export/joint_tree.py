"""A skeleton as a hierarchy of joints: each with its offset from the one above and its rotation in every frame.

A node is a joint, rotated as the segment that moves about it; its offset is the bone to it. Without rotations the
hierarchy is in a rest pose (`rest_pose`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from study.mocap.export.motion import ExportedMotion
from study.mocap.export.rest_pose import limb_end
from study.mocap.geometry.moving_axes import relative_rotation, to_world
from study.mocap.io.recording import RecordingError
from study.mocap.skeleton.calibration import JointPlace
from study.mocap.skeleton.draw_skeleton import pivot_joint
from study.sphere.types import Floats, Ints


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


@dataclass(frozen=True, eq=False)
class _Pose:
    """A segment over time, z up, held in frames in which it is unknown.

    Attributes:
        rotation: from the rest pose (3, 3, frames).
        start: place of the segment's joint (3, frames), metres.
        pivot: place of the joint in the segment's axes (3,), metres.
    """

    rotation: Floats
    start: Floats
    pivot: Floats


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
    calibration = motion.skeleton.calibration
    above = {place.joint.child: place for place in calibration.joints}
    nodes: dict[str, JointNode] = {}
    poses: dict[str, _Pose] = {}
    root = calibration.markerset.segments[0].name
    for segment in calibration.markerset.segments:
        parent = segment.parent or (None if segment.name == root else root)
        known = not np.isnan(motion.skeleton.rotation(segment.name)[0, 0]).all()
        if not known or (parent is not None and parent not in nodes):
            continue
        shape, rest = calibration.shape(segment.name), motion.rest_rotations[segment.name]
        place = pivot_joint(above.get(segment.name), shape)
        poses[segment.name] = pose = _pose(motion, segment.name, place)
        tip = limb_end(shape, pose.pivot)
        if parent is None:
            offset, rotation, course = np.zeros(3), pose.rotation, pose.start
        else:
            base = poses[parent]
            rotation = relative_rotation(base.rotation, pose.rotation)
            course = np.einsum("jit,jt->it", base.rotation, pose.start - base.start)
            offset = np.median(course, axis=1)
            if place is not None:
                offset = motion.rest_rotations[parent] @ (place.in_parent - base.pivot)
        nodes[segment.name] = JointNode(
            name=segment.name if place is None else place.joint.name,
            offset=offset,
            rotation=rotation,
            course=course if place is None else None,
            end=np.zeros(3) if tip is None else rest @ (tip - pose.pivot),
        )
        if parent is not None:
            nodes[parent].children.append(nodes[segment.name])
    if root not in nodes:
        raise RecordingError(
            f"{motion.skeleton.name}: its {root} is known in no frame, and a hierarchy of joints starts from it"
        )
    return nodes[root]


def _pose(motion: ExportedMotion, name: str, place: JointPlace | None) -> _Pose:
    """The pose of a segment that is known in some frame."""
    number = motion.skeleton.segments.index(name)
    frames = _last_known(motion.skeleton.rotations[number][0, 0])
    rotation = np.einsum("ij,jkt->ikt", motion.upright, motion.skeleton.rotations[number][:, :, frames])
    origin = motion.upright @ motion.skeleton.origins[number][:, frames]
    pivot = np.zeros(3) if place is None else place.in_child
    from_rest = np.einsum("ijt,kj->ikt", rotation, motion.rest_rotations[name])
    return _Pose(from_rest, to_world(rotation, origin, pivot), pivot)


def _last_known(row: Floats) -> Ints:
    """For each frame the number of the last known one up to it, or of the first known one."""
    known = ~np.isnan(row)
    last = np.maximum.accumulate(np.where(known, np.arange(len(row)), -1))
    return np.where(last < 0, known.argmax(), last)
