"""Calibration: from a recording, or from the joints found in it, to segment shapes and joint places.

Plausibility. A joint is inside the body, and so, mostly, inside the hull. A knee or an elbow whose only marker is on
its outer side may leave the hull by up to its own thickness where it is the outermost part of the body: the true joints
of synthetic bodies do so by 2-3 cm in one frame of twenty, and by 4 cm at most. So the distance is reported for every
joint, and a joint is doubted only where it is farther out than any body's.

Hips that are too far apart for their pelvis, or outside the hull in nearly all frames, are doubted (`with_doubts`).

Subject. The shapes of its segments show if a calibration is of the subject in a recording. Those of one subject in one
session differ by skin in another posture and by markers that were put on again, by up to a centimetre; those of other
subjects by 11-55 mm, or all by a few hundredths of their size.
"""

import contextlib
import itertools
import math
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from study.arrays import Floats
from study.files import named_path
from study.recordings.joints.estimate import USABLE, JointStatus
from study.recordings.joints.find import (
    Calibration,
    JointPlace,
    SegmentShape,
    find_joints,
    load_calibration,
    with_allowance,
)
from study.recordings.joints.poses import fit_template
from study.recordings.markersets import MarkerSet, Match, match, mirrored, place_markerset, side
from study.recordings.recording import Recording, RecordingError
from study.recordings.rigid import nearest_rotation
from study.recordings.skeleton.anatomy import DrawnTrial, Hips, part_of, with_anatomy
from study.recordings.skeleton.draw import LARGEST_ERROR, Skeleton, draw_skeleton

_THICKNESS = 0.05
"""Metres: thickness of a limb, beyond which a joint is doubted."""
_QUANTILE = 0.95
"""Share of the frames in which a joint is at most as far outside as reported."""
_FRAMES = 300
"""Most frames used, spread over those that show all markers."""
_FEWEST = 20
"""Fewest frames from which a distance is reported."""


def hull_doubt(share: float, distance: float) -> str:
    """Reason to doubt a joint, from its share and distance outside the markers' hull; "" if there is none."""
    where = f"outside the markers' hull in {share:.0%} of the frames"
    return f"{where}, by up to {1000 * distance:.0f} mm" if distance > _THICKNESS else ""


def gap_doubt(gap: float) -> str:
    """Reason to doubt a joint whose segments put it so far apart, metres, root mean square; "" if there is none."""
    return f"its two segments put it {1000 * gap:.0f} mm apart" if gap > LARGEST_ERROR else ""


def hull_distances(markers: Floats, joints: Floats) -> tuple[Floats, Floats]:
    """Measure the distance of each joint from the markers' hull, on frames that show all markers.

    A hull without one of its markers is smaller than the body, so other frames are left out. Markers that are missing
    throughout do not count.

    Args:
        markers: their places (markers, 3, frames), metres; NaN where missing. Two coordinates are seen along an axis.
        joints: their centres (joints, 3, frames), metres; NaN where unknown.

    Returns:
        Share of the frames in which each joint is outside (joints,), and the 95 % quantile over frames of its distance
        outside (joints,), metres, negative inside; NaN if too few frames show all markers. A distance is measured to
        the planes of the hull's facets, so it is a lower bound.
    """
    seen = ~np.isnan(markers[:, 0])
    present = seen.any(axis=1)
    whole = np.flatnonzero(seen[present].all(axis=0)) if present.any() else np.zeros(0, dtype=int)
    part = whole[np.unique(np.linspace(0, len(whole) - 1, min(len(whole), _FRAMES)).astype(int))]
    distances = np.full((len(part), len(joints)), np.nan)  # signed, from the farthest facet's plane
    for row, t in enumerate(part):
        with contextlib.suppress(QhullError):  # fewer than four markers, or all in one plane
            planes = ConvexHull(markers[present, :, t]).equations
            distances[row] = (joints[:, :, t] @ planes[:, :-1].T + planes[:, -1]).max(axis=1)
    shares, quantiles = np.full(len(joints), np.nan), np.full(len(joints), np.nan)
    for joint, column in enumerate(distances.T):
        known = column[~np.isnan(column)]
        if len(known) >= _FEWEST:
            shares[joint], quantiles[joint] = (known > 0.0).mean(), np.quantile(known, _QUANTILE)
    return shares, quantiles


