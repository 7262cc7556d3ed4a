"""A session: the trials of one subject with the markers on, calibrated one by one and merged if they fit each other.

Each trial has its own axes for a segment. Kabsch's fit of the markers that two trials share moves one trial's axes onto
the other's; a segment with fewer than three markers takes the joint above it as one more point.

A joint has one place from all trials. The trials whose estimate is reliable are weighted by the inverse of their
covariances. A hinge counts across its axis only. Trials that contradict each other are named as segments that do are
(`check_against_sides`): the best one's place stays, and its covariance covers the other.

A trial that does not move a joint has no vote on it. Skin that slides by s over a joint that turns by θ looks like a
centre that is s/θ elsewhere, and on a leg that stands the stated error does not cover that. So each trial's covariance
has an allowance for s = 1 mm; where that exceeds a centimetre, as for 6° root mean square, the trial does not count. A
joint that no trial moved is unsure by the allowance, too, and beyond 5 cm it has no place.

A functional calibration moves one joint after the other, each in a trial of its own. The merged calibration has all of
them. A static trial may give the shapes of the segments, and with medial markers, which are off during motion, the
places of hinges along their axes.

Source: the weighted mean of independent estimates (Gauss-Markov).
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from study.arrays import Floats
from study.recordings.joints.estimate import SHORT_TEXTS, USABLE, JointStatus, PlaceDifference, largest_error
from study.recordings.joints.find import (
    SLIDES,
    Calibration,
    JointPlace,
    SegmentShape,
    allowance,
    find_joints,
    moved_along_axis,
)
from study.recordings.joints.report import joint_table, millimetres
from study.recordings.markersets import MarkerSet, Match, match, place_markerset
from study.recordings.recording import Recording, RecordingError, one_after_another
from study.recordings.rigid import across, fit_rigid_motion
from study.recordings.skeleton.anatomy import DrawnTrial, Hips, part_of, points_of_the_body, with_anatomy
from study.recordings.skeleton.calibrate import hull_distances, require_same_subject, with_checks, with_doubts
from study.recordings.skeleton.draw import draw_skeleton
from study.text import columns


class AxesChange(NamedTuple):
    """A change of axes, x ↦ R x + t, with R (3, 3) and t (3,), metres."""

    rotation: Floats
    shift: Floats

    def place(self, points: Floats) -> Floats:
        """Points (…, 3) in the new axes."""
        return points @ self.rotation.T + self.shift

    def covariance(self, matrix: Floats) -> Floats:
        """A covariance (3, 3) in the new axes."""
        return self.rotation @ matrix @ self.rotation.T


UNKNOWN = AxesChange(np.full((3, 3), np.nan), np.full(3, np.nan))
"""Change of axes where a trial and the reference share too little: places become NaN."""
SAME = AxesChange(np.eye(3), np.zeros(3))
Trial = tuple[Calibration, Mapping[str, AxesChange]]
"""The calibration of a trial, and the changes of its segments' axes to those that all trials have in common."""
_NOWHERE = 0.05
"""Metres: error from which a joint that no trial moved has no place."""


def shape_points(calibration: Calibration, shape: SegmentShape) -> dict[str, Floats]:
    """The points that fix a segment's pose (3,) by name: its markers and, if these are too few, the joint above it."""
    points = dict(zip(shape.markers, shape.places, strict=True))
    if not shape.has_own_pose:
        for joint in calibration.joints:
            if joint.joint.child == shape.segment and not np.isnan(joint.in_child).any():
                points[joint.joint.name] = joint.in_child
    return points


def change_between(points: Mapping[str, Floats], onto: Mapping[str, Floats]) -> AxesChange:
    """The change of axes that moves points nearest to those of the same names; `UNKNOWN` for fewer than three."""
    common = [name for name in points if name in onto]
    if len(common) < 3:
        return UNKNOWN
    template, x = (np.stack([named[name] for name in common]) for named in (points, onto))
    rotation, origin, known = fit_rigid_motion(template, np.ascontiguousarray(x[:, :, None]))
    return AxesChange(rotation[:, :, 0], origin[:, 0]) if known[0] else UNKNOWN


