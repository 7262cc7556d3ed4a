"""Several markers about one centre (MGDK): `study.mgdk` and its answer, and `Incremental` for points one after another.

From the moments of the markers, of many data sets at once, the paper's equation 22, corrected, is

    ĉ = [Σ_p w_p (C_p - Σ̂)]⁻¹ Σ_p w_p [(C_p - Σ̂) x̄_p + ½ S_p]                            (paper eq. 22, corrected)

In print the sum closes before ½S_p; both ways of reading it are wrong (theory §2). Moments have divisor n here. As
derived, w_p = n_p - 1. But a marker's algebraic residual grows with its radius, and so its weight should fall:
w_p = n_p/r̂_p². Where the noise is unknown, one η for all markers is found from their residuals together (theory §5.5).

Points that arrive one after the other need not be stored: their moments merge exactly, and the d × d system is solved
when an answer is wanted: every closed form, and the common centre, from the same few numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import orth
from scipy.special import fdtrc, stdtrit

from study.arrays import Floats, Ints, real_array
from study.fits.answers.answer import Fit
from study.fits.answers.display import named_axis
from study.fits.errors.intervals import NOISY, Intervals, intervals_of
from study.fits.errors.weighted import BatchWeights, PointSets
from study.fits.estimators.closed_forms import smallest_root
from study.fits.evidence.circle import fit_circles, parallel
from study.fits.evidence.fitted import FittedPoints
from study.fits.evidence.goodness import HINGE, LEVEL, Answer, Goodness
from study.fits.evidence.judge import NOTHING, Assumptions, PointEvidence, gather, judge
from study.fits.loops.linalg import eigenbasis
from study.fits.points.moments import Moments, Regression
from study.fits.points.noise import noise_covariance
from study.fits.points.samples import (
    FARTHEST,
    Estimator,
    Samples,
    Status,
    binary_size,
    blank,
    is_ordinary,
    repeated,
    scaled_noise,
)
from study.text import number, with_error
from study.words import Hinting

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False, eq=False)
class JointFit(Hinting):
    """The common centre of several markers, as `mgdk` finds it.

    Attributes:
        center: ĉ (d,), in the unit of the points.
        radii: r̂ of each marker (M,), in the unit of the points; NaN where no radius is real.
        noise_variance: σ² of one coordinate, unit squared: as given (the mean over coordinates, for a covariance) or
            estimated.
        own_status: `Status` by the equations alone, before the points are tested.
        condition: ρ, the largest share of noise in Σ w_p C_p along any direction; it must be below 1.
        covariance: covariance of ĉ (d, d), unit squared: the Cramér-Rao bound with the estimates plugged in.
        count: number of samples used of each marker (M,); points with a NaN are left out.
        markers: the points of each marker (n_p, d), missing ones as NaN.
        assumed: what the user knows of the points.

    Examples:
        >>> import numpy as np, study
        >>> angles = np.linspace(0, 6, 50)
        >>> circle = np.column_stack([np.cos(angles), np.sin(angles)])
        >>> near = 1 * circle + np.random.default_rng(1).normal(0, 0.01, circle.shape)
        >>> far = 2 * circle + np.random.default_rng(2).normal(0, 0.01, circle.shape)
        >>> joint = study.mgdk([near, far])
        >>> joint.ok, joint.radii.round(2), joint.standard_errors.round(4)
        (True, array([1., 2.]), array([0.0013, 0.0013]))
    """

    center: Floats
    radii: Floats
    noise_variance: float
    own_status: Status
    condition: float
    covariance: Floats
    count: Ints
    markers: tuple[Floats, ...] = field(default=())
    assumed: Assumptions = NOTHING

    @property
    def status(self) -> Status:
        """`Status` of the fit by the rule for every fit, after the points of each marker are tested.

        Its own if it failed. Markers on circles about one axis are a *hinge*. A fit is a *misfit* if a marker's points
        are not a sphere about the common centre, or the markers do not share one (`agreement`). It uses *outliers* if
        some of a marker's points are outliers that matter. It is weakly identified if no marker bounds its radius by
        an `interval`, with a noise below a third of it. Without its points it is *untested*.
        """
        return self._judged[0]

    @property
    def goodness(self) -> tuple[Goodness, ...]:
        """The tests of each marker's points about the common centre, M of them."""
        return self._judged[1]

    @cached_property
    def _judged(self) -> tuple[Status, tuple[Goodness, ...]]:
        """The status and the tests of the markers."""
        if self.own_status != Status.OK or not self.markers:
            unknown = self.own_status == Status.OK and not self.assumed.sphere
            untested = (Goodness.untested((), Answer.NO_POINTS),) * len(self.radii)
            return (Status.UNTESTED if unknown else self.own_status), untested
        statuses, tests = list[Status](), list[Goodness]()
        for samples, evidence in zip(self._samples, self._evidence, strict=True):
            ruled, goodness = judge(evidence, samples, np.zeros(1, dtype=np.int64), None, self.assumed, False)
            statuses.append(Status(int(ruled[0])))
            tests.append(goodness.take(0))
        ends = self.intervals(0.95)
        if self._hinge:
            status = Status.HINGE
        elif Status.OUTLIERS in statuses:
            status = Status.OUTLIERS
        elif Status.MISFIT in statuses or self.agreement < REFUSED:
            status = Status.MISFIT
        elif not (np.isfinite(ends.center).all() and ends.identified.any()):
            status = Status.WEAKLY_IDENTIFIED
        else:
            status = Status.UNTESTED if set(statuses) == {Status.UNTESTED} else Status.OK
        return status, tuple(tests)

    @cached_property
    def _hinge(self) -> bool:
        """True if all markers that can tell are on circles in space, about parallel axes."""
        answers = [seen.goodness.answers[HINGE, 0] for seen in self._evidence]
        told = [answer for answer in answers if answer in (Answer.PASSED, Answer.FAILED)]
        if not told or Answer.PASSED in told:
            return False
        named = (answer == Answer.FAILED for answer in answers)
        return parallel([fit_circles(samples) for samples, on in zip(self._samples, named, strict=True) if on])

    @cached_property
    def _samples(self) -> tuple[Samples, ...]:
        """The points of each marker, copies once."""
        every = [Samples(np.ascontiguousarray(points.T[None])) for points in self.markers]
        return tuple(samples.without(repeated(samples.x)) for samples in every)

    @cached_property
    def _evidence(self) -> tuple[PointEvidence, ...]:
        """Evidence in the points of each marker about the common centre."""
        seen = list[PointEvidence]()
        for samples, radius in zip(self._samples, self.radii, strict=True):
            sphere = blank(1, len(self.center))
            sphere.center[0], sphere.radius[0], sphere.noise_variance[0] = self.center, radius, self.noise_variance
            seen.append(gather(samples, self.assumed, sphere, LEVEL / len(self.radii)))
        return tuple(seen)

    @property
    def ok(self) -> bool:
        """True if the status is ok."""
        return self.status == Status.OK

    @property
    def sigma(self) -> float:
        """Standard deviation σ of one coordinate, in the unit of the points: the root of `noise_variance`."""
        return float(np.sqrt(self.noise_variance)) if self.noise_variance >= 0.0 else np.nan

    @property
    def standard_errors(self) -> Floats:
        """Standard errors of ĉ's components (d,), in the unit of the points; see `covariance`."""
        with np.errstate(all="ignore"):
            return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def residuals(self) -> list[Floats]:
        """Signed distance of each marker's points from its sphere, M arrays (n_p,), in the unit of the points.

        It is |x - ĉ| - r̂_p, positive outside; NaN where a sample is missing.

        Raises:
            ValueError: if the fit does not hold its points, because it is from `mgdk_so_far`.
        """
        if not self.markers:
            raise ValueError("this fit does not hold its points: use study.mgdk, which stores them in the fit")
        with np.errstate(all="ignore"):
            away = [np.sqrt(np.sum((points - self.center) ** 2, axis=1)) for points in self.markers]
        return [np.asarray(distance - radius) for distance, radius in zip(away, self.radii, strict=True)]

    @property
    def agreement(self) -> float:
        """The p value of the markers' having one centre; NaN where they leave nothing to compare.

        An F test of the squares that the common centre leaves beyond those that each marker leaves about a centre of
        its own, both by regression on the directions. It is exact for white isotropic noise, small beside the radii.
        Markers that spread less than twice the noise along some direction of the sphere tell nothing and are left out.
        Below 0.01 a fit that would be ok is a misfit.

        Raises:
            ValueError: if the fit does not hold its points, because it is from `mgdk_so_far`.
        """
        ratio, more, spare = self._disagreement
        return float(fdtrc(more, spare, ratio))

    @cached_property
    def _disagreement(self) -> tuple[float, int, int]:
        """The F ratio of `agreement` with its degrees of freedom; NaN where there is nothing to compare."""
        nothing = math.nan, 1, 1
        there = [points[np.isfinite(away)] for points, away in zip(self.markers, self.residuals, strict=True)]
        there = [points for points in there if len(points) > points.shape[1] + 1]
        if len(there) < 2:
            return nothing
        own = [mgdk([points]) for points in there]
        noise = np.sqrt(np.average([fit.noise_variance for fit in own], weights=[len(points) for points in there]))
        markers, apart, ranks = list[Floats](), 0.0, 0
        for points, fit in zip(there, own, strict=True):
            if 2.0 * noise < _spread(points, fit.center):
                left, rank = _left([points], fit.center)
                apart, ranks = apart + np.fmin(left, _left([points], self.center)[0]), ranks + rank
                markers.append(points)
        if len(markers) < 2:
            return nothing
        together, parameters = _left(markers, self.center)
        more, spare = ranks - parameters, sum(map(len, markers)) - ranks
        if more < 1 or spare < 1 or not apart > spare * (1e-11 * np.nanmax(self.radii)) ** 2:
            return nothing
        return (together - apart) / more / (apart / spare), more, spare

    def interval(self, of: str, level: float = 0.95) -> Floats:
        """Confidence interval of each radius or diameter, or of the centre or one of its coordinates.

        It depends on the points alone. Their noise is taken to be isotropic, of one unknown size for all markers. It
        covers where an estimate ± its standard error does not. That of a single marker is `Fit.interval`.

        Args:
            of: "radius", "diameter" or "center"; "x", "y" or "z" in up to three dimensions, or "center_1", "center_2",
                … in any number.
            level: nominal coverage of each interval, in (0, 1).

        Returns:
            Lower and upper ends, (M, 2) for radii, (d, 2) for the centre and (2,) for a coordinate, in the unit of the
            points. Ends that the points do not determine are 0 or infinite for a radius; where no radius is bounded
            the centre may be anywhere.

        Raises:
            ValueError: if the level is not in (0, 1), the name is another, or the fit does not hold its points.

        Source: theory §10.7.
        """
        axis, ends = named_axis(of, len(self.center)), self.intervals(level)
        if of in ("radius", "diameter"):
            return (2.0 if of == "diameter" else 1.0) * ends.radius
        return np.asarray(ends.center[0, slice(None) if axis is None else axis])

    def _stretch(self, level: float) -> Floats:
        """The factor on half-widths (1,): the largest of all markers for structure in their residuals, and Birge's.

        Birge's is the root of the F ratio of `agreement` where that is above 1. Centres that differ by too little to be
        a misfit still move the common one (Birge, Phys. Rev. 40 (1932) 207).
        """
        spare = [np.maximum(np.atleast_1d(n - len(self.center) - 1), 1) for n in self.count]
        factors = [seen.stretch(level, free).max() for seen, free in zip(self._evidence, spare, strict=True)]
        return np.array([max(factors) * math.sqrt(np.fmax(self._disagreement[0], 1.0))])

    def intervals(self, level: float) -> Intervals:
        """Intervals of each radius (M, 2) with the noise's share of it (M,), and of the centre (1, d, 2).

        That of the centre is the union over the radii of the marker whose interval is the narrowest. Where all markers
        are on circles about parallel axes it is open, and each radius has the interval of its marker alone. Markers
        with a noise of 0.35 radii or more are left out, and their radii are open.

        Raises:
            ValueError: if the level is not in (0, 1), or the fit does not hold its points.
        """
        d, residuals = len(self.center), self.residuals
        result = Intervals.unbounded(len(self.radii), d, level)
        result = result._replace(center=result.center[:1])
        arrays = [points[np.isfinite(away)] for points, away in zip(self.markers, residuals, strict=True)]
        with np.errstate(all="ignore"):
            quiet = (self.sigma / self.radii < NOISY) | (len(arrays) == 1)
        places = [p for p, points in enumerate(arrays) if len(points) >= 2 and quiet[p]]
        x = np.ascontiguousarray(np.concatenate([np.empty((0, d)), *(arrays[p] for p in places)]).T)[None]
        spare = x.shape[2] - d - len(places)
        if len(places) == 1 or self._hinge:
            for p in places:
                alone = Samples(np.ascontiguousarray(arrays[p].T)[None])
                own = FittedPoints(blank(1, d), alone, None, self.assumed).intervals(level)
                result.radius[p], result.noise_share[p] = own.radius[0], own.noise_share[0]
                result.center[:] = own.center if len(places) == 1 else result.center
            return result
        if spare < 1:
            return result
        power = int(binary_size(x)[0])
        x, center = np.ldexp(x, -power), np.ldexp(self.center[None], -power)
        quantile, narrowest = self._stretch(level) * stdtrit(spare, 0.5 + 0.5 * level), np.inf
        which = np.repeat(np.arange(len(places)), [len(arrays[p]) for p in places])
        for turn, p in enumerate(places):
            first = np.where(which == turn, 0, np.where(which == 0, turn, which))
            weights = BatchWeights(np.ones((1, x.shape[2])), np.empty((1, 2, 0)), np.full(1, np.nan), first)
            sets = PointSets(x, center, np.ldexp(self.radii[p : p + 1], -power), weights)
            ends = intervals_of(sets, quantile)
            result.radius[p], result.noise_share[p] = np.ldexp(ends.radius[0], power), ends.noise_share[0]
            width = np.ptp(np.log(ends.radius[0])) if ends.radius[0, 0] > 0.0 else np.inf
            if width < narrowest:
                narrowest, result.center[:] = width, np.ldexp(ends.center, power)
        return result

    def to_frame(self) -> pd.DataFrame:
        """A row per marker.

        Returns:
            Columns: radius, residual_rms (NaN if the fit does not hold its points), samples used; then, the same in all
            rows, each coordinate of the centre (center_1) and its standard error (error_1), noise (σ̂), condition (ρ),
            status in words.
        """
        import pandas as pd

        held = self.residuals if self.markers else [np.empty(0)] * len(self.radii)
        squares = [residuals[np.isfinite(residuals)] ** 2 for residuals in held]
        rms = [float(np.sqrt(square.mean())) if len(square) else np.nan for square in squares]
        columns: dict[str, object] = {"radius": self.radii, "residual_rms": rms, "samples": self.count}
        for i, (value, error) in enumerate(zip(self.center, self.standard_errors, strict=True)):
            columns[f"center_{i + 1}"], columns[f"error_{i + 1}"] = value, error
        columns |= {"noise": self.sigma, "condition": self.condition, "status": self.status.text}
        return pd.DataFrame(columns)

    def __repr__(self) -> str:
        center = ", ".join(with_error(*pair) for pair in zip(self.center, self.standard_errors, strict=True))
        radii = ", ".join(number(float(radius), ".6g") for radius in self.radii[:10])
        more = f", … {len(self.radii) - 10} more" if len(self.radii) > 10 else ""
        words = self.status.name.lower().replace("_", " ")
        rest = f"sigma {number(self.sigma)}, {self.count.sum():,} points, {words}"
        return f"JointFit(center ({center}), radii ({radii}{more}), {rest})"


