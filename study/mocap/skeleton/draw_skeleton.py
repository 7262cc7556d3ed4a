"""Phase 2: a skeleton in every frame, from a calibration and whatever markers are seen.

From the root outwards each segment hangs on its joint, J(t) = o_P(t) + R_P(t) c_J, and is turned about that onto its
markers (`pose.py`): time is proportional to the number of segments, and bones keep their lengths. What is not seen is
bridged by the hierarchy: a segment keeps the way it is turned in its parent, interpolated over a gap, for a while; it
is flagged, and so is all that hangs on it.

Source: paper §10 (second phase); theory §1.2.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from study.mocap.geometry.kabsch import out_of
from study.mocap.io.recording import Recording, RecordingError
from study.mocap.joints.estimates import USABLE, JointStatus
from study.mocap.markersets.marker_set import Segment
from study.mocap.skeleton.calibration import Calibration, Place, Shape
from study.mocap.skeleton.scene import Flag
from study.mocap.skeleton.segment_pose import follow, point
from study.sphere.types import Bools, Bytes, Floats, Ints

_FAR = 6.0
"""Scatters from its place, and..."""
_SLACK = 0.1
"""...share of its segment's size, beyond which a marker is left out."""
_PINNED = (*USABLE, JointStatus.DISAGREE, JointStatus.UNSURE, JointStatus.INSIGNIFICANT)
"""A joint on which a segment hangs even if its own markers would do without."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A skeleton over time; metres.

    Attributes:
        name: of the recording; ``rate``: its frames per second.
        calibration: what it was drawn with.
        segments: names; ``rotations`` (segments, 3, 3, frames) and ``origins`` (segments, 3, frames): x = R a + o for a
            point at a in its axes; NaN where unknown.
        segment_flags: how each is known (segments, frames), see `Flag`.
        misfits: root mean square distance of each segment's markers from where it has them (segments,); NaN if there
            was no frame to see that in.
        left_out: share of each segment's samples that were seen and are nowhere near where it has them (segments,).
        joints: names, in the marker set's order; ``centers`` (joints, 3, frames); NaN where unknown.
        flags: how each is known (joints, frames).
    """

    name: str
    rate: float
    calibration: Calibration
    segments: tuple[str, ...]
    rotations: Floats
    origins: Floats
    segment_flags: Bytes
    misfits: Floats
    left_out: Floats
    joints: tuple[str, ...]
    centers: Floats
    flags: Bytes

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.centers.shape[2])

    def rotation(self, segment: str) -> Floats:
        """Of a segment (3, 3, frames)."""
        return np.asarray(self.rotations[self.segments.index(segment)])

    def center(self, joint: str) -> Floats:
        """Of a joint (3, frames), metres."""
        return np.asarray(self.centers[self.joints.index(joint)])


def draw_skeleton(calibration: Calibration, recording: Recording, bridge: float = 1.0) -> Skeleton:
    """Phase 2: where the joints are in every frame.

    Args:
        calibration: of the same subject with the same markers on (see `check`).
        recording: markers under the calibration's names; those that it lacks count as never seen.
        bridge: seconds, at most, between an unseen segment and the nearest frame in which it was seen; what is farther
            is unknown.

    Raises:
        RecordingError: if the calibration has no segment whose markers make a frame, or ``bridge`` is negative.
    """
    if not bridge >= 0.0:
        raise RecordingError(f"bridge = {bridge:g} seconds; it must be 0 or more")
    if not any(shape.own for shape in calibration.shapes):
        raise RecordingError(
            f"{calibration.source}: no segment of this calibration has a frame; there is no skeleton to draw"
        )
    drawing = _Drawing(calibration, recording, round(bridge * recording.rate))
    for number, segment in enumerate(calibration.markerset.segments):
        drawing.segment(number, segment)
    centers, flags = drawing.joints()
    return Skeleton(
        recording.name, recording.rate, calibration, tuple(drawing.numbers), drawing.rotations, drawing.origins,
        drawing.flags, drawing.misfits, drawing.left_out,
        tuple(place.joint.name for place in calibration.joints), centers, flags,
    )  # fmt: skip


