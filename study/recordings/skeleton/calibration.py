"""The calibration of a subject: the shape of each segment and the joints in it, as phase 1 leaves them for phase 2.

It belongs to a subject with its markers on. Fitted to one recording, it serves for any other of the same session.

Its file is JSON: every number exactly, readable by any program.

Source: paper §10 ("calculations can be reused for the same actor and marker-set").
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from study.arrays import Floats
from study.files import write
from study.recordings.joints.estimate import USABLE, JointStatus, largest_error
from study.recordings.joints.report import SHORT_TEXTS
from study.recordings.markersets import Joint, MarkerSet
from study.recordings.recording import RecordingError
from study.text import columns, number


@dataclass(frozen=True, eq=False)
class SegmentShape:
    """A segment's markers, fixed in its axes.

    Attributes:
        segment: name of the segment.
        markers: those whose places are known.
        places: of these markers (m, 3), metres, in the segment's axes.
        scatter: root mean square distance of each from its place (m,), metres: noise and soft-tissue artefact.
        has_own_pose: True if its markers alone, three or more of them, fix its pose.
        reason: why it has no pose, or "". Its axes are then its parent's, in the mean pose.
        misfit: root mean square distance of its markers from their places in phase 2 of the recording that it was
            fitted to, metres; NaN if that showed it fully in no frame.
    """

    segment: str
    markers: tuple[str, ...]
    places: Floats
    scatter: Floats
    has_own_pose: bool
    reason: str
    misfit: float = float("nan")

    @property
    def has_pose(self) -> bool:
        """True if it has poses, by its markers alone or with a joint."""
        return not self.reason


@dataclass(frozen=True, eq=False)
class JointPlace:
    """A joint, fixed in both of its segments. Places are in metres, NaN where they are not known.

    Attributes:
        joint: as the marker set has it.
        status: its reliability.
        reason: the same in words.
        in_parent: place in the parent's axes (3,).
        in_child: place in the child's axes (3,).
        covariance: of the place in the parent's axes (3, 3), m².
        axis_in_parent: axis of a hinge in the parent's axes (3,); NaN for others.
        axis_in_child: axis of a hinge in the child's axes (3,); NaN for others.
        mean_rotation: of the child in the parent's axes (3, 3).
        trials: names of the recordings that the place comes from, where there are several.
        floor: standard error from skin that no marker shows, metres (see `Estimate`); part of no covariance.
        warnings: reasons why it is unlike any body's joint (see `plausibility`); they do not change its status.
    """

    joint: Joint
    status: JointStatus
    reason: str
    in_parent: Floats
    in_child: Floats
    covariance: Floats
    axis_in_parent: Floats
    axis_in_child: Floats
    mean_rotation: Floats
    trials: tuple[str, ...] = ()
    floor: float = float("nan")
    warnings: tuple[str, ...] = ()

    @property
    def known(self) -> bool:
        """True if its place in both of its segments is known."""
        return not (np.isnan(self.in_parent).any() or np.isnan(self.in_child).any())

    @property
    def usable(self) -> bool:
        """True if its place is known and reliable."""
        return self.status in USABLE and not np.isnan(self.in_parent).any()

    @property
    def rank(self) -> tuple[bool, JointStatus, float]:
        """Order by quality, the best first."""
        error = self.standard_error
        return bool(np.isnan(self.in_parent).any()), self.status, np.inf if np.isnan(error) else error

    @property
    def standard_error(self) -> float:
        """Largest standard error in the parent's axes, across the axis of a hinge, metres; NaN if unknown."""
        return largest_error(self.covariance, None if np.isnan(self.axis_in_parent).any() else self.axis_in_parent)

    @property
    def accuracy(self) -> tuple[float, float]:
        """Standard error and floor, metres; NaN where they are not known."""
        return self.standard_error, self.floor


@dataclass(frozen=True, eq=False)
class Calibration:
    """The answer of phase 1, as far as phase 2 needs it.

    Attributes:
        source: name of the recording that it was fitted to, or names with commas between them.
        frames: number of frames of these.
        markerset: whose segments and joints they are.
        shapes: of all segments, in the marker set's order.
        joints: all of the marker set's, in its order.
    """

    source: str
    frames: int
    markerset: MarkerSet
    shapes: tuple[SegmentShape, ...]
    joints: tuple[JointPlace, ...]

    def shape(self, segment: str) -> SegmentShape:
        """The shape of a segment (KeyError if there is none)."""
        return {shape.segment: shape for shape in self.shapes}[segment]

    def __getitem__(self, joint: str) -> JointPlace:
        """The joint of a name (KeyError if there is none)."""
        return {place.joint.name: place for place in self.joints}[joint]

    def warnings(self) -> Iterator[str]:
        """Lay out what is unlike any body's, a line for each joint and warning."""
        for place in self.joints:
            yield from (f"{place.joint.name}: warning: {words}" for words in place.warnings)

    def lines(self) -> Iterator[str]:
        """Lay out status, error and floor of each joint as phase 1 found them, in millimetres, then the warnings."""
        rows = [
            (each.joint.name, SHORT_TEXTS[each.status], *(number(1000 * x, ".1f") for x in each.accuracy))
            for each in self.joints
        ]
        yield from columns(map(list, rows), [f"joint in {self.source}", "status", "error / mm", "floor / mm"], "<<>")
        yield from self.warnings()


