"""Fits with what is known beforehand: the radius, the noise of each point, or its law.

`study.fit` hands points here when a radius is given, a noise for each point, or one that lies along the radius. The
noise of all points comes here, too, for estimators that find it by themselves: it fixes σ, errors, intervals and the
status, while centre and radius stay. Which estimators take which is in `check_way`. Their answer is a `GivenFit`: a
`Fit` whose covariances and intervals use what is known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import scipy

from study.arrays import Bools, Floats, Ints
from study.fits.answer import Fit, FittedPoints
from study.fits.goodness import Goodness, number_of
from study.fits.intervals import AtRadius, BatchWeights, Intervals, PointSets, at_radius, intervals_of
from study.fits.judge import NOTHING, Assumptions, PointEvidence, weighted_outliers, widened
from study.fits.prior import CLOSED, Believed, Given, StatedRadius, check_way
from study.fits.robust import find
from study.fits.samples import Estimates, Estimator, Samples, Status, blank, careful_fit
from study.fits.weighted import Spheres, Weighted, along_normals, closed, cost, covariance, solve
from study.text import number, with_error

_FULLER = 2.0
"""Fuller's constant where the radius is fitted: bias is removed in full, and tails are short (theory 9.3)."""
_NOWHERE = 1e-5
"""Level up to which the free radius is taken to lie in its interval, where a stated one is uncertain."""
_FAR = 1e7
"""Radius in units of the points' spread beyond which a sphere is a plane."""
_FLAT = 1e-14
"""Least extent of points over the largest, up to which they lie in a plane."""
_NOTICED = 0.01
"""p value below which the points do not agree with a known radius, or with the noise that was given for each."""
_SIDES = 3.0
"""Standard errors by which a known radius must fit better on one side of the points than on the other."""


def weighted(x: Floats, given: Given, estimator: str) -> Weighted:
    """The points (b, d, n) with the weights that are given."""
    noise, known = given.noise, not given.relative
    if noise is None:
        known = given.sigma is not None
        noise = np.full((x.shape[0], x.shape[2]), 1.0 if given.sigma is None else given.sigma**2)
    return Weighted.of(x.swapaxes(1, 2), noise, known, given.radius)._replace(radial=given.radial)


def estimate(sets: Weighted, estimator: str) -> Estimates:
    """Fit a batch by an estimator that takes what is given, in the unit of the points."""
    b, _, d = sets.points.shape
    result, places = blank(b, d), np.flatnonzero(sets.usable)
    result.status[:] = np.where(sets.size < d + 1, Status.TOO_FEW_POINTS, Status.NOT_FINITE)
    result.status[(sets.size > d) & (sets.unit == 0.0)] = Status.SINGULAR
    if not len(places):
        return result
    part = sets.take(places)
    with np.errstate(all="ignore"):
        extent = np.linalg.eigvalsh(np.einsum("bn,bni,bnj->bij", part.weights, part.points, part.points))
        sphere = closed(part, estimator if estimator in CLOSED else "gdke")
        if estimator not in CLOSED:
            sphere = solve(part, sphere, corrected=False)
        if estimator == "corrected":
            sphere = solve(part, sphere, corrected=True, fuller=_FULLER)
        status = np.where(sphere.found, Status.OK, Status.NOT_CONVERGED)
        status[sphere.radius > _FAR] = Status.AT_BOUND
        flat = ~(extent[:, 0] > _FLAT * extent[:, -1])
        status[flat & (~np.isfinite(part.radius) | ~(extent[:, 1] > _FLAT * extent[:, -1]))] = Status.SINGULAR
        lost = (status == Status.SINGULAR) | (status == Status.NOT_CONVERGED)
        size = sphere.scale * part.unit**2 * part.mean_variance
        numbers = [part.origin + sphere.center * part.unit[:, None], sphere.radius * part.unit, size]
    for whole, values in zip(result, numbers, strict=False):
        values[lost] = np.nan
        whole[places] = values
    result.status[places] = status
    return result


class RadiusTest(NamedTuple):
    """The radius of the free fit beside the given one: r̂, its standard error, and the p value of the given one."""

    radius: Floats
    error: Floats
    p: Floats


