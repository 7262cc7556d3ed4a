"""Gait: events of walks, and the angles of pelvis and legs over the gait cycle.

A cycle goes from one strike of a foot to the next of the same foot. Events are those that the file holds; else those of
force plates, of a foot whose heel (for a strike) or toe (for an off) is on the plate; else those of the feet's markers.
By these a heel is about to strike where it is farthest in front of the pelvis, and toes leave where they are farthest
behind it. A strike by that is some 35 ms early. So it is moved to where the heel slows down to a quarter of the walking
speed in the sagittal plane, and an off to where the toes reach three quarters of it. Two children of Vicon's files and
an adult on plates chose the shares; the medians of 26 events are within 8 ms, with standard deviations of 12 ms for
strikes and 7 ms for offs. In walks made with known strikes, of 1.1 to 1.75 m and 0.6 to 1.8 m/s, they are 9 and 10 ms
late.

On a treadmill the feet move back while they stand. The belt's speed is added to all that moves, as if the subject went
ahead.

An angle of a cycle is interpolated to 101 points, 0 to 100 %. Points more than 0.05 s from a known angle are missing.
The pelvis' angles are those to the way of the walk, in the order tilt, obliquity, rotation, as Plug-in Gait has them.

Source: Zeni, Richards & Higginson 2008, Gait & Posture 27:710-714; Bruening & Ridge 2014, Gait & Posture 39:472-477,
for shares of the walking speed; Wu et al. 2002 for the angles.
"""

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import ndimage, signal

from study.arrays import Bools, Floats, Ints
from study.recordings.export.tree import ExportedMotion, axes_errors, clinical_joints, joint_angles, zxy_errors
from study.recordings.joints.estimate import ANATOMICAL
from study.recordings.joints.find import by_words
from study.recordings.markersets import landmarks
from study.recordings.recording import Contact, GaitEvent, RecordingError
from study.recordings.rigid import to_world, zxy_angles
from study.recordings.skeleton.anatomy import legs
from study.text import columns, number

JOINTS = {"hip": "thigh", "knee": "shank", "ankle": "foot"}
"""The joints of a leg, with the segment below each."""
ANGLES = ("flexion", "adduction", "rotation")
PANELS = (
    *(("pelvis", angle) for angle in ("tilt", "obliquity", "rotation")),
    *itertools.product(JOINTS, ANGLES),
    ("foot", "progression"),
)
"""The angles of a report: joint, or segment, and angle."""
SIDES = ("left", "right")
PERCENT = np.arange(101)
"""Points of a cycle, per cent."""
FEW = 3
"""Cycles below which a standard deviation says nothing."""
_SMOOTH = 6.0
"""Hertz: cutoff of the low-pass filter of feet, above what a foot does in a walk."""
_QUICK = 10.0
"""Hertz: cutoff for the speed of a foot that strikes."""
_FASTEST, _SLOWEST = 0.5, 2.5
"""Seconds: shortest and longest cycle."""
_SWING = 0.4
"""Least excursion of a foot to a peak, as a share of its range of 5 to 95 %."""
_TOGETHER = 0.15
"""Share of a cycle between strikes of both feet below which they strike together. In gait it is 0.5 (Perry & Burnfield
2010, Gait Analysis), and 0 in jumps with both feet; the limit leaves room for a limp of a third of a cycle."""
_TRAVEL = 0.5
"""Metres: least distance from which the direction of a walk is known."""
_STRAIGHT = 0.9
"""A walk is straight if it goes so far, as a share of its length, and where the body faces."""
_HELD = 0.05
"""Seconds from the nearest known angle beyond which a point of a cycle is missing."""
_STRUCK, _GONE = 0.25, 0.75
"""Shares of the walking speed, of a heel that strikes and of toes that leave."""
_EARLY, _LATE = 0.035, 0.010
"""Seconds by which a farthest place is before a strike and after an off, where no speed shows them."""
_NEAR = 0.1
"""Seconds from a farthest place in which an event is."""
_SAME = 0.25
"""Seconds within which two events are one, half of the shortest cycle."""
_BELT = 0.15
"""Metres per second: least speed of feet that stand by which a treadmill is known."""
_SPIKE, _AROUND = 5.0, 7
"""Degrees by which a point of a curve is off the median of so many around it if it is a spike."""


