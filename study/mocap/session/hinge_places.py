"""Places of hinges along their axes, from a static trial with the medial markers, which are off during motion."""

from dataclasses import replace

import numpy as np

from study.mocap.io.recording import Recording
from study.mocap.joints.found_joints import FoundJoints
from study.mocap.session.common_axes import change_between, shape_points
from study.mocap.session.merge_calibrations import Merged
from study.mocap.skeleton.calibration import Calibration, JointPlace
from study.sphere.types import Floats


def hinges_placed(merged: Merged, static: Calibration, found: FoundJoints, recording: Recording) -> Merged:
    """Move hinges along their axes to the middle of the two points across them, as far as a static trial shows these.

    Args:
        merged: calibration of the session.
        static: calibration of the static trial alone.
        found: its joints, with the poses of its segments.
        recording: the static trial.
    """
    joints = []
    for joint in merged.joints:
        middle = _middle(joint.place, merged.calibration, static, found, recording)
        joints.append(replace(joint, place=_along_axis(joint.place, middle)))
    calibration = replace(merged.calibration, joints=tuple(joint.place for joint in joints))
    return replace(merged, calibration=calibration, joints=tuple(joints))


def _middle(
    place: JointPlace, merged: Calibration, static: Calibration, found: FoundJoints, recording: Recording
) -> Floats:
    """Middle of the two points in the parent's axes (3,), metres; NaN if the trial does not show it."""
    parent, across = place.joint.parent, place.joint.across
    poses = found.poses.get(parent)
    if poses is None or len(across) != 2 or not set(across) <= set(recording.markers):
        return np.full(3, np.nan)
    middle = poses.mean_place(0.5 * (recording.of(across[0]) + recording.of(across[1])))
    onto = shape_points(merged, merged.shape(parent))
    return change_between(shape_points(static, static.shape(parent)), onto).place(middle)


def _along_axis(place: JointPlace, middle: Floats) -> JointPlace:
    """A hinge moved along its axis to next to a point in the parent's axes (3,), in both segments."""
    axis = place.axis_in_parent
    if np.isnan(axis).any() or np.isnan(middle).any() or np.isnan(place.in_parent).any():
        return place
    step = float((middle - place.in_parent) @ axis)
    in_child = place.axis_in_child * np.sign((place.mean_rotation @ place.axis_in_child) @ axis)
    if np.isnan(in_child).any():  # a child without a pose
        in_child = place.mean_rotation.T @ axis
    return replace(place, in_parent=place.in_parent + step * axis, in_child=place.in_child + step * in_child)
