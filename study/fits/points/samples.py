"""The records of every fit: point sets with their shared moments, estimates, statuses and covariances.

`Samples` is a batch of point sets; what several estimators need of it is computed once. `Estimates` are the arrays that
an estimator fills in, with a `Status` for each set, and `Estimator` is its line in the registry. Sets with missing
samples, or so large or small that their powers leave float64, are prepared by `careful_fit`. Covariances are the
Cramér-Rao bound with the estimates plugged in, or an estimator's own rule. Points that repeat another one count once.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from scipy.special import chdtri, fdtri

from study.arrays import Bools, Floats, Ints
from study.fits.loops.linalg import eigenbasis
from study.fits.points.information import bound_from_scatter, normal_weights, weighted_scatter
from study.fits.points.moments import Moments, Regression
from study.fits.points.noise import unit_covariance


class Estimates(NamedTuple):
    """Results of a batch of fits: the centres, then arrays with a number per point set, floating-point ones first.

    An estimator returns them. Everything that handles fits field by field reads this list.

    Attributes:
        center: ĉ (b, d), in the unit of the points.
        radius: r̂ (b,), in the unit of the points. NaN where no radius is real, which the status then says.
        noise_variance: σ² of one coordinate (b,), unit squared: as given to an estimator that uses it (the mean over
            coordinates, for a covariance), else estimated from the residuals. NaN at n = d + 1, which leaves none.
        condition: the paper's Leontief condition ρ (b,), the spectral radius of Σ̂C⁻¹, which must be below 1. NaN for
            an estimator that subtracts no noise.
        status: number of the `Status` of each fit (b,).
        iterations: steps taken (b,); 0 for a closed form.

    Examples:
        >>> import numpy as np, study
        >>> circle = study.Samples(np.array([[[1.0, 0, -1, 0], [0, 1, 0, -1]]]))
        >>> estimates = study.ESTIMATORS["gdke"](circle)
        >>> estimates.radius, estimates.status
        (array([1.]), array([0]))
    """

    center: Floats
    radius: Floats
    noise_variance: Floats
    condition: Floats
    status: Ints
    iterations: Ints

    def reshape(self, *lead: int) -> "Estimates":
        """Return the same numbers with other leading axes."""
        center, *others = self
        return Estimates._make([center.reshape(*lead, center.shape[-1]), *(array.reshape(lead) for array in others)])


_NUMBERS = list(Estimates.__annotations__.values()).count(Floats) - 1
"""Arrays of one floating-point number per set."""


def blank(batch: int, dimension: int) -> Estimates:
    """Return estimates of NaN with status ok, for an estimator to fill in."""
    # two allocations: one for each array would cost more than fitting one small set
    numbers = np.empty(batch * (dimension + _NUMBERS))
    whole = np.zeros((len(Estimates._fields) - _NUMBERS - 1, batch), dtype=np.int64)
    numbers.fill(np.nan)
    rest = numbers[batch * dimension :].reshape(_NUMBERS, batch)
    return Estimates(numbers[: batch * dimension].reshape(batch, dimension), *rest, *whole)


def remove(fit: Estimates, lost: Bools) -> Estimates:
    """Take the numbers of lost fits (b,) out; their status stays."""
    for numbers in (fit.center, fit.radius, fit.noise_variance, fit.condition):
        numbers[lost] = np.nan
    return fit


class StatedRadius(NamedTuple):
    """Stated radii r₀ (b,), and their standard uncertainties τ (b,)."""

    radius: Floats
    uncertainty: Floats


class Given(NamedTuple):
    """Knowledge beforehand of a batch, beside the weights of its points: radii, and the size of the noise.

    Attributes:
        radius: r of each set (b,), NaN where it is not known.
        size: noise variance of a point of weight 1 (b,), as it was given; NaN where none was.
        relative: only ratios of the noise are known.
        covariances: of each point in units of ``size`` (b, n, d, d), with the trace d over its weight; None where the
            noise is isotropic.
        prior: stated radii with their uncertainties, of which ``radius`` is what points and statement give together;
            None where a radius is exact or not known.
        radial: the noise is along the radius alone.
    """

    radius: Floats
    size: Floats
    relative: bool = False
    covariances: Floats | None = None
    prior: StatedRadius | None = None
    radial: bool = False

    def of(self, sets: Ints, present: Bools | None = None) -> "Given":
        """Part of the batch, and of its points if (b, n) says which ones."""
        covariances, prior = self.covariances, self.prior
        if covariances is not None:
            covariances = covariances[sets] if present is None else _chosen(covariances, sets, present)
        prior = None if prior is None else StatedRadius(*(array[sets] for array in prior))
        return Given(self.radius[sets], self.size[sets], self.relative, covariances, prior, self.radial)

    def scaled(self, power: int) -> "Given":
        """Knowledge of points times 2^power."""
        prior = None if self.prior is None else StatedRadius(*(np.ldexp(array, power) for array in self.prior))
        return self._replace(radius=np.ldexp(self.radius, power), size=np.ldexp(self.size, 2 * power), prior=prior)


def _chosen(array: Floats, sets: Ints, present: Bools) -> Floats:
    """The entries of the points (b, n, …) that are present, of sets with equally many: (k, count, …)."""
    shape = len(sets), int(present[sets[0]].sum()), *array.shape[2:]
    return np.asarray(array[sets][present[sets]].reshape(shape))


@dataclass(frozen=True, eq=False)
class Samples:
    """A batch of point sets, with what is known of them.

    Attributes:
        x: the points, coordinates first (b, d, n), float64, any memory layout.
        noise: σ, one for all sets or one for each (b,), a covariance Σ (d, d), or None if it is not known.
        lent: True if the points are in an array of the caller's, who may have changed them since.
        weights: one over the noise variance of each point, but for a factor of each set (b, n); None if all are equal.
        given: knowledge of the radius, of the size of the noise or of its law; None if there is none.
        formed: their moments or regression, if these are known already.

    Examples:
        A batched estimator of one's own reads them; see `study.register`.

        >>> import numpy as np, study
        >>> samples = study.Samples(np.array([[[1.0, 0, -1, 0], [0, 1, 0, -1]]]), noise=0.1)
        >>> samples.shape, samples.x.mean(axis=2), samples.noise
        ((1, 2, 4), array([[0., 0.]]), 0.1)
    """

    x: Floats
    noise: float | Floats | None = None
    lent: bool = False
    weights: Floats | None = None
    given: Given | None = None
    formed: Moments | Regression | None = None

    @classmethod
    def of_regression(cls, regression: Regression, noise: float | Floats | None = None) -> "Samples":
        """Samples of which only the regression is known, as from their moments: enough for every closed form."""
        return cls(np.empty((*regression.mean.shape, 0)), noise, formed=regression)

    def only(self, index: int) -> "Samples":
        """One set of the batch."""
        return self.take(np.array([index]))

    def take(self, places: Ints) -> "Samples":
        """Sets of the batch, by their places (k,); if the points are lent, with the moments that they had."""
        noise = self._noise_of(places)
        if isinstance(self.formed, Regression):
            return Samples.of_regression(self.formed.take(places), noise)
        one = len(places) == 1  # of which the array need not be copied
        weights = None if self.weights is None else self.weights[places]
        given, moments = None if self.given is None else self.given.of(places), None
        if self.lent:
            numbers, vectors, second = self.moments
            moments = Moments(numbers[:, places], vectors[:, places], second[places])
        x = self.x[int(places[0]) :][:1] if one else self.x[places]
        return Samples(x, noise, self.lent, weights, given, moments)

    def rows_at(self, places: Ints) -> "Samples":
        """Some points of every set, by their places (k,)."""
        weights = None if self.weights is None else self.weights[:, places]
        return Samples(np.ascontiguousarray(self.x[:, :, places]), self.noise, weights=weights)

    def without(self, points: Bools) -> "Samples":
        """The samples, of which some points (b, n) are missing."""
        return Samples(np.where(points[:, None], np.nan, self.x), self.noise, False, self.weights, self.given)

    def with_radius(self, radius: Floats) -> "Samples":
        """The samples with known radii (b,), NaN where they are not known."""
        given = Given(radius, np.full(len(radius), np.nan)) if self.given is None else self.given
        return replace(self, given=given._replace(radius=radius))

    def with_ratios(self) -> "Samples":
        """The samples with the ratios of their noise alone: neither its size nor the radius is known."""
        if self.given is None:
            return self
        unknown = np.full(len(self.x), np.nan)
        return replace(self, given=self.given._replace(radius=unknown, relative=True, covariances=None))

    @property
    def p(self) -> Floats:
        """Weights of the points (b, n), 1 where all are equal."""
        return np.ones((len(self.x), self.shape[2])) if self.weights is None else self.weights

    @property
    def radius(self) -> Floats:
        """Known radii (b,), NaN where they are not known."""
        return np.full(len(self.x), np.nan) if self.given is None else self.given.radius

    @property
    def stated(self) -> StatedRadius | None:
        """Radii that are stated with an uncertainty."""
        return None if self.given is None else self.given.prior

    @property
    def scale(self) -> Floats:
        """Known noise variances of a point of weight 1 (b,), NaN where they are not known."""
        unknown = self.given is None or self.given.relative
        return np.full(len(self.x), np.nan) if unknown else self.given.size  # type: ignore[union-attr]

    @property
    def radial(self) -> bool:
        """True if the noise is known to be along the radius alone."""
        return self.given is not None and self.given.radial

    @property
    def sigma_alone(self) -> bool:
        """True if the noise of all points is known, and nothing else: centre and radius are those without it."""
        alone = self.given is not None and self.weights is None and not self.given.radial
        return alone and not np.isfinite(self.radius).any() and bool(np.isfinite(self.scale).any())

    @property
    def even(self) -> Bools:
        """True for sets (b,) whose points have equal noise of unknown size: as if none were given."""
        if self.given is None or self.given.covariances is not None or self.given.radial:
            return np.full(len(self.x), self.given is None and self.weights is None)
        if self.weights is None:
            return np.isnan(self.scale)
        present = np.logical_not(np.isnan(self.x).any(axis=1))
        first = self.weights[np.arange(len(present)), present.argmax(axis=1)]
        return np.asarray(((self.weights == first[:, None]) | ~present).all(axis=1) & np.isnan(self.scale))

    @property
    def nothing_known(self) -> Bools:
        """True for sets (b,) that are fitted as points of which nothing is known."""
        return self.even & np.isnan(self.radius)

    def unchanged(self) -> "Samples":
        """These samples.

        Raises:
            ValueError: if they are lent, and their moments are no longer those that were computed first.
        """
        if self.lent and not all(map(np.array_equal, self.moments, Moments.of(self.x))):
            raise ValueError(
                "the points have changed since they were fitted: the fit reads them from your array; use copy=True"
            )
        return self

    def _noise_of(self, places: Ints) -> float | Floats | None:
        """The noise of some sets."""
        return self.noise[places] if isinstance(self.noise, np.ndarray) and self.noise.ndim == 1 else self.noise

    def by_count(self) -> Iterator[tuple[Ints, "Samples"]]:
        """Sets with equally many samples that are not missing: their places (k,), and those samples (k, d, count).

        Of each part the same is known: sets of which nothing is known are samples without weights and knowledge.
        """
        if self.given is None and np.isfinite(self.moments.fourth).all():  # none is missing
            yield np.arange(len(self.x)), self
            return
        present = np.logical_not(np.isnan(self.x).any(axis=1))
        count, even = present.sum(axis=1), self.even
        kinds = 4 * count + 2 * even + np.isnan(self.radius)
        for kind in np.unique(kinds):
            sets = np.flatnonzero(kinds == kind)
            if self.given is None and count[sets[0]] == self.shape[2] and len(sets) == len(count):
                yield sets, self
            else:
                yield sets, self._complete(sets, present, bool(even[sets[0]]))

    def _complete(self, sets: Ints, present: Bools, even: bool) -> "Samples":
        """Sets (k,) of which the same is known, with the equally many points that are present (b, n)."""
        x = np.ascontiguousarray(_chosen(self.x.swapaxes(1, 2), sets, present).swapaxes(1, 2))
        weights = None if self.weights is None or even else _chosen(self.weights, sets, present)
        given = None if self.given is None else self.given.of(sets, present)
        part = Samples(x, self._noise_of(sets), weights=weights, given=given)
        return replace(part, given=None) if part.nothing_known.all() else part

    def alike(self) -> Iterator[tuple[Ints, "Samples", int]]:
        """Sets with equally many samples and of one size: their places (k,), the samples in a unit, its power of two.

        Sets of ordinary size keep their unit, and so their bits.
        """
        for sets, present in self.by_count():
            powers = binary_size(present.x) if present.shape[2] else np.zeros(len(sets), dtype=np.int64)
            for power in np.unique(powers):
                places = np.flatnonzero(powers == power)
                part = present if len(places) == len(sets) else present.take(places)
                yield sets[places], scaled(part, -int(power)), int(power)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of sets b, dimension d, samples n."""
        b, d, n = self.x.shape
        return b, d, n

    @cached_property
    def rows(self) -> Floats:
        """The points with each coordinate in a row of memory, for kernels that read them many times."""
        return np.ascontiguousarray(self.x)

    @property
    def points(self) -> Floats:
        """The points as (b, n, d), for an estimator that prefers them so."""
        return self.x.swapaxes(1, 2)

    @cached_property
    def moments(self) -> Moments:
        """Centred moments of each set."""
        return self.formed if isinstance(self.formed, Moments) else Moments.of(self.x)

    @cached_property
    def regression(self) -> Regression:
        """Covariances from which the closed forms are computed, with the eigenbasis of C."""
        return self.formed if isinstance(self.formed, Regression) else Regression.about_centroids(self.moments)


