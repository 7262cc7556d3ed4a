"""One joint as a line for a reader, and as JSON for a program."""

import math
from collections.abc import Iterator

import numpy as np

from study.mocap.joints.joint_table import SHORT_TEXTS
from study.mocap.one_joint.left_centres import NEAR, LeftCentre
from study.mocap.one_joint.one_joint import OneJoint
from study.sphere.types import Floats
from study.text.json_text import json_text
from study.text.numbers import number


def joint_line(joint: OneJoint) -> str:
    """A joint in one line: status, centre, error, range of motion, comparison and doubts; millimetres and degrees."""
    return "; ".join(_parts(joint))


def joint_json(joint: OneJoint) -> str:
    """A joint as a JSON object, in metres and degrees; null where there is no number.

    Keys: ``recording``; ``parent_markers``, an object with the place of each in the parent's axes; ``child_markers``;
    ``kind``; ``ok``; ``status``, in words as in the table of `study joints`; ``doubts``; ``center``, in the parent's
    axes; ``covariance``; ``error``; ``axis`` of a hinge; ``center_in_recording``, the mean over the frames;
    ``axes_frame``, the frame, from 1, in which the parent's axes are the recording's; ``moved_least``, ``moved_most``;
    ``turn``; ``side``, the segment in whose axes it was fitted, or both; ``frames``; ``effective_frames``;
    ``compared``, a list of objects with ``label``, ``distance`` and ``frames``.
    """
    found, estimate = joint.found, joint.found.estimate
    places = zip(joint.clusters.parent, joint.places, strict=True)
    values = {
        "recording": joint.recording,
        "parent_markers": dict(places),
        "child_markers": list(joint.clusters.child),
        "kind": found.joint.kind,
        "ok": joint.ok,
        "status": SHORT_TEXTS[found.status],
        "doubts": list(joint.doubts),
        "center": found.in_parent,
        "covariance": found.covariance,
        "error": joint.error,
        "axis": None if np.isnan(found.axis_in_parent).any() else found.axis_in_parent,
        "center_in_recording": joint.in_recording,
        "axes_frame": joint.frame,
        "moved_least": joint.moved[0],
        "moved_most": joint.moved[1],
        "turn": joint.turn,
        "side": None if estimate is None else estimate.side,
        "frames": joint.frames,
        "effective_frames": joint.effective_frames,
        "compared": [each._asdict() for each in joint.compared],
    }
    return json_text(values)


def _parts(joint: OneJoint) -> Iterator[str]:
    found = joint.found
    yield f"{joint.recording}: {SHORT_TEXTS[found.status]}"
    if not np.isnan(found.in_parent).any():
        yield f"centre ({_millimetres(found.in_parent)}) ± {1000 * joint.error:.1f} mm in the parent's axes"
        yield f"mean ({_millimetres(joint.in_recording)}) mm in the recording's"
    if not np.isnan(found.axis_in_parent).any():
        between = " and ".join(found.joint.across)
        place = f"midway between {between}" if between else "not known"
        yield f"axis ({', '.join(f'{x:.3f}' for x in found.axis_in_parent)}), the place along it is {place}"
    turned = "" if math.isnan(joint.turn) else f", 95 % of the rotations within {joint.turn:.0f}°"
    if not math.isnan(joint.moved[0]):
        yield f"moved {joint.moved[0]:.0f}°-{joint.moved[1]:.0f}°{turned}"
    if joint.frames:
        yield f"{joint.frames} frames, effectively {number(joint.effective_frames, '.0f')}"
    across = "" if np.isnan(found.axis_in_parent).any() else " across the axis"
    yield from (
        f"{_comparison(each)}{across}" for i, each in enumerate(joint.compared) if i == 0 or each.distance < NEAR
    )
    yield f"doubts: {'; '.join(joint.doubts)}" if joint.doubts else "no doubts"


def _comparison(centre: LeftCentre) -> str:
    return f"{centre.label} of another program is {1000 * centre.distance:.1f} mm away"


def _millimetres(place: Floats) -> str:
    return ", ".join(f"{1000 * x:.1f}" for x in place)
