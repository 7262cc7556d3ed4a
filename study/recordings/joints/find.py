"""Phase 1: fit all joints of a body to a whole recording, each fixed in the two segments that meet there.

The answer is each joint's place and axis in both of its segments, or the reason why there is none. A joint is the
centre of the spheres on which the child's markers move in the parent's axes. Joints are fitted from the root outwards:
hips come from the pelvis's own markers, and a hip is the third point of a thigh that has two. Where the child has poses
of its own, the parent's markers are fitted in the child's axes, too, and so is the point in which both segments agree.
The estimate with the best status and the smallest standard error is chosen; the others are compared with it.

A `Calibration` has the joints, and the shape of each segment. It belongs to a subject with its markers on: fitted to
one recording, it serves for any other of the same session (paper §10, "calculations can be reused for the same actor
and marker-set"). Its file is JSON: every number exactly, readable by any program. What phase 2 does not need - poses of
segments, estimates from each side - is not in it.

Source: paper §2, §7; theory §1.2.
"""

import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Self

import numpy as np
import pydantic
from pydantic.dataclasses import dataclass
from threadpoolctl import threadpool_limits

from study.arrays import Bools, Floats, Ints
from study.recordings.joints.center import LocalMarker, center_only
from study.recordings.joints.estimate import (
    CENTIMETRE,
    COMPARABLE,
    DOUBTED,
    SHORT_TEXTS,
    USABLE,
    Estimate,
    JointStatus,
    Side,
    check_against_sides,
    check_both_ways,
    estimate_from_poses,
    estimate_from_spheres,
    largest_error,
    local_marker,
    symmetric_fit,
)
from study.recordings.joints.poses import SegmentPoses, exchanged_labels, fit_poses, poses_from_markers, reference_frame
from study.recordings.joints.skin import SkinErrors
from study.recordings.markersets import Joint, MarkerSet
from study.recordings.recording import Recording, RecordingError, written
from study.recordings.rigid import across, mean_rotated_covariance, nearest_rotation, relative_rotation
from study.text import columns, number


def _array(*shape: int) -> pydantic.BeforeValidator:
    """Conversion of numbers to an array of this shape, in which -1 stands for any length."""

    def convert(rows: object) -> Floats:
        array = np.asarray(rows, dtype=np.float64)
        array = array if array.size else array.reshape(*(max(length, 0) for length in shape))
        if array.ndim != len(shape) or any(n not in (-1, m) for n, m in zip(shape, array.shape, strict=True)):
            raise ValueError(f"shape {array.shape} where {str(shape).replace('-1', 'm')} is needed")
        return array

    return pydantic.BeforeValidator(convert)


_Serial = pydantic.PlainSerializer(
    lambda values: np.where(np.isnan(values), np.array(None), np.asarray(values, dtype=float)).tolist()
)
"""Nested lists of an array's numbers; NaN becomes null."""
Vector = Annotated[Floats, _array(3), _Serial]
Matrix = Annotated[Floats, _array(3, 3), _Serial]
_FROM_NULL = pydantic.BeforeValidator(lambda value: float("nan") if value is None else value)
_TO_NULL = pydantic.PlainSerializer(lambda value: None if np.isnan(value) else value)
Number = Annotated[float, _FROM_NULL, _TO_NULL]
"""A number that is null in JSON where it is not known, and NaN here."""
_BY_NAME = pydantic.BeforeValidator(lambda value: JointStatus[value] if isinstance(value, str) else value)
Status = Annotated[JointStatus, _BY_NAME, pydantic.PlainSerializer(lambda status: status.name)]
_CONFIG = pydantic.ConfigDict(arbitrary_types_allowed=True, populate_by_name=True)


