"""Merge the calibrations of several trials of one session: shapes averaged, joints from the trials that moved them.

A functional calibration moves one joint after the other, each in a trial of its own. The merged calibration has all of
them, and a static trial may give the shapes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from study.mocap.markersets.marker_set import MarkerSet
from study.mocap.session.common_axes import AxesChange, SharedAxes, axes_changes, moved, shared_axes
from study.mocap.session.pool_places import PooledPlace, TrialPlace, pool_places
from study.mocap.skeleton.calibration import Calibration, SegmentShape
from study.sphere.types import Floats


@dataclass(frozen=True, eq=False)
class Merged:
    """The calibration of a session.

    Attributes:
        calibration: merged from all trials; the misfits of its shapes are those of the trials.
        joints: of the marker set, each with its places in the trials.
    """

    calibration: Calibration
    joints: tuple[PooledPlace, ...]


def merge_calibrations(markerset: MarkerSet, calibrations: Sequence[Calibration], static: int | None = None) -> Merged:
    """Merge calibrations of one subject in one session.

    Args:
        markerset: of all of them; a trial need not show all of its markers.
        calibrations: one for each trial, in the same marker set.
        static: number of the trial whose shapes are taken, where it has them; the mean of all trials' if None.
    """
    onto = shared_axes(calibrations)
    changes = [axes_changes(number, calibration, onto) for number, calibration in enumerate(calibrations)]
    shapes = tuple(
        _merged_shape(segment.name, onto[segment.name], calibrations, changes, static) for segment in markerset.segments
    )
    joints = tuple(
        pool_places(
            [
                TrialPlace(calibration.source, moved(calibration[joint.name], change))
                for calibration, change in zip(calibrations, changes, strict=True)
            ]
        )
        for joint in markerset.joints
    )
    return Merged(
        Calibration(
            source=", ".join(calibration.source for calibration in calibrations),
            frames=sum(calibration.frames for calibration in calibrations),
            markerset=markerset,
            shapes=shapes,
            joints=tuple(joint.place for joint in joints),
        ),
        joints,
    )


def _merged_shape(
    name: str,
    reference: SharedAxes,
    calibrations: Sequence[Calibration],
    changes: Sequence[Mapping[str, AxesChange]],
    static: int | None,
) -> SegmentShape:
    """Mean shape of a segment over the trials, weighted by their frames; a static trial's for the markers it has."""
    placed: dict[str, list[_Placed]] = {}
    first = calibrations[reference.trial].shape(name)
    own = first.has_own_pose
    for number, (calibration, change) in enumerate(zip(calibrations, changes, strict=True)):
        shape = calibration.shape(name)
        if shape.has_pose != reference.has_pose or np.isnan(change[name].shift).any():
            continue
        own = own or shape.has_own_pose
        for marker, place, scatter in zip(shape.markers, shape.places, shape.scatter, strict=True):
            part = _Placed(change[name].place(place), float(scatter), calibration.frames, number == static)
            placed.setdefault(marker, []).append(part)
    markers = tuple(marker for marker in calibrations[0].markerset.segment(name).markers if marker in placed)
    merged = [_mean_place(placed[marker]) for marker in markers]
    return SegmentShape(
        segment=name,
        markers=markers,
        places=np.array([place for place, _ in merged]).reshape(-1, 3),
        scatter=np.array([scatter for _, scatter in merged]),
        has_own_pose=own,
        reason=first.reason,
    )


class _Placed(NamedTuple):
    """A marker's place in one trial."""

    place: Floats
    scatter: float
    frames: int
    static: bool


def _mean_place(parts: Sequence[_Placed]) -> tuple[Floats, float]:
    """A marker's place (3,), and its root mean square distance from there over all trials, metres."""
    chosen = [part for part in parts if part.static] or parts
    place = np.average([part.place for part in chosen], axis=0, weights=[part.frames for part in chosen])
    square = [np.nan_to_num(part.scatter) ** 2 + ((part.place - place) ** 2).sum() for part in parts]
    return place, float(np.sqrt(np.average(square, weights=[part.frames for part in parts])))
