"""Phase 1: fit all joints of a body to a whole recording, each fixed in the two segments that meet there.

The answer is each joint's place and axis in both of its segments, or the reason why there is none. A joint is the
centre of the spheres on which the child's markers move in the parent's axes. Joints are fitted from the root outwards:
hips come from the pelvis's own markers, and a hip is the third point of a thigh that has two. Where the child has poses
of its own, the parent's markers are fitted in the child's axes, too, and so is the point in which both segments agree.
The estimate with the best status and the smallest standard error is chosen; the others are compared with it.

Source: paper §2, §7; theory §1.2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from study.arrays import Bools, Floats, Ints
from study.recordings.joints.calibration import Calibration, JointPlace, SegmentShape
from study.recordings.joints.center import center_only
from study.recordings.joints.estimate import (
    COMPARABLE,
    DOUBTED,
    USABLE,
    Estimate,
    JointStatus,
    Side,
    check_against_sides,
    check_both_ways,
    estimate_from_poses,
    estimate_from_spheres,
    local_marker,
    symmetric_fit,
)
from study.recordings.joints.poses import SegmentPoses, exchanged_labels, fit_poses, poses_from_markers, reference_frame
from study.recordings.joints.skin import SkinErrors
from study.recordings.markersets import Joint, MarkerSet
from study.recordings.recording import Recording
from study.recordings.rigid import mean_rotated_covariance, nearest_rotation, relative_rotation

_FRAMES = 300
"""Frames on which errors are propagated from joint to joint."""
_ROUNDING = 1e-9
"""Metres."""
_BUILT_ON = (*USABLE, *DOUBTED, JointStatus.UNSURE, JointStatus.INSIGNIFICANT)
"""A joint that may be the third point of a segment's pose; its errors are propagated."""


def find_joints(markerset: MarkerSet, recording: Recording) -> Calibration:
    """Find all joints of a recording.

    Args:
        markerset: segments and joints; its markers are looked up under their names.
        recording: the same markers; those that it lacks count as always missing (see `match`).

    Returns:
        The calibration, without misfits of shapes and warnings (see `calibrate`), with the poses of the segments.
    """
    with threadpool_limits(1, user_api="blas"):  # threads take longer to start than such small products
        body = _Body(markerset, recording)
        answers = {place.joint.name: place for place in _from_the_root(body)}
        places = (replace(answers[joint.name], joint=joint) for joint in markerset.joints)
        poses = {name: poses for name, poses in body.poses.items() if isinstance(poses, SegmentPoses)}
        exchanges = {s.name: exchange(s.markers, recording) for s in markerset.segments}
        joints = tuple(_with_exchanges(in_both_segments(place, poses), exchanges) for place in places)
        shapes = tuple(_shape(segment.name, body, joints) for segment in markerset.segments)
    return Calibration(recording.name, recording.frames, markerset, shapes, joints, poses)


def exchange(markers: Sequence[str], recording: Recording) -> str:
    """The words about two markers of a segment that exchange their labels in a recording, and the remedy; or ""."""
    names = [marker for marker in markers if marker in recording.markers]
    if len(names) < 3:
        return ""
    exchanged = exchanged_labels(np.stack([recording.of(name) for name in names]))
    if exchanged is None:
        return ""
    one, two, frames = exchanged
    return (
        f"{names[one]} and {names[two]} exchange their labels in {frames.mean():.0%} of the frames, first in frame "
        f"{int(frames.argmax()) + 1}: exchange them back where the markers are labelled, or leave these frames out"
    )


def _with_exchanges(place: JointPlace, exchanges: Mapping[str, str]) -> JointPlace:
    """Doubt a joint if markers of its segments exchange their labels, and say which."""
    words = [words for name in (place.joint.parent, place.joint.child) if (words := exchanges[name])]
    if not words:
        return place
    if place.usable:
        return replace(place, status=JointStatus.UNSURE, reason="; ".join(words))
    return replace(place, reason="; ".join([*words, place.reason]))


