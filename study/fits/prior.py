"""Knowledge beforehand: a radius, the noise of each point, or its law; and a radius with an uncertainty.

A radius that is stated as r₀ with its standard uncertainty τ has a normal law about r₀. On a grid of radii r the fit
with r given has the centre ĉ(r), its errors e(r) and the score T(r), which is Student's t where r is right, or normal
where the noise is known (theory 10.6). The score's law is the points' own distribution of the radius, of density
f(T) |dT/dr|. Its product with the prior is that of both, and the centre's law is the mixture of the laws of ĉ(r) over
it. For τ → 0 this is the fit with the radius r₀, for τ → ∞ the radius and its interval are those of the free fit.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from study.arrays import Floats, real_array
from study.fits.bounds import is_per_point, noise_covariance, point_noise
from study.fits.intervals import AtRadius
from study.fits.samples import Estimator, Given, GivenWay, StatedRadius
from study.fits.weighted import closed, corrected_equations, least_squares

RADIUS, UNCERTAIN = "known radius", "uncertain radius"
NOISE, COVARIANCE, LAW = "noise for each point", "covariance for each point", "law = 'radial'"
RADIUS_AND_COVARIANCE = "known radius and a covariance for each point"
_ALL = frozenset([RADIUS, UNCERTAIN, NOISE, COVARIANCE, LAW, RADIUS_AND_COVARIANCE])
"""Knowledge that estimators may take, as messages name it."""
_CLOSED = frozenset([RADIUS, UNCERTAIN, NOISE])
MLE, CORRECTED = GivenWay(least_squares, _ALL), GivenWay(corrected_equations, _ALL)
ROBUST = GivenWay(least_squares, frozenset([RADIUS]))
GDKE, UGDK = (GivenWay(form, _CLOSED | {COVARIANCE}) for form in (closed, partial(closed, subtract=True)))
ALS = GivenWay(partial(closed, find=True), _CLOSED)
"""What shipped estimators take, and their ways to fit it."""
_EXACT = 1e-9
"""Uncertainty of a radius, in radii, below which rounding leaves no less of it."""
_GRID = 101
_WIDE = 5.0
"""Standard uncertainties about the stated radius, beyond which the prior is nil."""
_FURTHER = 0.5
"""Share of the free interval's extent by which the radius may lie beyond it, as where points and statement disagree."""
_HALVINGS = 60


def given_of(
    shape: tuple[int, ...], noise: ArrayLike | None, radius: ArrayLike | tuple[ArrayLike, ArrayLike] | None, scale: str
) -> Given:
    """Check what is given for points of a shape (…, n, d), and bring it to the flat batch.

    Raises:
        TypeError: if a value is no real number.
        ValueError: if a shape or value cannot be used; the message says which.
    """
    *lead, n, d = shape
    b = math.prod(lead)
    if scale not in ("given", "estimated"):
        raise ValueError(f"scale = {scale!r}: 'given' takes the noise as it is, 'estimated' its ratios alone")
    known, stated = np.full(b, np.nan), None
    radius, uncertain = radius if isinstance(radius, tuple) and len(radius) == 2 else (radius, None)
    if radius is not None:
        value = real_array(radius, "radius").astype(float)
        if value.shape not in ((), tuple(lead)):
            raise ValueError(f"radius has shape {value.shape}: give one number, or one for each set, {tuple(lead)}")
        if (wrong := value[~((value > 0.0) & (value < 1e150))]).size:
            raise ValueError(f"radius = {wrong[0]:g}: a known radius must be positive and finite")
        known = np.broadcast_to(value, lead).reshape(b).astype(float)
    if uncertain is not None:
        value = real_array(uncertain, "radius").astype(float)
        if value.shape not in ((), tuple(lead)) or not ((value > 0.0) & (value < 1e150)).all():
            remedy = "must be positive and finite; give an exact radius alone, as one number"
            raise ValueError(f"radius = (…, {uncertain}): a standard uncertainty {remedy}")
        stated = StatedRadius(known, np.maximum(np.broadcast_to(value, lead).reshape(b), _EXACT * known))
    array = None if noise is None else real_array(noise, "noise").astype(float)
    if array is None or not is_per_point(array.shape, n, d):
        if scale == "estimated":
            raise ValueError("scale = 'estimated' needs a noise for each point: (n,), (n, d) or (n, d, d)")
        if array is None:
            return Given(known, None, False, None, stated)
        if array.ndim == 0:
            return Given(known, None, False, float(array), stated)
        array = np.broadcast_to(noise_covariance(array, d), (n, d, d))
    variance = point_noise(array, shape)
    if variance.ndim == 4 and np.array_equal(variance, variance[..., :1, :1] * np.eye(d), equal_nan=True):
        variance = variance[..., 0, 0]  # isotropic
    return Given(known, variance, scale == "estimated", None, stated)


def check_way(estimator: str, given: Given, entries: Mapping[str, Estimator]) -> None:
    """Raise a ValueError, which names those that can, if an estimator does not take what is known.

    Args:
        estimator: its name.
        given: what is known.
        entries: the estimators by their names.
    """
    entry, radius = entries[estimator], bool(np.isfinite(given.radius).any())
    if given.radial and given.noise is not None and given.noise.ndim == 4:
        raise ValueError("law = 'radial': the noise has one size at a point, no covariance; give σ of each, (n,)")
    wanted = [LAW] if given.radial else []
    if radius:
        wanted.append(RADIUS if given.prior is None else UNCERTAIN)
    if given.noise is not None:
        wanted += [RADIUS_AND_COVARIANCE] * (radius and given.noise.ndim == 4)
        wanted.append(NOISE if given.noise.ndim == 2 else COVARIANCE)
    if not entry.given.takes.issuperset(wanted):
        able = [name for name, other in entries.items() if other.given.takes.issuperset(wanted)]
        names = " and ".join([", ".join(able[:-1]), able[-1]])
        if given.radial and LAW not in entry.given.takes:
            wanted = [LAW]
        said = " and ".join(word for word in wanted if word != RADIUS_AND_COVARIANCE)
        raise ValueError(f"estimator = {estimator!r}: takes no {said}; {names} do")
    if entry.needs == "noise" and given.relative:
        raise ValueError(f"estimator = {estimator!r}: subtracts the noise, whose scale must be given; als finds it")
    if entry.needs == "noise" and given.noise is None and given.sigma is None:
        raise ValueError(f"estimator = {estimator!r}: subtracts the known noise: pass noise=σ, or use als")


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
    def of(cls, prior: StatedRadius, free: Floats, fits_at: Callable[[Floats], AtRadius], spare: Floats) -> "Believed":
        """The product of the points' own distribution and the prior.

        Args:
            prior: r₀ and τ.
            free: ends of a wide interval of the free radius (b, 2).
            fits_at: the fits at radii (b, g).
            spare: degrees of freedom of the noise (b,); infinite where it is known.
        """
        ends = free + _FURTHER * (free - free[:, ::-1])
        low, high = (prior.radius + side * _WIDE * prior.uncertainty for side in (-1.0, 1.0))
        low, high = np.maximum(low, 1e-3 * prior.radius), np.maximum(high, 2e-3 * prior.radius)
        near, far = np.maximum(low, ends[:, 0]), np.minimum(high, ends[:, 1])
        apart = ~(near < far)  # the points refuse the radius; the status says so
        low, high = np.where(apart, low, near), np.where(apart, high, far)
        radius = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _GRID)
        score, center, errors, _ = fits_at(radius)
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
