"""Phase 1: fit all joints of a body to a whole recording, each fixed in the two segments that meet there.

The answer is each joint's place and axis in both of its segments, or the reason why there is none. A joint is the
centre of the spheres on which the child's markers move in the parent's axes. Joints are fitted from the root outwards:
hips come from the pelvis's own markers, and a hip is the third point of a thigh that has two. Where the child has poses
of its own, the parent's markers are fitted in the child's axes, too, and so is the point in which both segments agree.
The estimate with the best status and the smallest standard error is chosen; the others are compared with it.

Source: paper §2, §7; theory §1.2.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from study.arrays import Bools, Floats, Ints
from study.recordings.joints.center import center_only
from study.recordings.joints.estimate import (
    COMPARABLE,
    DOUBTED,
    USABLE,
    Estimate,
    JointStatus,
    Side,
    WayDifference,
    check_against_sides,
    check_both_ways,
    estimate_from_poses,
    estimate_from_spheres,
    largest_error,
    local_marker,
)
from study.recordings.joints.poses import (
    PosePoint,
    SegmentPoses,
    fit_poses,
    marker_points,
    poses_from_markers,
    reference_frame,
)
from study.recordings.joints.skin import SkinErrors
from study.recordings.joints.symmetric import symmetric_fit
from study.recordings.markersets import Joint, MarkerSet
from study.recordings.recording import Recording
from study.recordings.rigid import mean_rotated_covariance, relative_rotation


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


_FRAMES = 300
"""Frames on which errors are propagated from joint to joint."""
_ROUNDING = 1e-9
"""Metres."""
_BUILT_ON = (*USABLE, *DOUBTED, JointStatus.UNSURE, JointStatus.INSIGNIFICANT)
"""A joint that may be the third point of a segment's pose; its errors are propagated."""


def find_joints(markerset: MarkerSet, recording: Recording) -> FoundJoints:
    """Find all joints of a recording.

    Args:
        markerset: segments and joints; its markers are looked up under their names.
        recording: the same markers; those that it lacks count as always missing (see `match`).
    """
    return _Search(markerset, recording).run()


