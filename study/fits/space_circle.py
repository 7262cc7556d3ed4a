"""Fits of a circle in space: a bore, a wheel, the path of a marker about a hinge.

The plane is that of the least squares of distances. In it the points are those of a circle in two dimensions, which
`study.fit` fits, tests and gives intervals: they hold here, since an error of the plane moves the points in it in
second order alone. The heights above the plane give the errors of the axis, and of the centre along it. The tests out
of the plane are an F test of the heights on harmonics of the angle, of which the plane absorbs degrees 0 and 1, and
one of their size beside the residuals in the plane: points of a sphere or a disc fail it.

Source: theory §13.7.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import fdtrc, fdtri, stdtrit

from study.arrays import Bools, Floats, Ints, as_number, real_array
from study.fits.answers.answer import Fit
from study.fits.answers.display import named_axis, statuses
from study.fits.evidence.circle import fit_circles
from study.fits.evidence.goodness import LEVEL
from study.fits.points.samples import Samples, Status
from study.fits.registry import fit
from study.text import number, with_error
from study.words import Hinting

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DEGREES = (2, 3)
"""Degrees of the harmonics of the angle that test the heights."""
_UNLIKE = 1.5
"""Ratio of the noise out of the plane to that in it, or its inverse, from which it matters."""
_ROUND = 0.15
"""Noise, in radii, beyond which points may fill a disc, which leaves 0.3."""
_TILTED = 0.1
"""Standard error of the axis, in radians, beyond which noise makes the plane and intervals are too short."""


class CircleFit(Hinting):
    """Circles in space, fitted to one point set or to a batch of them with leading axes `…`; see `fit_circle`.

    Attributes:
        inside: the `Fit` of the points in their plane, in two dimensions, with its residuals, tests and picture.
        center: centre (…, 3), in the unit of the points.
        radius: radius (…), in the unit of the points.
        axis: unit vector across the plane (…, 3), with its largest component positive.
        heights: distances of the points from the plane (…, n), positive on the side of the axis.

    Examples:
        >>> import numpy as np, study
        >>> angles = np.linspace(0, 2, 60)
        >>> arc = np.column_stack([3 * np.cos(angles), 3 * np.sin(angles), np.ones(60)])
        >>> circle = study.fit_circle(arc + np.random.default_rng(1).normal(0, 0.01, arc.shape))
        >>> bool(circle.ok), round(float(circle.radius), 2), abs(circle.axis).round(1)
        (True, 3.0, array([0., 0., 1.]))
        >>> circle.interval("radius").round(2)
        array([2.99, 3.02])
    """

    def __init__(self, points: Floats, known: dict[str, Any]) -> None:
        *lead, n, _ = points.shape
        x = points.reshape(-1, n, 3)
        circle = fit_circles(Samples(np.ascontiguousarray(x.swapaxes(1, 2))))
        found: Bools = np.asarray(np.isfinite(circle.axis).all(axis=1))
        axis = np.where(found[:, None], circle.axis, [0.0, 0.0, 1.0])
        across = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        self._basis = np.stack([across, np.cross(axis, across)], axis=2)
        with np.errstate(all="ignore"):
            there: Bools = np.asarray(np.isfinite(x).all(axis=2, keepdims=True))
            self._middle = np.where(there, x, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
            away = x - self._middle[:, None]
            self._flat, heights = away @ self._basis, (away @ axis[:, :, None])[..., 0]
        self._known, self._found = known, found
        self.inside: Fit = fit(self._flat.reshape(*lead, n, 2), **known)
        self.axis, self.heights = axis.reshape(*lead, 3), heights.reshape(*lead, n)
        self.axis[~found.reshape(lead)] = np.nan
        center = (self._basis @ self.inside.center.reshape(-1, 2, 1))[..., 0] + self._middle
        self.center, self.radius = center.reshape(*lead, 3), self.inside.radius

    @property
    def shape(self) -> tuple[int, ...]:
        """The leading axes; () for a single fit."""
        return self.inside.shape

    @cached_property
    def _plane(self) -> tuple[Ints, Floats, Floats, Floats]:
        """Points n (b,), noise variance s out of the plane (b,), covariance of the tilts (b, 2, 2), and its centre's.

        The axis is an eigenvector of the scatter, so the tilts have the covariance (s/n) (M - sI)⁻¹ M (M - sI)⁻¹, M
        being the second moments in the plane (Anderson, Ann. Math. Statist. 34 (1963) 122). NaN if noise is all of M.
        """
        y, h = self._flat, self.heights.reshape(len(self._flat), -1)
        there: Bools = np.asarray(np.isfinite(h))
        count, h, y = there.sum(axis=1), np.where(there, h, 0.0), np.where(there[..., None], y, 0.0)
        with np.errstate(all="ignore"):
            noise = (h**2).sum(axis=1) / np.maximum(count - 3, 1)
            second = y.swapaxes(1, 2) @ y / np.maximum(count, 1)[:, None, None]
            clear = second - noise[:, None, None] * np.eye(2)  # of the circle itself
            fine: Bools = self._found & (np.linalg.eigvalsh(clear)[:, 0] > 0.0)
            inverse, tilts = np.linalg.inv(clear[fine]), np.full(second.shape, np.nan)
            tilts[fine] = (noise[fine] / count[fine])[:, None, None] * (inverse @ second[fine] @ inverse)
            c = self.inside.center.reshape(-1, 2)
            along = noise / np.maximum(count, 1) + np.einsum("bi,bij,bj->b", c, tilts, c)
        return count, noise, tilts, along

    @property
    def standard_errors(self) -> Floats:
        """Standard errors of the centre's coordinates and of the radius (…, 4), in the unit of the points."""
        axis, inside = self.axis.reshape(-1, 3), self.inside.covariance.reshape(-1, 3, 3)
        with np.errstate(all="ignore"):
            spread = self._basis @ inside[:, :2, :2] @ self._basis.swapaxes(1, 2)
            variance = np.einsum("bii->bi", spread) + self._plane[3][:, None] * axis**2
            errors = np.sqrt(np.column_stack([variance, inside[:, 2, 2]]))
        return np.asarray(errors.reshape(*self.shape, 4))

    @property
    def axis_error(self) -> Floats:
        """Standard error of the axis (…), radians: of the larger of its two tilts."""
        tilts = np.nan_to_num(self._plane[2], nan=np.inf)
        finite: Bools = np.asarray(np.isfinite(tilts).all(axis=(1, 2)))
        largest = np.linalg.eigvalsh(np.where(finite[:, None, None], tilts, 0.0))[:, 1]
        return as_number(np.where(finite, np.sqrt(np.maximum(largest, 0.0)), np.nan).reshape(self.shape))

    def interval(self, of: str, level: float = 0.95) -> Floats:
        """Confidence interval of the radius, the diameter, the centre, one of its coordinates, or the axis.

        That of the radius is the interval of the circle in its plane (theory §10); so is the centre's there, and along
        the axis it has Student's law. Of the axis it is the angle within which the true axis lies.

        Args:
            of: "radius", "diameter", "center", "x", "y", "z" or "axis".
            level: nominal coverage, in (0, 1).

        Returns:
            Lower and upper ends (…, 2), or (…, 3, 2) for the centre, in the unit of the points; (…, 2) of the axis, 0
            and an angle in radians.

        Raises:
            ValueError: if the level is not in (0, 1), or the name is another.
        """
        count, _, tilts, along = self._plane
        spare = np.maximum(count - 3, 1).astype(float)
        if of == "axis":
            # a sum of two squares with unequal weights, as F by Satterthwaite's degrees of freedom
            with np.errstate(all="ignore"):
                both, squares = np.einsum("bii->b", tilts), np.square(tilts).sum(axis=(1, 2))
                angle = np.sqrt(both * fdtri(both**2 / squares, spare, level))
            return np.column_stack([np.zeros(len(angle)), angle]).reshape(*self.shape, 2)
        place = named_axis(of, 3)
        if of in ("radius", "diameter"):
            return self.inside.interval(of, level)
        axis = self.axis.reshape(-1, 3)
        with np.errstate(all="ignore"):
            part = np.linalg.norm(self._basis, axis=2)  # of a coordinate that lies in the plane (b, 3)
            first = np.where(part[..., None] > 0.0, self._basis / part[..., None], [1.0, 0.0])
            turned = np.stack([first, first[..., ::-1] * [-1.0, 1.0]], axis=2)  # rows: along the coordinate, across it
            flat = np.einsum("bnj,baij->bani", self._flat, turned)
            ends = fit(flat, **self._known).interval("center", level)[:, :, 0]
            middle, half = ends.mean(axis=2), 0.5 * np.ptp(ends, axis=2)
            reach = np.abs(axis) * np.sqrt(along)[:, None] * stdtrit(spare, 0.5 + 0.5 * level)[:, None]
            half = np.hypot(part * half, reach)
            middle = np.where(np.isfinite(middle), part * middle, 0.0) + self._middle[:, None][:, 0]
            result = np.stack([middle - half, middle + half], axis=2)
        return np.asarray(result.reshape(*self.shape, 3, 2)[..., slice(None) if place is None else place, :])

    @cached_property
    def tests(self) -> dict[str, Floats]:
        """The p values (…): of the circle in the plane, of warps out of it, and of equal noise in and out of it."""
        count, noise, _, _ = self._plane
        h, there = self.heights.reshape(len(count), -1), np.asarray(np.isfinite(self._flat).all(axis=2))
        y = self._flat - self.inside.center.reshape(-1, 1, 2)
        angle = np.arctan2(y[..., 1], y[..., 0])
        waves = [wave(degree * angle) for degree in _DEGREES for wave in (np.cos, np.sin)]
        X = np.stack([np.ones_like(angle), self._flat[..., 0], self._flat[..., 1], *waves], axis=2)
        fine = self._found & np.asarray(np.isfinite(self.inside.center.reshape(-1, 2)).all(axis=1))
        Q = np.linalg.qr(np.where((there & fine[:, None])[..., None], X, 0.0))[0]
        more, spare = len(waves), count - 3
        sigma = np.ravel(self.inside.sigma)
        with np.errstate(all="ignore"):
            squares = np.square(Q.swapaxes(1, 2) @ np.where(there, h, 0.0)[..., None])[..., 0]
            left = noise * spare - squares[:, 3:].sum(axis=1)
            warped = fdtrc(more, spare - more, squares[:, 3:].sum(axis=1) / more / (left / (spare - more)))
            ratio = noise / sigma**2
            unlike = 2.0 * np.minimum(fdtrc(spare, spare, ratio), fdtrc(spare, spare, 1.0 / ratio))
        warped = np.where(fine & (spare > more + 1), warped, np.nan)
        unlike = np.where((ratio < _UNLIKE**2) & (ratio > _UNLIKE**-2), np.maximum(unlike, LEVEL), unlike)
        inside = np.broadcast_to(self.inside.goodness.p, self.shape)
        return {"in plane": inside, "out of plane": warped.reshape(self.shape), "noise": unlike.reshape(self.shape)}

    @cached_property
    def outliers(self) -> Bools:
        """True for each point (…, n) that is an outlier in the plane or out of it."""
        count, noise, _, _ = self._plane
        limit = stdtrit(np.maximum(count - 4, 1), 1.0 - 0.5 * LEVEL / np.maximum(count, 1)) * np.sqrt(noise)
        return np.asarray(self.inside.outliers | (np.abs(self.heights) > limit.reshape(*self.shape, 1)))

    @cached_property
    def _statuses(self) -> Ints:
        """Numbers of the statuses (…): that in the plane, unless the heights say more."""
        result, tests = np.array(self.inside.status, dtype=np.int64), self.tests
        good = result == Status.OK
        far = (self.outliers & ~self.inside.outliers).any(axis=-1)
        misfit = (tests["out of plane"] < LEVEL) | (tests["noise"] < LEVEL)
        with np.errstate(all="ignore"):
            weak = ~((self.axis_error < _TILTED) & (self.inside.sigma < _ROUND * self.radius))
        rules = [~np.isfinite(self.axis[..., 0]), far, misfit, weak]
        values = [Status.SINGULAR, Status.OUTLIERS, Status.MISFIT, Status.WEAKLY_IDENTIFIED]
        return np.where(good, np.select(rules, [int(value) for value in values], int(Status.OK)), result)

    @property
    def status(self) -> Any:
        """The `Status` of a single fit; of a batch the numbers of the statuses (…)."""
        return self._statuses if self.shape else Status(int(self._statuses))

    @property
    def ok(self) -> Any:
        """True for each fit (…) whose status is ok."""
        return as_number(self._statuses == Status.OK)

    def plot(self) -> "Figure":
        """Draw the points in their plane, with the circle and their distances from it; of a single fit."""
        return self.inside.plot()

    def to_dict(self) -> dict[str, Any]:
        """The numbers of a single fit as plain Python: what `Fit.to_dict` has, of the circle, with its axis and tests.

        Raises:
            ValueError: if there is more than one fit.
        """
        numbers, errors = self.inside.to_dict(), self.standard_errors
        status = self.status
        numbers |= {"ok": bool(self.ok), "status": status.name.lower(), "status_text": status.text}
        numbers |= {"center": self.center.tolist(), "center_errors": errors[:3].tolist()}
        numbers |= {"axis": self.axis.tolist(), "axis_error": float(self.axis_error)}
        numbers |= {"center_intervals": self.interval("center").tolist()}
        numbers |= {"axis_interval": self.interval("axis").tolist(), "outliers": np.flatnonzero(self.outliers).tolist()}
        del numbers["tests"]["hinge"]
        numbers["goodness"] |= {name.replace(" ", "_"): float(p) for name, p in self.tests.items()}
        for name in ("correlation", "condition", "circle", "outlier_influence"):
            del numbers[name]
        return numbers

    def lines(self, names: list[str]) -> Iterator[str]:
        """Lines for a terminal about a single fit; the coordinates have names."""
        errors, (low, high) = self.standard_errors, self.interval("radius")
        sizes = [with_error(*pair) for pair in zip(self.center, errors, strict=False)]
        middle = ", ".join(f"{name} {size}" for name, size in zip(names, sizes, strict=True))
        axis = ", ".join(f"{round(part, 4) + 0.0:.4f}" for part in self.axis)
        angle = number(float(self.interval("axis")[1]), ".2g")
        yield f"circle: centre {middle}; radius {with_error(float(self.radius), float(errors[3]))}"
        yield f"axis ({axis}) ± {number(float(self.axis_error), '.2g')} rad; with 95 % within {angle} rad"
        ends = [f"{name} {a:.6g} to {b:.6g}" for name, (a, b) in zip(names, self.interval("center"), strict=True)]
        yield f"95 % intervals: radius {low:.6g} to {high:.6g}, {', '.join(ends)}"
        tests = [f"{name} p = {number(float(p), '.2g')}" for name, p in self.tests.items()]
        yield f"tests: {', '.join(tests)}"
        across = float(np.sqrt(self._plane[1][0]))
        yield f"noise {number(float(self.inside.sigma))} in the plane, {number(across)} across it"
        yield f"status: {self.status.text}"

    def __repr__(self) -> str:
        if self.shape:
            return f"CircleFit({np.size(self.radius):,} fits of shape {self.shape}, {statuses(self._statuses)})"
        errors = self.standard_errors
        center = ", ".join(with_error(*pair) for pair in zip(self.center, errors, strict=False))
        radius = with_error(float(self.radius), float(errors[3]))
        return f"CircleFit(center ({center}), radius {radius}, {statuses(self._statuses)})"


