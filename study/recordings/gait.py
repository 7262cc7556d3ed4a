"""Gait: events of walks, and the angles of hips, knees and ankles over the gait cycle.

A cycle goes from one strike of a heel to the next of the same heel. Events come from the markers of the feet: a heel
strikes where it is farthest in front of the pelvis, and toes leave the floor where they are farthest behind it, along
the direction in which the pelvis faces, or moves. Force plates are not read.

An angle of a cycle is interpolated to 101 points, 0 to 100 %. Points more than 0.05 s from a known angle are missing.

Source: Zeni, Richards & Higginson 2008, Gait & Posture 27:710-714; Wu et al. 2002 for the angles.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from scipy import signal

from study.arrays import Floats, Ints
from study.recordings.export.tree import ExportedMotion, clinical_joints, joint_angles
from study.recordings.joints.estimate import ANATOMICAL
from study.recordings.joints.find import by_words
from study.recordings.markersets import landmarks
from study.recordings.recording import RecordingError
from study.recordings.rigid import to_world
from study.recordings.skeleton.anatomy import legs
from study.text import columns, number

JOINTS = {"hip": "thigh", "knee": "shank", "ankle": "foot"}
"""The joints of a leg, with the segment below each."""
ANGLES = ("flexion", "adduction", "rotation")
SIDES = ("left", "right")
PERCENT = np.arange(101)
"""Points of a cycle, per cent."""
_SMOOTH = 6.0
"""Hertz: cutoff of the low-pass filter of feet, above what a foot does in a walk."""
_FASTEST, _SLOWEST = 0.5, 2.5
"""Seconds: shortest and longest cycle."""
_SWING = 0.4
"""Least excursion of a foot to a peak, as a share of its range of 5 to 95 %."""
_TOGETHER = 0.15
"""Share of a cycle between strikes of both feet below which they strike together. In gait it is 0.5 (Perry & Burnfield
2010, Gait Analysis), and 0 in jumps with both feet; the limit leaves room for a limp of a third of a cycle."""
_TRAVEL = 0.5
"""Metres: least distance from which the direction of a walk is known."""
_HELD = 0.05
"""Seconds from the nearest known angle beyond which a point of a cycle is missing."""


@dataclass(frozen=True)
class Gait:
    """The cycles of some walks, and the angles over them.

    Attributes:
        cycles: a row per cycle: recording, side, cycle (from 1 in each recording and side), start and end, seconds;
            duration, seconds; stance, per cent of the cycle; stride, the distance of the pelvis, metres; speed, m/s;
            cadence, steps per minute.
        curves: a row per cycle, joint, angle and per cent: value, and error, its standard error, degrees; NaN where
            they are missing.
        notes: what a reader should know: kinds of angles, walks without a cycle, reasons to doubt the legs' joints.
        missing: for a side and a joint, the reason why no body has it so, and why it is missing.
    """

    cycles: pd.DataFrame
    curves: pd.DataFrame
    notes: tuple[str, ...]
    missing: Mapping[tuple[str, str], str] = field(default_factory=dict)

    def means(self) -> pd.DataFrame:
        """Average the curves over the cycles of all walks.

        Returns:
            A row per side, joint, angle and per cent: mean; sd over the cycles; cycles, their number; error, the root
            mean square standard error of the pose in one cycle; all but the number in degrees.
        """
        keys = ["side", "joint", "angle", "percent"]
        known = self.curves.dropna(subset="value").assign(square=lambda rows: rows["error"] ** 2)
        groups = known.groupby(keys, sort=False)
        table = groups["value"].agg(["mean", "std", "count"]).rename(columns={"std": "sd", "count": "cycles"})
        table["error"] = np.sqrt(groups["square"].mean())
        return table.reset_index()


def gait_of(motions: Sequence[ExportedMotion]) -> Gait:
    """Find the cycles of walks of one subject.

    Raises:
        RecordingError: if no walk has a cycle, or the marker set has no legs.
    """
    cycles, curves, notes, missing = [], [], [], {}
    for motion in motions:
        notes += [f"{motion.skeleton.name}: {found.text}" for found in motion.skeleton.barred]
        places = {place.joint.name: place.joint for place in motion.skeleton.calibration.joints}
        for key, name in _joints(motion).items():
            if reason := motion.skeleton.barred_at(places[name])[1]:
                missing[key] = reason
        if any(found.name == "up" for found in motion.skeleton.barred):
            continue
        rows = list(_cycles(motion))
        if not rows:
            notes.append(f"{motion.skeleton.name}: no whole cycle: two strikes of one heel are never seen in a row")
            continue
        cycles.append(pd.DataFrame([row for row, _ in rows]))
        curves += [table for _, table in rows]
    if not cycles:
        raise RecordingError("; ".join(notes))
    calibration = motions[0].skeleton.calibration
    clinical, legs_of = clinical_joints(calibration), set(_joints(motions[0]).values())
    others = sorted(legs_of - set(clinical) - {_joints(motions[0])[key] for key in missing})
    if others:
        words = "no anatomical axes: zero is where bones hang straight, and curves of two subjects do not compare"
        notes.append(f"{', '.join(others)}: {words}")
    doubted = [place for place in calibration.joints if place.joint.name in legs_of and not place.usable]
    notes += by_words((p.joint.name, "doubted: " * (p.status not in ANATOMICAL) + p.reason) for p in doubted)
    every = pd.concat(curves, ignore_index=True)
    known = every.groupby(["side", "joint", "angle"], sort=False)["value"].count()
    if lost := [" ".join(key) for key in known.index[known == 0].tolist() if key[:2] not in missing]:
        limit = f"the error is above {motions[0].largest_angle_error:g}° in every frame"
        notes.append(f"{', '.join(lost)}: missing: {limit}, or a segment is unknown")
    return Gait(pd.concat(cycles, ignore_index=True), every, tuple(notes), missing)


def _joints(motion: ExportedMotion) -> dict[tuple[str, str], str]:
    """Names of the joints of the legs, by side and joint; those that the marker set has."""
    calibration = motion.skeleton.calibration
    segments = legs(calibration.markerset)
    below = {place.joint.child: place.joint.name for place in calibration.joints}
    names = {(side, joint): segments.get(f"{side} {part}") for side in SIDES for joint, part in JOINTS.items()}
    return {key: below[name] for key, name in names.items() if name in below}


def _cycles(motion: ExportedMotion) -> Iterator[tuple[dict[str, object], pd.DataFrame]]:
    """Each cycle of a walk: its row of the table, and its curves."""
    skeleton, angles, joints = motion.skeleton, joint_angles(motion), _joints(motion)
    if not joints:
        raise RecordingError(f"{skeleton.name}: its marker set has no pelvis with both spines, or no leg on it")
    places, events = _pelvis(motion), gait_events(motion)
    if (phase := _opposite(events["left"][0], events["right"][0])) < _TOGETHER:
        words = f"feet strike together, {phase:.0%} of a cycle apart in the median: no walk, or labels or up are wrong"
        raise RecordingError(f"{skeleton.name}: {words}")
    for side in SIDES:
        strikes, offs = events[side]
        for count, (first, last) in enumerate(itertools.pairwise(strikes), start=1):
            duration, between = (last - first) / skeleton.rate, offs[(offs > first) & (offs < last)]
            if not (_FASTEST <= duration <= _SLOWEST and len(between) == 1):
                continue
            stride = float(np.linalg.norm((places[:, last] - places[:, first])[:2]))
            row: dict[str, object] = {"recording": skeleton.name, "side": side, "cycle": count}
            row |= {"start": first / skeleton.rate, "end": last / skeleton.rate, "duration": duration}
            row |= {"stance": 100.0 * (between[0] - first) / (last - first), "stride": stride}
            row |= {"speed": stride / duration, "cadence": 120.0 / duration}
            tables = [
                pd.DataFrame({"joint": joint, "angle": angle, "percent": PERCENT} | _curve(angles, name, first, last))
                for (own, joint), prefix in joints.items()
                for angle in ANGLES
                if own == side and (name := f"{prefix}_{angle}") in angles
            ]
            table = pd.concat(tables, ignore_index=True)
            yield row, table.assign(recording=skeleton.name, side=side, cycle=count)


def _opposite(left: Ints, right: Ints) -> float:
    """Median share of the left foot's cycles between a strike of the right one and the nearest of the left; or 0.5."""
    inside = right[(right > left[0]) & (right < left[-1])] if len(left) > 1 else right[:0]
    if not len(inside):
        return 0.5
    after = left.searchsorted(inside, side="right")
    share = (inside - left[after - 1]) / (left[after] - left[after - 1])
    return float(np.median(np.minimum(share, 1.0 - share)))


