"""The points of fits: those that a fit stands on, and their distances from its centre."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from study.estimators.robust.copies import repeated
from study.estimators.robust.outliers import outliers
from study.estimators.samples import Samples
from study.sphere.real_array import real_array
from study.sphere.types import Bools, Floats


class FittedPoints:
    """The points of a flat batch of fits.

    Args:
        samples: the points (b, d, n), missing ones as NaN.
        center: ĉ (b, d).
        without_outliers: the estimator leaves outliers out.
    """

    def __init__(self, samples: Samples, center: Floats, without_outliers: bool) -> None:
        self._samples = samples
        self._center = center
        self._without_outliers = without_outliers

    @property
    def samples(self) -> Samples:
        """The points; ValueError if they were lent and have changed."""
        return self._samples.unchanged()

    @cached_property
    def outliers(self) -> Bools:
        """True for the points (b, n) that do not belong to the sphere of the majority."""
        return outliers(self.samples)

    @cached_property
    def repeated(self) -> Bools:
        """True for the points (b, n) that repeat an earlier one."""
        return repeated(self.samples.x)

    @property
    def present(self) -> Bools:
        """False for missing points (b, n)."""
        return self._from_center[2]

    @property
    def distance(self) -> Floats:
        """Distances from ĉ (b, n)."""
        return self._from_center[0]

    @property
    def directions(self) -> Floats:
        """Directions from ĉ (b, d, n)."""
        return self._from_center[1]

    @cached_property
    def used(self) -> Bools:
        """True for the points (b, n) that the fit stands on: those that are not missing, and no outliers left out."""
        return self.present & ~self.outliers if self._without_outliers else self.present

    @property
    def different(self) -> Samples:
        """The points that the fit stands on, copies once."""
        points = self.samples
        if not self._without_outliers and not self.repeated.any():
            return points
        return Samples(np.where((self.used & ~self.repeated)[:, None], points.x, np.nan), points.noise)

    @cached_property
    def _from_center(self) -> tuple[Floats, Floats, Bools]:
        """Distances, directions, and False for missing points."""
        x = self.samples.x
        with np.errstate(all="ignore"):
            away = x - self._center[:, :, None]
            distance = np.sqrt(np.einsum("bdn,bdn->bn", away, away))
            return distance, away / distance[:, None], np.logical_not(np.isnan(x).any(axis=1))


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
