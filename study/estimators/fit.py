"""What every estimator takes and gives: a batch of samples in, a `Fit` with a `Status` out."""

from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from study.sphere.linalg import eigenbasis
from study.sphere.moments import Moments

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Status(IntEnum):
    """How a fit ended. ``text`` is what a user reads."""

    text: str

    def __new__(cls, value: int, text: str) -> "Status":
        member = int.__new__(cls, value)
        member._value_ = value
        member.text = text
        return member

    OK = 0, "ok"
    NOT_POSITIVE_DEFINITE = 1, "covariance minus noise is not positive definite: the noise hides the sphere's extent"
    SINGULAR = 2, "the points lie in a plane or a line (or are one point): they leave the centre undetermined"
    NOT_CONVERGED = 3, "the iteration did not converge within its limit of steps"
    AT_BOUND = 4, "the best sphere is a plane: the centre runs away from the points and was stopped at the bound"
    TOO_FEW_POINTS = 5, "fewer than d + 1 points"
    NOT_FINITE = 6, "a coordinate is not finite, or so large that its fourth power is not"


@dataclass(frozen=True, slots=True)
class Fit:
    """The answer of an estimator, for one point set or a batch of them (leading axes `…`).

    Attributes:
        center: ĉ (…, d), in the unit of the points.
        radius: r̂ (…). NaN where no radius is real, which only a status other than ok allows.
        noise_variance: σ² of one coordinate (…), unit squared: as given, where the estimator was told (the mean over
            coordinates, for a covariance), else estimated from the residuals. NaN at n = d + 1, which leaves none.
        status: `Status` of each fit (…).
        condition: the paper's Leontief condition ρ (…), the spectral radius of Σ̂C⁻¹, which must be below 1; NaN for
            an estimator that subtracts no noise.
        iterations: steps taken (…); 0 for a closed form.
    """

    center: Floats
    radius: Floats
    noise_variance: Floats
    status: Ints
    condition: Floats
    iterations: Ints


def blank(batch: int, dimension: int) -> Fit:
    """A fit of NaN throughout, status ok, for an estimator to fill in."""
    return Fit(
        center=np.full((batch, dimension), np.nan),
        radius=np.full(batch, np.nan),
        noise_variance=np.full(batch, np.nan),
        status=np.zeros(batch, dtype=np.int64),
        condition=np.full(batch, np.nan),
        iterations=np.zeros(batch, dtype=np.int64),
    )


@dataclass(frozen=True)
class Samples:
    """A batch of point sets as estimators see them, with what several of them share computed once.

    Attributes:
        x: the points, coordinates first (b, d, n), float64, any memory layout.
        noise: σ, a covariance Σ (d, d), or None if it is not known.
    """

    x: Floats
    noise: float | Floats | None = field(default=None)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of sets b, dimension d, samples n."""
        b, d, n = self.x.shape
        return b, d, n

    @property
    def points(self) -> Floats:
        """The points as (b, n, d), for an estimator that prefers them so."""
        return self.x.swapaxes(1, 2)

    @cached_property
    def moments(self) -> Moments:
        """Centred moments of each set."""
        return Moments.of(self.x)

    @cached_property
    def spectrum(self) -> tuple[Floats, Floats]:
        """Eigenvalues (b, d), ascending, and eigenvectors (b, d, d), as columns, of the sample covariance C."""
        return eigenbasis(self.moments.covariance)