def fit_circle(points: ArrayLike, *, ordered: bool = False, assume: str | None = None) -> CircleFit:
    """Fit a circle in space to each of one or many point sets.

    Args:
        points: coordinates (…, n, 3) of n ≥ 6 points, in any unit; leading axes are a batch. Points with a NaN, or
            masked, are missing.
        ordered: True if the rows are in the order in which they were measured; see `study.fit`.
        assume: "circle" if the points are known to lie on one: its shape in the plane is then not tested.

    Returns:
        A `CircleFit`. Look at its ``ok`` first: points of a line or a sphere have a status, and raise nothing.

    Raises:
        TypeError: if the points are not real numbers.
        ValueError: if the shape is another, or something else is assumed.

    Examples:
        >>> import numpy as np, study
        >>> angles = np.linspace(0, 6, 60)
        >>> ring = np.column_stack([np.cos(angles), np.ones(60), np.sin(angles)])
        >>> circle = study.fit_circle(ring + np.random.default_rng(1).normal(0, 0.01, ring.shape))
        >>> bool(circle.ok), abs(circle.axis).round(1), circle.interval("radius").round(2)
        (True, array([0., 1., 0.]), array([1., 1.]))
    """
    array = real_array(points, "points").astype(float)
    if array.ndim < 2 or array.shape[-1] != 3 or array.shape[-2] < 6:
        raise ValueError(f"points have shape {array.shape}: expected (…, n, 3) with n ≥ 6")
    if assume not in (None, "circle"):
        raise ValueError(f"assume = {assume!r}: only 'circle' can be assumed, or nothing, None")
    return CircleFit(array, {"ordered": ordered, "assume": None if assume is None else "sphere"})