class _Search:
    """Poses and joints found so far."""

    def __init__(self, markerset: MarkerSet, recording: Recording) -> None:
        self.whole, self.markerset, self.recording = markerset, _without_missing(markerset, recording), recording
        self.reference = reference_frame(recording)
        self.poses = poses_from_markers(self.markerset, recording, self.reference)
        own = {name: poses for name, poses in self.poses.items() if isinstance(poses, SegmentPoses)}
        self.skin = SkinErrors(recording, own)
        self.own = set(own)
        self.found: dict[str, FoundJoint] = {}
        self.rests_on: dict[str, Estimate] = {}
        """For a segment whose poses are fitted to a joint: the estimate of that joint."""

    def run(self) -> FoundJoints:
        """Fit the joints, parents first, until no more can be fitted."""
        order = [segment.name for segment in self.markerset.segments]
        waiting = sorted(self.markerset.joints, key=lambda joint: order.index(joint.child))
        while waiting:
            ready = [joint for joint in waiting if isinstance(self.poses[joint.parent], SegmentPoses)]
            ready = ready or [joint for joint in waiting if joint.child in self.own]
            if not ready:
                break
            joint = ready[0]
            waiting.remove(joint)
            self.found[joint.name] = self.fit(joint)
            self.complete_segments(joint)
        for joint in waiting:
            why = "; ".join(self.why_no_own_pose(name) for name in (joint.parent, joint.child))
            self.found[joint.name] = FoundJoint(joint, JointStatus.NO_FRAME, f"{JointStatus.NO_FRAME.text} ({why})")
        poses = {name: each for name, each in self.poses.items() if isinstance(each, SegmentPoses)}
        without = {name: each for name, each in self.poses.items() if isinstance(each, str)}
        found = (replace(self.found[joint.name], joint=joint) for joint in self.whole.joints)
        joints = tuple(in_both_segments(each, poses) for each in found)
        return FoundJoints(self.recording.name, self.whole, poses, without, joints)

    def fit(self, joint: Joint) -> FoundJoint:
        """Fit a joint from each side that has poses without it, and choose among the estimates."""
        parent, child = self.poses[joint.parent], self.poses[joint.child] if joint.child in self.own else ""
        found = []
        if isinstance(parent, SegmentPoses):
            found.append(self.fit_spheres(joint, "parent", parent, self.markerset.markers_for(joint)))
        if isinstance(child, SegmentPoses):
            found.append(self.fit_spheres(joint, "child", child, self.markerset.segment(joint.parent).markers))
        if isinstance(parent, SegmentPoses) and isinstance(child, SegmentPoses):
            found.append(self.fit_pair(joint, parent, child))
        estimates = sorted((e for e in found if e is not None), key=lambda e: (e.status, e.standard_error))
        if not estimates:
            status = self.reason_without_estimate(joint)
            return FoundJoint(joint, status, status.text)
        chosen, sides = check_against_sides(estimates[0], estimates[1:])
        chosen, ways = check_both_ways(chosen, self.turning_ways(joint, estimates))
        chosen = chosen.placed_along_axis(_midway(joint, self.recording))
        chosen = chosen.as_ball() if joint.kind == "ball" else chosen
        own = sides or ("" if chosen.status in (*USABLE, JointStatus.REVERSES) else chosen.status.text)
        reason = "; ".join(filter(None, (own, ways))) or chosen.status.text
        return FoundJoint(joint, chosen.status, reason, chosen, tuple(estimates[1:]))

    def turning_ways(self, joint: Joint, estimates: Sequence[Estimate]) -> list[WayDifference]:
        """Differences between bending and straightening, by the estimate in the first one's axes that shows most."""
        child, found = self.poses[joint.child], []
        for each in estimates:
            if each.poses is estimates[0].poses and each.status in COMPARABLE:
                two = child if each.side == "both" and isinstance(child, SegmentPoses) else None
                found.append(self.skin.ways(each, joint, two))
        return max(found, key=lambda ways: sum(way.distance for way in ways if way.contradicts), default=[])

    def reason_without_estimate(self, joint: Joint) -> JointStatus:
        """Status of a joint that has poses but no estimate."""
        samples = sum(int((~np.isnan(self.recording.of(name)[0])).sum()) for name in self.markerset.markers_for(joint))
        return JointStatus.STILL if samples > 3 else JointStatus.UNSEEN

    def why_no_own_pose(self, segment: str) -> str:
        """Reason, in words, why a segment has no pose of its own."""
        poses = self.poses[segment]
        return f"{segment} has one only by the joint {poses.points[0]}" if isinstance(poses, SegmentPoses) else poses

    def fit_spheres(self, joint: Joint, side: Side, poses: SegmentPoses, names: Sequence[str]) -> Estimate | None:
        """Fit a joint to markers in the axes of one of its segments."""
        markers = [local_marker(poses, self.recording.of(name), self.accepted(name)) for name in names]
        found = estimate_from_spheres(side, poses, names, markers, joint.kind == "hinge") if markers else None
        if found is None or found.sphere is None:
            return None
        hinge, size = found.sphere.axis is not None, 0.0 if found.noise == "none" else None

        def refit(moved: SegmentPoses, part: Ints) -> Floats | None:
            some = [local_marker(moved, self.recording.of(name)[:, part], self.accepted(name)[part]) for name in names]
            noise = moved.noise if found.noise == "pose" else moved.noise.removed
            return center_only(some, noise, hinge, size)

        return self.skin.add(self.with_propagated_errors(found, refit), joint, None).with_status()

    def fit_pair(self, joint: Joint, parent: SegmentPoses, child: SegmentPoses) -> Estimate | None:
        """Fit a joint as the point in which both of its segments agree."""
        pair = symmetric_fit(parent, child)
        if pair is None:
            return None

        def refit(moved: SegmentPoses, part: Ints) -> Floats | None:
            other = symmetric_fit(moved, child.in_frames(part))
            return None if other is None else other.in_parent

        found = estimate_from_poses(parent, child, pair, joint.kind == "hinge")
        return self.skin.add(self.with_propagated_errors(found, refit), joint, child).with_status()

    def with_propagated_errors(
        self, estimate: Estimate, refit: Callable[[SegmentPoses, Ints], Floats | None]
    ) -> Estimate:
        """Add to an estimate's covariance the errors of the joint that its segment's poses are fitted to.

        That joint is moved by its standard errors, one principal direction after the other, and ``refit`` repeats the
        fit with the poses that follow, on frames spread over the recording.
        """
        segment = estimate.poses.segment
        if segment not in self.rests_on:
            return estimate
        base = self.rests_on[segment]
        part = np.linspace(0, self.recording.frames - 1, min(self.recording.frames, _FRAMES)).astype(int)
        fixed, base = estimate.poses.in_frames(part), replace(base, poses=base.poses.in_frames(part))
        markers = marker_points(self.markerset.segment(segment), self.recording)
        own = [PosePoint(each.name, each.x[:, part]) for each in markers]

        def place(step: Floats) -> Floats:
            moved = fit_poses(segment, [_as_point(fixed.points[0], base, step), *own])
            center = refit(moved, part) if isinstance(moved, SegmentPoses) else None
            if center is None or not isinstance(moved, SegmentPoses):
                return np.full(3, np.nan)
            return fixed.mean_place(moved.to_world(center))

        values, vectors = np.linalg.eigh(base.covariance)
        start = place(np.zeros(3))
        sizes = np.maximum(np.sqrt(np.maximum(values, 0.0)), _ROUNDING)
        shifts = np.array([place(step) - start for step in (vectors * sizes).T])
        shifts[np.isnan(shifts)] = 1.0  # a metre: a joint whose fit fails when its base moves is not known
        follows = shifts.T @ (vectors / sizes).T  # shift of the joint per shift of its base
        covariance = estimate.covariance + follows @ base.covariance @ follows.T
        return replace(estimate, covariance=covariance, skin=estimate.skin + follows @ base.skin @ follows.T)

    def accepted(self, marker: str) -> Bools:
        """Samples of a marker (frames,) that are no outliers in its own segment."""
        for poses in self.poses.values():
            if isinstance(poses, SegmentPoses) and marker in poses.points:
                return np.asarray(~poses.outliers[poses.points.index(marker)])
        return np.ones(self.recording.frames, dtype=np.bool_)

    def complete_segments(self, joint: Joint) -> None:
        """Fit the poses of segments with too few markers, with the joint as one more point."""
        found = self.found[joint.name]
        if found.estimate is None or found.status not in _BUILT_ON:
            return
        point = _as_point(joint.name, found.estimate)
        for name in (joint.child, joint.parent):
            if isinstance(self.poses[name], str):
                points = [point, *marker_points(self.markerset.segment(name), self.recording)]
                self.poses[name] = fit_poses(name, points, self.reference)
                self.rests_on[name] = found.estimate