def _unknown(*shape: int) -> Callable[[], Floats]:
    """Default of an array that is not known: NaN."""
    return lambda: np.full(shape, np.nan)


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
        anatomy_covariance: of the error of their rotation (3, 3), rad², in the segment's axes, alike.
    """

    segment: str
    markers: tuple[str, ...]
    places: Annotated[Floats, _array(-1, 3), _Serial]
    scatter: Annotated[Floats, _array(-1), _Serial]
    has_own_pose: Annotated[bool, pydantic.Field(alias="own")]
    reason: Annotated[str, pydantic.Field(alias="why")]
    misfit: Number = float("nan")
    anatomy: Matrix = field(default_factory=_unknown(3, 3))
    anatomy_covariance: Matrix = field(default_factory=_unknown(3, 3))

    @pydantic.model_validator(mode="after")
    def _fits(self) -> Self:
        if not len(self.markers) == len(self.places) == len(self.scatter):
            raise ValueError(f"{self.segment}: {len(self.markers)} markers, {len(self.places)} places")
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
        allowance: covariance of what skin hides in a trial that hardly moved it (3, 3), m², in the same axes (see
            `study.recordings.session`); part of the covariance only if no trial moved the joint.
        beside: of a knee, its distance from the middle of its epicondyles, across its axis, metres; NaN if the file has
            none, or the joint is there.
        warnings: reasons why it is unlike any body's joint (see `plausibility`).
        estimates: from its sides, the chosen one first; none in a calibration that was read or merged.
    """

    joint: Annotated[Joint, pydantic.PlainSerializer(lambda joint: joint.name)]
    status: Status
    reason: str
    in_parent: Vector = field(default_factory=_unknown(3))
    in_child: Vector = field(default_factory=_unknown(3))
    covariance: Matrix = field(default_factory=_unknown(3, 3))
    axis_in_parent: Vector = field(default_factory=_unknown(3))
    axis_in_child: Vector = field(default_factory=_unknown(3))
    mean_rotation: Annotated[Matrix, pydantic.Field(alias="rest")] = field(default_factory=lambda: np.eye(3))
    trials: tuple[str, ...] = ()
    floor: Number = float("nan")
    allowance: Floats = pydantic.Field(default_factory=lambda: np.zeros((3, 3)), exclude=True, repr=False)
    beside: Number = float("nan")
    warnings: tuple[str, ...] = ()
    estimates: tuple[pydantic.InstanceOf[Estimate], ...] = pydantic.Field(default=(), exclude=True, repr=False)

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
    def has_vote(self) -> bool:
        """True if a trial moved it far enough to count in a session: skin hides less than a centimetre."""
        return largest_error(self.allowance, self.axis) < CENTIMETRE

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
    shapes: Annotated[tuple[SegmentShape, ...], pydantic.Field(alias="segments")]
    joints: tuple[JointPlace, ...]
    poses: Mapping[str, pydantic.InstanceOf[SegmentPoses]] = pydantic.Field(
        default_factory=dict, exclude=True, repr=False
    )

    @pydantic.model_validator(mode="after")
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
        return by_words((place.joint.name, words) for place in doubted for words in place.reason.split("; "))

    def beside(self) -> Iterator[str]:
        """Lay out the distances of knees from the middle of their epicondyles, if the file has these."""
        far = [f"{p.joint.name} {1000 * p.beside:.0f} mm" for p in self.joints if not np.isnan(p.beside)]
        if far:
            yield f"across their axes from the middle of the epicondyles: {', '.join(far)}"

    def warnings(self) -> Iterator[str]:
        """Lay out what is unlike any body's, a line for each warning with the joints that it holds for."""
        return by_words((place.joint.name, f"warning: {words}") for place in self.joints for words in place.warnings)

    def lines(self) -> Iterator[str]:
        """Lay out status, error and floor of each joint as phase 1 left them, in millimetres, then the warnings."""
        errors = [[number(1000 * x, ".1f") for x in (p.standard_error, p.floor)] for p in self.joints]
        rows = [[p.joint.name, SHORT_TEXTS[p.status], *own] for p, own in zip(self.joints, errors, strict=True)]
        yield from columns(rows, [f"joint in {self.source}", "status", "error / mm", "floor / mm"], "<<>")
        yield from self.beside()
        yield from self.warnings()


