"""The points of fits: what they show of the spheres, the errors and intervals that stand on them, and the status.

The status that a user sees follows one rule for every estimator, beside what the estimator says itself. Covariances and
intervals use what is known beforehand. A known radius is tested by the fit with a free one, a noise that was given by
χ². Where each point has a noise of its own, residuals are tested in units of it.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import scipy

from study.arrays import Bools, Floats, Ints
from study.fits.errors.intervals import Intervals, degrees, intervals
from study.fits.errors.prior import Believed, believed
from study.fits.errors.weighted import Spheres, at_radii, corrected_equations, covariance, estimates
from study.fits.estimators.corrected import corrected
from study.fits.estimators.robust import Found, find, found_in
from study.fits.evidence.circle import Circle, fit_circles, lowest_radius
from study.fits.evidence.goodness import Goodness, form_beside_noise, number_of
from study.fits.evidence.judge import Assumptions, PointEvidence, gather, influence, judge, outliers_of, widened
from study.fits.points.information import normal_weights
from study.fits.points.samples import (
    Estimates,
    Estimator,
    Samples,
    Status,
    careful_fit,
    plug_in_bound,
    repeated,
    unless_missing,
)
from study.text import number, with_error

_NOTICED = 0.01
"""p value below which the points do not agree with a known radius, or with the noise that was given."""
_FREE = Estimator(partial(estimates, corrected_equations))


class RadiusTest(NamedTuple):
    """The radius of the free fit beside the given one: r̂, its standard error, and the p value of the given one."""

    radius: Floats
    error: Floats
    p: Floats


class FittedPoints:
    """The points of a flat batch of fits, and what they show of these.

    Args:
        estimates: the fits (b,).
        samples: the points (b, d, n), missing ones as NaN.
        entry: the estimator; None if it is not known.
        assumed: of the points.
    """

    def __init__(self, estimates: Estimates, samples: Samples, entry: Estimator | None, assumed: Assumptions) -> None:
        self.estimates = estimates
        self.samples = samples
        self.entry = entry
        self.assumed = assumed
        self.without_outliers = entry is not None and entry.without_outliers
        self._intervals = dict[float, Intervals]()

    @cached_property
    def observed(self) -> Samples:
        """The points, with weights where they differ: by their noise along the directions from the free fit."""
        along = self.samples.given is not None and self.samples.given.covariances is not None
        return replace(self.samples, weights=self._along(self._free.center)) if along else self.samples

    def _along(self, center: Floats) -> Floats:
        """Weights of the points (b, n), by their noise along the directions from centres if it depends on these."""
        given = self.samples.given
        if given is None or given.covariances is None:
            return self.samples.p
        with np.errstate(all="ignore"):
            away = self.samples.points - center[:, None]
            return normal_weights(away / np.linalg.norm(away, axis=2, keepdims=True), given.covariances)

    @cached_property
    def _free_samples(self) -> Samples:
        """The points that the fit stands on, as if no radius were known."""
        used = self.samples.without(self.outliers) if self.without_outliers else self.samples
        return used.with_radius(np.full(len(used.x), np.nan))

    @cached_property
    def _free(self) -> Estimates:
        """Fits of these by the corrected equations."""
        return careful_fit(_FREE, self._free_samples)

    @property
    def spheres(self) -> Estimates | None:
        """Spheres whose residuals are looked at, if they are known already."""
        plain = self.samples.given is None and self.entry is not None and self.entry.function is corrected
        return self.estimates if plain else None

    @cached_property
    def outliers(self) -> Bools:
        """True for the points (b, n) that do not belong to the sphere of the majority.

        Where each point has a noise of its own they are those beyond the largest deviation, in units of it, that clean
        points have once in a hundred data sets.
        """
        return self.found.named if self.samples.weights is None else outliers_of(self.observed)

    @cached_property
    def found(self) -> Found:
        """The outliers, and what leaving them out adds to the errors."""
        exact = self.samples.stated is None and np.isfinite(self.samples.radius).all()
        if self.without_outliers and exact:
            return find(self.samples, known=self.samples.radius)
        return found_in(self.samples)

    @property
    def selection(self) -> Floats:
        """Factors on the standard errors for the choice of the points (b, d + 1); 1 unless outliers are left out."""
        b, d, _ = self.samples.shape
        return self.found.ratio if self.without_outliers else np.ones((b, d + 1))

    @cached_property
    def repeated(self) -> Bools:
        """True for the points (b, n) that repeat an earlier one."""
        return repeated(self.samples.x)

    @cached_property
    def present(self) -> Bools:
        """False for missing points (b, n)."""
        return np.logical_not(np.isnan(self.samples.x).any(axis=1))

    @cached_property
    def from_center(self) -> tuple[Floats, Floats]:
        """Distances (b, n) and directions (b, d, n) from ĉ."""
        with np.errstate(all="ignore"):
            away = np.subtract(self.samples.x, self.estimates.center[:, :, None], order="C")  # one order of adding
            distance = np.sqrt(np.einsum("bdn,bdn->bn", away, away))
            return distance, away / distance[:, None]

    @cached_property
    def used(self) -> Bools:
        """True for the points (b, n) that the fit stands on: those that are not missing, and no outliers left out."""
        return self.present & ~self.outliers if self.without_outliers else self.present

    @cached_property
    def different(self) -> Samples:
        """The points that the fit stands on, copies once."""
        if not self.without_outliers and not self.repeated.any():
            return self.observed
        return self.observed.without(~self.used | self.repeated)

    @cached_property
    def spare(self) -> Ints:
        """Degrees of freedom of the noise (b,): different points that the fit stands on, less d + 1; at least 1."""
        b, d, n = self.samples.shape
        if not self.without_outliers and not self.repeated.any() and np.isfinite(self.samples.moments.fourth).all():
            return np.full(b, max(n - d - 1, 1))
        return np.asarray(np.maximum((self.used & ~self.repeated).sum(axis=1) - d - 1, 1))

    @cached_property
    def evidence(self) -> PointEvidence:
        """Evidence in the residuals of these points."""
        return gather(self.different, self.assumed, self.spheres if self.different is self.observed else None)

    @cached_property
    def allowed(self) -> PointEvidence:
        """The evidence for which errors and intervals allow: in the residuals, and a known radius that points refuse.

        Such a radius is a coefficient of degree 0, which joins those of degree 2 that measure structure, in units of
        the free fit's noise; the noise of this fit may hold the refused part already (theory 13.6).
        """
        seen, test = self.evidence, self.radius_test
        refused = test.p < _NOTICED
        if not refused.any():
            return seen
        with np.errstate(all="ignore"):  # a radius without an error
            shift = (((test.radius - self.estimates.radius) / test.error) ** 2).reshape(-1, 1)
            freedom = np.minimum(seen.freedom, number_of(self.samples.shape[1], 2))
            noise = np.sqrt(np.minimum(self._free.noise_variance / self.estimates.noise_variance, 1.0))[:, None]
            ratio = np.sqrt((freedom * seen.ratio**2 + shift) / (freedom + 1.0)) * noise
        wider = refused.reshape(-1, 1) & (ratio > seen.ratio) & np.isfinite(ratio)
        return seen._replace(
            ratio=np.where(wider, ratio, seen.ratio), freedom=np.where(wider, freedom + 1.0, seen.freedom)
        )

    @cached_property
    def judged(self) -> tuple[Ints, Goodness]:
        """The status of each fit (b,) after what its residuals show, and the answers of the tests.

        The points must not refuse a known radius, nor a noise that was given.
        """
        ends = self.intervals(0.95)
        status = ruled_status(self.estimates, ends)
        told = self.samples.given is not None and self.noise_is_known  # no large form can hide beside it
        known = form_beside_noise(self.spare + self.samples.shape[1] + 1, self.spare) if told else None
        status, goodness = judge(
            self.evidence, self.different, status, ends, self.assumed, self.without_outliers, known
        )
        refused = (self.radius_test.p < _NOTICED) | (self._noise_test < _NOTICED)
        return np.where((status == Status.OK) & refused, Status.MISFIT, status), goodness

    @property
    def _noise_test(self) -> Floats:
        """The p value of the noise that was given (b,), by χ²; NaN where none was."""
        if self.samples.given is None:
            return np.full(len(self.samples.x), np.nan)
        spare, square = self._left(self._along(self.estimates.center))
        with np.errstate(all="ignore"):
            return np.asarray(scipy.special.chdtrc(spare, square / self.samples.scale))

    @cached_property
    def noise_scale(self) -> Floats:
        """The noise that the residuals show over the one that was given (b,); see `Fit.noise_scale`."""
        if self.samples.given is None:
            return np.full(len(self.samples.x), np.nan)
        spare, square = self._left(self.samples.p)
        with np.errstate(all="ignore"):
            return np.asarray(np.sqrt(square / spare / self.samples.given.size))

    def _left(self, weights: Floats) -> tuple[Floats, Floats]:
        """Degrees of freedom N - k of the residuals, NaN if there are none, and Σ p (R - r̂)² (b,)."""
        spare = self.used.sum(axis=1) - self.samples.shape[1] - np.isnan(self.samples.radius)
        with np.errstate(all="ignore"):
            square = np.where(self.used, weights * (self.from_center[0] - self.estimates.radius[:, None]) ** 2, 0.0)
        return np.where(spare > 0, spare, np.nan), square.sum(axis=1)

    @cached_property
    def circles(self) -> Circle:
        """The circles in space of the points, NaN in other than three dimensions."""
        return fit_circles(self.different)

    def intervals(self, level: float) -> Intervals:
        """Intervals of a level, with allowance for structure; open along the axis where the points lie on a circle."""
        if level not in self._intervals:
            self._intervals[level] = self._intervals_at(level)
        return self._intervals[level]

    def _intervals_at(self, level: float) -> Intervals:
        """The intervals, computed."""
        different, stretch = self.different, self.allowed.stretch(level, self.spare) * self.selection
        white = intervals(different, level)
        if self.samples.stated is not None:
            return self._uncertain_intervals(level, stretch, white)
        stretch[np.isfinite(self.samples.radius), -1] = 1.0
        ends = widened(white, stretch, lambda sets, factors: intervals(different.take(sets), level, factors))
        return self.open_on_hinges(ends, level)

    @cached_property
    def _believed(self) -> Believed:
        """Radii by points and statement together."""
        return believed(self.different)

    def _uncertain_intervals(self, level: float, stretch: Floats, given: Intervals) -> Intervals:
        """Intervals for a radius stated with an uncertainty; they hold those of the known radius that is likeliest.

        Args:
            level: nominal coverage.
            stretch: factors of `PointEvidence.stretch` (b, d + 1).
            given: intervals for that radius.
        """
        ends = self._believed.ends(level, degrees(self.samples, (self.used & ~self.repeated).sum(axis=1)))
        radius, center = (
            array.mean(axis=-1, keepdims=True) + (array - array.mean(axis=-1, keepdims=True)) * factors
            for array, factors in zip(ends, (stretch[:, -1:], stretch[:, :-1, None]), strict=True)
        )
        center[..., 0] = np.fmin(center[..., 0], given.center[..., 0])
        center[..., 1] = np.fmax(center[..., 1], given.center[..., 1])
        return Intervals(np.where(np.isfinite(radius), radius, given.radius), center, given.noise_share)

    def open_on_hinges(self, ends: Intervals, level: float) -> Intervals:
        """Intervals of a level that are open along the axis where the points lie on a circle."""
        sets = np.flatnonzero(self.evidence.hinge & np.isnan(self.samples.radius))
        if not len(sets):
            return ends
        least = lowest_radius(fit_circles(self.different.take(sets)), level, self.spare[sets] + 1)
        radius, center = ends.radius.copy(), ends.center.copy()
        center[sets] = -np.inf, np.inf
        radius[sets] = np.column_stack([least, np.full(len(sets), np.inf)])
        return Intervals(radius, center, ends.noise_share)

    @cached_property
    def white_covariance(self) -> Floats:
        """Covariance of (ĉ, r̂) (b, d+1, d+1) for white noise, whatever the residuals show, unit squared.

        It is the estimator's own if it has one (`Estimator.covariance`), else the Cramér-Rao bound with the estimates
        plugged in. These are the noise, given or estimated, and the directions of the points from ĉ, without outliers
        if the estimator leaves them out. The bound includes neither an estimator's bias (`gdke`, `lls`) nor
        the excess of one that does not attain it. NaN or infinite where it cannot be formed.
        """
        own = None if self.entry is None else self.entry.covariance
        plain = self.samples.given is None or self.samples.sigma_alone
        if own is not None and plain:
            return unless_missing(own, self.samples, self.estimates)
        distance, directions = self.from_center
        away = self.used & (distance > 0.0)  # a point at the centre has no direction
        bound = plug_in_bound(directions, away, self.samples.noise, self.estimates.noise_variance)
        if plain:
            return bound

        def known(samples: Samples, fits: Estimates) -> Floats:
            if own is not None and samples.given is None and samples.weights is None:
                return own(samples, fits)
            return covariance(samples, fits, own is not None)

        used = self.samples.without(~self.used)
        result = unless_missing(known, used, self.estimates)
        if own is None:
            result[used.nothing_known] = bound[used.nothing_known]
        if self.samples.stated is not None:
            deviation, slope = self._believed.spread()
            line = deviation[:, None] * np.column_stack([slope, np.ones(len(slope))])
            result += np.nan_to_num(line[:, :, None] * line[:, None], nan=0.0)
        return result

    @property
    def noise_is_known(self) -> bool:
        """True if the covariance stands on a noise that was given."""
        used = self.samples.noise is not None and (self.entry is None or self.entry.covariance is None)
        return used or bool(np.isfinite(self.samples.scale).any())

    @property
    def held(self) -> Floats:
        """Noise variance over the squared uncertainty of a radius that is known (b,); 0 where none is."""
        if (stated := self.samples.stated) is not None:
            return np.asarray(self.estimates.noise_variance / stated.uncertainty**2)
        return np.where(np.isfinite(self.samples.radius), np.inf, 0.0)

    @property
    def design(self) -> tuple[Floats, Floats, Floats]:
        """Directions (b, d, n) and weights (b, n) of the points, 0 where they are not used, and `held` (b,)."""
        distance, directions = self.from_center
        return directions, np.where(self.used & (distance > 0.0), self.observed.p, 0.0), self.held

    @cached_property
    def radius_test(self) -> RadiusTest:
        """The free fit as a test of a known radius (b,), NaN without one; see `Fit.radius_test`."""
        known = self.samples.radius
        if not np.isfinite(known).any():
            return RadiusTest(*np.full((3, len(known)), np.nan))
        free, prior = self._free, self.samples.stated
        with np.errstate(all="ignore"):
            error = np.sqrt(unless_missing(covariance, self._free_samples, free)[:, -1, -1])
            if prior is None:
                score, away = self._scores(known), (known - free.radius) / error
                spare = degrees(self._free_samples, self.used.sum(axis=1))
                p = 2.0 * scipy.special.stdtr(spare, -np.abs(np.where(np.isnan(score), away, score)))
            else:
                away = (prior.radius - free.radius) / np.hypot(error, prior.uncertainty)
                deviance = self._believed.deviance
                p = scipy.special.chdtrc(1.0, np.where(np.isnan(deviance), away**2, deviance))
        return RadiusTest(*(np.where(np.isnan(known), np.nan, array) for array in (free.radius, error, p)))

    def _scores(self, radius: Floats) -> Floats:
        """Scores of known radii (b,)."""
        result, (center, r, variance) = np.full(len(radius), np.nan), self.estimates[:3]
        for sets, part in self._free_samples.by_count():
            if part.shape[2] > part.shape[1]:
                sphere = Spheres(center[sets], r[sets], variance[sets], np.isfinite(r[sets]))
                result[sets] = at_radii(part, sphere, radius[sets, None]).score[:, 0]
        return result

    def remarks(self) -> Iterator[str]:
        """Lines about what was given, and whether the points agree; of a single fit."""
        samples, known = self.samples, self.samples.given
        if known is None:
            return
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
        if samples.weights is not None:
            scaled = "its scale is found in them" if known.relative else "± stands on the noise as it is given"
            yield f"each point has a noise of its own, and the residuals are {times}; {scaled}"
        elif np.isfinite(known.size).all():
            given = f"noise {float(np.sqrt(known.size[0])):g} is given"
            yield f"{given}, and the residuals are {times}; ± stands on the noise as it is given"
        if known.radial:
            yield "the noise is taken to be along the radius alone"

    @cached_property
    def influence(self) -> float:
        """Largest change of a single fit without its outliers, in standard errors without them; 0 if it has none."""
        if self.without_outliers or not self.outliers.any():
            return 0.0
        return float(influence(self.observed, self.outliers)[0])


def ruled_status(estimates: Estimates, ends: Intervals) -> Ints:
    """Status of each fit (b,) by the intervals of its points at 95 %.

    A rule that admits only fits far from the noise selects those whose curvature came out too large, and intervals of
    such fits do not cover. Intervals of the fits that are bounded do (theory 10.5). So this rule replaces the
    estimator's "ok" and "insignificant"; only an estimate outside its own interval stays insignificant. Failures stay.
    """
    own, radius = estimates.status.reshape(-1), estimates.radius.reshape(-1)
    inside = (ends.radius[:, 0] <= radius) & (radius <= ends.radius[:, 1])
    ruled = (own == Status.OK) | (own == Status.INSIGNIFICANT)
    accepted = np.where((own == Status.OK) | inside, Status.OK, own)
    return np.asarray(np.where(ruled, np.where(ends.identified, accepted, Status.WEAKLY_IDENTIFIED), own))