@dataclass(frozen=True)
class Gait:
    """The cycles of some walks, and the angles over them.

    Attributes:
        cycles: a row per cycle: recording, side, cycle (from 1 in each recording and side), start and end, seconds;
            duration, seconds; stance, per cent of the cycle; stride, the distance that the pelvis goes, metres, on the
            belt if there is one; speed, m/s; cadence, steps per minute; step, from the other heel's strike to the own,
            along the way, and width, across it, metres; double_support, per cent of the cycle; events, the sources of
            both strikes.
        curves: a row per cycle, joint, angle and per cent: value, and error, its standard error, degrees; NaN where
            they are missing; suspect, true where a segment is bridged or the value is a spike.
        notes: what a reader should know: events, kinds of angles, walks without a cycle, doubts about the legs' joints.
        events: those of each walk.
        motions: the walks.
        reasons: the reason for each curve that is missing, by side, joint and angle.
        sticks: the body over one cycle.
    """

    cycles: pd.DataFrame
    curves: pd.DataFrame
    notes: tuple[str, ...]
    events: tuple[tuple[GaitEvent, ...], ...] = ()
    motions: tuple[ExportedMotion, ...] = ()
    reasons: Mapping[tuple[str, str, str], str] = field(default_factory=dict)
    sticks: "Sticks | None" = None

    def means(self) -> pd.DataFrame:
        """Average the curves over the cycles of all walks.

        Returns:
            A row per side, joint, angle and per cent: mean; sd over the cycles, NaN for fewer than three; cycles, their
            number; error, the root mean square standard error of one cycle; total, the standard error of the mean,
            √(error² + sd²/cycles); all but the number in degrees.
        """
        keys = ["side", "joint", "angle", "percent"]
        known = self.curves.dropna(subset="value").assign(square=lambda rows: rows["error"] ** 2)
        groups = known.groupby(keys, sort=False)
        table = groups["value"].agg(["mean", "std", "count"]).rename(columns={"std": "sd", "count": "cycles"})
        table["sd"] = table["sd"].where(table["cycles"] >= FEW)
        table["error"] = np.sqrt(groups["square"].mean())
        table["total"] = np.sqrt(table["error"] ** 2 + (table["sd"] ** 2 / table["cycles"]).fillna(0.0))
        return table.reset_index()


class Sticks(NamedTuple):
    """The body over one cycle, seen from its right side."""

    title: str
    """Recording, side and number of the cycle."""
    places: Floats
    """Of joints and ends of limbs (n, points, 2), metres before the pelvis and above the floor, at n equal steps."""
    bones: tuple[tuple[int, int], ...]
    """Pairs of numbers of points."""
    sides: tuple[str, ...]
    """Of the points, as of `Scene`."""


class Course(NamedTuple):
    """The way of a walk, z up."""

    pelvis: Floats
    """Places (3, frames), metres, interpolated; on a treadmill as if the subject went ahead."""
    way: Floats
    """Horizontal direction in which it goes in each frame (3, frames)."""
    forward: Floats
    """Horizontal direction in which the body faces in each frame (3, frames)."""
    belt: float
    """Speed of a treadmill, m/s; 0 on a floor."""
    shift: Floats
    """Metres that are added to places in each frame for the belt (3, frames)."""
    feet: Mapping[str, Floats]
    """Places of heels and toes, as "left heel" and "left toe" (3, frames), with the shift; NaN where unknown."""

    def speed(self, rate: float) -> float:
        """The median speed of the pelvis along the way, m/s."""
        return float(
            np.median((np.gradient(_smooth(self.pelvis, rate, _SMOOTH), axis=1) * self.way).sum(axis=0)) * rate
        )


def gait_of(motions: Sequence[ExportedMotion]) -> Gait:
    """Find the cycles of walks of one subject.

    Raises:
        RecordingError: if no walk has a cycle, or the marker set has no legs.
    """
    cycles, curves, events = [], [], []
    notes: list[str] = []
    sticks: list[Sticks] = []
    told: dict[str, str] = {}
    for motion in motions:
        name, joints, skeleton = motion.skeleton.name, _joints(motion), motion.skeleton
        barred = {place.joint.name: skeleton.barred_at(place.joint)[1] for place in skeleton.calibration.joints}
        told |= {name: why for name, why in barred.items() if why}
        notes += [f"{name}: {found.text}" for found in skeleton.barred]
        if any(found.name == "up" for found in skeleton.barred):
            continue
        course = walk_course(motion)
        events.append(gait_events(motion, course))
        _assert_alternating(name, events[-1])
        angles = _angles(motion, course, joints)
        rows = list(_cycles(motion, course, events[-1], angles))
        notes += _event_notes(name, events[-1], course)
        if not rows:
            notes.append(f"{name}: no whole cycle: two strikes of one heel are never seen in a row")
            continue
        cycles.append(pd.DataFrame([row for row, _ in rows]))
        curves += [table for _, table in rows]
        sticks += [_sticks(motion, course, row) for row, _ in rows[-1:] if not sticks]
    if not cycles:
        raise RecordingError("; ".join(notes))
    calibration = motions[0].skeleton.calibration
    joints = _joints(motions[0])
    clinical, legs_of = clinical_joints(calibration), set(joints.values())
    others = sorted(legs_of - set(clinical))
    if others:
        words = "no anatomical axes: zero is where bones hang straight, and curves of two subjects do not compare"
        notes.append(f"{', '.join(others)}: {words}")
    doubted = [place for place in calibration.joints if place.joint.name in legs_of and not place.usable]
    notes += by_words((p.joint.name, "doubted: " * (p.status not in ANATOMICAL) + p.reason) for p in doubted)
    every = pd.concat(curves, ignore_index=True)
    known = every.groupby(["side", "joint", "angle"], sort=False)["value"].count()
    limit = f"the error is above {motions[0].largest_angle_error:g}° in every frame, or a segment is unknown"
    reasons = {key: told.get(joints.get(key[:2], ""), limit) for key in known.index[known == 0].tolist()}
    return Gait(
        pd.concat(cycles, ignore_index=True), every, tuple(notes), tuple(events), tuple(motions), reasons, sticks[0]
    )


