"""One centre of several markers from their moments, of many data sets at once: the paper's equation 22, corrected.

    ĉ = [Σ_p w_p (C_p - Σ̂)]⁻¹ Σ_p w_p [(C_p - Σ̂) x̄_p + ½ S_p]                            (paper eq. 22, corrected)

In print the sum closes before ½S_p; both ways of reading it are wrong (theory §2). Moments have divisor n here.
"""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from study.sphere.jit import compiled_as_written
from study.sphere.moments import Moments
from study.sphere.types import Floats

ROUNDS = 5
"""Rounds in which weights, or the noise, are found."""


@compiled_as_written
def add_marker(weight: float, left: Floats, mean: Floats, third: Floats, matrix: Floats, right: Floats) -> None:
    """Add a marker to the normal equations of the corrected eq. 22, matrix · ĉ = right.

    Args:
        weight: w_p.
        left: C_p - Σ̂ (d, d).
        mean: x̄_p (d,), relative to any origin, which the centre then is relative to as well.
        third: S_p (d,).
        matrix: Σ w_p (C_p - Σ̂) (d, d), in place.
        right: Σ w_p [(C_p - Σ̂) x̄_p + ½ S_p] (d,), in place.
    """
    for i in range(len(mean)):
        even = odd = 0.0  # two sums, in the order of NumPy's einsum
        for j in range(len(mean)):
            matrix[i, j] += weight * left[i, j]
            if j % 2 == 0:
                even += left[i, j] * mean[j]
            else:
                odd += left[i, j] * mean[j]
        right[i] += weight * (even + odd + 0.5 * third[i])


@compiled_as_written
def _add_markers(weights: Floats, left: Floats, mean: Floats, third: Floats, matrix: Floats, right: Floats) -> None:
    for b in range(len(matrix)):
        for p in range(len(weights)):
            add_marker(weights[p, b], left[p, b], mean[p, b], third[p, b], matrix[b], right[b])


class MarkersMoments(NamedTuple):
    """Moments of M markers in each of b data sets.

    Attributes:
        n: number of samples of each marker (M, 1).
        mean: x̄ (M, b, d).
        c: covariances with divisor n (M, b, d, d), unit squared.
        s: third moments, means of y|y|² (M, b, d), unit cubed.
        fourth: means of |y|⁴ (M, b), unit to the fourth.
    """

    n: Floats
    mean: Floats
    c: Floats
    s: Floats
    fourth: Floats

    @classmethod
    def of(cls, markers: Sequence[Moments]) -> Self:
        """Stack the moments of the markers, each of the same number of samples in all data sets."""
        n = np.array([m.n[:1] for m in markers])
        return cls(
            n,
            np.array([m.mean for m in markers]),
            np.array([m.second for m in markers]) / n[..., None, None],
            np.array([m.third for m in markers]) / n[..., None],
            np.array([m.fourth for m in markers]) / n,
        )

    def subtracted(self, noise: Floats) -> Floats:
        """Subtract so much from the covariances C_p for a noise of covariance Σ (d, d): (M, b, d, d)."""
        return np.broadcast_to(noise * ((self.n - 1.0) / self.n)[..., None, None], self.c.shape)

    def weights(self, center: Floats) -> Floats:
        """Weights n/r̂² (M, b) for a centre (b, d)."""
        return np.asarray(self.n / np.maximum(self.square_radii(center, np.zeros_like(self.c)), 1e-300))

    def center(self, subtracted: Floats, weights: Floats) -> Floats:
        """Eq. 22, corrected, about the mean of the markers' centroids: ĉ (b, d).

        Args:
            subtracted: what is subtracted from each C (M, b, d, d).
            weights: w_p (M, b).
        """
        _, b, d = self.mean.shape
        origin, matrix, right = self.mean.mean(axis=0), np.zeros((b, d, d)), np.zeros((b, d))
        _add_markers(weights, self.c - subtracted, self.mean - origin, self.s, matrix, right)
        return np.asarray(origin + solved(matrix, right[..., None])[..., 0])

    def known(self, noise: Floats, weighted: bool) -> tuple[Floats, Floats]:
        """Centre ĉ (b, d) for a noise of covariance Σ (d, d), and weights (M, b): n, or n/r̂² if weighted."""
        subtracted, weights = self.subtracted(noise), self.n + np.zeros_like(self.fourth)
        center = self.center(subtracted, weights)
        for _ in range(ROUNDS if weighted else 0):
            weights = self.weights(center)
            center = self.center(subtracted, weights)
        return center, weights

    def square_radii(self, center: Floats, subtracted: Floats) -> Floats:
        """Eq. 23, squared: r̂² (M, b) about a centre (b, d)."""
        away = self.mean - center
        return np.asarray(np.trace(self.c - subtracted, axis1=2, axis2=3) + np.einsum("pbi,pbi->pb", away, away))


def solved(matrix: Floats, right: Floats) -> Floats:
    """Solutions of linear systems (b, d, d) for right-hand sides (b, d, k); the least one of a singular matrix."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:  # to the last bit
        return np.asarray(np.linalg.pinv(matrix) @ right)
