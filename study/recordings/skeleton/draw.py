"""Phase 2: draw a skeleton in every frame, from a calibration and the markers that are seen.

A segment with three spread markers has its own pose, by Kabsch's fit. Each marker is judged by this fit: one that is
far from its place, such as a swapped one, is rejected and the rest are fitted again. The joint does not enter, because
in a moving body the parent's place of a joint and the child's are up to centimetres apart. This vector is the joint's
gap, J_Q - J_P. Skin causes it, and a joint that is no exact pivot.

A segment with fewer markers is fitted to these and to its joint, J(t) = o_P(t) + R_P(t) c_J, weighted by 1/σ² of each.
In frames that do not show the parent, the joints that its other neighbours show take part. The gap of a joint is added,
interpolated from the frames that show it, so that nothing leaps where markers come and go.

In a frame with too few points, those that are left are weighed against the rotation that is expected there, by the
points' errors and by the covariance of the expected rotation. So a joint that is not known well, or a marker close to
one, hardly turns a segment.

Where too few markers are seen, but a joint of the segment or one of its markers is, its rotation is interpolated over
the gap, for a while, and it is flagged as bridged. The covariance of this rotation is that of the same interpolation
over gaps as long in frames that are seen. Where nothing shows a segment it is unknown, and so is a joint that neither
of its segments shows, or whose error is too large.

Time is proportional to the number of segments.

Source: paper §10 (second phase); theory §1.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from study.arrays import Bools, Bytes, Floats, Ints
from study.fits.loops.jit import compiled, squared
from study.fits.points.samples import Worded
from study.recordings.joints.estimate import ANATOMICAL, USABLE, JointStatus
from study.recordings.joints.find import Calibration, JointPlace, SegmentShape
from study.recordings.joints.poses import PoseNoise
from study.recordings.markersets import Joint, Segment
from study.recordings.recording import Recording, RecordingError
from study.recordings.rigid import best_rotation, fit_poses_to, skew, to_world
from study.recordings.skeleton.between import Gap, InterpolatedRotation, remove_leaps

_FAR = 6.0
"""Scatters from its place beyond which a marker is rejected..."""
_SLACK = 0.1
"""...if it is also this share of its segment's size away."""
_PIVOTS = (*USABLE, *ANATOMICAL, JointStatus.UNSURE, JointStatus.INSIGNIFICANT)
"""A joint that helps to place a segment whose own markers can fix its pose; a doubted one does not."""
_SOFT = 0.001
"""Metres: least standard deviation of a marker's place, where it is weighed against a joint's."""
_IMPLAUSIBLE = 6.0
"""Square misfit of a frame over the mean above which the pose's variance grows with it: noise does so in < 0.1 %."""
_LEAST_WEIGHT = 0.01
"""Least weight of a joint beside markers of weight 1: it decides what these leave open, and hardly moves the rest."""
_LEAST_SHARE = 0.002
"""Least weight of the expected rotation beside the points' extent, so that it decides what these leave open."""
_EXACT = 1e-12
"""Square radians: least variance of an expected rotation."""
_SPREAD = 0.3
"""Radians: standard deviation of an expected rotation whose error is not known."""
_ARM = 3.0
"""Distance from a joint, in the joint's standard errors, from which on a marker shows a direction."""
LARGEST_ERROR = 0.05
"""Metres: standard error above which a joint is unknown, if no other is given."""
_SURE = 0.01
"""Metres: standard error of a segment's joints up to which its neighbours place it."""
_POSE = 0.005
"""Metres: what the pose of the segment that shows a joint adds to its standard error."""


class Flag(Worded):
    """Source of a joint's place in one frame."""

    SEEN = 0, "from markers"
    BRIDGED = 1, "bridged: too few markers seen"
    UNKNOWN = 2, "unknown"