def _assert_alternating(name: str, events: Sequence[GaitEvent]) -> None:
    """Raise RecordingError if both feet strike together: the median share of the left foot's cycles between strikes."""
    left, right = (np.array([e.time for e in events if (e.side, e.kind) == (side, "strike")]) for side in SIDES)
    right = right[(right > left[0]) & (right < left[-1])] if len(left) > 1 else right[:0]
    if not len(right):
        return
    after = left.searchsorted(right, side="right")
    share = (right - left[after - 1]) / (left[after] - left[after - 1])
    if (phase := float(np.median(np.minimum(share, 1.0 - share)))) < _TOGETHER:
        words = f"feet strike together, {phase:.0%} of a cycle apart in the median: no walk, or labels or up are wrong"
        raise RecordingError(f"{name}: {words}")


def _by_reason(reasons: Mapping[tuple[str, str, str], str]) -> Iterator[tuple[str, str]]:
    """The curves of each reason, in words, and the reason."""
    for why in dict.fromkeys(reasons.values()):
        yield ", ".join(" ".join(key) for key, own in reasons.items() if own == why), why


def _joints(motion: ExportedMotion) -> dict[tuple[str, str], str]:
    """Names of the joints of the legs, by side and joint; those that the marker set has.

    Raises:
        RecordingError: if it has none.
    """
    calibration = motion.skeleton.calibration
    segments = legs(calibration.markerset)
    below = {place.joint.child: place.joint.name for place in calibration.joints}
    names = {(side, joint): segments.get(f"{side} {part}") for side in SIDES for joint, part in JOINTS.items()}
    joints = {key: below[name] for key, name in names.items() if name in below}
    if not joints:
        raise RecordingError(f"{motion.skeleton.name}: its marker set has no pelvis with both spines, or no leg on it")
    return joints


