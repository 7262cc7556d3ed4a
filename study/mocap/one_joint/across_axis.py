"""Checks of the two points that place a hinge along its axis: they must be on its segments, and near the joint."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from study.mocap.io.recording import Recording
from study.mocap.joints.estimates import Estimate
from study.mocap.joints.found_joints import FoundJoint
from study.mocap.joints.segment_poses import SegmentPoses
from study.sphere.types import Floats

_LOOSE = 0.05
"""Metres: greatest root mean square distance, from its mean place, of a point that is on a segment, with its skin."""
_OFF = 0.05
"""Metres: greatest distance from a hinge's axis of the middle of points at its ends. At real knees it is up to 3 cm."""
_ALONG = 0.1
"""Metres: greatest distance along the axis of that middle from the spheres' centre. At real knees it is up to 8 cm."""


def misplaced_across(
    found: FoundJoint, poses: Mapping[str, SegmentPoses], own: Sequence[str], recording: Recording
) -> tuple[str, ...]:
    """Find reasons why the two points across a hinge's axis are not at the joint.

    Args:
        found: the joint; one without such points, or without an axis, has no reason.
        poses: of its segments.
        own: markers that a user named on these.
        recording: that has the points.

    Returns:
        Sentences: a point moves in the axes of each segment; the middle is far from the axis; the markers of a joint
        that rotated about every direction show its place along the axis, and the middle is elsewhere.
    """
    estimate, across = found.estimate, found.joint.across
    if estimate is None or estimate.axis is None or not across:
        return ()
    strange = [label for label in across if label not in own]
    return (*_loose_points(strange, poses, recording), *_far_middle(estimate, across, recording))


def _loose_points(labels: Sequence[str], poses: Mapping[str, SegmentPoses], recording: Recording) -> Iterator[str]:
    for label in labels:
        moves = min((_scatter(each.to_local(recording.of(label))) for each in poses.values()), default=0.0)
        if moves > _LOOSE:
            yield f"{label} is on neither segment: it moves by {1000 * moves:.0f} mm in their axes"


def _far_middle(estimate: Estimate, across: Sequence[str], recording: Recording) -> Iterator[str]:
    middle = estimate.poses.mean_place(0.5 * (recording.of(across[0]) + recording.of(across[1])))
    if estimate.axis is None or np.isnan(middle).any():
        return
    name = f"the middle of {' and '.join(across)}"
    off = middle - estimate.center
    away = float(np.linalg.norm(off - (off @ estimate.axis) * estimate.axis))
    if away > _OFF:
        yield f"{name} is {1000 * away:.0f} mm from its axis"
    shown = _shown_place(estimate)
    along = 0.0 if shown is None else abs(float((middle - shown) @ estimate.axis))
    if along > _ALONG:
        yield f"it is no hinge: it rotated about every direction, and its centre is {1000 * along:.0f} mm from {name}"


def _shown_place(estimate: Estimate) -> Floats | None:
    """Place (3,) where the markers put a joint along its axis, too; None if they show nothing of it."""
    if estimate.sphere is not None:
        return estimate.sphere.center if estimate.sphere.axis is None else None
    return estimate.pair.in_parent if estimate.pair is not None and not estimate.pair.hinge else None


def _scatter(y: Floats) -> float:
    """Root mean square distance of places (3, frames) from their mean; 0 if there are none."""
    y = y[:, ~np.isnan(y[0])]
    return float(np.sqrt(y.var(axis=1).sum())) if y.shape[1] else 0.0