_HIPS = 0.65, 1.2
"""Least and greatest distance of the hips, in widths of the pelvis."""
_NARROW = 0.14
"""Metres: two markers that are nearer do not show the width of a pelvis."""
_ACROSS = np.cos(np.radians(30.0))
"""Cosine of the greatest angle between the line of these markers and that of the hips."""
UNEVEN = 0.08
"""Difference of a bone's length from the other side's, relative to their mean, above which both are doubtful."""
_OUTSIDE = 0.9
"""Share of the frames outside the markers' hull that is nearly all."""


def with_doubts(calibration: Calibration, outside: Floats, gaps: Floats) -> Calibration:
    """Doubt hips that no body has, and warn of other joints that are unlike any body's.

    A hip is doubted if it is outside the markers' hull in nearly all frames, or if the hips are too near to or too far
    from each other for their pelvis. Other joints outside the hull, joints that their segments put apart, and bones
    that differ between left and right, are warnings: signs that a joint is wrong, not measures of how far.

    Args:
        calibration: whose joints they are.
        outside: share of the frames in which each joint is outside the markers' hull (joints,).
        gaps: root mean square distance between each joint in its child and in its parent (joints,), metres.
    """
    doubts, warnings = hip_doubts(calibration), _uneven_bones(calibration)
    for place, share, gap in zip(calibration.joints, outside, gaps, strict=True):
        if words := gap_doubt(gap):
            warnings[place.joint.name].append(words)
        if share > _OUTSIDE:
            words = f"outside the markers' hull in {share:.0%} of the frames"
            (doubts if _is_hip(place) else warnings)[place.joint.name].append(words)
    joints = []
    for place in calibration.joints:
        reasons, status = doubts[place.joint.name], place.status
        if reasons:
            reasons = reasons if status in USABLE else [place.reason, *reasons]
            status = JointStatus.IMPLAUSIBLE if status in USABLE else status
            place = replace(place, status=status, reason="; ".join(reasons))
        joints.append(replace(place, warnings=tuple(warnings[place.joint.name])))
    return replace(calibration, joints=tuple(joints))


def _is_hip(place: JointPlace) -> bool:
    return "hip" in place.joint.name.lower()


def hip_doubts(calibration: Calibration) -> dict[str, list[str]]:
    """Reasons to doubt hips that are too near to or too far from each other for their pelvis, by joint.

    The width of the pelvis is the distance of the two of its markers that are nearest to the hips, of those that lie
    across the body: those on the anterior superior iliac spines, whatever their labels.
    """
    doubts: dict[str, list[str]] = defaultdict(list)
    hips = {side(place.joint.name): place for place in calibration.joints if _is_hip(place)}
    if not {"left", "right"} <= hips.keys() or hips["left"].joint.parent != hips["right"].joint.parent:
        return doubts
    left, right = hips["left"].in_parent, hips["right"].in_parent
    apart = math.dist(left, right)
    shape = calibration.shape(hips["left"].joint.parent)
    pairs = []
    for (one, label), (other, second) in itertools.permutations(zip(shape.places, shape.markers, strict=True), 2):
        width = math.dist(one, other)
        if width >= _NARROW and (one - other) @ (left - right) > _ACROSS * width * apart:
            pairs.append((math.dist(one, left) + math.dist(other, right), width, label, second))
    if pairs:
        _, width, *names = min(pairs)
        low, high = _HIPS
        if not low * width <= apart <= high * width:
            words = f"hip to hip is {1000 * apart:.0f} mm, {apart / width:.2f} of {names[0]} to {names[1]}"
            for place in hips.values():
                doubts[place.joint.name].append(f"{words}: {low} to {high} is plausible")
    return doubts


def _uneven_bones(calibration: Calibration) -> dict[str, list[str]]:
    """Warnings of bones that differ between left and right, by joint."""
    warnings: dict[str, list[str]] = defaultdict(list)
    above = {place.joint.child: place for place in calibration.joints}
    ends = [(above[end.joint.parent], end) for end in calibration.joints if end.joint.parent in above]
    lengths = {(a.joint.name, b.joint.name): math.dist(a.in_child, b.in_parent) for a, b in ends}
    for pair, length in lengths.items():
        across = mirrored(pair[0]), mirrored(pair[1])
        other = lengths.get(across, np.nan) if across != pair else np.nan
        if abs(length - other) > UNEVEN * 0.5 * (length + other):
            bones = {" - ".join(pair): length, " - ".join(across): other}
            one, two = sorted(bones)
            words = f"the bone {one} is {1000 * bones[one]:.0f} mm, {two} {1000 * bones[two]:.0f} mm"
            for name in pair:
                warnings[name].append(words)
    return warnings


