"""Joint centres from parts of a recording: batches of MGDK on subsets of the frames, and how the frames are chosen."""

from typing import Any

import numpy as np

from study.mocap.geometry.range_of_motion import cap_angle
from study.mocap.joints.estimates import Estimate
from study.sphere.jit import compiled
from study.sphere.types import Bools, Floats, Ints

SETS = 4
"""Data sets, each a random half of the frames, from which random subsets come."""
_MOST = 0.9
"""Share of the least extent that is taken off as noise, at most."""


class Whole:
    """A joint's samples (M, 3, T), and what the whole recording says of it."""

    def __init__(self, y: Floats, used: Bools, estimate: Estimate) -> None:
        self.y, self.used, self.estimate = np.where(used[:, None], y, 0.0), used, estimate
        self.frames = y.shape[2]
        self.noise, self.weights = 0.0, np.ones(len(y))
        everything = np.arange(self.frames)[None]
        for _ in range(20):  # the noise of residuals and the weights 1/r², as `als` and MGDK have them
            center, _ = self.centers(everything, None)
            away = ((self.y - center[0][None, :, None]) ** 2).sum(axis=1)
            count = used.sum(axis=1)
            mean = np.where(used, away, 0.0).sum(axis=1) / np.maximum(count, 1)
            variance = (np.where(used, away - mean[:, None], 0.0) ** 2).sum(axis=1) / np.maximum(count, 1)
            self.weights = np.where(count > 1, 1.0 / np.maximum(mean, 1e-300), 0.0)
            before, share = self.noise, self.weights * count
            self.noise = 0.0
            least = float(np.linalg.eigvalsh(self._pool(everything)[0][0])[0])
            # where the residuals say that noise hides the motion, as much is taken off as leaves a centre
            self.noise = min(float((share @ variance) / (4.0 * (share @ mean))), _MOST * least)
            if abs(self.noise - before) <= 1e-9 * self.noise:
                break
        values, vectors = np.linalg.eigh(self._pool(everything)[0][0])
        self.condition = float(self.noise / max(values[0] + self.noise, 1e-300))
        self.hinge = estimate.axis is not None
        self.least = np.asarray(vectors[:, 0] if estimate.axis is None else estimate.axis)
        fitted = estimate.sphere
        self.worth = max(estimate.worth if fitted is None else fitted.worth, 1.0)
        self.memory = max(float(used.any(axis=0).sum()) / self.worth, 1.0)
        covariance = estimate.covariance if fitted is None else fitted.covariance
        self.error = float(np.sqrt(max(np.trace(covariance), 0.0)))

    def about(self, number: int, answers: dict[tuple[str, bool, int], Floats]) -> dict[str, object]:
        """What explains how it scatters."""
        caps = [
            cap_angle(y, used, self.estimate.center) for y, used in zip(self.y, self.used, strict=True) if used.any()
        ]
        plain = answers["random", False, number]
        means = [np.median(part[np.isfinite(part[:, 0])], axis=0) for part in np.split(plain, SETS)]
        apart = [np.linalg.norm(a - b) for a in means for b in means]
        spread = np.nanvar(plain, axis=0).sum()
        along = np.nanvar(plain @ self.least) / spread if spread > 0 else np.nan
        return {
            "cap": float(np.degrees(max(caps))),
            "condition": self.condition, "hinge": self.hinge, "memory": self.memory,
            "worth": self.worth, "sets": float(max(apart)), "along": float(along),
        }  # fmt: skip

    def _pool(self, index: Ints) -> tuple[Floats, Floats]:
        """Σ w n (C - σ²I) / Σ w n (B, 3, 3), and the same of (C - σ²I) x̄ + ½S (B, 3), for frames (B, N)."""
        left, right = np.zeros((len(index), 3, 3)), np.zeros((len(index), 3))
        _pool(self.y, self.used, self.weights, self.noise, index, left, right)
        return left, right

    def centers(self, index: Ints, axis: Floats | None) -> tuple[Floats, Bools]:
        """MGDK's centres (B, 3) of frames (B, N), and which are positive definite (B,).

        With an axis (3,) the centre is found across it, and the mean of the samples along it.
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
            middle = self._middle(index) @ np.outer(axis, axis)
            shifted = right - np.einsum("bij,bj->bi", left, middle)
            found = middle + np.linalg.solve(reduced, (shifted @ basis)[:, :, None])[:, :, 0] @ basis.T
        found[~fine] = np.nan
        return np.asarray(found), np.asarray(fine)

    def _middle(self, index: Ints) -> Floats:
        """Mean of all markers' samples (B, 3)."""
        count = self.used[:, index].sum(axis=(0, 2))
        return np.asarray(self.y[:, :, index].sum(axis=(0, 3)).T / np.maximum(count, 1)[:, None])

    def effective(self, number: int) -> float:
        """N_eff of so many random frames."""
        return float(number / (1.0 + (number - 1) * (self.memory - 1.0) / max(self.frames - 1, 1)))


@compiled
def _pool(y: Any, used: Any, weights: Any, noise: float, index: Any, left: Any, right: Any) -> None:
    """`Whole._pool` into ``left`` (B, 3, 3) and ``right`` (B, 3), which are zero."""
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
            weight = weights[p] * n
            total += weight
            for i in range(3):
                for j in range(3):
                    entry = c[i, j] / (n - 1.0) - (noise if i == j else 0.0)
                    left[b, i, j] += weight * entry
                    right[b, i] += weight * entry * mean[j]
                right[b, i] += weight * 0.5 * s[i] / (n - 1.0)
        total = max(total, 1e-300)
        for i in range(3):
            right[b, i] /= total
            for j in range(3):
                left[b, i, j] /= total


def taken(way: str, seen: Ints, number: int, subsets: int, rng: np.random.Generator) -> Ints:
    """Frames of each subset (subsets, N): random ones of a random half, or ones that follow each other."""
    number = min(number, len(seen) // 2) or 1
    if way == "window":
        starts = rng.integers(0, len(seen) - number + 1, subsets)
        return np.asarray(seen[starts[:, None] + np.arange(number)])
    parts = []
    for _ in range(SETS):
        half = rng.permutation(seen)[: max(len(seen) // 2, number)]
        parts += [rng.choice(half, number, replace=False) for _ in range(subsets // SETS)]
    return np.stack(parts)
