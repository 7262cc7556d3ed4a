"""Phase 2: draw a skeleton in every frame, from a calibration and the markers that are seen.

From the root outwards each segment is placed at its joint, J(t) = o_P(t) + R_P(t) c_J, and rotated about it onto its
markers (`full_pose`, `partial_pose`). Time is proportional to the number of segments, and bones keep their lengths.
Gaps are bridged by the hierarchy: a segment that is not seen keeps its rotation in its parent, interpolated over the
gap, for a while. It is flagged, and so is all that depends on it.

Source: paper §10 (second phase); theory §1.2.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from study.arrays import Bools, Bytes, Floats, Ints
from study.recordings.joints.calibration import Calibration, JointPlace, SegmentShape
from study.recordings.joints.estimate import DOUBTED, USABLE, JointStatus
from study.recordings.markersets import Segment
from study.recordings.recording import Recording, RecordingError
from study.recordings.rigid import relative_rotation, to_world
from study.recordings.skeleton.poses import ExpectedPoses, PivotPath, SegmentPath, complete_poses, fit_full_poses
from study.recordings.skeleton.scene import Flag


def expected_poses(
    path: SegmentPath, parent: Floats | None, known: Bools, wanted: Ints, rest: Floats, reach: int
) -> tuple[ExpectedPoses, Bools]:
    """Interpolate a segment's rotation in its parent over gaps; before the first and after the last fit it stays.

    Args:
        path: poses of the segment.
        parent: the parent's rotation (3, 3, frames); None for a segment without a pivot.
        known: frames in which the segment is fitted and the parent is known (frames,).
        wanted: numbers of the frames (w,) to interpolate.
        rest: mean rotation in the parent (3, 3), for a segment that is never fitted.
        reach: frames that an expected pose is valid for.

    Returns:
        The expected poses, NaN where the parent is unknown; and the frames with a fit within reach (w,).
    """
    rotation, origin, count = path.rotation, path.origin, len(wanted)
    fitted = np.flatnonzero(known)
    if not len(fitted):
        nowhere, far = np.full((3, count), np.nan), np.zeros(count, bool)
        if parent is None:
            return ExpectedPoses(wanted, np.full((3, 3, count), np.nan), nowhere), far
        return ExpectedPoses(wanted, np.einsum("ijw,jk->ikw", parent[:, :, wanted], rest), nowhere), far
    place = np.searchsorted(fitted, wanted)
    before, after = fitted[np.maximum(place - 1, 0)], fitted[np.minimum(place, len(fitted) - 1)]
    share = np.clip((wanted - before) / np.maximum(after - before, 1), 0.0, 1.0)
    first, last = rotation[:, :, before], rotation[:, :, after]
    if parent is not None:
        first, last = relative_rotation(parent[:, :, before], first), relative_rotation(parent[:, :, after], last)
    step = Rotation.from_matrix(np.einsum("jiw,jkw->wik", first, last)).as_rotvec()
    between = np.einsum("ijw,wjk->ikw", first, Rotation.from_rotvec(share[:, None] * step).as_matrix())
    if parent is not None:
        between = np.einsum("ijw,jkw->ikw", parent[:, :, wanted], between)
    near = np.minimum(np.abs(wanted - before), np.abs(after - wanted)) <= reach
    middle = (1.0 - share) * origin[:, before] + share * origin[:, after]
    return ExpectedPoses(wanted, np.ascontiguousarray(between), middle), near


_FAR = 6.0
"""Scatters from its place beyond which a marker is rejected..."""
_SLACK = 0.1
"""...if it is also this share of its segment's size away."""
_PIVOTS = (*USABLE, *DOUBTED, JointStatus.UNSURE, JointStatus.INSIGNIFICANT)
"""A joint that a segment rotates about even if its own markers fix its pose."""


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
        calibration: of the same subject with the same markers (see `subject_check`).
        recording: markers under the calibration's names; those that it lacks count as always missing.
        bridge: longest time, seconds, between an unseen segment and the nearest frame in which it is seen; beyond, it
            is unknown.

    Raises:
        RecordingError: if the calibration has no segment whose markers fix its pose, or ``bridge`` is negative.
    """
    if not bridge >= 0.0:
        raise RecordingError(f"bridge = {bridge:g} seconds; it must be 0 or more")
    if not calibration.has_poses:
        raise RecordingError(
            f"{calibration.source}: no segment of this calibration has a pose; there is no skeleton to draw"
        )
    builder = _SkeletonBuilder(calibration, recording, round(bridge * recording.rate))
    for number, segment in enumerate(calibration.markerset.segments):
        builder.add_segment(number, segment)
    centers, flags = builder.joints()
    return Skeleton(
        name=recording.name,
        rate=recording.rate,
        calibration=calibration,
        rotations=builder.rotations,
        origins=builder.origins,
        segment_flags=builder.flags,
        misfits=builder.misfits,
        left_out=builder.left_out,
        centers=centers,
        flags=flags,
    )


class _SkeletonBuilder:
    """Segments placed so far; ``reach`` is the number of frames over which gaps are bridged."""

    def __init__(self, calibration: Calibration, recording: Recording, reach: int) -> None:
        self.calibration, self.recording, self.reach = calibration, recording, reach
        self.numbers = {segment.name: i for i, segment in enumerate(calibration.markerset.segments)}
        self.above = {place.joint.child: place for place in calibration.joints}
        count, n = len(self.numbers), recording.frames
        self.rotations, self.origins = np.empty((count, 3, 3, n)), np.empty((count, 3, n))
        self.flags, self.misfits = np.empty((count, n), dtype=np.uint8), np.full(count, np.nan)
        self.left_out = np.zeros(count)

    def add_segment(self, number: int, segment: Segment) -> None:
        """Place a segment in every frame; its parent is placed already."""
        shape, n = self.calibration.shape(segment.name), self.recording.frames
        place = pivot_joint(self.above.get(segment.name), shape)
        parent, pivot = -1, PivotPath(np.zeros(3), np.full((3, n), np.nan))
        if place is not None:
            parent = self.numbers[place.joint.parent]
            world = to_world(self.rotations[parent], self.origins[parent], place.in_parent)
            pivot = PivotPath(place.in_child, world)
        x = np.full((len(shape.markers), 3, n), np.nan)
        for k, marker in enumerate(shape.markers):
            if marker in self.recording.markers:
                x[k] = self.recording.of(marker)
        path = fit_full_poses(shape.places, _limits(shape, place), x, pivot)
        seen = ~np.isnan(x[:, 0])
        self.left_out[number] = 1.0 - path.used.sum() / max(seen.sum(), 1) if seen.any() else 0.0
        if path.fitted.any():
            self.misfits[number] = np.sqrt(path.square[path.fitted].mean())
        flags = self._bridge(shape, place, x, pivot, path)
        if parent >= 0:  # a segment whose joint is bridged is bridged, too
            hanging = ~np.isnan(pivot.world[0]) & (flags == Flag.SEEN)
            flags[hanging] = self.flags[parent, hanging]
        self.rotations[number], self.origins[number], self.flags[number] = path.rotation, path.origin, flags

    def _bridge(
        self, shape: SegmentShape, place: JointPlace | None, x: Floats, pivot: PivotPath, path: SegmentPath
    ) -> Bytes:
        """Complete a segment's poses where they were not fitted, and flag these frames (frames,)."""
        flags, wanted = np.zeros(self.recording.frames, dtype=np.uint8), np.flatnonzero(~path.fitted)
        if not len(wanted):
            return flags
        if place is None:
            parent, known, rest = None, path.fitted, np.eye(3)
        else:
            parent = self.rotations[self.numbers[place.joint.parent]]
            known, rest = path.fitted & ~np.isnan(parent[0, 0]), place.mean_rotation
        expected, near = expected_poses(path, parent, known, wanted, rest, self.reach)
        complete_poses(shape.places, x, pivot, expected, path)
        whole = path.used[:, wanted].all(axis=0) & (len(shape.markers) > 0) & (place is not None)
        missing = np.isnan(path.rotation[0, 0, wanted]) | np.isnan(path.origin[0, wanted])
        lost = missing | ~(near | path.used[:, wanted].any(axis=0))
        flags[wanted] = np.where(lost, Flag.UNKNOWN, np.where(whole, Flag.SEEN, Flag.BRIDGED))
        path.rotation[:, :, wanted[lost]] = path.origin[:, wanted[lost]] = np.nan
        return flags

    def joints(self) -> tuple[Floats, Bytes]:
        """Centres of the joints (joints, 3, frames) and their flags (joints, frames)."""
        places, n = self.calibration.joints, self.recording.frames
        centers, flags = np.full((len(places), 3, n), np.nan), np.full((len(places), n), Flag.UNKNOWN, dtype=np.uint8)
        for i, place in enumerate(places):
            for name, at in ((place.joint.parent, place.in_parent), (place.joint.child, place.in_child)):
                k = self.numbers[name]
                if np.isnan(at).any() or not np.isnan(centers[i, 0]).any():
                    continue
                world = to_world(self.rotations[k], self.origins[k], at)
                lacking = np.isnan(centers[i, 0]) & ~np.isnan(world[0])
                centers[i][:, lacking] = world[:, lacking]
                second = name == place.joint.child and not np.isnan(place.in_parent).any()
                flags[i, lacking] = np.maximum(self.flags[k, lacking], Flag.BRIDGED if second else Flag.SEEN)
        return centers, flags


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
