"""Calibration: from a recording, or from the joints found in it, to segment shapes and joint places."""

from dataclasses import replace

import numpy as np

from study.mocap.geometry.moving_axes import nearest_rotation
from study.mocap.io.recording import Recording
from study.mocap.joints.fit_joints import find_joints
from study.mocap.joints.found_joints import FoundJoint, FoundJoints
from study.mocap.joints.segment_poses import SegmentPoses
from study.mocap.markersets.marker_set import MarkerSet
from study.mocap.skeleton.calibration import Calibration, JointPlace, SegmentShape
from study.mocap.skeleton.draw_skeleton import draw_skeleton
from study.mocap.skeleton.plausibility import plausibility


def calibrate(recording: Recording, markerset: MarkerSet) -> Calibration:
    """Run phase 1: fit joints and shapes to a recording.

    Args:
        recording: markers under the set's names (see `match`).
        markerset: segments and joints.

    Returns:
        The calibration. Every joint has a status and a reason; one that was not found has no place.
    """
    return calibration_from(find_joints(markerset, recording), recording)


def calibration_from(joints: FoundJoints, recording: Recording) -> Calibration:
    """Make the calibration of joints that were found in a recording."""
    calibration = without_misfits(joints, recording)
    if not any(shape.has_own_pose for shape in calibration.shapes):
        return calibration
    drawn = draw_skeleton(calibration, recording)
    warnings = plausibility(calibration, drawn, recording)
    shapes = (replace(shape, misfit=float(m)) for shape, m in zip(calibration.shapes, drawn.misfits, strict=True))
    places = (replace(place, warnings=warnings.get(place.joint.name, ())) for place in calibration.joints)
    return replace(calibration, shapes=tuple(shapes), joints=tuple(places))


def without_misfits(joints: FoundJoints, recording: Recording) -> Calibration:
    """Make the calibration of joints that were found in a recording, without the misfits of its shapes."""
    above = {each.joint.child: each for each in joints.joints}
    shapes = []
    for segment in joints.markerset.segments:
        poses = joints.poses.get(segment.name)
        if poses is None:
            shapes.append(_shape_without_pose(segment.name, above.get(segment.name), joints, recording))
        else:
            shapes.append(_shape(poses, segment.markers))
    places = tuple(_place(each, joints) for each in joints.joints)
    return Calibration(joints.recording, recording.frames, joints.markerset, tuple(shapes), places)


def _shape(poses: SegmentPoses, markers: tuple[str, ...]) -> SegmentShape:
    rows = [k for k, name in enumerate(poses.points) if name in markers]
    return SegmentShape(
        segment=poses.segment,
        markers=tuple(poses.points[k] for k in rows),
        places=poses.template[rows],
        scatter=poses.scatter[rows],
        has_own_pose=len(rows) == len(poses.points),
        reason="",
    )


def _shape_without_pose(name: str, above: FoundJoint | None, joints: FoundJoints, recording: Recording) -> SegmentShape:
    """Shape of a segment without poses, in its parent's axes.

    Each marker is at its median radius and direction from ``above``, the joint that the segment rotates about.
    """
    reason = joints.without_pose.get(name, "")
    parent = None if above is None else joints.poses.get(above.joint.parent)
    if above is None or parent is None or np.isnan(above.in_parent).any():
        return SegmentShape(name, (), np.zeros((0, 3)), np.zeros(0), False, reason)
    names, places, scatter = [], [], []
    for marker in joints.markerset.segment(name).markers:
        if marker not in recording.markers:
            continue
        away = parent.to_local(recording.of(marker)) - above.in_parent[:, None]
        away = away[:, ~np.isnan(away[0])]
        if away.shape[1] < 2:
            continue
        distance = np.linalg.norm(away, axis=0)
        radius, direction = float(np.median(distance)), np.median(away, axis=1)
        if not np.linalg.norm(direction) > 0.0:
            continue
        names.append(marker)
        places.append(above.in_parent + radius * direction / np.linalg.norm(direction))
        scatter.append(1.4826 * float(np.median(np.abs(distance - radius))))
    return SegmentShape(name, tuple(names), np.array(places).reshape(-1, 3), np.array(scatter), False, reason)


def _place(found: FoundJoint, joints: FoundJoints) -> JointPlace:
    parent, child = joints.poses.get(found.joint.parent), joints.poses.get(found.joint.child)
    in_child, rotation = found.in_child, np.eye(3)
    if parent is not None and child is not None:
        both = parent.known & child.known
        if both.any():
            total = np.einsum("jit,jkt->ik", parent.rotation[:, :, both], child.rotation[:, :, both])
            rotation = nearest_rotation(total)
    elif child is None:  # its axes are the parent's
        in_child = found.in_parent
    return JointPlace(
        joint=found.joint,
        status=found.status,
        reason=found.reason,
        in_parent=found.in_parent,
        in_child=in_child,
        covariance=found.covariance,
        axis_in_parent=found.axis_in_parent,
        axis_in_child=found.axis_in_child,
        mean_rotation=rotation,
        floor=float("nan") if found.estimate is None else found.estimate.floor,
    )
