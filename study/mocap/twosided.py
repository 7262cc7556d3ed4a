"""Where two moving frames agree on a point: the symmetric fit of a joint, and the axis that both turn about.

    minimise Σ |R_P c_P + t_P - R_Q c_Q - t_Q|²                                              (SCoRE, Ehrig et al. 2006)

Six linear equations. Their matrix holds RᵀR = I, which has no noise, and M = mean R_PᵀR_Q, which noise makes smaller:
a frame that is uncertain by δ is seen on average as R (I - B), B = ½ (Tr Cov δ - Cov δ). Multiplying by I + B takes
that out, as UGDK takes the noise out of C. For a hinge both c may slide along the axis together; the singular vectors
of M show that axis in both frames (SARA, Ehrig et al. 2007, in closed form).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from study.mocap.segments import Frames
from study.mocap.timeseries import long_run

Floats = NDArray[np.float64]

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
    both = parent.known & child.known
    n = int(both.sum())
    if n < 4:
        return None
    p, q = _Unbiased(parent, both), _Unbiased(child, both)
    raw = np.einsum("jit,jkt->ikt", p.rotation, q.rotation)
    system = _System(p, q, raw, 1.0)
    s, u, v = system.spectrum()
    # by the turns of the mean rotation: about the axis kept, the other two shrink
    turns = np.sqrt(np.maximum([s[0] - s[1] - s[2] + 1.0, s[1] - s[0] - s[2] + 1.0, s[2] - s[0] - s[1] + 1.0], 0.0))
    if turns.max() < _STIFF:
        return None
    along = np.einsum("i,ijt,j->t", u, system.each, v, optimize=True) - s[0]
    hinge = bool(1.0 - s[0] < _CHANCE * np.sqrt(long_run(along[None])[0][0, 0]) / n)
    c, inverse = system.solve(hinge)
    inflated, instant = (inverse @ part @ inverse / n**2 for part in long_run(system.scores(c)))
    share = float(np.trace(instant[:3, :3]) / max(np.trace(inflated[:3, :3]), 1e-300))
    doubt = inverse @ (_System(p, q, raw, 1.0 + _SHAPE).residual(c))
    gap = parent.show(c[:3])[:, both] - child.show(c[3:])[:, both]
    return TwoSided(
        c[:3], c[3:], inflated[:3, :3] + np.outer(doubt[:3], doubt[:3]), float(np.sqrt((gap**2).sum(axis=0).mean())),
        np.stack([u, v]), turns, hinge, n, n * min(share, 1.0),
    )  # fmt: skip


class _Unbiased:
    """What is needed of a frame: rotations, and the points that it turns about, in the world and in its own axes."""

    def __init__(self, frames: Frames, chosen: NDArray[np.bool_]) -> None:
        self.pattern = frames.carried.pattern[chosen]
        self.carried = frames.carried
        self.rotation = frames.rotation[:, :, chosen]
        self.middle = frames.carried.centroid[self.pattern].T
        self.pivot = np.einsum("ijt,jt->it", self.rotation, self.middle) + frames.origin[:, chosen]

    def see(self, size: float, world: Floats) -> Floats:
        """Directions of the world (3, n) in the frame's axes, freed from what noise of this size does to them."""
        y = np.einsum("ijt,it->jt", self.rotation, world)
        return self.grow(size, y)

    def grow(self, size: float, y: Floats) -> Floats:
        """(I + B) y."""
        return np.asarray(np.einsum("tij,jt->it", self.carried.grown(size)[self.pattern], y))

    def drift(self, size: float) -> Floats:
        """Mean of δ × ε̄ (3, n)."""
        return np.asarray(self.carried.drift(size)[self.pattern].T)


class _System:
    """The six equations for a size of the frames' noise: mean of c_P - M c_Q = a, and the same the other way round."""

    def __init__(self, p: _Unbiased, q: _Unbiased, raw: Floats, size: float) -> None:
        left, right = p.carried.grown(size)[p.pattern], q.carried.grown(size)[q.pattern]
        self.each = np.einsum("tij,jkt,tkl->ilt", left, raw, right, optimize=True)
        apart = q.pivot - p.pivot
        self.a = p.middle + p.see(size, apart) - np.einsum("ijt,jt->it", self.each, q.middle) - p.drift(size)
        self.b = q.middle - q.see(size, apart) - np.einsum("jit,jt->it", self.each, p.middle) - q.drift(size)
        self.mean = self.each.mean(axis=2)

    def spectrum(self) -> tuple[Floats, Floats, Floats]:
        """Singular values of M, at most 1, and its first singular vectors."""
        u, s, vt = np.linalg.svd(self.mean)
        return np.minimum(s, 1.0), u[:, 0], vt[0]

    def solve(self, hinge: bool) -> tuple[Floats, Floats]:
        """The two places (6,), and the inverse that gives them (6, 6)."""
        matrix = np.block([[np.eye(3), -self.mean], [-self.mean.T, np.eye(3)]])
        kept = np.linalg.eigh(matrix)[1][:, 1 if hinge else 0 :]
        inverse = kept @ np.linalg.pinv(kept.T @ matrix @ kept) @ kept.T
        return inverse @ np.concatenate([self.a.mean(axis=1), self.b.mean(axis=1)]), inverse

    def residual(self, c: Floats) -> Floats:
        """Mean of what the equations lack (6,)."""
        return np.concatenate(
            [
                self.a.mean(axis=1) - c[:3] + self.mean @ c[3:],
                self.b.mean(axis=1) - c[3:] + self.mean.T @ c[:3],
            ]
        )

    def scores(self, c: Floats) -> Floats:
        """What each frame adds to that (6, n), less the mean."""
        scores = np.concatenate(
            [
                self.a - c[:3, None] + np.einsum("ijt,j->it", self.each, c[3:]),
                self.b - c[3:, None] + np.einsum("jit,j->it", self.each, c[:3]),
            ]
        )
        return np.asarray(scores - scores.mean(axis=1)[:, None])
