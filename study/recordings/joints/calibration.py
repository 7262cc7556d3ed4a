"""The answer of phase 1: each joint fixed in both of its segments, and the shape of each segment.

It belongs to a subject with its markers on. Fitted to one recording, it serves for any other of the same session.

Its file is JSON: every number exactly, readable by any program. What phase 2 does not need - poses of segments,
estimates from each side - is not in it.

Source: paper §10 ("calculations can be reused for the same actor and marker-set").
"""

import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    InstanceOf,
    PlainSerializer,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic.dataclasses import dataclass

from study.arrays import Floats
from study.files import write
from study.recordings.joints.estimate import SHORT_TEXTS, USABLE, Estimate, JointStatus, largest_error
from study.recordings.joints.poses import SegmentPoses
from study.recordings.markersets import Joint, MarkerSet
from study.recordings.recording import RecordingError
from study.text import columns, number


def _to_lists(values: Floats) -> list[object]:
    """Nested lists of an array's numbers; NaN becomes null."""
    return [_to_lists(row) if row.ndim else None if np.isnan(row) else float(row) for row in values]


Array = Annotated[Floats, BeforeValidator(lambda rows: np.asarray(rows, dtype=np.float64)), PlainSerializer(_to_lists)]
Number = Annotated[
    float,
    BeforeValidator(lambda value: float("nan") if value is None else value),
    PlainSerializer(lambda value: None if np.isnan(value) else value),
]
"""A number that is null in JSON where it is not known, and NaN here."""
Status = Annotated[
    JointStatus,
    BeforeValidator(lambda value: JointStatus[value] if isinstance(value, str) else value),
    PlainSerializer(lambda status: status.name),
]
_CONFIG = ConfigDict(arbitrary_types_allowed=True, populate_by_name=True)


def _named(name: str) -> object:
    """Mark a field that has another name in the file."""
    return Field(validation_alias=name, serialization_alias=name)


@dataclass(frozen=True, eq=False, config=_CONFIG)
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
            fitted to, metres; NaN if that showed it fully in no frame, or if it was not drawn.
        anatomy: anatomical axes (3, 3), columns x, y, z, in the segment's axes; NaN if their points are not known.
    """

    segment: str
    markers: tuple[str, ...]
    places: Array
    scatter: Array
    has_own_pose: Annotated[bool, _named("own")]
    reason: Annotated[str, _named("why")]
    misfit: Number = float("nan")
    anatomy: Array = field(default_factory=lambda: np.full((3, 3), np.nan))

    @model_validator(mode="after")
    def _fits(self) -> Self:
        count = len(self.markers)
        object.__setattr__(self, "places", self.places.reshape(-1, 3) if not count else self.places)
        if (self.places.shape, self.scatter.shape, self.anatomy.shape) != ((count, 3), (count,), (3, 3)):
            raise ValueError(f"{self.segment}: {count} markers, places {self.places.shape}")
        return self

    @property
    def has_pose(self) -> bool:
        """True if it has poses, by its markers alone or with a joint."""
        return not self.reason


@dataclass(frozen=True, eq=False, config=_CONFIG)
class JointPlace:
    """A joint, fixed in both of its segments. Places are in metres, NaN where they are not known.

    Attributes:
        joint: as the marker set has it.
        status: its reliability.
        reason: the same in words.
        in_parent: place in the parent's axes (3,).
        in_child: place in the child's axes (3,); these are the parent's, if the child has no pose.
        covariance: of the place (3, 3), m², in the parent's axes, mean over the frames; in the child's, where the
            parent has no pose.
        axis_in_parent: axis of a hinge in the parent's axes (3,); NaN for others.
        axis_in_child: axis of a hinge in the child's axes (3,); NaN for others.
        mean_rotation: of the child in the parent's axes (3, 3).
        trials: names of the recordings that the place comes from, where there are several.
        floor: standard error from skin that no marker shows, metres (see `Estimate`); part of no covariance.
        allowance: covariance of what skin hides in a trial of a session that hardly moved it (3, 3), m², in the same
            axes (see `study.recordings.session`); part of no covariance.
        warnings: reasons why it is unlike any body's joint (see `plausibility`).
        estimates: from its sides, the chosen one first; none in a calibration that was read or merged.
    """

    joint: Annotated[Joint, PlainSerializer(lambda joint: joint.name)]
    status: Status
    reason: str
    in_parent: Array = field(default_factory=lambda: np.full(3, np.nan))
    in_child: Array = field(default_factory=lambda: np.full(3, np.nan))
    covariance: Array = field(default_factory=lambda: np.full((3, 3), np.nan))
    axis_in_parent: Array = field(default_factory=lambda: np.full(3, np.nan))
    axis_in_child: Array = field(default_factory=lambda: np.full(3, np.nan))
    mean_rotation: Annotated[Array, _named("rest")] = field(default_factory=lambda: np.eye(3))
    trials: tuple[str, ...] = ()
    floor: Number = float("nan")
    allowance: Floats = Field(default_factory=lambda: np.zeros((3, 3)), exclude=True, repr=False)
    warnings: tuple[str, ...] = ()
    estimates: tuple[InstanceOf[Estimate], ...] = Field(default=(), exclude=True, repr=False)

    @model_validator(mode="after")
    def _fits(self) -> Self:
        vectors = ("in_parent", "in_child", "axis_in_parent", "axis_in_child")
        for name in (*vectors, "covariance", "mean_rotation"):
            wanted, shape = (3,) if name in vectors else (3, 3), getattr(self, name).shape
            if shape != wanted:
                raise ValueError(f"{self.joint.name}: {name} of shape {shape} where {wanted} is needed")
        return self

    @property
    def estimate(self) -> Estimate | None:
        """The chosen estimate; None if there is none."""
        return self.estimates[0] if self.estimates else None

    @property
    def axis(self) -> Floats | None:
        """Axis of a hinge in the parent's axes (3,); None if it has none."""
        return None if np.isnan(self.axis_in_parent).any() else self.axis_in_parent

    @property
    def known(self) -> bool:
        """True if its place in both of its segments is known."""
        return not (np.isnan(self.in_parent).any() or np.isnan(self.in_child).any())

    @property
    def usable(self) -> bool:
        """True if its place is known and reliable."""
        return self.status in USABLE and not np.isnan(self.in_parent).any()

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """Order of trials by error, the best first; one that shows no more than an axis comes after those that do."""
        error = largest_error(self.covariance + self.allowance, self.axis)
        return bool(np.isnan(self.in_parent).any()), self.axis is not None, np.inf if np.isnan(error) else error

    @property
    def standard_error(self) -> float:
        """Largest standard error in the axes of the covariance, across the axis of a hinge, metres; NaN if unknown."""
        return largest_error(self.covariance, self.axis)


