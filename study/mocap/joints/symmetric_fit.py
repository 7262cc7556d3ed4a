"""Where two moving frames agree on a point: the symmetric fit of a joint, and the axis that both turn about.

    minimise Σ |R_P c_P + t_P - R_Q c_Q - t_Q|²                                              (SCoRE, Ehrig et al. 2006)

Six linear equations. Their matrix holds RᵀR = I, which has no noise, and M = mean R_PᵀR_Q, which noise makes smaller:
a frame that is uncertain by δ is seen on average as R (I - B), B = ½ (Tr Cov δ - Cov δ). Multiplying by I + B takes
that out, as UGDK takes the noise out of C. For a hinge both c may slide along the axis together; the singular vectors
of M show that axis in both frames (SARA, Ehrig et al. 2007, in closed form).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from study.mocap.geometry.long_run_covariance import long_run
from study.mocap.joints.segment_poses import Frames
from study.sphere.jit import compiled
from study.sphere.types import Floats

_CHANCE = 3.0
"""Standard errors within which a turn of the axis is no more than noise."""
_STIFF = 0.02
"""Radians: frames that turned by less, root mean square, about every axis have no joint to show."""
_SHAPE = 0.1
"""Share to which the variance of the frames' turns is known."""


@dataclass(frozen=True)
class TwoSided:
    """A joint from both of its frames.

    Attributes:
        in_parent: c_P (3,) and ``in_child`` c_Q (3,), metres.
        covariance: of c_P (3, 3), m²: the sandwich over frames, correlation in time included, and what it would be off
            if the frames' noise were not what their markers say.
        gap: root mean square distance between the two images of the joint, metres.
        axes: direction that stays nearest to itself in both frames, in the parent's axes and in the child's (2, 3).
        turns: root mean square angle by which the frames turn against each other about three axes, that one first,
            radians.
        hinge: whether that direction moves by no more than noise; along it the two c are then the least that agree.
        frames: how many took part; ``worth``: as many independent ones as these are worth.
    """

    in_parent: Floats
    in_child: Floats
    covariance: Floats
    gap: float
    axes: Floats
    turns: Floats
    hinge: bool
    frames: int
    worth: float


def two_sided(parent: Frames, child: Frames) -> TwoSided | None:
    """Fit the point in which two frames agree; None if they share fewer than four frames or do not turn."""
    n = int((parent.known & child.known).sum())
    if n < 4:
        return None
    each = np.empty((15, n))
    system = _System(parent, child, 1.0, each)
    s, u, v = system.spectrum()
    # by the turns of the mean rotation: about the axis kept, the other two shrink
    turns = np.sqrt(np.maximum([s[0] - s[1] - s[2] + 1.0, s[1] - s[0] - s[2] + 1.0, s[2] - s[0] - s[1] + 1.0], 0.0))
    if turns.max() < _STIFF:
        return None
    along = np.outer(u, v).ravel() @ each[:9] - s[0]
    hinge = bool(1.0 - s[0] < _CHANCE * np.sqrt(long_run(along[None])[0][0, 0]) / n)
    c, inverse = system.solve(hinge)
    scores = np.empty((6, n))
    gap = _scores(
        each, parent.rotation, parent.origin, parent.known, child.rotation, child.origin, child.known, c, scores
    )
    inflated, instant = (inverse @ part @ inverse / n**2 for part in long_run(scores))
    share = float(np.trace(instant[:3, :3]) / max(np.trace(inflated[:3, :3]), 1e-300))
    doubt = inverse @ (_System(parent, child, 1.0 + _SHAPE, np.empty((15, 0))).residual(c))
    return TwoSided(
        c[:3], c[3:], inflated[:3, :3] + np.outer(doubt[:3], doubt[:3]), gap, np.stack([u, v]), turns, hinge, n,
        n * min(share, 1.0),
    )  # fmt: skip


class _System:
    """The six equations for a size of the frames' noise: mean of c_P - M c_Q = a, and the same the other way round.

    What each frame adds to M, a and b goes ``into`` (15, n), nine and three and three rows, unless that has no room.
    """

    def __init__(self, p: Frames, q: Frames, size: float, into: Floats) -> None:
        sums = np.zeros(15)
        _sum(
            p.rotation, p.origin, p.carried.pattern, p.known, *_tables(p, size),
            q.rotation, q.origin, q.carried.pattern, q.known, *_tables(q, size), into, sums,
        )  # fmt: skip
        self.mean, self.a, self.b = sums[:9].reshape(3, 3), sums[9:12], sums[12:]

    def spectrum(self) -> tuple[Floats, Floats, Floats]:
        """Singular values of M, at most 1, and its first singular vectors."""
        u, s, vt = np.linalg.svd(self.mean)
        return np.minimum(s, 1.0), u[:, 0], vt[0]

    def solve(self, hinge: bool) -> tuple[Floats, Floats]:
        """The two places (6,), and the inverse that gives them (6, 6)."""
        matrix = np.block([[np.eye(3), -self.mean], [-self.mean.T, np.eye(3)]])
        kept = np.linalg.eigh(matrix)[1][:, 1 if hinge else 0 :]
        inverse = kept @ np.linalg.pinv(kept.T @ matrix @ kept) @ kept.T
        return inverse @ np.concatenate([self.a, self.b]), inverse

    def residual(self, c: Floats) -> Floats:
        """Mean of what the equations lack (6,)."""
        return np.concatenate([self.a - c[:3] + self.mean @ c[3:], self.b - c[3:] + self.mean.T @ c[:3]])


