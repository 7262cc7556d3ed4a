"""Gait: the angles of pelvis and legs over the gait cycle.

A cycle goes from one strike of a foot to the next of the same foot (see `study.recordings.events`). An angle of a cycle
is interpolated to 101 points, 0 to 100 %. Points more than 0.05 s from a known angle are missing. The pelvis' angles
are those to the way of the walk, in the order tilt, obliquity, rotation, as Plug-in Gait has them.

Source: Wu et al. 2002 for the angles.
"""

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from study.arrays import Bools, Floats
from study.recordings.events import (
    FASTEST,
    HELD,
    SIDES,
    SLOWEST,
    Course,
    assert_alternating,
    event_notes,
    gait_events,
    walk_course,
)
from study.recordings.export.tree import (
    ExportedMotion,
    angles_errors,
    clinical_joints,
    flagged,
    joint_angles,
    known_angles,
    zxy_errors,
)
from study.recordings.joints.estimate import ANATOMICAL
from study.recordings.joints.find import by_words
from study.recordings.markersets import landmarks
from study.recordings.recording import GaitEvent, RecordingError
from study.recordings.skeleton.anatomy import legs
from study.recordings.skeleton.draw import Flag
from study.recordings.skeleton.scene import up_of
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
PERCENT = np.arange(101)
"""Points of a cycle, per cent."""
FEW = 3
"""Cycles below which a standard deviation says nothing."""
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
        gone = {found.name for found in skeleton.barred if found.frames.all()}
        if gone & {"up", legs(skeleton.calibration.markerset)["pelvis"]}:
            continue
        course = walk_course(motion)
        events.append(gait_events(motion, course))
        assert_alternating(name, events[-1])
        angles = _angles(motion, course, joints)
        rows = list(_cycles(motion, course, events[-1], angles))
        notes += event_notes(name, events[-1], course)
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
    notes += by_words((motion.skeleton.name, up_of(motion.recording)[1]) for motion in motions)
    others = sorted(legs_of - set(clinical))
    if others:
        named = {p for m in motions for p in landmarks(m.recording.markers, calibration.markerset.landmarks)}
        lacking = " or a ".join(p for p in ("medial epicondyle", "medial malleolus") if f"left {p}" not in named)
        words = f"no anatomical axes{f' (no label is that of a {lacking})' * bool(lacking)}: zero is where bones hang"
        words += " straight, and curves of two subjects do not compare"
        notes.append(f"{', '.join(others)}: {words}")
    doubted = [place for place in calibration.joints if place.joint.name in legs_of and not place.usable]
    notes += by_words((p.joint.name, "doubted: " * (p.status not in ANATOMICAL) + p.reason) for p in doubted)
    every = pd.concat(curves, ignore_index=True)
    counts = every.groupby(["side", "joint", "angle"], sort=False)["value"].count()
    limit = f"the error is above {motions[0].largest_angle_error:g}° in every frame, or a segment is unknown"
    reasons = {key: told.get(joints.get(key[:2], ""), limit) for key in counts.index[counts == 0].tolist()}
    return Gait(
        pd.concat(cycles, ignore_index=True), every, tuple(notes), tuple(events), tuple(motions), reasons, sticks[0]
    )


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


def _angles(motion: ExportedMotion, course: Course, joints: Mapping[tuple[str, str], str]) -> dict[str, Any]:
    """The angles of a report over time (frames,), degrees, by side, joint and angle, as "left hip_flexion".

    Each has its error in ``<angle>_error``, and each joint its flag in ``<side> <joint>_flag``.
    """
    table, skeleton = joint_angles(motion), motion.skeleton
    result: dict[str, Any] = {"time": table["time"].to_numpy()}
    for (side, joint), name in joints.items():
        own = [column for column in map(str, table) if column.startswith(f"{name}_")]
        result |= {f"{side} {joint}{column.removeprefix(name)}": table[column].to_numpy() for column in own}
    up = np.broadcast_to([[0.0], [0.0], [1.0]], course.way.shape)
    ahead = np.stack([course.way, up, np.cross(course.way, up, axis=0)])  # rows: ahead, up, to the right
    world = np.einsum("ijt,jk->ikt", ahead, motion.upright)
    for name, segment in legs(skeleton.calibration.markerset).items():
        anatomy = skeleton.calibration.shape(segment).anatomy
        if not name.endswith(("pelvis", "foot")) or np.isnan(anatomy).any():
            continue
        number = skeleton.segments.index(segment)
        turn = np.einsum("ijt,jkt,kl->ilt", world, skeleton.rotations[number], anatomy)
        covariance = np.einsum("ijt,tjk,lkt->til", world, skeleton.turning[number], world)
        of_axes, flags = angles_errors(skeleton.calibration, turn, None, segment), skeleton.segment_flags[number]
        if name == "pelvis":
            errors = zxy_errors(turn, covariance)
            about_z, about_x, about_y = known_angles(turn)
            for side, sign in zip(SIDES, (1.0, -1.0), strict=True):  # up, and to the front, on this side
                values = -about_z, sign * about_x, -sign * about_y
                names = (f"{side} pelvis_{angle}" for angle in ("tilt", "obliquity", "rotation"))
                angles = dict(zip(names, values, strict=True))
                result |= flagged(motion, f"{side} pelvis", angles, errors, flags, of_axes)
            continue
        inwards = np.degrees(np.arctan2(turn[2, 0], turn[0, 0])) * (1.0 if name == "left foot" else -1.0)
        above = next(p.joint for p in skeleton.calibration.joints if p.joint.child == segment)
        error = np.where(skeleton.barred_at(above)[0], np.nan, np.degrees(np.sqrt(covariance[:, 1, 1])))
        result |= flagged(motion, name, {f"{name}_progression": inwards}, error[None], flags, of_axes[2:])
    return result


