"""What every estimator takes and gives: a batch of samples in, a `Fit` with a `Status` out."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import Self

import numpy as np
from scipy import stats

from study.sphere.bounds import bound_from_scatter, noise_covariance, normal_weights, weighted_scatter
from study.sphere.layouts import Placed, extent, form
from study.sphere.linalg import eigenbasis
from study.sphere.moments import Moments
from study.sphere.regression import Regression
from study.sphere.types import Bools, Floats, Ints


class Worded(IntEnum):
    """Numbers as tables store them, each with its words: ``text`` is what a user reads."""

    text: str

    def __new__(cls, value: int, text: str) -> Self:
        member = int.__new__(cls, value)
        member._value_ = value
        member.text = text
        return member


class Status(Worded):
    """How a fit ended."""

    OK = 0, "ok"
    NOT_POSITIVE_DEFINITE = 1, "covariance minus noise is not positive definite: the noise hides the sphere's extent"
    SINGULAR = 2, "the points lie in a plane or a line (or are one point): they leave the centre undetermined"
    NOT_CONVERGED = 3, "the iteration did not converge within its limit of steps"
    AT_BOUND = 4, "the best sphere is a plane: the centre runs away from the points and was stopped at the bound"
    TOO_FEW_POINTS = 5, "fewer than d + 1 points"
    NOT_FINITE = 6, "a coordinate is not finite, or so large that its fourth power is not"
    INSIGNIFICANT = 7, "along some direction the points' extent is within the noise: the centre is unreliable"
    HINGE = 8, "the points lie on an arc or in a plane, within the noise: the centre was taken in their plane"
    FAILED = 9, "the estimator raised an exception, or the worker that ran it died"


def explain(status: int) -> str:
    """What a status code means, in words."""
    return next(member.text for member in Status if member == status)


@dataclass(frozen=True)
class Samples:
    """A batch of point sets as estimators see them, with what several of them share computed once.

    Attributes:
        source: the points, coordinates first (b, d, n), float64, any memory layout; or what they are formed of.
        noise: σ, the same for all sets or one for each (b,), a covariance Σ (d, d), or None if it is not known.
    """

    source: Floats | Placed
    noise: float | Floats | None = None

    @classmethod
    def of_moments(cls, moments: Moments, noise: float | Floats | None = None) -> "Samples":
        """Samples of which only the moments are known: enough for every closed form."""
        return cls.of_regression(Regression.of(moments), noise)

    @classmethod
    def of_regression(cls, regression: Regression, noise: float | Floats | None = None) -> "Samples":
        """Samples of which the closed forms' regression is all that is known."""
        samples = cls(np.empty((*regression.mean.shape, 0)), noise)
        samples.__dict__["regression"] = regression  # in place of the cached property
        return samples

    def only(self, index: int) -> "Samples":
        """One set of the batch."""
        one = slice(index, index + 1)
        noise = self.noise[one] if isinstance(self.noise, np.ndarray) and self.noise.ndim == 1 else self.noise
        _, d, n = self.shape
        if isinstance(self.source, Placed):
            return Samples(form(self.source, np.empty((1, d, n)), index), noise)
        if n or "regression" not in self.__dict__:
            return Samples(self.source[one], noise)
        return Samples.of_regression(self.regression.only(index), noise)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of sets b, dimension d, samples n."""
        return extent(self.source)

    @cached_property
    def x(self) -> Floats:
        """The points, coordinates first (b, d, n)."""
        return form(self.source, np.empty(self.shape)) if isinstance(self.source, Placed) else self.source

    @cached_property
    def rows(self) -> Floats | Placed:
        """The points with each coordinate in a row of memory, for what reads them many times; or what forms them."""
        return self.source if isinstance(self.source, Placed) else np.ascontiguousarray(self.source)

    @property
    def points(self) -> Floats:
        """The points as (b, n, d), for an estimator that prefers them so."""
        return self.x.swapaxes(1, 2)

    @cached_property
    def moments(self) -> Moments:
        """Centred moments of each set."""
        return Moments.of(self.source)

    @cached_property
    def regression(self) -> Regression:
        """What the closed forms know of each set."""
        return Regression.of(self.moments)


@dataclass(frozen=True)
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
        samples: the points that were fitted, which the properties below look at again.
    """

    center: Floats
    radius: Floats
    noise_variance: Floats
    status: Ints
    condition: Floats
    iterations: Ints
    samples: Samples | None = field(default=None, repr=False, compare=False)

    def reshape(self, *lead: int, samples: Samples | None = None) -> "Fit":
        """The same fits with other leading axes, and the points that they belong to."""
        return Fit(
            center=self.center.reshape(*lead, self.center.shape[-1]),
            radius=self.radius.reshape(lead),
            noise_variance=self.noise_variance.reshape(lead),
            status=self.status.reshape(lead),
            condition=self.condition.reshape(lead),
            iterations=self.iterations.reshape(lead),
            samples=samples,
        )

    @cached_property
    def count(self) -> Ints:
        """Samples used (…): rows with a NaN are missing and left out."""
        _, _, present = self._residuals
        return np.asarray(present.sum(axis=1).reshape(self.radius.shape))

    @cached_property
    def residual_rms(self) -> Floats:
        """Root mean square distance of the points from the sphere (…), unit of the points."""
        distance, _, present = self._residuals
        with np.errstate(all="ignore"):
            square = np.where(present, (distance - self.radius.reshape(-1, 1)) ** 2, 0.0).sum(axis=1)
            return np.asarray(np.sqrt(square / present.sum(axis=1)).reshape(self.radius.shape))

    @cached_property
    def covariance(self) -> Floats:
        """Covariance of (ĉ, r̂) (…, d+1, d+1), unit squared.

        It is the Cramér-Rao bound with the estimates plugged in: the noise as given or estimated, and the directions
        in which the points lie from ĉ. It does not know of an estimator's bias (`gdke`, `lls`), nor of the excess of
        one that does not attain the bound; NaN or infinite where it cannot be formed.
        """
        _, directions, present = self._residuals
        b, d, _ = directions.shape
        noise = self._given_noise
        with np.errstate(all="ignore"):
            variance = np.ones(b) if noise is not None else self.noise_variance.reshape(b)
            covariance = np.eye(d) if noise is None else noise_covariance(noise, d)
            weights = np.where(present, normal_weights(directions.swapaxes(1, 2), covariance), 0.0)
            sums, mean, scatter = weighted_scatter(np.where(present[:, None], directions, 0.0), weights)
            bound = bound_from_scatter(sums, mean, scatter) * variance[:, None, None]
        return bound.reshape(*self.radius.shape, d + 1, d + 1)

    @property
    def standard_errors(self) -> Floats:
        """Standard errors of ĉ's components and of r̂ (…, d+1), unit of the points."""
        with np.errstate(all="ignore"):
            return np.asarray(np.sqrt(np.einsum("...ii->...i", self.covariance)))

    def ellipsoid(self, level: float = 0.95) -> Floats:
        """Joint confidence ellipsoid of the centre.

        Args:
            level: nominal coverage, in (0, 1).

        Returns:
            Semi-axes as columns (…, d, d), unit of the points. Their length comes from the χ² distribution where the
            noise was given, and from F with n - d - 1 degrees of freedom where it was estimated.
        """
        d = self.center.shape[-1]
        spare = np.maximum(self.count - d - 1, 1).reshape(-1)
        known = self._given_noise is not None
        scale = np.full(len(spare), stats.chi2.ppf(level, d)) if known else d * stats.f.ppf(level, d, spare)
        values, vectors = eigenbasis(self.covariance[..., :d, :d].reshape(-1, d, d))
        with np.errstate(all="ignore"):  # NaN where the covariance is not finite
            lengths = np.sqrt(np.maximum(values, 0.0) * scale[:, None])
            return np.asarray((vectors * lengths[:, None, :]).reshape(*self.center.shape, d))

    @property
    def _given_noise(self) -> float | Floats | None:
        return None if self.samples is None else self.samples.noise

    @cached_property
    def _residuals(self) -> tuple[Floats, Floats, Bools]:
        """Distances from ĉ (b, n), directions from ĉ (b, d, n), and which samples are not missing (b, n)."""
        if self.samples is None:
            raise ValueError("this fit does not hold its points: use study.fit, which keeps them")
        x = self.samples.x
        with np.errstate(all="ignore"):
            away = x - self.center.reshape(len(x), x.shape[1], 1)
            distance = np.sqrt(np.einsum("bdn,bdn->bn", away, away))
            return distance, away / distance[:, None], np.logical_not(np.isnan(x).any(axis=1))


