"""Recordings of an articulated body whose joints are known, on which estimators and skeletons are tested.

The body has fifteen rigid segments, the joints between them, and the markers of a set on them; its measures and axes
are described in ``body.toml``. Sides differ in a few markers that are placed unevenly. It moves at random within its
natural range; then come the artefacts of real recordings: skin that moves the markers, noise, swapped markers and gaps.
The truth stands in tables of its own.

What skin does to a joint's centre depends on what it moves with (theory §12): a displacement that is linear in the
joint's own angle moves the centre and leaves next to no residual, above all one that is common to a segment's markers.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pydantic
from scipy.spatial.transform import Rotation

from study.arrays import Bools, Floats, Ints
from study.fits.loops.random import stream
from study.recordings.recording import Recording, RecordingError
from study.recordings.rigid import rotation_vectors

Number = int | float
Triple = tuple[Number, Number, Number]
Interval = tuple[Number, Number]
MARKER_SETS = ("cmu41", "rizzoli")
"""Marker sets that the body can wear: 41 markers all over, or the landmarks of trunk and legs."""
_UNEVEN = {"RUPA": -0.110, "RFRM": -0.085, "RTHI": -0.110, "RSHN": -0.150}
"""z of the right side's markers that differ from the left's, in heights."""


@pydantic.dataclasses.dataclass(frozen=True)
class BodyPart:
    """A segment, its markers, and the joint to its parent; lengths in heights of the body."""

    name: str
    ranges: tuple[Interval, Interval, Interval]
    """Range of motion: least and greatest angle about y, x and z, degrees, in this order, about the rotated axes."""
    markers: dict[str, Triple]
    """Each marker in the segment's axes."""
    parent: str | None = None
    joint: str | None = None
    at: Triple = (0.0, 0.0, 0.0)
    """The joint in the parent's axes."""
    axis: Triple | None = None
    """Axis of a hinge in the parent's axes; the angle about y is the angle about it, and the other two do not count."""


@cache
def body(markerset: str = "cmu41") -> tuple[BodyPart, ...]:
    """All segments with the markers of one of `MARKER_SETS`, parents before children."""
    tables = tomllib.loads(Path(__file__).with_name("body.toml").read_text(encoding="utf-8"))
    parts = []
    for name, table in tables.items():
        worn = {known: table.pop(known, {}) for known in MARKER_SETS}
        parts.append(BodyPart(name=name, markers=worn[markerset], **table))
    return (*parts, *(_mirrored(part) for part in parts if part.name.startswith("left_")))


def _mirrored(part: BodyPart) -> BodyPart:
    """The segment of the right side: rotations about x and z change their sign, as do those components of an axis."""
    name, parent, joint = (text and text.replace("left_", "right_") for text in (part.name, part.parent, part.joint))
    places = {"R" + label[1:]: place for label, place in part.markers.items()}
    markers = {label: (x, -y, _UNEVEN.get(label, z)) for label, (x, y, z) in places.items()}
    about_y, *others = part.ranges
    about_x, about_z = ((-high, -low) for low, high in others)
    axis = part.axis and (-part.axis[0], part.axis[1], -part.axis[2])
    at = part.at[0], -part.at[1], part.at[2]
    return BodyPart(str(name), (about_y, about_x, about_z), markers, parent, joint, at, axis)


PARTS = body()
"""All segments with the 41 markers of CMU's set, parents before children."""
MARKERS: tuple[str, ...] = tuple(label for part in PARTS for label in part.markers)
JOINTS: tuple[str, ...] = tuple(part.joint for part in PARTS if part.joint)


def unit(axis: Triple) -> Floats:
    """A direction as a unit vector (3,)."""
    return np.array(axis) / float(np.linalg.norm(axis))


def nearest_pairs(parts: tuple[BodyPart, ...] = PARTS) -> list[tuple[str, str]]:
    """Each marker with the one nearest to it on the standing body, each pair once; these get swapped."""
    origins: dict[str | None, Floats] = {None: np.zeros(3)}
    for part in parts:
        origins[part.name] = origins[part.parent] + np.array(part.at)
    labels = [label for part in parts for label in part.markers]
    places = np.array([origins[part.name] + np.array(at) for part in parts for at in part.markers.values()])
    distance = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    pairs = {tuple(sorted((i, int(j)))) for i, j in enumerate(distance.argmin(axis=1))}
    return [(labels[i], labels[j]) for i, j in sorted(pairs)]


