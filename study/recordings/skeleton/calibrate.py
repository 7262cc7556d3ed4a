"""Calibration: from a recording, or from the joints found in it, to segment shapes and joint places.

Plausibility. A joint is inside the body, and so, mostly, inside the hull. A knee or an elbow whose only marker is on
its outer side may leave the hull by up to its own thickness where it is the outermost part of the body: the true joints
of synthetic bodies do so by 2-3 cm in one frame of twenty, and by 4 cm at most. So the distance is reported for every
joint, and a joint is doubted only where it is farther out than any body's.

Warnings about implausible hips, bones left and right, and joints outside the hull are signs that a joint is wrong, not
measures of how far, so they do not change its status.

Subject. The misfit of its segments' markers shows if a calibration is of the subject in a recording. The markers of one
subject stay at their places to a soft-tissue artefact of a few millimetres, which grows with the motion: a functional
trial with misfits of 3 mm meets 3-8 mm in a walk of the same session. Those of another subject, or of the same one with
its markers put on again, miss by 11-55 mm. So a segment does not fit if its misfit is beyond both that range and twice
its own in the recording that was calibrated, or if most of its samples are rejected.
"""

from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from study.arrays import Floats
from study.recordings.joints.calibration import Calibration, JointPlace
from study.recordings.joints.find import find_joints
from study.recordings.markersets import MarkerSet
from study.recordings.recording import Recording, RecordingError
from study.recordings.skeleton.draw import Skeleton, draw_skeleton
from study.recordings.skeleton.scene import mirrored, side

_THICKNESS = 0.05
"""Metres: thickness of a limb, beyond which a joint is doubted."""
_QUANTILE = 0.95
"""Share of the frames in which a joint is at most as far outside as reported."""
_FRAMES = 300
"""Most frames used, spread over those that show all markers."""
_FEWEST = 20
"""Fewest frames from which a distance is reported."""


@dataclass(frozen=True)
class HullDistance:
    """Distance of a joint from the hull of the markers.

    Attributes:
        share_outside: share of the frames in which the joint is outside; NaN if too few frames show all markers.
        distance: 95 % quantile over frames of the distance outside the hull, metres; negative inside.
    """

    share_outside: float
    distance: float

    @property
    def doubt(self) -> str:
        """Reason to doubt the joint; "" if there is none."""
        if not self.distance > _THICKNESS:
            return ""
        return (
            f"outside the markers' hull in {self.share_outside:.0%} of the frames, by up to "
            f"{1000 * self.distance:.0f} mm"
        )


def hull_distances(markers: Floats, joints: Floats) -> list[HullDistance]:
    """Measure the distance of each joint from the markers' hull, on frames that show all markers.

    A hull without one of its markers is smaller than the body, so other frames are left out. Markers that are missing
    throughout do not count.

    Args:
        markers: their places (markers, 3, frames), metres; NaN where missing.
        joints: their centres (joints, 3, frames), metres; NaN where unknown.

    Returns:
        A distance for each joint. It is measured to the planes of the hull's facets, so it is a lower bound.
    """
    seen = ~np.isnan(markers[:, 0])
    present = seen.any(axis=1)
    whole = np.flatnonzero(seen[present].all(axis=0)) if present.any() else np.zeros(0, dtype=int)
    part = whole[np.unique(np.linspace(0, len(whole) - 1, min(len(whole), _FRAMES)).astype(int))]
    distances = np.array([_plane_distances(markers[present, :, t], joints[:, :, t]) for t in part])
    return [_summary(row[~np.isnan(row)]) for row in distances.reshape(-1, len(joints)).T]


def _plane_distances(markers: Floats, joints: Floats) -> Floats:
    """Signed distances of joints (joints, 3) from the farthest facet's plane of the markers' hull; NaN without one."""
    try:
        planes = ConvexHull(markers).equations
    except QhullError:  # fewer than four markers, or all in one plane
        return np.full(len(joints), np.nan)
    return np.asarray((joints @ planes[:, :3].T + planes[:, 3]).max(axis=1))