class GivenFit(Fit):
    """Spheres that were fitted with a known radius, noise, or law of the noise; see `study.fit`.

    It has all that a `Fit` has. Covariances and intervals use what is known. A radius that was given with its standard
    uncertainty is fitted with it, and has an error and an interval of its own. Where each point has a noise of its own,
    residuals are tested in units of it, and outliers are points beyond the largest deviation, in units of their own
    noise, that clean points have once in a hundred data sets.

    Args:
        estimates: the estimator's numbers, with the leading axes.
        samples: the points that were fitted, flat (b, d, n).
        estimator: name of the estimator.
        given: what was known, flat.
        assumed: what the user knows of the points.
        covariance_of: the estimator's own covariance of its numbers, where nothing is known.

    Examples:
        >>> import numpy as np, study
        >>> angles = np.linspace(0, 1, 50)
        >>> arc = np.column_stack([np.cos(angles), np.sin(angles)])
        >>> noisy = arc + np.random.default_rng(1).normal(0, 0.01, arc.shape)
        >>> free, known = study.fit(noisy), study.fit(noisy, radius=1.0)
        >>> free.standard_errors.round(3), known.standard_errors.round(3)
        (array([0.03 , 0.017, 0.033]), array([0.002, 0.004, 0.   ]))
        >>> float(known.radius_test.p.round(2))
        0.94
    """

    _samples: Samples

    def __init__(
        self,
        estimates: Estimates,
        samples: Samples,
        estimator: str,
        given: Given,
        assumed: Assumptions = NOTHING,
        covariance_of: Callable[[Samples, Estimates], Floats] | None = None,
    ) -> None:
        super().__init__(estimates, samples, estimator, covariance_of, estimator == "robust", assumed)
        self._given = given

    def __getitem__(self, index: Any) -> Self:
        if not self.shape:
            raise TypeError("a single fit cannot be indexed; its arrays are fit.center, fit.radius, fit.status, …")
        places = np.arange(self.radius.size).reshape(self.shape)[index]
        part = Estimates._make([np.asarray(array[places]) for array in self._estimates.reshape(-1)])
        flat = np.atleast_1d(places).ravel()
        samples, given = self._samples.take(flat), self._given.take(flat)
        return type(self)(part, samples, self._estimator, given, self._assumed, self._covariance_of)

    @cached_property
    def _points(self) -> FittedPoints:
        """The points with their weights; what they show is judged by the sphere of the free fit."""
        center = self.center.reshape(-1, self.center.shape[-1])
        samples, free = self._samples, None
        if (self._given.noise is not None or self._given.radial) and not self._nothing_known.all():
            sets, sphere = self._sets, self._free
            if self._given.noise is not None:
                samples = replace(samples, weights=self._along(sphere))
            with np.errstate(all="ignore"):
                middle = sets.origin + sphere.center * sets.unit[:, None]
                numbers = middle, sphere.radius * sets.unit, sphere.scale * sets.unit**2
            free = blank(*self._samples.shape[:2])
            for whole, part in zip(free, numbers, strict=False):
                whole[sphere.found] = part[sphere.found]
        known = self._given.radius if self._without_outliers else None
        return FittedPoints(samples, center, self._without_outliers, self._assumed, free, known)

    @cached_property
    def _sets(self) -> Weighted:
        x = self._samples.x
        if self._without_outliers:
            x = np.where(self._points.outliers[:, None], np.nan, x)
        return weighted(x, self._given, self._estimator)

    @cached_property
    def _different(self) -> Weighted:
        """The points that intervals stand on: copies count once."""
        if not self._points.repeated.any():
            return self._sets
        return weighted(self._points.different.x, self._given, self._estimator)

    @cached_property
    def _spheres(self) -> Spheres:
        """The answers in the units of the sets."""
        sets, flat = self._sets, self._estimates.reshape(-1)
        with np.errstate(all="ignore"):
            center = (flat.center - sets.origin) / sets.unit[:, None]
            scale = flat.noise_variance / sets.unit**2 / sets.mean_variance
            scale = np.where(np.isfinite(sets.scale), sets.scale, scale)
        return Spheres(center, flat.radius / sets.unit, scale, np.isfinite(flat.radius))

    @property
    def stated_alone(self) -> bool:
        """True if the noise of all points was given, and nothing else."""
        return self._given.stated_alone

    @property
    def _noise_is_known(self) -> bool:
        """True if the size of the noise was given."""
        return bool(np.isfinite(self._sets.scale).any())

    @cached_property
    def _own_covariance(self) -> Floats:
        """Covariance of (ĉ, r̂) for white noise (…, d+1, d+1), unit squared; a known radius has none (theory 9.6)."""
        result = covariance(self._sets, self._spheres, self._estimator == "corrected")
        result[~self._spheres.found] = np.nan
        if self._given.prior is not None:
            deviation, slope = self._believed.spread()
            line = np.column_stack([slope, np.ones(len(slope))])
            added = np.nan_to_num(deviation[:, None, None] ** 2 * line[:, :, None] * line[:, None], nan=0.0)
            result += added
        result *= (self._sets.unit**2)[:, None, None]
        plain = self._nothing_known | self._given.stated_alone
        if plain.any():
            result[plain] = super()._own_covariance.reshape(result.shape)[plain]
        return result.reshape(*self.shape, *result.shape[1:])

    @property
    def _nothing_known(self) -> Bools:
        """True for sets (b,) whose points were given equal noise of unknown size: they are fitted as without it."""
        return self._sets.alike & np.isnan(self._given.radius)

    @cached_property
    def _plain(self) -> Self | None:
        """Those fits alone; None if all of a batch are such, or none: beside others, they have their own answers."""
        plain = self._nothing_known
        return self[plain.reshape(self.shape)] if plain.any() and not plain.all() else None

    @cached_property
    def _believed(self) -> Believed:
        """Radii by points and statement together, in the units of the sets."""
        assert self._given.prior is not None
        return believed(self._sets, self._given.prior)

    def _along(self, sphere: Spheres) -> Floats:
        """Weights of the points (b, n) by their noise along the directions from the centres of spheres."""
        sets = self._sets
        if sets.covariances is None:
            return sets.weights
        with np.errstate(all="ignore"):
            away = sets.points - sphere.center[:, None]
            e = away / np.linalg.norm(away, axis=2, keepdims=True)
            return np.where(sets.present, 1.0 / np.einsum("bni,bnij,bnj->bn", e, sets.covariances, e), 0.0)

    @cached_property
    def _evidence(self) -> PointEvidence:
        """Evidence in the residuals of the free fit, and a known radius that the points refuse.

        Such a radius is a coefficient of degree 0, which joins those of degree 2 that measure structure, in units of
        the free fit's noise; the noise of this fit may hold the refused part already (theory 13.6).
        """
        seen, test, d = self._points.evidence, self.radius_test, self.center.shape[-1]
        with np.errstate(all="ignore"):  # a radius without an error
            shift = (((test.radius - self.radius) / test.error) ** 2).reshape(-1, 1)
            freedom = np.minimum(seen.freedom, number_of(d, 2))
            noise = np.sqrt(np.minimum(self._free.scale / self._spheres.scale, 1.0))[:, None]
            ratio = np.sqrt((freedom * seen.ratio**2 + shift) / (freedom + 1.0)) * noise
        wider = (test.p < _NOTICED).reshape(-1, 1) & (ratio > seen.ratio) & np.isfinite(ratio)
        ratio, freedom = np.where(wider, ratio, seen.ratio), np.where(wider, freedom + 1.0, seen.freedom)
        if (plain := self._plain) is not None:
            ratio[self._nothing_known], freedom[self._nothing_known] = plain._evidence.ratio, plain._evidence.freedom
        return seen._replace(ratio=ratio, freedom=freedom)

    @property
    def allowance(self) -> Floats:
        """Factors on standard errors for structure in the residuals, and for a known radius that the points refuse.

        A radius that is itself wrong moves the centre of a cap along its axis by more than that (…, d+1).
        """
        return (self._evidence.ratio * self._points.selection).reshape(*self.shape, self.center.shape[-1] + 1)

    @property
    def _held(self) -> Floats:
        prior, radius = self._given.prior, self._given.radius
        if prior is None:
            return np.where(np.isfinite(radius), np.inf, 0.0)
        return np.asarray(self._estimates.noise_variance.reshape(-1) / prior.uncertainty**2)

    @cached_property
    def noise_scale(self) -> Floats:
        """The noise that the residuals show over the one that was given (…): about 1 if that is right.

        It is the root of Σ p (R - r̂)²/(N - k), k the number of coordinates fitted: the standard error of unit weight.
        """
        sets, sphere = self._sets, self._spheres
        free = ~np.isfinite(sets.radius)
        with np.errstate(all="ignore"):
            square = cost(sets, sphere.center, sphere.radius) / (sets.size - sphere.center.shape[1] - free)
            given = np.where(np.isfinite(sets.scale), sets.scale, np.nan if self._given.noise is None else 1.0)
            known = weighted(self._samples.x, self._given._replace(relative=False), self._estimator)
            size = known.scale * known.unit**2  # of a point of weight 1, as its noise was given
            unit = np.where(np.isfinite(sets.scale), 1.0, sets.unit**2 / size)
            return np.asarray(np.sqrt(square * unit / given).reshape(self.shape))

    @cached_property
    def _free(self) -> Spheres:
        """The corrected fit with a free radius, in the units of the sets."""
        free = self._sets._replace(radius=np.full_like(self._sets.radius, np.nan))
        with np.errstate(all="ignore"):
            sphere = solve(free, closed(free, "gdke"), corrected=False)
            return solve(free, sphere, corrected=True, fuller=_FULLER)

    @cached_property
    def radius_test(self) -> RadiusTest:
        """The fit with a free radius, as a test of a known one: its r̂ and error, and the p value of the given r (…).

        The p value is that of the radius's score (theory 10.6), or of r̂ over its error if the points have no centre for
        the given radius. It is small where the radius is wrong, and where the points are no sphere. NaN where no radius
        was given.
        """
        known, start, sphere, prior = self._sets, self._spheres, self._free, self._given.prior
        with np.errstate(all="ignore"):
            if prior is not None:
                known = known._replace(radius=prior.radius / known.unit)
            score = _at_radius(known, start).score
            error = np.sqrt(covariance(known._replace(radius=np.full_like(known.radius, np.nan)), sphere)[:, -1, -1])
            score = np.where(np.isnan(score), (known.radius - sphere.radius) / error, score)
            if prior is not None:  # the statement errs, too
                score *= error / np.hypot(error, prior.uncertainty / known.unit)
            spare = np.maximum(known.size - start.center.shape[1] - 1, 1.0)
            exact = np.isfinite(known.scale)
            tail = np.where(exact, scipy.special.ndtr(-np.abs(score)), scipy.special.stdtr(spare, -np.abs(score)))
        numbers = [sphere.radius * known.unit, error * known.unit, 2.0 * tail]
        lost = ~np.isfinite(known.radius)
        return RadiusTest(*(np.where(lost, np.nan, array).reshape(self.shape) for array in numbers))

    def remarks(self) -> Iterator[str]:
        """Lines about what was given, and whether the points agree; for a single fit."""
        if np.isfinite(self._given.radius).all():
            test, prior, given = self.radius_test, self._given.prior, f"radius {float(self.radius):.6g} is given"
            if prior is not None:
                given = f"radius {with_error(float(prior.radius[0]), float(prior.uncertainty[0]))} is given"
            p = "p < 1e-9" if test.p < 1e-9 else f"p = {number(float(test.p), '.2g')}"
            agrees = ": the points do not agree with it" if test.p < _NOTICED else ""
            free = with_error(float(test.radius), float(test.error))
            yield f"{given}; with a free one the points have {free} ({p}){agrees}"
        if self._given.noise is not None:
            times = number(float(self.noise_scale), ".3g")
            scaled = "its scale is found in them" if self._given.relative else "± stands on the noise as it is given"
            yield f"each point has a noise of its own, and the residuals are {times} times as large; {scaled}"
        elif self._given.sigma is not None:
            times, given = number(float(self.noise_scale), ".3g"), f"noise {self._given.sigma:g} is given"
            yield f"{given}, and the residuals are {times} times as large; ± stands on the noise as it is given"
        if self._given.radial:
            yield "the noise is taken to be along the radius alone"

    @cached_property
    def outliers(self) -> Bools:
        """True for each point (…, n) that does not belong to the sphere of the majority; see the class."""
        samples = self._points.samples
        if samples.weights is None:
            return np.asarray(super().outliers)
        named = weighted_outliers(samples)
        if (plain := self._plain) is not None:
            named[self._nothing_known] = plain.outliers
        return np.asarray(named.reshape(*self.shape, named.shape[1]))

    def _intervals_at(self, level: float) -> Intervals:
        """Intervals of the flat batch, with what was given."""
        sets, stretch = self._different, self._evidence.stretch(level, self._points.spare) * self._points.selection
        if self._given.prior is not None:
            return self._uncertain_intervals(level, stretch)
        stretch[np.isfinite(self._given.radius), -1] = 1.0

        def again(some: Ints, factors: Floats) -> Intervals:
            return given_intervals(sets.take(some), level, factors)

        intervals = widened(given_intervals(sets, level, np.ones(len(stretch))), stretch, again)
        if self._given.stated_alone:
            intervals = self._points.open_on_hinges(intervals, level)
        if (plain := self._nothing_known).any():
            for whole, part in zip(intervals, self._points.intervals(level), strict=True):
                whole[plain] = part[plain]
        return intervals

    def _uncertain_intervals(self, level: float, stretch: Floats) -> Intervals:
        """Intervals for a radius stated with an uncertainty; they hold those of the known radius that is likeliest.

        Args:
            level: nominal coverage.
            stretch: factors of `PointEvidence.stretch` (b, d + 1).
        """
        sets, some = self._sets, self._believed
        spare, sides = _spare(sets), (0.5 * (1.0 - level), 0.5 * (1.0 + level))
        radius = np.stack([some.quantile(side) for side in sides], axis=1)
        center = np.stack([some.center_quantile(side, spare) for side in sides], axis=2)
        given = given_intervals(sets, level, np.ones(len(spare)))
        middle = center.mean(axis=2, keepdims=True)
        center = middle + (center - middle) * stretch[:, :-1, None]
        radius = radius.mean(axis=1, keepdims=True) + (radius - radius.mean(axis=1, keepdims=True)) * stretch[:, -1:]
        center = sets.origin[..., None] + center * sets.unit[:, None, None]
        center[..., 0] = np.fmin(center[..., 0], given.center[..., 0])
        center[..., 1] = np.fmax(center[..., 1], given.center[..., 1])
        radius = np.where(np.isfinite(radius), radius * sets.unit[:, None], given.radius)
        return Intervals(radius, center, given.noise_share)

    @cached_property
    def _judged(self) -> tuple[Ints, Goodness]:
        """The status by the rule for every fit, which a known radius must pass, and a noise that is given, by χ²."""
        status, goodness = super()._judged
        if (plain := self._plain) is not None:
            places = self._nothing_known.reshape(self.shape)
            status[places] = plain._judged[0]
            for whole, part in zip(goodness, plain._judged[1], strict=True):
                whole[..., places] = part
        refused = self.radius_test.p < _NOTICED
        if self._noise_is_known:
            sets, sphere = self._sets, self._spheres
            spare = np.maximum(sets.size - self.center.shape[-1] - ~np.isfinite(sets.radius), 1.0)
            with np.errstate(all="ignore"):
                distance = np.linalg.norm(sets.points - sphere.center[:, None], axis=2)
                square = (self._along(sphere) * (distance - sphere.radius[:, None]) ** 2).sum(axis=1) / sphere.scale
            refused |= (scipy.special.chdtrc(spare, square) < _NOTICED).reshape(self.shape)
        return np.where((status == Status.OK) & refused, Status.MISFIT, status), goodness


