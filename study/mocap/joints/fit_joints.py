"""Phase 1: where the joints are, fixed in the segments that meet there, fitted once to a whole recording.

A joint's centre is that of the spheres on which the child's markers move in the parent's frame. From the root outwards:
hips come from the pelvis's own markers, and a hip is the third point of a thigh that has two. Where the child has a
frame of its own, the parent's markers are fitted in that, too, and the point in which both frames agree; the estimate
that knows the place best is taken, and the others are kept beside it, to contradict it if they must.

Source: paper §2, §7; theory §1.2.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from study.mocap.io.recording import Recording
from study.mocap.joints.center import middle_of
from study.mocap.joints.estimates import (
    USABLE,
    Estimate,
    JointStatus,
    from_frames,
    from_spheres,
    marker_from,
)
from study.mocap.joints.segment_poses import Frames, Point, fixed_by, own_frames, own_points, reference_frame
from study.mocap.joints.side_agreement import weighed
from study.mocap.joints.symmetric_fit import two_sided
from study.mocap.markersets.marker_set import Joint, MarkerSet
from study.sphere.types import Bools, Floats, Ints

_THINNED = 300
"""Frames on which errors are traced from joint to joint."""
_ROUNDING = 1e-9
"""Metres."""
_BUILT_ON = (*USABLE, JointStatus.DISAGREE, JointStatus.UNSURE, JointStatus.INSIGNIFICANT)
"""A joint that may serve as the third point of a segment: its errors go with it."""


@dataclass(frozen=True)
class FoundJoint:
    """A joint, or why there is none.

    Attributes:
        joint: as the marker set has it.
        status: what to think of it; ``reason`` says it in words.
        estimate: the one that was taken; ``others``: the other sides' answers.
        in_parent: its place in the parent's axes (3,) and ``in_child`` in the child's, metres; NaN where that segment
            has no frame.
        covariance: of its place (3, 3), m², in the parent's axes, on average over the frames; in the child's, where the
            parent has no frame.
        axis_in_parent: axis of a hinge (3,) in the parent's axes, ``axis_in_child`` in the child's; NaN if none.
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


@dataclass(frozen=True)
class Joints:
    """Phase 1's answer.

    Attributes:
        recording: its name; ``markerset``: which was laid on it.
        frames: of each segment that has any; ``frameless``: why the others have none.
        joints: all of the marker set's, in its order.
    """

    recording: str
    markerset: MarkerSet
    frames: Mapping[str, Frames]
    frameless: Mapping[str, str]
    joints: tuple[FoundJoint, ...]

    def __getitem__(self, name: str) -> FoundJoint:
        """The joint of a name (KeyError if there is none)."""
        return {found.joint.name: found for found in self.joints}[name]


def find_joints(markerset: MarkerSet, recording: Recording) -> Joints:
    """Find all joints of a recording.

    Args:
        markerset: segments and joints; its markers are looked up under their names.
        recording: the same markers; those that are not in it count as never seen (see `match`).
    """
    return _Search(markerset, recording).run()


