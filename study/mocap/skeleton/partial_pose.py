"""Poses of a segment in frames that show too few of its markers to fit its rotation.

The markers that are left show a direction. The segment is rotated from its expected pose by the shortest arc that takes
the expected direction to the one seen; the rotation about that direction is the expected one.
"""

import math
from typing import NamedTuple

import numpy as np

from study.mocap.skeleton.full_pose import PivotPath, SegmentPath
from study.sphere.jit import compiled
from study.sphere.types import Floats, Ints

_HALF_TURN = -0.999999
"""Cosine of the arc below which its plane is undefined, so that the expected rotation is kept."""


class ExpectedPoses(NamedTuple):
    """Poses of a segment that are expected in frames that do not show it.

    Attributes:
        frames: numbers of these frames (w,).
        rotation: (3, 3, w), NaN where unknown.
        origin: (3, w), metres, NaN where unknown; for a segment without a pivot.
    """

    frames: Ints
    rotation: Floats
    origin: Floats


@compiled
def _rotate_by_arc(u: Floats, v: Floats, r: Floats) -> None:
    """Rotate r (3, 3), in place, by the shortest arc that takes the direction u (3,) to v (3,)."""
    uu = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    vv = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if not (uu > 0.0 and vv > 0.0):
        return
    c = (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) / (uu * vv)
    if c < _HALF_TURN:
        return
    w0 = (u[1] * v[2] - u[2] * v[1]) / (uu * vv)
    w1 = (u[2] * v[0] - u[0] * v[2]) / (uu * vv)
    w2 = (u[0] * v[1] - u[1] * v[0]) / (uu * vv)
    h = 1.0 / (1.0 + c)
    for j in range(3):
        a, b, d = r[0, j], r[1, j], r[2, j]
        along = h * (w0 * a + w1 * b + w2 * d)
        r[0, j] = c * a + w1 * d - w2 * b + along * w0
        r[1, j] = c * b + w2 * a - w0 * d + along * w1
        r[2, j] = c * d + w0 * b - w1 * a + along * w2


@compiled
def complete_poses(places: Floats, x: Floats, pivot: PivotPath, expected: ExpectedPoses, path: SegmentPath) -> None:
    """Complete a segment's poses, in place, in frames that show too few of its markers.

    Args:
        places: of its markers in its axes (m, 3), metres.
        x: the markers in the world (m, 3, frames), metres.
        pivot: its joint.
        expected: its expected poses in the frames to complete.
        path: its poses; ``rotation`` and ``origin`` are completed.
    """
    pin, at = pivot
    wanted, expected_rotation, expected_origin = expected
    rotation, origin, _, used, _ = path
    m = used.shape[0]
    u, v, a, b, r = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    for w in range(len(wanted)):
        t = wanted[w]
        pinned, count = at[0, t] == at[0, t], 0
        for i in range(3):
            a[i], b[i] = pin[i], at[i, t]
            for j in range(3):
                r[i, j] = expected_rotation[i, j, w]
        for k in range(m):
            if used[k, t]:
                count += 1
                if count == 1:
                    for i in range(3):  # without a joint, the first marker takes its place
                        a[i], b[i] = (pin[i], at[i, t]) if pinned else (places[k, i], x[k, i, t])
                        v[i] = 0.0
                        u[i] = 0.0
                for i in range(3):
                    v[i] += x[k, i, t] - b[i]
                    u[i] += (
                        r[i, 0] * (places[k, 0] - a[0])
                        + r[i, 1] * (places[k, 1] - a[1])
                        + r[i, 2] * (places[k, 2] - a[2])
                    )
        if count > 0:
            _rotate_by_arc(u, v, r)
        for i in range(3):
            if pinned or count > 0:
                origin[i, t] = b[i] - r[i, 0] * a[0] - r[i, 1] * a[1] - r[i, 2] * a[2]
            else:
                origin[i, t] = expected_origin[i, w]
            for j in range(3):
                rotation[i, j, t] = r[i, j]