def calibrate(
    recording: Recording, markerset: MarkerSet, source: Recording | None = None, hips: Hips = "motion"
) -> Calibration:
    """Run phase 1: fit joints and shapes to a recording.

    Args:
        recording: markers under the set's names (see `match`).
        markerset: segments and joints.
        source: the whole recording, whose points of the body give anatomical axes (see `with_anatomy`).
        hips: "regression" to place doubted hips by these points.

    Returns:
        The calibration. Every joint has a status and a reason; one that was not found has no place.
    """
    found = find_joints(markerset, recording)
    found = replace(found, joints=tuple(map(with_allowance, found.joints)))
    return with_checks(found, recording, source, hips)


def with_checks(
    calibration: Calibration, recording: Recording, source: Recording | None = None, hips: Hips = "motion"
) -> Calibration:
    """Add the misfits of the shapes, doubts, warnings and anatomical axes, from the recording that a calibration is of.

    The arguments are those of `calibrate`.
    """
    if not calibration.has_poses:
        return calibration
    checked, drawn = _checked(calibration, recording)
    if source is None:
        return checked
    placed = with_anatomy(checked, DrawnTrial(drawn, recording), source, hips)
    if all(new.status == was.status for new, was in zip(placed.joints, checked.joints, strict=True)):
        return placed
    threes = zip(placed.joints, checked.joints, calibration.joints, strict=True)
    joints = tuple(
        new if new.status != was.status else replace(new, status=old.status, reason=old.reason, warnings=())
        for new, was, old in threes
    )
    return _checked(replace(placed, joints=joints), recording)[0]


def _checked(calibration: Calibration, recording: Recording) -> tuple[Calibration, Skeleton]:
    """The calibration with misfits, doubts and warnings, and the skeleton that is drawn with it."""
    drawn = draw_skeleton(calibration, recording)
    shapes = (replace(shape, misfit=float(m)) for shape, m in zip(calibration.shapes, drawn.misfits, strict=True))
    outside, _ = hull_distances(recording.positions, drawn.centers)
    return with_doubts(replace(calibration, shapes=tuple(shapes)), outside, drawn.gaps), drawn


def with_joints(
    recording: Recording,
    joints: Calibration | str | Path | None,
    markerset: str | None,
    hips: Hips = "motion",
    segments: str = "",
) -> tuple[Match, Calibration]:
    """Place the marker set of given joints on a recording, or find joints in the recording itself.

    Args:
        recording: the whole recording.
        joints: given ones, or their file or its folder; None to find them here.
        markerset: name or file of a marker set for joints that are found here.
        hips: as in `calibrate`.
        segments: those to use, as in `part_of`; all if "".

    Raises:
        RecordingError: if the joints cannot be read, or ``markerset`` is given, too.
        MarkerSetError: if no joint can be found with the marker set, or it has not these segments.
    """
    if joints is None:
        placed = place_markerset(recording, markerset)
        placed = match(part_of(placed.whole, segments), recording) if segments else placed
        return placed, calibrate(placed.recording, placed.markerset, recording, hips)
    if markerset is not None:
        raise RecordingError(f"markerset = {markerset!r}: joints have their own marker set; leave it out")
    if not isinstance(joints, Calibration):
        path = named_path(joints, "joints")
        joints = load_calibration(path / "calibration.json" if path.is_dir() else path)
    if segments:
        part = part_of(joints.markerset, segments)
        names, kept = {segment.name for segment in part.segments}, {joint.name for joint in part.joints}
        shapes = tuple(shape for shape in joints.shapes if shape.segment in names)
        places = tuple(place for place in joints.joints if place.joint.name in kept)
        joints = replace(joints, markerset=part, shapes=shapes, joints=places)
    return match(joints.markerset, recording), joints


_REPLACED = 0.013
"""Metres: greatest distance of markers from their places, root mean square, that a session explains: skin in another
posture, or a marker that was put on again."""
_LEAST = 0.003
"""Metres: least standard deviation of a coordinate of such distances."""
_UNKNOWN = 0.006
"""The same where segments of two markers do not show it."""
_SCALE, _SIGNIFICANT = 0.025, 2.6
"""Difference in size above which another subject is shown, if it is also so many standard errors."""
_ROBUST = 4
"""Number of segments from which on the one that fits worst does not count: a label may be on another marker there."""


