"""Phase 2: draw a skeleton in every frame, from a calibration and the markers that are seen.

From the root outwards each segment is placed at its joint, J(t) = o_P(t) + R_P(t) c_J, and rotated about it onto its
markers. Time is proportional to the number of segments, and bones keep their lengths. In frames that do not show the
parent, a segment's own markers place it; a segment that these do not show is placed by the joints that its neighbours
show.

Two markers and the joint, or three markers without it, fix the rotation, by Kabsch's fit about the joint instead of the
centroid. A marker that is far from its place in the segment, such as a swapped one, is rejected and the rest are fitted
again. In a frame with too few markers, those that are left show a direction. The segment is rotated from its expected
pose by the shortest arc that takes the expected direction to the one seen; the rotation about that direction is the
expected one.

Where too few markers are seen, but a joint of the segment or one of its markers is, its rotation is interpolated over
the gap, for a while, and it is flagged as bridged. The covariance of this rotation is that of the same interpolation
over gaps as long in frames that are seen. Where nothing shows a segment it is unknown, and so is a joint that neither
of its segments shows.

Source: paper §10 (second phase); theory §1.2.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from study.arrays import Bools, Bytes, Floats, Ints
from study.fits.jit import compiled
from study.fits.samples import Worded
from study.recordings.joints.estimate import DOUBTED, USABLE, JointStatus
from study.recordings.joints.find import Calibration, JointPlace, SegmentShape
from study.recordings.joints.poses import PoseNoise
from study.recordings.markersets import Segment
from study.recordings.recording import Recording, RecordingError
from study.recordings.rigid import fit_poses_about, relative_rotation, skew, to_world

_FAR = 6.0
"""Scatters from its place beyond which a marker is rejected..."""
_SLACK = 0.1
"""...if it is also this share of its segment's size away."""
_PIVOTS = (*USABLE, *DOUBTED, JointStatus.UNSURE, JointStatus.INSIGNIFICANT)
"""A joint that a segment rotates about even if its own markers fix its pose."""
_ANY = 1e3
"""Metres: a joint is never rejected as far from its place."""
_SURE = 0.01
"""Metres: standard error of a segment's joints up to which its neighbours place it."""
_POSE = 0.005
"""Metres: what the pose of the segment that shows a joint adds to its standard error."""
_FEWEST, _ENOUGH = 20, 300
"""Fewest and most gaps of one length from which an interpolation's error is known."""


class Flag(Worded):
    """Source of a joint's place in one frame."""

    SEEN = 0, "from markers"
    BRIDGED = 1, "bridged: too few markers seen"
    UNKNOWN = 2, "unknown"


_HALF_TURN = -0.999999
"""Cosine of the arc below which its plane is undefined, so that the expected rotation is kept."""


@compiled
def _rotate_by_arc(u: Floats, v: Floats, r: Floats) -> None:
    """Rotate r (3, 3), in place, by the shortest arc that takes the direction u (3,) to v (3,)."""
    uu = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    vv = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if not (uu > 0.0 and vv > 0.0):
        return
    c = (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) / (uu * vv)
    if c < _HALF_TURN:
        return
    w0 = (u[1] * v[2] - u[2] * v[1]) / (uu * vv)
    w1 = (u[2] * v[0] - u[0] * v[2]) / (uu * vv)
    w2 = (u[0] * v[1] - u[1] * v[0]) / (uu * vv)
    h = 1.0 / (1.0 + c)
    for j in range(3):
        a, b, d = r[0, j], r[1, j], r[2, j]
        along = h * (w0 * a + w1 * b + w2 * d)
        r[0, j] = c * a + w1 * d - w2 * b + along * w0
        r[1, j] = c * b + w2 * a - w0 * d + along * w1
        r[2, j] = c * d + w0 * b - w1 * a + along * w2


