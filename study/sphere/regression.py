"""Kåsa's regression: what every closed form of the family needs to know of a point set.

With y = x - o for any origin o, the algebraic fit regresses |y|² on y. It needs their means and covariances, and the
answer does not depend on o. From the points themselves o is the centroid, and the covariances are the centred
`Moments`. Where the truth is known o can be the true centre: then they are formed from the errors alone
(`study.sphere.joint_moments`), and so is the answer.
"""

from typing import NamedTuple

import numpy as np

from study.sphere.jit import compiled
from study.sphere.linalg import components_all, diagonalise_all
from study.sphere.moments import Moments
from study.sphere.types import Floats


class Regression(NamedTuple):
    """Moments of y = x - o and |y|² of a batch of point sets, in three arrays, which is what a kernel takes.

    Attributes:
        numbers: n, ``variance``, ``square`` and ``base`` of each set (4, b).
        vectors: ``origin``, ``mean`` and ``cross`` (3, b, d).
        covariance: C, the sample covariance of y, in weights of 1/(n - 1), paper eq. 5 (b, d, d).
    """

    numbers: Floats
    vectors: Floats
    covariance: Floats

    @classmethod
    def of(cls, moments: Moments) -> "Regression":
        """Form the regression about the centroids."""
        b, d, _ = moments.second.shape
        result = cls(np.empty((4, b)), np.empty((3, b, d)), np.empty((b, d, d)))
        _central(moments, result)
        return result

    def only(self, index: int) -> "Regression":
        """The regression of one set of the batch."""
        one = slice(index, index + 1)
        return Regression(self.numbers[:, one].copy(), self.vectors[:, one].copy(), self.covariance[one])

    @property
    def n(self) -> Floats:
        """Number of samples of each set (b,)."""
        return np.asarray(self.numbers[0])

    @property
    def variance(self) -> Floats:
        """Variance of |y|², in weights of 1/n (b,)."""
        return np.asarray(self.numbers[1])

    @property
    def square(self) -> Floats:
        """Mean of |y|², less ``base`` (b,)."""
        return np.asarray(self.numbers[2])

    @property
    def base(self) -> Floats:
        """r² (b,), where it is known and the fits are wanted as errors; else 0."""
        return np.asarray(self.numbers[3])

    @property
    def origin(self) -> Floats:
        """The origin o (b, d), in the unit of the points."""
        return np.asarray(self.vectors[0])

    @property
    def mean(self) -> Floats:
        """Mean of y (b, d)."""
        return np.asarray(self.vectors[1])

    @property
    def cross(self) -> Floats:
        """Sample covariance of y and |y|² (b, d): the paper's S, eq. 6, where the mean of y is 0."""
        return np.asarray(self.vectors[2])


class Spectrum(NamedTuple):
    """A regression in the eigenbasis of C.

    Attributes:
        along: eigenvalues of C, ascending, and the components of ``cross`` and ``mean`` along its axes (3, b, d).
        axes: eigenvectors of C (b, d, d), as columns.
    """

    along: Floats
    axes: Floats

    @classmethod
    def of(cls, regression: Regression) -> "Spectrum":
        """Diagonalise C."""
        result = cls(np.empty(regression.vectors.shape), np.empty(regression.covariance.shape))
        _decompose(regression, result)
        return result

    @property
    def values(self) -> Floats:
        """Eigenvalues of C (b, d), ascending."""
        return np.asarray(self.along[0])

    @property
    def cross(self) -> Floats:
        """Components of ``cross`` along the eigenvectors (b, d)."""
        return np.asarray(self.along[1])


@compiled
def _central(moments: Moments, regression: Regression) -> None:
    """C and S (paper eqs 5 and 6), and variance and mean of |y|², of sums about the centroid."""
    second, origin, third = moments.second, moments.vectors[0], moments.vectors[1]
    count, fourth = moments.numbers[0], moments.numbers[1]
    numbers, vectors, covariance = regression
    b, d = third.shape
    for t in range(b):
        n, trace = count[t], 0.0
        for i in range(d):
            trace += second[t, i, i]
            vectors[0, t, i], vectors[1, t, i], vectors[2, t, i] = origin[t, i], 0.0, third[t, i] / (n - 1.0)
            for j in range(d):
                covariance[t, i, j] = second[t, i, j] / (n - 1.0)
        square = trace / n
        numbers[0, t], numbers[1, t], numbers[2, t], numbers[3, t] = n, fourth[t] / n - square * square, square, 0.0


@compiled
def _decompose(regression: Regression, spectrum: Spectrum) -> None:
    along, axes = spectrum
    diagonalise_all(regression.covariance, along[0], axes)
    components_all(axes, regression.vectors[2], along[1])
    components_all(axes, regression.vectors[1], along[2])
