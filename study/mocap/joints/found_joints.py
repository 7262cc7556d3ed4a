"""Answer of phase 1: each joint's place and axis in both of its segments, or the reason why there is none."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from study.mocap.geometry.moving_axes import mean_rotated_covariance, relative_rotation
from study.mocap.joints.estimates import Estimate, JointStatus, largest_error
from study.mocap.joints.segment_poses import SegmentPoses
from study.mocap.joints.symmetric_fit import symmetric_fit
from study.mocap.markersets.marker_set import Joint, MarkerSet
from study.sphere.types import Floats


@dataclass(frozen=True)
class FoundJoint:
    """A joint, or the reason why there is none.

    Attributes:
        joint: as the marker set has it.
        status: its reliability.
        reason: the same in words.
        estimate: the chosen one.
        others: the estimates from other sides.
        in_parent: place in the parent's axes (3,), metres; NaN where that segment has no pose.
        in_child: place in the child's axes (3,), metres; NaN where that segment has no pose.
        covariance: of the place (3, 3), m², in the parent's axes, mean over the frames; in the child's, where the
            parent has no pose.
        axis_in_parent: axis of a hinge (3,) in the parent's axes; NaN if none.
        axis_in_child: axis of a hinge (3,) in the child's axes; NaN if none.
    """

    joint: Joint
    status: JointStatus
    reason: str
    estimate: Estimate | None = None
    others: tuple[Estimate, ...] = ()
    in_parent: Floats = field(default_factory=lambda: np.full(3, np.nan))
    in_child: Floats = field(default_factory=lambda: np.full(3, np.nan))
    covariance: Floats = field(default_factory=lambda: np.full((3, 3), np.nan))
    axis_in_parent: Floats = field(default_factory=lambda: np.full(3, np.nan))
    axis_in_child: Floats = field(default_factory=lambda: np.full(3, np.nan))

    @property
    def standard_error(self) -> float:
        """Largest standard error in the axes of the covariance, across the axis of a hinge, metres; NaN if unknown."""
        return largest_error(self.covariance, None if np.isnan(self.axis_in_parent).any() else self.axis_in_parent)


@dataclass(frozen=True)
class FoundJoints:
    """Joints of a recording, and the poses of its segments.

    Attributes:
        recording: name of the recording.
        markerset: whose joints they are.
        poses: of each segment that has any.
        without_pose: reason, for each of the others.
        joints: all of the marker set's, in its order.
    """

    recording: str
    markerset: MarkerSet
    poses: Mapping[str, SegmentPoses]
    without_pose: Mapping[str, str]
    joints: tuple[FoundJoint, ...]

    def __getitem__(self, name: str) -> FoundJoint:
        """The joint of a name (KeyError if there is none)."""
        return {found.joint.name: found for found in self.joints}[name]


def in_both_segments(found: FoundJoint, poses: Mapping[str, SegmentPoses]) -> FoundJoint:
    """Add a joint's place, and the axis of a hinge, in both segments' axes."""
    estimate, parent, child = found.estimate, found.joint.parent, found.joint.child
    if estimate is None:
        return found
    x = estimate.poses.to_world(estimate.center)
    places = {segment: np.full(3, np.nan) for segment in (parent, child)}
    for segment in places.keys() & poses.keys():
        places[segment] = poses[segment].mean_place(x)
    places[estimate.poses.segment] = estimate.center
    covariance = estimate.covariance
    if estimate.side == "child" and parent in poses:
        covariance = _covariance_in_parent(poses[parent], estimate.poses, covariance)
    axes = np.full((2, 3), np.nan)
    if estimate.axis is not None:
        own = 1 if estimate.side == "child" else 0
        axes[own] = estimate.axis
        if parent in poses and child in poses:
            two = poses[parent], poses[child]
            # rotations show an axis better than the planes of a few arcs; but errors are across the estimate's own axis
            pair = None if found.status == JointStatus.DISAGREE else symmetric_fit(*two)
            if pair is None:
                axes[1 - own] = _axis_in_other(two[own], two[1 - own], axes[own])
            else:
                axes = pair.axes
    return replace(
        found,
        in_parent=places[parent],
        in_child=places[child],
        covariance=covariance,
        axis_in_parent=axes[0],
        axis_in_child=axes[1],
    )


def _axis_in_other(one: SegmentPoses, other: SegmentPoses, axis: Floats) -> Floats:
    """Mean direction in one segment's axes of a direction (3,) in another's."""
    both = one.known & other.known
    mean = np.einsum("jit,jkt,k->i", other.rotation[:, :, both], one.rotation[:, :, both], axis, optimize=True)
    length = np.linalg.norm(mean)
    return mean / length if length > 0.0 else np.full(3, np.nan)


def _covariance_in_parent(parent: SegmentPoses, child: SegmentPoses, covariance: Floats) -> Floats:
    """Mean covariance in the parent's axes (3, 3) of one in the child's."""
    both = parent.known & child.known
    if not both.any():
        return covariance
    return mean_rotated_covariance(
        relative_rotation(parent.rotation[:, :, both], child.rotation[:, :, both]), covariance
    )
