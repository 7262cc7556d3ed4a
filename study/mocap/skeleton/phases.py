"""Both phases, from a recording to what is drawn, and whether a calibration is of the subject that a recording shows.

A subject's markers are where the calibration has them, to a few millimetres of skin. Another body, or the same one
with its markers put on anew, is off by centimetres: that shows in how far the markers of each segment are from their
places, against how far they were in the recording that was calibrated.
"""

from dataclasses import dataclass, replace

import numpy as np

from study.mocap.geometry.convex_hull import outside
from study.mocap.io.recording import Recording, RecordingError
from study.mocap.joints.estimates import USABLE
from study.mocap.joints.fit_joints import Joints, find_joints
from study.mocap.markersets.marker_set import MarkerSet
from study.mocap.skeleton.calibration import Calibration, keep
from study.mocap.skeleton.draw_skeleton import Skeleton, draw_skeleton
from study.mocap.skeleton.make_scene import Shown, stage
from study.mocap.skeleton.scene import Scene

_WORSE = 2.0
"""Growth of a segment's misfit above which it is another's: between halves of one recording it is at most 1.4."""
_SMALL = 0.001
"""Metres of misfit that are never too much."""
_LEFT_OUT = 0.5
"""Share of a segment's samples left out above which it is another's."""
_SEGMENTS = 1 / 3
"""Share of the segments that may be another's; the rest are the subject's."""


def calibrate(recording: Recording, markerset: MarkerSet) -> Calibration:
    """Phase 1: fit joints and shapes to a recording.

    Args:
        recording: markers under the set's names (see `match`).
        markerset: segments and joints.

    Returns:
        The calibration; every joint has a status and a reason, and those that could not be found have no place.
    """
    return calibrated(find_joints(markerset, recording), recording)


def calibrated(joints: Joints, recording: Recording) -> Calibration:
    """The calibration that joints make which were found in a recording (see `calibrate`)."""
    found = keep(joints, recording)
    if not any(shape.own for shape in found.shapes):
        return found
    misfits = draw_skeleton(found, recording).misfits
    shapes = tuple(replace(shape, misfit=float(misfit)) for shape, misfit in zip(found.shapes, misfits, strict=True))
    return replace(found, shapes=shapes)


@dataclass(frozen=True)
class Verdict:
    """Whether a calibration is of the subject that a recording shows.

    Attributes:
        fits: whether it is.
        off: segments whose markers are not where the calibration has them, with by how much, in words.
        words: one line for a user.
    """

    fits: bool
    off: dict[str, str]
    words: str


def check(skeleton: Skeleton) -> Verdict:
    """Judge a calibration by a skeleton drawn with it."""
    off: dict[str, str] = {}
    judged = 0
    for shape, misfit, left_out in zip(skeleton.calibration.shapes, skeleton.misfits, skeleton.left_out, strict=True):
        if not len(shape.markers):
            continue
        judged += 1
        if left_out > _LEFT_OUT:
            off[shape.segment] = f"{left_out:.0%} of its samples are nowhere near"
        elif misfit > max(_WORSE * shape.misfit, _SMALL):
            off[shape.segment] = f"{1000 * misfit:.0f} mm off, {1000 * shape.misfit:.0f} mm when calibrated"
    source, name = skeleton.calibration.source, skeleton.name
    if len(off) > _SEGMENTS * judged:
        listed = "; ".join(f"{segment}: {words}" for segment, words in off.items())
        return Verdict(
            False, off,
            f"{name} does not show the subject calibrated in {source}: {len(off)} of {judged} segments do not fit "
            f"({listed}); calibrate on a recording of the same session",
        )  # fmt: skip
    words = f"{name} fits the calibration from {source}: {judged - len(off)} of {judged} segments"
    return Verdict(True, off, words + (f", not {', '.join(off)}" if off else ""))


def require_same_subject(skeleton: Skeleton) -> Skeleton:
    """The skeleton, if its calibration is of the subject that it shows.

    Raises:
        RecordingError: if not; the message says which segments do not fit and by how much.
    """
    verdict = check(skeleton)
    if not verdict.fits:
        raise RecordingError(verdict.words)
    return skeleton


def skeleton_scene(skeleton: Skeleton, recording: Recording) -> Scene:
    """What pictures show of a skeleton.

    Joints that are not to be relied on say why, those that leave the markers' hull among them. A skeleton drawn with
    another subject's calibration says so, too.

    Args:
        skeleton: of phase 2.
        recording: that it was drawn from.

    Raises:
        RecordingError: if none of its joints is known in any frame.
    """
    verdict, kept = check(skeleton), skeleton.calibration
    own = kept.source == skeleton.name
    source = "joints found in this recording" if own else f"joints found in {kept.source}"
    doubts = [] if verdict.fits else ["another subject's calibration"]
    joints = []
    hull = outside(recording.positions, skeleton.centers)
    for place, center, flags, out in zip(kept.joints, skeleton.centers, skeleton.flags, hull, strict=True):
        reasons = [*([] if place.status in USABLE else [place.reason]), *([out.words] if out.words else []), *doubts]
        axis = None if np.isnan(place.axis_in_parent).any() else place.axis_in_parent
        joint = place.joint
        shown = Shown(
            joint.name, joint.parent, joint.child, center, skeleton.rotation(joint.parent), place.covariance, axis,
            flags, "; ".join(reasons),
        )  # fmt: skip
        joints.append(shown)
    notes = [*recording.notes, *([] if verdict.fits and not verdict.off else [verdict.words])]
    return stage(recording, kept.markerset, joints, source, notes)
