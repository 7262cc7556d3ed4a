"""The answer of `study.fit`: spheres, their standard errors and intervals, and how far the points are from them.

One class answers whatever was fitted: points alone, or with a radius, a noise of each point, or its law. What the
points show is in `study.fits.evidence.fitted`.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from study.arrays import Bools, Floats, Ints, as_number, real_array
from study.fits.answers.display import as_dict, as_html, as_text, frame, named_axis
from study.fits.evidence.circle import Circle
from study.fits.evidence.fitted import FittedPoints, RadiusTest
from study.fits.evidence.form import forms_that_move, moves_of_forms
from study.fits.evidence.goodness import Answer, Goodness
from study.fits.evidence.judge import NOTHING, Assumptions
from study.fits.points.samples import Estimates, Estimator, Samples, Status, semi_axes
from study.words import Hinting

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def signed_distances(points: ArrayLike, center: Floats, radius: Floats) -> Floats:
    """Distances of points (…, m, d), or of one (d,), from spheres, positive outside; see `Fit.distance`."""
    array, d = real_array(points, "points"), center.shape[-1]
    if array.ndim == 0 or array.shape[-1] != d:
        raise ValueError(f"points have shape {array.shape}: the fit needs {d} coordinates, (…, m, {d}) or ({d},)")
    lead = f"points have shape {array.shape}, the fits {radius.shape}"
    if array.ndim > 1:
        center, radius = center[..., None, :], radius[..., None]
    try:
        with np.errstate(all="ignore"):
            return np.asarray(np.linalg.norm(array - center, axis=-1) - radius)
    except ValueError:
        raise ValueError(f"{lead}: leading axes must match; for the same points, pass (m, {d})") from None


class Fit(Hinting):
    """Spheres that an estimator fitted, to one point set or to a batch of them with leading axes `…`.

    Look at ``ok`` first: an estimator never raises on data, and a number beside a status other than ok may be of no
    use. Standard errors and residuals are computed from the points on first use. Of a single fit, radius, status and
    the like are numbers; of a batch they are arrays. A fit of a batch has a length, can be indexed (``fit[3]``,
    ``fit[fit.ok]``) and iterated, along its leading axes.

    Args:
        estimates: the estimator's numbers, with the leading axes.
        samples: the points that were fitted, flat (b, d, n); None if they are not known, which leaves no errors.
        estimator: name of the estimator.
        entry: the estimator; without it errors are the Cramér-Rao bound with the estimates plugged in.
        assumed: what the user knows of the points.

    Examples:
        Two point sets on a circle about (1, 2), one with noise:

        >>> import numpy as np, study
        >>> angles = np.linspace(0, 6, 50)
        >>> circle = np.column_stack([1 + np.cos(angles), 2 + np.sin(angles)])
        >>> noisy = circle + np.random.default_rng(1).normal(0, 0.01, circle.shape)
        >>> fit = study.fit([circle, noisy])
        >>> fit.ok, fit.center.round(2), fit.radius.round(2)
        (array([ True,  True]), array([[1., 2.],
               [1., 2.]]), array([1., 1.]))
        >>> fit[1].standard_errors.round(4), print(fit[1].status)
        OK
        (array([0.0017, 0.0017, 0.0012]), None)
    """

    def __init__(
        self,
        estimates: Estimates,
        samples: Samples | None = None,
        estimator: str = "",
        entry: Estimator | None = None,
        assumed: Assumptions = NOTHING,
    ) -> None:
        self._estimates = estimates
        self._samples = samples
        self._estimator = estimator
        self._entry = entry
        self._assumed = assumed

    @property
    def estimates(self) -> Estimates:
        """The estimator's own numbers with the leading axes, among them its status, ρ and its iterations."""
        return self._estimates

    @property
    def samples(self) -> Samples | None:
        """The points that were fitted, flat (b, d, n); None if the fit does not hold them."""
        return self._samples

    @property
    def estimator(self) -> str:
        """Name of the estimator."""
        return self._estimator

    @property
    def center(self) -> Floats:
        """Centre ĉ (…, d), in the unit of the points."""
        return self._estimates.center

    @property
    def radius(self) -> Floats:
        """Radius r̂ (…), in the unit of the points. NaN where no radius is real, which the status then says."""
        return as_number(self._estimates.radius)

    @property
    def sigma(self) -> Floats:
        """Standard deviation σ of one coordinate (…), in the unit of the points.

        As given to an estimator that uses it (the root mean square over coordinates, for a covariance), else estimated
        from the residuals. NaN at n = d + 1, which leaves none.
        """
        with np.errstate(invalid="ignore"):
            return as_number(np.sqrt(self._estimates.noise_variance))

    @property
    def status(self) -> Any:
        """The `Status` of a single fit, whose `text` explains it; of a batch the numbers of the statuses (…).

        It is the estimator's own if it failed. Else one rule holds for every estimator. Points on a circle in space
        are a hinge (theory 13.7). A fit is weakly identified unless its points bound the radius by a 95 % interval and
        the noise is below 0.35 radii (theory 10.5). It is not ok either if it uses outliers that matter, or if the test
        of fit fails by enough to matter (theory 13.6), or if the points refuse a known radius or noise (p < 0.01).
        """
        return self._statuses if self.shape else Status(int(self._statuses))

    @property
    def _statuses(self) -> Ints:
        """Numbers of the statuses (…)."""
        if self._samples is not None:
            return self._points.judged[0].reshape(self.shape)
        untested = (self._estimates.status == Status.OK) & (not self._assumed.sphere)
        return np.asarray(np.where(untested, Status.UNTESTED, self._estimates.status))

    def interval(self, of: str, level: float = 0.95) -> Floats:
        """Confidence interval of the radius, the diameter or a coordinate of the centre, or one of each coordinate.

        It depends on the points alone, not on the estimator; that of `robust` leaves the outliers out, as the fit
        does. Copies of a point count once. It assumes isotropic noise of unknown size, and covers where an estimate ±
        its standard error does not: on small caps, under large noise, and with few points. Where the residuals show
        structure it is longer by `allowance`; of points on a circle in space it is open along the axis.

        Args:
            of: "radius", "diameter" or "center"; "x", "y" or "z" in up to three dimensions, or "center_1", "center_2",
                … in any number.
            level: nominal coverage of each interval, in (0, 1).

        Returns:
            Lower and upper ends, (…, d, 2) for the centre and (…, 2) for one number, in the unit of the points. Ends
            that the points do not determine are 0 or infinite for the radius; the centre then may be anywhere.

        Raises:
            ValueError: if the level is not in (0, 1), the name is another, or the fit does not hold its points.

        Examples:
            >>> import numpy as np, study
            >>> angles = np.linspace(0, 6, 50)
            >>> circle = np.column_stack([np.cos(angles), np.sin(angles)])
            >>> fit = study.fit(circle + np.random.default_rng(1).normal(0, 0.01, circle.shape))
            >>> fit.interval("radius").round(3)
            array([0.998, 1.002])
            >>> fit.interval("center", level=0.99).round(3)
            array([[-0.003,  0.006],
                   [-0.006,  0.003]])

        Source: theory §10.
        """
        axis = named_axis(of, self.center.shape[-1])
        ends = self._points.intervals(level)
        if of in ("radius", "diameter"):
            return np.asarray((2.0 if of == "diameter" else 1.0) * ends.radius.reshape(*self.shape, 2))
        return np.asarray(ends.center.reshape(*self.center.shape, 2)[..., slice(None) if axis is None else axis, :])

    def distance(self, points: ArrayLike) -> Floats:
        """Signed distances of points from the sphere, positive outside it: |p - ĉ| - r̂.

        Args:
            points: coordinates (…, m, d), or one point (d,); leading axes match the fit's, or one of both has none.

        Returns:
            Distances (…, m), or (…) for one point, in the unit of the points; NaN where a coordinate is missing.

        Raises:
            ValueError: if the shapes do not match; a TypeError if the points are no real numbers.
        """
        return signed_distances(points, self.center, self.radius)

    @property
    def ok(self) -> Bools:
        """True for each fit (…) whose status is ok: no more need be looked at."""
        return as_number(self._statuses == Status.OK)

    @property
    def shape(self) -> tuple[int, ...]:
        """The leading axes; () for a single fit."""
        return self._estimates.radius.shape

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a single fit has no length; only a fit of a batch (…, n, d) has")
        return self.shape[0]

    def __bool__(self) -> bool:
        raise TypeError("a fit is neither true nor false: look at fit.ok")

    def __getitem__(self, index: Any) -> Self:
        """Fits of a part of the batch, by any index of an array with the leading axes."""
        if not self.shape:
            raise TypeError("a single fit cannot be indexed; its arrays are fit.center, fit.radius, fit.status, …")
        places = np.arange(self.radius.size).reshape(self.shape)[index]
        flat = self._estimates.reshape(-1)
        part = Estimates._make([np.asarray(array[places]) for array in flat])
        samples = None if self._samples is None else self._samples.take(np.atleast_1d(places).ravel())
        return type(self)(part, samples, self._estimator, self._entry, self._assumed)

    def __iter__(self) -> Iterator[Self]:
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        return as_text(self)

    def _repr_html_(self) -> str:
        return as_html(self)

    def to_frame(self) -> "pd.DataFrame":
        """A row per fit.

        Returns:
            Columns: each coordinate of the centre (center_1) and its standard error (error_1), radius and
            radius_error, noise (σ̂), residual_rms; by the names of ``study fit --csv`` center_x, error_x, …, diameter,
            diameter_error, and the 95 % intervals radius_low, radius_high, center_x_low, …; condition (ρ), iterations,
            samples used, status in words. The index has a level for each leading axis.

        Examples:
            >>> import numpy as np, study
            >>> angles = np.linspace(0, 6, 50)
            >>> circle = np.column_stack([np.cos(angles), np.sin(angles)])
            >>> fit = study.fit(circle + np.random.default_rng(1).normal(0, 0.01, circle.shape))
            >>> fit.to_frame()[["radius", "radius_error", "samples", "status"]].round(4)
               radius  radius_error  samples status
            0     1.0        0.0012       50     ok
        """
        return frame(self)

    def to_dict(self) -> dict[str, Any]:
        """The numbers of a single fit as plain Python: floats, lists and texts, as ``study fit --json`` prints them.

        Returns:
            estimator, ok, status (a name), status_text, samples (used), outliers (rows from 0), outlier_influence
            (largest change without them, in standard errors; up to 1.5 they do not matter), copies (points that repeat
            an earlier one but for rounding), center, center_errors, radius, radius_error, diameter, diameter_error,
            correlation (of ĉ and r̂), sigma, residual_rms, form_error (largest minus smallest residual),
            largest_deviation, condition (ρ), radius_interval, center_intervals (95 %), and the same numbers by the
            names of ``study fit --csv`` (center_x, error_x, radius_low, …); goodness (p values by block, and
            p of all), misfit (the block that is named, or ""), allowance, circle (of a hinge, else None), visible_form
            (size of a form that the test of shape finds in half of such sets, in σ), visible_moves (of centre and
            radius by such a form, in their errors), ordered. NaN where there is no number.

        Raises:
            ValueError: if there is more than one fit, or the fit does not hold its points.
        """
        numbers = as_dict(self)
        numbers |= {"outlier_influence": self._points.influence, "copies": int(self._points.repeated.sum())}
        numbers |= {"visible_form": float(self.goodness.visible_form), "visible_moves": visible_moves(self).tolist()}
        return numbers | {"ordered": self._assumed.ordered}

    def plot(self) -> "Figure":
        """Draw the points, the sphere and its centre's error, and the distances of the points: as ``study fit --plot``.

        Raises:
            ValueError: if there is more than one fit, or the fit does not hold its points.

        Examples:
            >>> import numpy as np, study
            >>> angles = np.linspace(0, 6, 50)
            >>> circle = np.column_stack([np.cos(angles), np.sin(angles)])
            >>> fit = study.fit(circle + np.random.default_rng(1).normal(0, 0.01, circle.shape))
            >>> fit.plot().savefig("circle.png")
        """
        from study.fits.answers.fit_plot import picture  # imported here, since it loads matplotlib

        return picture(self, self._assumed.ordered)

    @cached_property
    def count(self) -> Ints:
        """Number of samples used (…): points with a NaN are missing and left out."""
        return as_number(self._points.present.sum(axis=1).reshape(self.shape))

    @cached_property
    def residuals(self) -> Floats:
        """Signed distance of each point from the sphere (…, n), in the unit of the points.

        It is |x - ĉ| - r̂, positive outside; NaN where a sample is missing.
        """
        points = self._points
        with np.errstate(all="ignore"):
            signed = np.where(points.present, points.from_center[0] - self.radius.reshape(-1, 1), np.nan)
        return signed.reshape(*self.shape, signed.shape[1])

    @cached_property
    def outliers(self) -> Bools:
        """True for each point (…, n) that does not belong to the sphere of the majority.

        It depends on the points alone, not on this fit: `robust` leaves them out, other estimators use them. Of data
        sets without outliers about 1 % have a point named. Missing samples are none.

        Source: theory §11.
        """
        found = self._points.outliers
        return found.reshape(*self.shape, found.shape[1])

    @property
    def goodness(self) -> Goodness:
        """Test of fit (…): p values of *shape*, *unequal noise*, *tails* and *memory* of the rows, and of all.

        Each test, and those of hinges and outliers, has an answer: passed, failed, or not tested with its reason.

        It depends on the points alone, not on the estimator, holds for every law of directions, and takes the noise to
        be isotropic, normal and of unknown size. Copies count once; that of `robust` leaves the outliers out. Of more
        than 100,000 points so many are tested.

        Source: theory §13.
        """
        if self._samples is None:
            return Goodness.untested(self.shape, Answer.NO_POINTS)
        return self._points.judged[1].reshape(*self.shape)

    @cached_property
    def allowance(self) -> Floats:
        """Factors on the standard errors of ĉ's components and of r̂ (…, d+1) for structure in the residuals.

        They are 1 unless the test of fit speaks by its shape, unequal noise or memory; then errors of white noise would
        be too small. For memory the rows must be `ordered`. What is constant or linear over the directions cannot be
        seen, and is not allowed for; but a known radius that the points refuse is. If that is itself wrong, it moves
        the centre of a cap along its axis by more.

        Source: theory §13.6.
        """
        points = self._points
        return (points.allowed.ratio * points.selection).reshape(*self.shape, self.center.shape[-1] + 1)

    @cached_property
    def circle(self) -> Circle:
        """The circle in space on which the points lie, if their status is *hinge* (…); NaN in other dimensions.

        It depends on the points alone. Every sphere through it fits: the sphere's centre may be anywhere on its axis.

        Examples:
            >>> import numpy as np, study
            >>> angles = np.linspace(0, 2, 60)
            >>> arc = np.column_stack([3 * np.cos(angles), 3 * np.sin(angles), np.ones(60)])
            >>> fit = study.fit(arc + np.random.default_rng(1).normal(0, 0.01, arc.shape))
            >>> fit.status.name, fit.circle.radius.round(2), fit.circle.axis.round(2)
            ('HINGE', array(3.), array([0., 0., 1.]))

        Source: theory §13.7.
        """
        return Circle(*(array.reshape((*self.shape, *array.shape[1:])) for array in self._points.circles))

    @cached_property
    def residual_rms(self) -> Floats:
        """Root mean square distance of the points from the sphere (…), in the unit of the points."""
        points = self._points
        with np.errstate(all="ignore"):
            away = points.from_center[0] - self.radius.reshape(-1, 1)
            square = np.where(points.present, away**2, 0.0).sum(axis=1)
            return as_number(np.sqrt(square / points.present.sum(axis=1)).reshape(self.shape))

    @property
    def _own_covariance(self) -> Floats:
        """Covariance of (ĉ, r̂) (…, d+1, d+1) for white noise; see `FittedPoints.white_covariance`."""
        found = self._points.white_covariance
        return found.reshape(*self.shape, *found.shape[1:])

    @cached_property
    def covariance(self) -> Floats:
        """Covariance of (ĉ, r̂) (…, d+1, d+1), unit squared: that for white noise, times `allowance` on both sides."""
        return self._own_covariance * self.allowance[..., :, None] * self.allowance[..., None, :]

    @property
    def standard_errors(self) -> Floats:
        """Standard errors of ĉ's components and of r̂ (…, d+1), in the unit of the points; see `covariance`."""
        with np.errstate(all="ignore"):
            return np.asarray(np.sqrt(np.einsum("...ii->...i", self.covariance)))

    def sensitivity(self) -> Floats:
        """Form errors that move ĉ's components and r̂ by their standard errors (…, 2, d+1), in units of σ.

        A ball that is not round moves a fit, and what it moves most leaves the least in the residuals. The first row
        has forms of degree 2, such as an ellipsoid's, the second those of degree 3, each the worst of its degree; their
        size is the root mean square over the whole sphere. If you cannot exclude a form of this size, the number is
        less certain than its error says. It is infinite for a radius that is known exactly.

        Raises:
            ValueError: if the fit does not hold its points.

        Examples:
            >>> import numpy as np, study
            >>> angles = np.linspace(0, 1.5, 50)
            >>> arc = np.column_stack([np.cos(angles), np.sin(angles)])
            >>> fit = study.fit(arc + np.random.default_rng(1).normal(0, 0.01, arc.shape))
            >>> fit.sensitivity().round(2)
            array([[0.32, 0.31, 0.43],
                   [0.19, 0.18, 0.2 ]])
        """
        directions, weights, held = self._points.design
        errors = self.standard_errors.reshape(-1, self.center.shape[-1] + 1)
        found = forms_that_move(directions, weights, errors, held)
        with np.errstate(all="ignore"):
            return np.asarray((found / self.sigma.reshape(-1, 1, 1)).reshape(*self.shape, *found.shape[1:]))

    def ellipsoid(self, level: float = 0.95) -> Floats:
        """Joint confidence ellipsoid of the centre.

        Args:
            level: nominal coverage, in (0, 1).

        Returns:
            Semi-axes as columns (…, d, d), in the unit of the points. Their length comes from the χ² distribution
            where the noise is known, else from F with n - d - 1 degrees of freedom.

        Raises:
            ValueError: if the level is not in (0, 1), or the fit does not hold its points.

        Examples:
            >>> import numpy as np, study
            >>> angles = np.linspace(0, 6, 50)
            >>> circle = np.column_stack([np.cos(angles), np.sin(angles)])
            >>> fit = study.fit(circle + np.random.default_rng(1).normal(0, 0.01, circle.shape))
            >>> np.linalg.norm(fit.ellipsoid(), axis=0).round(4)
            array([0.0042, 0.0043])
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"level = {level!r}: a coverage must lie between 0 and 1, such as 0.95")
        d = self.center.shape[-1]
        spare = None if self._points.noise_is_known else np.maximum(self._points.used.sum(axis=1) - d - 1, 1)
        found = semi_axes(self.covariance[..., :d, :d].reshape(-1, d, d), level, spare)
        return found.reshape(*self.center.shape, d)

    @property
    def radius_test(self) -> RadiusTest:
        """The fit with a free radius, as a test of a known one: its r̂ and error, and the p value of the given r (…).

        The p value is that of the radius's score (theory 10.6), or of r̂ over its error if the points have no centre for
        the given radius. For a radius with an uncertainty it is that of the radius at which points and statement agree
        best (theory 10.8). It is small where the radius is wrong, and where the points are no sphere. NaN where no
        radius was given.
        """
        return RadiusTest(*(as_number(part.reshape(self.shape)) for part in self._points.radius_test))

    @property
    def noise_scale(self) -> Floats:
        """The noise that the residuals show over the one that was given (…): about 1 if that is right.

        It is the root of Σ p (R - r̂)²/(N - k), k the number of coordinates fitted: the standard error of unit weight.
        NaN where no noise was given.
        """
        return as_number(self._points.noise_scale.reshape(self.shape))

    def remarks(self) -> Iterator[str]:
        """Lines about what was given, and whether the points agree; for a single fit."""
        return self._points.remarks()

    @cached_property
    def _fitted(self) -> FittedPoints:
        """The points, flat, with what was computed of them."""
        if self._samples is None:
            raise ValueError("this fit does not hold its points: use study.fit, which stores them in the fit")
        return FittedPoints(self._estimates.reshape(-1), self._samples, self._entry, self._assumed)

    @property
    def _points(self) -> FittedPoints:
        """The points, flat; ValueError if the fit does not hold them, or they were lent and have changed."""
        points = self._fitted
        points.samples.unchanged()
        return points


GivenFit = Fit
"""Former name of the answer where something was given."""


def white_covariance(fit: Fit) -> Floats:
    """Covariance of (ĉ, r̂) (…, d+1, d+1) for white noise, whatever the residuals show, unit squared.

    Studies look at it: their noise is known to be white, and the tests behind `Fit.covariance` take time.
    """
    return fit._own_covariance


def visible_moves(fit: Fit) -> Floats:
    """Moves of ĉ's components and r̂ by a form that the test of shape just sees (…, d+1), in their standard errors.

    Such a form, whose residuals are of the size ``goodness.visible_form``, is found in half of the sets; in the others
    it moves the fit by so much, as a root mean square over forms of degree 2. NaN where the shape was not looked at.
    """
    points = fit._points
    moved = moves_of_forms(*points.design).reshape(*fit.shape, -1)
    with np.errstate(all="ignore"):
        size = fit.goodness.visible_form * fit.sigma
        return np.asarray(np.asarray(size)[..., None] * moved / fit.standard_errors)