def by_words(pairs: Iterable[tuple[str, str]]) -> Iterator[str]:
    """A line for each different text, with the names that have it."""
    names = defaultdict(list)
    for name, words in pairs:
        names[words].append(name)
    return (f"{', '.join(names[words])}: {words}" for words in names)


FORMAT = "sphere-fit-study calibration"
VERSION = 1
_MODEL = pydantic.TypeAdapter(Calibration)


def save_calibration(calibration: Calibration, path: str | Path) -> Path:
    """Write a calibration as JSON.

    Raises:
        RecordingError: if the file cannot be written.
    """
    content = _MODEL.dump_python(calibration, mode="json", by_alias=True)
    head = {key: content.pop(key) for key in ("source", "frames")}
    document = {"format": FORMAT, "version": VERSION, **head, "unit": "m", **content}
    text = json.dumps(document, indent=1) + "\n"
    return written(Path(path), lambda temporary: temporary.write_bytes(text.encode()))


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
    if (version := document.get("version")) != VERSION:
        raise RecordingError(f"{path}: version {version} of a calibration; this program reads {VERSION}")
    try:
        markerset = MarkerSet.model_validate(document["markerset"])
        declared = {joint.name: joint for joint in markerset.joints}
        joints = [place | {"joint": declared[place["joint"]]} for place in document["joints"]]
        return _MODEL.validate_python(document | {"markerset": markerset, "joints": joints})
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        words = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    except (KeyError, TypeError, ValueError) as error:
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
    raise RecordingError(f"{path}: a damaged calibration ({words}); make it again with `study joints`")


def moved_along_axis(place: JointPlace, middle: Floats) -> JointPlace:
    """A hinge, moved along its axis to where that is nearest to a point (3,) of its parent, metres."""
    axis = place.axis_in_parent
    step = float((middle - place.in_parent) @ axis)
    in_child = place.axis_in_child * np.sign((place.mean_rotation @ place.axis_in_child) @ axis)
    if np.isnan(in_child).any():  # a child without a pose
        in_child = place.mean_rotation.T @ axis
    return replace(place, in_parent=place.in_parent + step * axis, in_child=place.in_child + step * in_child)


SLIDES = 0.001
"""Metres: how far skin slides along with a joint, beyond what the stated error covers."""
_NO_MOTION = 0.001
"""Radians: rotation that is none; skin of a millimetre would hide a joint to a metre."""


def allowance(place: JointPlace) -> Floats:
    """Covariance (3, 3), m², of what skin may hide in a trial that hardly moved a joint, in the axes of its own one.

    The rotation is that of both segments' poses, or else that of the markers of one about the joint.
    """
    pair = next((e.pair for e in place.estimates if e.pair is not None), None)
    estimate = place.estimate
    if estimate is None:
        return np.zeros((3, 3))
    normal = np.zeros((3, 3)) if pair is None else pair.normal
    # two estimates would have a pair, if the joint moved at all
    if pair is None and estimate.sphere is not None and len(place.estimates) == 1:
        normal = estimate.sphere.normal / estimate.used[estimate.sphere.weights > 0.0].sum()
        if estimate.side == "child" and not np.isnan(place.in_parent).any():
            normal = place.mean_rotation @ normal @ place.mean_rotation.T
    basis = across(place.axis)
    values, vectors = np.linalg.eigh(basis.T @ normal @ basis)
    if pair is None:  # along the arm of markers that move on a sphere only its curvature shows, not rotation
        values[0] = values[1]
    along = basis @ vectors
    return np.asarray((along * (SLIDES**2 / np.maximum(values, _NO_MOTION**2))) @ along.T)


