"""The answer of phase 1: each joint fixed in both of its segments, and the shape of each segment.

It belongs to a subject with its markers on. Fitted to one recording, it serves for any other of the same session.

Its file is JSON: every number exactly, readable by any program. What phase 2 does not need - poses of segments,
estimates from each side - is not in it.

It is laid out as a table and as lines: each joint's place, its accuracy, and the reasons to doubt it. A second table
has the agreement of methods: the distances of other estimators' centres from the chosen one. The paper's estimators fit
the same samples with isotropic noise: `mgdk` fits all markers, weighted, and finds the noise as `als` does; `gdke`,
`ugdk` (with mgdk's noise) and `mle` fit the marker that moved most. The symmetric fit of both segments is the fifth.
Distances are across a hinge's axis, for no method knows the place along it.

Source: paper §10 ("calculations can be reused for the same actor and marker-set").
"""

import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field
from pathlib import Path
from typing import Annotated, Self

import numpy as np
import pandas as pd
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
from study.fits import fit, mgdk
from study.recordings.joints.estimate import (
    SHORT_TEXTS,
    USABLE,
    Estimate,
    JointStatus,
    largest_error,
    mean_difference,
    side_differences,
)
from study.recordings.joints.poses import SegmentPoses
from study.recordings.markersets import Joint, MarkerSet
from study.recordings.recording import Recording, RecordingError, written
from study.recordings.rigid import cap_angle, relative_rotation, rotation_range
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


def joint_table(joints: Calibration) -> pd.DataFrame:
    """Tabulate joints, a row per joint of the marker set.

    Returns:
        Columns: joint, kind, parent, child; status and reason in words; side, the segment whose axes the markers were
        in, or both; markers; center_parent_* and center_child_* (metres, in the segments' axes); error, the largest
        standard error across a dropped axis (metres), with that from skin and the differences of estimates that
        contradict each other; floor (metres), what skin common to a segment's markers adds unseen (see `Estimate`);
        cov_xx ... cov_zz (m², in the parent's axes); axis_parent_* and axis_child_* of a hinge; radius_mean (metres) of
        the markers' spheres; sigma (metres), noise of one coordinate; rho, share of the smallest extent that is noise;
        moved_least, moved_most (degrees), root mean square angles of motion about the joint; frames; worth, the
        effective number of independent frames; apart (metres), distance of the farthest other side's estimate that can
        be compared (see `side_differences`). NaN where there is none.
    """
    rows: list[dict[str, object]] = []
    for place in joints.joints:
        estimate = place.estimate
        row: dict[str, object] = {
            "joint": place.joint.name,
            "kind": place.joint.kind,
            "parent": place.joint.parent,
            "child": place.joint.child,
            "status": SHORT_TEXTS[place.status],
            "reason": place.reason,
            "side": estimate.side if estimate else "",
            "markers": ", ".join(estimate.markers) if estimate else "",
        }
        in_child = place.in_child if joints.shape(place.joint.child).has_pose else np.full(3, np.nan)
        vectors = {"center_parent": place.in_parent, "center_child": in_child}
        vectors |= {"axis_parent": place.axis_in_parent, "axis_child": place.axis_in_child}
        for name, vector in vectors.items():
            row |= {f"{name}_{axis}": float(x) for axis, x in zip("xyz", vector, strict=True)}
        pairs = [(i, j) for i in range(3) for j in range(i, 3)]
        row |= {f"cov_{'xyz'[i]}{'xyz'[j]}": float(place.covariance[i, j]) for i, j in pairs}
        rows.append(row | accuracy_columns(place))
    return pd.DataFrame(rows)


