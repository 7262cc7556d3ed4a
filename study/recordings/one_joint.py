"""One joint of a recording, fitted to the markers of its two segments, with its range of motion and its doubts.

The markers are those of the labels that a user gave, looked up in the recording. The two points that place a hinge
along its axis must be on its segments, and near the joint. Gait software writes its centres beside the markers: LHJC,
RHJC (Vicon's Plug-in Gait, Visual3D), L_HipCentre, RightHipCenter and the like. They are another method's answer, not
the truth; their distances from the joint are reported.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from study.arrays import Floats
from study.recordings.joints.estimate import CENTIMETRE, SHORT_TEXTS, JointStatus
from study.recordings.joints.find import Calibration, JointPlace, find_joints, with_allowance
from study.recordings.joints.poses import SegmentPoses
from study.recordings.joints.report import accuracy_columns
from study.recordings.markersets import Joint, MarkerSet, Segment
from study.recordings.recording import Recording, RecordingError
from study.recordings.rigid import relative_rotation, rotation_range
from study.recordings.skeleton.calibrate import hull_distances, hull_doubt
from study.text import did_you_mean, json_text, number

_LOOSE = 0.05
"""Metres: greatest root mean square distance, from its mean place, of a point that is on a segment, with its skin."""
_OFF = 0.05
"""Metres: greatest distance from a hinge's axis of the middle of points at its ends. At real knees it is up to 3 cm."""
_ALONG = 0.1
"""Metres: greatest distance along the axis of that middle from the spheres' centre. At real knees it is up to 8 cm."""


def misplaced_across(
    found: JointPlace, poses: Mapping[str, SegmentPoses], own: Sequence[str], recording: Recording
) -> tuple[str, ...]:
    """Find reasons why the two points across a hinge's axis are not at the joint.

    Args:
        found: the joint; one without such points, or without an axis, has no reason.
        poses: of its segments.
        own: markers that a user named on these.
        recording: that has the points.

    Returns:
        Sentences: a point moves in the axes of each segment; the middle is far from the axis; the markers of a joint
        that rotated about every direction show its place along the axis, and the middle is elsewhere.
    """
    estimate, across = found.estimate, found.joint.across
    if estimate is None or estimate.axis is None or not across:
        return ()
    reasons = []
    for label in (label for label in across if label not in own):
        local = [segment.to_local(recording.of(label)) for segment in poses.values()]
        seen = [y[:, ~np.isnan(y[0])] for y in local]
        moves = min((np.sqrt(y.var(axis=1).sum()) if y.shape[1] else 0.0 for y in seen), default=0.0)
        if moves > _LOOSE:
            reasons.append(f"{label} is on neither segment: it moves by {1000 * moves:.0f} mm in their axes")
    middle = estimate.poses.mean_place(0.5 * (recording.of(across[0]) + recording.of(across[1])))
    if np.isnan(middle).any():
        return tuple(reasons)
    name, off = f"the middle of {' and '.join(across)}", middle - estimate.center
    away = float(np.linalg.norm(off - (off @ estimate.axis) * estimate.axis))
    if away > _OFF:
        reasons.append(f"{name} is {1000 * away:.0f} mm from its axis")
    # where the markers put the joint along its axis, too, the middle is not elsewhere
    sphere, pair = estimate.sphere, estimate.pair
    free = sphere.axis is None if sphere is not None else pair is not None and not pair.hinge
    shown = sphere.center if sphere is not None else pair.in_parent if pair is not None else middle
    along = abs(float((middle - shown) @ estimate.axis)) if free else 0.0
    if along > _ALONG:
        centre = f"its centre is {1000 * along:.0f} mm from {name}"
        reasons.append(f"it is no hinge: it rotated about every direction, and {centre}")
    return tuple(reasons)


PARENT, CHILD, JOINT = "parent", "child", "joint"
"""Names of the two segments and of the joint."""