class GivenWay(NamedTuple):
    """A way to fit points of which something is known.

    Attributes:
        fit: computes `Estimates` from complete `Samples`, of each of which the same is known; None if there is none.
        takes: the knowledge that it takes: words of `study.fits.answers.given`.
    """

    fit: Callable[[Samples], Estimates] | None = None
    takes: frozenset[str] = frozenset()


_NO_WAY = GivenWay()


@dataclass(frozen=True)
class Estimator:
    """An estimator as the registry lists it.

    Attributes:
        function: computes `Estimates` from `Samples`. It never raises on data, only on a noise that it cannot use.
        reference: publication that it follows.
        needs: argument of `study.fit` without which it raises; empty if points are enough.
        takes_noise: the function uses a noise that is given, though it need not be.
        flops: floating-point operations per sample in d dimensions: sums, products, quotients, square roots.
        flops_of: the part of a fit that ``flops`` counts; empty for all of it.
        caution: warning for the user that holds whatever the status; empty if there is none.
        moments_suffice: the function reads ``Samples.moments`` alone.
        covariance: covariance of (ĉ, r̂) (b, d+1, d+1), unit squared, of its answers, from samples without missing ones
            and with the noise that they show; None for the Cramér-Rao bound with the estimates plugged in.
        without_outliers: the function leaves out the points that `study.fits.estimators.robust.outliers` names, so
            that intervals are to be formed without them.
        given: its way to fit points of which something is known; it takes nothing by default.
        version: to be raised with every change of its numbers, so that runs do not mix old rows with new ones; a digest
            of its code, for an estimator that is not shipped.

    Examples:
        >>> import study
        >>> "corrected" in study.ESTIMATORS, study.ESTIMATORS["ugdk"].needs
        (True, 'noise')
        >>> study.ESTIMATORS["ugdk"].reference
        'paper eqs 15-21'
    """

    function: Callable[[Samples], Estimates]
    reference: str = ""
    needs: str = ""
    flops: Callable[[int], float] | None = None
    flops_of: str = ""
    caution: str = ""
    moments_suffice: bool = False
    covariance: Callable[[Samples, Estimates], Floats] | None = None
    without_outliers: bool = False
    version: int | str = 1
    takes_noise: bool = False
    given: GivenWay = _NO_WAY

    def __call__(self, samples: Samples) -> Estimates:
        """Fit each set of the batch; with what is known of it, if it is complete and the estimator takes it."""
        way = None if samples.given is None or samples.sigma_alone else self.given.fit
        return self.function(samples) if way is None else way(samples)


