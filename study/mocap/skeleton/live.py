"""IGDK as a live mode: joint centres that improve with every frame of a camera, in constant memory.

For each joint one sum over all frames so far, taken in frame by frame: its markers are put into the parent's moving
frame and into the recurrences of x̄, Σdd' and Σd|d|² (theory §1.1), and the centre is MGDK's (paper eqs 22, 24) with a
known noise taken off, as UGDK does it. No sample is kept. With the noise left at zero it is the paper's IGDK, which
carries GDKE's bias. A frame costs some hundred operations per marker and one 3 × 3 system per joint.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from study.mocap.geometry.rigid import place
from study.mocap.skeleton.calibration import Calibration
from study.sphere.jit import compiled
from study.sphere.linalg import cholesky_solve
from study.sphere.types import Floats

_ROW = 13
"""Of a marker's state: n, x̄ (3), Σdd' (xx, yy, zz, xy, xz, yz), Σd|d|² (3)."""


@compiled
def _take(state: Any, y0: float, y1: float, y2: float) -> None:
    """Take one sample into a marker's sums (13,), in place (theory §1.1, unnormalised)."""
    n = state[0]
    e0, e1, e2 = y0 - state[1], y1 - state[2], y2 - state[3]
    share = 1.0 / (n + 1.0)
    trace = state[4] + state[5] + state[6]
    square = e0 * e0 + e1 * e1 + e2 * e2
    keep, third = n * share, n * (n - 1.0) * share * share * square
    a0 = state[4] * e0 + state[7] * e1 + state[8] * e2
    a1 = state[7] * e0 + state[5] * e1 + state[9] * e2
    a2 = state[8] * e0 + state[9] * e1 + state[6] * e2
    state[10] += third * e0 - share * (2.0 * a0 + trace * e0)
    state[11] += third * e1 - share * (2.0 * a1 + trace * e1)
    state[12] += third * e2 - share * (2.0 * a2 + trace * e2)
    state[4] += keep * e0 * e0
    state[5] += keep * e1 * e1
    state[6] += keep * e2 * e2
    state[7] += keep * e0 * e1
    state[8] += keep * e0 * e2
    state[9] += keep * e1 * e2
    state[0] = n + 1.0
    state[1] += share * e0
    state[2] += share * e1
    state[3] += share * e2


@compiled
def _center(states: Any, first: int, last: int, noise: float, matrix: Any, center: Any) -> bool:
    """MGDK's centre (3,) of the markers ``first`` to ``last``; False, and NaN, if it is not positive definite."""
    count = m0 = m1 = m2 = 0.0
    for k in range(first, last):
        n = states[k, 0]
        count, m0, m1, m2 = count + n, m0 + n * states[k, 1], m1 + n * states[k, 2], m2 + n * states[k, 3]
    for i in range(3):
        center[i] = 0.0
        for j in range(3):
            matrix[i, j] = 0.0
    if count > 0.0:
        m0, m1, m2 = m0 / count, m1 / count, m2 / count
    for k in range(first, last):
        n = states[k, 0]
        if n < 2.0:
            continue
        off = (n - 1.0) * noise
        xx, yy, zz = states[k, 4] - off, states[k, 5] - off, states[k, 6] - off
        xy, xz, yz = states[k, 7], states[k, 8], states[k, 9]
        d0, d1, d2 = states[k, 1] - m0, states[k, 2] - m1, states[k, 3] - m2
        matrix[0, 0] += xx
        matrix[1, 1] += yy
        matrix[2, 2] += zz
        matrix[1, 0] += xy
        matrix[2, 0] += xz
        matrix[2, 1] += yz
        center[0] += xx * d0 + xy * d1 + xz * d2 + 0.5 * states[k, 10]
        center[1] += xy * d0 + yy * d1 + yz * d2 + 0.5 * states[k, 11]
        center[2] += xz * d0 + yz * d1 + zz * d2 + 0.5 * states[k, 12]
    if not cholesky_solve(matrix, center):
        center[0] = center[1] = center[2] = math.nan
        return False
    center[0] += m0
    center[1] += m1
    center[2] += m2
    return True