def other_subject(calibration: Calibration, recording: Recording, refit: bool = False) -> str:
    """Compare the shapes of a calibration's segments with those that a recording has.

    Only segments of joints with a place count. The shapes of two trials of one session differ by skin in another
    posture, and by markers that were put on again. Those of another subject differ by more, or all in size.

    Args:
        calibration: of the subject.
        recording: with markers under the calibration's names.
        refit: True if the shapes will be fitted to the recording, so that only the size counts.

    Returns:
        The sentence on the segments that do not fit, and by how much; "" if the recording shows the same subject, or
        nothing can be compared.
    """
    joints = [place.joint for place in calibration.joints if not np.isnan(place.in_parent).any()]
    carrying = {segment for joint in joints for segment in (joint.parent, joint.child)}
    compared = {s.segment: _shape_difference(s, recording) for s in calibration.shapes if s.segment in carrying}
    rows = {name: row for name, row in compared.items() if row is not None}
    if not rows:
        return ""
    squares, spare, extents, along = np.array(list(rows.values())).T
    off = np.sqrt(3.0 * squares / np.maximum(spare, 1.0))
    counted = spare > 0.0
    counted[off.argmax()] &= counted.sum() < _ROBUST
    freedom = spare[counted].sum()
    sigma = max(np.sqrt(squares[counted].sum() / freedom), _LEAST) if freedom else _UNKNOWN
    scale, error = along.sum() / extents.sum(), sigma / np.sqrt(extents.sum())
    apart = {n: f"{1000 * d:.0f} mm from its places" for n, d in zip(rows, off, strict=True) if d > _REPLACED}
    reasons = []
    if not refit and freedom and np.sqrt(3.0) * sigma > _REPLACED:
        listed = "; ".join(f"{segment}: {words}" for segment, words in apart.items())
        reasons.append(f"{len(apart)} of {len(rows)} segments do not fit ({listed})")
    if abs(scale - 1.0) > max(_SCALE, _SIGNIFICANT * error):
        sizes = {name: part / extent - 1.0 for name, part, extent in zip(rows, along, extents, strict=True)}
        listed = ", ".join(f"{name} {size:+.0%}" for name, size in sizes.items() if abs(size) > _SCALE)
        reasons.append(f"its segments are {abs(scale - 1.0):.0%} {'larger' if scale > 1.0 else 'smaller'} ({listed})")
    subject = f"{recording.name} does not show the subject calibrated in {calibration.source}"
    return f"{subject}: {'; '.join(reasons)}" if reasons else ""


def _shape_difference(shape: SegmentShape, recording: Recording) -> tuple[float, float, float, float] | None:
    """Difference of a segment's shape in a recording from that of a calibration.

    Returns:
        Sum of squared distances after superposition and scaling, m²; the degrees of freedom in it; sum of squares of
        the calibrated places about their centroid, m²; and that times the scale. None for fewer than two markers.
    """
    present = [k for k, marker in enumerate(shape.markers) if marker in recording.markers]
    if len(present) < 2:
        return None
    own, *_ = fit_template(np.stack([recording.of(shape.markers[k]) for k in present]))
    known = np.isfinite(own).all(axis=1)
    here, there = own[known], shape.places[present][known]
    if len(here) < 2:
        return None
    here, there = here - here.mean(axis=0), there - there.mean(axis=0)
    extent = float((there**2).sum())
    if len(here) == 2:
        return 0.0, 0.0, extent, float(np.sqrt((here**2).sum() * extent))
    rotation = nearest_rotation(here.T @ there)
    along = float(np.vdot(here, there @ rotation.T))
    return max(float((here**2).sum()) - along**2 / extent, 0.0), 3.0 * len(here) - 7.0, extent, along


def require_same_subject(
    calibration: Calibration, recording: Recording, refit: bool = False, force: bool = False
) -> list[str]:
    """Refuse a recording of another subject than a calibration's (see `other_subject`), unless it is forced.

    Returns:
        The line that says what is overruled by force, if it is.

    Raises:
        RecordingError: the message names the segments that do not fit and by how much.
    """
    words = other_subject(calibration, recording, refit)
    if words and not force:
        remedy = "calibrate on a recording of the same session, leave segments out with --segments, or use --force"
        raise RecordingError(f"{words}; {remedy}")
    return [f"--force overrules: {words}"] if words else []