class Worded(IntEnum):
    """Numbers as tables store them, each with a ``text`` for the user."""

    text: str

    def __new__(cls, value: int, text: str = "") -> Self:  # without a text a member is looked up by its value
        member = int.__new__(cls, value)
        member._value_ = value
        member.text = text
        return member

    def __str__(self) -> str:
        return self.name

    def __repr__(self) -> str:
        return f"{type(self).__name__}.{self.name}"


class Status(Worded):
    """Status of a fit.

    A fit that is not ``OK`` may still hold a number: the status says how far to trust it. Statuses compare equal to
    the integers in `Fit.status`, and `text` explains them: ``Status(2).text``.

    Examples:
        >>> import study
        >>> line = study.fit([[0, 0], [1, 0], [2, 0], [3, 0]])
        >>> line.status.name, line.status.text
        ('SINGULAR', 'the points lie in a plane or a line (or are one point): they leave the centre undetermined')
        >>> line.status == study.Status.OK
        False
    """

    OK = 0, "ok"
    NOT_POSITIVE_DEFINITE = 1, "covariance minus noise is not positive definite: the noise hides the sphere's extent"
    SINGULAR = 2, "the points lie in a plane or a line (or are one point): they leave the centre undetermined"
    NOT_CONVERGED = 3, "the iteration did not converge within its limit of steps"
    AT_BOUND = 4, "the best sphere is a plane: the centre runs away from the points and was stopped at the bound"
    TOO_FEW_POINTS = 5, "fewer than d + 1 points"
    NOT_FINITE = 6, "a coordinate is not finite, or the points are too large or too small to compute with"
    INSIGNIFICANT = 7, "along some direction the points' extent is within the noise: the centre is unreliable"
    HINGE = 8, "the points lie on a circle in space, within the noise: along its axis the centre is unknown"
    FAILED = 9, "the estimator raised an exception, or the worker that ran it died"
    WEAKLY_IDENTIFIED = (
        10,
        "weakly identified: the points do not bound the radius, or the noise is over a third of it",
    )
    MISFIT = (
        11,
        "the points are not a sphere with white noise, by enough to matter: another shape, or noise of another kind",
    )
    OUTLIERS = 12, "some points are outliers and the fit uses them: the estimator robust leaves them out"
    UNTESTED = 13, "not tested: these points cannot tell a sphere from another shape; if you know it is one, say so"


