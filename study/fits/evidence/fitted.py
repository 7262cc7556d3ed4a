"""The points of fits: what they show of the spheres, the errors and intervals that stand on them, and the status.

The status that a user sees follows one rule for every estimator, beside what the estimator says itself.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np

from study.arrays import Bools, Floats, Ints
from study.fits.errors.intervals import Intervals, intervals
from study.fits.estimators.corrected import corrected
from study.fits.estimators.robust import Found, found_in
from study.fits.evidence.circle import Circle, fit_circles, lowest_radius
from study.fits.evidence.goodness import Goodness, form_beside_noise
from study.fits.evidence.judge import Assumptions, PointEvidence, gather, influence, judge, widened
from study.fits.points.samples import Estimates, Estimator, Samples, Status, plug_in_bound, repeated, unless_missing


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

    @property
    def observed(self) -> Samples:
        """The points, with weights where they differ."""
        return self.samples

    @property
    def spheres(self) -> Estimates | None:
        """Spheres whose residuals are looked at, if they are known already."""
        return self.estimates if self.entry is not None and self.entry.function is corrected else None

    @cached_property
    def outliers(self) -> Bools:
        """True for the points (b, n) that do not belong to the sphere of the majority."""
        return self.found.named

    @cached_property
    def found(self) -> Found:
        """The outliers, and what leaving them out adds to the errors."""
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

    @property
    def allowed(self) -> PointEvidence:
        """The evidence for which errors and intervals allow."""
        return self.evidence

    @cached_property
    def judged(self) -> tuple[Ints, Goodness]:
        """The status of each fit (b,) after what its residuals show, and the answers of the tests."""
        ends = self.intervals(0.95)
        status = ruled_status(self.estimates, ends)
        told = self.samples.given is not None and self.noise_is_known  # no large form can hide beside it
        known = form_beside_noise(self.spare + self.samples.shape[1] + 1, self.spare) if told else None
        return judge(self.evidence, self.different, status, ends, self.assumed, self.without_outliers, known)

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
        different = self.different
        white, stretch = intervals(different, level), self.evidence.stretch(level, self.spare) * self.selection
        ends = widened(white, stretch, lambda sets, factors: intervals(different.take(sets), level, factors))
        return self.open_on_hinges(ends, level)

    def open_on_hinges(self, ends: Intervals, level: float) -> Intervals:
        """Intervals of a level that are open along the axis where the points lie on a circle."""
        sets = np.flatnonzero(self.evidence.hinge)
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
        if self.entry is not None and self.entry.covariance is not None:
            return unless_missing(self.entry.covariance, self.samples, self.estimates)
        distance, directions = self.from_center
        away = self.used & (distance > 0.0)  # a point at the centre has no direction
        return plug_in_bound(directions, away, self.samples.noise, self.estimates.noise_variance)

    @property
    def noise_is_known(self) -> bool:
        """True if the covariance stands on a noise that was given."""
        return self.samples.noise is not None and (self.entry is None or self.entry.covariance is None)

    @property
    def held(self) -> Floats:
        """Noise variance over the squared uncertainty of a radius that is known (b,): of none here."""
        return np.zeros(len(self.samples.x))

    @property
    def design(self) -> tuple[Floats, Floats, Floats]:
        """Directions (b, d, n) and weights (b, n) of the points, 0 where they are not used, and `held` (b,)."""
        distance, directions = self.from_center
        weights = np.ones(self.used.shape) if self.observed.weights is None else self.observed.weights
        return directions, np.where(self.used & (distance > 0.0), weights, 0.0), self.held

    @cached_property
    def radius_test(self) -> RadiusTest:
        """The free fit as a test of a known radius (b,); NaN without one."""
        return RadiusTest(*np.full((3, len(self.samples.x)), np.nan))

    @cached_property
    def noise_scale(self) -> Floats:
        """The noise that the residuals show over the one that was given (b,); NaN without one."""
        return np.full(len(self.samples.x), np.nan)

    def remarks(self) -> Iterator[str]:
        """Lines about what was given, and whether the points agree; of a single fit."""
        return iter(())

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