def _spread(points: Floats, center: Floats) -> float:
    """Least standard deviation of the directions from a centre along an axis, times the mean distance; NaN at it."""
    distance = np.linalg.norm(points - center, axis=1)
    with np.errstate(all="ignore"):
        e = (points - center) / distance[:, None]
    if not np.isfinite(e).all():
        return np.nan
    least = np.linalg.svd(e - e.mean(axis=0), compute_uv=False)[-1]
    return float(least / np.sqrt(len(e)) * distance.mean())


def _left(markers: list[Floats], center: Floats) -> tuple[float, int]:
    """Squares that a regression of distances from a centre on markers and directions leaves, and its rank."""
    away = np.concatenate(markers) - center
    distance = np.linalg.norm(away, axis=1)
    if not (np.isfinite(distance) & (distance > 0.0)).all():
        return np.nan, 0
    which = np.repeat(np.eye(len(markers)), [len(points) for points in markers], axis=0)
    Q = orth(np.column_stack([which, away / distance[:, None]]))
    return float(np.sum((distance - Q @ (Q.T @ distance)) ** 2)), Q.shape[1]


class Incremental:
    """A sphere fit that grows with its points, in constant memory.

    The points are not stored. In three dimensions 14 numbers stand for all of them, about the first, and from these
    every closed form gives the answer that it gives from the points.

    Args:
        dimension: d ≥ 2.

    Attributes:
        dimension: d.
        moments: the `Moments` of the points so far, a batch of one; None while there are none.

    Raises:
        ValueError: if the dimension is smaller than 2.

    Examples:
        >>> import study
        >>> growing = study.Incremental(2)
        >>> for points in ([[1, 0], [0, 1]], [[-1, 0], [0, -1]]):
        ...     growing.update(points)
        >>> fit = growing.fit(study.ESTIMATORS["gdke"])
        >>> fit.center, float(fit.radius)
        (array([0., 0.]), 1.0)

    Source: the idea is the paper's, eqs 24-25.
    """

    def __init__(self, dimension: int) -> None:
        if dimension < 2:
            raise ValueError(f"dimension = {dimension}: a sphere needs at least 2")
        self.dimension = dimension
        self._origin = np.zeros(dimension)
        self._about_origin: Moments | None = None

    @property
    def moments(self) -> Moments | None:
        """The moments."""
        return None if self._about_origin is None else self._about_origin.moved(self._origin)

    def update(self, points: ArrayLike) -> None:
        """Add points.

        Args:
            points: one (d,) or several (n, d), in the unit of those before. Points with a NaN are left out.

        Raises:
            TypeError: if they are not real numbers.
            ValueError: if the shape is another.
        """
        array = np.atleast_2d(real_array(points, "points")).astype(float, copy=False)
        if array.ndim != 2 or array.shape[1] != self.dimension:
            d = self.dimension
            raise ValueError(f"points have shape {np.shape(points)}: expected ({d},) or (n, {d})")
        array = array[~np.isnan(array).any(axis=1)]
        if not len(array):
            return
        if self._about_origin is None:  # means of points far away would lose the digits of the sphere
            self._origin = np.where(np.isfinite(array[0]), array[0], 0.0)
        with np.errstate(all="ignore"):
            added = Moments.of((array - self._origin).T[None])
        self._about_origin = added if self._about_origin is None else self._about_origin.merge(added)

    def merge(self, other: Incremental) -> None:
        """Add the points of another fit that grew; that one stays as it is.

        Raises:
            ValueError: if it is of another dimension.
        """
        if other.dimension != self.dimension:
            raise ValueError(f"points of dimension {other.dimension} cannot be added to points of {self.dimension}")
        if other._about_origin is None:
            return
        if self._about_origin is None:
            self._origin, self._about_origin = other._origin, other._about_origin
        else:
            self._about_origin = self._about_origin.merge(other._about_origin.moved(other._origin - self._origin))

    def fit(self, estimator: Estimator, noise: float | Floats | None = None, assume: str | None = None) -> Fit:
        """Fit the points so far by a closed form.

        Args:
            estimator: one that needs the moments alone, such as ``study.ESTIMATORS["als"]``.
            noise: standard deviation σ in the unit of the points, or a covariance (d, d), for ``ugdk`` and ``hinge``.
                Others find it in the points, and a fit without points has no errors that could stand on it.
            assume: "sphere" if the points are known to lie on one, which their moments cannot test: a fit that its
                estimator calls ok is then ok, and else untested.

        Returns:
            A fit of shape ``()``. While there are fewer than d + 1 points its status is `Status.TOO_FEW_POINTS`. Points
            of a size beyond 1e40 or below 1e-40 have the status `Status.NOT_FINITE`: their moments leave the range of
            numbers.

        Raises:
            TypeError: if the noise is no real number.
            ValueError: if the estimator needs the points themselves, which are not stored, or the noise cannot be used,
                or is not used.
        """
        if not estimator.moments_suffice:
            raise ValueError("this estimator reads the points, which are not stored: take gdke, ugdk or als")
        if noise is not None:
            noise_covariance(noise, self.dimension)
            if estimator.needs != "noise" and not estimator.takes_noise:
                raise ValueError(f"noise = {noise}: this estimator finds it in the points; leave it out, or take ugdk")
        moments = self.moments
        if moments is None or moments.n[0] < self.dimension + 1:
            status = Status.TOO_FEW_POINTS
        elif np.trace(moments.second[0]) > 0.0 and not is_ordinary(moments.fourth):
            status = Status.NOT_FINITE
        else:
            regression = Regression.about_centroids(moments)
            estimates = estimator(Samples.of_regression(regression, noise)).reshape()
            return Fit(estimates, assumed=Assumptions.of(False, assume))
        fit = blank(1, self.dimension)
        fit.status[:] = status
        return Fit(fit.reshape())


