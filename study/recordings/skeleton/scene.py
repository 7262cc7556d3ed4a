"""The scene: a moving skeleton as every picture shows it - figure, video and viewer.

It holds plain arrays in metres, z up, and nothing of the fits: `make_scene` makes it of joints over time, with the
principal directions of their errors. It is also laid out as tables - joints in every frame, lengths of bones -, as
lines, and as data for other programs.

Bones are the lines between joints and ends of limbs that are fixed in one segment. Files do not say which way is up,
but a body's parts are above one another: the rotation that makes z point up follows from that.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from study.arrays import Bytes, Floats
from study.recordings.joints.estimate import ANATOMICAL, SHORT_TEXTS, USABLE
from study.recordings.joints.find import Calibration, JointPlace
from study.recordings.markersets import Joint, MarkerSet, is_output, landmarks, mirrored, side
from study.recordings.recording import Recording, RecordingError
from study.recordings.rigid import quaternions
from study.recordings.skeleton.calibrate import UNEVEN, gap_doubt, hull_distances, hull_doubt
from study.recordings.skeleton.draw import LARGEST_ERROR, Flag, Skeleton
from study.text import columns, number


def bones(fixed: Sequence[Sequence[int]], points: Floats, sides: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Choose the lines that show segments as bones.

    Two points in one segment make a bone and three a triangle, as in a pelvis. Of four or more, as in a chest, one is
    linked with all others: the one nearest to them, of those on neither side of the body if there are any.

    Args:
        fixed: for each segment, the numbers of the joints and ends of limbs that are fixed in it.
        points: their places (points, 3, frames), metres.
        sides: side of each point, "left", "right" or "".

    Returns:
        Pairs of numbers, each once.
    """
    chosen: dict[tuple[int, int], None] = {}
    for group in fixed:
        pairs = list(itertools.combinations(group, 2))
        if len(group) > 3:
            # sums of the median distances to the others, large for a point that is never known
            apart = np.linalg.norm(points[list(group), None] - points[None, list(group)], axis=2)
            apart[np.isnan(apart).all(axis=2)] = 1e3
            total = dict(zip(group, np.nanmedian(apart, axis=2).sum(axis=1), strict=True))
            middle = min(group, key=lambda i: (sides[i] != "", total[i]))
            pairs = [(middle, other) for other in group if other != middle]
        chosen |= dict.fromkeys(pairs)
    return tuple(chosen)


