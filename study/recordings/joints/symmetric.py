"""The symmetric fit of a joint: the point in which the poses of two segments agree, and the axis of their rotation.

    minimise Σ |R_P c_P + t_P - R_Q c_Q - t_Q|²                                              (SCoRE, Ehrig et al. 2006)

These are six linear equations. Their matrix holds RᵀR = I, which has no noise, and M = mean R_PᵀR_Q, which noise makes
smaller: the mean of a pose whose rotation is uncertain by δ is R (I - B), B = ½ (Tr Cov δ - Cov δ). Multiplication by
I + B corrects for that, as UGDK corrects C for noise. For a hinge both c may slide along the axis together. The
singular vectors of M are that axis in both segments (SARA, Ehrig et al. 2007, in closed form).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from study.arrays import Bools, Floats
from study.fits.jit import compiled
from study.recordings.joints.poses import SegmentPoses
from study.recordings.pose_noise import PatternNoise, long_run_covariance

_SIGNIFICANT = 3.0
"""Standard errors within which a rotation of the axis is noise."""
_STILL = 0.02
"""Radians: segments that rotate by less, root mean square, about every axis show no joint."""
_SHAPE_ERROR = 0.1
"""Relative uncertainty of the variance of the poses' rotations."""


@dataclass(frozen=True)
class SymmetricFit:
    """A joint from the poses of both of its segments.

    Attributes:
        in_parent: c_P (3,), metres.
        in_child: c_Q (3,), metres.
        covariance: of c_P (3, 3), m²: the sandwich over frames in its long-run form, and the error that follows if the
            poses' noise is not what their markers say.
        gap: root mean square distance between the two images of the joint, metres.
        axes: direction that changes least in both segments, in the parent's axes and in the child's (2, 3).
        rms_angles: root mean square angles by which the segments rotate against each other about three axes, that one
            first, radians.
        hinge: True if that direction changes by no more than noise; the two c are then the shortest that agree.
        frames: number of frames used.
        effective_frames: effective number of independent frames.
    """

    in_parent: Floats
    in_child: Floats
    covariance: Floats
    gap: float
    axes: Floats
    rms_angles: Floats
    hinge: bool
    frames: int
    effective_frames: float


def symmetric_fit(parent: SegmentPoses, child: SegmentPoses, known_hinge: bool | None = None) -> SymmetricFit | None:
    """Fit the point in which two segments agree.

    Args:
        parent: poses of one segment.
        child: poses of the other.
        known_hinge: True if the joint is a hinge, False if not, None to decide by the data.

    Returns:
        The fit; None if the segments share fewer than four frames or do not rotate against each other.
    """
    n = int((parent.known & child.known).sum())
    if n < 4:
        return None
    each = np.empty((15, n))
    system = _System(parent, child, 1.0, each)
    s, u, v = system.spectrum()
    # angles that the mean rotation implies: rotation about one axis shrinks the other two
    angles = np.sqrt(np.maximum([s[0] - s[1] - s[2] + 1.0, s[1] - s[0] - s[2] + 1.0, s[2] - s[0] - s[1] + 1.0], 0.0))
    if angles.max() < _STILL:
        return None
    along = np.outer(u, v).ravel() @ each[:9] - s[0]
    error = np.sqrt(long_run_covariance(along[None])[0][0, 0]) / n
    hinge = bool(1.0 - s[0] < _SIGNIFICANT * error) if known_hinge is None else known_hinge
    c, inverse = system.solve(hinge)
    scores = np.empty((6, n))
    gap = _scores(each, _side(parent, 1.0), _side(child, 1.0), c, scores)
    inflated, independent = (inverse @ part @ inverse / n**2 for part in long_run_covariance(scores))
    share = float(np.trace(independent[:3, :3]) / max(np.trace(inflated[:3, :3]), 1e-300))
    doubt = inverse @ (_System(parent, child, 1.0 + _SHAPE_ERROR, np.empty((15, 0))).residual(c))
    return SymmetricFit(
        in_parent=c[:3],
        in_child=c[3:],
        covariance=inflated[:3, :3] + np.outer(doubt[:3], doubt[:3]),
        gap=gap,
        axes=np.stack([u, v]),
        rms_angles=angles,
        hinge=hinge,
        frames=n,
        effective_frames=n * min(share, 1.0),
    )