REFUSED = 0.01
"""p value of the agreement below which markers do not share a centre."""
ROUNDS = 5
"""Rounds in which weights, or the noise, are found."""


class MarkersMoments(NamedTuple):
    """Moments of M markers in each of b data sets.

    Attributes:
        n: number of samples of each marker (M, 1).
        mean: x̄ (M, b, d).
        c: covariances with divisor n (M, b, d, d), unit squared.
        s: third moments, means of y|y|² (M, b, d), unit cubed.
        fourth: means of |y|⁴ (M, b), unit to the fourth.
    """

    n: Floats
    mean: Floats
    c: Floats
    s: Floats
    fourth: Floats

    @classmethod
    def of(cls, markers: Sequence[Moments]) -> Self:
        """Stack the moments of the markers, each of the same number of samples in all data sets."""
        n = np.array([m.n[:1] for m in markers])
        names = ("mean", "second", "third", "fourth")
        mean, second, third, fourth = (np.array([getattr(m, name) for m in markers]) for name in names)
        return cls(n, mean, second / n[..., None, None], third / n[..., None], fourth / n)

    def subtracted(self, noise: Floats) -> Floats:
        """Subtract so much from the covariances C_p for a noise of covariance Σ (d, d): (M, b, d, d)."""
        return np.broadcast_to(noise * ((self.n - 1.0) / self.n)[..., None, None], self.c.shape)

    def weights(self, center: Floats) -> Floats:
        """Weights n/r̂² (M, b) for a centre (b, d)."""
        return np.asarray(self.n / np.maximum(self.square_radii(center, np.zeros_like(self.c)), 1e-300))

    def center(self, subtracted: Floats, weights: Floats) -> Floats:
        """Eq. 22, corrected, about the mean of the markers' centroids: ĉ (b, d).

        Args:
            subtracted: what is subtracted from each C (M, b, d, d).
            weights: w_p (M, b).
        """
        origin, left = self.mean.mean(axis=0), self.c - subtracted
        moved = np.einsum("pbij,pbj->pbi", left, self.mean - origin) + 0.5 * self.s
        matrix, right = (weights[..., None, None] * left).sum(axis=0), (weights[..., None] * moved).sum(axis=0)
        return np.asarray(origin + solved(matrix, right[..., None])[..., 0])

    def known(self, noise: Floats, weighted: bool) -> tuple[Floats, Floats]:
        """Centre ĉ (b, d) for a noise of covariance Σ (d, d), and weights (M, b): n, or n/r̂² if weighted."""
        subtracted, weights = self.subtracted(noise), self.n + np.zeros_like(self.fourth)
        center = self.center(subtracted, weights)
        for _ in range(ROUNDS if weighted else 0):
            weights = self.weights(center)
            center = self.center(subtracted, weights)
        return center, weights

    def square_radii(self, center: Floats, subtracted: Floats) -> Floats:
        """Eq. 23, squared: r̂² (M, b) about a centre (b, d)."""
        away = self.mean - center
        return np.asarray(np.trace(self.c - subtracted, axis1=2, axis2=3) + np.einsum("pbi,pbi->pb", away, away))