def _spare(sets: Weighted) -> Floats:
    """Degrees of freedom of the noise beside a free radius (b,), infinite where its scale is known."""
    spare = np.maximum(sets.size - sets.points.shape[2] - 1.0, 1.0)
    return np.where(np.isfinite(sets.scale), np.inf, spare)


def believed(sets: Weighted, prior: StatedRadius) -> Believed:
    """Join points and statement about radii stated with an uncertainty, in the units of the sets."""
    d = sets.points.shape[2]
    places = np.flatnonzero(sets.usable & (sets.size > d + 1))
    result = Believed.unknown(len(sets.unit), d)
    if len(places):
        part = sets.take(places)
        stated = StatedRadius(prior.radius[places] / part.unit, prior.uncertainty[places] / part.unit)
        open_ = part._replace(radius=np.full(len(places), np.nan))

        def fit_at(radius: Floats) -> AtRadius:
            at = part._replace(radius=radius)
            return _at_radius(at, solve(at, closed(at, "gdke"), corrected=False))

        with np.errstate(all="ignore"):
            ends = _without_radius(open_, _quantile(open_, _spare(open_), 1.0 - _NOWHERE)).radius
            found = Believed.of(stated, ends, fit_at, _spare(part))
        for whole, values in zip(result, found, strict=True):
            whole[places] = values
    return result