def complete_poses(places: Floats, x: Floats, local: Floats, world: Floats, expected: Floats) -> tuple[Floats, Floats]:
    """Complete a segment's poses in frames that show too few of its markers.

    Args:
        places: of its markers in its axes (m, 3), metres.
        x: the markers in the world (m, 3, w), metres; NaN where missing.
        local: the place of its joint in its axes (3,), metres.
        world: the place of its joint in the world (3, w), metres; NaN where it is not known. Without a joint, the first
            marker takes its place.
        expected: rotations that are expected (3, 3, w).

    Returns:
        Rotations (3, 3, w) and origins (3, w); NaN where neither a joint nor a marker is seen.
    """
    rotation, origin = np.array(expected), np.full(world.shape, np.nan)
    _complete_poses(places, x, local, world, rotation, origin)
    return rotation, origin


@compiled
def _complete_poses(places: Floats, x: Floats, pin: Floats, at: Floats, rotation: Floats, origin: Floats) -> None:
    """Compiled part of `complete_poses`: rotates the expected rotations in place."""
    u, v, a, b, r = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    for t in range(x.shape[2]):
        pinned, count = at[0, t] == at[0, t], 0
        for i in range(3):
            a[i], b[i], u[i], v[i] = pin[i], at[i, t], 0.0, 0.0
            for j in range(3):
                r[i, j] = rotation[i, j, t]
        for k in range(x.shape[0]):
            if x[k, 0, t] == x[k, 0, t]:
                count += 1
                if count == 1 and not pinned:
                    for i in range(3):
                        a[i], b[i] = places[k, i], x[k, i, t]
                p0, p1, p2 = places[k, 0] - a[0], places[k, 1] - a[1], places[k, 2] - a[2]
                for i in range(3):
                    v[i] += x[k, i, t] - b[i]
                    u[i] += r[i, 0] * p0 + r[i, 1] * p1 + r[i, 2] * p2
        if count > 0:
            _rotate_by_arc(u, v, r)
        for i in range(3):
            if pinned or count > 0:
                origin[i, t] = b[i] - r[i, 0] * a[0] - r[i, 1] * a[1] - r[i, 2] * a[2]
            for j in range(3):
                rotation[i, j, t] = r[i, j]