_LEAST_FOURTH, _MOST_FOURTH = 1e-160, 1e160
"""Range of Σ|x - x̄|⁴ in which nothing that an estimator computes overflows or loses digits to underflow."""
_ORDINARY = 1e-40, 1e40
"""Sizes of point sets that are fitted as they are."""
FARTHEST = 430
"""Binary exponent of the largest and smallest points, 1e±129, whose answers and variances float64 holds."""
_LARGEST_NOISE = 1e70
"""Noise beside points of size 1 beyond which it makes no difference."""


def is_ordinary(fourth: Floats) -> bool:
    """True if no set has missing samples, or needs scaling, by the fourth moments Σ|x - x̄|⁴ (b,)."""
    if len(fourth) == 1:
        return bool(_LEAST_FOURTH < float(fourth[0]) < _MOST_FOURTH)
    return len(fourth) == 0 or bool(fourth.min() > _LEAST_FOURTH and fourth.max() < _MOST_FOURTH)


def careful_fit(estimator: Estimator, samples: Samples) -> Estimates:
    """Fit each set without its missing samples, in a unit of its own size where it is very large or small."""
    b, d, _ = samples.shape
    result = blank(b, d)
    for sets, part, power in samples.alike():
        if part.shape[2] < d + 1:
            result.status[sets] = Status.TOO_FEW_POINTS
        elif abs(power) > FARTHEST:
            result.status[sets] = Status.NOT_FINITE
        else:
            answer = estimator(part)
            with np.errstate(all="ignore"):
                lengths = np.ldexp(answer.center, power), np.ldexp(answer.radius, power)
                variance = np.ldexp(answer.noise_variance, 2 * power)
            for whole, values in zip(result, (*lengths, variance, *answer[3:]), strict=True):
                whole[sets] = values
    return result