def with_allowance(place: JointPlace) -> JointPlace:
    """A joint of a single trial; unsure, with what skin may hide in its error, if the trial hardly moved it."""
    place = replace(place, allowance=allowance(place))
    if not place.usable or place.has_vote:
        return place
    total = place.covariance + place.allowance
    error = 1000 * largest_error(total, place.axis)
    reason = f"it moved too little to show it: ± {error:.0f} mm, if skin slides by {1000 * SLIDES:.0f} mm"
    return replace(place, status=JointStatus.UNSURE, reason=reason, covariance=total)


_FRAMES = 300
"""Frames on which errors are propagated from joint to joint."""
_ROUNDING = 1e-9
"""Metres."""
_BUILT_ON = (*USABLE, *DOUBTED, JointStatus.UNSURE, JointStatus.INSIGNIFICANT)
"""A joint that may be the third point of a segment's pose; its errors are propagated."""


def find_joints(markerset: MarkerSet, recording: Recording) -> Calibration:
    """Find all joints of a recording.

    Args:
        markerset: segments and joints; its markers are looked up under their names.
        recording: the same markers; those that it lacks count as always missing (see `match`).

    Returns:
        The calibration, without misfits of shapes and warnings (see `calibrate`), with the poses of the segments.
    """
    with threadpool_limits(1, user_api="blas"):  # threads take longer to start than such small products
        body = _Body(markerset, recording)
        answers = {place.joint.name: place for place in _from_the_root(body)}
        exchanges = {s.name: exchange(s.markers, recording) for s in markerset.segments}
        joints = []
        for joint in markerset.joints:
            place = in_both_segments(replace(answers[joint.name], joint=joint), body.poses)
            if words := [exchanges[name] for name in (joint.parent, joint.child) if exchanges[name]]:
                status, reasons = (JointStatus.UNSURE, []) if place.usable else (place.status, [place.reason])
                place = replace(place, status=status, reason="; ".join([*words, *reasons]))
            joints.append(place)
        shapes = tuple(_shape(segment.name, body, joints) for segment in markerset.segments)
    return Calibration(recording.name, recording.frames, markerset, shapes, tuple(joints), body.poses)


def exchange(markers: Sequence[str], recording: Recording) -> str:
    """The words about two markers of a segment that exchange their labels in a recording, and the remedy; or ""."""
    names = [marker for marker in markers if marker in recording.markers]
    exchanged = exchanged_labels(np.stack([recording.of(name) for name in names])) if len(names) > 2 else None
    if exchanged is None:
        return ""
    one, two, frames = exchanged
    share, first = f"{frames.mean():.0%} of the frames", int(frames.argmax()) + 1
    words = f"{names[one]} and {names[two]} exchange their labels in {share}, first in frame {first}"
    return f"{words}: exchange them back where the markers are labelled, or leave these frames out"


