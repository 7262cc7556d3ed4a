"""Joint centres from subsets of a recording's frames: MGDK in batches, and the choice of the frames."""

import numpy as np

from study.estimators.common_center import add_marker
from study.mocap.geometry.range_of_motion import cap_angle
from study.mocap.joints.estimates import Estimate
from study.sphere.jit import compiled
from study.sphere.types import Bools, Floats, Ints

SETS = 4
"""Number of data sets, each a random half of the frames, from which random subsets come."""
_MOST = 0.9
"""Largest share of the smallest eigenvalue that is subtracted as noise."""


class JointSamples:
    """The samples of a joint's markers, with the noise variance and the weights that the whole recording shows.

    Args:
        y: samples of the markers in the parent's axes (M, 3, T), metres.
        used: samples that count (M, T).
        estimate: the joint from the whole recording.

    Attributes:
        noise_variance: σ² of a coordinate; ``weights``: 1/r² of each marker (M,), as in ALS and MGDK.
        condition: ρ, the share of the smallest extent that is noise.
        hinge: True for a hinge; ``least``: its axis, or the direction in which the markers moved least (3,).
        effective_frames: effective number of independent frames; ``autocorrelation_time``: τ, in frames.
        error: standard error of the whole recording's centre, metres.
    """

    def __init__(self, y: Floats, used: Bools, estimate: Estimate) -> None:
        self.y, self.used, self.estimate = np.where(used[:, None], y, 0.0), used, estimate
        self.frames = y.shape[2]
        self.noise_variance, self.weights = self._noise_and_weights()
        values, vectors = np.linalg.eigh(self._pool(np.arange(self.frames)[None])[0][0])
        self.condition = float(self.noise_variance / max(values[0] + self.noise_variance, 1e-300))
        self.hinge = estimate.axis is not None
        self.least = np.asarray(vectors[:, 0] if estimate.axis is None else estimate.axis)
        fitted = estimate.sphere
        self.effective_frames = max(estimate.effective_frames if fitted is None else fitted.effective_frames, 1.0)
        self.autocorrelation_time = max(float(used.any(axis=0).sum()) / self.effective_frames, 1.0)
        covariance = estimate.covariance if fitted is None else fitted.covariance
        self.error = float(np.sqrt(max(np.trace(covariance), 0.0)))

    def _noise_and_weights(self) -> tuple[float, Floats]:
        """Noise variance from the residuals of the whole recording, and the weights 1/r², by iteration."""
        self.noise_variance, self.weights = 0.0, np.ones(len(self.y))
        every_frame = np.arange(self.frames)[None]
        count = self.used.sum(axis=1)
        for _ in range(20):
            center, _ = self.centers(every_frame, None)
            away = ((self.y - center[0][None, :, None]) ** 2).sum(axis=1)
            mean = np.where(self.used, away, 0.0).sum(axis=1) / np.maximum(count, 1)
            variance = (np.where(self.used, away - mean[:, None], 0.0) ** 2).sum(axis=1) / np.maximum(count, 1)
            self.weights = np.where(count > 1, 1.0 / np.maximum(mean, 1e-300), 0.0)
            before, share = self.noise_variance, self.weights * count
            self.noise_variance = 0.0
            least = float(np.linalg.eigvalsh(self._pool(every_frame)[0][0])[0])
            # if noise of the residuals' size would hide the motion, only so much is subtracted that a centre remains
            self.noise_variance = min(float((share @ variance) / (4.0 * (share @ mean))), _MOST * least)
            if abs(self.noise_variance - before) <= 1e-9 * self.noise_variance:
                break
        return self.noise_variance, self.weights

    def causes(self, centers: Floats) -> dict[str, object]:
        """The row of `CaseStudy.joints` for this joint, with what explains its scatter.

        Args:
            centers: from random subsets, with every axis kept (B, 3).
        """
        caps = [
            cap_angle(y, used, self.estimate.center) for y, used in zip(self.y, self.used, strict=True) if used.any()
        ]
        medians = [np.median(part[np.isfinite(part[:, 0])], axis=0) for part in np.split(centers, SETS)]
        apart = [np.linalg.norm(a - b) for a in medians for b in medians]
        spread = np.nanvar(centers, axis=0).sum()
        along = np.nanvar(centers @ self.least) / spread if spread > 0 else np.nan
        return {
            "cap": float(np.degrees(max(caps))),
            "condition": self.condition,
            "hinge": self.hinge,
            "memory": self.autocorrelation_time,
            "worth": self.effective_frames,
            "sets": float(max(apart)),
            "along": float(along),
        }

    def centers(self, index: Ints, axis: Floats | None) -> tuple[Floats, Bools]:
        """Centres by MGDK (B, 3) from the frames of each subset (B, N); True where positive definite (B,).

        With an axis (3,) the fit gives the centre across it, and the mean of the samples the centre along it.
        """
        left, right = self._pool(index)
        basis = np.eye(3) if axis is None else np.linalg.svd(axis[None])[2][1:].T
        reduced = basis.T @ left @ basis
        values = np.linalg.eigvalsh(reduced)
        fine = values[:, 0] > 0.0
        reduced[~fine] = np.eye(basis.shape[1])
        if axis is None:
            found = np.linalg.solve(reduced, right[:, :, None])[:, :, 0]
        else:
            middle = self._mean(index) @ np.outer(axis, axis)
            shifted = right - np.einsum("bij,bj->bi", left, middle)
            found = middle + np.linalg.solve(reduced, (shifted @ basis)[:, :, None])[:, :, 0] @ basis.T
        found[~fine] = np.nan
        return np.asarray(found), np.asarray(fine)

    def effective(self, number: int) -> float:
        """N_eff of this many random frames."""
        return float(number / (1.0 + (number - 1) * (self.autocorrelation_time - 1.0) / max(self.frames - 1, 1)))

    def _mean(self, index: Ints) -> Floats:
        """Mean of the samples of all markers (B, 3)."""
        count = self.used[:, index].sum(axis=(0, 2))
        return np.asarray(self.y[:, :, index].sum(axis=(0, 3)).T / np.maximum(count, 1)[:, None])

    def _pool(self, index: Ints) -> tuple[Floats, Floats]:
        """Σ w n (C - σ²I) / Σ w n (B, 3, 3), and the same of (C - σ²I) x̄ + ½S (B, 3), for frames (B, N)."""
        left, right = np.zeros((len(index), 3, 3)), np.zeros((len(index), 3))
        _pool(self.y, self.used, self.weights, self.noise_variance, index, left, right)
        return left, right


