"""Gaussian laws of the noise of a sample: draws, covariance, and the Cramér-Rao bound under them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from study.sphere.bounds import bound_from_scatter, normal_weights, weighted_scatter
from study.sphere.jit import CHUNK
from study.sphere.types import Floats


class NoiseLaw(Protocol):
    """A law of the noise of a sample, of any size σ."""

    @property
    def isotropic(self) -> bool:
        """True if the covariance is σ² I; estimators then take σ."""

    @property
    def words(self) -> str:
        """The law in words, for a reader."""

    def unit_noise(self, normals: Floats) -> Floats:
        """Noise at σ = 1 (b, d, n), from standard normal numbers of the same shape."""

    def covariance(self, sigma: float) -> Floats:
        """Covariance of a sample (d, d)."""

    def given(self, sigma: float) -> float | Floats:
        """The noise as an argument of estimators: σ, or the covariance (d, d) if it is not isotropic."""

    def unit_bound(self, directions: Floats) -> Floats:
        """The Cramér-Rao bound of (c, r) at σ = 1 for these directions (b, d+1, d+1).

        Args:
            directions: unit vectors (b, d, n), with the height 1 - u₁ in place of u₁.
        """


@dataclass(frozen=True)
class IsotropicGaussian:
    """Independent normal noise of the same size in every coordinate.

    Attributes:
        dimension: number of coordinates d.
    """

    dimension: int
    isotropic = True
    words = "the same noise in all directions"

    def unit_noise(self, normals: Floats) -> Floats:
        """The normal numbers themselves."""
        return normals

    def covariance(self, sigma: float) -> Floats:
        """σ² I."""
        return sigma**2 * np.eye(self.dimension)

    def given(self, sigma: float) -> float:
        """The standard deviation σ."""
        return sigma

    def unit_bound(self, directions: Floats) -> Floats:
        """The bound with equal weights of all samples."""
        return _bound(directions, np.ones((1, CHUNK)))  # a row of n would be read from memory


@dataclass(frozen=True)
class AnisotropicGaussian:
    """Normal noise of any covariance.

    Attributes:
        shape: covariance of a sample in units of σ², as rows of numbers (d, d).
    """

    shape: tuple[tuple[float, ...], ...]
    isotropic = False
    words = "noise not the same in all directions"

    def unit_noise(self, normals: Floats) -> Floats:
        """The normal numbers times Cholesky's root of the shape."""
        return np.asarray(np.linalg.cholesky(self._matrix) @ normals)

    def covariance(self, sigma: float) -> Floats:
        """σ² times the shape."""
        return sigma**2 * self._matrix

    def given(self, sigma: float) -> Floats:
        """The covariance."""
        return self.covariance(sigma)

    def unit_bound(self, directions: Floats) -> Floats:
        """The bound with the weight of each sample by the noise along its direction."""
        u = directions.swapaxes(1, 2).copy()
        u[:, :, 0] = 1.0 - u[:, :, 0]
        return _bound(directions, normal_weights(u, self._matrix))

    @cached_property
    def _matrix(self) -> Floats:
        return np.array(self.shape)


def gaussian(shape: tuple[tuple[float, ...], ...] | None, dimension: int) -> NoiseLaw:
    """The Gaussian law of a covariance.

    Args:
        shape: covariance of a sample in units of σ² (d, d); the identity if None.
        dimension: d.
    """
    if shape is None or np.array_equal(shape, np.eye(dimension)):
        return IsotropicGaussian(dimension)
    return AnisotropicGaussian(shape)


def _bound(directions: Floats, weights: Floats) -> Floats:
    """The bound at σ = 1 of directions (b, d, n) and weights of samples.

    It is exact at tiny angles, because it is formed from heights: the sign of u₁ drops out of the variances,
    and its offset from the mean.
    """
    sums, mean, scatter = weighted_scatter(directions, weights)
    scatter[:, 0, 1:] *= -1.0
    scatter[:, 1:, 0] *= -1.0
    mean[:, 0] = 1.0 - mean[:, 0]
    return bound_from_scatter(sums, mean, scatter)