_LIMITS: dict[str, Interval] = {"frames": (2, 10**7), "rate": (1, 1e5), "seed": (0, 2**63), "noise": (0, 10)}
_LIMITS |= {"soft_tissue": (0, 10), "gaps": (0, 1), "swaps": (0, 1), "height": (0.1, 10), "reach": (0, 1)}
"""Least and greatest value of each number of a recipe."""
SKIN = ("mixed", "random", "angle", "velocity", "cluster", "slide")
"""Laws by which the skin moves the markers; see `skin_motion`."""


@dataclass(frozen=True)
class Recipe:
    """The settings of a synthetic recording: the options of `study synthetic`, whose help says more.

    Raises:
        RecordingError: if a number is outside of its limits, ``skin`` is no law, ``markers`` no set, or both
            ``independent`` and ``gait``.
    """

    frames: int = 3000
    rate: float = 120.0
    seed: int = 1
    noise: float = 0.001
    soft_tissue: float = 0.0
    skin: str = "mixed"
    gaps: float = 0.0
    swaps: float = 0.0
    height: float = 1.75
    reach: float = 1.0
    independent: bool = False
    gait: bool = False
    markers: str = "cmu41"

    def __post_init__(self) -> None:
        for name, (low, high) in _LIMITS.items():
            if not low <= (value := getattr(self, name)) <= high:
                raise RecordingError(f"{name} = {value:g} of a synthetic body must be from {low:g} to {high:g}")
        for name, known in (("skin", SKIN), ("markers", MARKER_SETS)):
            if (word := getattr(self, name)) not in known:
                raise RecordingError(f"{name} = {word} of a synthetic body must be one of {', '.join(known)}")
        if self.independent and self.gait:
            raise RecordingError("independent and gait of a synthetic body exclude each other; choose one")


_GAP = 0.2  # mean duration of a gap, seconds
_SWAP = 0.15  # mean duration of a swap, seconds


Swap = tuple[int, int, tuple[str, str]]
"""First frame in which the labels of two markers are exchanged, the first frame after that, and the two markers."""


def marker_noise(shape: tuple[int, ...], sigma: float, seed: int) -> Floats:
    """Draw isotropic normal noise with the standard deviation ``sigma`` of each coordinate, metres."""
    return sigma * stream(seed, "synthetic", "noise").standard_normal(shape)