def given_intervals(sets: Weighted, level: float, factors: Floats) -> Intervals:
    """Confidence intervals of radius and centre with what is known, whatever the estimator (theory 10.6).

    Given the radius, those of the centre are ĉ ± q errors. Where the sphere on the other side of the points is not
    rejected, as on a cap whose curvature the noise hides, they hold both; where it is not by far, the noise share is
    NaN.

    Args:
        sets: the points.
        level: nominal coverage.
        factors: on the quantile of each set (b,).

    Raises:
        ValueError: if the level is not between 0 and 1.
    """
    b, _, d = sets.points.shape
    result = Intervals.unbounded(b, d, level)
    known = np.isfinite(sets.radius)
    with np.errstate(all="ignore"):
        for alike, ends_of, fitted in ((known, _with_radius, d), (~known, _without_radius, d + 1)):
            enough = np.flatnonzero(alike & sets.usable & (sets.size > d + 1))
            if len(enough):
                part = sets.take(enough)
                ends = ends_of(part, _quantile(part, part.size - fitted, 0.5 * (1.0 + level)) * factors[enough])
                result.radius[enough] = ends.radius * part.unit[:, None]
                result.center[enough] = part.origin[..., None] + ends.center * part.unit[:, None, None]
                result.noise_share[enough] = ends.noise_share
    return result