def _curve(angles: pd.DataFrame, name: str, first: int, last: int) -> dict[str, Floats]:
    """Value and error of an angle at 0 to 100 % of a cycle, degrees; NaN where it is missing."""
    time, wanted = angles["time"].to_numpy(), np.linspace(angles["time"][first], angles["time"][last], len(PERCENT))
    known = np.flatnonzero(~np.isnan(angles[name].to_numpy()))
    if not len(known):
        return dict.fromkeys(("value", "error"), np.full(len(PERCENT), np.nan))
    near = np.abs(time[known][:, None] - wanted).min(axis=0) <= _HELD
    both = {"value": angles[name].to_numpy(), "error": angles[f"{name}_error"].to_numpy()}
    return {key: np.where(near, np.interp(wanted, time[known], row[known]), np.nan) for key, row in both.items()}


def _pelvis(motion: ExportedMotion) -> Floats:
    """The pelvis' place (3, frames), metres, z up; interpolated where it is not seen."""
    segment = legs(motion.skeleton.calibration.markerset)["pelvis"]
    return _filled(motion.upright @ motion.skeleton.origins[motion.skeleton.segments.index(segment)])


def _filled(rows: Floats) -> Floats:
    """Rows (k, frames) with missing values interpolated in time; NaN if all are missing."""
    known = ~np.isnan(rows[0])
    frames = np.arange(rows.shape[1])
    return np.array([np.interp(frames, frames[known], row[known]) if known.any() else row for row in rows])