@dataclass(frozen=True, eq=False)
class Scene:
    """A skeleton with its markers over time.

    Attributes:
        name: of the recording.
        source: origin of the joints, in words.
        rate: frames per second.
        markers: their labels.
        places: of the markers (markers, 3, frames), NaN where missing.
        joints: their names.
        centers: of the joints (joints, 3, frames), NaN where unknown.
        tips: names of the ends of limbs, which are no joints.
        ends: places of the tips (tips, 3, frames).
        bones: pairs of numbers of points: joints first, then tips.
        flags: `Flag` of each joint in each frame (joints, frames).
        doubts: reason to doubt each joint, or "".
        errors: standard errors of the joints along their principal directions (joints, 3), metres; NaN for a direction
            in which a joint is not known, such as the axis of a hinge.
        posed: variances along x, y and z that the frame adds to the error of each joint (joints, 3, frames), m².
        gaps: root mean square distance between each joint in its child and in its parent (joints,), metres; NaN if no
            frame shows both.
        orientations: of the principal directions, as quaternions x, y, z, w (joints, frames, 4); NaN where unknown.
        notes: remarks for the viewer.
        roots: for each segment with anatomical axes and no joint above, such as the pelvis, the numbers of the joints
            in whose middle its axes are drawn.
        anatomy: orientations of the anatomical axes of the segments that rotate about the joints, then of the roots
            (joints and roots, frames, 4); NaN where there are none.
    """

    name: str
    source: str
    rate: float
    markers: tuple[str, ...]
    places: Floats
    joints: tuple[str, ...]
    centers: Floats
    tips: tuple[str, ...]
    ends: Floats
    bones: tuple[tuple[int, int], ...]
    flags: Bytes
    doubts: tuple[str, ...]
    errors: Floats
    posed: Floats
    gaps: Floats
    orientations: Floats
    notes: tuple[str, ...]
    roots: tuple[tuple[int, ...], ...]
    anatomy: Floats

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.centers.shape[2])

    @property
    def points(self) -> Floats:
        """Joints, then tips (points, 3, frames)."""
        return np.concatenate([self.centers, self.ends])

    @property
    def floor(self) -> float:
        """Height of the floor, metres: just below the lowest markers, or the lowest points if there are no markers."""
        heights = self.places[:, 2] if len(self.markers) else self.points[:, 2]
        return float(np.nanquantile(np.fmin.reduce(heights, axis=0), 0.02)) - 0.02

    def at_most(self, rate: float) -> "Scene":
        """The scene with every second, third, ... frame, for at most this many frames per second."""
        step = max(int(np.ceil(self.rate / rate - 1e-9)), 1)
        return self if step == 1 else self.part(slice(None, None, step), self.rate / step)

    def part(self, frames: slice, rate: float | None = None) -> "Scene":
        """The scene in some of the frames; at ``rate`` frames per second, if that changes."""
        cut = {name: getattr(self, name)[..., frames] for name in ("places", "centers", "ends", "flags", "posed")}
        cut |= {name: getattr(self, name)[:, frames] for name in ("orientations", "anatomy")}
        return replace(self, rate=rate or self.rate, **cut)

    def sides(self) -> tuple[str, ...]:
        """Side of each point: "left", "right" or ""."""
        return tuple(map(side, (*self.joints, *self.tips)))


_FEET = ("heel", "toe", "malleolus", "metatarsal")
"""Words in the names of points that are below all others."""


def up_of(recording: Recording) -> tuple[Floats, str]:
    """Rotation (3, 3) after which z points up, and the words that say how that is known.

    Up is the direction along y or z of the recording in which the pelvis' spines, or else all other labelled markers,
    are above the feet's, in the median of the frames. Without labels of feet it is z, or y if the labelled markers'
    mean places extend along it by a third more. What a program computed, and points without a label, do not count.
    """
    labels = [m for m in recording.markers if not (m.startswith(("*", "point ")) or m.isdigit() or is_output(m))]
    points = {point: label for point, label in landmarks(recording.markers).items() if label in labels}
    feet = [label for point, label in points.items() if point.endswith(_FEET)]
    high = [label for point, label in points.items() if point.endswith(("asis", "psis", "sacrum"))]
    high = high or [label for label in labels if label not in points.values()]
    if feet and high:
        above, below = (known_mean(np.array([recording.of(m) for m in names]), axis=0) for names in (high, feet))
        apart = (above - below)[:, ~np.isnan(above - below)[0]]
        if apart.size:
            up = np.median(apart, axis=1)
            axis = 1 + int(np.abs(up[1:]).argmax())
            name = "-" * bool(up[axis] < 0.0) + "xyz"[axis]
            words = f"up is {name} of the recording, in which {high[0]} is above {feet[0]}"
            return _to_z(axis, up[axis] < 0.0), words
    labels = labels or list(recording.markers)
    positions = np.array([recording.of(label) for label in labels])
    # a body that rotates about the vertical has little mean extent to the sides; that from foot to head stays
    mean = known_mean(positions - known_mean(positions, axis=0), axis=2)
    _, y, z = np.nanstd(mean[~np.isnan(mean[:, 0])], axis=0)
    axis = 1 if y > _Y_UP * z else 2
    words = f"up is {'xyz'[axis]} of the recording, along which the markers extend; no label is a foot's"
    return _to_z(axis, False), words


_Y_UP = 1.3
"""Without labels of feet y points up if the markers' mean places extend along it by this factor more than along z."""


