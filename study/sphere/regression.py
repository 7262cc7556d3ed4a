"""Kåsa's regression: what every closed form of the family needs to know of a point set.

With y = x - o for any origin o, the algebraic fit regresses |y|² on y. It needs their means and covariances, and the
answer does not depend on o. From the points themselves o is the centroid, and the covariances are the centred
`Moments`. Where the truth is known o can be the true centre: then they are formed from the errors alone
(`study.sphere.joint_moments`), and so is the answer.
"""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from study.sphere.jit import compiled
from study.sphere.linalg import components_all, diagonalise_all
from study.sphere.moments import Moments
from study.sphere.types import Floats


@compiled
def _central(
    count: Any, second: Any, third: Any, fourth: Any, covariance: Any, cross: Any, variance: Any, square: Any
) -> None:
    """C and S (paper eqs 5 and 6), and variance and mean of |y|², of sums about the centroid."""
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
def _decompose(
    covariance: Any, cross: Any, mean: Any, values: Any, vectors: Any, cross_along: Any, mean_along: Any
) -> None:  # fmt: skip
    diagonalise_all(covariance, values, vectors)
    components_all(vectors, cross, cross_along)
    components_all(vectors, mean, mean_along)


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


@dataclass(frozen=True)
class Regression:
    """Moments of y = x - o and |y|² of a batch of point sets.

    Attributes:
        count: number of samples n of each set (b,).
        origin: o (b, d), in the unit of the points.
        mean: ȳ (b, d).
        covariance: C, the sample covariance of y, in weights of 1/(n - 1), paper eq. 5 (b, d, d).
        cross: its counterpart between y and |y|² (b, d): the paper's S, eq. 6, where ȳ = 0.
        variance: that of |y|², in weights of 1/n (b,).
        square: the mean of |y|², less ``base`` (b,).
        base: r², where it is known and the fits are wanted as errors; else 0.
    """

    count: Floats
    origin: Floats
    mean: Floats
    covariance: Floats
    cross: Floats
    variance: Floats
    square: Floats
    base: Floats

    @classmethod
    def of(cls, moments: Moments) -> "Regression":
        """About the centroids."""
        m, (b, d) = moments, moments.mean.shape
        covariance, cross, variance, square = np.empty((b, d, d)), np.empty((b, d)), np.empty(b), np.empty(b)
        _central(m.count, m.second, m.third, m.fourth, covariance, cross, variance, square)
        return cls(m.count, m.mean, np.zeros((b, d)), covariance, cross, variance, square, np.zeros(b))

    def only(self, index: int) -> "Regression":
        """That of one set of the batch."""
        return Regression(*(getattr(self, each.name)[index : index + 1] for each in fields(self)))

    @cached_property
    def spectrum(self) -> Spectrum:
        """The same in the eigenbasis of C, which several estimators share."""
        values, cross, mean = (np.empty(self.mean.shape) for _ in range(3))
        result = Spectrum(values, np.empty(self.covariance.shape), cross, mean)
        _decompose(self.covariance, self.cross, self.mean, *result)
        return result