def walk_course(motion: ExportedMotion) -> Course:
    """Find the way of a walk, and the belt under it if the feet move back while they stand.

    Raises:
        RecordingError: if the walk has no direction, or the marker set has no legs.
    """
    skeleton, segments = motion.skeleton, legs(motion.skeleton.calibration.markerset)
    _joints(motion)
    raw = motion.upright @ skeleton.origins[skeleton.segments.index(segments["pelvis"])]
    pelvis, feet = _filled(raw), _feet(motion, segments)
    forward = _forward(motion, pelvis, feet)
    backwards = []
    for side in SIDES:
        if not {f"{side} heel", f"{side} toe"} <= feet.keys():
            continue
        heel = feet[f"{side} heel"]
        velocity = skeleton.rate * np.gradient(_smooth(_filled(heel), skeleton.rate, _SMOOTH), axis=1)
        strikes, offs = _farthest(feet, side, pelvis, forward, skeleton.rate)
        for strike in strikes:  # a quarter to a half of stance: the whole foot is on the floor
            off = next((off for off in offs if 0 < off - strike < _SLOWEST * skeleton.rate), None)
            if off is not None:
                backwards.append(-np.median(velocity[:, (3 * strike + off) // 4 : (strike + off) // 2 + 1], axis=1))
    belt = np.median(backwards, axis=0) * [1.0, 1.0, 0.0] if backwards else np.zeros(3)
    belt = belt if belt @ forward.mean(axis=1) > _BELT else np.zeros(3)
    shift = belt[:, None] * np.arange(skeleton.frames) / skeleton.rate
    way = _way(pelvis + shift, forward, skeleton.rate)
    feet = {name: place + shift for name, place in feet.items()}
    return Course(pelvis + shift, way, forward, float(np.linalg.norm(belt)), shift, feet)


def _way(pelvis: Floats, forward: Floats, rate: float) -> Floats:
    """Horizontal direction in which the pelvis (3, frames) goes, in each frame.

    It is that of the whole walk if this is straight. Else, or if the body does not face there, it is the direction in
    which the pelvis faces, averaged over a second.
    """
    places = pelvis * [[1.0], [1.0], [0.0]]
    whole = places[:, -1] - places[:, 0]
    far = np.linalg.norm(whole)
    steps = np.linalg.norm(np.diff(places[:, :: max(round(rate), 1)], axis=1), axis=0).sum()
    if far > max(_TRAVEL, _STRAIGHT * steps) and (whole @ forward).mean() > _STRAIGHT * far:
        return np.repeat((whole / far)[:, None], places.shape[1], axis=1)
    way = ndimage.uniform_filter1d(forward, max(round(rate), 1), axis=1, mode="nearest")
    return np.asarray(way / np.linalg.norm(way, axis=0))


def _feet(motion: ExportedMotion, segments: Mapping[str, str]) -> dict[str, Floats]:
    """Markers of heels and toes in the world (3, frames), z up; by their segment's pose where that is known."""
    points, feet = _landmarks(motion), {}
    for side in SIDES:
        toes = (points.get(f"{side} {name}") for name in ("toe", "first metatarsal", "fifth metatarsal"))
        toe = next((label for label in toes if label is not None), None)
        for name, label in (("heel", points.get(f"{side} heel")), ("toe", toe)):
            if label is not None:
                feet[f"{side} {name}"] = _place(motion, segments.get(f"{side} foot"), label)
    return feet


def _landmarks(motion: ExportedMotion) -> dict[str, str]:
    """The recording's labels of points of the body."""
    return landmarks(motion.recording.markers, motion.skeleton.calibration.markerset.landmarks)


def _place(motion: ExportedMotion, segment: str | None, label: str) -> Floats:
    """A marker of a foot in the world (3, frames), z up; by its segment's pose where it is missing."""
    skeleton, x = motion.skeleton, motion.recording.of(label)
    if segment is not None and label in (shape := skeleton.calibration.shape(segment)).markers:
        number = skeleton.segments.index(segment)
        at = shape.places[shape.markers.index(label)]
        by_pose = to_world(skeleton.rotations[number], skeleton.origins[number], at)
        x = np.where(np.isnan(x), by_pose, x)
    return np.asarray(motion.upright @ x)


def _filled(rows: Floats) -> Floats:
    """Rows (k, frames) with missing values interpolated in time; NaN if all are missing."""
    known = ~np.isnan(rows[0])
    frames = np.arange(rows.shape[1])
    return np.array([np.interp(frames, frames[known], row[known]) if known.any() else row for row in rows])


def _smooth(rows: Floats, rate: float, cutoff: float) -> Floats:
    """Rows (..., frames) after a low-pass filter without lag; as they are if the rate is too low, or they are short."""
    if rate <= 2.5 * cutoff or rows.shape[-1] < 30 or np.isnan(rows).any():
        return rows
    return np.asarray(signal.sosfiltfilt(signal.butter(2, cutoff, fs=rate, output="sos"), rows))


def _forward(motion: ExportedMotion, pelvis: Floats, feet: Mapping[str, Floats]) -> Floats:
    """Horizontal direction of the walk in each frame (3, frames): where the pelvis faces, or moves, or feet point."""
    skeleton = motion.skeleton
    segment = legs(skeleton.calibration.markerset)["pelvis"]
    axes = skeleton.calibration.shape(segment).anatomy
    if not np.isnan(axes).any():
        ahead = _filled(motion.upright @ np.einsum("ijt,j->it", skeleton.rotation(segment), axes[:, 0]))
    else:
        ahead = (pelvis[:, -1] - pelvis[:, 0])[:, None]
        if not np.linalg.norm(ahead[:2]) > _TRAVEL:
            pairs = [(feet.get(f"{side} toe"), feet.get(f"{side} heel")) for side in SIDES]
            pointing = [np.nanmedian(toe - heel, axis=1) for toe, heel in pairs if toe is not None and heel is not None]
            if not pointing:
                words = "its pelvis has no anatomical axes and moves less than 0.5 m, so that forward is not known"
                raise RecordingError(f"{skeleton.name}: {words}")
            ahead = np.mean(pointing, axis=0)[:, None]
        ahead = np.repeat(ahead, skeleton.frames, axis=1)
    ahead[2] = 0.0
    return np.asarray(ahead / np.linalg.norm(ahead, axis=0))


def _farthest(feet: Mapping[str, Floats], side: str, pelvis: Floats, forward: Floats, rate: float) -> tuple[Ints, Ints]:
    """Frames in which a heel is farthest in front of the pelvis and toes farthest behind it (Zeni et al. 2008)."""
    none = np.zeros(0, dtype=np.int64)
    if not {f"{side} heel", f"{side} toe"} <= feet.keys():
        return none, none
    ahead = [((feet[f"{side} {name}"] - pelvis) * forward).sum(axis=0) for name in ("heel", "toe")]
    return _peaks(ahead[0], rate), _peaks(-ahead[1], rate)


def _peaks(ahead: Floats, rate: float) -> Ints:
    """Frames of the peaks of a foot's place along the walk (frames,), metres; where it is seen."""
    known = ~np.isnan(ahead)
    if known.sum() < rate * _FASTEST:
        return np.zeros(0, dtype=np.int64)
    filled = _smooth(_filled(ahead[None])[0], rate, _SMOOTH)
    low, high = np.quantile(filled, [0.05, 0.95])
    apart = max(int(_FASTEST * rate), 1)
    peaks, _ = signal.find_peaks(filled, distance=apart, prominence=_SWING * (high - low))
    near = [known[max(peak - round(_HELD * rate), 0) : peak + round(_HELD * rate) + 1].any() for peak in peaks]
    return np.asarray(peaks[np.array(near, dtype=bool)], dtype=np.int64)


def gait_events(motion: ExportedMotion, course: Course | None = None) -> tuple[GaitEvent, ...]:
    """Find the times in which feet strike and leave the floor: by the file, else by plates, else by markers.

    A side of which the file has two strikes has the file's strikes alone.

    Returns:
        The events in their order.

    Raises:
        RecordingError: if the walk has no direction.
    """
    course = walk_course(motion) if course is None else course
    events = [*motion.recording.laboratory.events]
    marked = {side for side in SIDES if sum(e.side == side and e.kind == "strike" for e in events) > 1}
    by_markers = list(_marker_events(course, motion.skeleton.rate))
    by_plates = (
        event for load in motion.recording.laboratory.contacts for event in _of_plate(motion, course, load, by_markers)
    )
    for event in (*by_plates, *by_markers):
        alike = (e.time for e in events if (e.side, e.kind) == (event.side, event.kind))
        settled = event.kind == "strike" and event.side in marked
        if not settled and all(abs(event.time - time) > _SAME for time in alike):
            events.append(event)
    return tuple(sorted(events, key=lambda event: event.time))


def _marker_events(course: Course, rate: float) -> Iterator[GaitEvent]:
    """The events by the markers of the feet."""
    walking = course.speed(rate)
    for side in SIDES:
        found = _farthest(course.feet, side, course.pelvis, course.forward, rate)
        kinds = (("heel", "strike", _STRUCK, _EARLY), ("toe", "off", _GONE, -_LATE))
        for frames, (name, kind, share, usual) in zip(found, kinds, strict=True):
            if not len(frames):
                continue
            velocity = rate * np.gradient(_smooth(_filled(course.feet[f"{side} {name}"]), rate, _QUICK), axis=1)
            along = (velocity * course.way).sum(axis=0)
            slow = np.hypot(along, velocity[2]) < share * walking
            for frame in frames:
                yield GaitEvent(side, kind, _crossing(slow, int(frame), rate, kind, usual), "markers")


def _crossing(slow: Bools, frame: int, rate: float, kind: str, usual: float) -> float:
    """Time at which a foot gets slow, for a strike, or stops to be slow, for an off, near a frame, seconds.

    Args:
        slow: true in the frames in which the foot is slower than the threshold (frames,).
        frame: in which it is farthest.
        rate: frames per second.
        kind: ``strike`` or ``off``.
        usual: seconds from the frame to the event if the speed does not show it.
    """
    first, last = max(frame - round(_HELD * rate), 0), frame + round(_NEAR * rate) + 1
    if kind == "off":
        first, last = max(frame - round(_NEAR * rate), 0), frame + round(_HELD * rate) + 1
    change = np.flatnonzero(np.diff(slow[first:last].astype(np.int8)) == (1 if kind == "strike" else -1))
    if not len(change):
        return frame / rate + usual
    return float(first + change[0 if kind == "strike" else -1] + 0.5) / rate


def _of_plate(
    motion: ExportedMotion, course: Course, load: Contact, by_markers: Sequence[GaitEvent]
) -> Iterator[GaitEvent]:
    """The strike and the off of a load on a plate: those of a foot that is near by its markers, and on the plate."""
    corners = motion.upright @ load.corners.T
    edges = np.stack([corners[:2, 1] - corners[:2, 0], corners[:2, 3] - corners[:2, 0]])
    for kind, name, time in (("strike", "heel", load.start), ("off", "toe", load.end)):
        near = {e.side for e in by_markers if e.kind == kind and abs(e.time - time) <= _NEAR}
        for side in near:
            frame = min(round(time * motion.skeleton.rate), motion.skeleton.frames - 1)
            place = (course.feet[f"{side} {name}"] - course.shift)[:2, frame] - corners[:2, 0]
            share = (edges @ place) / (edges**2).sum(axis=1)
            if ((share >= 0.0) & (share <= 1.0)).all():
                yield GaitEvent(side, kind, time, "plate")


_SOURCES = {"file": "the file", "plate": "force plates", "markers": "the feet's markers, some ± 15 ms"}


def _event_notes(name: str, events: Sequence[GaitEvent], course: Course) -> Iterator[str]:
    """The lines that say where a walk's events come from, and that it was on a treadmill."""
    listed = []
    for source, words in _SOURCES.items():
        counts = {kind: sum((e.source, e.kind) == (source, kind) for e in events) for kind in ("strike", "off")}
        texts = [f"{count} {kind}{'s' * (count != 1)}" for kind, count in counts.items() if count]
        listed += [f"{' and '.join(texts)} by {words}"] * bool(texts)
    yield f"{name}: events: {', '.join(listed) or 'none'}"
    if course.belt:
        yield f"{name}: on a treadmill at {course.belt:.2f} m/s: stride and speed are those on the belt"


def _angles(motion: ExportedMotion, course: Course, joints: Mapping[tuple[str, str], str]) -> pd.DataFrame:
    """The angles of a report over time, degrees: columns named by side, joint and angle, each with ``_error``.

    The flag of each joint is in ``<side> <joint>_flag``.
    """
    table, skeleton = joint_angles(motion), motion.skeleton
    result: dict[str, Floats] = {"time": table["time"].to_numpy()}
    for (side, joint), name in joints.items():
        for angle in ANGLES:
            if f"{name}_{angle}" in table:
                result[f"{side} {joint} {angle}"] = table[f"{name}_{angle}"].to_numpy()
                result[f"{side} {joint} {angle}_error"] = table[f"{name}_{angle}_error"].to_numpy()
        result[f"{side} {joint}_flag"] = table[f"{name}_flag"].to_numpy()
    segments = legs(skeleton.calibration.markerset)
    up = np.broadcast_to([[0.0], [0.0], [1.0]], course.way.shape)
    world = np.stack([course.way, up, np.cross(course.way, up, axis=0)])  # rows: ahead, up, to the right
    for name in ("pelvis", *(f"{side} foot" for side in SIDES)):
        segment = segments.get(name)
        anatomy = np.full((3, 3), np.nan) if segment is None else skeleton.calibration.shape(segment).anatomy
        if segment is None or np.isnan(anatomy).any():
            continue
        number = skeleton.segments.index(segment)
        seen = np.einsum("ijt,jk->ikt", world, motion.upright)
        turn = np.einsum("ijt,jkt,kl->ilt", seen, skeleton.rotations[number], anatomy)
        covariance = np.einsum("ijt,tjk,lkt->til", seen, skeleton.turning[number], seen)
        if name == "pelvis":
            angles = np.full((3, skeleton.frames), np.nan)
            known = ~np.isnan(turn[0, 0])
            angles[:, known] = np.degrees(zxy_angles(turn[:, :, known]))
            errors = zxy_errors(turn, covariance)
            of_axes = axes_errors(skeleton.calibration, turn, None, segment)
            upside = any(found.name == "up" for found in skeleton.barred)
            errors = np.where(upside, np.nan, errors)
            for side, sign in zip(SIDES, (1.0, -1.0), strict=True):  # up, and to the front, on this side
                names = (f"{side} pelvis {angle}" for angle in ("tilt", "obliquity", "rotation"))
                for key, factor, *of in zip(names, (-1.0, sign, -sign), angles, errors, of_axes, strict=True):
                    result |= _sure(motion, key, factor * of[0], *of[1:])
                result[f"{side} pelvis_flag"] = skeleton.segment_flags[number]
            continue
        side = name.partition(" ")[0]
        inwards = np.degrees(np.arctan2(turn[2, 0], turn[0, 0])) * (1.0 if side == "left" else -1.0)
        error = np.degrees(np.sqrt(covariance[:, 1, 1]))
        above = next(p.joint for p in skeleton.calibration.joints if p.joint.child == segment)
        error = np.where(skeleton.barred_at(above)[0], np.nan, error)
        of_foot = axes_errors(skeleton.calibration, turn, None, segment)[2]
        result |= _sure(motion, f"{side} foot progression", inwards, error, of_foot)
        result[f"{side} foot_flag"] = skeleton.segment_flags[number]
    return pd.DataFrame(result)


def _sure(motion: ExportedMotion, name: str, values: Floats, errors: Floats, axes: Floats) -> dict[str, Floats]:
    """An angle (frames,) and its error, of pose and axes, degrees; NaN where that of the pose is too large."""
    with np.errstate(invalid="ignore"):
        sure = errors <= motion.largest_angle_error
    return {name: np.where(sure, values, np.nan), f"{name}_error": np.where(sure, np.hypot(errors, axes), np.nan)}


def _cycles(
    motion: ExportedMotion, course: Course, events: Sequence[GaitEvent], angles: pd.DataFrame
) -> Iterator[tuple[dict[str, object], pd.DataFrame]]:
    """Each cycle of a walk: its row of the table, and its curves."""
    skeleton = motion.skeleton
    for side in SIDES:
        strikes = [event for event in events if (event.side, event.kind) == (side, "strike")]
        count = 0
        for one, other in itertools.pairwise(strikes):
            offs = [e.time for e in events if (e.side, e.kind) == (side, "off") and one.time < e.time < other.time]
            duration = other.time - one.time
            told = one.source == other.source == "file"  # then it is a cycle, whether or not an off is known
            inside = one.time >= 0.0 and other.time <= (skeleton.frames - 0.5) / skeleton.rate
            if not (_FASTEST <= duration <= _SLOWEST and inside and (len(offs) == 1 or told)):
                continue
            count += 1
            row: dict[str, object] = {"recording": skeleton.name, "side": side, "cycle": count}
            row |= {"start": one.time, "end": other.time, "duration": duration}
            row |= _parameters(course, skeleton.rate, (one, other), offs[:1], events)
            row |= {"events": " and ".join(dict.fromkeys((one.source, other.source)))}
            tables = [
                pd.DataFrame({"joint": j, "angle": a, "percent": PERCENT} | _curve(angles, (side, j, a), (one, other)))
                for j, a in PANELS
                if f"{side} {j} {a}" in angles
            ]
            table = pd.concat(tables, ignore_index=True)
            yield row, table.assign(recording=skeleton.name, side=side, cycle=count)


def _at(rows: Floats, rate: float, time: float) -> Floats:
    """Rows (k, frames) at a time, seconds, interpolated (k,)."""
    return np.array([np.interp(time * rate, np.arange(rows.shape[1]), row) for row in rows])


def _parameters(
    course: Course,
    rate: float,
    strikes: tuple[GaitEvent, GaitEvent],
    offs: Sequence[float],
    events: Sequence[GaitEvent],
) -> dict[str, float]:
    """Stance, stride, speed, cadence, step, width and double support of a cycle; NaN where the events do not show them.

    Args:
        course: of the walk.
        rate: frames per second.
        strikes: the first and the last.
        offs: the time of the off between, if it is known.
        events: of the walk.
    """
    start, end = (strike.time for strike in strikes)
    side, duration = strikes[0].side, end - start
    opposite = "right" if side == "left" else "left"
    stride = float(np.linalg.norm((_at(course.pelvis, rate, end) - _at(course.pelvis, rate, start))[:2]))
    own_off = offs[0] if offs else np.nan
    others = {
        kind: next((e.time for e in events if (e.side, e.kind) == (opposite, kind) and start < e.time < end), np.nan)
        for kind in ("strike", "off")
    }
    double = (others["off"] - start) + (own_off - others["strike"])
    double = double if others["off"] < others["strike"] < own_off else np.nan
    step = width = np.nan
    if not np.isnan(others["strike"]) and {f"{side} heel", f"{opposite} heel"} <= course.feet.keys():
        heels = (
            _at(course.feet[f"{side} heel"], rate, end),
            _at(course.feet[f"{opposite} heel"], rate, others["strike"]),
        )
        way = _at(course.way, rate, end)[:2]
        apart = (heels[0] - heels[1])[:2]
        step, width = float(apart @ way), float(abs(apart[0] * way[1] - apart[1] * way[0]))
    row = {"stance": 100.0 * (own_off - start) / duration, "stride": stride, "speed": stride / duration}
    row |= {"cadence": 120.0 / duration, "step": step, "width": width}
    return row | {"double_support": 100.0 * double / duration}


def _curve(angles: pd.DataFrame, key: tuple[str, str, str], ends: tuple[GaitEvent, GaitEvent]) -> dict[str, object]:
    """Value and error of an angle at 0 to 100 % of a cycle, degrees, NaN where it is missing, and suspect points."""
    name = " ".join(key)
    time, wanted = angles["time"].to_numpy(), np.linspace(ends[0].time, ends[1].time, len(PERCENT))
    known = np.flatnonzero(~np.isnan(angles[name].to_numpy()))
    if not len(known):
        missing = np.full(len(PERCENT), np.nan)
        return {"value": missing, "error": missing, "suspect": np.zeros(len(PERCENT), dtype=bool)}
    near = np.abs(time[known][:, None] - wanted).min(axis=0) <= _HELD
    both = {"value": angles[name].to_numpy(), "error": angles[f"{name}_error"].to_numpy()}
    curve: dict[str, object] = {
        key: np.where(near, np.interp(wanted, time[known], values[known]), np.nan) for key, values in both.items()
    }
    bridged = angles[f"{key[0]} {key[1]}_flag"].to_numpy()[np.abs(time[:, None] - wanted).argmin(axis=0)] == 1
    return curve | {"suspect": near & (bridged | _spikes(curve["value"]))}


def _spikes(values: object) -> Bools:
    """True where a curve (101,) is far from the median around it."""
    middle = pd.Series(values).rolling(_AROUND, center=True, min_periods=_AROUND // 2 + 1).median().to_numpy()
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(np.asarray(values, dtype=float) - middle) > _SPIKE)


_STICKS = 11
"""Bodies of a stick figure over one cycle."""


def _sticks(motion: ExportedMotion, course: Course, row: Mapping[str, object]) -> Sticks:
    """The stick figure of a cycle."""
    scene, rate = motion.scene, motion.skeleton.rate
    times = np.linspace(float(row["start"]), float(row["end"]), _STICKS)  # type: ignore[arg-type]
    frames = np.clip(np.round(times * rate).astype(int), 0, motion.skeleton.frames - 1)
    points = (scene.points + course.shift)[:, :, frames]
    way = course.way[:, frames].mean(axis=1)
    ahead = np.einsum("pit,i->tp", points - course.pelvis[:, frames], way / np.linalg.norm(way))
    places = np.stack([ahead, points[:, 2].T - motion.scene.floor], axis=2)
    return Sticks(f"{row['recording']}, {row['side']} cycle {row['cycle']}", places, scene.bones, scene.sides())


def gait_lines(gait: Gait) -> Iterator[str]:
    """Lay out what is missing, the cycles by side (means and standard deviations), the mean curves, and the notes."""
    yield from (f"missing: {words}: {why}" for words, why in _by_reason(gait.reasons))
    yield from columns(list(parameter_rows(gait)), ["", "left", "right"], "<>>")
    yield from columns(list(angle_rows(gait)), ["mean over the cycles", "left", "right"], "<>>")
    yield f"±: standard error of the mean curve, median over it, {TOTAL}"
    yield from (f"note: {note}" for note in gait.notes)


TOTAL = "from poses, anatomical axes and, with three cycles or more, their spread"


def angle_rows(gait: Gait) -> Iterator[list[str]]:
    """Rows of the table of angles: which, and for both sides the range of the mean curve ± its standard error."""
    means = gait.means()
    shown = set(zip(gait.curves["joint"], gait.curves["angle"], strict=True))
    for joint, angle in (panel for panel in PANELS if panel in shown):
        texts = []
        for side in SIDES:
            own = means[(means["side"] == side) & (means["joint"] == joint) & (means["angle"] == angle)]
            low, high = (own["mean"].min(), own["mean"].max()) if len(own) else (np.nan, np.nan)
            words = f"{number(low, '.0f')}° to {number(high, '.0f')}°, ± {own['total'].median():.1f}°"
            texts.append("-" if np.isnan(low) else re.sub(r"-0(?=°)", "0", words))
        yield [f"{joint} {angle}", *texts]


_PARAMETERS = {
    "duration": ("duration of a cycle / s", ".2f"),
    "stance": ("stance / %", ".1f"),
    "double_support": ("double support / %", ".1f"),
    "stride": ("stride / m", ".2f"),
    "step": ("step / m", ".2f"),
    "width": ("step width / m", ".2f"),
    "speed": ("speed / (m/s)", ".2f"),
    "cadence": ("cadence / (steps/min)", ".0f"),
}


def parameter_rows(gait: Gait) -> Iterator[list[str]]:
    """Rows of the table of cycles: a parameter, and its mean on each side, ± standard deviation of three or more."""
    sides = [gait.cycles[gait.cycles["side"] == side] for side in SIDES]
    yield ["cycles", *(str(len(rows)) for rows in sides)]
    for key, (words, form) in _PARAMETERS.items():
        texts = []
        for rows in sides:
            mean, sd = rows[key].mean(), rows[key].std()
            spread = "" if rows[key].count() < FEW else f" ± {number(float(sd), form)}"
            texts.append("-" if np.isnan(mean) else f"{number(float(mean), form)}{spread}")
        yield [words, *texts]
