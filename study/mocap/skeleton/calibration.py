"""What phase 1 leaves for phase 2: the shape of every segment, with the joints in it, and how well they are known.

A calibration belongs to a subject with its markers on: fitted to one recording it draws any other of the same session.
It is kept as JSON, every number as it was, so that it can be read by anything and runs nothing.

Source: paper §10 ("calculations can be reused for the same actor and marker-set").
"""

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from study.mocap.geometry.kabsch import nearest_rotation
from study.mocap.io.recording import Recording, RecordingError
from study.mocap.joints.estimates import JointStatus
from study.mocap.joints.fit_joints import FoundJoint, Joints
from study.mocap.joints.segment_poses import Frames
from study.mocap.markersets.marker_set import Joint, MarkerSet
from study.runs.storage.atomic_write import write
from study.sphere.types import Floats

FORMAT = "sphere-fit-study calibration"
VERSION = 1


@dataclass(frozen=True, eq=False)
class Shape:
    """A segment as phase 2 knows it.

    Attributes:
        segment: its name.
        markers: on it, as far as their places are known; ``places`` of them (m, 3), metres, in its axes.
        scatter: root mean square distance of each from its place (m,), metres: noise and soft tissue.
        misfit: root mean square distance of its markers from where phase 2 had them in the recording that it was fitted
            to, metres; NaN if that never showed it fully.
        own: whether its markers alone, three or more of them, make a frame.
        why: why it had no frame, or "". Its axes are then those of the segment it hangs on, in the mean pose.
    """

    segment: str
    markers: tuple[str, ...]
    places: Floats
    scatter: Floats
    own: bool
    why: str
    misfit: float = float("nan")


@dataclass(frozen=True, eq=False)
class Place:
    """A joint as phase 2 knows it. Places are in metres, NaN where they are not known.

    Attributes:
        joint: as the marker set has it.
        status: what to think of it; ``reason`` says it in words.
        in_parent: in the parent's axes (3,); ``in_child``: in the child's.
        covariance: of the place in the parent's axes (3, 3), m².
        axis_in_parent: of a hinge (3,); ``axis_in_child``: the same in the child's axes; NaN for others.
        rest: mean rotation of the child in the parent's axes (3, 3).
    """

    joint: Joint
    status: JointStatus
    reason: str
    in_parent: Floats
    in_child: Floats
    covariance: Floats
    axis_in_parent: Floats
    axis_in_child: Floats
    rest: Floats

    @property
    def known(self) -> bool:
        """Whether it is at a known place in both of its segments."""
        return not (np.isnan(self.in_parent).any() or np.isnan(self.in_child).any())


@dataclass(frozen=True, eq=False)
class Calibration:
    """Phase 1's answer, as far as phase 2 needs it.

    Attributes:
        source: name of the recording it was fitted to; ``frames``: how many that had.
        markerset: whose segments and joints they are.
        shapes: of all segments, in the marker set's order; ``joints``: all of its joints, in its order.
    """

    source: str
    frames: int
    markerset: MarkerSet
    shapes: tuple[Shape, ...]
    joints: tuple[Place, ...]

    def shape(self, segment: str) -> Shape:
        """The shape of a segment (KeyError if there is none)."""
        return {shape.segment: shape for shape in self.shapes}[segment]

    def __getitem__(self, joint: str) -> Place:
        """The joint of a name (KeyError if there is none)."""
        return {place.joint.name: place for place in self.joints}[joint]

    def save(self, path: str | Path) -> Path:
        """Write it as JSON.

        Raises:
            RecordingError: if it cannot be written.
        """
        path = Path(path)
        document = {
            "format": FORMAT, "version": VERSION, "source": self.source, "frames": self.frames, "unit": "m",
            "markerset": self.markerset.model_dump(mode="json"),
            "segments": [_plain(shape) for shape in self.shapes],
            "joints": [_plain(each) | {"joint": each.joint.name, "status": each.status.name} for each in self.joints],
        }  # fmt: skip
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path, (json.dumps(document, indent=1) + "\n").encode())
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from None
        return path


def keep(joints: Joints, recording: Recording) -> Calibration:
    """What of phase 1's answer is kept.

    Args:
        joints: that were found.
        recording: in this one.
    """
    found = {each.joint.child: each for each in joints.joints}
    shapes = []
    for segment in joints.markerset.segments:
        frames = joints.frames.get(segment.name)
        if frames is not None:
            shapes.append(_shape(frames, segment.markers))
        else:
            why = joints.frameless.get(segment.name, "")
            shapes.append(_hanging(segment.name, found.get(segment.name), joints, recording, why))
    places = tuple(_place(each, joints) for each in joints.joints)
    return Calibration(joints.recording, recording.frames, joints.markerset, tuple(shapes), places)