def solved(matrix: Floats, right: Floats) -> Floats:
    """Solutions of linear systems (b, d, d) for right-hand sides (b, d, k); the least one of a singular matrix."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:  # to the last bit
        return np.asarray(np.linalg.pinv(matrix) @ right)


def mgdk(
    markers: Sequence[ArrayLike],
    noise: ArrayLike | None = None,
    weighted: bool = True,
    *,
    ordered: bool = False,
    assume: str | None = None,
) -> JointFit:
    """Fit spheres with one common centre to several markers, each with a radius of its own (MGDK).

    Args:
        markers: points (n_p, d) of each marker, in one unit and one coordinate system; n_p may differ. Points with a
            NaN, or masked, are missing samples.
        noise: standard deviation σ of each coordinate, in the unit of the points, a covariance Σ (d, d), or None: it
            is then estimated from the points.
        weighted: weigh each marker by 1/r̂². If False, eq. 22 as derived is used, whose errors exceed the reported
            covariance where the radii differ.
        ordered: the rows of each marker are in the order in which they were measured, so that memory is no misfit.
        assume: "sphere" if each marker is known to stay on a sphere: the shape is then not tested.

    Returns:
        A `JointFit`. Look at its ``status`` before using the numbers: markers that determine no centre have a status,
        and raise nothing.

    Raises:
        TypeError: if the points or the noise are not real numbers.
        ValueError: if there is no marker, or a shape or the noise cannot be used. The message says which and why.

    Examples:
        >>> import numpy as np, study
        >>> near = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]])
        >>> study.mgdk([near, 3 * near]).radii
        array([1., 3.])

    Source: paper eqs 22-23; the correction is in theory §2, weights and the joint root in §5.5.
    """
    assumed = Assumptions.of(ordered, assume)
    given = tuple(_points(marker, place) for place, marker in enumerate(markers))
    arrays = [array[np.logical_not(np.isnan(array).any(axis=1))] for array in given]
    if not arrays or len({array.shape[1] for array in arrays}) != 1:
        raise ValueError(f"markers of shapes {[a.shape for a in arrays]}: give at least one, all of the same dimension")
    d, count = arrays[0].shape[1], np.array([len(array) for array in arrays])
    known = None if noise is None else noise_covariance(noise, d)
    # in a unit of their size, a power of two, if the points are so large or small that their powers leave float64
    power = int(binary_size(np.concatenate(arrays).T[None])[0]) if count.any() else 0
    if not all(np.isfinite(array).all() for array in arrays) or abs(power) > FARTHEST:
        return replace(_nothing(d, count, Status.NOT_FINITE), markers=given)
    if power:
        arrays = [np.ldexp(array, -power) for array in arrays]
        known = None if known is None else np.asarray(scaled_noise(known, -power))
    used = [array for array in arrays if len(array) >= 2]  # one sample fixes its marker's radius and no more
    moments = [Moments.of(np.ascontiguousarray(array.T)[None]) for array in used]
    unit_noise = np.eye(d) if known is None else known

    def bound(_: MarkersMoments, solution: _Solution) -> Floats:
        return _unit_bound(arrays, solution[0], unit_noise)

    result = _fit_moments(moments, count, d, known, weighted, bound)
    return replace(
        result,
        markers=given,
        assumed=assumed,
        center=np.ldexp(result.center, power),
        radii=np.ldexp(result.radii, power),
        noise_variance=float(np.ldexp(result.noise_variance, 2 * power)),
        covariance=np.ldexp(result.covariance, 2 * power),
    )


def mgdk_so_far(markers: Sequence[Incremental]) -> JointFit:
    """Fit one centre to several markers that grow, from their moments alone: the points are not stored.

    The answer is that of `mgdk` for the same points. Its covariance takes the spread of the directions from the
    moments, where `mgdk` takes it from the points; ``markers`` of the fit is empty, and nothing is tested.

    Args:
        markers: at least one, of the same dimension; points of a size between 1e-40 and 1e40.
    """
    moments = [marker.moments for marker in markers]
    count = np.array([0 if m is None else int(m.n[0]) for m in moments])
    used = [m for m in moments if m is not None and m.n[0] >= 2]

    def bound(joint: MarkersMoments, solution: _Solution) -> Floats:
        _, subtracted, weights = solution
        information = np.einsum("p,pij->ij", weights, joint.c[:, 0] - subtracted)
        return np.asarray(np.linalg.pinv(information, hermitian=True))

    return _fit_moments(used, count, markers[0].dimension, None, True, bound)


_Solution = tuple[Floats, Floats, Floats]
"""Centre (d,), what was subtracted from each C (M, d, d), and the weights (M,)."""
_Bound = Callable[[MarkersMoments, _Solution], Floats]
"""Covariance of the centre for the noise as given, or for noise of size 1."""


def _fit_moments(
    moments: list[Moments], count: Ints, d: int, known: Floats | None, weighted: bool, bound: _Bound
) -> JointFit:
    """Fit the moments of the markers with two samples or more, given the number of samples of each marker (M,)."""
    if not moments or sum(int(m.n[0]) for m in moments) < d + len(moments):
        return _nothing(d, count, Status.TOO_FEW_POINTS)
    if not all(np.isfinite(m.fourth[0]) for m in moments):
        return _nothing(d, count, Status.NOT_FINITE)
    joint = MarkersMoments.of(moments)
    n, c = joint.n[:, 0], joint.c[:, 0]
    values = np.linalg.eigvalsh(np.einsum("p,pij->ij", n, c))
    if not values[0] > d * np.finfo(float).eps * values[-1]:
        return _nothing(d, count, Status.SINGULAR)
    solution = _solve(joint, known, weighted)
    center, subtracted, weights = solution
    total = np.einsum("p,pij->ij", weights, c)
    share = solved(total, np.einsum("p,pij->ij", weights, subtracted))
    condition = float(np.linalg.eigvals(share).real.max())
    squares = np.full(len(count), np.nan)
    squares[count >= 2] = joint.square_radii(center[None], subtracted[:, None])[:, 0]
    if known is None:
        spare = n.sum() - d - len(moments)
        variance = float(subtracted[0, 0, 0] * n.sum() / spare) if spare > 0 else np.nan
        covariance = variance * bound(joint, solution)
    else:
        variance, covariance = float(np.trace(known)) / d, bound(joint, solution)
    radii, status = np.sqrt(np.where(squares >= 0.0, squares, np.nan)), Status.NOT_POSITIVE_DEFINITE
    status = Status.OK if condition < 1.0 else status
    return JointFit(center, radii, variance, status, condition, covariance, count)


def _solve(joint: MarkersMoments, known: Floats | None, weighted: bool) -> _Solution:
    """Solve for the centre of one data set, with the noise as known or found."""
    if known is not None:
        center, weights = joint.known(known, weighted)
        return center[0], joint.subtracted(known)[:, 0], weights[:, 0]
    weights, subtracted = joint.n, np.zeros_like(joint.c)
    center = joint.center(subtracted, weights)
    # the centre of one marker is final after one round, since its weight cancels, and its weight after two
    for _ in range(ROUNDS if len(weights) > 1 else 2):
        if weighted:
            weights = joint.weights(center)
        subtracted = np.zeros_like(joint.c) + _root(joint, weights[:, 0]) * np.eye(len(center[0]))
        center = joint.center(subtracted, weights)
    return center[0], subtracted[:, 0], weights[:, 0]


def _root(joint: MarkersMoments, weights: Floats) -> float:
    """η for which the residuals' variances are those that such noise gives: Σ w (Var f - 4r²η - 2dη²) = 0.

    About the weighted mean of the centroids that is the equation of theory 8.2, of weighted means, with ϰ = 2d. Where
    all of the least extent is not enough, η is just above it: the noise hides how far the markers moved, and the fit is
    not positive definite.
    """
    w, (_, mean, c, s, fourth) = weights / weights.sum(), (part[:, 0] for part in joint)
    away = mean - w @ mean
    moved = np.einsum("pij,pj->pi", c, away)
    extents, vectors = (part[0] for part in eigenbasis(np.einsum("p,pij->ij", w, c)[None]))
    cross = 2.0 * (w @ (moved + 0.5 * s)) @ vectors
    m2 = np.trace(c, axis1=1, axis2=2)
    variance = fourth - m2**2 + 4.0 * np.einsum("pi,pi->p", away, s + moved)
    size = float(w @ (m2 + np.einsum("pi,pi->p", away, away)))
    eta = smallest_root(extents, cross, np.zeros(len(cross)), size, float(w @ variance), 2.0 * len(cross))
    return eta if eta < extents[0] * (1.0 - 1e-12) else float(extents[0]) * (1.0 + 1e-9)


def _unit_bound(arrays: list[Floats], center: Floats, noise: Floats) -> Floats:
    """Cramér-Rao bound of the centre: each marker's radius takes the mean of its directions out of the information."""
    d = len(center)
    information = np.zeros((d, d))
    for array in arrays:
        away = array - center
        distance = np.linalg.norm(away, axis=1)
        u = away[distance > 0.0] / distance[distance > 0.0, None]  # a point at the centre has no direction
        if len(u):
            weights = 1.0 / np.einsum("ni,ij,nj->n", u, noise, u)
            u = u - weights @ u / weights.sum()
            information += np.einsum("n,ni,nj->ij", weights, u, u)
    regular = np.linalg.cond(information) < 1e15
    return np.asarray(np.linalg.inv(information)) if regular else np.full((d, d), np.inf)


def _points(marker: ArrayLike, place: int) -> Floats:
    array = real_array(marker, f"marker {place}: points").astype(float)  # a copy, which the answer keeps
    if array.ndim != 2 or array.shape[1] < 2:
        raise ValueError(f"marker {place} has shape {array.shape}: expected (n, d) with d ≥ 2")
    return array


def _nothing(d: int, count: Ints, status: Status) -> JointFit:
    center, radii, covariance = np.full(d, np.nan), np.full(len(count), np.nan), np.full((d, d), np.nan)
    return JointFit(center, radii, np.nan, status, np.nan, covariance, count)