class _Body:
    """Poses of a body's segments, as far as they are known.

    Attributes:
        markerset: without the markers that the recording lacks.
        recording: with the markers.
        poses: of each segment that has any.
        reasons: why the others have none.
        own: poses of the segments whose own markers fix them.
        skin: of these.
        rests_on: for a segment whose poses are fitted to a joint, too, the estimate of that joint.
    """

    def __init__(self, markerset: MarkerSet, recording: Recording) -> None:
        def present(markers: Sequence[str]) -> dict[str, tuple[str, ...]]:
            return {"markers": tuple(marker for marker in markers if marker in recording.markers)}

        segments = tuple(s.model_copy(update=present(s.markers)) for s in markerset.segments)
        joints = tuple(j.model_copy(update=present(markerset.markers_for(j))) for j in markerset.joints)
        self.markerset = markerset.model_copy(update={"segments": segments, "joints": joints})
        self.recording, self.reference = recording, reference_frame(recording)
        self.poses: dict[str, SegmentPoses] = {}
        self.reasons: dict[str, str] = {}
        for name, poses in poses_from_markers(self.markerset, recording, self.reference).items():
            self._put(name, poses)
        self.own = dict(self.poses)
        self.skin, self.rests_on = SkinErrors(recording, self.own), dict[str, Estimate]()

    def _put(self, name: str, poses: SegmentPoses | str) -> None:
        if isinstance(poses, str):
            self.reasons[name] = poses
        else:
            self.poses[name] = poses
            self.reasons.pop(name, None)

    def local_markers(
        self, names: Sequence[str], poses: SegmentPoses, frames: Ints | slice = slice(None)
    ) -> list[LocalMarker]:
        """Markers in a segment's axes in some of the frames, without the outliers in their own segments."""
        return [local_marker(poses, self.recording.of(name)[:, frames], self._accepted(name)[frames]) for name in names]

    def by_spheres(self, side: Side, poses: SegmentPoses | None, names: Sequence[str], hinge: bool) -> Estimate | None:
        """An estimate from markers in a segment's axes; None without a pose, or if the markers do not move."""
        if poses is None or not names:
            return None
        return estimate_from_spheres(side, poses, names, self.local_markers(names, poses), hinge)

    def _accepted(self, marker: str) -> Bools:
        """Samples of a marker (frames,) that are no outliers in its own segment."""
        owner = next((poses for poses in self.poses.values() if marker in poses.points), None)
        if owner is None:
            return np.ones(self.recording.frames, dtype=np.bool_)
        return np.asarray(~owner.outliers[owner.points.index(marker)])

    def complete(self, joint: Joint, estimate: Estimate) -> None:
        """Fit the poses of a joint's segments that have too few markers, with the joint as one more point."""
        for name in (joint.child, joint.parent):
            if name not in self.poses:
                self.rests_on[name] = estimate
                self._put(name, self.about_joint(name, joint.name, estimate, slice(None)))

    def about_joint(
        self, segment: str, joint: str, base: Estimate, frames: Ints | slice, step: Floats | float = 0.0
    ) -> SegmentPoses | str:
        """Fit a segment's poses to its markers and a joint, moved by a step (3,) in the axes of its estimate.

        The joint's own error is the same in every frame, so that it is no noise of the pose; it is propagated apart.
        """
        place, poses, markers = base.center + step, base.poses, self.markerset.segment(segment).markers
        x = [poses.to_world(place), *(self.recording.of(marker)[:, frames] for marker in markers)]
        return fit_poses(segment, [joint, *markers], x, poses.world_covariance(place), self.reference)


def _from_the_root(body: _Body) -> Iterator[JointPlace]:
    """Fit the joints, parents first, until no more can be fitted; their places in both segments are still open."""
    order = [segment.name for segment in body.markerset.segments]
    waiting = sorted(body.markerset.joints, key=lambda joint: order.index(joint.child))
    while ready := [j for j in waiting if j.parent in body.poses] or [j for j in waiting if j.child in body.own]:
        joint = ready[0]
        waiting.remove(joint)
        place = _fit(joint, body)
        if place.estimate is not None and place.estimate.status in _BUILT_ON:
            body.complete(joint, place.estimate)
        yield place
    for joint in waiting:
        two = joint.parent, joint.child
        whys = [body.reasons.get(s) or f"{s} has one only by the joint {body.poses[s].points[0]}" for s in two]
        yield JointPlace(joint, JointStatus.NO_FRAME, f"{JointStatus.NO_FRAME.text} ({'; '.join(whys)})")


