"""The symmetric fit of a joint: the point in which the poses of two segments agree, and the axis of their rotation.

    minimise Σ |R_P c_P + t_P - R_Q c_Q - t_Q|²                                              (SCoRE, Ehrig et al. 2006)

These are six linear equations. Their matrix holds RᵀR = I, which has no noise, and M = mean R_PᵀR_Q, which noise makes
smaller: the mean of a pose whose rotation is uncertain by δ is R (I - B), B = ½ (Tr Cov δ - Cov δ). Multiplication by
I + B corrects for that, as UGDK corrects C for noise. For a hinge both c may slide along the axis together. The
singular vectors of M are that axis in both segments (SARA, Ehrig et al. 2007, in closed form).
"""

from dataclasses import dataclass

import numpy as np

from study.arrays import Bools, Floats
from study.recordings.joints.poses import SegmentPoses
from study.recordings.pose_noise import long_run_covariance, times

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
        normal: matrix of the normal equations of c_P (3, 3), 1 - M Mᵀ: what the rotation shows of it, rad².
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
    normal: Floats
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
    system = _System(parent, child, 1.0)
    s, u, v = system.spectrum()
    # angles that the mean rotation implies: rotation about one axis shrinks the other two
    angles = np.sqrt(np.maximum([s[0] - s[1] - s[2] + 1.0, s[1] - s[0] - s[2] + 1.0, s[2] - s[0] - s[1] + 1.0], 0.0))
    if angles.max() < _STILL:
        return None
    along = np.einsum("i,ijt,j->t", u, system.m, v) - s[0]
    error = np.sqrt(long_run_covariance(along[None])[0][0, 0]) / n
    hinge = bool(1.0 - s[0] < _SIGNIFICANT * error) if known_hinge is None else known_hinge
    c, inverse = system.solve(hinge)
    inflated, independent = (inverse @ part @ inverse / n**2 for part in long_run_covariance(system.scores(c)))
    share = float(np.trace(independent[:3, :3]) / max(np.trace(inflated[:3, :3]), 1e-300))
    doubt = inverse @ _System(parent, child, 1.0 + _SHAPE_ERROR).residual(c)
    apart = parent.to_world(c[:3]) - child.to_world(c[3:])
    return SymmetricFit(
        in_parent=c[:3],
        in_child=c[3:],
        covariance=inflated[:3, :3] + np.outer(doubt[:3], doubt[:3]),
        gap=float(np.sqrt(np.nansum(apart**2) / n)),
        axes=np.stack([u, v]),
        rms_angles=angles,
        hinge=hinge,
        normal=np.eye(3) - system.mean @ system.mean.T,
        frames=n,
        effective_frames=n * min(share, 1.0),
    )


class _System:
    """The six equations for a size of the poses' noise: mean of c_P - M c_Q = a, and the same for the child.

    With G = I + B, p and q the centroids and w the vector in the world from R_P p + o_P to R_Q q + o_Q, a frame has

        M = G_P R_PᵀR_Q G_Q,  a = p + G_P R_Pᵀ w - M q - shift,  b = q - G_Q R_Qᵀ w - Mᵀ p - shift.

    Attributes:
        m, a, b: of the n frames that both know (3, 3, n), (3, n), (3, n).
        mean, mean_a, mean_b: their means.
    """

    def __init__(self, parent: SegmentPoses, child: SegmentPoses, size: float) -> None:
        both = parent.known & child.known
        back_p, p, world_p, shift_p = _side(parent, both, size)
        back_q, q, world_q, shift_q = _side(child, both, size)
        w = world_q - world_p
        self.m = np.einsum("ijt,kjt->ikt", back_p, back_q)
        self.a = p + times(back_p, w) - times(self.m, q) - shift_p
        self.b = q - times(back_q, w) - times(self.m.swapaxes(0, 1), p) - shift_q
        self.mean, self.mean_a, self.mean_b = (part.mean(axis=-1) for part in (self.m, self.a, self.b))

    def spectrum(self) -> tuple[Floats, Floats, Floats]:
        """Singular values of M, at most 1, and its first singular vectors."""
        u, s, vt = np.linalg.svd(self.mean)
        return np.minimum(s, 1.0), u[:, 0], vt[0]

    def solve(self, hinge: bool) -> tuple[Floats, Floats]:
        """The two places (6,), and the inverse that gives them (6, 6)."""
        matrix = np.block([[np.eye(3), -self.mean], [-self.mean.T, np.eye(3)]])
        basis = np.linalg.eigh(matrix)[1][:, 1 if hinge else 0 :]
        inverse = basis @ np.linalg.pinv(basis.T @ matrix @ basis) @ basis.T
        return inverse @ np.concatenate([self.mean_a, self.mean_b]), inverse

    def residual(self, c: Floats) -> Floats:
        """Mean residual of the equations at c (6,)."""
        of_child = self.mean_b - c[3:] + self.mean.T @ c[:3]
        return np.concatenate([self.mean_a - c[:3] + self.mean @ c[3:], of_child])

    def scores(self, c: Floats) -> Floats:
        """Each frame's contribution to the residuals at c (6,), less the mean (6, n)."""
        of_child = self.b + times(self.m.swapaxes(0, 1), c[:3])
        scores = np.concatenate([self.a + times(self.m, c[3:]), of_child])
        return np.asarray(scores - scores.mean(axis=1, keepdims=True))


def _side(poses: SegmentPoses, frames: Bools, size: float) -> tuple[Floats, Floats, Floats, Floats]:
    """G Rᵀ (3, 3, n) of a segment, its centroid in its axes and in the world, and the noise's mean shift (3, n)."""
    rotation, origin = poses.rotation[:, :, frames], poses.origin[:, frames]
    expansion, centroid, shift = (
        poses.noise.in_patterns_of(values, frames)
        for values in (poses.noise.expansion(size), poses.noise.centroid, poses.noise.mean_shift(size))
    )
    back = np.einsum("ijt,kjt->ikt", np.broadcast_to(expansion, rotation.shape), rotation)
    return back, centroid, times(rotation, centroid) + origin, shift