class InterpolatedRotation:
    """A segment's rotation between the frames that show it, in its parent or in the world, and its error.

    Args:
        rotation: of the segment (3, 3, frames).
        parent: of its parent; None for the world.
        known: frames in which both are seen (frames,).
        rest: mean rotation in the parent (3, 3), for a segment that is never seen together with it.
    """

    def __init__(self, rotation: Floats, parent: Floats | None, known: Bools, rest: Floats | None = None) -> None:
        self.known, self.fitted, self.parent, self.rest = known, np.flatnonzero(known), parent, rest
        part = rotation.take(self.fitted, axis=2)  # an index would put frames first in memory, where sums take longer
        inside = part if parent is None else relative_rotation(parent.take(self.fitted, axis=2), part)
        self.inside = np.ascontiguousarray(np.moveaxis(inside, 2, 0))  # (fitted, 3, 3)

    def ends(self, wanted: Ints) -> tuple[Ints, Ints]:
        """Places in ``fitted`` of the frames before and after those wanted (w,), the nearest one where one is missing.

        None may be fitted.
        """
        place = np.searchsorted(self.fitted, wanted)
        return np.maximum(place - 1, 0), np.minimum(place, len(self.fitted) - 1)

    def distance(self, wanted: Ints) -> Ints:
        """Number of frames to the nearest one that is seen (w,)."""
        if not len(self.fitted):
            return np.full(len(wanted), np.iinfo(np.int64).max)
        before, after = (self.fitted[end] for end in self.ends(wanted))
        return np.asarray(np.minimum(np.abs(wanted - before), np.abs(after - wanted)))

    def at(self, wanted: Ints) -> Floats:
        """Rotations in the world (3, 3, w); the nearest one before the first and after the last fit, NaN if unknown."""
        if not len(self.fitted):
            if self.parent is None or self.rest is None:
                return np.full((3, 3, len(wanted)), np.nan)
            return np.asarray(np.einsum("ijw,jk->ikw", self.parent[:, :, wanted], self.rest))
        before, after = self.ends(wanted)
        span = np.maximum(self.fitted[after] - self.fitted[before], 1)
        share = np.clip((wanted - self.fitted[before]) / span, 0.0, 1.0)
        between = _between(self.inside[before], self.inside[after], share)
        world = between if self.parent is None else np.moveaxis(self.parent[:, :, wanted], 2, 0) @ between
        return np.ascontiguousarray(np.moveaxis(world, 0, 2))

    def covariance(self, wanted: Ints) -> Floats:
        """Covariance of the rotation's error in the world (w, 3, 3), rad²; NaN if it is not known.

        Between two ends it is that of the middle of a gap as long, less towards the ends as for a random walk.
        """
        if not len(self.fitted):
            return np.full((len(wanted), 3, 3), np.nan)
        before, after = (self.fitted[end] for end in self.ends(wanted))
        inner = (wanted > before) & (wanted < after)
        half = 0.5 * np.maximum(after - before, 1)
        near = self.distance(wanted)
        result = np.empty((len(wanted), 3, 3))
        for kind, distances in ((True, half), (False, near.astype(float))):
            result[inner == kind] = self._table(kind, distances[inner == kind])
        result *= np.where(inner, near * (2.0 * half - near) / half**2, 1.0)[:, None, None]
        if self.parent is None:
            return result
        frame = np.moveaxis(self.parent[:, :, wanted], 2, 0)
        return frame @ result @ frame.swapaxes(1, 2)

    def _table(self, inner: bool, distances: Floats) -> Floats:
        """Covariance (w, 3, 3) of errors over these numbers of frames, between two ends or beyond one."""
        steps, squares = [0.0], [np.zeros((3, 3))]
        for lag in (4**k for k in range(int(np.log2(max(len(self.fitted), 2))) // 2 + 1)):
            if steps[-1] >= distances.max(initial=0.0):
                break
            length = 2 * lag if inner else lag
            starts = max(len(self.known) - length, 0)
            seen = self.known[:starts] & self.known[lag : lag + starts] & self.known[length : length + starts]
            first = np.flatnonzero(seen)
            if len(first) < _FEWEST:
                break
            first = first[:: max(len(first) // _ENOUGH, 1)]
            guess, between, last = (self.inside[self.fitted.searchsorted(first + k)] for k in (0, lag, length))
            if inner:
                guess = _between(guess, last, np.full(len(first), 0.5))
            off = Rotation.from_matrix(between @ guess.swapaxes(1, 2), assume_valid=True).as_rotvec()
            steps.append(float(lag))
            squares.append(off.T @ off / len(off))
        if len(steps) < 2:
            return np.full((len(distances), 3, 3), np.nan)
        entries = [np.interp(distances, steps, entry) for entry in np.array(squares).reshape(-1, 9).T]
        beyond = np.maximum(distances / steps[-1], 1.0) ** 2  # as if it went on in one direction
        return np.asarray(np.stack(entries, axis=1).reshape(-1, 3, 3) * beyond[:, None, None])


def _between(first: Floats, last: Floats, share: Floats) -> Floats:
    """Rotations (n, 3, 3) at shares (n,) of the way from the first ones to the last ones."""
    step = Rotation.from_matrix(first.swapaxes(1, 2) @ last, assume_valid=True).as_rotvec()
    return np.asarray(first @ Rotation.from_rotvec(share[:, None] * step).as_matrix())


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
        centers: of each joint (joints, 3, frames), NaN where unknown.
        flags: `Flag` of each joint in each frame (joints, frames).
        bridging: variances along x, y and z of the error of bridged joints (joints, 3, frames), m²; 0 in other frames.
    """

    name: str
    rate: float
    calibration: Calibration
    rotations: Floats
    origins: Floats
    segment_flags: Bytes
    misfits: Floats
    left_out: Floats
    centers: Floats
    flags: Bytes
    bridging: Floats

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

    def rotation(self, segment: str) -> Floats:
        """Rotation of a segment (3, 3, frames)."""
        return np.asarray(self.rotations[self.segments.index(segment)])

    def center(self, joint: str) -> Floats:
        """Centre of a joint (3, frames), metres."""
        return np.asarray(self.centers[self.joints.index(joint)])


def draw_skeleton(calibration: Calibration, recording: Recording, bridge: float = 1.0) -> Skeleton:
    """Run phase 2: place the joints in every frame.

    Args:
        calibration: of the same subject with the same markers (see `other_subject`).
        recording: markers under the calibration's names; those that it lacks count as always missing.
        bridge: longest time, seconds, between an unseen segment and the nearest frame in which it is seen; beyond, it
            is unknown unless one of its markers is seen.

    Raises:
        RecordingError: if the calibration has no segment whose markers fix its pose, or ``bridge`` is negative.
    """
    if not bridge >= 0.0:
        raise RecordingError(f"bridge = {bridge:g} seconds; it must be 0 or more")
    if not calibration.has_poses:
        words = "no segment of this calibration has a pose; there is no skeleton to draw"
        raise RecordingError(f"{calibration.source}: {words}")
    builder, segments = _SkeletonBuilder(calibration, recording), calibration.markerset.segments
    for segment in segments:
        builder.place_by_markers(segment)
    for segment in (*reversed(segments), *segments):
        builder.place_by_neighbours(segment)
    for segment in segments:
        builder.bridge(segment, round(bridge * recording.rate))
    segments_in_time = builder.rotations, builder.origins, builder.flags, builder.misfits, builder.left_out
    return Skeleton(recording.name, recording.rate, calibration, *segments_in_time, *builder.joints())


class _SkeletonBuilder:
    """Poses of the segments so far, and the covariance of the rotation of those that are bridged."""

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
        self.turning = np.zeros((count, n, 3, 3))
        """Covariance of the rotation of each segment in the frames in which it is bridged, rad²..."""
        self.pivots = np.zeros((count, 3, n))
        """...and the place in its axes that it rotates about there, metres."""

    def _pivot(self, segment: Segment) -> tuple[JointPlace | None, Floats, Floats]:
        """The joint that a segment rotates about, if any, and its place in the segment's axes and in the world."""
        place = pivot_joint(self.above.get(segment.name), self.calibration.shape(segment.name))
        if place is None:
            return None, np.zeros(3), np.full((3, self.recording.frames), np.nan)
        return place, place.in_child, self._shown(place.joint.parent, place.in_parent)

    def place_by_markers(self, segment: Segment) -> None:
        """Place a segment in the frames that show it by its own markers, at its joint if its parent is seen."""
        number, shape = self.numbers[segment.name], self.calibration.shape(segment.name)
        x = np.full((len(shape.markers), 3, self.recording.frames), np.nan)
        for k, marker in enumerate(shape.markers):
            x[k] = self.recording.of(marker) if marker in self.recording.markers else np.nan
        place, local, world = self._pivot(segment)
        path = fit_poses_about(shape.places, _limits(shape, place), x, local, world)
        self.rotations[number], self.origins[number], fitted, used, square = path
        seen, self.markers[segment.name] = ~np.isnan(x[:, 0]), np.where(used[:, None], x, np.nan)
        self.left_out[number] = 1.0 - used.sum() / max(seen.sum(), 1) if seen.any() else 0.0
        if fitted.any():
            self.misfits[number] = np.sqrt(square[fitted].mean())
        self.flags[number, fitted] = Flag.SEEN
        # one marker and the joint are all that a hand may have: its rotation about the line of the two is not shown
        whole = used.all(axis=0) & ~np.isnan(world[0]) & ~fitted
        if place is not None and len(shape.markers) and whole.any():
            self._complete(segment.name, np.flatnonzero(whole), local, world, self._in_parent(place))
            self.flags[number, whole] = Flag.SEEN

    def place_by_neighbours(self, segment: Segment) -> None:
        """Place a segment in further frames by its markers and the joints that its neighbours show.

        Frames in which these points would not place each of its joints to 1 cm are left out.
        """
        number, shape = self.numbers[segment.name], self.calibration.shape(segment.name)
        frames = np.flatnonzero(self.flags[number] != Flag.SEEN)
        if not len(frames):
            return
        own, local, world = self._pivot(segment)
        world, below = world[:, frames], self._below(segment.name)
        others = (self._shown(p.joint.child, p.in_child)[None, :, frames] for p in below)
        x = np.concatenate([self.markers[segment.name].take(frames, axis=2), *others])
        if ((~np.isnan(x[:, 0])).sum(axis=0) + ~np.isnan(world[0]) < 3).all():
            return
        places = np.concatenate([shape.places, *(place.in_parent[None] for place in below)])
        limits = np.concatenate([_limits(shape, None), np.full(len(below), _ANY)])
        rotation, origin, fitted, used, _ = fit_poses_about(places, limits, x, local, world)
        joints = [*below, *([] if own is None else [own])]
        errors = [*np.nan_to_num(shape.scatter) / np.sqrt(3.0), *(np.hypot(p.standard_error, _POSE) for p in joints)]
        ends = np.concatenate([places, local[None]])[: len(errors)]
        used = np.concatenate([used, ~np.isnan(world[:1])])[: len(errors)]
        square = np.nan_to_num(errors, nan=1.0)[:, None, None] ** 2
        noise = PoseNoise.of(ends, square * np.eye(3), used, fitted)
        covariances = [noise.covariances_at(at) for at in ends[len(shape.markers) :]]
        worst = np.linalg.eigvalsh(np.array(covariances))[:, :, -1].max(axis=0)
        sure = fitted.copy()
        sure[fitted] = worst[noise.pattern[fitted]] < _SURE**2
        self.rotations[number][:, :, frames[sure]] = rotation[:, :, sure]
        self.origins[number][:, frames[sure]] = origin[:, sure]
        self.flags[number, frames[sure]] = Flag.SEEN

    def bridge(self, segment: Segment, reach: int) -> None:
        """Place a segment about a joint that is seen, or about one of its markers, with its expected rotation."""
        number, above = self.numbers[segment.name], self.above.get(segment.name)
        flags, seen = self.flags[number], ~np.isnan(self.markers[segment.name][:, 0])
        marker: Bools = np.asarray(seen.any(axis=0))
        # places in its axes and in the world, of its own joint first, and last of its first marker
        pivots = [self._pivot(segment)[1:]]
        pivots += [(p.in_parent, self._shown(p.joint.child, p.in_child)) for p in self._below(segment.name)]
        about = [(at, world, ~np.isnan(world[0])) for at, world in pivots]
        about.append((np.zeros(3), np.full((3, self.recording.frames), np.nan), marker))
        for at, world, shown in about:
            wanted = np.flatnonzero((flags == Flag.UNKNOWN) & shown)
            if not len(wanted):
                continue
            courses = [(wanted, InterpolatedRotation(self.rotations[number], None, flags == Flag.SEEN))]
            if above is not None:  # the rotation in its parent for the frames that show that, else in the world
                within = self.flags[self.numbers[above.joint.parent], wanted] == Flag.SEEN
                courses = [(wanted[within], self._in_parent(above)), (wanted[~within], courses[0][1])]
            for frames, course in courses:
                frames = frames[(course.distance(frames) <= reach) | marker[frames]]
                self._complete(segment.name, frames, at, world, course)
                frames = frames[~np.isnan(self.rotations[number][0, 0, frames])]
                flags[frames] = Flag.BRIDGED
                self.turning[number, frames] = course.covariance(frames)
                self.pivots[number][:, frames] = at[:, None]
                if np.isnan(world).all():
                    places = self.calibration.shape(segment.name).places
                    self.pivots[number][:, frames] = places[seen[:, frames].argmax(axis=0)].T

    def _in_parent(self, place: JointPlace) -> InterpolatedRotation:
        """Rotation of a joint's child in its parent, from the frames that show both."""
        child, parent = self.numbers[place.joint.child], self.numbers[place.joint.parent]
        known = (self.flags[child] == Flag.SEEN) & (self.flags[parent] == Flag.SEEN)
        return InterpolatedRotation(self.rotations[child], self.rotations[parent], known, place.mean_rotation)

    def _complete(self, name: str, frames: Ints, local: Floats, world: Floats, course: InterpolatedRotation) -> None:
        """Complete a segment's poses in some frames from its expected rotation and the markers that are left."""
        number, x = self.numbers[name], self.markers[name].take(frames, axis=2)
        places, at = self.calibration.shape(name).places, np.ascontiguousarray(world[:, frames])
        poses = complete_poses(places, x, local, at, course.at(frames))
        self.rotations[number][:, :, frames], self.origins[number][:, frames] = poses

    def _shown(self, segment: str, at: Floats) -> Floats:
        """A point of a segment in the world (3, frames) where the segment is seen; NaN elsewhere."""
        number = self.numbers[segment]
        world = to_world(self.rotations[number], self.origins[number], at)
        return np.where(self.flags[number] == Flag.SEEN, world, np.nan)

    def _below(self, segment: str) -> list[JointPlace]:
        """Joints that are fixed in a segment and can place it."""
        joints = self.calibration.joints
        return [p for p in joints if p.joint.parent == segment and p.known and p.status in _PIVOTS]

    def joints(self) -> tuple[Floats, Bytes, Floats]:
        """Centres of the joints (joints, 3, frames), their flags (joints, frames), and variances from bridging.

        A joint is placed by its parent if that is seen, else by its child if that is; else by the one that is bridged
        with the smaller error.
        """
        places, n = self.calibration.joints, self.recording.frames
        centers, flags = np.full((len(places), 3, n), np.nan), np.full((len(places), n), Flag.UNKNOWN, dtype=np.uint8)
        bridging = np.zeros((len(places), 3, n))
        for i, place in enumerate(places):
            for name, at in ((place.joint.parent, place.in_parent), (place.joint.child, place.in_child)):
                k = self.numbers[name]
                if np.isnan(at).any():
                    continue
                world, variance = to_world(self.rotations[k], self.origins[k], at), self._bridging(name, at)
                same, surer = self.flags[k] == flags[i], variance.sum(axis=0) < bridging[i].sum(axis=0)
                better = ((self.flags[k] < flags[i]) | (same & surer)) & ~np.isnan(world[0])
                for old, new in ((centers, world), (bridging, variance), (flags, self.flags[k])):
                    np.copyto(old[i], new, where=better)
        return centers, flags, bridging

    def _bridging(self, segment: str, at: Floats) -> Floats:
        """Variances (3, frames) of a point of a segment from the rotation of its bridged frames, m²."""
        variance, number = np.zeros((3, self.recording.frames)), self.numbers[segment]
        frames = np.flatnonzero(self.flags[number] == Flag.BRIDGED)
        if len(frames):
            away = at[:, None] - self.pivots[number][:, frames]
            arm = np.einsum("ijt,jt->ti", self.rotations[number][:, :, frames], away)
            variance[:, frames] = np.einsum("tij,tjk,tik->it", skew(arm), self.turning[number, frames], skew(arm))
        return variance


def pivot_joint(place: JointPlace | None, shape: SegmentShape) -> JointPlace | None:
    """The joint that a segment rotates about; None if its pose is fitted to its own markers alone."""
    if place is None or not place.known:
        return None
    return None if shape.has_own_pose and place.status not in _PIVOTS else place


def _limits(shape: SegmentShape, place: JointPlace | None) -> Floats:
    """Largest accepted distance of each marker from its place (m,), metres."""
    if not len(shape.markers):
        return np.zeros(0)
    middle = shape.places.mean(axis=0) if place is None else place.in_child
    size = np.sqrt(((shape.places - middle) ** 2).sum(axis=1).mean())
    return np.asarray(np.maximum(_FAR * np.nan_to_num(shape.scatter), _SLACK * size))