def binary_size(x: Floats) -> Ints:
    """Binary exponent of the extent of each set (b, d, n), 0 where it is ordinary, nil or not finite."""
    with np.errstate(all="ignore"):
        extent = np.abs(x - x[:, :, :1]).max(axis=(1, 2))
    usual = ~np.isfinite(extent) | (extent == 0.0) | ((extent > _ORDINARY[0]) & (extent < _ORDINARY[1]))
    return np.asarray(np.where(usual, 0, np.frexp(extent)[1]), dtype=np.int64)


def scaled(samples: Samples, power: int) -> Samples:
    """The samples times 2^power, with their noise."""
    if power == 0:
        return samples
    with np.errstate(all="ignore"):
        given = None if samples.given is None else samples.given.scaled(power)
        noise = scaled_noise(samples.noise, power)
        return Samples(np.ldexp(samples.x, power), noise, weights=samples.weights, given=given)


def scaled_noise(noise: float | Floats | None, power: int) -> float | Floats | None:
    """A noise times 2^power, or its covariance times the square."""
    if noise is None:
        return None
    with np.errstate(all="ignore"):
        if np.ndim(noise) < 2:
            sigma = np.minimum(np.ldexp(noise, power), _LARGEST_NOISE)
            return np.asarray(sigma) if np.ndim(noise) else float(sigma)
        largest = float(np.sqrt(np.max(noise)))
        factor = min(np.ldexp(1.0, power), _LARGEST_NOISE / largest)
        return np.asarray(noise * factor * factor)