def axes_changes(trials: Sequence[Calibration], index: int, references: Mapping[str, int]) -> dict[str, AxesChange]:
    """The change of axes of each segment of a trial, by its number, to those of the segment's reference trial.

    A segment without a pose in either has its parent's axes.
    """
    calibration, changes = trials[index], dict[str, AxesChange]()
    for segment, shape in zip(calibration.markerset.segments, calibration.shapes, strict=True):
        other = trials[references[segment.name]]
        onto = other.shape(segment.name)
        change = UNKNOWN
        if other is calibration:
            change = SAME
        elif shape.has_pose and onto.has_pose:
            change = change_between(shape_points(calibration, shape), shape_points(other, onto))
        elif not (shape.has_pose or onto.has_pose or segment.parent is None):
            change = changes[segment.parent]
        changes[segment.name] = change
    return changes


def moved(place: JointPlace, changes: Mapping[str, AxesChange]) -> JointPlace:
    """A joint in the new axes of its two segments."""
    parent, child = changes[place.joint.parent], changes[place.joint.child]
    owner = child if np.isnan(place.in_parent).any() else parent  # whose axes the covariance is in
    return replace(
        place,
        in_parent=parent.place(place.in_parent),
        in_child=child.place(place.in_child),
        covariance=owner.covariance(place.covariance),
        allowance=owner.covariance(allowance(place)),
        axis_in_parent=parent.rotation @ place.axis_in_parent,
        axis_in_child=child.rotation @ place.axis_in_child,
        mean_rotation=parent.rotation @ place.mean_rotation @ child.rotation.T,
    )


def pool_places(parts: Sequence[JointPlace]) -> JointPlace:
    """Pool the places of one joint from several trials.

    Args:
        parts: one for each trial, at least one, with its name, in axes that all trials have in common.

    Returns:
        The weighted mean of the reliable ones that moved the joint; the best one if none did. It has the names of their
        trials.
    """
    ranked = sorted(parts, key=lambda part: part.rank)
    used = [part for part in ranked if part.usable and part.has_vote]
    if not used:
        return _unmoved(ranked[0])
    best = used[0]
    apart = [(off.distance, part, off) for part in used[1:] if (off := difference(best, part)).contradicts]
    if apart:
        distance, part, worst = max(apart, key=lambda three: three[0])
        turn = f", its axis turned by {np.degrees(worst.angle):.0f}°" if worst.angle > 0.0 else ""
        words = f"{part.trials[0]} puts it {1000 * distance:.0f} mm from where {best.trials[0]} does{turn}"
        covariance = best.covariance + np.outer(worst.vector, worst.vector)
        reason = f"{words}: beyond what the errors explain"
        return replace(best, status=JointStatus.DISAGREE, reason=reason, covariance=covariance)
    if len(used) == 1:
        return best
    information = []
    for part in used:  # across the best trial's axis or, if that has none, across the part's own
        basis = across(part.axis if best.axis is None else best.axis)
        within = basis.T @ (part.covariance + part.allowance) @ basis
        information.append(basis @ np.linalg.pinv(within, hermitian=True) @ basis.T)
    rotation, total = best.mean_rotation, np.linalg.pinv(np.sum(information, axis=0), hermitian=True)
    shares = [total @ weight for weight in information]
    return replace(
        best,
        in_parent=_mean([part.in_parent for part in used], information),
        in_child=_mean([part.in_child for part in used], [rotation.T @ weight @ rotation for weight in information]),
        covariance=np.sum([w @ part.covariance @ w.T for w, part in zip(shares, used, strict=True)], axis=0),
        trials=tuple(name for part in used for name in part.trials),
    )


def _unmoved(best: JointPlace) -> JointPlace:
    """The joint that no trial moved, by the best of them: unsure, or without a place."""
    total = best.covariance + best.allowance
    error = largest_error(total, best.axis)
    if error > _NOWHERE and not best.has_vote:
        without = JointPlace(best.joint, JointStatus.STILL, "no trial moved it")  # neither place nor covariance
        kept = {name: getattr(best, name) for name in ("axis_in_parent", "axis_in_child", "mean_rotation")}
        return replace(without, trials=best.trials, allowance=best.allowance, estimates=best.estimates, **kept)
    if not best.usable:
        return best
    reason = f"no trial moved it enough to show it: ± {1000 * error:.0f} mm, if skin slides by {1000 * SLIDES:.0f} mm"
    return replace(best, status=JointStatus.UNSURE, reason=reason, covariance=total)


