"""Input of every estimator: a batch of point sets, with moments that estimators share computed once."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from study.sphere.layouts import Placed, extent, form
from study.sphere.moments import Moments
from study.sphere.regression import Regression, Spectrum
from study.sphere.types import Floats, Ints


@dataclass(frozen=True)
class Samples:
    """A batch of point sets.

    Attributes:
        source: the points, coordinates first (b, d, n), float64, any memory layout; or the draws they are formed from.
        noise: σ, one for all sets or one for each (b,), a covariance Σ (d, d), or None if it is not known.
        lent: True if the points are in an array of the caller's, who may have changed them since.
    """

    source: Floats | Placed
    noise: float | Floats | None = None
    lent: bool = False

    @classmethod
    def of_moments(cls, moments: Moments, noise: float | Floats | None = None) -> "Samples":
        """Samples of which only the moments are known: enough for every closed form."""
        return cls.of_regression(Regression.of(moments), noise)

    @classmethod
    def of_regression(cls, regression: Regression, noise: float | Floats | None = None) -> "Samples":
        """Samples of which only the closed forms' regression is known."""
        samples = cls(np.empty((*regression.mean.shape, 0)), noise)
        samples.__dict__["regression"] = regression  # in place of the cached property
        return samples

    def only(self, index: int) -> "Samples":
        """One set of the batch."""
        one = slice(index, index + 1)
        noise = self._noise_of(one)
        _, d, n = self.shape
        if isinstance(self.source, Placed):
            return Samples(form(self.source, np.empty((1, d, n)), index), noise)
        if n or "regression" not in self.__dict__:
            return self._part(self.source[one], noise, np.array([index]))
        return Samples.of_regression(self.regression.only(index), noise)

    def take(self, places: Ints) -> "Samples":
        """Some sets of the batch, by their places (k,)."""
        if len(places) == 1:
            return self.only(int(places[0]))
        return self._part(self.x[places], self._noise_of(places), places)

    def unchanged(self) -> "Samples":
        """These samples.

        Raises:
            ValueError: if they are lent, and their moments are no longer those that were computed first.
        """
        if self.lent and not all(map(np.array_equal, self.moments, Moments.of(self.source))):
            raise ValueError(
                "the points have changed since they were fitted: the fit reads them from your array; use copy=True"
            )
        return self

    def _part(self, source: Floats, noise: float | Floats | None, places: Ints) -> "Samples":
        """Some sets; if they are lent, with the moments that they had."""
        part = Samples(source, noise, self.lent)
        if self.lent:
            numbers, vectors, second = self.moments
            part.__dict__["moments"] = Moments(numbers[:, places], vectors[:, places], second[places])
        return part

    def _noise_of(self, places: slice | Ints) -> float | Floats | None:
        """The noise of some sets."""
        return self.noise[places] if isinstance(self.noise, np.ndarray) and self.noise.ndim == 1 else self.noise

    def by_count(self) -> Iterator[tuple[Ints, "Samples"]]:
        """Sets with equally many samples that are not missing: their places (k,), and those samples (k, d, count)."""
        present = np.logical_not(np.isnan(self.x).any(axis=1))
        count = present.sum(axis=1)
        for n in np.unique(count):
            sets = np.flatnonzero(count == n)
            if n == self.shape[2] and len(sets) == len(count):
                yield sets, self
            else:
                complete = [np.ascontiguousarray(self.x[t][:, present[t]]) for t in sets]
                yield sets, Samples(np.stack(complete), self._noise_of(sets))

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
        """The points with each coordinate in a row of memory, for kernels that read them many times; or the draws."""
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
        """Covariances from which the closed forms are computed."""
        return Regression.of(self.moments)

    @cached_property
    def spectrum(self) -> Spectrum:
        """The regression in the eigenbasis of C."""
        return Spectrum.of(self.regression)
