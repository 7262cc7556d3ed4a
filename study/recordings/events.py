"""Events of walks: when feet strike and leave the floor, and the way that the body goes.

Events are those that the file holds; else those of force plates, of a foot whose heel (for a strike) or toe (for an
off) is on the plate; else those of the feet's markers. By these a heel is about to strike where it is farthest in front
of the pelvis, and toes leave where they are farthest behind it. A strike by that is some 35 ms early. So it is moved to
where the heel slows down to a quarter of the walking speed in the sagittal plane, and an off to where the toes reach
three quarters of it. Two children of Vicon's files and an adult on plates chose the shares; the medians of 26 events
are within 8 ms, with standard deviations of 12 ms for strikes and 7 ms for offs. In walks made with known strikes, of
1.1 to 1.75 m and 0.6 to 1.8 m/s, they are 9 and 10 ms late.

On a treadmill the feet move back while they stand. The belt's speed is added to all that moves, as if the subject went
ahead.

Source: Zeni, Richards & Higginson 2008, Gait & Posture 27:710-714; Bruening & Ridge 2014, Gait & Posture 39:472-477,
for shares of the walking speed.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy import ndimage, signal

from study.arrays import Bools, Floats, Ints
from study.recordings.export.tree import ExportedMotion
from study.recordings.markersets import landmarks
from study.recordings.recording import Contact, GaitEvent, RecordingError
from study.recordings.rigid import to_world
from study.recordings.skeleton.anatomy import legs

SIDES = ("left", "right")
FASTEST, SLOWEST = 0.5, 2.5
"""Seconds: shortest and longest cycle."""
HELD = 0.05
"""Seconds from the nearest known value up to which a missing one is interpolated."""
_SMOOTH = 6.0
"""Hertz: cutoff of the low-pass filter of feet, above what a foot does in a walk."""
_QUICK = 10.0
"""Hertz: cutoff for the speed of a foot that strikes."""
_SWING = 0.4
"""Least excursion of a foot to a peak, as a share of its range of 5 to 95 %."""
_TOGETHER = 0.15
"""Share of a cycle between strikes of both feet below which they strike together. It is 0.5 in an even gait and 0 in
jumps; the limit leaves room for a limp of a third of a cycle."""
_TRAVEL = 0.5
"""Metres: least distance from which the direction of a walk is known."""
_STRAIGHT = 0.9
"""A walk is straight if it goes so far, as a share of its length, and where the body faces."""
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


def walk_course(motion: ExportedMotion) -> Course:
    """Find the way of a walk, and the belt under it if the feet move back while they stand.

    Raises:
        RecordingError: if the walk has no direction.
    """
    skeleton, segments = motion.skeleton, legs(motion.skeleton.calibration.markerset)
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
            off = next((off for off in offs if 0 < off - strike < SLOWEST * skeleton.rate), None)
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
    feet: dict[str, Floats] = {}
    points = landmarks(motion.recording.markers, motion.skeleton.calibration.markerset.landmarks)
    for side in SIDES:
        kinds = {"heel": ("heel",), "toe": ("toe", "first metatarsal", "fifth metatarsal")}
        for kind, names in kinds.items():
            labels = [points[f"{side} {name}"] for name in names if f"{side} {name}" in points]
            feet |= {f"{side} {kind}": _place(motion, segments.get(f"{side} foot"), label) for label in labels[:1]}
    return feet


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
    if known.sum() < rate * FASTEST:
        return np.zeros(0, dtype=np.int64)
    filled = _smooth(_filled(ahead[None])[0], rate, _SMOOTH)
    low, high = np.quantile(filled, [0.05, 0.95])
    apart = max(int(FASTEST * rate), 1)
    peaks, _ = signal.find_peaks(filled, distance=apart, prominence=_SWING * (high - low))
    near = [known[max(peak - round(HELD * rate), 0) : peak + round(HELD * rate) + 1].any() for peak in peaks]
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
    first, last = max(frame - round(HELD * rate), 0), frame + round(_NEAR * rate) + 1
    if kind == "off":
        first, last = max(frame - round(_NEAR * rate), 0), frame + round(HELD * rate) + 1
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


def assert_alternating(name: str, events: Sequence[GaitEvent]) -> None:
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


_SOURCES = {"file": "the file", "plate": "force plates", "markers": "the feet's markers, some ± 15 ms"}


def event_notes(name: str, events: Sequence[GaitEvent], course: Course) -> Iterator[str]:
    """The lines that say where a walk's events come from, and that it was on a treadmill."""
    listed = []
    for source, words in _SOURCES.items():
        counts = {kind: sum((e.source, e.kind) == (source, kind) for e in events) for kind in ("strike", "off")}
        texts = [f"{count} {kind}{'s' * (count != 1)}" for kind, count in counts.items() if count]
        listed += [f"{' and '.join(texts)} by {words}"] * bool(texts)
    lacking = [f"{side} {point}" for side in SIDES for point in ("heel", "toe") if f"{side} {point}" not in course.feet]
    words = f"; no label of the file is that of a {', '.join(lacking)}" if lacking else ""
    yield f"{name}: events: {', '.join(listed) or 'none'}{words}"
    if course.belt:
        yield f"{name}: on a treadmill at {course.belt:.2f} m/s: stride and speed are those on the belt"
