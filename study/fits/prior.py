"""A radius that is known with an uncertainty: a value r₀ and its standard uncertainty τ.

The radius has a normal law about r₀. On a grid of radii r the fit with r given has the centre ĉ(r), its errors e(r) and
the score T(r), which is Student's t where r is right, or normal where the noise is known (theory 10.6). The score's law
is the points' own distribution of the radius, of density f(T) |dT/dr|. Its product with the prior is that of both, and
the centre's law is the mixture of the laws of ĉ(r) over it. For τ → 0 this is the fit with the radius r₀, for τ → ∞
the radius and its interval are those of the free fit.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from study.arrays import Floats
from study.fits.intervals import AtRadius

_GRID = 101
_WIDE = 5.0
"""Standard uncertainties about the stated radius, beyond which the prior is nil."""
_FURTHER = 0.5
"""Share of the free interval's extent by which the radius may lie beyond it, as where points and statement disagree."""
_HALVINGS = 60


class StatedRadius(NamedTuple):
    """Stated radii r₀ (b,), and their standard uncertainties τ (b,)."""

    radius: Floats
    uncertainty: Floats


class Believed(NamedTuple):
    """Radii on a grid (b, g), their probabilities, and the fits given each.

    Attributes:
        radius: r, in ascending order (b, g).
        probability: of each (b, g), of sum 1.
        center: ĉ(r) (b, g, d).
        errors: e(r) (b, g, d).
    """

    radius: Floats
    probability: Floats
    center: Floats
    errors: Floats

    @classmethod
    def unknown(cls, batch: int, dimension: int) -> "Believed":
        """Of sets about which nothing is known, to be filled in."""
        shape = (batch, _GRID)
        return cls(*(np.full((*shape, *more), np.nan) for more in ((), (), (dimension,), (dimension,))))

    @classmethod
    def of(cls, prior: StatedRadius, free: Floats, fit_at: Callable[[Floats], AtRadius], spare: Floats) -> "Believed":
        """The product of the points' own distribution and the prior.

        Args:
            prior: r₀ and τ.
            free: ends of a wide interval of the free radius (b, 2).
            fit_at: the fits at a radius for each set (b,).
            spare: degrees of freedom of the noise (b,); infinite where it is known.
        """
        ends = free + _FURTHER * (free - free[:, ::-1])
        low, high = (prior.radius + side * _WIDE * prior.uncertainty for side in (-1.0, 1.0))
        low, high = np.maximum(low, 1e-3 * prior.radius), np.maximum(high, 2e-3 * prior.radius)
        near, far = np.maximum(low, ends[:, 0]), np.minimum(high, ends[:, 1])
        apart = ~(near < far)  # the points refuse the radius; the status says so
        low, high = np.where(apart, low, near), np.where(apart, high, far)
        radius = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _GRID)
        fits = [fit_at(radius[:, k]) for k in range(_GRID)]
        score, center, errors = (np.stack([one[i] for one in fits], axis=1) for i in range(3))
        with np.errstate(all="ignore"):
            slope = np.stack([np.abs(np.gradient(*pair)) for pair in zip(score, radius, strict=True)])
            normal = np.isinf(spare)[:, None]
            law = np.where(normal, -0.5 * score**2, scipy.stats.t.logpdf(score, np.where(normal, 1.0, spare[:, None])))
            log = law + np.log(slope) - 0.5 * ((radius - prior.radius[:, None]) / prior.uncertainty[:, None]) ** 2
            log[~np.isfinite(log) | ~np.isfinite(center).all(axis=2)] = -np.inf
            probability = np.exp(log - log.max(axis=1, keepdims=True))
            probability[:, [0, -1]] *= 0.5  # the trapezoidal rule
            return cls(radius, probability / probability.sum(axis=1, keepdims=True), center, errors)

    def quantile(self, level: float) -> Floats:
        """Quantiles of the radius (b,); NaN where nothing is known."""
        step = self.probability
        cumulative = np.cumsum(0.5 * (step + np.column_stack([np.zeros(len(step)), step[:, :-1]])), axis=1)
        cumulative /= cumulative[:, -1:]
        rows = zip(cumulative, self.radius, strict=True)
        return np.array([np.interp(level, *row) if np.isfinite(row[0]).all() else np.nan for row in rows])

    def center_quantile(self, level: float, spare: Floats) -> Floats:
        """Quantiles of each coordinate of the centre (b, d), by bisection of the mixture's distribution function."""
        weight = self.probability[:, :, None]
        normal, nu = np.isinf(spare)[:, None, None], np.where(np.isinf(spare), 1.0, spare)[:, None, None]
        with np.errstate(all="ignore"):
            center, errors = (
                np.where(weight > 0.0, part, fill) for part, fill in ((self.center, 0.0), (self.errors, 1.0))
            )
            reach = 40.0 * np.where(weight > 0.0, errors, 0.0).max(axis=1)
            low = np.where(weight > 0.0, center, np.inf).min(axis=1) - reach
            high = np.where(weight > 0.0, center, -np.inf).max(axis=1) + reach
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                z = (middle[:, None] - center) / errors
                share = (weight * np.where(normal, scipy.special.ndtr(z), scipy.special.stdtr(nu, z))).sum(axis=1)
                low, high = np.where(share < level, middle, low), np.where(share < level, high, middle)
        return np.where(np.isfinite(weight).all(axis=1), 0.5 * (low + high), np.nan)

    def spread(self) -> tuple[Floats, Floats]:
        """Standard deviation of the radius (b,), and the derivative of the centre by it (b, d)."""
        ends = [self.quantile(level) for level in (0.15866, 0.5, 0.84134)]
        deviation = 0.5 * (ends[2] - ends[0])
        mean = (self.probability * self.radius).sum(axis=1)[:, None]
        away = np.where(self.probability > 0.0, self.radius - mean, 0.0)
        center = np.where(self.probability[..., None] > 0.0, self.center, 0.0)
        weight = self.probability * away
        return deviation, np.einsum("bg,bgd->bd", weight, center) / np.einsum("bg,bg->b", weight, away)[:, None]