def _shape(frames: Frames, markers: tuple[str, ...]) -> Shape:
    rows = [k for k, name in enumerate(frames.points) if name in markers]
    names = tuple(frames.points[k] for k in rows)
    return Shape(
        frames.segment, names, frames.template[rows], frames.scatter[rows], len(rows) == len(frames.points), ""
    )


def _hanging(name: str, found: FoundJoint | None, joints: Joints, recording: Recording, why: str) -> Shape:
    """A segment without a frame: its markers are at their radius from the joint, where they are on average.

    Axes are the parent's, the joint is where it is in these.
    """
    parent = None if found is None else joints.frames.get(found.joint.parent)
    if found is None or parent is None or np.isnan(found.in_parent).any():
        return Shape(name, (), np.zeros((0, 3)), np.zeros(0), False, why)
    names, places, scatter = [], [], []
    for marker in joints.markerset.segment(name).markers:
        if marker not in recording.markers:
            continue
        away = parent.see(recording.of(marker)) - found.in_parent[:, None]
        away = away[:, ~np.isnan(away[0])]
        if away.shape[1] < 2:
            continue
        distance = np.linalg.norm(away, axis=0)
        middle, mean = float(np.median(distance)), np.median(away, axis=1)
        if not np.linalg.norm(mean) > 0.0:
            continue
        names.append(marker)
        places.append(found.in_parent + middle * mean / np.linalg.norm(mean))
        scatter.append(1.4826 * float(np.median(np.abs(distance - middle))))
    return Shape(name, tuple(names), np.array(places).reshape(-1, 3), np.array(scatter), False, why)


def _place(found: FoundJoint, joints: Joints) -> Place:
    parent, child = joints.frames.get(found.joint.parent), joints.frames.get(found.joint.child)
    in_child, rest = found.in_child, np.eye(3)
    if parent is not None and child is not None:
        both = parent.known & child.known
        if both.any():
            between = np.einsum("jit,jkt->ik", parent.rotation[:, :, both], child.rotation[:, :, both])
            rest = nearest_rotation(between)
    elif child is None:  # its axes are the parent's
        in_child = found.in_parent
    return Place(
        found.joint, found.status, found.reason, found.in_parent, in_child, found.covariance, found.axis_in_parent,
        found.axis_in_child, rest,
    )  # fmt: skip


def _plain(record: Shape | Place) -> dict[str, Any]:
    """A record as JSON has it; NaN becomes null."""
    result: dict[str, Any] = {}
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, np.ndarray):
            value = _listed(value)
        elif isinstance(value, float):
            value = None if np.isnan(value) else value
        result[field.name] = value
    return result


def _listed(values: Floats) -> Any:
    if values.ndim > 1:
        return [_listed(row) for row in values]
    return [None if np.isnan(value) else float(value) for value in values]


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
        return _restored(document)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordingError(f"{path}: a damaged calibration ({words}); make it anew") from None


def _restored(document: dict[str, Any]) -> Calibration:
    markerset = MarkerSet.model_validate(document["markerset"])
    by_name = {joint.name: joint for joint in markerset.joints}
    shapes = []
    for each in document["segments"]:
        markers = tuple(map(str, each["markers"]))
        places, scatter = _array(each["places"], (len(markers), 3)), _array(each["scatter"], (len(markers),))
        misfit = float("nan") if each["misfit"] is None else float(each["misfit"])
        name, why = str(each["segment"]), str(each["why"])
        shapes.append(Shape(name, markers, places, scatter, bool(each["own"]), why, misfit))
    joints = []
    for each in document["joints"]:
        vectors = {key: _array(each[key], (3,)) for key in ("in_parent", "in_child", "axis_in_parent", "axis_in_child")}
        matrices = {key: _array(each[key], (3, 3)) for key in ("covariance", "rest")}
        status, reason = JointStatus[each["status"]], str(each["reason"])
        joints.append(Place(joint=by_name[each["joint"]], status=status, reason=reason, **vectors, **matrices))
    if [shape.segment for shape in shapes] != [segment.name for segment in markerset.segments]:
        raise ValueError("its segments are not those of its marker set")
    return Calibration(str(document["source"]), int(document["frames"]), markerset, tuple(shapes), tuple(joints))


def _array(rows: Any, shape: tuple[int, ...]) -> Floats:
    array = np.array(rows, dtype=np.float64).reshape(shape) if rows else np.zeros(shape)
    if array.shape != shape:
        raise ValueError(f"an array of shape {array.shape} where {shape} is needed")
    return array