def accuracy_columns(place: JointPlace) -> dict[str, float]:
    """Accuracy of a joint and the data behind it, under the column names of `joint_table`; NaN where there is none."""
    names = ("error", "floor", "radius_mean", "sigma", "rho", "moved_least", "moved_most", "frames", "worth", "apart")
    values = dict.fromkeys(names, float("nan"))
    estimate = place.estimate
    if estimate is None:
        return values
    values |= {"error": place.standard_error, "floor": estimate.floor, "frames": float(estimate.frames)}
    values["worth"] = float(estimate.effective_frames)
    apart = (side.distance for side in side_differences(estimate, place.estimates[1:]))
    values["apart"] = max(apart, default=float("nan"))
    angles = np.zeros(0)
    if estimate.sphere is not None:
        radii = estimate.sphere.radii[np.isfinite(estimate.sphere.radii)]
        values |= {"sigma": float(estimate.sphere.noise), "rho": float(estimate.sphere.condition)}
        values |= {"radius_mean": float(radii.mean())} if len(radii) else {}
        angles = np.degrees(estimate.sphere.rms_angles)
    elif estimate.pair is not None:
        values["sigma"] = float(estimate.pair.gap) / np.sqrt(3.0)
        angles = np.degrees(estimate.pair.rms_angles)
    return values | ({"moved_least": float(angles.min()), "moved_most": float(angles.max())} if len(angles) else {})


_FAR = 10.0
"""Error, metres, from which its digits say nothing: the joint moved about one axis, and may lie anywhere along it."""


def agreement_lines(table: pd.DataFrame) -> Iterator[str]:
    """Lay out the agreement of methods, a line per joint, in millimetres.

    Args:
        table: a row per joint; its columns ``from_…`` are distances, metres (see `agreement_table`).
    """
    others = [name for name in table.columns if str(name).startswith("from_")]
    titles = ["distance to / mm", *(str(name).removeprefix("from_").replace("_", "-") for name in others)]
    distances = zip(table["joint"], table[others].to_numpy(dtype=float), strict=True)
    yield from columns([[name, *map(millimetres, row)] for name, row in distances], titles, "<>")


def joint_lines(joints: Calibration) -> Iterator[str]:
    """Lay out the joints, a line each in millimetres and degrees, then the reasons to doubt some of them."""
    titles = ["joint", "status", "from", *(f"{axis} / mm" for axis in "xyz"), "error", "floor", "noise", "range"]
    titles += ["ρ", "frames", "n_eff", "apart"]
    yield from columns(map(_joint_row, joints.joints), titles, "<<<>")
    yield "x, y, z: centre in its parent; error: largest standard error; noise: of a coordinate; all in mm"
    yield "floor: error from skin that moves all markers of a segment alike, by 5 mm/rad, which no marker shows, mm"
    yield "apart: distance to the farthest other side with an error, mm; n_eff: effective number of independent frames"
    yield "range: of motion, least and greatest root mean square angle; ρ: share of the smallest extent that is noise"
    for place in joints.joints:
        if place.joint.across and not np.isnan(place.axis_in_parent).any():
            yield f"{place.joint.name}: along its axis midway between {' and '.join(place.joint.across)}"
        if place.estimate is not None and np.isnan(place.in_parent).any():
            two = f"{place.joint.parent} and {place.joint.child}"
            yield f"{place.joint.name}: no place in its parent: no frame has poses of both {two}"
    yield from joints.reasons()
    poseless = joints.without_pose.items()  # why a joint without any marker cannot be found is said above
    yield from (f"no pose of its own: {why}" for name, why in poseless if joints.markerset.segment(name).markers)


def _joint_row(place: JointPlace) -> list[str]:
    """A joint's texts, in the order of the titles."""
    n = accuracy_columns(place)
    moved = "-" if np.isnan(n["moved_least"]) else f"{n['moved_least']:.0f}°-{n['moved_most']:.0f}°"
    side = place.estimate.side if place.estimate else "-"
    return [
        *(place.joint.name, SHORT_TEXTS[place.status], side),
        *(millimetres(float(x)) for x in place.in_parent),
        f"> {1000 * _FAR:.0f}" if n["error"] > _FAR else millimetres(n["error"]),
        *(millimetres(n[key]) for key in ("floor", "sigma")),
        *(moved, number(n["rho"], ".3f")),
        *(number(n[key], ".0f") for key in ("frames", "worth")),
        millimetres(n["apart"]),
    ]