def blank(batch: int, dimension: int) -> Fit:
    """A fit of NaN throughout, status ok, for an estimator to fill in."""
    # two allocations: five cost more than fitting one small set
    numbers, whole = np.empty(batch * (dimension + 3)), np.zeros((2, batch), dtype=np.int64)
    numbers.fill(np.nan)
    radius, noise_variance, condition = numbers[batch * dimension :].reshape(3, batch)
    return Fit(
        center=numbers[: batch * dimension].reshape(batch, dimension),
        radius=radius,
        noise_variance=noise_variance,
        status=whole[0],
        condition=condition,
        iterations=whole[1],
    )


@dataclass(frozen=True)
class Estimator:
    """An estimator as the registry holds it.

    Attributes:
        function: from samples to a fit. It never raises on data, only on a noise that it cannot use.
        reference: where it comes from.
        needs: what it must be told besides the points.
        flops: floating-point operations per sample in d dimensions, as `study.analysis.cost` counts them.
        flops_of: what they are for, where that is not the whole fit.
        caution: what a user should know beside the answer, whatever its status.
        moments_suffice: whether it looks at ``Samples.moments`` alone.
        by_window: whether all else that it reads comes from `study.sphere.layouts.window`, so that points need not lie
            in memory.
        version: to be raised with every change of its numbers, so that runs do not mix old rows with new ones.
    """

    function: Callable[[Samples], Fit]
    reference: str = ""
    needs: str = ""
    flops: Callable[[int], float] | None = None
    flops_of: str = ""
    caution: str = ""
    moments_suffice: bool = False
    by_window: bool = False
    version: int = 1

    def __call__(self, samples: Samples) -> Fit:
        """Fit."""
        return self.function(samples)