def _summary(distances: Floats) -> HullDistance:
    """Summarise the distances of one joint (frames,)."""
    if len(distances) < _FEWEST:
        return HullDistance(float("nan"), float("nan"))
    return HullDistance(float((distances > 0.0).mean()), float(np.quantile(distances, _QUANTILE)))


_HIPS = 0.65, 1.2
"""Least and greatest distance of the hips, in distances of the markers on the two anterior superior iliac spines."""
_SPINES = (("LASI", "RASI"), ("LASIS", "RASIS"), ("LFWT", "RFWT"), ("L_ASIS", "R_ASIS"), ("L.ASIS", "R.ASIS"))
"""Names of these markers."""
UNEVEN = 0.08
"""Difference of a bone's length from the other side's, relative to their mean, above which both are doubtful."""
_OUTSIDE = 0.9
"""Share of the frames outside the markers' hull that is nearly all."""


def plausibility(calibration: Calibration, skeleton: Skeleton, recording: Recording) -> dict[str, tuple[str, ...]]:
    """Find joints that are unlike any body's.

    Args:
        calibration: whose joints they are.
        skeleton: drawn with it.
        recording: that the skeleton was drawn from.

    Returns:
        For each joint of which there is something to say, the warnings in words.
    """
    found: dict[str, list[str]] = defaultdict(list)
    _warn_of_hips(calibration, found)
    _warn_of_bones(calibration, found)
    distances = hull_distances(recording.positions, skeleton.centers)
    for name, hull in zip(skeleton.joints, distances, strict=True):
        if hull.share_outside > _OUTSIDE:
            found[name].append(f"outside the markers' hull in {hull.share_outside:.0%} of the frames")
    return {name: tuple(words) for name, words in found.items()}


def _warn_of_hips(calibration: Calibration, found: dict[str, list[str]]) -> None:
    """Warn of hips that are too near or too far from each other for their pelvis."""
    hips = {side(each.joint.name): each for each in calibration.joints if "hip" in each.joint.name.lower()}
    if not {"left", "right"} <= hips.keys() or hips["left"].joint.parent != hips["right"].joint.parent:
        return
    shape = calibration.shape(hips["left"].joint.parent)
    places = dict(zip(shape.markers, shape.places, strict=True))
    spines = next((pair for pair in _SPINES if set(pair) <= places.keys()), None)
    if spines is None:
        return
    width = _distance(places[spines[0]], places[spines[1]])
    apart = _distance(hips["left"].in_parent, hips["right"].in_parent)
    low, high = _HIPS
    if not np.isnan(apart) and not low * width <= apart <= high * width:
        words = (
            f"hip to hip is {1000 * apart:.0f} mm, {apart / width:.2f} of {spines[0]} to {spines[1]}: {low} to {high}"
        )
        for place in hips.values():
            found[place.joint.name].append(f"{words} is plausible")


def _warn_of_bones(calibration: Calibration, found: dict[str, list[str]]) -> None:
    """Warn of bones that differ between left and right."""
    lengths: dict[tuple[str, str], float] = {}
    above = {each.joint.child: each for each in calibration.joints}
    for end in calibration.joints:
        start: JointPlace | None = above.get(end.joint.parent)
        if start is not None:
            lengths[start.joint.name, end.joint.name] = _distance(start.in_child, end.in_parent)
    for (start_name, end_name), length in lengths.items():
        other = lengths.get((mirrored(start_name), mirrored(end_name)), float("nan"))
        if (start_name, end_name) == (mirrored(start_name), mirrored(end_name)):
            continue
        if abs(length - other) > UNEVEN * 0.5 * (length + other):
            words = (
                f"its bone {start_name} - {end_name} is {1000 * length:.0f} mm, the other side's {1000 * other:.0f} mm"
            )
            for name in (start_name, end_name):
                found[name].append(words)


def _distance(one: Floats, two: Floats) -> float:
    return float(np.linalg.norm(one - two))