class _System:
    """The six equations for a size of the poses' noise: mean of c_P - M c_Q = a, and the same for the child.

    ``each`` (15, n) receives the contribution of each frame to M, a and b, in nine, three and three rows, if it has
    room.
    """

    def __init__(self, parent: SegmentPoses, child: SegmentPoses, size: float, each: Floats) -> None:
        means = np.zeros(15)
        _accumulate(_side(parent, size), _side(child, size), each, means)
        self.mean, self.a, self.b = means[:9].reshape(3, 3), means[9:12], means[12:]

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
        """Mean residual of the equations at c (6,)."""
        return np.concatenate([self.a - c[:3] + self.mean @ c[3:], self.b - c[3:] + self.mean.T @ c[:3]])


class _Side(NamedTuple):
    """Poses of one segment, as compiled code takes them; see `SegmentPoses`."""

    rotation: Floats
    origin: Floats
    known: Bools
    noise: PatternNoise


def _side(poses: SegmentPoses, size: float) -> _Side:
    return _Side(poses.rotation, poses.origin, poses.known, poses.noise.of_marker(0.0, size))


@compiled
def _accumulate(parent: _Side, child: _Side, each: Floats, means: Floats) -> None:
    """Put the means (15,) of M, a and b over the frames that both know into ``means``, which start at zero.

    With G = I + B, p and q the centroids and w the vector in the world from R_P p + o_P to R_Q q + o_Q, a frame has

        M = G_P R_PᵀR_Q G_Q,  a = p + G_P R_Pᵀ w - M q - shift,  b = q - G_Q R_Qᵀ w - Mᵀ p - shift.

    Each frame's own go into ``each`` (15, n), if it has room.
    """
    rp, op, known_p, noise_p = parent
    rq, oq, known_q, noise_q = child
    pattern_p, middle_p, grown_p, shift_p = noise_p.pattern, noise_p.centroid, noise_p.expansion, noise_p.mean_shift
    pattern_q, middle_q, grown_q, shift_q = noise_q.pattern, noise_q.centroid, noise_q.expansion, noise_q.mean_shift
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
                means[3 * i + j] += m[i, j]
        keep = at < each.shape[1]
        for i in range(3):
            a = grown_p[at_p, i, 0] * y[0] + grown_p[at_p, i, 1] * y[1] + grown_p[at_p, i, 2] * y[2]
            a += middle_p[at_p, i] - (m[i, 0] * q0 + m[i, 1] * q1 + m[i, 2] * q2) - shift_p[at_p, i]
            b = -(grown_q[at_q, i, 0] * z[0] + grown_q[at_q, i, 1] * z[1] + grown_q[at_q, i, 2] * z[2])
            b += middle_q[at_q, i] - (m[0, i] * p0 + m[1, i] * p1 + m[2, i] * p2) - shift_q[at_q, i]
            means[9 + i] += a
            means[12 + i] += b
            if keep:
                each[9 + i, at], each[12 + i, at] = a, b
                for j in range(3):
                    each[3 * i + j, at] = m[i, j]
        at += 1
    for i in range(15):
        means[i] /= at


@compiled
def _scores(each: Floats, parent: _Side, child: _Side, c: Floats, scores: Floats) -> float:
    """Put each frame's contribution to the residuals at c (6,), less the mean, into ``scores`` (6, n).

    Returns the root mean square distance between the two images of the joint.
    """
    rp, op, known_p, _ = parent
    rq, oq, known_q, _ = child
    n = each.shape[1]
    for i in range(3):
        first, second = 0.0, 0.0
        for t in range(n):
            m0, m1, m2 = each[3 * i, t], each[3 * i + 1, t], each[3 * i + 2, t]
            scores[i, t] = each[9 + i, t] + m0 * c[3] + m1 * c[4] + m2 * c[5]
            scores[3 + i, t] = each[12 + i, t] + each[i, t] * c[0] + each[3 + i, t] * c[1] + each[6 + i, t] * c[2]
            first += scores[i, t]
            second += scores[3 + i, t]
        for t in range(n):
            scores[i, t] -= first / n
            scores[3 + i, t] -= second / n
    square = 0.0
    for t in range(known_p.size):
        if known_p[t] and known_q[t]:
            for i in range(3):
                away = rp[i, 0, t] * c[0] + rp[i, 1, t] * c[1] + rp[i, 2, t] * c[2] + op[i, t]
                away -= rq[i, 0, t] * c[3] + rq[i, 1, t] * c[4] + rq[i, 2, t] * c[5] + oq[i, t]
                square += away * away
    return math.sqrt(square / n)