def plug_in_bound(directions: Floats, present: Bools, noise: float | Floats | None, variance: Floats) -> Floats:
    """The Cramér-Rao bound (b, d+1, d+1) with estimates in place of the truth.

    Args:
        directions: of the points from ĉ (b, d, n).
        present: False for missing samples (b, n).
        noise: σ or Σ as given, None if it was estimated.
        variance: σ̂² (b,), used if no noise was given.
    """
    b, d, _ = directions.shape
    with np.errstate(all="ignore"):
        covariance, unit = (np.eye(d), variance) if noise is None else unit_covariance(noise, d)
        weights = np.where(present, normal_weights(directions.swapaxes(1, 2), covariance), 0.0)
        sums, mean, scatter = weighted_scatter(np.where(present[:, None], directions, 0.0), weights)
        return np.asarray(bound_from_scatter(sums, mean, scatter) * np.broadcast_to(unit, b)[:, None, None])


def unless_missing(
    covariance_of: Callable[[Samples, Estimates], Floats], samples: Samples, estimates: Estimates
) -> Floats:
    """Covariances (b, d+1, d+1) by an estimator's own rule, without the missing samples; NaN at fewer than d + 1."""
    b, d, _ = samples.shape
    result = np.full((b, d + 1, d + 1), np.nan)
    with np.errstate(all="ignore"):
        for sets, present in samples.by_count():
            if present.shape[2] > d:
                result[sets] = covariance_of(present, Estimates._make([array[sets] for array in estimates]))
    return result


def semi_axes(covariance: Floats, level: float, spare: Ints | None) -> Floats:
    """Semi-axes of confidence ellipsoids, as columns (b, d, d).

    Args:
        covariance: of each estimate (b, d, d); where it is not finite, the axes are NaN.
        level: nominal coverage, in (0, 1).
        spare: degrees of freedom of the noise that the covariance stands on (b,), at least 1, for lengths by F; None
            where the noise is known, for lengths by χ².
    """
    b, d, _ = covariance.shape
    scale = np.full(b, chdtri(d, 1.0 - level)) if spare is None else d * fdtri(d, spare, level)
    values, vectors = eigenbasis(covariance)
    with np.errstate(all="ignore"):
        lengths = np.sqrt(np.maximum(values, 0.0) * scale[:, None])
        return np.asarray(vectors * lengths[:, None, :])


_ALIKE = 1e-8
"""Difference of coordinates, in units of the extent of the points' middle half, up to which points are one and the
same: no instrument resolves so little, and a change of unit, a rotation or a conversion of a file moves copies by about
1e-9 or less. In single precision neighbouring numbers of the points' size are 6e-8 apart."""
_MOST_ALIKE = 100
"""Points along a line among which copies that are not exact are searched."""
_TOGETHER = 1 << 15
"""Points whose copies are searched at a time, which stay in a processor's cache."""
_BINS = 4
"""Bins along that line for each point, of which those with close points are looked at."""