@compiled
def _step(
    x: Any, bases: Any, templates: Any, starts: Any, watched: Any, begins: Any, noise: Any, states: Any, seen: Any,
    points: Any, rotation: Any, origin: Any, work: Any, centers: Any,
) -> None:  # fmt: skip
    """Take one frame x (markers, 3) into every joint's sums, and find the centres (joints, 3)."""
    for j in range(len(begins) - 1):
        m = starts[j + 1] - starts[j]
        for k in range(m):
            marker = bases[starts[j] + k]
            for i in range(3):
                points[k, i, 0] = x[marker, i]
            seen[k, 0] = x[marker, 0] == x[marker, 0]
        if place(templates[starts[j] : starts[j + 1]], points[:m], seen[:m], 0, work, rotation, origin):
            for k in range(begins[j], begins[j + 1]):
                v0, v1, v2 = x[watched[k], 0] - origin[0], x[watched[k], 1] - origin[1], x[watched[k], 2] - origin[2]
                if v0 == v0:
                    _take(
                        states[k],
                        rotation[0, 0] * v0 + rotation[1, 0] * v1 + rotation[2, 0] * v2,
                        rotation[0, 1] * v0 + rotation[1, 1] * v1 + rotation[2, 1] * v2,
                        rotation[0, 2] * v0 + rotation[1, 2] * v1 + rotation[2, 2] * v2,
                    )
        _center(states, begins[j], begins[j + 1], noise[j], work[0], centers[j])


class LiveJoints:
    """Joints whose parent has three markers or more, found while the camera runs.

    Args:
        calibration: for the segments' shapes; its joints' places are not used.
        markers: the order in which a frame has them.
        noise: standard deviation of a coordinate (metres) that is taken off; 0 gives the paper's IGDK.

    Attributes:
        joints: names of those that can be found.
        centers: (joints, 3), metres, in the parents' axes; NaN while frames are too few or noise hides the motion.

    Raises:
        ValueError: if the noise is negative.
    """

    def __init__(self, calibration: Calibration, markers: Sequence[str], noise: float = 0.0) -> None:
        if not noise >= 0.0:
            raise ValueError(f"noise = {noise:g}; give a standard deviation in metres, 0 or more")
        row = {marker: i for i, marker in enumerate(markers)}
        names, bases, templates, starts, watched, begins = [], [], [], [0], [], [0]
        for found in calibration.joints:
            shape = calibration.shape(found.joint.parent)
            chosen = [k for k, marker in enumerate(shape.markers) if marker in row]
            seeing = [row[marker] for marker in calibration.markerset.seeing(found.joint) if marker in row]
            if not shape.own or len(chosen) < 3 or not seeing:
                continue
            names.append(found.joint.name)
            bases += [row[shape.markers[k]] for k in chosen]
            templates.append(shape.places[chosen])
            watched += seeing
            starts.append(len(bases))
            begins.append(len(watched))
        most = max(np.diff(starts), default=0)
        self.joints = tuple(names)
        self.centers: Floats = np.full((len(names), 3), np.nan)
        self._states = np.zeros((len(watched), _ROW))
        self._arguments = (
            np.array(bases, dtype=np.int64), np.concatenate([np.zeros((0, 3)), *templates]), np.array(starts),
            np.array(watched, dtype=np.int64), np.array(begins), np.full(len(names), float(noise) ** 2), self._states,
            np.zeros((most, 1), dtype=np.bool_), np.empty((most, 3, 1)), np.empty((3, 3)), np.empty(3),
            np.empty((3, 3, 3)), self.centers,
        )  # fmt: skip

    def update(self, frame: Floats) -> Floats:
        """Take one frame (markers, 3), metres, NaN where not seen, and return the centres, which change in place."""
        _step(frame, *self._arguments)
        return self.centers