def soft_tissue(phases: Floats, rate: float, amplitude: float, seed: int) -> Floats:
    """Draw the soft-tissue artefact of each marker: its displacement on its segment.

    Half of it follows the angle of the segment's joint, as skin does over a moving joint; half oscillates in time, as
    muscle and fat do. The directions of both are random and fixed for a marker.

    Args:
        phases: angle of the joint of each marker's segment, -1 to 1 over its range (markers, frames).
        rate: frames per second.
        amplitude: largest displacement, metres.
        seed: of directions and frequencies.

    Returns:
        Displacements in the segments' axes (markers, 3, frames), metres.
    """
    rng = stream(seed, "synthetic", "soft tissue")
    directions = rng.standard_normal((2, len(phases), 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    frequency, start = rng.uniform(0.5, 2.0, len(phases)), rng.uniform(0, 2 * np.pi, len(phases))
    time = np.arange(phases.shape[1]) / rate
    oscillation = np.sin(2 * np.pi * frequency[:, None] * time + start[:, None])
    courses = np.stack([phases, oscillation])
    return np.asarray(0.5 * amplitude * np.einsum("kmi,kmt->mit", directions, courses))


def gaps(markers: int, frames: int, rate: float, share: float, seed: int) -> Bools:
    """Draw the missing samples (markers, frames), in runs; each marker lacks the given share of frames, rounded."""
    rng = stream(seed, "synthetic", "gaps")
    mask = np.zeros((markers, frames), dtype=bool)
    for row in mask:
        for first, end in _runs(rng, frames, round(share * frames), _GAP * rate):
            row[first:end] = True
    return mask


def swapped_labels(pairs: Sequence[tuple[str, str]], frames: int, rate: float, share: float, seed: int) -> list[Swap]:
    """Draw swaps: in the given share of the frames one of the pairs is exchanged."""
    rng = stream(seed, "synthetic", "swaps")
    runs = _runs(rng, frames, round(share * frames), _SWAP * rate)
    return [(first, end, pairs[int(rng.integers(len(pairs)))]) for first, end in runs]


def _runs(rng: np.random.Generator, frames: int, count: int, mean: float) -> list[tuple[int, int]]:
    """Draw runs of frames: ``count`` frames in all, of the mean length ``mean``, at least one frame apart."""
    free = frames - count
    number = min(max(round(count / max(mean, 1.0)), 1), count, free + 1)
    if number == 0:
        return []
    inside = _lengths(rng, count, number)
    # the stretches before the first and after the last run may be empty, those between runs may not
    outside = _lengths(rng, free + 2, number + 1)
    firsts = np.cumsum(outside[:-1]) - 1 + np.concatenate([[0], np.cumsum(inside[:-1])])
    return [(int(first), int(first + length)) for first, length in zip(firsts, inside, strict=True)]


def _lengths(rng: np.random.Generator, total: int, parts: int) -> Ints:
    """Cut a whole number into parts of at least one, each way with the same probability."""
    cuts = np.sort(rng.choice(total - 1, parts - 1, replace=False)) + 1
    return np.diff(np.concatenate([[0], cuts, [total]]))


@dataclass(frozen=True, eq=False)
class BodyTruth:
    """True segment poses, joints and markers of a synthetic body.

    Lengths are in metres. The origin of a segment is the joint to its parent.
    """

    segments: tuple[str, ...]
    rotations: Floats
    """(segments, frames, 3, 3), from a segment's axes to the world's."""
    origins: Floats
    """(segments, 3, frames), in the world."""
    markers: tuple[str, ...]
    offsets: Floats
    """(markers, 3): each marker in its segment's axes, without soft-tissue artefact."""
    joints: tuple[str, ...]
    parents: tuple[str, ...]
    """Parent segment of each joint; the joint is fixed in it."""
    children: tuple[str, ...]
    """Child segment of each joint."""
    centers: Floats
    """(joints, 3, frames), in the world."""
    in_parent: Floats
    """(joints, 3): each joint in its parent's axes; in its child's axes it is the origin."""
    axes: Floats
    """(joints, 3): unit vectors along hinge axes, equal in the parent's and the child's axes; NaN for ball joints."""
    bones: dict[tuple[str, str], float]
    """Length of each bone: two joints of one segment, the one to its parent first."""
    swaps: tuple[Swap, ...]
    missing: Bools
    """(markers, frames)."""


def write_truth(truth: BodyTruth, path: str | Path) -> tuple[Path, Path]:
    """Write the truth about a synthetic body beside its recording.

    Args:
        truth: of the body.
        path: of the recording; its suffix is replaced.

    Returns:
        ``….joints.parquet``, a row per joint: names, kind, centre and axis in the parent's axes, and the bone that ends
        there; ``….truth.parquet``, a row per frame and joint: the centre in the world and the rotation vector of the
        child segment. Metres and radians.

    Raises:
        RecordingError: if they cannot be written.
    """
    bones = dict.fromkeys(truth.joints, ("", np.nan)) | {end: (start, d) for (start, end), d in truth.bones.items()}
    joints: dict[str, object] = {"joint": truth.joints, "parent": truth.parents, "child": truth.children}
    joints |= {"kind": ["ball" if np.isnan(axis[0]) else "hinge" for axis in truth.axes]}
    joints |= {f"center_{axis}": truth.in_parent[:, i] for i, axis in enumerate("xyz")}
    joints |= {f"axis_{axis}": truth.axes[:, i] for i, axis in enumerate("xyz")}
    joints |= {f"bone_{key}": [bones[joint][i] for joint in truth.joints] for i, key in enumerate(("from", "length"))}
    count, _, frames = truth.centers.shape
    children = [truth.segments.index(child) for child in truth.children]
    vectors = Rotation.from_matrix(truth.rotations[children].reshape(-1, 3, 3)).as_rotvec()
    poses = {"frame": np.tile(np.arange(1, frames + 1), count), "joint": np.repeat(truth.joints, frames)}
    poses |= {f"center_{axis}": truth.centers[:, i].ravel() for i, axis in enumerate("xyz")}
    poses |= {f"turn_{axis}": vectors[:, i] for i, axis in enumerate("xyz")}
    path = Path(path)
    out = path.with_suffix(".joints.parquet"), path.with_suffix(".truth.parquet")
    try:
        for columns, target in zip((joints, poses), out, strict=True):
            pq.write_table(pa.table(columns), target, compression="zstd")
    except OSError as error:
        raise RecordingError(f"{path.parent}: cannot be written: {error.strerror or error}") from None
    return out


_WEIGHTS = np.array([0.5, 0.3, 0.2])  # of three sinusoids; their sum is 1, so that no angle leaves its range
_SLOW, _FAST = 0.1, 0.7  # hertz: periods of 1.4 to 10 seconds
_STRIDE = np.array([0.6, 0.18, 0.07])  # of a stride and its harmonics, in gait; the rest of the course is smooth
_STRIDES = 0.8, 1.1  # hertz
_GAIT = np.array([0.5, 0.3, 0.3])  # share of the range of motion about y, x and z that gait uses, near standing
_ROOM = np.array([1.2, 1.2, 0.12])  # metres: largest excursion of the pelvis to either side

Style = Literal["smooth", "independent", "gait"]
"""Smooth courses; each frame drawn anew, with angles uniform over their ranges; or strides of a part of the range."""


def draw_motion(
    frames: int, rate: float, seed: int, *, height: float, reach: float, style: Style
) -> tuple[Floats, Floats, Floats]:
    """Draw a motion of the body.

    Args:
        frames: number of frames.
        rate: frames per second.
        seed: of the motion; each angle has a stream of its own.
        height: of the body, metres.
        reach: share of each joint's natural range of motion, about its middle; 0 for a stiff body.
        style: of the courses in time.

    Returns:
        Rotations (segments, frames, 3, 3), from each segment's axes to the world's; origins (segments, 3, frames),
        metres; and phases (segments, frames), the angle about y of the joint to the parent, -1 to 1 over its range.
    """
    rotations, origins = np.empty((len(PARTS), frames, 3, 3)), np.empty((len(PARTS), 3, frames))
    phases, row = np.empty((len(PARTS), frames)), {part.name: i for i, part in enumerate(PARTS)}
    for i, part in enumerate(PARTS):
        courses = np.array([_course(frames, rate, style, seed, part.name, a) for a in "yxz"])
        phases[i] = courses[0]
        low, high = np.radians(np.array(part.ranges)).T[:, :, None]
        middle, half = (low + high) / 2, reach * (high - low) / 2
        if style == "gait":
            half = _GAIT[:, None] * half
            middle = np.clip(0.0, low + half, high - half)
        angles = middle + half * courses
        if part.parent is None:  # heading first, then lean, so that the lean does not depend on the heading
            wander = np.array([_course(frames, rate, style, seed, part.name, f"to {a}") for a in "xyz"])
            rotations[i] = Rotation.from_euler("ZYX", angles[[2, 0, 1]].T).as_matrix()
            origins[i] = wander * _ROOM[:, None] + np.array([[0.0], [0.0], [0.53 * height]])
            continue
        turns = Rotation.from_euler("YXZ", angles.T)
        if part.axis is not None:
            turns = Rotation.from_rotvec(angles[0][:, None] * unit(part.axis))
        parent = row[part.parent]
        rotations[i] = rotations[parent] @ turns.as_matrix()
        origins[i] = origins[parent] + rotations[parent].dot(height * np.array(part.at)).T
    return rotations, origins, phases


def _course(frames: int, rate: float, style: Style, seed: int, *name: str) -> Floats:
    """Draw a random course between -1 and 1 (frames,) from the stream of this name."""
    rng = stream(seed, "synthetic", "motion", *name)
    if style == "independent":
        return rng.uniform(-1, 1, frames)
    frequency = np.exp(rng.uniform(np.log(_SLOW), np.log(_FAST), len(_WEIGHTS)))
    start = rng.uniform(0, 2 * np.pi, len(_WEIGHTS))
    time = np.arange(frames) / rate
    course: Floats = _WEIGHTS @ np.sin(2 * np.pi * frequency[:, None] * time + start[:, None])
    if style == "gait":  # strides of one rate in the whole body, and a smooth course that tells one from the next
        stride = stream(seed, "synthetic", "motion", "stride").uniform(*_STRIDES)
        harmonics = stride * np.arange(1, 1 + len(_STRIDE))
        start = stream(seed, "synthetic", "motion", "strides", *name).uniform(0, 2 * np.pi, len(_STRIDE))
        course = (1 - _STRIDE.sum()) * course + _STRIDE @ np.sin(2 * np.pi * harmonics[:, None] * time + start[:, None])
    return course


_SIGNS = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], dtype=float).T