class _Body:
    """Poses of a body's segments, as far as they are known.

    Attributes:
        markerset: without the markers that the recording lacks.
        recording: with the markers.
        poses: of each segment, or the reason why it has none.
        own: segments whose own markers fix their poses.
        skin: of these.
        rests_on: for a segment whose poses are fitted to a joint, too, the estimate of that joint.
    """

    def __init__(self, markerset: MarkerSet, recording: Recording) -> None:
        self.markerset, self.recording = _without_missing(markerset, recording), recording
        self.reference = reference_frame(recording)
        self.poses = poses_from_markers(self.markerset, recording, self.reference)
        own = {name: poses for name, poses in self.poses.items() if isinstance(poses, SegmentPoses)}
        self.own, self.skin = set(own), SkinErrors(recording, own)
        self.rests_on: dict[str, Estimate] = {}

    def accepted(self, marker: str) -> Bools:
        """Samples of a marker (frames,) that are no outliers in its own segment."""
        for poses in self.poses.values():
            if isinstance(poses, SegmentPoses) and marker in poses.points:
                return np.asarray(~poses.outliers[poses.points.index(marker)])
        return np.ones(self.recording.frames, dtype=np.bool_)

    def complete(self, joint: Joint, estimate: Estimate) -> None:
        """Fit the poses of a joint's segments that have too few markers, with the joint as one more point."""
        for name in (joint.child, joint.parent):
            if isinstance(self.poses[name], str):
                self.rests_on[name] = estimate
                self.poses[name] = self.about_joint(name, joint.name, estimate, slice(None))

    def about_joint(
        self, segment: str, joint: str, base: Estimate, frames: Ints | slice, step: Floats | float = 0.0
    ) -> SegmentPoses | str:
        """Fit a segment's poses to its markers and a joint, moved by a step (3,) in the axes of its estimate.

        The joint's own error is the same in every frame, so that it is no noise of the pose; it is propagated apart.
        """
        place, poses, markers = base.center + step, base.poses, self.markerset.segment(segment).markers
        x = [poses.to_world(place), *(self.recording.of(marker)[:, frames] for marker in markers)]
        return fit_poses(segment, [joint, *markers], x, poses.world_covariance(place), self.reference)


def _from_the_root(body: _Body) -> list[JointPlace]:
    """Fit the joints, parents first, until no more can be fitted; their places in both segments are still open."""
    order = [segment.name for segment in body.markerset.segments]
    waiting = sorted(body.markerset.joints, key=lambda joint: order.index(joint.child))
    answers = []
    while waiting:
        ready = [joint for joint in waiting if isinstance(body.poses[joint.parent], SegmentPoses)]
        ready = ready or [joint for joint in waiting if joint.child in body.own]
        if not ready:
            break
        joint = ready[0]
        waiting.remove(joint)
        answers.append(_fit(joint, body))
        estimate = answers[-1].estimate
        if estimate is not None and estimate.status in _BUILT_ON:
            body.complete(joint, estimate)
    for joint in waiting:
        whys = []
        for name in (joint.parent, joint.child):
            poses = body.poses[name]
            whys.append(poses if isinstance(poses, str) else f"{name} has one only by the joint {poses.points[0]}")
        reason = f"{JointStatus.NO_FRAME.text} ({'; '.join(whys)})"
        answers.append(JointPlace(joint, JointStatus.NO_FRAME, reason))
    return answers


