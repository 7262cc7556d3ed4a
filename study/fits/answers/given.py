"""Fits with what is known beforehand: the radius, the noise of each point, or its law.

`study.fit` hands points here when a radius is given, a noise for each point, or one that lies along the radius. The
noise of all points comes here, too, for estimators that find it by themselves: it fixes σ, errors, intervals and the
status, while centre and radius stay. Which estimators take which is in `Estimator.given`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy

from study.arrays import Bools, Floats, Ints
from study.fits.errors.intervals import AtRadius, Intervals, Spheres, at_radii, intervals_of
from study.fits.errors.prior import Believed
from study.fits.errors.weighted import (
    Weighted,
    corrected_equations,
    cost,
    covariance,
    for_kernels,
    least_squares,
    solve,
)
from study.fits.estimators.robust import Found, find
from study.fits.evidence.fitted import FittedPoints, RadiusTest
from study.fits.evidence.goodness import Goodness, number_of
from study.fits.evidence.judge import PointEvidence, weighted_outliers, widened
from study.fits.points.samples import Estimates, Estimator, Given, Samples, StatedRadius, Status, blank, careful_fit
from study.text import number, with_error

_FAR = 1e7
"""Radius in units of the points' spread beyond which a sphere is a plane."""
_FLAT = 1e-14
"""Least extent of points over the largest, up to which they lie in a plane."""
_NOTICED = 0.01
"""p value below which the points do not agree with a known radius, or with the noise that was given for each."""
_SIDES = 3.0
"""Standard errors by which a known radius must fit better on one side of the points than on the other."""


def weighted(x: Floats, given: Given) -> Weighted:
    """The points (b, d, n) with the weights that are given."""
    noise, known = given.noise, not given.relative
    if noise is None:
        known = given.sigma is not None
        noise = np.full((x.shape[0], x.shape[2]), 1.0 if given.sigma is None else given.sigma**2)
    return Weighted.of(x.swapaxes(1, 2), noise, known, given.radius)._replace(radial=given.radial)


def estimate(sets: Weighted, entry: Estimator) -> Estimates:
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
        assert entry.given.fit is not None
        sphere = entry.given.fit(part)
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