def skin_motion(recipe: Recipe, rotations: Floats, phases: Floats, segment_of: Ints) -> Floats:
    """Draw the displacement of each marker on its segment by the recipe's law, largest at its ``soft_tissue``.

    The laws are ``mixed`` (see `soft_tissue`); ``random``: smooth in time, independent of the motion; ``angle``: linear
    in the rotation vector of the segment's joint, each marker in its own way; ``velocity``: the same with its rate of
    change; ``cluster``: linear in the rotation vector, equal for all markers of a segment; ``slide``: only markers over
    a joint move, such as those on trochanter and epicondyles (see `_sliding`). The pelvis has no joint to a parent; its
    skin follows the waist.

    Args:
        recipe: its ``skin``, ``soft_tissue``, ``rate``, ``seed`` and ``markers``.
        rotations: of the segments (segments, frames, 3, 3).
        phases: of their joints (segments, frames); both as `draw_motion` returns them.
        segment_of: number of each marker's segment (markers,).

    Returns:
        Displacements in the segments' axes (markers, 3, frames), metres.
    """
    joint_of, size = np.where(segment_of == 0, 1, segment_of), recipe.soft_tissue
    if recipe.skin == "mixed":
        return soft_tissue(phases[joint_of], recipe.rate, size, recipe.seed)
    if recipe.skin == "random":  # three oscillations of 0.2 to 2 hertz along random directions
        rng, count = stream(recipe.seed, "synthetic", "skin", "random"), len(segment_of)
        frequency = np.exp(rng.uniform(np.log(0.2), np.log(2.0), (3, count, 1)))
        cycles = frequency * np.arange(phases.shape[1]) / recipe.rate + rng.uniform(size=(3, count, 1))
        directions = rng.standard_normal((3, count, 3))
        directions /= 3.0 * np.linalg.norm(directions, axis=2, keepdims=True)
        return np.asarray(size * np.einsum("kmi,kmt->mit", directions, np.sin(2 * np.pi * cycles)))
    vectors = _rotation_vectors(rotations)
    if recipe.skin == "slide":
        return size * _sliding(body(recipe.markers), vectors, recipe.seed)
    tensors = _tensors(segment_of if recipe.skin == "cluster" else np.arange(len(segment_of)), recipe.seed)
    drive = np.gradient(vectors, 1.0 / recipe.rate, axis=2) if recipe.skin == "velocity" else vectors
    drive = drive / np.maximum(np.abs(drive).max(axis=(1, 2), keepdims=True), 1e-300)
    return np.asarray(size * np.einsum("mik,mkt->mit", tensors, drive[joint_of]))