def _fit(joint: Joint, body: _Body) -> JointPlace:
    """Fit a joint from each side that has poses without it, and choose among the estimates."""
    parent = body.poses[joint.parent]
    child = body.poses[joint.child] if joint.child in body.own else ""
    estimates: list[Estimate | None] = []
    if isinstance(parent, SegmentPoses):
        estimates.append(_from_spheres(joint, "parent", parent, body))
    if isinstance(child, SegmentPoses):
        estimates.append(_from_spheres(joint, "child", child, body))
    if isinstance(parent, SegmentPoses) and isinstance(child, SegmentPoses):
        pair = symmetric_fit(parent, child)
        estimates.append(None if pair is None else estimate_from_poses(parent, pair, joint.kind == "hinge"))
    with_errors = (_with_errors(estimate, joint, body) for estimate in estimates if estimate is not None)
    ranked = sorted(with_errors, key=lambda estimate: (estimate.status, estimate.standard_error))
    if not ranked:
        samples = sum(int((~np.isnan(body.recording.of(name)[0])).sum()) for name in body.markerset.markers_for(joint))
        status = JointStatus.STILL if samples > 3 else JointStatus.UNSEEN
        return JointPlace(joint, status, status.text)
    chosen, sides = check_against_sides(ranked[0], ranked[1:])
    # of the estimates in the first one's axes, the one in which bending and straightening differ most
    one_frame = (e for e in ranked if e.poses is ranked[0].poses and e.status in COMPARABLE)
    ways = [body.skin.ways(estimate, joint) for estimate in one_frame]
    most = max(ways, key=lambda two: sum(way.distance for way in two if way.contradicts), default=[])
    chosen, reverses = check_both_ways(chosen, most)
    chosen = chosen.placed_along_axis(_midway(joint, body.recording))
    if joint.kind == "ball" and chosen.status == JointStatus.HINGE:  # a hinge is not reliable along its axis
        chosen = replace(chosen, status=JointStatus.ONE_AXIS)
    own = sides or ("" if chosen.status in (*USABLE, JointStatus.REVERSES) else chosen.status.text)
    reason = "; ".join(filter(None, (own, reverses))) or chosen.status.text
    return JointPlace(joint, chosen.status, reason, floor=chosen.floor, estimates=(chosen, *ranked[1:]))


def _from_spheres(joint: Joint, side: Side, poses: SegmentPoses, body: _Body) -> Estimate | None:
    """Fit a joint to markers in the axes of one of its segments."""
    names = body.markerset.markers_for(joint) if side == "parent" else body.markerset.segment(joint.parent).markers
    markers = [local_marker(poses, body.recording.of(name), body.accepted(name)) for name in names]
    return estimate_from_spheres(side, poses, names, markers, joint.kind == "hinge") if markers else None


def _with_errors(estimate: Estimate, joint: Joint, body: _Body) -> Estimate:
    """Add to an estimate the errors of the joint that its poses rest on and those from skin, and set its status."""
    return body.skin.add(_with_propagated_errors(estimate, body), joint).with_status()


def _with_propagated_errors(estimate: Estimate, body: _Body) -> Estimate:
    """Add to an estimate's covariance the errors of the joint that its segment's poses are fitted to.

    That joint is moved by its standard errors, one principal direction after the other, and the fit is repeated with
    the poses that follow, on frames spread over the recording.
    """
    segment = estimate.poses.segment
    if segment not in body.rests_on:
        return estimate
    base = body.rests_on[segment]
    part = np.linspace(0, body.recording.frames - 1, min(body.recording.frames, _FRAMES)).astype(int)
    fixed, base = estimate.poses.in_frames(part), replace(base, poses=base.poses.in_frames(part))
    values, vectors = np.linalg.eigh(base.covariance)
    sizes = np.maximum(np.sqrt(np.maximum(values, 0.0)), _ROUNDING)
    places = []
    for step in (np.zeros(3), *(vectors * sizes).T):
        moved = body.about_joint(segment, fixed.points[0], base, part, step)
        place = np.full(3, np.nan)
        if isinstance(moved, SegmentPoses):
            center = _repeated(estimate, moved, part, body)
            place = place if center is None else fixed.mean_place(moved.to_world(center))
        places.append(place)
    shifts = np.array(places[1:]) - places[0]
    shifts[np.isnan(shifts)] = 1.0  # a metre: a joint whose fit fails when its base moves is not known
    follows = shifts.T @ (vectors / sizes).T  # shift of the joint per shift of its base
    covariance = estimate.covariance + follows @ base.covariance @ follows.T
    return replace(estimate, covariance=covariance, skin=estimate.skin + follows @ base.skin @ follows.T)


def _repeated(estimate: Estimate, poses: SegmentPoses, part: Ints, body: _Body) -> Floats | None:
    """The centre (3,) of an estimate with other poses of its segment, in these frames; None if the fit fails."""
    if estimate.pair is not None:
        pair = symmetric_fit(poses, estimate.pair.child.in_frames(part))
        return None if pair is None else pair.in_parent
    names, recording = estimate.markers, body.recording
    markers = [local_marker(poses, recording.of(name)[:, part], body.accepted(name)[part]) for name in names]
    noise = poses.noise if estimate.noise == "pose" else poses.noise.removed
    hinge = estimate.sphere is not None and estimate.sphere.axis is not None
    return center_only(markers, noise, hinge, 0.0 if estimate.noise == "none" else None)