def millimetres(metres: float) -> str:
    """A length in millimetres, as it is printed."""
    return number(1000 * metres, ".1f")


METHODS = ("mgdk", "gdke", "ugdk", "mle", "two_sided")
_FEWEST_SAMPLES = 5
"""Fewest samples of a marker that other estimators fit."""


def agreement_table(joints: Calibration, recording: Recording) -> pd.DataFrame:
    """Tabulate the agreement of methods, a row per joint in the marker set's order.

    Args:
        joints: answer of phase 1.
        recording: that they were found in.

    Returns:
        Columns ``joint``; ``radii``: of each marker's sphere (metres), a list; ``cap`` (degrees): half-angle of the cap
        with 95 % of the samples, of the marker that moved most; ``turn`` (degrees): angle within which 95 % of the
        child's rotations in the parent lie; ``gap`` (metres): root mean square distance between the joint's images in
        both segments; ``from_mgdk, from_gdke, from_ugdk, from_mle, from_two_sided`` (metres): distances of their
        centres from the chosen one. NaN where there is none.
    """
    return pd.DataFrame([_row(place, joints, recording) for place in joints.joints])


def _row(place: JointPlace, joints: Calibration, recording: Recording) -> dict[str, object]:
    row: dict[str, object] = {"joint": place.joint.name, "radii": [], "cap": np.nan, "turn": np.nan, "gap": np.nan}
    parent, child = joints.poses.get(place.joint.parent), joints.poses.get(place.joint.child)
    if parent is not None and child is not None:
        row["turn"] = float(np.degrees(rotation_range(relative_rotation(parent.rotation, child.rotation))))
        apart = ((parent.to_world(place.in_parent) - child.to_world(place.in_child)) ** 2).sum(axis=0)
        if not np.isnan(apart).all():
            row["gap"] = float(np.sqrt(np.nanmean(apart)))
    row |= {f"from_{name}": np.nan for name in METHODS}
    if place.estimate is None:
        return row
    every = place.estimates
    pair = next((estimate for estimate in every if estimate.side == "both"), None)
    if pair is not None:
        row["from_two_sided"] = _distance(mean_difference(place.estimate, pair.poses.to_world(pair.center)))
    one = next((estimate for estimate in every if estimate.sphere is not None), None)
    if one is not None and one.sphere is not None:
        row["radii"] = one.sphere.radii.tolist()
        local = [one.poses.to_local(recording.of(name)) for name in one.markers]
        caps = [cap_angle(y, used, one.center) for y, used in zip(local, one.used, strict=True) if used.any()]
        row["cap"] = float(np.degrees(max(caps, default=np.nan)))
        points = [y[:, used].T for y, used in zip(local, one.used, strict=True) if used.sum() >= _FEWEST_SAMPLES]
        for name, center in _centers(points).items():
            row[f"from_{name}"] = _distance(mean_difference(place.estimate, one.poses.to_world(center)))
    return row


def _distance(vector: Floats) -> float:
    return float(np.linalg.norm(vector))


def _centers(points: list[Floats]) -> dict[str, Floats]:
    """Centres (3,) that the library's estimators fit to markers' samples (n, 3) in one segment's axes."""
    if not points:
        return {}
    together = mgdk(points)
    most = max(points, key=lambda y: float(np.trace(np.cov(y.T))))
    centers = {"mgdk": together.center, "gdke": fit(most, "gdke").center, "mle": fit(most, "mle").center}
    if together.noise_variance > 0.0:
        centers["ugdk"] = fit(most, "ugdk", noise=float(np.sqrt(together.noise_variance))).center
    return centers
