"""The answer of every estimator: a `Fit`, its errors, and the distances of the points from it."""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from study.estimators.samples import Samples
from study.sphere.bounds import bound_from_scatter, noise_covariance, normal_weights, weighted_scatter
from study.sphere.linalg import eigenbasis
from study.sphere.types import Bools, Floats, Ints


class _Arrays(NamedTuple):
    """The arrays of a `Fit`: the centre, then an entry per point set, floating-point numbers before integers.

    Everything that handles a fit field by field reads this list.
    """

    center: Floats
    radius: Floats
    noise_variance: Floats
    condition: Floats
    status: Ints
    iterations: Ints


_NUMBERS = list(_Arrays.__annotations__.values()).count(Floats) - 1
"""Arrays of one floating-point number per set."""


class Fit(_Arrays):
    """Spheres that an estimator fitted, to one point set or to a batch of them with leading axes `…`.

    Look at ``status`` first: an estimator never raises on data, and a number beside a status other than ok may be of
    no use. The arrays are a named tuple; standard errors and residuals are computed from the points on first use.

    Attributes:
        center: ĉ (…, d), in the unit of the points.
        radius: r̂ (…), in the unit of the points. NaN where no radius is real, which the status then says.
        noise_variance: σ² of one coordinate (…), unit squared: as given to an estimator that uses it (the mean over
            coordinates, for a covariance), else estimated from the residuals. NaN at n = d + 1, which leaves none.
        condition: the paper's Leontief condition ρ (…), the spectral radius of Σ̂C⁻¹, which must be below 1. NaN for
            an estimator that subtracts no noise.
        status: number of the `Status` of each fit (…).
        iterations: steps taken (…); 0 for a closed form.
        samples: the points that were fitted, which the properties below need. `study.fit` sets it.
    """

    samples: Samples | None = None

    def reshape(self, *lead: int, samples: Samples | None = None) -> "Fit":
        """Return the same fits with other leading axes, and with the points that they belong to."""
        center, *others = self
        result = Fit._make([center.reshape(*lead, center.shape[-1]), *(array.reshape(lead) for array in others)])
        result.samples = samples
        return result

    def _replace(self, /, **changes: Any) -> "Fit":
        """Return the same fits with some arrays replaced, and with the points that they belong to."""
        result = super()._replace(**changes)
        result.samples = self.samples
        return result

    @cached_property
    def count(self) -> Ints:  # type: ignore[override]  # a tuple's method, of no use here
        """Number of samples used (…): points with a NaN are missing and left out."""
        _, _, present = self._residuals
        return np.asarray(present.sum(axis=1).reshape(self.radius.shape))

    @cached_property
    def residual_rms(self) -> Floats:
        """Root mean square distance of the points from the sphere (…), in the unit of the points."""
        distance, _, present = self._residuals
        with np.errstate(all="ignore"):
            square = np.where(present, (distance - self.radius.reshape(-1, 1)) ** 2, 0.0).sum(axis=1)
            return np.asarray(np.sqrt(square / present.sum(axis=1)).reshape(self.radius.shape))

    @cached_property
    def covariance(self) -> Floats:
        """Covariance of (ĉ, r̂) (…, d+1, d+1), unit squared.

        It is the Cramér-Rao bound with the estimates plugged in: the noise as given or estimated, and the directions
        of the points from ĉ. It includes neither an estimator's bias (`gdke`, `lls`) nor the excess of one that does
        not attain the bound. NaN or infinite where it cannot be formed.
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
        """Standard errors of ĉ's components and of r̂ (…, d+1), in the unit of the points; see `covariance`."""
        with np.errstate(all="ignore"):
            return np.asarray(np.sqrt(np.einsum("...ii->...i", self.covariance)))

    def ellipsoid(self, level: float = 0.95) -> Floats:
        """Joint confidence ellipsoid of the centre.

        Args:
            level: nominal coverage, in (0, 1).

        Returns:
            Semi-axes as columns (…, d, d), in the unit of the points. Their length comes from the χ² distribution
            where the noise was given, and from F with n - d - 1 degrees of freedom where it was estimated.

        Raises:
            ValueError: if the fit does not hold its points, because it is not from `study.fit`.
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
        """Distances from ĉ (b, n), directions from ĉ (b, d, n), and False for missing samples (b, n)."""
        if self.samples is None:
            raise ValueError("this fit does not hold its points: use study.fit, which stores them in the fit")
        x = self.samples.x
        with np.errstate(all="ignore"):
            away = x - self.center.reshape(len(x), x.shape[1], 1)
            distance = np.sqrt(np.einsum("bdn,bdn->bn", away, away))
            return distance, away / distance[:, None], np.logical_not(np.isnan(x).any(axis=1))


def blank(batch: int, dimension: int) -> Fit:
    """Return fits of NaN with status ok, for an estimator to fill in."""
    # two allocations: one for each array would cost more than fitting one small set
    numbers = np.empty(batch * (dimension + _NUMBERS))
    whole = np.zeros((len(Fit._fields) - _NUMBERS - 1, batch), dtype=np.int64)
    numbers.fill(np.nan)
    rest = numbers[batch * dimension :].reshape(_NUMBERS, batch)
    return Fit(numbers[: batch * dimension].reshape(batch, dimension), *rest, *whole)