def in_both_segments(place: JointPlace, poses: Mapping[str, SegmentPoses]) -> JointPlace:
    """Add a joint's place, the axis of a hinge, and the mean rotation in both segments' axes."""
    estimate, parent, child = place.estimate, poses.get(place.joint.parent), poses.get(place.joint.child)
    rotation, axes = np.eye(3), np.full((2, 3), np.nan)
    if parent is not None and child is not None:
        both = parent.known & child.known
        if both.any():
            total = np.einsum("jit,jkt->ik", parent.rotation[:, :, both], child.rotation[:, :, both])
            rotation = nearest_rotation(total)
    if estimate is None:
        return replace(place, mean_rotation=rotation)
    x = estimate.poses.to_world(estimate.center)
    own = 1 if estimate.side == "child" else 0
    places = [np.full(3, np.nan) if one is None else one.mean_place(x) for one in (parent, child)]
    places[own] = estimate.center
    if child is None:  # its axes are the parent's
        places[1] = places[0]
    covariance = estimate.covariance
    if own == 1 and parent is not None:
        both = parent.known & estimate.poses.known
        if both.any():
            relative = relative_rotation(parent.rotation[:, :, both], estimate.poses.rotation[:, :, both])
            covariance = mean_rotated_covariance(relative, covariance)
    if estimate.axis is not None:
        axes[own] = estimate.axis
        if parent is not None and child is not None:
            # rotations show an axis better than the planes of a few arcs; but errors are across the estimate's own axis
            pair = next((e.pair for e in place.estimates if e.pair is not None), None) or symmetric_fit(parent, child)
            pair = None if place.status == JointStatus.DISAGREE else pair
            if pair is None:
                axes[1 - own] = _axis_in_other((parent, child)[own], (parent, child)[1 - own], axes[own])
            else:
                axes = pair.axes
    return replace(
        place,
        in_parent=places[0],
        in_child=places[1],
        covariance=covariance,
        axis_in_parent=axes[0],
        axis_in_child=axes[1],
        mean_rotation=rotation,
    )


def _axis_in_other(one: SegmentPoses, other: SegmentPoses, axis: Floats) -> Floats:
    """Mean direction in one segment's axes of a direction (3,) in another's."""
    both = one.known & other.known
    mean = np.einsum("jit,jkt,k->i", other.rotation[:, :, both], one.rotation[:, :, both], axis, optimize=True)
    length = np.linalg.norm(mean)
    return mean / length if length > 0.0 else np.full(3, np.nan)


def _shape(name: str, body: _Body, joints: Sequence[JointPlace]) -> SegmentShape:
    """Shape of a segment in its own axes; of one without poses, in its parent's.

    Each marker of the latter is at its median radius and direction from the joint that the segment rotates about.
    """
    poses, recording = body.poses[name], body.recording
    own = body.markerset.segment(name).markers
    if isinstance(poses, SegmentPoses):
        rows = [k for k, point in enumerate(poses.points) if point in own]
        markers = tuple(poses.points[k] for k in rows)
        return SegmentShape(
            name, markers, poses.template[rows], poses.scatter[rows], rows == [*range(len(poses.points))], ""
        )
    above = next((place for place in joints if place.joint.child == name), None)
    parent = None if above is None else body.poses[above.joint.parent]
    names, places, scatter = [], [], []
    if above is not None and isinstance(parent, SegmentPoses) and not np.isnan(above.in_parent).any():
        for marker in own:
            away = parent.to_local(recording.of(marker)) - above.in_parent[:, None]
            away = away[:, ~np.isnan(away[0])]
            direction = np.median(away, axis=1) if away.shape[1] > 1 else np.zeros(3)
            if np.linalg.norm(direction) > 0.0:
                distance = np.linalg.norm(away, axis=0)
                radius = float(np.median(distance))
                names.append(marker)
                places.append(above.in_parent + radius * direction / np.linalg.norm(direction))
                scatter.append(1.4826 * float(np.median(np.abs(distance - radius))))
    return SegmentShape(name, tuple(names), np.array(places).reshape(-1, 3), np.array(scatter), False, poses)


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