class GivenPoints(FittedPoints):
    """The points of fits with a known radius, noise, or law of the noise; see `study.fit`.

    Covariances and intervals use what is known. A radius that was given with its standard uncertainty is fitted with
    it, and has an error and an interval of its own. Where each point has a noise of its own, residuals are tested in
    units of it, and outliers are points beyond the largest deviation, in units of their own noise, that clean points
    have once in a hundred data sets.
    """

    @cached_property
    def given(self) -> Given:
        """The radius, the noise or the law that was given."""
        assert self.samples.given is not None
        return self.samples.given

    @cached_property
    def _weighs(self) -> bool:
        """True if points may weigh differently, or have noise along the radius alone."""
        return (self.given.noise is not None or self.given.radial) and not bool(self._nothing_known.all())

    @cached_property
    def observed(self) -> Samples:
        """The points, with their weights along the directions from the free fit."""
        if self.given.noise is None or not self._weighs:
            return self.samples
        return replace(self.samples, weights=self._along(self._free))

    @cached_property
    def spheres(self) -> Estimates | None:
        """The free fits where points weigh differently; NaN where there is none."""
        if not self._weighs:
            return None
        sets, sphere = self._sets, self._free
        with np.errstate(all="ignore"):
            middle = sets.origin + sphere.center * sets.unit[:, None]
            numbers = middle, sphere.radius * sets.unit, sphere.scale * sets.unit**2
        free = blank(*self.samples.shape[:2])
        for whole, part in zip(free, numbers, strict=False):
            whole[sphere.found] = part[sphere.found]
        return free

    @cached_property
    def found(self) -> Found:
        """The outliers, and what leaving them out adds to the errors."""
        return find(self.samples, known=self.given.exact_radius if self.without_outliers else None)

    @cached_property
    def outliers(self) -> Bools:
        """True for the points (b, n) that do not belong to the sphere of the majority; see the class."""
        if self.given.noise is None or not self._weighs:
            return self.found.named
        named = weighted_outliers(replace(self.observed, weights=self._along(self._free)))
        if self._plain is not None:
            named[self._nothing_known] = self._plain.outliers
        return named

    @cached_property
    def _sets(self) -> Weighted:
        x = self.samples.x
        return weighted(np.where(self.outliers[:, None], np.nan, x) if self.without_outliers else x, self.given)

    @cached_property
    def _different(self) -> Weighted:
        """The points that intervals stand on: copies count once."""
        return weighted(self.different.x, self.given) if self.repeated.any() else self._sets

    @cached_property
    def _answers(self) -> Spheres:
        """The answers in the units of the sets."""
        sets, flat = self._sets, self.estimates
        with np.errstate(all="ignore"):
            center = (flat.center - sets.origin) / sets.unit[:, None]
            scale = flat.noise_variance / sets.unit**2 / sets.mean_variance
            scale = np.where(np.isfinite(sets.scale), sets.scale, scale)
        return Spheres(center, flat.radius / sets.unit, scale, np.isfinite(flat.radius))

    @property
    def noise_is_known(self) -> bool:
        """True if the size of the noise was given."""
        return bool(np.isfinite(self._sets.scale).any())

    @cached_property
    def white_covariance(self) -> Floats:
        """Covariance of (ĉ, r̂) for white noise (b, d+1, d+1), unit squared; a known radius has none (theory 9.6)."""
        result = covariance(self._sets, self._answers, self.entry is not None and self.entry.covariance is not None)
        result[~self._answers.found] = np.nan
        result *= (self._sets.unit**2)[:, None, None]
        if self.given.prior is not None:
            deviation, slope = self._believed.spread()
            line = (deviation * self._different.unit)[:, None] * np.column_stack([slope, np.ones(len(slope))])
            result += np.nan_to_num(line[:, :, None] * line[:, None], nan=0.0)
        plain = self._nothing_known | self.given.sigma_alone
        if plain.any():
            result[plain] = super().white_covariance[plain]
        return result

    @property
    def _nothing_known(self) -> Bools:
        """True for sets (b,) whose points were given equal noise of unknown size: they are fitted as without it."""
        return self._sets.alike & np.isnan(self.given.radius)

    @cached_property
    def _plain(self) -> FittedPoints | None:
        """Such sets of a batch that has others, too, which answer as they do alone; None if there are none."""
        sets = np.flatnonzero(self._nothing_known)
        if not 0 < len(sets) < len(self._nothing_known):
            return None
        part = Estimates._make([np.asarray(array[sets]) for array in self.estimates])
        return FittedPoints(part, replace(self.samples.take(sets), given=None), self.entry, self.assumed)

    @cached_property
    def _believed(self) -> Believed:
        """Radii by points and statement together, in the units of the different points."""
        assert self.given.prior is not None
        return believed(self._different, self.given.prior)

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
    def allowed(self) -> PointEvidence:
        """Evidence in the residuals of the free fit, and a known radius that the points refuse.

        Such a radius is a coefficient of degree 0, which joins those of degree 2 that measure structure, in units of
        the free fit's noise; the noise of this fit may hold the refused part already (theory 13.6).
        """
        seen, test, d = self.evidence, self.radius_test, self.samples.shape[1]
        with np.errstate(all="ignore"):  # a radius without an error
            shift = (((test.radius - self.estimates.radius) / test.error) ** 2).reshape(-1, 1)
            freedom = np.minimum(seen.freedom, number_of(d, 2))
            noise = np.sqrt(np.minimum(self._free.scale / self._answers.scale, 1.0))[:, None]
            ratio = np.sqrt((freedom * seen.ratio**2 + shift) / (freedom + 1.0)) * noise
        wider = (test.p < _NOTICED).reshape(-1, 1) & (ratio > seen.ratio) & np.isfinite(ratio)
        ratio, freedom = np.where(wider, ratio, seen.ratio), np.where(wider, freedom + 1.0, seen.freedom)
        if self._plain is not None:
            alone = self._plain.evidence
            ratio[self._nothing_known], freedom[self._nothing_known] = alone.ratio, alone.freedom
        return seen._replace(ratio=ratio, freedom=freedom)

    @property
    def held(self) -> Floats:
        """Noise variance over the squared uncertainty of a known radius (b,)."""
        prior, radius = self.given.prior, self.given.radius
        if prior is None:
            return np.where(np.isfinite(radius), np.inf, 0.0)
        return np.asarray(self.estimates.noise_variance / prior.uncertainty**2)

    @cached_property
    def noise_scale(self) -> Floats:
        """The noise that the residuals show over the one that was given (b,); see `Fit.noise_scale`."""
        sets, sphere = self._sets, self._answers
        free = ~np.isfinite(sets.radius)
        with np.errstate(all="ignore"):
            square = cost(sets, sphere.center, sphere.radius) / (sets.size - sphere.center.shape[1] - free)
            given = np.where(np.isfinite(sets.scale), sets.scale, np.nan if self.given.noise is None else 1.0)
            known = weighted(self.samples.x, self.given._replace(relative=False))
            size = known.scale * known.unit**2  # of a point of weight 1, as its noise was given
            unit = np.where(np.isfinite(sets.scale), 1.0, sets.unit**2 / size)
            return np.asarray(np.sqrt(square * unit / given))

    @cached_property
    def _free(self) -> Spheres:
        """The corrected fit with a free radius, in the units of the sets."""
        free = self._sets._replace(radius=np.full_like(self._sets.radius, np.nan))
        with np.errstate(all="ignore"):
            return corrected_equations(free)

    @cached_property
    def radius_test(self) -> RadiusTest:
        """The fit with a free radius, as a test of a known one (b,); see `Fit.radius_test`."""
        known, start, sphere, prior = self._sets, self._answers, self._free, self.given.prior
        with np.errstate(all="ignore"):
            error = np.sqrt(covariance(known._replace(radius=np.full_like(known.radius, np.nan)), sphere)[:, -1, -1])
            if prior is None:
                score = _at_radii(known, start, known.radius[:, None]).score[:, 0]
                away = (known.radius - sphere.radius) / error
                p = 2.0 * scipy.special.stdtr(_spare(known) - 1.0, -np.abs(np.where(np.isnan(score), away, score)))
            else:
                away = (prior.radius / known.unit - sphere.radius) / np.hypot(error, prior.uncertainty / known.unit)
                deviance = self._believed.deviance
                p = scipy.special.chdtrc(1.0, np.where(np.isnan(deviance), away**2, deviance))
        numbers = [sphere.radius * known.unit, error * known.unit, p]
        lost = ~np.isfinite(known.radius)
        return RadiusTest(*(np.where(lost, np.nan, array) for array in numbers))

    def _intervals_at(self, level: float) -> Intervals:
        """Intervals of the flat batch, with what was given."""
        sets, stretch = self._different, self.allowed.stretch(level, self.spare) * self.selection
        if self.given.prior is not None:
            return self._uncertain_intervals(level, stretch)
        stretch[np.isfinite(self.given.radius), -1] = 1.0

        def again(some: Ints, factors: Floats) -> Intervals:
            return given_intervals(sets.take(some), level, factors)

        ends = widened(given_intervals(sets, level, np.ones(len(stretch))), stretch, again)
        if self.given.sigma_alone:
            ends = self.open_on_hinges(ends, level)
        if (plain := self._nothing_known).any():
            for whole, part in zip(ends, super()._intervals_at(level), strict=True):
                whole[plain] = part[plain]
        return ends

    def _uncertain_intervals(self, level: float, stretch: Floats) -> Intervals:
        """Intervals for a radius stated with an uncertainty; they hold those of the known radius that is likeliest.

        Args:
            level: nominal coverage.
            stretch: factors of `PointEvidence.stretch` (b, d + 1).
        """
        sets = self._different
        radius, center = self._believed.ends(level, _spare(sets))
        given = given_intervals(sets, level, np.ones(len(radius)))
        middle = center.mean(axis=2, keepdims=True)
        center = middle + (center - middle) * stretch[:, :-1, None]
        radius = radius.mean(axis=1, keepdims=True) + (radius - radius.mean(axis=1, keepdims=True)) * stretch[:, -1:]
        center = sets.origin[..., None] + center * sets.unit[:, None, None]
        center[..., 0] = np.fmin(center[..., 0], given.center[..., 0])
        center[..., 1] = np.fmax(center[..., 1], given.center[..., 1])
        radius = np.where(np.isfinite(radius), radius * sets.unit[:, None], given.radius)
        return Intervals(radius, center, given.noise_share)

    @cached_property
    def judged(self) -> tuple[Ints, Goodness]:
        """The status by the rule for every fit, which a known radius must pass, and a noise that is given, by χ²."""
        status, goodness = super().judged
        if self._plain is not None:
            status[self._nothing_known], answers = self._plain.judged
            for whole, part in zip(goodness, answers, strict=True):
                whole[..., self._nothing_known] = part
        refused = self.radius_test.p < _NOTICED
        if self.noise_is_known:
            sets, sphere = self._sets, self._answers
            spare = np.maximum(sets.size - self.samples.shape[1] - ~np.isfinite(sets.radius), 1.0)
            with np.errstate(all="ignore"):
                distance = np.linalg.norm(sets.points - sphere.center[:, None], axis=2)
                square = (self._along(sphere) * (distance - sphere.radius[:, None]) ** 2).sum(axis=1) / sphere.scale
            refused = refused | (scipy.special.chdtrc(spare, square) < _NOTICED)
        return np.where((status == Status.OK) & refused, Status.MISFIT, status), goodness

    def remarks(self) -> Iterator[str]:
        """Lines about what was given, and whether the points agree; of a single fit."""
        known = self.given
        if np.isfinite(known.radius).all():
            (free,), (error,), (p,) = self.radius_test
            given = f"radius {float(self.estimates.radius[0]):.6g} is given"
            if known.prior is not None:
                given = f"radius {with_error(float(known.prior.radius[0]), float(known.prior.uncertainty[0]))} is given"
            words = "p < 1e-9" if p < 1e-9 else f"p = {number(float(p), '.2g')}"
            agrees = ": the points do not agree with it" if p < _NOTICED else ""
            yield f"{given}; with a free one the points have {with_error(float(free), float(error))} ({words}){agrees}"
        scale, spare = float(self.noise_scale[0]), float(self.spare[0] + np.isfinite(known.radius).all())
        ends = [scale * np.sqrt(spare / scipy.special.chdtri(spare, tail)) for tail in (0.025, 0.975)]
        times = f"{number(scale, '.3g')} times as large ({' to '.join(number(end, '.2g') for end in ends)})"
        if known.noise is not None:
            scaled = "its scale is found in them" if known.relative else "± stands on the noise as it is given"
            yield f"each point has a noise of its own, and the residuals are {times}; {scaled}"
        elif known.sigma is not None:
            given = f"noise {known.sigma:g} is given"
            yield f"{given}, and the residuals are {times}; ± stands on the noise as it is given"
        if known.radial:
            yield "the noise is taken to be along the radius alone"