def _midway(joint: Joint, recording: Recording) -> Floats:
    """Middle (3, frames) of the points between which a hinge lies; NaN where they are missing."""
    points = [recording.of(name) for name in joint.across if name in recording.markers]
    return 0.5 * (points[0] + points[1]) if len(points) == 2 else np.full((3, recording.frames), np.nan)


def _without_missing(markerset: MarkerSet, recording: Recording) -> MarkerSet:
    """The marker set without the markers that the recording lacks."""
    have = set(recording.markers)

    def present(markers: Sequence[str]) -> tuple[str, ...]:
        return tuple(marker for marker in markers if marker in have)

    segments = tuple(s.model_copy(update={"markers": present(s.markers)}) for s in markerset.segments)
    joints = tuple(j.model_copy(update={"markers": present(markerset.markers_for(j))}) for j in markerset.joints)
    return markerset.model_copy(update={"segments": segments, "joints": joints})


def _as_point(name: str, estimate: Estimate, step: Floats | float = 0.0) -> PosePoint:
    """A joint as a point of a segment's pose, moved by a step (3,) in the axes of its estimate."""
    place, poses = estimate.center + step, estimate.poses
    # the joint's own error is the same in every frame, so that it is no noise of the pose; it is propagated apart
    return PosePoint(name, poses.to_world(place), poses.world_covariance(place))