def gait_events(motion: ExportedMotion) -> dict[str, tuple[Ints, Ints]]:
    """Find the frames in which heels strike and toes leave the floor (Zeni et al. 2008).

    Returns:
        For each side the frames of the strikes and those of the toes; none for a side without a heel and a toe.

    Raises:
        RecordingError: if the walk has no direction.
    """
    skeleton, places = motion.skeleton, _pelvis(motion)
    forward, points = _forward(motion, places), landmarks(motion.recording.markers)
    segments, events = legs(skeleton.calibration.markerset), {}
    for side in SIDES:
        heel = points.get(f"{side} heel")
        toes = (points.get(f"{side} {name}") for name in ("fifth metatarsal", "first metatarsal", "toe"))
        toe = next((label for label in toes if label is not None), None)
        found: list[Ints] = []
        for label, sign in ((heel, 1.0), (toe, -1.0)):
            if label is None:
                break
            ahead = sign * ((_place(motion, segments.get(f"{side} foot"), label) - places) * forward).sum(axis=0)
            found.append(_peaks(ahead, skeleton.rate))
        none = np.zeros(0, dtype=np.int64)
        events[side] = (found[0], found[1]) if len(found) == 2 else (none, none)
    return events


def _place(motion: ExportedMotion, segment: str | None, label: str) -> Floats:
    """A marker of a foot in the world (3, frames), z up; by its segment's pose where that is known."""
    skeleton, x = motion.skeleton, motion.recording.of(label)
    if segment is not None and label in (shape := skeleton.calibration.shape(segment)).markers:
        number = skeleton.segments.index(segment)
        at = shape.places[shape.markers.index(label)]
        by_pose = to_world(skeleton.rotations[number], skeleton.origins[number], at)
        x = np.where(np.isnan(x), by_pose, x)
    return np.asarray(motion.upright @ x)