def _to_z(axis: int, downwards: bool) -> Floats:
    """Rotation (3, 3) of an axis of the recording, or its opposite, to z."""
    rotation = np.roll(np.eye(3), axis - 2, axis=1)
    return np.diag([-1.0, 1.0, -1.0]) @ rotation if downwards else rotation


def known_mean(x: Floats, axis: int) -> Floats:
    """Mean of the values that are not NaN; NaN where there are none."""
    known = ~np.isnan(x)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(known, x, 0.0).sum(axis=axis) / known.sum(axis=axis))


TIP = 0.7
"""A limb ends in the middle of its markers that are at least this share of the farthest one's distance away."""


def make_scene(
    skeleton: Skeleton, recording: Recording, doubts: Sequence[str], source: str, notes: Sequence[str] = ()
) -> Scene:
    """Make a scene.

    Args:
        skeleton: joints over time; one that is known in no frame is left out, with a note.
        recording: markers over time; those of the skeleton's marker set are looked up in it.
        doubts: reason to doubt each joint, or "".
        source: origin of the joints, in words.
        notes: remarks for the viewer.

    Raises:
        RecordingError: if no joint is known in any frame.
    """
    calibration, upright = skeleton.calibration, up_of(recording)[0]
    joints, segments = calibration.joints, calibration.markerset.segments
    known = [i for i, center in enumerate(skeleton.centers) if not np.isnan(center).all()]
    lost = [(joints[i], doubts[i]) for i in range(len(joints)) if i not in known]
    notes = [*notes]
    for place, doubt in lost:
        large = f"± {1000 * place.standard_error:.0f} mm (see --largest-error); "
        words = large * (place.standard_error > LARGEST_ERROR) + (doubt or "known in no frame")
        notes.append(f"{place.joint.name} is not shown: {words}")
    rejected = [
        f"{share:.1%} of {name}" for name, share in zip(skeleton.segments, skeleton.left_out, strict=True) if share
    ]
    notes += [f"samples left out, as far from their places: {', '.join(rejected)}"] * bool(rejected)
    if not known:
        raise RecordingError(f"{recording.name}: none of its joints is known in any frame; there is nothing to show")
    centers, shown = skeleton.centers[known], [joints[i] for i in known]
    names = tuple(place.joint.name for place in shown)
    ends = _ends(recording, calibration.markerset, [place.joint for place in shown], centers)
    points = np.concatenate([centers, *(end[None] for end in ends.values())])
    axes = {shape.segment: shape.anatomy for shape in calibration.shapes}
    fixed, roots = [], {}
    for segment in segments:
        below = [i for i, place in enumerate(shown) if place.joint.parent == segment.name]
        own = [i for i, place in enumerate(shown) if segment.name in (place.joint.parent, place.joint.child)]
        fixed.append(own + [len(known) + i for i, name in enumerate(ends) if name == segment.name])
        if segment.parent is None and below and not np.isnan(axes[segment.name]).any():
            roots[segment.name] = tuple(i for i in below if side(names[i])) or tuple(below)
    errors, directions = zip(*map(_principal_directions, shown), strict=True)
    parents = [(place.joint.parent, columns) for place, columns in zip(shown, directions, strict=True)]
    turning = [(name, axes[name]) for name in (*(place.joint.child for place in shown), *roots)]
    return Scene(
        name=recording.name,
        source=source,
        rate=recording.rate,
        markers=recording.markers,
        places=upright @ recording.positions,
        joints=names,
        centers=upright @ centers,
        tips=tuple(ends),
        ends=upright @ points[len(known) :],
        bones=bones(fixed, points, [*map(side, (*names, *ends))]),
        flags=np.where(np.isnan(centers[:, 0]), np.uint8(Flag.UNKNOWN), skeleton.flags[known]),
        doubts=tuple(doubts[i] for i in known),
        errors=np.stack(errors),
        posed=upright**2 @ skeleton.posed[known],
        gaps=skeleton.gaps[known],
        orientations=_orientations(upright, skeleton, parents),
        notes=tuple(notes),
        roots=tuple(roots.values()),
        anatomy=_orientations(upright, skeleton, turning),
    )