def _spare(sets: Weighted) -> Floats:
    """Degrees of freedom of the noise (b,), infinite where its scale is known."""
    spare = np.maximum(sets.size - sets.points.shape[2] - np.isnan(sets.radius), 1.0)
    return np.where(np.isfinite(sets.scale), np.inf, spare)


def believed(sets: Weighted, prior: StatedRadius) -> Believed:
    """Join points and statement about radii stated with an uncertainty, in the units of the sets."""
    places = np.flatnonzero(sets.usable & (sets.size > sets.points.shape[2] + 1))
    part = sets.take(places)
    stated = StatedRadius(prior.radius[places] / part.unit, prior.uncertainty[places] / part.unit)
    open_ = part._replace(radius=np.full(len(places), np.nan))
    spare = _spare(open_)

    def fits_at(first: Floats, radii: Floats) -> AtRadius:
        return _at_radii(part, least_squares(part._replace(radius=first)), radii)

    with np.errstate(all="ignore"):
        ends = _without_radius(open_, scipy.special.stdtrit(spare, scipy.special.ndtr(1.0))).radius
        found = Believed.of(stated, ends, fits_at, spare)
    result = Believed(*(np.full((len(sets.unit), *values.shape[1:]), np.nan) for values in found))
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
    result, enough = Intervals.unbounded(b, d, level), np.flatnonzero(sets.usable & (sets.size > d + 1))
    part, known = sets.take(enough), bool(np.isfinite(sets.radius).all())
    with np.errstate(all="ignore"):
        quantile = scipy.special.stdtrit(_spare(part), 0.5 * (1.0 + level)) * factors[enough]
        ends = (_with_radius if known else _without_radius)(part, quantile)
        result.radius[enough] = ends.radius * part.unit[:, None]
        result.center[enough] = part.origin[..., None] + ends.center * part.unit[:, None, None]
        result.noise_share[enough] = ends.noise_share
    return result