def calibrate(recording: Recording, markerset: MarkerSet) -> Calibration:
    """Run phase 1: fit joints and shapes to a recording.

    Args:
        recording: markers under the set's names (see `match`).
        markerset: segments and joints.

    Returns:
        The calibration. Every joint has a status and a reason; one that was not found has no place.
    """
    return with_checks(find_joints(markerset, recording), recording)


def with_checks(calibration: Calibration, recording: Recording) -> Calibration:
    """Add the misfits of the shapes, and warnings about the joints, from the recording that a calibration is of."""
    if not calibration.has_poses:
        return calibration
    drawn = draw_skeleton(calibration, recording)
    warnings = plausibility(calibration, drawn, recording)
    shapes = (replace(shape, misfit=float(m)) for shape, m in zip(calibration.shapes, drawn.misfits, strict=True))
    places = (replace(place, warnings=warnings.get(place.joint.name, ())) for place in calibration.joints)
    return replace(calibration, shapes=tuple(shapes), joints=tuple(places))


_WORSE = 2.0
"""Growth of a segment's misfit above which it does not fit; between halves of one recording it is at most 1.4."""
_SESSION = 0.0095
"""Metres of misfit that are always accepted: between 8 mm, the most within a session, and 11 mm, the least beyond."""
_LEFT_OUT = 0.5
"""Share of a segment's samples left out above which it does not fit."""
_SEGMENTS = 1 / 3
"""Share of the segments above which misfits show another subject."""


@dataclass(frozen=True)
class SubjectCheck:
    """Comparison of a calibration with the subject in a recording.

    Attributes:
        same: True if the calibration is of this subject, or nothing can be compared.
        misfits: segments whose markers are far from their places, and by how much, in words.
        text: one line for a user.
    """

    same: bool
    misfits: dict[str, str]
    text: str


def check_subject(skeleton: Skeleton) -> SubjectCheck:
    """Compare a skeleton's misfits with those of its calibration."""
    misfits: dict[str, str] = {}
    compared = 0
    for shape, misfit, left_out in zip(skeleton.calibration.shapes, skeleton.misfits, skeleton.left_out, strict=True):
        if np.isnan(misfit) and not left_out:  # none of its markers, or never enough of them
            continue
        compared += 1
        if np.isnan(misfit):
            misfits[shape.segment] = "its markers fit together in no frame"
        elif left_out > _LEFT_OUT:
            misfits[shape.segment] = f"{left_out:.0%} of its samples are far from their places"
        elif misfit > max(_WORSE * shape.misfit, _SESSION):
            misfits[shape.segment] = f"{1000 * misfit:.0f} mm off, {1000 * shape.misfit:.0f} mm when calibrated"
    source, name = skeleton.calibration.source, skeleton.name
    if len(misfits) > _SEGMENTS * compared:
        listed = "; ".join(f"{segment}: {words}" for segment, words in misfits.items())
        text = (
            f"{name} does not show the subject calibrated in {source}: {len(misfits)} of {compared} segments do not "
            f"fit ({listed}); calibrate on a recording of the same session"
        )
        return SubjectCheck(False, misfits, text)
    text = f"{name} fits the calibration from {source}: {compared - len(misfits)} of {compared} segments"
    return SubjectCheck(True, misfits, text + (f", not {', '.join(misfits)}" if misfits else ""))


def require_same_subject(skeleton: Skeleton) -> Skeleton:
    """Return the skeleton, if its calibration is of the subject that it shows.

    Raises:
        RecordingError: if not; the message names the segments that do not fit and their misfits.
    """
    check = check_subject(skeleton)
    if not check.same:
        raise RecordingError(f"{check.text}, or use --force to draw with this one")
    return skeleton


def overruled(skeleton: Skeleton) -> list[str]:
    """The lines that say what is overruled where a skeleton is drawn whatever `check_subject` says; none if nothing."""
    check = check_subject(skeleton)
    return [] if check.same else [f"--force overrules: {check.text.partition('; calibrate on')[0]}"]