def complete_poses(
    places: Floats, x: Floats, weights: Floats, expected: Floats, sure: Floats
) -> tuple[Floats, Floats, Floats]:
    """Complete a segment's poses in frames that show too few of its points, with rotations that are expected.

    Minimises Σ w |x - R p - o|² + s |R - R₀|², which is Kabsch's fit to Σ w (x - x̄)(p - p̄)ᵀ + s R₀.

    Args:
        places: p of its points in its axes (m, 3), metres.
        x: the points in the world (m, 3, n), metres; NaN where missing.
        weights: w of the points (m,), 1/m².
        expected: R₀, rotations that are expected (3, 3, n).
        sure: s of these (n,), ½/σ² for a standard deviation of σ radians about each axis.

    Returns:
        Rotations (3, 3, n); origins (3, n), metres, NaN where no point is seen; and p̄, the weighted middle of the
        places that are seen (3, n).
    """
    rotation, origin, middle = np.array(expected, order="C"), np.full((3, len(sure)), np.nan), np.zeros((3, len(sure)))
    _complete_poses(places, x, weights, sure, rotation, origin, middle)
    return rotation, origin, middle


@compiled
def _complete_poses(
    places: Floats, x: Floats, weights: Floats, sure: Floats, rotation: Floats, origin: Floats, middle: Floats
) -> None:
    """Compiled part of `complete_poses`: rotates the expected rotations in place."""
    b, r = np.empty(3), np.empty((3, 3))
    cross, cofactors, scratch = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for t in range(x.shape[2]):
        total, extent, a = 0.0, 0.0, middle[:, t]
        b[:] = 0.0
        for k in range(x.shape[0]):
            if x[k, 0, t] == x[k, 0, t]:
                total += weights[k]
                for i in range(3):
                    a[i] += weights[k] * places[k, i]
                    b[i] += weights[k] * x[k, i, t]
        if not total > 0.0:
            continue
        for i in range(3):
            a[i], b[i] = a[i] / total, b[i] / total
        cross[:] = 0.0
        for k in range(x.shape[0]):
            if x[k, 0, t] == x[k, 0, t]:
                for i in range(3):
                    extent += weights[k] * squared(places[k, i] - a[i])
                    for j in range(3):
                        cross[i, j] += weights[k] * (x[k, i, t] - b[i]) * (places[k, j] - a[j])
        share = max(sure[t], _LEAST_SHARE * extent)
        for i in range(3):
            for j in range(3):
                cross[i, j] += share * rotation[i, j, t]
        if extent > 0.0 and best_rotation(cross, cofactors, scratch, r):
            rotation[:, :, t] = r
        for i in range(3):
            origin[i, t] = b[i] - rotation[i, 0, t] * a[0] - rotation[i, 1, t] * a[1] - rotation[i, 2, t] * a[2]


@compiled
def _in_world(rotations: Floats, covariance: Floats, sizes: Floats) -> Floats:
    """Covariances s R Σ Rᵀ (n, 3, 3) for rotations R (3, 3, n), a covariance Σ (3, 3) and sizes s (n,)."""
    result, turned = np.empty((len(sizes), 3, 3)), np.empty((3, 3))
    for t in range(len(sizes)):
        for i in range(3):
            for j in range(3):
                turned[i, j] = 0.0
                for k in range(3):
                    turned[i, j] += rotations[i, k, t] * covariance[k, j]
        for i in range(3):
            for j in range(3):
                total = 0.0
                for k in range(3):
                    total += turned[i, k] * rotations[j, k, t]
                result[t, i, j] = sizes[t] * total
    return result