def _tensors(clusters: Ints, seed: int) -> Floats:
    """Random tensors (markers, 3, 3), equal within a cluster, that take vectors in the cube of side 2 to at most 1."""
    drawn = stream(seed, "synthetic", "skin", "tensors").standard_normal((clusters.max() + 1, 3, 3))[clusters]
    return np.asarray(drawn / np.linalg.norm(drawn @ _SIGNS, axis=1).max(axis=1)[:, None, None])


def _rotation_vectors(rotations: Floats) -> Floats:
    """Rotation vectors of each segment in its parent's axes, about the mean rotation (segments, 3, frames)."""
    rows = {part.name: i for i, part in enumerate(PARTS)}
    vectors = np.zeros((len(PARTS), 3, rotations.shape[1]))
    for i, part in enumerate(PARTS):
        if part.parent is not None:
            relative = np.swapaxes(rotations[rows[part.parent]], 1, 2) @ rotations[i]
            vectors[i] = rotation_vectors(np.moveaxis(relative, 0, 2))
    return vectors


_OVER = 0.045
"""A marker is over a joint if it is as near to it on the standing body, in heights of the body."""


def _sliding(parts: Sequence[BodyPart], vectors: Floats, seed: int) -> Floats:
    """Displacements of markers over joints (markers, 3, frames), linear in the rotation vectors (segments, 3, frames).

    A marker over the joint of its own segment slides with that joint; one over the next joint, half with that one, half
    with its own segment's. Each reaches 1; all other markers stay.
    """
    shares = []
    for number, part in enumerate(parts):
        ends = [i for i, other in enumerate(parts) if other.parent == part.name]
        for place in part.markers.values():
            share = np.zeros(len(parts))
            near = [i for i in ends if np.linalg.norm(np.subtract(place, parts[i].at)) <= _OVER]
            if part.joint and (near or np.linalg.norm(place) <= _OVER):
                share[number] = 1.0
            if near:
                share[near[0]] = 1.0
            shares.append(share / max(share.sum(), 1.0))
    weights = np.array(shares)
    tensors = _tensors(np.arange(weights.size), seed).reshape(*weights.shape, 3, 3)
    slid = np.einsum("ms,msik,skt->mit", weights, tensors, vectors)
    return np.asarray(slid / np.maximum(np.linalg.norm(slid, axis=1).max(axis=1), 1e-300)[:, None, None])