def _at_radii(sets: Weighted, start: Spheres, radii: Floats) -> AtRadius:
    """The centres at radii (b, g), and their scores, from spheres near some of them, in the units of the sets."""
    result = AtRadius.unknown(radii, sets.points.shape[2])
    for places, part, _ in for_kernels(sets, start, plain=True):
        for whole, values in zip(result, at_radii(part, radii[places]), strict=True):
            whole[places] = values
    return result


def _with_radius(sets: Weighted, quantile: Floats) -> Intervals:
    """Intervals of the centre for a known radius, in the units of the sets."""
    least = least_squares(sets)
    other = solve(sets, least._replace(center=-least.center), corrected=False)
    both = (_at_radii(sets, sphere, sets.radius[:, None]) for sphere in (least, other))
    at, second = (AtRadius(*(array[:, 0] for array in one)) for one in both)
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
    start = least_squares(sets)
    sphere = corrected_equations(sets, start)
    fine = sphere.found & (sphere.radius < _FAR)
    for part, better in zip(start, sphere, strict=True):
        part[fine] = better[fine]
    result = Intervals.unbounded(len(fine), sets.points.shape[2], 0.5)
    for places, some, _ in for_kernels(sets, start):
        for whole, values in zip(result, intervals_of(some, quantile[places]), strict=True):
            whole[places] = values
    return result


