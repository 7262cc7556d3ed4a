"""The noise that a moving frame carries: markers seen from a segment move with that segment's own marker noise, too.

A frame fitted to noisy markers is shifted by ε̄ and turned by δ, so that a point at v from its centroid is seen with
the error ε - ε̄ + v × δ, of covariance

    F(v) = s² I + Cov ε̄ + [v] Cov δ [v]ᵀ - [v] Cov(δ, ε̄) - (…)ᵀ                                               (*)

and, to second order, drawn in by (I - B) v, B = ½ (Tr Cov δ - Cov δ). Both follow from the template's shape alone, up
to the size of the noise. It is neither isotropic nor the same for all samples: four markers on a pelvis turn a thigh's
marker by a tenth of a degree per tenth of a millimetre, and three in a thin triangle far more about its long side. A
sphere fit that takes it for isotropic is biased by centimetres at the knee. Subtracting its covariance sample by sample
is UGDK's own idea (paper eqs 10-17) with a covariance per sample,

    Cov z  -> Σzzᵀ - ΣF,        third moment  -> Σ|z|²z - Σ(2F + Tr F) z,

exact for any symmetric noise.
"""

from dataclasses import dataclass, replace

import numpy as np

from study.sphere.types import Bools, Floats, Ints


@dataclass(frozen=True)
class CarriedNoise:
    """Noise of points fixed in the world, or in another segment, as seen from a moving frame.

    It differs between frames of a recording only by which of the template's points were seen: by their pattern.

    Attributes:
        pattern: number of each frame's pattern (frames,); -1 where the frame is unknown.
        centroid: of the points in each pattern (patterns, 3), metres, in the frame's axes.
        shift: covariance of ε̄ (patterns, 3, 3), m².
        tilt: covariance of δ (patterns, 3, 3), rad².
        cross: covariance of δ with ε̄ (patterns, 3, 3), rad m.
    """

    pattern: Ints
    centroid: Floats
    shift: Floats
    tilt: Floats
    cross: Floats

    @classmethod
    def of(cls, template: Floats, noise: Floats, used: Bools, known: Bools) -> "CarriedNoise":
        """Noise of a template's frame.

        Args:
            template: points (m, 3), metres.
            noise: covariance of each point's own noise (m, 3, 3), m², in the frame's axes.
            used: which points the frame was fitted to (m, frames).
            known: where the frame is known (frames,).
        """
        bits = (np.where(used, 1, 0) << np.arange(len(template))[:, None]).sum(axis=0)
        found, where = np.unique(bits[known], return_inverse=True)
        pattern = np.full(used.shape[1], -1)
        pattern[known] = where
        masks = (found[:, None] >> np.arange(len(template))) & 1
        parts = [_perturbed(template[mask == 1], noise[mask == 1]) for mask in masks]
        centroid, shift, tilt, cross = (
            np.array([part[i] for part in parts]).reshape(-1, *shape)
            for i, shape in enumerate([(3,), (3, 3), (3, 3), (3, 3)])
        )
        return cls(pattern, centroid, shift, tilt, cross)

    def at(self, point: Floats) -> Floats:
        """Covariance (3, 3) with which a point fixed in the frame (3,) is carried along, over all frames; m²."""
        weights = np.bincount(self.pattern[self.pattern >= 0], minlength=len(self.centroid))
        k = skew(np.asarray(point) - self.centroid)
        mixed = k @ self.cross
        each = self.shift + k @ self.tilt @ k.swapaxes(1, 2) - mixed - mixed.swapaxes(1, 2)
        return np.asarray(np.einsum("k,kij->ij", weights / max(weights.sum(), 1), each))

    def grown(self, size: float = 1.0) -> Floats:
        """I + B (patterns, 3, 3): undoes how the turn draws points towards the centroid, on average."""
        trace = np.trace(self.tilt, axis1=1, axis2=2)[:, None, None]
        return np.asarray(np.eye(3) + 0.5 * size * (trace * np.eye(3) - self.tilt))

    def drift(self, size: float = 1.0) -> Floats:
        """Mean of δ × ε̄ (patterns, 3), metres, by which points are seen beside where they are."""
        c = self.cross
        parts = [c[:, 1, 2] - c[:, 2, 1], c[:, 2, 0] - c[:, 0, 2], c[:, 0, 1] - c[:, 1, 0]]
        return size * np.stack(parts, axis=1)

    def loose(self, angle: float) -> Bools:
        """Patterns (patterns,) that leave the turn about some axis uncertain by more than an angle, radians."""
        return np.asarray(np.linalg.eigvalsh(self.tilt)[:, -1] > angle**2)

    def at_frames(self, part: Ints) -> "CarriedNoise":
        """The same in some of the frames."""
        return replace(self, pattern=self.pattern[part])

    def every(self, step: int) -> "CarriedNoise":
        """The same in every so many frames."""
        return replace(self, pattern=self.pattern[::step])

    def without(self, frames: Bools) -> "CarriedNoise":
        """The same, unknown in these frames (frames,)."""
        return replace(self, pattern=np.where(frames, -1, self.pattern))

    @property
    def level(self) -> "CarriedNoise":
        """As if the frame had no noise: what is left is isotropic."""
        none = np.zeros_like(self.tilt)
        return replace(self, shift=none, tilt=none, cross=none)

    @property
    def tilt_angle(self) -> float:
        """Standard deviation of the frame's turn about its worst axis, radians."""
        return float(np.sqrt(np.linalg.eigvalsh(self.tilt)[:, -1].max(initial=0.0)))


def skew(v: Floats) -> Floats:
    """Matrices [v] (…, 3, 3) with [v] w = v × w."""
    result = np.zeros((*v.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        result[..., k, j] = v[..., i]
        result[..., j, k] = -v[..., i]
    return result


def _perturbed(points: Floats, noise: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Centroid, Cov ε̄, Cov δ and Cov(δ, ε̄) of Kabsch's fit to points (k, 3), to first order: δ = I⁻¹ Σ a × ε."""
    centroid = points.mean(axis=0)
    k = skew(points - centroid)
    inverse = np.linalg.pinv(np.einsum("mij,mkj->ik", k, k))
    turned = np.einsum("ij,mjk->mik", inverse, k)
    shift = noise.sum(axis=0) / len(points) ** 2
    tilt = np.einsum("mij,mjk,mlk->il", turned, noise, turned)
    cross = np.einsum("mij,mjk->ik", turned, noise) / len(points)
    return centroid, shift, tilt, cross


def unexplained(points: Floats) -> Floats:
    """What a rigid fit leaves of each point's noise, as the operator (3m, 3m) on the stacked noise (m, 3): I - A A⁺."""
    k = skew(points - points.mean(axis=0))
    design = np.concatenate([np.broadcast_to(np.eye(3), k.shape), -k], axis=2).reshape(-1, 6)
    return np.asarray(np.eye(len(design)) - design @ np.linalg.pinv(design))
