"""A session: the trials of one subject with the markers on, calibrated one by one and merged if they fit each other."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from study.mocap.io.recording import Recording, RecordingError
from study.mocap.joints.fit_joints import find_joints
from study.mocap.joints.found_joints import FoundJoints
from study.mocap.markersets.marker_set import MarkerSet
from study.mocap.session.hinge_places import hinges_placed
from study.mocap.session.merge_calibrations import Merged, merge_calibrations
from study.mocap.skeleton.calibrate import calibration_from
from study.mocap.skeleton.calibration import Calibration
from study.mocap.skeleton.draw_skeleton import draw_skeleton
from study.mocap.skeleton.subject_check import overruled, require_same_subject
from study.sphere.types import Floats


@dataclass(frozen=True, eq=False)
class Session:
    """The calibration of one subject from several trials.

    Attributes:
        found: joints of each trial, found in it alone.
        merged: the calibration from all of them.
        overruled: misfits between trials that were accepted by force, a line each.
    """

    found: tuple[FoundJoints, ...]
    merged: Merged
    overruled: tuple[str, ...]


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
    found = tuple(find_joints(markerset, trial) for trial in every)
    calibrations = [calibration_from(joints, trial) for joints, trial in zip(found, every, strict=True)]
    forced: list[str] = []
    for number in range(1, len(every)):
        before = _with_misfits(merge_calibrations(markerset, calibrations[:number]), every[:number])
        if not any(shape.has_own_pose for shape in before.calibration.shapes):
            continue
        drawn = draw_skeleton(before.calibration, every[number])
        if force:
            forced += overruled(drawn)
        else:
            require_same_subject(drawn)
    fixed = None if static is None else len(trials)
    merged = merge_calibrations(markerset, calibrations, fixed)
    if fixed is not None:
        merged = hinges_placed(merged, calibrations[fixed], found[fixed], every[fixed])
    merged = _with_misfits(merged, every)
    return Session(found, merged, tuple(forced))


def _with_misfits(merged: Merged, trials: Sequence[Recording]) -> Merged:
    """Add the misfits of the shapes, root mean square over the trials."""
    calibration = merged.calibration
    if not any(shape.has_own_pose for shape in calibration.shapes):
        return merged
    misfits = np.array([draw_skeleton(calibration, trial).misfits for trial in trials])
    total = _mean_square(misfits, np.array([trial.frames for trial in trials], dtype=np.float64))
    shapes = (replace(shape, misfit=float(m)) for shape, m in zip(calibration.shapes, total, strict=True))
    return replace(merged, calibration=replace(calibration, shapes=tuple(shapes)))


def _mean_square(misfits: Floats, frames: Floats) -> Floats:
    """Root mean square of misfits (trials, segments) over trials with weights (trials,); NaN where all are NaN."""
    weights = np.where(np.isnan(misfits), 0.0, frames[:, None])
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt((weights * np.nan_to_num(misfits) ** 2).sum(axis=0) / weights.sum(axis=0)))


def refit_shapes(calibration: Calibration, recording: Recording) -> Calibration:
    """Fit the shapes of a calibration's segments to another recording of the session; its joints stay in their axes.

    Skin carries the markers a little elsewhere in another posture, and a recording may have markers that the
    calibration lacks. Segments whose markers alone do not fix a pose keep their shapes.

    Args:
        calibration: of the same subject with the same markers (see `subject_check`).
        recording: markers under the calibration's names.
    """
    here = calibration_from(find_joints(calibration.markerset, recording), recording)
    merged = merge_calibrations(calibration.markerset, [calibration, here], static=1).calibration
    shapes = (
        new if old.has_own_pose and here.shape(old.segment).has_own_pose else old
        for old, new in zip(calibration.shapes, merged.shapes, strict=True)
    )
    return replace(calibration, shapes=tuple(replace(s, misfit=calibration.shape(s.segment).misfit) for s in shapes))