def _fit(joint: Joint, body: _Body) -> JointPlace:
    """Fit a joint from each side that has poses without it, and choose among the estimates."""
    markerset, hinge = body.markerset, joint.kind == "hinge"
    parent, child = body.poses.get(joint.parent), body.own.get(joint.child)
    estimates = [
        body.by_spheres("parent", parent, markerset.markers_for(joint), hinge),
        body.by_spheres("child", child, markerset.segment(joint.parent).markers, hinge),
    ]
    if parent is not None and child is not None and (pair := symmetric_fit(parent, child)) is not None:
        estimates.append(estimate_from_poses(parent, pair, hinge))
    # with the errors of the joint that an estimate's poses rest on, and those from skin
    whole = [_with_propagated_errors(estimate, body) for estimate in estimates if estimate is not None]
    ranked = [body.skin.add(estimate, joint).with_status() for estimate in whole]
    ranked.sort(key=lambda estimate: (estimate.status, estimate.standard_error))
    if not ranked:
        samples = sum(int((~np.isnan(body.recording.of(name)[0])).sum()) for name in markerset.markers_for(joint))
        status = JointStatus.STILL if samples > 3 else JointStatus.UNSEEN
        return JointPlace(joint, status, status.text)
    chosen, sides_differ = check_against_sides(ranked[0], ranked[1:])
    # of the estimates in the first one's axes, the one in which bending and straightening differ most
    one_frame = (e for e in ranked if e.poses is ranked[0].poses and e.status in COMPARABLE)
    ways = [body.skin.ways(estimate, joint) for estimate in one_frame]
    most = max(ways, key=lambda two: sum(way.distance for way in two if way.contradicts), default=[])
    chosen, reverses = check_both_ways(chosen, most)
    ends = [body.recording.of(name) for name in joint.across if name in body.recording.markers]
    if len(ends) == 2:
        chosen = chosen.placed_along_axis(0.5 * (ends[0] + ends[1]))
    if not hinge and chosen.status == JointStatus.HINGE:  # a hinge is not reliable along its axis
        chosen = replace(chosen, status=JointStatus.ONE_AXIS)
    own = sides_differ or ("" if chosen.status in (*USABLE, JointStatus.REVERSES) else chosen.status.text)
    reason = "; ".join(filter(None, (own, reverses))) or chosen.status.text
    return JointPlace(joint, chosen.status, reason, floor=chosen.floor, estimates=(chosen, *ranked[1:]))


def _with_propagated_errors(estimate: Estimate, body: _Body) -> Estimate:
    """Add to an estimate's covariance the errors of the joint that its segment's poses are fitted to.

    That joint is moved by its standard errors, one principal direction after the other, and the fit is repeated with
    the poses that follow, on frames spread over the recording.
    """
    segment = estimate.poses.segment
    if segment not in body.rests_on:
        return estimate
    base, frames = body.rests_on[segment], body.recording.frames
    part = np.linspace(0, frames - 1, min(frames, _FRAMES)).astype(int)
    fixed, base = estimate.poses.in_frames(part), replace(base, poses=base.poses.in_frames(part))
    values, vectors = np.linalg.eigh(base.covariance)
    sizes = np.maximum(np.sqrt(np.maximum(values, 0.0)), _ROUNDING)
    places = np.full((4, 3), np.nan)
    for k, step in enumerate((np.zeros(3), *(vectors * sizes).T)):
        moved = body.about_joint(segment, fixed.points[0], base, part, step)
        if not isinstance(moved, str) and (center := _repeated(estimate, moved, part, body)) is not None:
            places[k] = fixed.mean_place(moved.to_world(center))
    shifts = places[1:] - places[0]
    shifts[np.isnan(shifts)] = 1.0  # a metre: a joint whose fit fails when its base moves is not known
    follows = shifts.T @ (vectors / sizes).T  # shift of the joint per shift of its base
    covariance = estimate.covariance + follows @ base.covariance @ follows.T
    return replace(estimate, covariance=covariance, skin=estimate.skin + follows @ base.skin @ follows.T)


def _repeated(estimate: Estimate, poses: SegmentPoses, part: Ints, body: _Body) -> Floats | None:
    """The centre (3,) of an estimate with other poses of its segment, in these frames; None if the fit fails."""
    if estimate.pair is not None:
        pair = symmetric_fit(poses, estimate.pair.child.in_frames(part))
        return None if pair is None else pair.in_parent
    markers = body.local_markers(estimate.markers, poses, part)
    return center_only(markers, *estimate.noise_model(poses))