def _forward(motion: ExportedMotion, places: Floats) -> Floats:
    """Horizontal direction of the walk in each frame (3, frames): where the pelvis faces, or moves."""
    skeleton = motion.skeleton
    segment = legs(skeleton.calibration.markerset)["pelvis"]
    axes = skeleton.calibration.shape(segment).anatomy
    if np.isnan(axes).any():
        step = places[:, -1] - places[:, 0]
        step[2] = 0.0
        if not np.linalg.norm(step) > _TRAVEL:
            words = "its pelvis has no anatomical axes and moves less than 0.5 m, so that forward is not known"
            raise RecordingError(f"{skeleton.name}: {words}")
        return np.repeat((step / np.linalg.norm(step))[:, None], places.shape[1], axis=1)
    ahead = _filled(motion.upright @ np.einsum("ijt,j->it", skeleton.rotation(segment), axes[:, 0]))
    ahead[2] = 0.0
    return np.asarray(ahead / np.linalg.norm(ahead, axis=0))


def _peaks(ahead: Floats, rate: float) -> Ints:
    """Frames of the peaks of a foot's place along the walk (frames,), metres; where it is seen."""
    known = ~np.isnan(ahead)
    if known.sum() < rate * _FASTEST:
        return np.zeros(0, dtype=np.int64)
    filled = _filled(ahead[None])[0]
    if rate > 2.5 * _SMOOTH:
        filled = signal.sosfiltfilt(signal.butter(2, _SMOOTH, fs=rate, output="sos"), filled)
    low, high = np.quantile(filled, [0.05, 0.95])
    apart = max(int(_FASTEST * rate), 1)
    peaks, _ = signal.find_peaks(filled, distance=apart, prominence=_SWING * (high - low))
    near = [known[max(peak - round(_HELD * rate), 0) : peak + round(_HELD * rate) + 1].any() for peak in peaks]
    return np.asarray(peaks[np.array(near, dtype=bool)], dtype=np.int64)


def gait_lines(gait: Gait) -> Iterator[str]:
    """Lay out the cycles by side: means and standard deviations, then the ranges of the mean curves, and the notes."""
    yield from (f"{side} {joint}: {reason}" for (side, joint), reason in gait.missing.items())
    yield from columns(list(parameter_rows(gait)), ["", "left", "right"], "<>>")
    means, rows = gait.means(), []
    for (joint, angle), part in means.groupby(["joint", "angle"], sort=False):
        texts = []
        for side in SIDES:
            own = part[part["side"] == side]
            low, high = (own["mean"].min(), own["mean"].max()) if len(own) else (np.nan, np.nan)
            texts.append("-" if np.isnan(low) else f"{low:.0f}° to {high:.0f}°, ± {own['error'].median():.1f}°")
        rows.append([f"{joint} {angle}", *texts])
    yield from columns(rows, ["mean over the cycles", "left", "right"], "<>>")
    yield "±: median standard error in a frame, from the poses and from the anatomical axes"
    yield from (f"note: {note}" for note in gait.notes)


_PARAMETERS = {
    "duration": ("duration of a cycle / s", ".2f"),
    "stance": ("stance / %", ".1f"),
    "stride": ("stride / m", ".2f"),
    "speed": ("speed / (m/s)", ".2f"),
    "cadence": ("cadence / (steps/min)", ".0f"),
}


def parameter_rows(gait: Gait) -> Iterator[list[str]]:
    """Rows of the table of cycles: what, and for the left and the right side mean ± standard deviation."""
    sides = [gait.cycles[gait.cycles["side"] == side] for side in SIDES]
    yield ["cycles", *(str(len(rows)) for rows in sides)]
    for key, (words, form) in _PARAMETERS.items():
        texts = []
        for rows in sides:
            mean, sd = rows[key].mean(), rows[key].std()
            spread = "" if np.isnan(sd) else f" ± {number(float(sd), form)}"
            texts.append("-" if np.isnan(mean) else f"{number(float(mean), form)}{spread}")
        yield [words, *texts]