def difference(one: JointPlace, other: JointPlace) -> PlaceDifference:
    """Difference of another trial's place from a joint's, across the axis of either, in the parent's axes."""
    axes = [place.axis for place in (one, other) if place.axis is not None]
    errors = one.covariance + one.allowance + other.covariance + other.allowance
    angle = float(np.arccos(np.minimum(np.abs(axes[0] @ axes[1]), 1.0))) if len(axes) == 2 else 0.0
    return PlaceDifference.of(other.in_parent - one.in_parent, errors, axes[0] if axes else None, "parent", angle)


def _mean(points: Sequence[Floats], information: Sequence[Floats]) -> Floats:
    """Mean of points (3,) weighted by information; in directions without any it is the first point that is known."""
    known = [(point, weight) for point, weight in zip(points, information, strict=True) if not np.isnan(point).any()]
    if not known:
        return np.full(3, np.nan)
    first = known[0][0]
    total = np.sum([weight for _, weight in known], axis=0)
    moment = np.sum([weight @ (point - first) for point, weight in known], axis=0)
    return np.asarray(first + np.linalg.pinv(total, hermitian=True) @ moment)


@dataclass(frozen=True, eq=False)
class Session:
    """The calibration of one subject from several trials.

    Attributes:
        calibration: merged from all trials; the misfits of its shapes are those of the trials.
        parts: each joint's places in the trials, in the axes that these have in common.
        trials: the calibration of each trial alone.
        overruled: misfits between trials that were accepted by force, a line each.
    """

    calibration: Calibration
    parts: Mapping[str, Sequence[JointPlace]]
    trials: tuple[Calibration, ...]
    overruled: tuple[str, ...] = ()


def merge_calibrations(markerset: MarkerSet, calibrations: Sequence[Calibration], static: int | None = None) -> Session:
    """Merge calibrations of one subject in one session.

    Args:
        markerset: of all of them; a trial need not show all of its markers.
        calibrations: one for each trial, in the same marker set.
        static: number of the trial whose shapes are taken, where it has them; the mean of all trials' if None.
    """
    numbers, segments = range(len(calibrations)), [segment.name for segment in markerset.segments]
    # the first trial in which a segment has a pose, if there is one
    references = {s: min(numbers, key=lambda k: not calibrations[k].shape(s).has_pose) for s in segments}
    changes = [axes_changes(calibrations, index, references) for index in numbers]
    trials = list(zip(calibrations, changes, strict=True))
    shapes = tuple(_merged_shape(name, references[name], trials, static) for name in segments)
    names = [joint.name for joint in markerset.joints]
    parts = {name: [replace(moved(c[name], change), trials=(c.source,)) for c, change in trials] for name in names}
    source, frames = ", ".join(one.source for one in calibrations), sum(one.frames for one in calibrations)
    merged = Calibration(source, frames, markerset, shapes, tuple(map(pool_places, parts.values())))
    return Session(merged, parts, tuple(calibrations))


def _merged_shape(name: str, reference: int, trials: Sequence[Trial], static: int | None) -> SegmentShape:
    """Mean shape of a segment over the trials, weighted by their frames; a static trial's for the markers it has."""
    first, own = trials[reference][0].shape(name), False
    # place, scatter and frames of each marker in each trial that shows it, and if that is the static one
    seen: dict[str, list[tuple[Floats, float, int, bool]]] = defaultdict(list)
    for index, (calibration, change) in enumerate(trials):
        shape = calibration.shape(name)
        if shape.has_pose == first.has_pose and not np.isnan(change[name].shift).any():
            own |= shape.has_own_pose
            places = change[name].place(shape.places)
            for marker, place, scatter in zip(shape.markers, places, shape.scatter, strict=True):
                seen[marker].append((place, scatter, calibration.frames, index == static))
    markers = tuple(m for m in trials[reference][0].markerset.segment(name).markers if m in seen)
    merged, scatters = np.zeros((len(markers), 3)), np.zeros(len(markers))
    for k, marker in enumerate(markers):
        places, own_scatters, frames, fixed = map(np.array, zip(*seen[marker], strict=True))
        merged[k] = places[fixed][0] if fixed.any() else np.average(places, axis=0, weights=frames)
        square = np.nan_to_num(own_scatters) ** 2 + ((places - merged[k]) ** 2).sum(axis=1)
        scatters[k] = np.sqrt(np.average(square, weights=frames))
    return SegmentShape(name, markers, merged, scatters, own or first.has_own_pose, first.reason)