def _cycles(
    motion: ExportedMotion, course: Course, events: Sequence[GaitEvent], angles: Mapping[str, Floats]
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
            if not (FASTEST <= duration <= SLOWEST and inside and (len(offs) == 1 or told)):
                continue
            count += 1
            row: dict[str, object] = {"recording": skeleton.name, "side": side, "cycle": count}
            row |= {"start": one.time, "end": other.time, "duration": duration}
            row |= _parameters(course, skeleton.rate, (one, other), offs[0] if offs else np.nan, events)
            row |= {"events": " and ".join(dict.fromkeys((one.source, other.source)))}
            tables = [
                pd.DataFrame({"joint": j, "angle": a, "percent": PERCENT} | _curve(angles, (side, j, a), (one, other)))
                for j, a in PANELS
                if f"{side} {j}_{a}" in angles
            ]
            table = pd.concat(tables, ignore_index=True)
            yield row, table.assign(recording=skeleton.name, side=side, cycle=count)


def _at(rows: Floats, rate: float, time: float) -> Floats:
    """Rows (k, frames) at a time, seconds, interpolated (k,)."""
    return np.array([np.interp(time * rate, np.arange(rows.shape[1]), row) for row in rows])


def _parameters(
    course: Course, rate: float, strikes: tuple[GaitEvent, GaitEvent], off: float, events: Sequence[GaitEvent]
) -> dict[str, float]:
    """Stance, stride, speed, cadence, step, width and double support of a cycle; NaN where the events do not show them.

    Args:
        course: of the walk.
        rate: frames per second.
        strikes: the first and the last.
        off: the time of the off between; NaN if it is not known.
        events: of the walk.
    """
    side, start, end = strikes[0].side, strikes[0].time, strikes[1].time
    opposite, duration = "right" if side == "left" else "left", end - start
    stride = float(np.linalg.norm((_at(course.pelvis, rate, end) - _at(course.pelvis, rate, start))[:2]))
    others = [e for e in events if e.side == opposite and start < e.time < end]
    struck, gone = (next((e.time for e in others if e.kind == kind), np.nan) for kind in ("strike", "off"))
    double = (gone - start) + (off - struck) if gone < struck < off else np.nan
    step = width = np.nan
    if not np.isnan(struck) and {f"{side} heel", f"{opposite} heel"} <= course.feet.keys():
        way = _at(course.way, rate, end)[:2]
        apart = _at(course.feet[f"{side} heel"], rate, end) - _at(course.feet[f"{opposite} heel"], rate, struck)
        step, width = float(apart[:2] @ way), float(abs(apart[0] * way[1] - apart[1] * way[0]))
    row = {"stance": 100.0 * (off - start) / duration, "stride": stride, "speed": stride / duration}
    row |= {"cadence": 120.0 / duration, "step": step, "width": width}
    return row | {"double_support": 100.0 * double / duration}


def _curve(
    angles: Mapping[str, Floats], key: tuple[str, str, str], ends: tuple[GaitEvent, GaitEvent]
) -> dict[str, object]:
    """Value and error of an angle at 0 to 100 % of a cycle, degrees, NaN where it is missing, and suspect points."""
    name, time = "{} {}_{}".format(*key), angles["time"]
    wanted, known = np.linspace(ends[0].time, ends[1].time, len(PERCENT)), ~np.isnan(angles[name])
    if not known.any():
        missing = np.full(len(PERCENT), np.nan)
        return {"value": missing, "error": missing, "suspect": np.zeros(len(PERCENT), dtype=bool)}
    near = np.abs(time[known][:, None] - wanted).min(axis=0) <= HELD
    value, error = (
        np.where(near, np.interp(wanted, time[known], row[known]), np.nan)
        for row in (angles[name], angles[f"{name}_error"])
    )
    bridged = angles[f"{key[0]} {key[1]}_flag"][np.abs(time[:, None] - wanted).argmin(axis=0)] == Flag.BRIDGED
    return {"value": value, "error": error, "suspect": near & (bridged | _spikes(value))}


def _spikes(values: Floats) -> Bools:
    """True where a curve (101,) is far from the median around it."""
    middle = pd.Series(values).rolling(_AROUND, center=True, min_periods=_AROUND // 2 + 1).median().to_numpy()
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values - middle) > _SPIKE)


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