class _Drawing:
    """Segments drawn so far."""

    def __init__(self, calibration: Calibration, recording: Recording, reach: int) -> None:
        self.calibration, self.recording, self.reach = calibration, recording, reach
        self.numbers = {segment.name: i for i, segment in enumerate(calibration.markerset.segments)}
        self.above = {place.joint.child: place for place in calibration.joints}
        count, n = len(self.numbers), recording.frames
        self.rotations, self.origins = np.empty((count, 3, 3, n)), np.empty((count, 3, n))
        self.flags, self.misfits = np.empty((count, n), dtype=np.uint8), np.full(count, np.nan)
        self.left_out = np.zeros(count)

    def segment(self, number: int, segment: Segment) -> None:
        """Draw a segment; those that it hangs on are there."""
        shape, n = self.calibration.shape(segment.name), self.recording.frames
        place = hung(self.above.get(segment.name), shape)
        pin, at, parent = np.zeros(3), np.full((3, n), np.nan), -1
        if place is not None:
            parent = self.numbers[place.joint.parent]
            pin, at = place.in_child, out_of(self.rotations[parent], self.origins[parent], place.in_parent)
        x = np.full((len(shape.markers), 3, n), np.nan)
        for k, marker in enumerate(shape.markers):
            if marker in self.recording.markers:
                x[k] = self.recording.of(marker)
        rotation, origin, full, used, square = follow(shape.places, _limits(shape, place), x, pin, at)
        seen = ~np.isnan(x[:, 0])
        self.left_out[number] = 1.0 - used.sum() / max(seen.sum(), 1) if seen.any() else 0.0
        if full.any():
            self.misfits[number] = np.sqrt(square[full].mean())
        wanted = np.flatnonzero(~full)
        flags = np.zeros(n, dtype=np.uint8)
        if len(wanted):
            rest = np.eye(3) if place is None else place.rest
            known = full if parent < 0 else full & ~np.isnan(self.rotations[parent, 0, 0])
            base = self.rotations[parent] if parent >= 0 else None
            expected, start, near = _expected(rotation, origin, base, known, wanted, rest, self.reach)
            point(shape.places, x, used, pin, at, wanted, expected, start, rotation, origin)
            whole = used[:, wanted].all(axis=0) & (len(shape.markers) > 0) & (place is not None)
            lost = (
                np.isnan(rotation[0, 0, wanted]) | np.isnan(origin[0, wanted]) | ~(near | used[:, wanted].any(axis=0))
            )
            flags[wanted] = np.where(lost, Flag.UNKNOWN, np.where(whole, Flag.SEEN, Flag.BRIDGED))
            rotation[:, :, wanted[lost]] = origin[:, wanted[lost]] = np.nan
        if parent >= 0:  # what hangs on a guess is one
            hanging = ~np.isnan(at[0]) & (flags == Flag.SEEN)
            flags[hanging] = self.flags[parent, hanging]
        self.rotations[number], self.origins[number], self.flags[number] = rotation, origin, flags

    def joints(self) -> tuple[Floats, Bytes]:
        """Centres (joints, 3, frames) and how they are known (joints, frames)."""
        places, n = self.calibration.joints, self.recording.frames
        centers, flags = np.full((len(places), 3, n), np.nan), np.full((len(places), n), Flag.UNKNOWN, dtype=np.uint8)
        for i, place in enumerate(places):
            for name, at in ((place.joint.parent, place.in_parent), (place.joint.child, place.in_child)):
                k = self.numbers[name]
                if np.isnan(at).any() or not np.isnan(centers[i, 0]).any():
                    continue
                there = out_of(self.rotations[k], self.origins[k], at)
                lacking = np.isnan(centers[i, 0]) & ~np.isnan(there[0])
                centers[i][:, lacking] = there[:, lacking]
                second = name == place.joint.child and not np.isnan(place.in_parent).any()
                flags[i, lacking] = np.maximum(self.flags[k, lacking], Flag.BRIDGED if second else Flag.SEEN)
        return centers, flags


def hung(place: Place | None, shape: Shape) -> Place | None:
    """The joint on which a segment hangs; None if its own markers must do."""
    if place is None or not place.known:
        return None
    return None if shape.own and place.status not in _PINNED else place


def _limits(shape: Shape, place: Place | None) -> Floats:
    """How far from its place each marker may be (m,), metres."""
    if not len(shape.markers):
        return np.zeros(0)
    middle = shape.places.mean(axis=0) if place is None else place.in_child
    size = np.sqrt(((shape.places - middle) ** 2).sum(axis=1).mean())
    return np.asarray(np.maximum(_FAR * np.nan_to_num(shape.scatter), _SLACK * size))


def _expected(
    rotation: Floats,
    origin: Floats,
    base: Floats | None,
    known: Bools,
    wanted: Ints,
    rest: Floats,
    reach: int,
) -> tuple[Floats, Floats, Bools]:
    """How a segment would be turned in frames (w,) that do not show it, and where its origin would be.

    Between the frames that do, its turn in its parent is interpolated; before and after them it stays.

    Args:
        rotation: of it (3, 3, frames).
        origin: of it (3, frames).
        base: the parent's rotation (3, 3, frames); None for a segment that hangs on nothing.
        known: where both are known (frames,).
        wanted: frames (w,).
        rest: how it is turned in its parent on average (3, 3), if it is never seen fully.
        reach: frames that a guess lasts.

    Returns:
        Rotations (3, 3, w) and origins (3, w), NaN where the parent's is; whether a frame that shows it is near (w,).
    """
    seen = np.flatnonzero(known)
    if not len(seen):
        if base is None:
            return np.full((3, 3, len(wanted)), np.nan), np.full((3, len(wanted)), np.nan), np.zeros(len(wanted), bool)
        turned = np.einsum("ijw,jk->ikw", base[:, :, wanted], rest)
        return turned, np.full((3, len(wanted)), np.nan), np.zeros(len(wanted), bool)
    place = np.searchsorted(seen, wanted)
    before, after = seen[np.maximum(place - 1, 0)], seen[np.minimum(place, len(seen) - 1)]
    share = np.clip((wanted - before) / np.maximum(after - before, 1), 0.0, 1.0)
    first, last = rotation[:, :, before], rotation[:, :, after]
    if base is not None:
        first, last = (np.einsum("jiw,jkw->ikw", base[:, :, f], r) for f, r in ((before, first), (after, last)))
    step = Rotation.from_matrix(np.einsum("jiw,jkw->wik", first, last)).as_rotvec()
    turned = np.einsum("ijw,wjk->ikw", first, Rotation.from_rotvec(share[:, None] * step).as_matrix())
    if base is not None:
        turned = np.einsum("ijw,jkw->ikw", base[:, :, wanted], turned)
    near = np.minimum(np.abs(wanted - before), np.abs(after - wanted)) <= reach
    return np.ascontiguousarray(turned), (1.0 - share) * origin[:, before] + share * origin[:, after], near
