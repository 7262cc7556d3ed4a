"""Warnings about joints that are implausible in any body: hips, bones left and right, joints outside the markers' hull.

They are signs that a joint is wrong, not measures of how far, so they do not change its status.
"""

from collections import defaultdict

import numpy as np

from study.mocap.geometry.convex_hull import hull_distances
from study.mocap.io.recording import Recording
from study.mocap.skeleton.bones import mirrored, side
from study.mocap.skeleton.calibration import Calibration, JointPlace
from study.mocap.skeleton.draw_skeleton import Skeleton
from study.sphere.types import Floats

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