class Barred(NamedTuple):
    """A joint or a segment that no body has so (see `study.recordings.skeleton.gate`).

    Attributes:
        name: of a joint or a segment, or "up".
        frames: true where it is barred (frames,).
        reason: in words.
    """

    name: str
    frames: Bools
    reason: str

    @property
    def text(self) -> str:
        """The sentence for a user."""
        share = "" if self.frames.all() else f" in {self.frames.mean():.1%} of the frames"
        return f"{self.name} is missing{share}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A skeleton over time, in metres.

    Attributes:
        name: of the recording.
        rate: its frames per second.
        calibration: that the skeleton was drawn with.
        rotations: R of each segment (segments, 3, 3, frames), NaN where unknown.
        origins: o of each segment (segments, 3, frames), x = R a + o for a point a in its axes; NaN where unknown.
        segment_flags: `Flag` of each segment in each frame (segments, frames).
        misfits: root mean square distance of each segment's markers from their places (segments,); NaN if no frame
            shows it fully.
        left_out: share of each segment's samples that are rejected, as far from their places (segments,).
        turning: covariance of the error of each segment's rotation in the world (segments, frames, 3, 3), rad²; NaN
            where the rotation is unknown, or its error is.
        centers: of each joint (joints, 3, frames), NaN where unknown.
        flags: `Flag` of each joint in each frame (joints, frames).
        posed: variances along x, y and z that a joint's place has in each frame (joints, 3, frames), m², beside those
            of the calibration: from the markers' noise, from its gap, and from interpolation.
        gaps: root mean square distance between a joint in its child and in its parent (joints,), metres; NaN if no
            frame shows both.
        barred: what no body can do, and is missing.
    """

    name: str
    rate: float
    calibration: Calibration
    rotations: Floats
    origins: Floats
    segment_flags: Bytes
    misfits: Floats
    left_out: Floats
    turning: Floats
    centers: Floats
    flags: Bytes
    posed: Floats
    gaps: Floats
    barred: tuple[Barred, ...] = ()

    @property
    def segments(self) -> tuple[str, ...]:
        """Names of the segments."""
        return tuple(segment.name for segment in self.calibration.markerset.segments)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the marker set's order."""
        return tuple(place.joint.name for place in self.calibration.joints)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.centers.shape[2])

    def barred_at(self, joint: Joint) -> tuple[Bools, str]:
        """Frames in which a joint is barred (frames,), itself or with one of its segments, and the reasons or ""."""
        own = [found for found in self.barred if found.name in (joint.name, joint.parent, joint.child)]
        frames = np.logical_or.reduce([found.frames for found in own], initial=False) & np.ones(self.frames, np.bool_)
        return frames, "; ".join(found.text for found in own)

    def rotation(self, segment: str) -> Floats:
        """Rotation of a segment (3, 3, frames)."""
        return np.asarray(self.rotations[self.segments.index(segment)])

    def center(self, joint: str) -> Floats:
        """Centre of a joint (3, frames), metres."""
        return np.asarray(self.centers[self.joints.index(joint)])


def draw_skeleton(
    calibration: Calibration, recording: Recording, bridge: float = 1.0, largest_error: float = LARGEST_ERROR
) -> Skeleton:
    """Run phase 2: place the joints in every frame.

    Args:
        calibration: of the same subject with the same markers (see `other_subject`).
        recording: markers under the calibration's names; those that it lacks count as always missing.
        bridge: longest time, seconds, between an unseen segment and the nearest frame in which it is seen; beyond, it
            is unknown unless one of its markers is seen.
        largest_error: standard error above which a joint is unknown, metres.

    Raises:
        RecordingError: if the calibration has no segment whose markers fix its pose, ``bridge`` is negative, or
            ``largest_error`` is not above 0.
    """
    if not bridge >= 0.0:
        raise RecordingError(f"bridge = {bridge:g} seconds; it must be 0 or more")
    if not largest_error > 0.0:
        raise RecordingError(f"largest_error = {largest_error:g} metres; it must be above 0")
    if not calibration.has_poses:
        words = "no segment of this calibration has a pose; there is no skeleton to draw"
        raise RecordingError(f"{calibration.source}: {words}")
    builder, segments = _SkeletonBuilder(calibration, recording), calibration.markerset.segments
    for segment in segments:
        builder.place_by_markers(segment)
    builder.measure_gaps()
    for segment in segments:
        builder.place_about_joint(segment)
    for segment in (*reversed(segments), *segments):
        builder.place_by_neighbours(segment)
    builder.measure_gaps()
    for segment in segments:
        builder.bridge(segment, round(bridge * recording.rate))
    segments_in_time = builder.rotations, builder.origins, builder.flags, builder.misfits, builder.left_out
    gaps = np.array([builder.gaps[place.joint.name].size for place in calibration.joints])
    joints_in_time = *builder.joints(largest_error), gaps
    return Skeleton(recording.name, recording.rate, calibration, *segments_in_time, builder.turning, *joints_in_time)