def synthesize(recipe: Recipe | None = None) -> tuple[Recording, BodyTruth]:
    """Make a recording and the truth about it.

    Motion, noise, soft-tissue artefact, gaps and swaps are drawn from streams of their own: a change of one leaves the
    others as they are, and the same recipe gives the same bytes.

    Args:
        recipe: the settings; their defaults if None.
    """
    r = recipe or Recipe()
    style: Style = "independent" if r.independent else "gait" if r.gait else "smooth"
    rotations, origins, phases = draw_motion(r.frames, r.rate, r.seed, height=r.height, reach=r.reach, style=style)
    parts = body(r.markers)
    markers = tuple(label for part in parts for label in part.markers)
    segment_of = np.array([i for i, part in enumerate(parts) for _ in part.markers])
    offsets = r.height * np.array([place for part in parts for place in part.markers.values()])
    local = offsets[:, :, None] + skin_motion(r, rotations, phases, segment_of)
    positions = np.empty((len(markers), 3, r.frames))
    for row, segment in enumerate(segment_of):
        positions[row] = np.einsum("tij,jt->it", rotations[segment], local[row]) + origins[segment]
    positions += marker_noise(positions.shape, r.noise, r.seed)
    swaps = swapped_labels(nearest_pairs(parts), r.frames, r.rate, r.swaps, r.seed)
    for first, end, both in swaps:
        pair = [markers.index(marker) for marker in both]
        positions[pair, :, first:end] = positions[pair[::-1], :, first:end]
    missing = gaps(len(markers), r.frames, r.rate, r.gaps, r.seed)
    positions[np.broadcast_to(missing[:, None], positions.shape)] = np.nan
    recording = Recording(f"synthetic-{r.seed}", markers, positions, r.rate)
    children = [i for i, part in enumerate(PARTS) if part.joint]
    moving, joint_of = [PARTS[i] for i in children], {part.name: part.joint for part in PARTS}
    parents, in_parent = tuple(str(part.parent) for part in moving), r.height * np.array([part.at for part in moving])
    axes = np.array([np.full(3, np.nan) if part.axis is None else unit(part.axis) for part in moving])
    lengths = zip(parents, JOINTS, np.linalg.norm(in_parent, axis=1), strict=True)
    bones = {(one, joint): float(far) for parent, joint, far in lengths if (one := joint_of[parent]) is not None}
    segments, names = tuple(joint_of), tuple(part.name for part in moving)
    centers = origins[children]
    of_joints = JOINTS, parents, names, centers, in_parent, axes, bones
    return recording, BodyTruth(segments, rotations, origins, markers, offsets, *of_joints, tuple(swaps), missing)