def find_clusters(recording: Recording, parent: str, child: str, across: str = "", hinge: bool = False) -> MarkerSet:
    """Look up the markers of two segments in a recording.

    Args:
        recording: that has them.
        parent: labels with commas between them, at least three: their pose gives the axes of the answer; a subject's
            prefix and the case of letters do not matter.
        child: likewise, at least one; with three or more the child has a pose, and the joint a second opinion.
        across: likewise, the lateral and the medial point, midway between which a hinge lies along its axis; empty if
            there are none.
        hinge: True if the joint is known to be a hinge, such as a knee or an elbow.

    Returns:
        The marker set with these two segments and one joint between them.

    Raises:
        RecordingError: one line: unknown labels, with the nearest ones of the recording; markers without any sample; a
            marker that is named twice; fewer than three markers of the parent, none of the child, or one or more than
            two for the axis.
    """
    folded, exact = {label.casefold(): label for label in reversed(recording.markers)}, set(recording.markers)
    options = {f"--{PARENT}": parent, f"--{CHILD}": child, "--across": across}
    named = {option: [name for part in text.split(",") if (name := part.strip())] for option, text in options.items()}

    def label(name: str) -> str:
        """The recording's label of this name, with the subject's prefix or without, in capitals or not; "" if none."""
        forms = name, name.rpartition(":")[2].strip()
        labelled = (form if form in exact else folded.get(form.casefold(), "") for form in forms)
        return next(filter(None, labelled), "")

    if unknown := [name for names in named.values() for name in names if not label(name)]:
        lacking = {option: [repr(name) for name in names if name in unknown] for option, names in named.items()}
        listed = "; ".join(f"{option} {', '.join(names)}" for option, names in lacking.items() if names)
        remedy = did_you_mean(unknown, recording.markers)
        raise RecordingError(f"{recording.name}: no marker of this name: {listed}; {remedy}")
    clusters = [tuple(map(label, names)) for names in named.values()]
    if fault := next(_faults(recording, *clusters), ""):
        raise RecordingError(f"{recording.name}: {fault}")
    segments = Segment(name=PARENT, markers=clusters[0]), Segment(name=CHILD, markers=clusters[1], parent=PARENT)
    joint = Joint(name=JOINT, parent=PARENT, child=CHILD, kind="hinge" if hinge else "ball", across=clusters[2])
    return MarkerSet(name="one joint", segments=segments, joints=(joint,))


def _faults(recording: Recording, parent: Sequence[str], child: Sequence[str], across: Sequence[str]) -> Iterator[str]:
    """Reasons why labels of a recording cannot fix a joint whatever the motion."""
    markers = [*parent, *child]
    if twice := [label for label in dict.fromkeys(markers) if markers.count(label) > 1]:
        yield f"{', '.join(twice)} is named twice; name each marker once, on the segment that it is on"
    if across and len(set(across)) != 2:
        yield f"--across names {len(set(across))} points; it takes two"
    missing = recording.missing()
    if never := [label for label in dict.fromkeys([*markers, *across]) if missing[recording.row(label)] == 1.0]:
        yield f"{', '.join(never)} has no sample in any frame; name other markers of the segment"
    if not child:
        yield "--child names no marker; one is enough, three give a second opinion"
    if len(parent) < 3:
        swap = "; --child has enough: exchange the two, the joint is the same point" if len(child) > 2 else ""
        yield f"--parent names {len(parent)} markers; its axes need 3{swap}"


_PATTERN = re.compile(r"(hip|knee|ankle|shoulder|elbow|wrist)[\s_.-]*(joint)?[\s_.-]*cent(re|er)|[hkaswe]jc$", re.I)
NEAR = 0.1
"""Metres within which another program's centre may be of this joint, and not of the other side's."""


Centre = tuple[str, float, int]
"""A point of a recording that another program calls a joint's centre.

Its label; the median over the frames of its distance from the joint, across the axis of a hinge, metres; and the number
of frames with both.
"""


def is_centre(label: str) -> bool:
    """True for the label of a joint's centre, such as LHJC, rkjc or Left_HipCentre."""
    return _PATTERN.search(label.strip()) is not None


def other_centres(recording: Recording, joint: Floats, axis: Floats | None = None) -> tuple[Centre, ...]:
    """Measure the distances of other programs' centres from a joint.

    Args:
        recording: that may hold such points.
        joint: the joint's place in the recording (3, frames), metres; NaN where unknown.
        axis: direction of a hinge's axis in the recording (3, frames), of length 1; None for a ball.

    Returns:
        One for each such point that is seen together with the joint, the nearest first.
    """
    centres = []
    for label in filter(is_centre, recording.markers):
        off = recording.of(label) - joint
        off = off if axis is None else off - (off * axis).sum(axis=0) * axis
        distance = np.linalg.norm(off, axis=0)
        distance = distance[~np.isnan(distance)]
        if len(distance):
            centres.append((label, float(np.median(distance)), len(distance)))
    return tuple(sorted(centres, key=lambda centre: centre[1]))


