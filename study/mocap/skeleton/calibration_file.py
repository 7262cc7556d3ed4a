"""Calibrations as JSON files: every number exactly, readable by any program."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from study.mocap.io.recording import RecordingError
from study.mocap.joints.estimates import JointStatus
from study.mocap.markersets.marker_set import MarkerSet
from study.mocap.skeleton.calibration import Calibration, JointPlace, SegmentShape
from study.runs.storage.atomic_write import write
from study.sphere.types import Floats

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