@compiled
def _pool(y: Floats, used: Bools, weights: Floats, variance: float, index: Ints, left: Floats, right: Floats) -> None:
    """Add the sums of `JointSamples._pool` to ``left`` (B, 3, 3) and ``right`` (B, 3), which are zero."""
    mean, c, s = np.empty(3), np.empty((3, 3)), np.empty(3)
    for b in range(index.shape[0]):
        total = 0.0
        for p in range(y.shape[0]):
            n = 0.0
            for i in range(3):
                mean[i], s[i] = 0.0, 0.0
                for j in range(3):
                    c[i, j] = 0.0
            for t in index[b]:
                if used[p, t]:
                    n += 1.0
                    for i in range(3):
                        mean[i] += y[p, i, t]
            if n < 2.0:
                continue
            for i in range(3):
                mean[i] /= n
            for t in index[b]:
                if used[p, t]:
                    d0, d1, d2 = y[p, 0, t] - mean[0], y[p, 1, t] - mean[1], y[p, 2, t] - mean[2]
                    square = d0 * d0 + d1 * d1 + d2 * d2
                    c[0, 0] += d0 * d0
                    c[0, 1] += d0 * d1
                    c[0, 2] += d0 * d2
                    c[1, 1] += d1 * d1
                    c[1, 2] += d1 * d2
                    c[2, 2] += d2 * d2
                    s[0] += square * d0
                    s[1] += square * d1
                    s[2] += square * d2
            c[1, 0], c[2, 0], c[2, 1] = c[0, 1], c[0, 2], c[1, 2]
            for i in range(3):
                s[i] /= n - 1.0
                for j in range(3):
                    c[i, j] = c[i, j] / (n - 1.0) - (variance if i == j else 0.0)
            total += weights[p] * n
            add_marker(weights[p] * n, c, mean, s, left[b], right[b])
        total = max(total, 1e-300)
        for i in range(3):
            right[b, i] /= total
            for j in range(3):
                left[b, i, j] /= total


def subset_frames(way: str, seen: Ints, number: int, subsets: int, rng: np.random.Generator) -> Ints:
    """Choose the frames of each subset (subsets, N).

    Args:
        way: ``random``, for random frames of a random half, or ``window``, for consecutive ones.
        seen: the frames to choose from.
        number: N; at most half of them.
        subsets: number of subsets.
        rng: the generator.
    """
    number = min(number, len(seen) // 2) or 1
    if way == "window":
        starts = rng.integers(0, len(seen) - number + 1, subsets)
        return np.asarray(seen[starts[:, None] + np.arange(number)])
    parts = []
    for _ in range(SETS):
        half = rng.permutation(seen)[: max(len(seen) // 2, number)]
        parts += [rng.choice(half, number, replace=False) for _ in range(subsets // SETS)]
    return np.stack(parts)