def fit_given(points: Floats, entry: Estimator, given: Given) -> tuple[Estimates, Samples]:
    """Fit points (…, n, d) with a known radius or a noise for each point: the numbers and the samples, flat.

    See `study.fit`.
    """
    x = np.array(points.reshape(-1, *points.shape[-2:]).swapaxes(1, 2), dtype=float, order="C")
    if given.sigma_alone and given.sigma is not None:
        samples = Samples(x, given.sigma, given=given)
        answer = careful_fit(entry, samples)
        answer.noise_variance[np.isfinite(answer.noise_variance)] = given.sigma**2
        return answer, samples
    if given.noise is not None:  # a point without a noise is missing
        unknown = given.noise <= 0.0 if given.noise.ndim == 2 else np.einsum("bnii->bn", given.noise) <= 0.0
        x[np.broadcast_to(unknown[:, None], x.shape)] = np.nan
    infinite = np.isinf(x).any(axis=(1, 2))
    found = find(Samples(x), known=given.exact_radius) if entry.without_outliers else None
    left = infinite[:, None] if found is None else infinite[:, None] | found.named
    sets = weighted(np.where(left[:, None], np.nan, x), given)
    if given.prior is not None:
        radius = believed(sets, given.prior).at(np.full((len(x), 1), 0.5))[0][:, 0]
        sets = sets._replace(radius=np.where(np.isfinite(radius), radius, sets.radius))
        given = given._replace(radius=np.where(np.isfinite(radius), radius * sets.unit, given.radius))
    answer, plain = estimate(sets, entry), np.flatnonzero(sets.alike & np.isnan(given.radius) & ~infinite)
    if len(plain):
        for whole, part in zip(answer, careful_fit(entry, Samples(x[plain])), strict=True):
            whole[plain] = part
    if found is not None and given.prior is None:  # with an uncertain radius the points that are left are fitted
        weighed = np.isfinite(found.radius) & (answer.status == Status.OK)
        answer.center[weighed], answer.noise_variance[weighed] = found.center[weighed], found.variance[weighed]
    answer.status[infinite] = Status.NOT_FINITE
    fitted = np.isfinite(answer.radius) & np.isfinite(given.radius)
    answer.radius[fitted] = given.radius[fitted]
    return answer, Samples(x, given=given)