_ONE_AXIS = 0.2
"""Least angle of motion, as a share of the greatest, of a ball joint: skin of a hinge moves as far about other axes."""
_ERRORS = 3.0
"""Standard errors beyond which another program's centre contradicts the joint, if it is a centimetre away, too."""


@dataclass(frozen=True)
class OneJoint:
    """A joint between two clusters of markers. Lengths are in metres, angles in degrees; NaN where there is none.

    Attributes:
        recording: its name.
        markerset: the two segments, with the markers that the joint was fitted to.
        found: the joint in both segments, with its status and estimates.
        in_recording: mean place over the frames, in the recording's axes (3,).
        frame: number, from 1, of the frame in which the parent's axes are the recording's; their origin is the mean of
            the parent's markers. 0 if the parent has no pose.
        places: of the parent's markers in its axes (markers, 3).
        error: largest standard error, across the axis of a hinge.
        moved: least and greatest root mean square angle of the markers' motion about the joint.
        turn: angle about the mean orientation within which 95 % of the child's rotations in the parent lie.
        frames: number of frames used.
        effective_frames: effective number of independent frames.
        compared: centres that other programs left in the recording, the nearest first.
        misplaced: reasons why the points across its axis cannot be there.
        doubts: all reasons not to rely on the joint.
    """

    recording: str
    markerset: MarkerSet
    found: JointPlace
    in_recording: Floats
    frame: int
    places: Floats
    error: float
    moved: tuple[float, float]
    turn: float
    frames: int
    effective_frames: float
    compared: tuple[Centre, ...]
    misplaced: tuple[str, ...]
    doubts: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """True if the joint is of the kind that the user gave, ball or hinge, and nothing speaks against it."""
        return not self.doubts


def fit_one_joint(recording: Recording, markerset: MarkerSet) -> OneJoint:
    """Fit the joint between two clusters of markers.

    The fit is that of phase 1 (`find_joints`) on a marker set of two segments.

    Args:
        recording: that has the markers.
        markerset: of the two segments (see `find_clusters`).

    Returns:
        The joint; one that cannot be found has a status, a reason and NaN for its place.
    """
    joints = find_joints(markerset, recording.select((*markerset.markers(), *markerset.between())))
    found = with_allowance(joints[JOINT])
    n = accuracy_columns(joints, found)
    parent, child = joints.poses.get(PARENT), joints.poses.get(CHILD)
    world, axis, turn, frame = np.full((3, recording.frames), np.nan), None, np.nan, 0
    places = np.full((len(markerset.segment(PARENT).markers), 3), np.nan)
    if parent is not None:
        world, places = parent.to_world(found.in_parent), parent.template[-len(places) :]  # a joint is before markers
        frame = int(np.nan_to_num(np.einsum("iit->t", parent.rotation), nan=-1.0).argmax()) + 1
        axis = None if found.axis is None else np.einsum("ijt,j->it", parent.rotation, found.axis)
        if child is not None:
            turn = float(np.degrees(rotation_range(relative_rotation(parent.rotation, child.rotation))))
    known = ~np.isnan(world[0])
    mean = world[:, known].mean(axis=1) if known.any() else np.full(3, np.nan)
    compared = other_centres(recording, world, axis)
    misplaced = misplaced_across(found, joints.poses, markerset.markers(), recording)
    doubts = [*misplaced, *_doubts(joints, n, recording, world)]
    # the nearest of other programs' centres may be of this joint, but contradict its error
    if compared and max(CENTIMETRE, _ERRORS * n["error"]) < compared[0][1] < NEAR:
        label, distance, _ = compared[0]
        doubts.append(f"{label} of another program is {1000 * distance:.0f} mm away, beyond what the error explains")
    moved, frames = (n["moved_least"], n["moved_most"]), 0 if found.estimate is None else found.estimate.fit.frames
    effective = n["effective_frames"]
    fitted = recording.name, markerset, found, mean, frame, places, n["error"], moved, turn, frames, effective
    return OneJoint(*fitted, compared, misplaced, tuple(doubts))