def hinges_placed(merged: Calibration, static: Calibration, recording: Recording) -> Calibration:
    """Move hinges along their axes to the middle of the two points across them, as far as a static trial shows these.

    Args:
        merged: calibration of all trials.
        static: calibration of the static trial alone, with the poses of its segments.
        recording: the static trial.
    """
    places = list(merged.joints)
    for k, place in enumerate(places):
        parent, ends, axis = place.joint.parent, place.joint.across, place.axis
        poses = static.poses.get(parent)
        if poses is None or axis is None or len(ends) != 2 or not set(ends) <= set(recording.markers):
            continue
        middle = poses.mean_place(0.5 * (recording.of(ends[0]) + recording.of(ends[1])))
        onto = shape_points(merged, merged.shape(parent))
        middle = change_between(shape_points(static, static.shape(parent)), onto).place(middle)
        if np.isnan(middle).any() or np.isnan(place.in_parent).any():
            continue
        places[k] = moved_along_axis(place, middle)
    return replace(merged, joints=tuple(places))


def calibrate_session(
    markerset: MarkerSet, trials: Sequence[Recording], static: Recording | None = None, force: bool = False
) -> Session:
    """Calibrate each trial and merge them.

    Each trial must fit the calibration merged from those before it.

    Args:
        markerset: of all trials; each may lack markers.
        trials: recordings, each with a name of its own.
        static: one more trial, whose shapes of segments are taken.
        force: merge trials that seem to show different subjects.

    Raises:
        RecordingError: if a trial shows another subject, and ``force`` is not given; if two have one name.
    """
    every = [*trials, *([] if static is None else [static])]
    names = [trial.name for trial in every]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise RecordingError(f"{', '.join(twice)}: given twice; name each trial once, and give each a name of its own")
    calibrations = [find_joints(markerset, trial) for trial in every]
    forced: list[str] = []
    for index in range(1, len(every)):
        before = merge_calibrations(markerset, calibrations[:index]).calibration
        forced += require_same_subject(before, every[index], force=force) if before.has_poses else []
    session = merge_calibrations(markerset, calibrations, None if static is None else len(trials))
    merged = session.calibration if static is None else hinges_placed(session.calibration, calibrations[-1], static)
    checked = (with_checks(one, trial) for one, trial in zip(calibrations, every, strict=True))
    return replace(session, calibration=_checked(merged, every), trials=tuple(checked), overruled=tuple(forced))


def fit_session(
    trials: Sequence[Recording],
    static: bool,
    markerset: str | None,
    hips: Hips = "motion",
    segments: str = "",
    force: bool = False,
) -> tuple[Match, Session]:
    """Find the joints of several trials of one session.

    Args:
        trials: of the same subject with the same markers.
        static: True if the last of them gives the shapes of the segments.
        markerset: as in `place_markerset`, for all trials together.
        hips: as in `find_joints`. Points of the body come from the last trial that shows the pelvis' spines.
        segments: those to use, as in `part_of`; all if "".
        force: True to merge trials that seem to show different subjects.
    """
    together = place_markerset(one_after_another(trials, ", ".join(trial.name for trial in trials)), markerset)
    together = match(part_of(together.whole, segments), together.source) if segments else together
    named = [match(together.whole, trial).recording for trial in trials]
    still = named[-1] if static else None
    merged = calibrate_session(together.markerset, named[: len(named) - static], still, force=force)
    if merged.calibration.has_poses:
        for trial, own in reversed(list(zip(named, trials, strict=True))):
            source = replace(own, widths=together.source.widths)  # any trial may have them
            drawn = draw_skeleton(merged.calibration, trial)
            if {"left asis", "right asis"} <= points_of_the_body(drawn, source).keys():
                anatomy = with_anatomy(merged.calibration, DrawnTrial(drawn, trial), source, hips)
                return together, replace(merged, calibration=anatomy)
    return together, merged