def _quantile(sets: Weighted, spare: Floats, level: Floats | float) -> Floats:
    """Quantile of the normal law where the scale of the noise is known, else of Student's t (b,)."""
    quantile = np.where(np.isfinite(sets.scale), scipy.special.ndtri(level), scipy.special.stdtrit(spare, level))
    return np.asarray(quantile)


def _for_kernels(sets: Weighted, spheres: Spheres) -> Iterator[tuple[Ints, PointSets]]:
    """Sets of equally many points as the kernels of intervals take them, with their places (k,).

    A point with a covariance weighs by its variance along the normal of its set's sphere, and keeps that weight.
    """
    kinds = np.column_stack([sets.size.astype(int), sets.alike])
    for count, same in np.unique(kinds[sets.size > sets.points.shape[2] + 1], axis=0).tolist():
        places = np.flatnonzero((kinds == [count, same]).all(axis=1))
        part, sphere = sets.take(places), spheres.take(places)
        if not same and sets.covariances is not None:
            p, bent, scale = along_normals(part, sphere)
        else:
            p, scale = part.weights, part.scale
            bent = np.zeros((*p.shape, 2)) if part.radial else np.empty((len(places), 2, 0))

        def dense(array: Floats, part: Weighted = part, shape: tuple[int, int] = (len(places), count)) -> Floats:
            return np.ascontiguousarray(np.moveaxis(array[part.present].reshape(*shape, -1), 2, 1))

        weights = None if same else BatchWeights(dense(p)[:, 0], bent if bent.size == 0 else dense(bent), scale)
        yield places, PointSets(dense(part.points), sphere.center, sphere.radius, weights)