class _SkeletonBuilder:
    """Poses of the segments so far, and the covariance of their rotations."""

    def __init__(self, calibration: Calibration, recording: Recording) -> None:
        self.calibration, self.recording = calibration, recording
        self.numbers = {segment.name: i for i, segment in enumerate(calibration.markerset.segments)}
        self.above = {place.joint.child: place for place in calibration.joints}
        count, n = len(self.numbers), recording.frames
        self.rotations, self.origins = np.full((count, 3, 3, n), np.nan), np.full((count, 3, n), np.nan)
        self.flags, self.misfits = np.full((count, n), Flag.UNKNOWN, dtype=np.uint8), np.full(count, np.nan)
        self.left_out = np.zeros(count)
        self.markers: dict[str, Floats] = {}
        """Each segment's markers in the world (m, 3, frames), metres; NaN where missing or rejected."""
        self.turning = np.full((count, n, 3, 3), np.nan)
        """Covariance of the error of each segment's rotation in the world, rad²..."""
        self.pivots = np.zeros((count, 3, n))
        """...and, where it is bridged, the place in its axes that it rotates about, metres..."""
        self.anchors = np.zeros((count, n))
        """...and the variance of a coordinate of that place in the world, m²."""
        self.gaps: dict[str, Gap] = {}
        self.at_joints = np.zeros((2, len(calibration.joints), 3, n))
        """Variances of each joint along x, y and z from the noise of its parent's pose, and of its child's, m²."""

    def place_by_markers(self, segment: Segment) -> None:
        """Place a segment in the frames in which its own markers fix its pose."""
        shape, number = self.calibration.shape(segment.name), self.numbers[segment.name]
        x = np.full((len(shape.markers), 3, self.recording.frames), np.nan)
        for k, marker in enumerate(shape.markers):
            x[k] = self.recording.of(marker) if marker in self.recording.markers else np.nan
        self.markers[segment.name] = x
        if shape.has_own_pose:
            self._fit(segment.name, np.arange(self.recording.frames), [])
            self._count_left_out(number, x, self.markers[segment.name])

    def place_about_joint(self, segment: Segment) -> None:
        """Place a segment in further frames by its markers and its joint, where its parent is seen."""
        number, shape, place = self.numbers[segment.name], self.calibration.shape(segment.name), self._pivot(segment)
        frames = np.flatnonzero(self.flags[number] != Flag.SEEN)
        if place is None or not len(frames) or not len(shape.markers):
            return
        x = self.markers[segment.name]
        self._fit(segment.name, frames, [place])
        if not shape.has_own_pose:
            self._count_left_out(number, x, self.markers[segment.name])
        # one marker and the joint are all that a hand may have: its rotation about the line of the two is not shown
        at = self._shown(place, 0)
        whole = ~np.isnan(self.markers[segment.name][:, 0]).any(axis=0) & ~np.isnan(at[0])
        whole &= (self.flags[number] != Flag.SEEN) & self._shows_direction(segment.name, place)
        if whole.any():
            self._complete(segment.name, np.flatnonzero(whole), [place], self._in_parent(place))
            self.flags[number, whole] = Flag.SEEN

    def place_by_neighbours(self, segment: Segment) -> None:
        """Place a segment in further frames by its markers and the joints that its neighbours show.

        Frames in which these points would not place each of its joints to 1 cm are left out.
        """
        joints = self._joints_of(segment)
        frames = np.flatnonzero(self.flags[self.numbers[segment.name]] != Flag.SEEN)
        if len(frames) and joints:
            self._fit(segment.name, frames, joints, _SURE)

    def _fit(self, name: str, frames: Ints, joints: Sequence[JointPlace], sure: float | None = None) -> None:
        """Fit a segment's poses in some frames to its markers and to joints, weighted by their errors.

        Args:
            name: of the segment.
            frames: their numbers (w,).
            joints: of the segment.
            sure: largest standard error, metres, with which the points must place each of the joints.
        """
        number, shape = self.numbers[name], self.calibration.shape(name)
        places, errors, x = self._points(name, joints, frames)
        count = len(shape.markers)
        if ((~np.isnan(x[:, 0])).sum(axis=0) < 3).all():
            return
        limits = np.full(len(places), np.inf)
        limits[:count] = np.hypot(_limits(shape, joints), 3.0 * errors[count:].max(initial=0.0))
        weights = np.maximum((errors[0] / errors) ** 2, _LEAST_WEIGHT)
        rotation, origin, fitted, used, square = fit_poses_to(places, x, limits, weights)
        if sure is None:
            markers = self.markers[name].copy()
            markers[:, :, frames] = np.where(used[:count, None], x[:count], np.nan)
            self.markers[name] = markers
            if fitted.any() and np.isnan(self.misfits[number]):
                self.misfits[number] = np.sqrt(square[fitted].mean())
        if not joints and fitted.any():  # the markers' errors in this recording
            left = (3 * used.sum(axis=0) - 6)[fitted].sum() / used.sum(axis=0)[fitted].sum()
            errors = np.maximum(errors, self.misfits[number] / np.sqrt(left))
        noise = PoseNoise.of(places, errors[:, None, None] ** 2 * np.eye(3), used, fitted, weights)
        if sure is not None and fitted.any():
            covariances = [noise.covariances_at(at) for at in places[count:]]
            worst = np.linalg.eigvalsh(np.array(covariances))[:, :, -1].max(axis=0)
            fitted[fitted] = worst[noise.pattern[fitted]] < sure**2
        seen, turns = frames[fitted], rotation[:, :, fitted]
        self.rotations[number][:, :, seen], self.origins[number][:, seen] = turns, origin[:, fitted]
        self.flags[number, seen] = Flag.SEEN
        ratio = square[fitted] / max(square[fitted].mean(), _EXACT**2) if fitted.any() else square[fitted]
        excess = np.where(ratio > _IMPLAUSIBLE, ratio, 1.0)
        for pattern in np.unique(noise.pattern[fitted]):
            frames, turns = seen[noise.pattern[fitted] == pattern], rotation[:, :, noise.pattern == pattern]
            more = excess[noise.pattern[fitted] == pattern]
            self.turning[number, frames] = _in_world(turns, noise.tilt[pattern], more)
            for i, place in enumerate(self.calibration.joints):
                for side, (end, at) in enumerate(_ends(place)):
                    if end == name:
                        turned = _in_world(turns, noise.covariances_at(at)[pattern], more)
                        self.at_joints[side, i][:, frames] = np.diagonal(turned, axis1=1, axis2=2).T

    def measure_gaps(self) -> None:
        """Measure the gap of each joint in the frames that show both of its segments."""
        for place in self.calibration.joints:
            parent, child = self.numbers[place.joint.parent], self.numbers[place.joint.child]
            known = (self.flags[parent] == Flag.SEEN) & (self.flags[child] == Flag.SEEN) & place.known
            frames = np.flatnonzero(known)
            rotations = [self.rotations[k].take(frames, axis=2) for k in (parent, child)]
            origins = [self.origins[k].take(frames, axis=1) for k in (parent, child)]
            one, other = (
                to_world(r, o, at)
                for r, o, at in zip(rotations, origins, (place.in_parent, place.in_child), strict=True)
            )
            self.gaps[place.joint.name] = Gap(other - one, frames, rotations)

    def bridge(self, segment: Segment, reach: int) -> None:
        """Place a segment about a joint that is seen, or about one of its markers, with its expected rotation."""
        number, above = self.numbers[segment.name], self.above.get(segment.name)
        flags = self.flags[number]
        marker = np.asarray((~np.isnan(self.markers[segment.name][:, 0])).any(axis=0))
        joints = self._joints_of(segment)
        shown = [~np.isnan(self._shown(place, int(place.joint.parent == segment.name))[0]) for place in joints]
        wanted = np.flatnonzero((flags == Flag.UNKNOWN) & np.stack([marker, *shown]).any(axis=0))
        if not len(wanted):
            return
        courses = [(wanted, InterpolatedRotation(self.rotations[number], None, flags == Flag.SEEN))]
        if above is not None:  # the rotation in its parent for the frames that show that, else in the world
            within = self.flags[self.numbers[above.joint.parent], wanted] == Flag.SEEN
            courses = [(wanted[within], self._in_parent(above)), (wanted[~within], courses[0][1])]
        for frames, course in courses:
            held = not len(course.fitted) and course.rest is not None  # to its parent's mean rotation
            frames = frames[(course.distance(frames) <= reach) | marker[frames] | held]
            if len(frames):
                self._complete(segment.name, frames, joints, course)
            flags[frames[~np.isnan(self.rotations[number][0, 0, frames])]] = Flag.BRIDGED

    def _pivot(self, segment: Segment) -> JointPlace | None:
        """The joint that helps to place a segment, if any."""
        place, own = self.above.get(segment.name), self.calibration.shape(segment.name).has_own_pose
        return place if place is not None and place.known and (_is_pivot(place) or not own) else None

    def _joints_of(self, segment: Segment) -> list[JointPlace]:
        """Joints that help to place a segment: its own, and those that are fixed in it."""
        own, joints = self._pivot(segment), self.calibration.joints
        below = [p for p in joints if p.joint.parent == segment.name and p.known and _is_pivot(p)]
        return [*([] if own is None else [own]), *below]

    def _in_parent(self, place: JointPlace) -> InterpolatedRotation:
        """Rotation of a joint's child in its parent, from the frames that show both."""
        child, parent = self.numbers[place.joint.child], self.numbers[place.joint.parent]
        known = (self.flags[child] == Flag.SEEN) & (self.flags[parent] == Flag.SEEN)
        return InterpolatedRotation(self.rotations[child], self.rotations[parent], known, place.mean_rotation)

    def _complete(self, name: str, frames: Ints, joints: Sequence[JointPlace], course: InterpolatedRotation) -> None:
        """Complete a segment's poses in some frames from its expected rotation, its markers and joints of it."""
        number = self.numbers[name]
        places, errors, x = self._points(name, joints, frames)
        prior = course.covariance(frames)
        prior[np.isnan(prior).any(axis=(1, 2))] = _SPREAD**2 * np.eye(3)
        prior += _EXACT * np.eye(3)
        sure = 1.5 / np.trace(prior, axis1=1, axis2=2)
        rotation, origin, middle = complete_poses(places, x, 1.0 / errors**2, course.at(frames), sure)
        self.rotations[number][:, :, frames], self.origins[number][:, frames] = rotation, origin
        self.pivots[number][:, frames] = middle
        shown = ~np.isnan(x[:, 0])
        self.anchors[number, frames] = 1.0 / (shown / errors[:, None] ** 2).sum(axis=0).clip(_EXACT)
        arms = skew(np.einsum("ijt,mjt->mti", rotation, places[:, :, None] - middle))
        arms *= (shown / errors[:, None])[:, :, None, None]
        # of δ = (λ + J)⁻¹ (λ δ₀ + Σ w a × ε): the expected rotation's error and the points' noise
        information, own = np.einsum("mtij,mtkj->tik", arms, arms, optimize=True), 2.0 * sure[:, None, None]
        gain = np.linalg.inv(own * np.eye(3) + information)
        self.turning[number, frames] = gain @ (own**2 * prior + information) @ gain

    def _points(self, name: str, joints: Sequence[JointPlace], frames: Ints) -> tuple[Floats, Floats, Floats]:
        """Markers of a segment, and joints that its neighbours show: places (m, 3), errors (m,), and points (m, 3, w).

        All are in metres; the points are those of w frames.
        """
        shape, sides = self.calibration.shape(name), [int(place.joint.child == name) for place in joints]
        shown = [self._shown(place, 1 - side)[None, :, frames] for place, side in zip(joints, sides, strict=True)]
        ends = [_ends(place)[side][1][None] for place, side in zip(joints, sides, strict=True)]
        errors = [*[_marker_error(shape)] * len(shape.markers), *map(_joint_error, joints)]
        x = np.concatenate([self.markers[name].take(frames, axis=2), *shown])
        return np.concatenate([shape.places, *ends]), np.array(errors), x

    def _shows_direction(self, name: str, place: JointPlace) -> bool:
        """True if a segment's markers are far enough from a joint to show a direction from there."""
        places, at = (
            self.calibration.shape(name).places,
            place.in_child if place.joint.child == name else place.in_parent,
        )
        return len(places) > 0 and bool(np.linalg.norm(places.mean(axis=0) - at) > _ARM * _joint_error(place))

    def _shown(self, place: JointPlace, side: int) -> Floats:
        """A joint in the world (3, frames) as its parent (0) or child (1) shows it, where the other expects it.

        NaN in frames that do not show the segment.
        """
        name, at = ((place.joint.parent, place.in_parent), (place.joint.child, place.in_child))[side]
        number, world = self.numbers[name], np.full((3, self.recording.frames), np.nan)
        frames = np.flatnonzero(self.flags[number] == Flag.SEEN)
        rotations = self.rotations[number].take(frames, axis=2)
        gap = self.gaps[place.joint.name].at(frames, side, rotations)
        world[:, frames] = to_world(rotations, self.origins[number].take(frames, axis=1), at) + (gap, -gap)[side]
        return world

    def _count_left_out(self, number: int, before: Floats, after: Floats) -> None:
        """Store the share of a segment's samples that its fits have rejected."""
        seen = ~np.isnan(before[:, 0])
        self.left_out[number] = 1.0 - (~np.isnan(after[:, 0])).sum() / max(seen.sum(), 1) if seen.any() else 0.0

    def joints(self, largest_error: float) -> tuple[Floats, Bytes, Floats]:
        """Centres of the joints (joints, 3, frames), their flags (joints, frames), and variances.

        A joint is placed by its parent if that is seen, else by its child if that is, with the gap of the joint; else
        by both as far as they are bridged, weighted by their errors.
        """
        places, n = self.calibration.joints, self.recording.frames
        centers, flags = np.full((len(places), 3, n), np.nan), np.full((len(places), n), Flag.UNKNOWN, dtype=np.uint8)
        posed = np.zeros((len(places), 3, n))
        for i, place in enumerate(places):
            if place.standard_error > largest_error:
                continue
            gap, shared = self.gaps[place.joint.name], 0.0
            if len(gap.frames):  # what noise does not explain of the gap is as much the parent's as the child's
                noise = 2.0 * self.at_joints[:, i].take(gap.frames, axis=2).mean()
                shared = 0.5 * max(gap.size**2 / 3.0 - noise, 0.0)
            for side, (name, at) in enumerate(_ends(place)):
                k = self.numbers[name]
                if np.isnan(at).any():
                    continue
                world, variance = to_world(self.rotations[k], self.origins[k], at), self._bridging(name, at)
                variance += self.at_joints[side, i]
                if side == 1:
                    world, variance = world - gap.at(np.arange(n), 1, self.rotations[k]), variance + gap.variance
                known = ~np.isnan(world[0])
                both = known & (self.flags[k] == Flag.BRIDGED) & (flags[i] == Flag.BRIDGED)
                better = known & (self.flags[k] < flags[i])
                for old, new in ((centers, world), (posed, variance), (flags, self.flags[k])):
                    np.copyto(old[i], new, where=better)
                old, new = posed[i][:, both], variance[:, both]
                share = old.sum(axis=0) / np.maximum((old + new).sum(axis=0), 1e-300)
                centers[i][:, both] += share * (world[:, both] - centers[i][:, both])
                posed[i][:, both] = (1.0 - share) * old + share * new  # their errors are not independent
            if (flags[i] == Flag.BRIDGED).any():
                remove_leaps(centers[i], posed[i].mean(axis=0) * (flags[i] == Flag.BRIDGED), self._source(place))
            posed[i][:, flags[i] != Flag.UNKNOWN] += shared
            large = place.standard_error**2 + posed[i].max(axis=0) > largest_error**2
            centers[i][:, large], flags[i][large], posed[i][:, large] = np.nan, Flag.UNKNOWN, 0.0
        return centers, flags, posed

    def _source(self, place: JointPlace) -> Ints:
        """A number (frames,) that changes where others of the segments around a joint are seen, or bridged."""
        ends, joints = (place.joint.parent, place.joint.child), [other.joint for other in self.calibration.joints]
        around = {
            name for joint in joints for name in (joint.parent, joint.child) if {joint.parent, joint.child} & {*ends}
        }
        flags = self.flags[sorted(self.numbers[name] for name in around)].astype(np.int64)
        return np.asarray(3 ** np.arange(len(flags)) @ flags)

    def _bridging(self, segment: str, at: Floats) -> Floats:
        """Variances (3, frames) of a point of a segment from the rotation of its bridged frames, m²."""
        variance, number = np.zeros((3, self.recording.frames)), self.numbers[segment]
        frames = np.flatnonzero(self.flags[number] == Flag.BRIDGED)
        if len(frames):
            away = at[:, None] - self.pivots[number][:, frames]
            arm = np.einsum("ijt,jt->ti", self.rotations[number][:, :, frames], away)
            variance[:, frames] = np.einsum("tij,tjk,tik->it", skew(arm), self.turning[number, frames], skew(arm))
            variance[:, frames] += self.anchors[number, frames]
        return variance


