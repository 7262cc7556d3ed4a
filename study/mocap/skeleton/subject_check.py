"""Check that a calibration is of the subject in a recording, by the misfit of its segments' markers.

The markers of one subject stay at their places to a soft-tissue artefact of a few millimetres, which grows with the
motion: a functional trial with misfits of 3 mm meets 3-8 mm in a walk of the same session. Those of another subject, or
of the same one with its markers put on again, miss by 11-55 mm. So a segment does not fit if its misfit is beyond both
that range and twice its own in the recording that was calibrated, or if most of its samples are rejected.
"""

from dataclasses import dataclass

import numpy as np

from study.mocap.io.recording import RecordingError
from study.mocap.skeleton.draw_skeleton import Skeleton

_WORSE = 2.0
"""Growth of a segment's misfit above which it does not fit; between halves of one recording it is at most 1.4."""
_SESSION = 0.0095
"""Metres of misfit that are always accepted: between 8 mm, the most within a session, and 11 mm, the least beyond."""
_LEFT_OUT = 0.5
"""Share of a segment's samples left out above which it does not fit."""
_SEGMENTS = 1 / 3
"""Share of the segments above which misfits show another subject."""


@dataclass(frozen=True)
class SubjectCheck:
    """Comparison of a calibration with the subject in a recording.

    Attributes:
        same: True if the calibration is of this subject, or nothing can be compared.
        misfits: segments whose markers are far from their places, and by how much, in words.
        text: one line for a user.
    """

    same: bool
    misfits: dict[str, str]
    text: str


def check_subject(skeleton: Skeleton) -> SubjectCheck:
    """Compare a skeleton's misfits with those of its calibration."""
    misfits: dict[str, str] = {}
    compared = 0
    for shape, misfit, left_out in zip(skeleton.calibration.shapes, skeleton.misfits, skeleton.left_out, strict=True):
        if np.isnan(misfit) and not left_out:  # none of its markers, or never enough of them
            continue
        compared += 1
        if np.isnan(misfit):
            misfits[shape.segment] = "its markers fit together in no frame"
        elif left_out > _LEFT_OUT:
            misfits[shape.segment] = f"{left_out:.0%} of its samples are far from their places"
        elif misfit > max(_WORSE * shape.misfit, _SESSION):
            misfits[shape.segment] = f"{1000 * misfit:.0f} mm off, {1000 * shape.misfit:.0f} mm when calibrated"
    source, name = skeleton.calibration.source, skeleton.name
    if len(misfits) > _SEGMENTS * compared:
        listed = "; ".join(f"{segment}: {words}" for segment, words in misfits.items())
        text = (
            f"{name} does not show the subject calibrated in {source}: {len(misfits)} of {compared} segments do not "
            f"fit ({listed}); calibrate on a recording of the same session"
        )
        return SubjectCheck(False, misfits, text)
    text = f"{name} fits the calibration from {source}: {compared - len(misfits)} of {compared} segments"
    return SubjectCheck(True, misfits, text + (f", not {', '.join(misfits)}" if misfits else ""))


def require_same_subject(skeleton: Skeleton) -> Skeleton:
    """Return the skeleton, if its calibration is of the subject that it shows.

    Raises:
        RecordingError: if not; the message names the segments that do not fit and their misfits.
    """
    check = check_subject(skeleton)
    if not check.same:
        raise RecordingError(f"{check.text}, or use --force to draw with this one")
    return skeleton


def overruled(skeleton: Skeleton) -> list[str]:
    """The lines that say what is overruled where a skeleton is drawn whatever `check_subject` says; none if nothing."""
    check = check_subject(skeleton)
    return [] if check.same else [f"--force overrules: {check.text.partition('; calibrate on')[0]}"]