FORMAT = "sphere-fit-study calibration"
VERSION = 1


def save_calibration(calibration: Calibration, path: str | Path) -> Path:
    """Write a calibration as JSON.

    Raises:
        RecordingError: if the file cannot be written.
    """
    path = Path(path)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "source": calibration.source,
        "frames": calibration.frames,
        "unit": "m",
        "markerset": calibration.markerset.model_dump(mode="json"),
        "segments": [_segment_to_json(shape) for shape in calibration.shapes],
        "joints": [_joint_to_json(place) for place in calibration.joints],
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, (json.dumps(document, indent=1) + "\n").encode())
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def load_calibration(path: str | Path) -> Calibration:
    """Read a calibration.

    Raises:
        RecordingError: one line, if the file cannot be read or is no calibration.
    """
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError):
        raise RecordingError(f"{path}: not a calibration: not JSON; make one with `study joints`") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise RecordingError(f"{path}: not a calibration; make one with `study joints`")
    if document.get("version") != VERSION:
        raise RecordingError(
            f"{path}: version {document.get('version')} of a calibration; this program reads {VERSION}"
        )
    try:
        return _from_json(document)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordingError(f"{path}: a damaged calibration ({words}); make it again with `study joints`") from None


def _segment_to_json(shape: SegmentShape) -> dict[str, object]:
    return {
        "segment": shape.segment,
        "markers": shape.markers,
        "places": _array_to_json(shape.places),
        "scatter": _array_to_json(shape.scatter),
        "own": shape.has_own_pose,
        "why": shape.reason,
        "misfit": None if np.isnan(shape.misfit) else shape.misfit,
    }


def _joint_to_json(place: JointPlace) -> dict[str, object]:
    return {
        "joint": place.joint.name,
        "status": place.status.name,
        "reason": place.reason,
        "in_parent": _array_to_json(place.in_parent),
        "in_child": _array_to_json(place.in_child),
        "covariance": _array_to_json(place.covariance),
        "axis_in_parent": _array_to_json(place.axis_in_parent),
        "axis_in_child": _array_to_json(place.axis_in_child),
        "rest": _array_to_json(place.mean_rotation),
        "trials": place.trials,
        "floor": None if np.isnan(place.floor) else place.floor,
        "warnings": list(place.warnings),
    }


def _array_to_json(values: Floats) -> list[object]:
    """Nested lists of an array's numbers; NaN becomes null."""
    if values.ndim > 1:
        return [_array_to_json(row) for row in values]
    return [None if np.isnan(value) else float(value) for value in values]


def _from_json(document: dict[str, Any]) -> Calibration:
    markerset = MarkerSet.model_validate(document["markerset"])
    by_name = {joint.name: joint for joint in markerset.joints}
    shapes = []
    for each in document["segments"]:
        markers = tuple(map(str, each["markers"]))
        shapes.append(
            SegmentShape(
                segment=str(each["segment"]),
                markers=markers,
                places=_array_from_json(each["places"], (len(markers), 3)),
                scatter=_array_from_json(each["scatter"], (len(markers),)),
                has_own_pose=bool(each["own"]),
                reason=str(each["why"]),
                misfit=float("nan") if each["misfit"] is None else float(each["misfit"]),
            )
        )
    joints = []
    for each in document["joints"]:
        joints.append(
            JointPlace(
                joint=by_name[each["joint"]],
                status=JointStatus[each["status"]],
                reason=str(each["reason"]),
                in_parent=_array_from_json(each["in_parent"], (3,)),
                in_child=_array_from_json(each["in_child"], (3,)),
                covariance=_array_from_json(each["covariance"], (3, 3)),
                axis_in_parent=_array_from_json(each["axis_in_parent"], (3,)),
                axis_in_child=_array_from_json(each["axis_in_child"], (3,)),
                mean_rotation=_array_from_json(each["rest"], (3, 3)),
                trials=tuple(map(str, each.get("trials", ()))),
                floor=float("nan") if each.get("floor") is None else float(each["floor"]),  # not in older files
                warnings=tuple(map(str, each.get("warnings", ()))),
            )
        )
    if [shape.segment for shape in shapes] != [segment.name for segment in markerset.segments]:
        raise ValueError("its segments are not those of its marker set")
    return Calibration(str(document["source"]), int(document["frames"]), markerset, tuple(shapes), tuple(joints))


def _array_from_json(rows: object, shape: tuple[int, ...]) -> Floats:
    """An array of a given shape from nested lists, which lose it where they are empty; null becomes NaN."""
    array = np.array(rows, dtype=np.float64)
    if array.size == 0 and 0 in shape:
        return np.zeros(shape)
    if array.shape != shape:
        raise ValueError(f"an array of shape {array.shape} where {shape} is needed")
    return array