def _ends(place: JointPlace) -> tuple[tuple[str, Floats], tuple[str, Floats]]:
    """The two segments of a joint, parent first, with the joint's place in each (3,), metres."""
    return (place.joint.parent, place.in_parent), (place.joint.child, place.in_child)


def _is_pivot(place: JointPlace) -> bool:
    """True if a joint is sure enough to place a segment whose own markers can fix its pose."""
    return place.status in _PIVOTS and not place.standard_error > LARGEST_ERROR


def _joint_error(place: JointPlace) -> float:
    """Standard error of a joint as a segment's pose shows it, metres; a metre if it is not known."""
    return float(np.nan_to_num(np.hypot(place.standard_error, _POSE), nan=1.0))


def _marker_error(shape: SegmentShape) -> float:
    """Standard deviation of a coordinate of a segment's markers from their places in it, metres.

    The scatter is that of a fit to three points or more, of which six coordinates fix the pose.
    """
    points = len(shape.markers) + (not shape.has_own_pose)
    if points < 3:
        return _SOFT
    square = float(np.mean(np.nan_to_num(shape.scatter) ** 2)) * points / (3 * points - 6)
    return max(float(np.sqrt(square)), _SOFT)


def _limits(shape: SegmentShape, joints: Sequence[JointPlace]) -> Floats:
    """Largest accepted distance of each marker from its place (m,), metres."""
    if not len(shape.markers):
        return np.zeros(0)
    middle = shape.places.mean(axis=0) if shape.has_own_pose or not joints else joints[0].in_child
    size = np.sqrt(((shape.places - middle) ** 2).sum(axis=1).mean())
    return np.asarray(np.maximum(_FAR * np.nan_to_num(shape.scatter), _SLACK * size))
