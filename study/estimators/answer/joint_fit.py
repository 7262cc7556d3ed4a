"""The answer of `study.mgdk`: the common centre of several markers, and each marker's radius."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from study.estimators.status import Status
from study.sphere.types import Floats, Ints
from study.text.numbers import number, with_error

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False, eq=False)
class JointFit:
    """The common centre of several markers, as `mgdk` finds it.

    Attributes:
        center: ĉ (d,), in the unit of the points.
        radii: r̂ of each marker (M,), in the unit of the points; NaN where no radius is real.
        noise_variance: σ² of one coordinate, unit squared: as given (the mean over coordinates, for a covariance) or
            estimated.
        status: `Status` of the fit, its own: there is no interval for several markers yet, and so "ok" does not mean
            that they bound their radii.
        condition: ρ, the largest share of noise in Σ w_p C_p along any direction; it must be below 1.
        covariance: covariance of ĉ (d, d), unit squared: the Cramér-Rao bound with the estimates plugged in.
        count: number of samples used of each marker (M,); points with a NaN are left out.
        markers: the points of each marker (n_p, d), missing ones as NaN.
    """

    center: Floats
    radii: Floats
    noise_variance: float
    status: Status
    condition: float
    covariance: Floats
    count: Ints
    markers: tuple[Floats, ...] = field(default=())

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

    def to_frame(self) -> "pd.DataFrame":
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
        sigma = number(self.sigma)
        return (
            f"JointFit(center ({center}), radii ({radii}{more}), sigma {sigma}, {self.count.sum():,} points, {words})"
        )
