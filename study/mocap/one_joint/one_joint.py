"""One joint of a recording, fitted to the markers of its two segments, with its range of motion and its doubts."""

from dataclasses import dataclass

import numpy as np

from study.mocap.geometry.convex_hull import hull_distances
from study.mocap.geometry.moving_axes import relative_rotation
from study.mocap.geometry.range_of_motion import rotation_range
from study.mocap.io.recording import Recording
from study.mocap.joints.estimates import CENTIMETRE, JointStatus
from study.mocap.joints.fit_joints import find_joints
from study.mocap.joints.found_joints import FoundJoint, FoundJoints
from study.mocap.joints.joint_table import accuracy_columns
from study.mocap.one_joint.across_axis import misplaced_across
from study.mocap.one_joint.clusters import CHILD, JOINT, PARENT, Clusters
from study.mocap.one_joint.left_centres import NEAR, LeftCentre, is_centre, left_centres
from study.sphere.types import Floats

_ERRORS = 3.0
"""Standard errors beyond which another program's centre contradicts the joint, if it is a centimetre away, too."""


@dataclass(frozen=True)
class OneJoint:
    """A joint between two clusters of markers. Lengths are in metres, angles in degrees; NaN where there is none.

    Attributes:
        recording: its name.
        clusters: the markers that the joint was fitted to.
        found: the joint in both segments, with its status and estimates.
        in_recording: mean place over the frames, in the recording's axes (3,).
        frame: number, from 1, of the frame in which the parent's axes are the recording's; their origin is the mean of
            the parent's markers. 0 if the parent has no pose.
        places: of the parent's markers in its axes (markers, 3).
        error: largest standard error, across the axis of a hinge.
        moved: least and greatest root mean square angle of the markers' motion about the joint.
        turn: angle about the mean orientation within which 95 % of the child's rotations in the parent lie.
        frames: number of frames used.
        effective_frames: effective number of independent frames.
        compared: centres that other programs left in the recording, the nearest first.
        misplaced: reasons why the points across its axis cannot be there.
        doubts: all reasons not to rely on the joint.
    """

    recording: str
    clusters: Clusters
    found: FoundJoint
    in_recording: Floats
    frame: int
    places: Floats
    error: float
    moved: tuple[float, float]
    turn: float
    frames: int
    effective_frames: float
    compared: tuple[LeftCentre, ...]
    misplaced: tuple[str, ...]
    doubts: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """True if the joint is of the kind that the user gave, ball or hinge, and reliable."""
        return self.found.status == _wanted(self.found) and not self.misplaced


def fit_one_joint(recording: Recording, clusters: Clusters, hinge: bool = False) -> OneJoint:
    """Fit the joint between two clusters of markers.

    The fit is that of phase 1 (`find_joints`) on a marker set of two segments.

    Args:
        recording: that has the markers.
        clusters: the markers of the two segments.
        hinge: True if the joint is known to be a hinge, such as a knee or an elbow.

    Returns:
        The joint; one that cannot be found has a status, a reason and NaN for its place.
    """
    joints = find_joints(clusters.markerset(hinge), recording.select(clusters.every))
    found = joints[JOINT]
    parent, child = joints.poses.get(PARENT), joints.poses.get(CHILD)
    world, axis = np.full((3, recording.frames), np.nan), None
    if parent is not None:
        world = parent.to_world(found.in_parent)
        if not np.isnan(found.axis_in_parent).any():
            axis = np.einsum("ijt,j->it", parent.rotation, found.axis_in_parent)
    known = ~np.isnan(world[0])
    turn = np.nan
    if parent is not None and child is not None:
        turn = float(np.degrees(rotation_range(relative_rotation(parent.rotation, child.rotation))))
    accuracy = accuracy_columns(found)
    compared = left_centres(recording, world, axis)
    misplaced = misplaced_across(found, joints.poses, clusters.markers, recording)
    doubts = [*misplaced, *_doubts(found, joints, recording, world), *_contradictions(compared, accuracy["error"])]
    return OneJoint(
        recording=recording.name,
        clusters=clusters,
        found=found,
        in_recording=world[:, known].mean(axis=1) if known.any() else np.full(3, np.nan),
        frame=0 if parent is None else _reference(parent.rotation),
        places=np.full((len(clusters.parent), 3), np.nan) if parent is None else parent.template,
        error=accuracy["error"],
        moved=(accuracy["moved_least"], accuracy["moved_most"]),
        turn=turn,
        frames=0 if found.estimate is None else found.estimate.frames,
        effective_frames=accuracy["worth"],
        compared=compared,
        misplaced=misplaced,
        doubts=tuple(doubts),
    )


def _reference(rotation: Floats) -> int:
    """Number, from 1, of the frame in which a segment's axes are the recording's; 0 if there is none."""
    trace = np.nan_to_num(np.einsum("iit->t", rotation), nan=-1.0)
    return int(trace.argmax()) + 1 if trace.size else 0


def _wanted(found: FoundJoint) -> JointStatus:
    """The status of a reliable joint of the kind that the user gave: a ball that moved as a hinge has no centre."""
    return JointStatus.HINGE if found.joint.kind == "hinge" else JointStatus.OK


def _doubts(found: FoundJoint, joints: FoundJoints, recording: Recording, world: Floats) -> list[str]:
    """Reasons not to rely on a joint: its status, a pose that is missing, a place outside the body."""
    doubts = []
    if found.status != _wanted(found):
        doubts.append(found.reason)
    doubts += joints.without_pose.values() if found.estimate is None else ()
    rows = [row for row, label in enumerate(recording.markers) if not is_centre(label)]
    if not np.isnan(world).all():
        (hull,) = hull_distances(recording.positions[rows], world[None])
        doubts += [hull.doubt] if hull.doubt else []
    return doubts


def _contradictions(compared: tuple[LeftCentre, ...], error: float) -> list[str]:
    """The doubt where the nearest of other programs' centres may be of this joint, but contradicts its error."""
    if not compared or not max(CENTIMETRE, _ERRORS * error) < compared[0].distance < NEAR:
        return []
    label, distance, _ = compared[0]
    return [f"{label} of another program is {1000 * distance:.0f} mm away, beyond what the error explains"]
