"""Circles in space: points that lie on one are recognised, and the circle is fitted.

A point on a hinge moves on a circle in space. Every sphere through the circle fits: its centre may be anywhere on the
axis, its mirror image in the circle's plane is as good, and the radius is at least the circle's. What the points do
determine is the circle.

They are on one if in their plane they are within noise of a circle, and across it too thin to tell where on the axis
the centre is. A cap of a sphere is as thin as an arc, but fills a disc; so the circle must explain the points in their
plane, which a disc's does not.

Source: theory §13.7.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, fdtri, stdtrit

from study.arrays import Floats, Ints
from study.fits.estimators.corrected import corrected, corrected_covariance
from study.fits.evidence.goodness import Answer
from study.fits.points.samples import Estimates, Samples, binary_size

_CURVED = 1.3
"""Least ratio of the points' smaller extent in their plane to what a circle leaves of it, as variances; on a line 1."""
_ROUND = 0.15
"""Largest residual of the circle, in its radii; points that fill a disc leave .3."""
FEWEST, _SURE = 15, 25
"""Number of points from which a circle is told from a cap by the rules below, and that residual may be as large."""
_SAME = 2.5
"""Largest ratio of the circle's residual variance to the sphere's, beside chance."""
_UNCERTAIN = 0.15
"""Standard error of the centre along the axis, in rms distances of the points from their plane, from which intervals
are too short."""
_BELT = math.tan(math.radians(15.0)) / math.sqrt(3.0)
"""The same distances, in radii, beyond which points are no belt."""
_THIN = math.tan(math.radians(3.6)) / math.sqrt(3.0)
"""The same distance, in radii, below which the centre along the axis hangs on errors of form: belts of ± 3.6°."""
_STRIP = 12.0
"""Ratio of the two larger extents, as variances, from which points are a strip: their plane is too uncertain for the
circle's residual to say more."""
_KNOWN = 0.01
"""The standard error in those distances below which even a thin belt tells the centre."""
_ROUNDING = 1e-7
"""Distance from a plane, in radii, that counts as none: moments round at its square."""
_VECTORS = ("center", "axis", "center_errors")
_RARE = 0.003
"""Share of circles that are thicker by chance than the noise in their plane explains."""


class Circle(NamedTuple):
    """Circles in space, fitted to point sets with their leading axes `…`.

    Attributes:
        center: its centre (…, 3), in the unit of the points.
        radius: its radius (…), in the unit of the points.
        axis: unit vector across its plane (…, 3), with its largest component positive.
        center_errors: standard errors of the centre's coordinates (…, 3), for a centre in the plane of the points.
        radius_error: standard error of the radius (…).
        axis_error: standard error of the axis (…), radians: the larger of those of its two tilts.
    """

    center: Floats
    radius: Floats
    axis: Floats
    center_errors: Floats
    radius_error: Floats
    axis_error: Floats


def hinges(samples: Samples, fit: Estimates) -> Ints:
    """Number of the `Answer` whether sets of points in space lie on a circle, within the noise (b,).

    It takes the moments of the points alone, beside the noise and the radius of spheres that were fitted to them. Few
    points are on no circle only if it leaves so much more than the sphere does that the noise cannot explain it.

    Args:
        samples: complete sets (b, 3, n).
        fit: spheres.
    """
    b, _, n = samples.shape
    values, along = samples.regression.along[:2]
    with np.errstate(all="ignore"):
        # the algebraic fit in the plane of the two larger extents, and then without the noise that draws it inwards
        share, extent = (n - 1.0) / n, values[:, 1:]
        least = 0.5 * along[:, 1:] / extent
        center, noise = least, np.zeros(b)
        for _ in range(2):
            radius = np.sqrt((center**2).sum(axis=1) + share * extent.sum(axis=1) - 2.0 * noise)
            moved = 4.0 * share * (extent * (center - least) ** 2).sum(axis=1)
            explained = share * (along[:, 1:] ** 2 / extent).sum(axis=1) - moved
            left = np.maximum(samples.regression.variance - explained, 0.0) / (4.0 * radius**2) * n / (n - 3.0)
            noise = np.minimum(left, 0.8 * extent[:, 0])
            center = 0.5 * along[:, 1:] / (extent - noise[:, None])
        height = values[:, 0] * (n - 1.0) / (n - 3.0)
        if n < FEWEST:
            sphere = (n - 4.0) * fit.noise_variance
            more = ((n - 3.0) * (left + height) - sphere) / (n - 2.0)
            refused = more > fdtri(n - 2, n - 4, 1.0 - _RARE) * fit.noise_variance
            return np.where(refused, int(Answer.PASSED), int(Answer.TOO_FEW))
        ring = (values[:, 1] > _CURVED * left) & (left < (_ROUND * min(n / _SURE, 1.0) * radius) ** 2)
        same = ~(left > _SAME * (1.0 + 6.0 / math.sqrt(n)) * fit.noise_variance)
        uncertain = np.sqrt(left / n) * radius / height
        flat = (height <= left * fdtri(n - 3, n - 3, 1.0 - _RARE)) | (
            (uncertain > _UNCERTAIN) & (height < (_BELT * radius) ** 2)
        )
        thin = (height < (_THIN * radius) ** 2) & (uncertain > _KNOWN)
        flat |= thin
        drawn = samples.regression.variance > 2.0 * (share * values.sum(axis=1)) ** 2  # by a point far from the rest
        same |= thin & (values[:, 2] > _STRIP * values[:, 1]) & ~drawn
        nothing = height <= (_ROUNDING * radius) ** 2
        return np.where(ring & (nothing | (flat & same)), int(Answer.FAILED), int(Answer.PASSED))