@dataclass(frozen=True, eq=False, config=_CONFIG)
class Calibration:
    """The answer of phase 1.

    Attributes:
        source: name of the recording that it was fitted to, or names with commas between them.
        frames: number of frames of these.
        markerset: whose segments and joints they are.
        shapes: of all segments, in the marker set's order.
        joints: all of the marker set's, in its order.
        poses: of each segment that has any, in the recording; none in a calibration that was read or merged.
    """

    source: str
    frames: int
    markerset: MarkerSet
    shapes: Annotated[tuple[SegmentShape, ...], _named("segments")]
    joints: tuple[JointPlace, ...]
    poses: Mapping[str, InstanceOf[SegmentPoses]] = Field(default_factory=dict, exclude=True, repr=False)

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if [shape.segment for shape in self.shapes] != [segment.name for segment in self.markerset.segments]:
            raise ValueError("its segments are not those of its marker set")
        return self

    def shape(self, segment: str) -> SegmentShape:
        """The shape of a segment (KeyError if there is none)."""
        return {shape.segment: shape for shape in self.shapes}[segment]

    def __getitem__(self, joint: str) -> JointPlace:
        """The joint of a name (KeyError if there is none)."""
        return {place.joint.name: place for place in self.joints}[joint]

    @property
    def without_pose(self) -> dict[str, str]:
        """The reason why a segment has no pose, for each of those."""
        return {shape.segment: shape.reason for shape in self.shapes if shape.reason}

    @property
    def has_poses(self) -> bool:
        """True if the markers of any segment fix its pose, so that there is a skeleton to draw."""
        return any(shape.has_own_pose for shape in self.shapes)

    def reasons(self) -> Iterator[str]:
        """Lay out the reasons to doubt joints, a line for each with the joints that it holds for."""
        doubted = (place for place in self.joints if place.status not in USABLE)
        return _by_words((place.joint.name, words) for place in doubted for words in place.reason.split("; "))

    def warnings(self) -> Iterator[str]:
        """Lay out what is unlike any body's, a line for each warning with the joints that it holds for."""
        return _by_words((place.joint.name, f"warning: {words}") for place in self.joints for words in place.warnings)

    def lines(self) -> Iterator[str]:
        """Lay out status, error and floor of each joint as phase 1 left them, in millimetres, then the warnings."""
        rows = [
            [p.joint.name, SHORT_TEXTS[p.status], *(number(1000 * x, ".1f") for x in (p.standard_error, p.floor))]
            for p in self.joints
        ]
        yield from columns(rows, [f"joint in {self.source}", "status", "error / mm", "floor / mm"], "<<>")
        yield from self.warnings()


def _by_words(pairs: Iterable[tuple[str, str]]) -> Iterator[str]:
    """A line for each different text, with the names that have it."""
    names = defaultdict(list)
    for name, words in pairs:
        names[words].append(name)
    return (f"{', '.join(names[words])}: {words}" for words in names)


FORMAT = "sphere-fit-study calibration"
VERSION = 1
_MODEL = TypeAdapter(Calibration)


def save_calibration(calibration: Calibration, path: str | Path) -> Path:
    """Write a calibration as JSON.

    Raises:
        RecordingError: if the file cannot be written.
    """
    path = Path(path)
    content = _MODEL.dump_python(calibration, mode="json", by_alias=True)
    head = {key: content.pop(key) for key in ("source", "frames")}
    document = {"format": FORMAT, "version": VERSION, **head, "unit": "m", **content}
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
        markerset = MarkerSet.model_validate(document["markerset"])
        declared = {joint.name: joint for joint in markerset.joints}
        joints = [place | {"joint": declared[place["joint"]]} for place in document["joints"]]
        return _MODEL.validate_python(document | {"markerset": markerset, "joints": joints})
    except ValidationError as error:
        first = error.errors()[0]
        words = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    except (KeyError, TypeError, ValueError) as error:
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
    raise RecordingError(f"{path}: a damaged calibration ({words}); make it again with `study joints`")