def _doubts(joints: Calibration, n: Mapping[str, float], recording: Recording, world: Floats) -> list[str]:
    """Reasons not to rely on a joint: its status, a pose that is missing, a place outside the body."""
    found = joints[JOINT]
    # a ball that moved as a hinge has no centre
    wanted = JointStatus.HINGE if found.joint.kind == "hinge" else JointStatus.OK
    doubts = [] if found.status == wanted else [found.reason]
    if found.joint.kind == "ball" and n["moved_least"] < _ONE_AXIS * n["moved_most"]:
        moved = f"it moved by {n['moved_least']:.0f}° about one axis and {n['moved_most']:.0f}° about another"
        remedy = "a joint with one axis, as a knee, is a hinge (--hinge); soft tissue alone may place it along the axis"
        doubts.append(f"{moved}: {remedy}")
    doubts += joints.without_pose.values() if found.estimate is None else ()
    markers, place = recording.positions[[not is_centre(label) for label in recording.markers]], world[None]
    if not np.isnan(world).all():
        seen = ""
        if found.axis is not None and not found.joint.across:  # the joint's place along its axis is unknown
            flat = np.einsum("ijt,jk->kit", joints.poses[PARENT].rotation, null_space(found.axis[None]))
            markers, place = (np.einsum("kit,mit->mkt", flat, x) for x in (markers, place))
            seen = "seen along its axis, "
        doubts += [seen + doubt for doubt in map(hull_doubt, *hull_distances(markers, place)) if doubt]
    return doubts


def joint_line(joint: OneJoint) -> str:
    """A joint in one line: status, centre, error, range of motion, comparison and doubts; millimetres and degrees."""
    found = joint.found
    parts = [f"{joint.recording}: {SHORT_TEXTS[found.status]}"]
    center, mean = (", ".join(f"{1000 * x:.1f}" for x in place) for place in (found.in_parent, joint.in_recording))
    if not np.isnan(found.in_parent).any():
        parts.append(f"centre ({center}) ± {1000 * joint.error:.1f} mm in the parent's axes")
        parts.append(f"mean ({mean}) mm in the recording's")
    if found.axis is not None:
        between = " and ".join(found.joint.across)
        place = f"midway between {between}" if between else "not known"
        parts.append(f"axis ({', '.join(f'{x:.3f}' for x in found.axis_in_parent)}), the place along it is {place}")
    turned = "" if math.isnan(joint.turn) else f", 95 % of the rotations within {joint.turn:.0f}°"
    if not math.isnan(joint.moved[0]):
        parts.append(f"moved {joint.moved[0]:.0f}°-{joint.moved[1]:.0f}°{turned}")
    if joint.frames:
        parts.append(f"{joint.frames} frames, effectively {number(joint.effective_frames, '.0f')}")
    across = "" if found.axis is None else " across the axis"
    near = [*joint.compared[:1], *(centre for centre in joint.compared[1:] if centre[1] < NEAR)]
    parts += [f"{label} of another program is {1000 * distance:.1f} mm away{across}" for label, distance, _ in near]
    parts.append(f"doubts: {'; '.join(joint.doubts)}" if joint.doubts else "no doubts")
    return "; ".join(parts)


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
    parent, child = joint.markerset.segments
    values = {
        "recording": joint.recording,
        "parent_markers": dict(zip(parent.markers, joint.places, strict=True)),
        "child_markers": child.markers,
        "kind": found.joint.kind,
        "ok": joint.ok,
        "status": SHORT_TEXTS[found.status],
        "doubts": joint.doubts,
        "center": found.in_parent,
        "covariance": found.covariance,
        "error": joint.error,
        "axis": found.axis,
        "center_in_recording": joint.in_recording,
        "axes_frame": joint.frame,
        **dict(zip(("moved_least", "moved_most"), joint.moved, strict=True)),
        "turn": joint.turn,
        "side": None if estimate is None else estimate.side,
        "frames": joint.frames,
        "effective_frames": joint.effective_frames,
        "compared": [dict(zip(("label", "distance", "frames"), centre, strict=True)) for centre in joint.compared],
    }
    return json_text(values)