def _ends(recording: Recording, markerset: MarkerSet, joints: Sequence[Joint], centers: Floats) -> dict[str, Floats]:
    """Ends of limbs (3, frames), by segment: of segments that rotate about a joint and carry none."""
    inner = {joint.parent for joint in joints}
    ends = {}
    for joint, center in zip(joints, centers, strict=True):
        names = [marker for marker in markerset.segment(joint.child).markers if marker in recording.markers]
        if joint.child in inner or not names:
            continue
        places = np.stack([recording.of(name) for name in names])
        away = np.linalg.norm(places - center, axis=1)
        far = np.array([np.nanmedian(row) if not np.isnan(row).all() else 0.0 for row in away])
        ends[joint.child] = np.asarray(places[far >= TIP * far.max()].mean(axis=0))
    return ends


def _principal_directions(joint: JointPlace) -> tuple[Floats, Floats]:
    """Standard errors (3,) along principal directions, and these as columns (3, 3), right-handed; the axis last."""
    if np.isnan(joint.covariance).any():
        return np.full(3, np.nan), np.eye(3)
    axis = np.empty((0, 3)) if joint.axis is None else joint.axis[None] / np.linalg.norm(joint.axis)
    across = np.linalg.svd(axis)[2][len(axis) :] if len(axis) else np.eye(3)  # directions as rows
    values, vectors = np.linalg.eigh(across @ joint.covariance @ across.T)
    errors = np.concatenate([np.sqrt(np.maximum(values, 0.0))[::-1], np.full(len(axis), np.nan)])
    directions = np.concatenate([vectors.T[::-1] @ across, axis]).T
    directions[:, 1] *= np.sign(np.linalg.det(directions))
    return errors, directions


def _orientations(upright: Floats, skeleton: Skeleton, fixed: Sequence[tuple[str, Floats]]) -> Floats:
    """Quaternions x, y, z, w (n, frames, 4) of axes fixed in n segments, in the upright world.

    Their signs do not jump.
    """
    result = np.full((len(fixed), skeleton.frames, 4), np.nan)
    for row, (name, axes) in zip(result, fixed, strict=True):
        rotation = skeleton.rotation(name)
        known = ~np.isnan(rotation[0, 0])
        if known.any() and not np.isnan(axes).any():
            row[known] = quaternions(np.einsum("ij,jkt,kl->til", upright, rotation[:, :, known], axes))
    return result


def skeleton_table(scene: Scene) -> pd.DataFrame:
    """Tabulate joints, a row per frame and joint.

    Returns:
        Columns: frame, from 1; time, seconds; joint; x, y, z, metres, z up; known: "seen", "bridged" or "unknown";
        error_x, error_y, error_z, standard errors of the place along x, y and z in this frame, metres (see
        `frame_errors`).
    """
    errors, count, frames = frame_errors(scene), len(scene.joints), scene.frames
    words = np.array([flag.name.lower() for flag in Flag])
    columns: dict[str, object] = {"frame": np.repeat(np.arange(1, frames + 1), count)}
    columns |= {"time": np.repeat(np.arange(frames) / scene.rate, count)}
    columns |= {"joint": np.tile(np.array(scene.joints), frames)}
    columns |= {axis: scene.centers[:, i].T.ravel() for i, axis in enumerate("xyz")}
    columns |= {"known": words[scene.flags.T.ravel()]}
    return pd.DataFrame(columns | {f"error_{axis}": errors[:, i].T.ravel() for i, axis in enumerate("xyz")})