@np.errstate(over="ignore", invalid="ignore")  # points as large as numbers go, which are refused later
def repeated(x: Floats) -> Bools:
    """True for each point of the sets (b, d, n) that repeats an earlier one: (b, n). Missing samples repeat none.

    Points of a continuous law never do: copies mean that a file holds the same measurement several times, or rounds,
    and then the standard errors, which take the points to be independent, may be too small. Points that differ by no
    more than a conversion or a rotation of the file would leave are copies, too; see `_ALIKE`.
    """
    b, d, n = x.shape
    result = np.zeros((b, n), dtype=np.bool_)
    size = max(_TOGETHER // n, 1)
    for begun in range(0, b, size):
        along = _along(x[begun : begun + size])
        in_order = np.sort(along, axis=1)  # where no two are alike, which is the rule, nothing else need be done
        first, extent = _middle_half(in_order)
        reach = _ALIKE * extent
        close = in_order[:, 1:] - in_order[:, :-1] <= d * reach[:, None]
        for t in np.flatnonzero(close.any(axis=1)):
            rows = _near_another(along[t], in_order[t], close[t], first[t], extent[t])
            result[begun + t, rows] = _repeats(x[begun + t][:, rows], along[t, rows], float(reach[t]))
    return result


def _near_another(along: Floats, in_order: Floats, close: Bools, first: float, extent: float) -> Ints:
    """Points of a set at positions (n,) that may be near another: those in the bins of positions that are ``close``.

    Sorting the points with their positions takes longer than a fit of a million points does.
    """
    count = _BINS * len(along)

    def bins(positions: Floats) -> Ints:
        with np.errstate(all="ignore"):
            places = positions - (first - 1.5 * extent)
            places *= count / (4.0 * extent)  # in place, which takes half as long
        np.fmax(places, 0.0, out=places)
        np.fmin(places, count - 1.0, out=places)
        return places.astype(np.intp)

    taken = np.zeros(count, dtype=np.bool_)
    taken[bins(in_order[:-1][close])] = taken[bins(in_order[1:][close])] = True
    return np.flatnonzero(taken[bins(along)])


def reach_of_copies(x: Floats) -> float:
    """Difference of coordinates of the points of one set (d, n) up to which they are copies."""
    return float(_ALIKE * _middle_half(np.sort(_along(x[None]), axis=1))[1][0])


def _along(x: Floats) -> Floats:
    """Position of each point (b, n) along a direction in which no two coordinates of a grid are alike."""
    return np.asarray(np.einsum("bdn,d->bn", x, 1.0 / np.sqrt(2.0 + np.arange(x.shape[1]))))


def _middle_half(in_order: Floats) -> tuple[Floats, Floats]:
    """Begin and extent of the middle half (b,) of numbers in ascending order (b, n), NaN last; 0 if not finite."""
    n, rows = np.logical_not(np.isnan(in_order)).sum(axis=1), np.arange(len(in_order))
    with np.errstate(over="ignore", invalid="ignore"):
        first = in_order[rows, n // 4]
        extent = in_order[rows, 3 * n // 4] - first
    finite = np.isfinite(extent)
    return np.where(finite, first, 0.0), np.where(finite, extent, 0.0)


def _repeats(x: Floats, along: Floats, reach: float) -> Bools:
    """True for the points of one set (d, n) that repeat an earlier one."""
    result = np.zeros(x.shape[1], dtype=np.bool_)
    if not any(map(len, _near_copies(x, along, np.argsort(along), reach))):
        return result
    order = np.lexsort(x)  # stable: of equal ones the first stands first
    result[order[1:]] = (x[:, order[1:]] == x[:, order[:-1]]).all(axis=0)
    order = order[~result[order]]
    for copies in _near_copies(x, along, order[np.argsort(along[order], kind="stable")], reach):
        result[copies] = True
    return result


def _near_copies(x: Floats, along: Floats, order: Ints, reach: float) -> Iterator[Ints]:
    """The later ones of pairs of points (d, n) that differ by no more than ``reach``, pair by pair in the order."""
    for lag in range(1, min(_MOST_ALIKE, len(order))):
        one, two = order[:-lag], order[lag:]
        near = along[two] - along[one] <= len(x) * reach
        if not near.any():
            break
        one, two = one[near], two[near]
        yield np.maximum(one, two)[(np.abs(x[:, two] - x[:, one]) <= reach).all(axis=0)]
