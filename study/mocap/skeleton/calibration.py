"""The calibration of a subject: the shape of each segment and the joints in it, as phase 1 leaves them for phase 2.

It belongs to a subject with its markers on. Fitted to one recording, it serves for any other of the same session.

Source: paper §10 ("calculations can be reused for the same actor and marker-set").
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from study.mocap.joints.estimates import JointStatus, largest_error
from study.mocap.joints.joint_table import SHORT_TEXTS
from study.mocap.markersets.marker_set import Joint, MarkerSet
from study.sphere.types import Floats
from study.text.columns import columns
from study.text.numbers import number


@dataclass(frozen=True, eq=False)
class SegmentShape:
    """A segment's markers, fixed in its axes.

    Attributes:
        segment: name of the segment.
        markers: those whose places are known.
        places: of these markers (m, 3), metres, in the segment's axes.
        scatter: root mean square distance of each from its place (m,), metres: noise and soft-tissue artefact.
        has_own_pose: True if its markers alone, three or more of them, fix its pose.
        reason: why it has no pose, or "". Its axes are then its parent's, in the mean pose.
        misfit: root mean square distance of its markers from their places in phase 2 of the recording that it was
            fitted to, metres; NaN if that showed it fully in no frame.
    """

    segment: str
    markers: tuple[str, ...]
    places: Floats
    scatter: Floats
    has_own_pose: bool
    reason: str
    misfit: float = float("nan")

    @property
    def has_pose(self) -> bool:
        """True if it has poses, by its markers alone or with a joint."""
        return not self.reason


@dataclass(frozen=True, eq=False)
class JointPlace:
    """A joint, fixed in both of its segments. Places are in metres, NaN where they are not known.

    Attributes:
        joint: as the marker set has it.
        status: its reliability.
        reason: the same in words.
        in_parent: place in the parent's axes (3,).
        in_child: place in the child's axes (3,).
        covariance: of the place in the parent's axes (3, 3), m².
        axis_in_parent: axis of a hinge in the parent's axes (3,); NaN for others.
        axis_in_child: axis of a hinge in the child's axes (3,); NaN for others.
        mean_rotation: of the child in the parent's axes (3, 3).
        trials: names of the recordings that the place comes from, if the calibration is merged from several.
        floor: standard error from skin that no marker shows, metres (see `Estimate`); part of no covariance.
        warnings: reasons why it is unlike any body's joint (see `plausibility`); they do not change its status.
    """

    joint: Joint
    status: JointStatus
    reason: str
    in_parent: Floats
    in_child: Floats
    covariance: Floats
    axis_in_parent: Floats
    axis_in_child: Floats
    mean_rotation: Floats
    trials: tuple[str, ...] = ()
    floor: float = float("nan")
    warnings: tuple[str, ...] = ()

    @property
    def known(self) -> bool:
        """True if its place in both of its segments is known."""
        return not (np.isnan(self.in_parent).any() or np.isnan(self.in_child).any())

    @property
    def standard_error(self) -> float:
        """Largest standard error in the parent's axes, across the axis of a hinge, metres; NaN if unknown."""
        return largest_error(self.covariance, None if np.isnan(self.axis_in_parent).any() else self.axis_in_parent)

    @property
    def accuracy(self) -> tuple[float, float]:
        """Standard error and floor, metres; NaN where they are not known."""
        return self.standard_error, self.floor


@dataclass(frozen=True, eq=False)
class Calibration:
    """The answer of phase 1, as far as phase 2 needs it.

    Attributes:
        source: name of the recording that it was fitted to, or names with commas between them.
        frames: number of frames of these.
        markerset: whose segments and joints they are.
        shapes: of all segments, in the marker set's order.
        joints: all of the marker set's, in its order.
    """

    source: str
    frames: int
    markerset: MarkerSet
    shapes: tuple[SegmentShape, ...]
    joints: tuple[JointPlace, ...]

    def shape(self, segment: str) -> SegmentShape:
        """The shape of a segment (KeyError if there is none)."""
        return {shape.segment: shape for shape in self.shapes}[segment]

    def __getitem__(self, joint: str) -> JointPlace:
        """The joint of a name (KeyError if there is none)."""
        return {place.joint.name: place for place in self.joints}[joint]

    def warnings(self) -> Iterator[str]:
        """Lay out what is unlike any body's, a line for each joint and warning."""
        for place in self.joints:
            yield from (f"{place.joint.name}: warning: {words}" for words in place.warnings)

    def lines(self) -> Iterator[str]:
        """Lay out status, error and floor of each joint as phase 1 found them, in millimetres, then the warnings."""
        rows = [
            (each.joint.name, SHORT_TEXTS[each.status], *(number(1000 * x, ".1f") for x in each.accuracy))
            for each in self.joints
        ]
        yield from columns(map(list, rows), [f"joint in {self.source}", "status", "error / mm", "floor / mm"], "<<>")
        yield from self.warnings()