def frame_errors(scene: Scene) -> Floats:
    """Standard errors of the joints along the world's axes in each frame (joints, 3, frames), metres.

    They are those of the joint's place in its parent, rotated with the parent; of a hinge, of the part across its axis.
    Each frame adds the error of the parent's pose, of the joint's gap, and of interpolation. NaN where the joint is
    unknown, or its error is.
    """
    errors = np.full(scene.centers.shape, np.nan)
    squares = np.nan_to_num(scene.errors) ** 2
    for joint, (turns, flags) in enumerate(zip(scene.orientations, scene.flags, strict=True)):
        if np.isnan(scene.errors[joint]).all():
            continue
        known, turned = flags != Flag.UNKNOWN, ~np.isnan(turns[:, 0])
        variance = np.full((3, len(flags)), squares[joint].max())  # of a joint that its child alone shows, the largest
        if (known & turned).any():
            axes = Rotation.from_quat(turns[known & turned]).as_matrix()
            variance[:, known & turned] = (axes**2 @ squares[joint]).T
        errors[joint][:, known] = np.sqrt(variance + scene.posed[joint])[:, known]
    return errors


def bone_table(scene: Scene) -> pd.DataFrame:
    """Tabulate bones, a row per bone between two joints.

    Returns:
        Columns: start, end; length, its median over time, and spread, its standard deviation (metres); error, upper
        bound of the length's standard error from those of its joints (metres); uneven, difference from the other
        side's length, relative to their mean; NaN where there is no other side.
    """
    worst = np.fmax.reduce(scene.errors, axis=1)
    rows = []
    for i, j in scene.bones:
        if max(i, j) >= len(scene.joints):
            continue
        length = np.linalg.norm(scene.centers[i] - scene.centers[j], axis=0)
        length = length[~np.isnan(length)]
        if len(length):
            error = float(np.hypot(worst[i], worst[j]))
            rows.append((scene.joints[i], scene.joints[j], np.median(length), length.std(), error))
    table = pd.DataFrame(rows, columns=["start", "end", "length", "spread", "error"])
    pairs = [frozenset(pair) for pair in zip(table["start"], table["end"], strict=True)]
    lengths = dict(zip(pairs, table["length"], strict=True))
    across = [frozenset(map(mirrored, pair)) for pair in pairs]
    other = [lengths.get(b, np.nan) if a != b else np.nan for a, b in zip(pairs, across, strict=True)]
    table["uneven"] = (table["length"] - other) / (0.5 * (table["length"] + other))
    return table


_LEFT_OUT = 0.05
"""Share of a segment's samples that are left out above which its joints are doubted."""


def skeleton_lines(scene: Scene, calibration: Calibration) -> Iterator[str]:
    """Lay out the joints, a line each, and the reasons to doubt some of them, then the bones and the notes."""
    places, kinds = {place.joint.name: place for place in calibration.joints}, defaultdict(list)
    rows = []
    for k, (name, share, by) in enumerate(zip(scene.joints, *hull_distances(scene.places, scene.centers), strict=True)):
        place, lacking = places[name], [(scene.flags[k] == flag).mean() for flag in (Flag.BRIDGED, Flag.UNKNOWN)]
        lengths = map(_millimetres, (place.standard_error, place.floor))
        row = [name, SHORT_TEXTS[place.status], *lengths, number(share, ".0%"), _millimetres(by) if by > 0.0 else "-"]
        rows.append([*row, _millimetres(scene.gaps[k]), *(f"{part:.1%}" if part else "-" for part in lacking)])
        if place.status in ANATOMICAL:
            kinds[place.reason].append(name)
    titles = ["joint", "status", "error", "floor", "outside", "by", "gap", "bridged", "unknown"]
    yield from columns(rows, titles, "<<>")
    yield "outside: share of frames outside the markers' hull; by: 95 % quantile of the distance outside it"
    yield "gap: distance between the joint in its child and in its parent, root mean square; bones vary by it"
    yield "bridged: share of frames without the segments' own markers; unknown: share in which nothing shows it"
    doubts = defaultdict(list)  # each reason once, with the joints that it holds for
    for name, doubt in zip(scene.joints, scene.doubts, strict=True):
        doubts[doubt].append(name)
    yield from (f"{', '.join(names)}: not reliable: {doubt}" for doubt, names in doubts.items() if doubt)
    yield from (f"{', '.join(names)}: {kind}" for kind, names in kinds.items())
    bones = []
    for start, end, length, spread, error, uneven in bone_table(scene).itertuples(index=False):
        difference = "" if np.isnan(uneven) else f"{round(100 * uneven, 1) + 0.0:+.1f} %"  # no minus before zero
        sizes = f"{length:.3f} m", _millimetres(error), _millimetres(spread)
        bones.append([f"{start} - {end}", *sizes, difference, "uneven" if abs(uneven) > UNEVEN else ""])
    yield from columns(bones, ["bone", "length", "error", "varies", "left to right"], "<>>>><")
    yield from (f"note: {note}" for note in scene.notes)