def _at_radius(sets: Weighted, start: Spheres) -> AtRadius:
    """The centre at the known radius, and its score, from spheres of that radius, in the units of the sets."""
    b, _, d = sets.points.shape
    result = AtRadius(*(np.full(shape, np.nan) for shape in (b, (b, d), (b, d), b)))
    for places, part in _for_kernels(sets, start._replace(radius=sets.radius)):
        for whole, values in zip(result, at_radius(part), strict=True):
            whole[places] = values
    return result


def _with_radius(sets: Weighted, quantile: Floats) -> Intervals:
    """Intervals of the centre for a known radius, in the units of the sets."""
    least = solve(sets, closed(sets, "gdke"), corrected=False)
    other = solve(sets, least._replace(center=-least.center), corrected=False)
    at, second = (_at_radius(sets, sphere) for sphere in (least, other))
    steps = quantile[:, None, None] * [-1.0, 1.0]
    center, mirrored = (one.center[..., None] + one.errors[..., None] * steps for one in (at, second))
    apart = np.linalg.norm(other.center - least.center, axis=1) > 1e-3 * sets.radius
    excess = cost(sets, other.center, sets.radius) - cost(sets, least.center, sets.radius)
    both = apart & other.found & (excess <= quantile**2 * at.variance)
    doubt = apart & other.found & (excess <= _SIDES**2 * at.variance)
    center[both, :, 0] = np.fmin(center[..., 0], mirrored[..., 0])[both]
    center[both, :, 1] = np.fmax(center[..., 1], mirrored[..., 1])[both]
    lost = np.isnan(at.variance)
    center[lost] = -np.inf, np.inf
    share = np.sqrt(at.variance) / sets.radius
    return Intervals(np.repeat(sets.radius[:, None], 2, axis=1), center, np.where(doubt | lost, np.nan, share))