def _tables(frames: Frames, size: float) -> tuple[Floats, Floats, Floats]:
    """Of each pattern of seen markers: its centroid (3,), I + B (3, 3), and the mean of δ × ε̄ (3,)."""
    carried = frames.carried
    return carried.centroid, carried.grown(size), carried.drift(size)


@compiled
def _sum(
    rp: Any, op: Any, pattern_p: Any, known_p: Any, middle_p: Any, grown_p: Any, drift_p: Any,
    rq: Any, oq: Any, pattern_q: Any, known_q: Any, middle_q: Any, grown_q: Any, drift_q: Any,
    into: Any, sums: Any,
) -> None:  # fmt: skip
    """Means (15,) of M, a and b over the frames in which both are known; each frame's own go ``into`` (15, n).

    With G = I + B, p and q the centroids and w what leads in the world from R_P p + o_P to R_Q q + o_Q, a frame has
    M = G_P R_PᵀR_Q G_Q,  a = p + G_P R_Pᵀ w - M q - drift,  b = q - G_Q R_Qᵀ w - Mᵀ p - drift.
    """
    n = known_p.size
    y, z, raw, left, m = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    at = 0
    for t in range(n):
        if not (known_p[t] and known_q[t]):
            continue
        at_p, at_q = pattern_p[t], pattern_q[t]
        p0, p1, p2 = middle_p[at_p, 0], middle_p[at_p, 1], middle_p[at_p, 2]
        q0, q1, q2 = middle_q[at_q, 0], middle_q[at_q, 1], middle_q[at_q, 2]
        for i in range(3):
            y[i], z[i] = 0.0, 0.0
            for j in range(3):
                raw[i, j] = rp[0, i, t] * rq[0, j, t] + rp[1, i, t] * rq[1, j, t] + rp[2, i, t] * rq[2, j, t]
        for i in range(3):
            w = rq[i, 0, t] * q0 + rq[i, 1, t] * q1 + rq[i, 2, t] * q2 + oq[i, t]
            w -= rp[i, 0, t] * p0 + rp[i, 1, t] * p1 + rp[i, 2, t] * p2 + op[i, t]
            for j in range(3):
                y[j] += rp[i, j, t] * w
                z[j] += rq[i, j, t] * w
        for i in range(3):
            g0, g1, g2 = grown_p[at_p, i, 0], grown_p[at_p, i, 1], grown_p[at_p, i, 2]
            for j in range(3):
                left[i, j] = g0 * raw[0, j] + g1 * raw[1, j] + g2 * raw[2, j]
        for i in range(3):
            for j in range(3):
                m[i, j] = (
                    left[i, 0] * grown_q[at_q, 0, j]
                    + left[i, 1] * grown_q[at_q, 1, j]
                    + left[i, 2] * grown_q[at_q, 2, j]
                )
                sums[3 * i + j] += m[i, j]
        keep = at < into.shape[1]
        for i in range(3):
            a = grown_p[at_p, i, 0] * y[0] + grown_p[at_p, i, 1] * y[1] + grown_p[at_p, i, 2] * y[2]
            a += middle_p[at_p, i] - (m[i, 0] * q0 + m[i, 1] * q1 + m[i, 2] * q2) - drift_p[at_p, i]
            b = -(grown_q[at_q, i, 0] * z[0] + grown_q[at_q, i, 1] * z[1] + grown_q[at_q, i, 2] * z[2])
            b += middle_q[at_q, i] - (m[0, i] * p0 + m[1, i] * p1 + m[2, i] * p2) - drift_q[at_q, i]
            sums[9 + i] += a
            sums[12 + i] += b
            if keep:
                into[9 + i, at], into[12 + i, at] = a, b
                for j in range(3):
                    into[3 * i + j, at] = m[i, j]
        at += 1
    for i in range(15):
        sums[i] /= at


@compiled
def _scores(each: Any, rp: Any, op: Any, known_p: Any, rq: Any, oq: Any, known_q: Any, c: Any, into: Any) -> float:
    """What each frame adds to the equations' residuals at c (6,), less the mean, ``into`` (6, n).

    Returned is the root mean square distance between the two images of the joint.
    """
    n = each.shape[1]
    for i in range(3):
        first, second = 0.0, 0.0
        for t in range(n):
            into[i, t] = each[9 + i, t] + each[3 * i, t] * c[3] + each[3 * i + 1, t] * c[4] + each[3 * i + 2, t] * c[5]
            into[3 + i, t] = each[12 + i, t] + each[i, t] * c[0] + each[3 + i, t] * c[1] + each[6 + i, t] * c[2]
            first += into[i, t]
            second += into[3 + i, t]
        for t in range(n):
            into[i, t] -= first / n
            into[3 + i, t] -= second / n
    square = 0.0
    for t in range(known_p.size):
        if known_p[t] and known_q[t]:
            for i in range(3):
                away = rp[i, 0, t] * c[0] + rp[i, 1, t] * c[1] + rp[i, 2, t] * c[2] + op[i, t]
                away -= rq[i, 0, t] * c[3] + rq[i, 1, t] * c[4] + rq[i, 2, t] * c[5] + oq[i, t]
                square += away * away
    return math.sqrt(square / n)