def in_both_segments(place: JointPlace, poses: Mapping[str, SegmentPoses]) -> JointPlace:
    """Add a joint's place, the axis of a hinge, and the mean rotation in both segments' axes."""
    estimate, parent, child = place.estimate, poses.get(place.joint.parent), poses.get(place.joint.child)
    if parent is not None and child is not None and (both := parent.known & child.known).any():
        total = np.einsum("jit,jkt->ik", parent.rotation[:, :, both], child.rotation[:, :, both])
        place = replace(place, mean_rotation=nearest_rotation(total))
    if estimate is None:
        return place
    x, own = estimate.poses.to_world(estimate.center), int(estimate.side == "child")
    places = [np.full(3, np.nan) if one is None else one.mean_place(x) for one in (parent, child)]
    places[own] = estimate.center
    if child is None:  # its axes are the parent's
        places[1] = places[0]
    covariance = estimate.covariance
    if own == 1 and parent is not None and (both := parent.known & estimate.poses.known).any():
        relative = relative_rotation(parent.rotation[:, :, both], estimate.poses.rotation[:, :, both])
        covariance = mean_rotated_covariance(relative, covariance)
    place = replace(place, in_parent=places[0], in_child=places[1], covariance=covariance)
    if estimate.axis is None:
        return place
    axes = np.full((2, 3), np.nan)
    axes[own] = estimate.axis
    if parent is not None and child is not None:
        # rotations show an axis better than the planes of a few arcs; but errors are across the estimate's own axis
        pair = next((e.pair for e in place.estimates if e.pair is not None), None) or symmetric_fit(parent, child)
        if pair is not None and place.status != JointStatus.DISAGREE:
            axes = pair.axes
        else:
            one, other = (parent, child)[own], (parent, child)[1 - own]
            both = one.known & other.known
            turns = other.rotation[:, :, both], one.rotation[:, :, both]
            mean = np.einsum("jit,jkt,k->i", *turns, axes[own], optimize=True)
            length = np.linalg.norm(mean)
            axes[1 - own] = mean / length if length > 0.0 else np.nan
    return replace(place, axis_in_parent=axes[0], axis_in_child=axes[1])


def _shape(name: str, body: _Body, joints: Sequence[JointPlace]) -> SegmentShape:
    """Shape of a segment in its own axes; of one without poses, in its parent's.

    Each marker of the latter is at its median radius and direction from the joint that the segment rotates about.
    """
    own, poses = body.markerset.segment(name).markers, body.poses.get(name)
    if poses is not None:
        rows = [k for k, point in enumerate(poses.points) if point in own]
        markers, alone = tuple(poses.points[k] for k in rows), len(rows) == len(poses.points)
        return SegmentShape(name, markers, poses.template[rows], poses.scatter[rows], alone, "")
    above = next((place for place in joints if place.joint.child == name), None)
    parent = None if above is None else body.poses.get(above.joint.parent)
    names, places, scatter = [], [], []
    if above is not None and parent is not None and not np.isnan(above.in_parent).any():
        for marker in own:
            away = parent.to_local(body.recording.of(marker)) - above.in_parent[:, None]
            away = away[:, ~np.isnan(away[0])]
            direction = np.median(away, axis=1) if away.shape[1] > 1 else np.zeros(3)
            if np.linalg.norm(direction) > 0.0:
                distance = np.linalg.norm(away, axis=0)
                radius = float(np.median(distance))
                names.append(marker)
                places.append(above.in_parent + radius * direction / np.linalg.norm(direction))
                scatter.append(1.4826 * float(np.median(np.abs(distance - radius))))
    return SegmentShape(name, tuple(names), np.array(places), np.array(scatter), False, body.reasons[name])