class _Search:
    """The state of a search: frames and joints found so far."""

    def __init__(self, markerset: MarkerSet, recording: Recording) -> None:
        self.whole, self.markerset, self.recording = markerset, _common(markerset, recording), recording
        self.reference = reference_frame(recording)
        self.frames = own_frames(self.markerset, recording, self.reference)
        self.own = {name for name, frames in self.frames.items() if isinstance(frames, Frames)}
        self.found: dict[str, FoundJoint] = {}
        self.above: dict[str, Estimate] = {}
        """For a segment whose frame hangs on a joint: what is known of that joint."""

    def run(self) -> Joints:
        """Go over the joints, parents first, until no more are found."""
        order = [segment.name for segment in self.markerset.segments]
        waiting = sorted(self.markerset.joints, key=lambda joint: order.index(joint.child))
        while waiting:
            ready = [joint for joint in waiting if isinstance(self.frames[joint.parent], Frames)]
            ready = ready or [joint for joint in waiting if joint.child in self.own]
            if not ready:
                break
            joint = ready[0]
            waiting.remove(joint)
            self.found[joint.name] = self.fit(joint)
            self.extend(joint)
        for joint in waiting:
            why = "; ".join(str(self.frames[name]) for name in (joint.parent, joint.child))
            self.found[joint.name] = FoundJoint(joint, JointStatus.NO_FRAME, f"{JointStatus.NO_FRAME.text} ({why})")
        frames = {name: frame for name, frame in self.frames.items() if isinstance(frame, Frames)}
        without = {name: frame for name, frame in self.frames.items() if isinstance(frame, str)}
        found = tuple(_both_sides(replace(self.found[joint.name], joint=joint), frames) for joint in self.whole.joints)
        return Joints(self.recording.name, self.whole, frames, without, found)

    def fit(self, joint: Joint) -> FoundJoint:
        """A joint from each side that has a frame without it."""
        parent, child = self.frames[joint.parent], self.frames[joint.child] if joint.child in self.own else ""
        found = []
        if isinstance(parent, Frames):
            found.append(self.spheres(joint, "parent", parent, self.markerset.seeing(joint)))
        if isinstance(child, Frames):
            found.append(self.spheres(joint, "child", child, self.markerset.segment(joint.parent).markers))
        if isinstance(parent, Frames) and isinstance(child, Frames):
            found.append(self.pair(joint, parent, child))
        estimates = sorted((each for each in found if each is not None), key=lambda e: (e.status, e.worst))
        if not estimates:
            status = self.why_not(joint)
            return FoundJoint(joint, status, status.text)
        taken, doubt = weighed(estimates[0], estimates[1:])
        return FoundJoint(joint, taken.status, doubt or taken.status.text, taken, tuple(estimates[1:]))

    def why_not(self, joint: Joint) -> JointStatus:
        """Why a joint that has a frame has no estimate."""
        samples = sum(int((~np.isnan(self.recording.of(name)[0])).sum()) for name in self.markerset.seeing(joint))
        return JointStatus.STILL if samples > 3 else JointStatus.UNSEEN

    def spheres(self, joint: Joint, side: str, frames: Frames, names: Sequence[str]) -> Estimate | None:
        """A joint as seen from one of its segments."""
        markers = [marker_from(frames, self.recording.of(name), self.sane(name)) for name in names]
        found = from_spheres(side, frames, names, markers, joint.kind == "hinge") if markers else None
        if found is None or found.sphere is None:
            return None
        hinge, size = found.sphere.axis is not None, 0.0 if found.noise == "none" else None

        def again(moved: Frames, part: Ints) -> Floats | None:
            seen = [marker_from(moved, self.recording.of(name)[:, part], self.sane(name)[part]) for name in names]
            carried = moved.carried if found.noise == "carried" else moved.carried.level
            return middle_of(seen, carried, hinge, size)

        return self.with_errors_above(found, again).judged()

    def pair(self, joint: Joint, parent: Frames, child: Frames) -> Estimate | None:
        """A joint as the point in which both of its frames agree."""
        pair = two_sided(parent, child)
        if pair is None:
            return None

        def again(moved: Frames, part: Ints) -> Floats | None:
            other = two_sided(moved, child.at(part))
            return None if other is None else other.in_parent

        return self.with_errors_above(from_frames(parent, child, pair, joint.kind == "hinge"), again).judged()

    def with_errors_above(self, estimate: Estimate, again: Callable[[Frames, Ints], Floats | None]) -> Estimate:
        """An estimate with what is unknown of the joint on which its frame hangs.

        The joint is moved by its standard errors, one after the other, and what is built on it built ``again``, on
        frames spread over the recording.
        """
        segment = estimate.frames.segment
        if segment not in self.above:
            return estimate
        above = self.above[segment]
        part = np.linspace(0, self.recording.frames - 1, min(self.recording.frames, _THINNED)).astype(int)
        fixed, above = estimate.frames.at(part), replace(above, frames=above.frames.at(part))
        own = [
            Point(each.name, each.x[:, part]) for each in own_points(self.markerset.segment(segment), self.recording)
        ]

        def place(step: Floats) -> Floats:
            points = [_as_point(fixed.points[0], above, step), *own]
            moved = fixed_by(segment, points)
            center = again(moved, part) if isinstance(moved, Frames) else None
            if center is None or not isinstance(moved, Frames):
                return np.full(3, np.nan)
            return fixed.place(moved.show(center))

        values, vectors = np.linalg.eigh(above.covariance)
        start = place(np.zeros(3))
        steps = (vectors * np.sqrt(np.maximum(values, 0.0))).T
        shifts = np.array([place(step) - start if np.abs(step).max() > _ROUNDING else np.zeros(3) for step in steps])
        shifts[np.isnan(shifts)] = 1.0  # a metre: what stands on it falls with it
        return replace(estimate, covariance=estimate.covariance + shifts.T @ shifts)

    def sane(self, marker: str) -> Bools:
        """Samples of a marker that its own segment does not find fault with (frames,)."""
        for frames in self.frames.values():
            if isinstance(frames, Frames) and marker in frames.points:
                return np.asarray(~frames.outliers[frames.points.index(marker)])
        return np.ones(self.recording.frames, dtype=np.bool_)

    def extend(self, joint: Joint) -> None:
        """Give a segment with too few markers a frame, with the joint as one more point."""
        found = self.found[joint.name]
        if found.estimate is None or found.status not in _BUILT_ON:
            return
        point = _as_point(joint.name, found.estimate)
        for name in (joint.child, joint.parent):
            if isinstance(self.frames[name], str):
                points = [point, *own_points(self.markerset.segment(name), self.recording)]
                self.frames[name] = fixed_by(name, points, self.reference)
                self.above[name] = found.estimate