def fit_circles(samples: Samples) -> Circle:
    """Fit a circle in space to each set (b, 3, n); NaN where there are too few points.

    The plane is that of the least squares of distances, and in it the circle is fitted by `corrected`. Errors take the
    noise to be isotropic.
    """
    b = samples.shape[0]
    result = Circle(*(np.full((b, 3), np.nan) if name in _VECTORS else np.full(b, np.nan) for name in Circle._fields))
    for sets, present in samples.by_count():
        n = present.shape[2]
        if n < 6 or samples.shape[1] != 3:
            continue
        finite = np.isfinite(present.moments.fourth)
        sets, powers = sets[finite], binary_size(present.x[finite])[:, None, None]
        x = np.ldexp(present.x[finite], -powers)
        mean = x.mean(axis=2)
        away = x - mean[:, :, None]
        values, axes = np.linalg.eigh(away @ away.swapaxes(1, 2) / n)
        largest = np.take_along_axis(axes[:, :, 0], np.abs(axes[:, :, 0]).argmax(axis=1)[:, None], axis=1)
        axis, plane = axes[:, :, 0] * np.where(largest < 0.0, -1.0, 1.0), axes[:, :, 1:]
        flat = Samples(np.ascontiguousarray(plane.swapaxes(1, 2) @ away))
        with np.errstate(all="ignore"):
            fit = corrected(flat)
            covariance = corrected_covariance(flat, fit)
            noise = values[:, 0] * n / (n - 3.0)
            tilts = noise[:, None] / (n * values[:, 1:])  # variances of the slopes of the plane
            across = noise / n + (tilts * fit.center**2).sum(axis=1)
            spread = plane @ covariance[:, :2, :2] @ plane.swapaxes(1, 2)
            spread += across[:, None, None] * axis[:, :, None] * axis[:, None, :]
            errors = np.sqrt(np.einsum("bii->bi", spread))
            radius, radius_error = fit.radius, np.sqrt(covariance[:, 2, 2])
            center = mean + (plane @ fit.center[:, :, None])[:, :, 0]
            unit = np.ldexp(1.0, powers[:, 0])
            found = (
                center * unit,
                radius * unit[:, 0],
                axis,
                errors * unit,
                radius_error * unit[:, 0],
                np.sqrt(tilts.max(axis=1)),
            )
        for whole, part in zip(result, found, strict=True):
            whole[sets] = part
    return result


def lowest_radius(circle: Circle, level: float, spare: Ints) -> Floats:
    """Lower ends of intervals of the radius of any sphere through the circles (b,), with degrees of freedom (b,)."""
    least = circle.radius - stdtrit(spare.astype(float), 0.5 * (1.0 + level)) * circle.radius_error
    return np.asarray(np.where(least > 0.0, least, 0.0))


def parallel(circles: list[Circle]) -> bool:
    """True if the axes of circles (1,) agree within their errors.

    Each axis has two tilts; the angle from the best-known one, in standard errors of both, is at most the root of the
    quantile of χ² with two degrees of freedom.
    """
    best = min(circles, key=lambda circle: float(circle.axis_error[0]))
    for circle in circles:
        sine = np.linalg.norm(np.cross(circle.axis[0], best.axis[0]))
        if not sine <= math.sqrt(chdtri(2, _RARE) * float(circle.axis_error[0] ** 2 + best.axis_error[0] ** 2)):
            return False
    return True