def _millimetres(metres: float) -> str:
    return "-" if np.isnan(metres) else f"{1000 * metres:.1f} mm"


def skeleton_data(scene: Scene) -> dict[str, object]:
    """Describe a skeleton.

    Returns:
        ``recording``, ``rate``, ``frames``, ``source`` of the joints; ``joints``, each with ``joint``, ``doubt`` (a
        reason, or null), ``error`` (its largest standard error, metres), the shares of the frames in which it is
        ``seen``, ``bridged``, ``unknown`` and ``outside`` of the markers' hull, ``distance`` outside it, metres, and
        ``gap``, metres;
        ``bones``, as in `bone_table`; ``notes``.
    """
    worst, joints = np.fmax.reduce(scene.errors, axis=1), []
    hulls = hull_distances(scene.places, scene.centers)
    parts = scene.joints, scene.doubts, worst, scene.flags, *hulls, scene.gaps
    for name, doubt, error, flags, *rest in zip(*parts, strict=True):
        row = {"joint": name, "doubt": doubt or None, "error": error}
        row |= {flag.name.lower(): (flags == flag).mean() for flag in Flag}
        joints.append(row | dict(zip(("outside", "distance", "gap"), rest, strict=True)))
    head = {"recording": scene.name, "rate": scene.rate, "frames": scene.frames, "source": scene.source}
    return head | {"joints": joints, "bones": bone_table(scene).to_dict("records"), "notes": scene.notes}


def skeleton_scene(skeleton: Skeleton, recording: Recording, notes: Sequence[str] = ()) -> Scene:
    """Make the scene of a skeleton.

    Joints that are not reliable carry the reason, those far outside the markers' hull among them.

    Args:
        skeleton: of phase 2.
        recording: that it was drawn from.
        notes: further remarks for the viewer, such as what is overruled (see `require_same_subject`).

    Raises:
        RecordingError: if none of its joints is known in any frame.
    """
    calibration = skeleton.calibration
    found = "this recording" if calibration.source == skeleton.name else calibration.source
    doubts, left_out = [], dict(zip(skeleton.segments, skeleton.left_out, strict=True))
    hulls = hull_distances(recording.positions, skeleton.centers)
    for place, gap, *hull in zip(calibration.joints, skeleton.gaps, *hulls, strict=True):
        kind = place.status in (*USABLE, *ANATOMICAL)  # by motion, or by points of the body: no doubt
        reasons = [
            "" if kind else place.reason,
            hull_doubt(*hull),
            skeleton.barred_at(place.joint)[1] or gap_doubt(gap),
        ]
        for segment in (place.joint.parent, place.joint.child):
            if left_out[segment] > _LEFT_OUT:
                reasons.append(f"{left_out[segment]:.0%} of the samples of {segment} are far from their places")
        doubts.append("; ".join(filter(None, reasons)))
    return make_scene(
        skeleton, recording, doubts, f"joints found in {found}", (*recording.notes, up_of(recording)[1], *notes)
    )
