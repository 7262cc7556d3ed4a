"""Common axes for calibrations of several trials: each trial's segments, moved onto those of a reference.

Each trial has its own axes for a segment. Kabsch's fit of the markers that two trials share moves one trial's axes onto
the other's; a segment with fewer than three markers takes the joint above it as one more point.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from study.mocap.geometry.kabsch import fit_rigid_motion
from study.mocap.skeleton.calibration import Calibration, JointPlace, SegmentShape
from study.sphere.types import Floats


class AxesChange(NamedTuple):
    """A change of axes, x ↦ R x + t, with R (3, 3) and t (3,), metres."""

    rotation: Floats
    shift: Floats

    def place(self, points: Floats) -> Floats:
        """Points (…, 3) in the new axes."""
        return np.asarray(points @ self.rotation.T + self.shift)

    def covariance(self, matrix: Floats) -> Floats:
        """A covariance (3, 3) in the new axes."""
        return np.asarray(self.rotation @ matrix @ self.rotation.T)


UNKNOWN = AxesChange(np.full((3, 3), np.nan), np.full(3, np.nan))
"""Change of axes where a trial and the reference share too little: places become NaN."""
SAME = AxesChange(np.eye(3), np.zeros(3))


@dataclass
class SharedAxes:
    """The axes of one segment that all trials are moved to, with the points that show them.

    Attributes:
        trial: number of the trial whose axes they are.
        has_pose: True if the segment has a pose there; its axes are its parent's otherwise.
        points: places of its markers, and of the joint above it, by name, metres.
    """

    trial: int
    has_pose: bool
    points: dict[str, Floats]


def shape_points(calibration: Calibration, shape: SegmentShape) -> dict[str, Floats]:
    """The points that fix a segment's pose (3,) by name: its markers and, if these are too few, the joint above it."""
    points = dict(zip(shape.markers, shape.places, strict=True))
    if not shape.has_own_pose:
        for joint in calibration.joints:
            if joint.joint.child == shape.segment and not np.isnan(joint.in_child).any():
                points[joint.joint.name] = joint.in_child
    return points


def change_between(points: Mapping[str, Floats], onto: Mapping[str, Floats]) -> AxesChange:
    """The change of axes that moves points nearest to those of the same names; `UNKNOWN` for fewer than three."""
    common = [name for name in points if name in onto]
    if len(common) < 3:
        return UNKNOWN
    template, x = (np.stack([each[name] for name in common]) for each in (points, onto))
    rotation, origin, known = fit_rigid_motion(template, np.ascontiguousarray(x[:, :, None]))
    return AxesChange(rotation[:, :, 0], origin[:, 0]) if known[0] else UNKNOWN


def shared_axes(calibrations: Sequence[Calibration]) -> dict[str, SharedAxes]:
    """For each segment the first trial in which it has a pose, or else the first that has markers of it."""
    found: dict[str, SharedAxes] = {}
    for number, calibration in enumerate(calibrations):
        for shape in calibration.shapes:
            before = found.get(shape.segment)
            if before is None or (shape.has_pose and not before.has_pose):
                found[shape.segment] = SharedAxes(number, shape.has_pose, shape_points(calibration, shape))
    return found


def axes_changes(number: int, calibration: Calibration, onto: Mapping[str, SharedAxes]) -> dict[str, AxesChange]:
    """The change of axes of each segment of a trial, by its number among the trials."""
    parents = {segment.name: segment.parent for segment in calibration.markerset.segments}
    changes: dict[str, AxesChange] = {}
    for shape in calibration.shapes:
        reference, parent = onto[shape.segment], parents[shape.segment]
        if reference.trial == number:
            change = SAME
        elif shape.has_pose and reference.has_pose:
            change = change_between(shape_points(calibration, shape), reference.points)
        elif shape.has_pose or reference.has_pose or parent is None:
            change = UNKNOWN
        else:  # its axes are its parent's
            change = changes[parent]
        changes[shape.segment] = change
    return changes


def moved(place: JointPlace, changes: Mapping[str, AxesChange]) -> JointPlace:
    """A joint in the new axes of its two segments."""
    parent, child = changes[place.joint.parent], changes[place.joint.child]
    owner = (
        child if np.isnan(place.in_parent).any() else parent
    )  # the covariance is in the parent's axes, if it has any
    return replace(
        place,
        in_parent=parent.place(place.in_parent),
        in_child=child.place(place.in_child),
        covariance=owner.covariance(place.covariance),
        axis_in_parent=parent.rotation @ place.axis_in_parent,
        axis_in_child=child.rotation @ place.axis_in_child,
        mean_rotation=parent.rotation @ place.mean_rotation @ child.rotation.T,
    )