def _common(markerset: MarkerSet, recording: Recording) -> MarkerSet:
    """The marker set without markers that the recording does not have."""
    have = set(recording.markers)

    def there(markers: Sequence[str]) -> tuple[str, ...]:
        return tuple(marker for marker in markers if marker in have)

    segments = tuple(s.model_copy(update={"markers": there(s.markers)}) for s in markerset.segments)
    joints = tuple(j.model_copy(update={"markers": there(markerset.seeing(j))}) for j in markerset.joints)
    return markerset.model_copy(update={"segments": segments, "joints": joints})


def _as_point(name: str, estimate: Estimate, step: Floats | float = 0.0) -> Point:
    """A joint as a point of another segment's frame, perhaps moved by a step (3,) in the axes that it is fixed in."""
    place, frames = estimate.center + step, estimate.frames
    return Point(name, frames.show(place), frames.carry(place, estimate.covariance))


def _both_sides(found: FoundJoint, frames: Mapping[str, Frames]) -> FoundJoint:
    """A joint with its place, and the axis of a hinge, in both segments' axes."""
    estimate = found.estimate
    if estimate is None:
        return found
    x = estimate.frames.show(estimate.center)
    places = {segment: np.full(3, np.nan) for segment in (found.joint.parent, found.joint.child)}
    for segment in places.keys() & frames.keys():
        places[segment] = frames[segment].place(x)
    places[estimate.frames.segment] = estimate.center
    covariance, parent = estimate.covariance, found.joint.parent
    if estimate.side == "child" and parent in frames:
        covariance = _seen_from(frames[parent], estimate.frames, covariance)
    axes = np.full((2, 3), np.nan)
    if estimate.axis is not None:
        own = 1 if estimate.side == "child" else 0
        axes[own] = estimate.axis
        if parent in frames and found.joint.child in frames:
            two = frames[parent], frames[found.joint.child]
            # turns show an axis better than the planes of a few markers' arcs; but errors are across that of the answer
            pair = None if found.status == JointStatus.DISAGREE else two_sided(*two)
            axes = axes if pair is None else pair.axes
            axes[1 - own] = _turned(two[own], two[1 - own], axes[own]) if pair is None else axes[1 - own]
    return replace(
        found, in_parent=places[found.joint.parent], in_child=places[found.joint.child],
        covariance=covariance, axis_in_parent=axes[0], axis_in_child=axes[1],
    )  # fmt: skip


def _turned(one: Frames, other: Frames, axis: Floats) -> Floats:
    """A direction in one frame's axes (3,) as it is in another's, on average over the frames."""
    both = one.known & other.known
    mean = np.einsum("jit,jkt,k->i", other.rotation[:, :, both], one.rotation[:, :, both], axis, optimize=True)
    length = np.linalg.norm(mean)
    return mean / length if length > 0.0 else np.full(3, np.nan)


def _seen_from(parent: Frames, child: Frames, covariance: Floats) -> Floats:
    """A covariance in the child's axes as it is in the parent's, on average over the frames."""
    both = parent.known & child.known
    if not both.any():
        return covariance
    turns = np.einsum("jit,jkt->ikt", parent.rotation[:, :, both], child.rotation[:, :, both])
    return np.asarray(np.einsum("ijt,jk,lkt->il", turns, covariance, turns, optimize=True) / both.sum())