def _without_radius(sets: Weighted, quantile: Floats) -> Intervals:
    """Intervals of radius and centre where the points weigh differently, in the units of the sets."""
    start = solve(sets, closed(sets, "gdke"), corrected=False)
    sphere = solve(sets, start, corrected=True, fuller=_FULLER)
    fine = sphere.found & (sphere.radius < _FAR)
    for part, better in zip(start, sphere, strict=True):
        part[fine] = better[fine]
    result = Intervals.unbounded(len(fine), sets.points.shape[2], 0.5)
    for places, some in _for_kernels(sets, start):
        for whole, values in zip(result, intervals_of(some, quantile[places]), strict=True):
            whole[places] = values
    return result


def fit_given(points: Floats, name: str, estimator: Estimator, given: Given, assumed: Assumptions = NOTHING) -> Fit:
    """`study.fit` with a known radius or a noise for each point; see there."""
    *lead, n, d = points.shape
    x = np.array(points.reshape(-1, n, d).swapaxes(1, 2), dtype=float, order="C")
    if given.stated_alone and given.sigma is not None:
        samples = Samples(x, given.sigma)
        answer = careful_fit(estimator, samples)
        answer.noise_variance[np.isfinite(answer.noise_variance)] = given.sigma**2
        return GivenFit(answer.reshape(*lead), samples, name, given, assumed, estimator.covariance)
    check_way(name, given)
    if given.noise is not None:  # a point without a noise is missing
        unknown = given.noise <= 0.0 if given.noise.ndim == 2 else np.einsum("bnii->bn", given.noise) <= 0.0
        x[np.broadcast_to(unknown[:, None], x.shape)] = np.nan
    infinite = np.isinf(x).any(axis=(1, 2))
    found = find(Samples(x), known=given.radius) if estimator.without_outliers else None
    left = infinite[:, None] if found is None else infinite[:, None] | found.named
    sets = weighted(np.where(left[:, None], np.nan, x), given, name)
    if given.prior is not None:
        radius = believed(sets, given.prior).quantile(0.5)
        sets = sets._replace(radius=np.where(np.isfinite(radius), radius, sets.radius))
        given = given._replace(radius=np.where(np.isfinite(radius), radius * sets.unit, given.radius))
    answer, plain = estimate(sets, name), np.flatnonzero(sets.alike & np.isnan(given.radius) & ~infinite)
    if len(plain):
        for whole, part in zip(answer, careful_fit(estimator, Samples(x[plain])), strict=True):
            whole[plain] = part
    if found is not None:
        weighed = np.isfinite(found.radius) & (answer.status == Status.OK)
        answer.center[weighed], answer.noise_variance[weighed] = found.center[weighed], found.variance[weighed]
    answer.status[infinite] = Status.NOT_FINITE
    fitted = np.isfinite(answer.radius) & np.isfinite(given.radius)
    answer.radius[fitted] = given.radius[fitted]
    return GivenFit(answer.reshape(*lead), Samples(x), name, given, assumed, estimator.covariance)