def _checked(calibration: Calibration, trials: Sequence[Recording]) -> Calibration:
    """Add the misfits of the shapes, root mean square over the trials, and doubts and warnings of the joints.

    A joint is as far outside the markers' hull, and its segments put it as far apart, as in the trial in which it is
    least.
    """
    if not calibration.has_poses:
        return calibration
    drawn = [draw_skeleton(calibration, trial) for trial in trials]
    misfits = np.array([one.misfits for one in drawn])
    weights = np.where(np.isnan(misfits), 0.0, np.array([[trial.frames] for trial in trials], dtype=np.float64))
    with np.errstate(invalid="ignore"):
        total = np.sqrt((weights * np.nan_to_num(misfits) ** 2).sum(axis=0) / weights.sum(axis=0))
    shapes = tuple(replace(shape, misfit=float(m)) for shape, m in zip(calibration.shapes, total, strict=True))
    outside = [hull_distances(trial.positions, one.centers)[0] for one, trial in zip(drawn, trials, strict=True)]
    gaps = np.fmin.reduce([one.gaps for one in drawn])
    return with_doubts(replace(calibration, shapes=shapes), np.fmin.reduce(outside), gaps)


def refit_shapes(calibration: Calibration, recording: Recording) -> Calibration:
    """Fit the shapes of a calibration's segments to another recording of the session; its joints stay in their axes.

    Skin carries the markers a little elsewhere in another posture, and a recording may have markers that the
    calibration lacks. Segments whose markers alone do not fix a pose keep their shapes.

    Args:
        calibration: of the same subject with the same markers (see `other_subject`).
        recording: markers under the calibration's names.
    """
    here = find_joints(calibration.markerset, recording)
    merged = merge_calibrations(calibration.markerset, [calibration, here], static=1).calibration
    fitted = zip(calibration.shapes, here.shapes, merged.shapes, strict=True)
    shapes = (new if old.has_own_pose and own.has_own_pose else old for old, own, new in fitted)
    return replace(calibration, shapes=tuple(replace(s, misfit=calibration.shape(s.segment).misfit) for s in shapes))


def session_lines(session: Session) -> Iterator[str]:
    """Lay out the merged joints, a line each in millimetres, with the trials that each comes from."""
    yield from session.overruled
    rows, left_out = [], defaultdict(list)
    for place in session.calibration.joints:
        parts = sorted(session.parts[place.joint.name], key=lambda part: part.rank)
        known = not np.isnan(place.in_parent).any()
        apart = [difference(place, part).distance for part in parts if known and part.usable]
        rows.append([place.joint.name, SHORT_TEXTS[place.status], *(millimetres(float(x)) for x in place.in_parent)])
        rows[-1] += [millimetres(place.standard_error), millimetres(max(apart)) if len(apart) > 1 else "-"]
        rows[-1] += [", ".join(place.trials) if known else "-"]
        left = ", ".join(_left_out(part) for part in parts if not set(part.trials) <= set(place.trials))
        if left and place.status in USABLE:
            left_out[left].append(place.joint.name)
    titles = ["joint", "status", *(f"{axis} / mm" for axis in "xyz"), "error", "apart", "from"]
    yield from columns(rows, titles, "<<>>>>><")
    yield "x, y, z: centre in its parent; error: largest standard error; apart: farthest reliable trial; all in mm"
    yield from session.calibration.reasons()
    yield from session.calibration.warnings()
    yield from (f"{', '.join(names)}: not from {left}" for left, names in left_out.items())


def session_table(session: Session) -> pd.DataFrame:
    """Tabulate joints, a row for each trial and joint.

    Returns:
        The columns of `joint_table`, in the axes of each trial; ``recording``, its name; ``merged``, True if the merged
        place rests on this row.
    """
    tables = []
    for trial in session.trials:
        table = joint_table(trial)
        table.insert(0, "recording", trial.source)
        tables.append(table.assign(merged=[trial.source in place.trials for place in session.calibration.joints]))
    return pd.concat(tables, ignore_index=True)


def _left_out(part: JointPlace) -> str:
    size = "" if np.isnan(part.standard_error) else f", ± {1000 * part.standard_error:.1f} mm"
    words = f"{SHORT_TEXTS[part.status]}{size}" if part.has_vote else "hardly moved it"
    return f"{', '.join(part.trials)} ({words})"
