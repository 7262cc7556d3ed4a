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
    """Moments of y = x - o and |y|² of a batch of point sets.

    Attributes:
        n: number of samples of each set (b,).
        origin: o (b, d), in the unit of the points.
        mean: ȳ (b, d).
        covariance: C, the sample covariance of y, in weights of 1/(n - 1), paper eq. 5 (b, d, d).
        cross: sample covariance of y and |y|² (b, d): the paper's S, eq. 6, where ȳ = 0.
        variance: variance of |y|², in weights of 1/n (b,).
        square: mean of |y|², less ``base`` (b,).
        base: r² (b,), where it is known and the fits are wanted as errors; else 0.
    """

    n: Floats
    origin: Floats
    mean: Floats
    covariance: Floats
    cross: Floats
    variance: Floats
    square: Floats
    base: Floats

    @classmethod
    def of(cls, moments: Moments) -> "Regression":
        """Form the regression about the centroids."""
        b, d = moments.mean.shape
        covariance, cross, variance, square = np.empty((b, d, d)), np.empty((b, d)), np.empty(b), np.empty(b)
        result = cls(moments.n, moments.mean, np.zeros((b, d)), covariance, cross, variance, square, np.zeros(b))
        _central(moments, result)
        return result

    def only(self, index: int) -> "Regression":
        """The regression of one set of the batch."""
        return Regression(*(part[index : index + 1] for part in self))


class Spectrum(NamedTuple):
    """A regression in the eigenbasis of C.

    Attributes:
        values: eigenvalues of C (b, d), ascending.
        vectors: eigenvectors (b, d, d), as columns.
        cross: components of ``cross`` along them (b, d).
        mean: components of ``mean`` along them (b, d).
    """

    values: Floats
    vectors: Floats
    cross: Floats
    mean: Floats

    @classmethod
    def of(cls, regression: Regression) -> "Spectrum":
        """Diagonalise C."""
        values, cross, mean = (np.empty(regression.mean.shape) for _ in range(3))
        result = cls(values, np.empty(regression.covariance.shape), cross, mean)
        _decompose(regression, result)
        return result


@compiled
def _central(moments: Moments, regression: Regression) -> None:
    """C and S (paper eqs 5 and 6), and variance and mean of |y|², of sums about the centroid."""
    count, _, second, third, fourth = moments
    _, _, _, covariance, cross, variance, square, _ = regression
    b, d = third.shape
    for t in range(b):
        n, trace = count[t], 0.0
        for i in range(d):
            trace += second[t, i, i]
            cross[t, i] = third[t, i] / (n - 1.0)
            for j in range(d):
                covariance[t, i, j] = second[t, i, j] / (n - 1.0)
        square[t] = trace / n
        variance[t] = fourth[t] / n - square[t] * square[t]


@compiled
def _decompose(regression: Regression, spectrum: Spectrum) -> None:
    diagonalise_all(regression.covariance, spectrum.values, spectrum.vectors)
    components_all(spectrum.vectors, regression.cross, spectrum.cross)
    components_all(spectrum.vectors, regression.mean, spectrum.mean)
