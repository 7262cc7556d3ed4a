"""Knowledge beforehand: a radius, the noise of each point, or its law; and a radius with an uncertainty.

A radius that is stated as r₀ with its standard uncertainty τ has a normal law about r₀. The fit with a radius r given
has the centre ĉ(r), its errors e(r) and the score T(r), which is Student's t where r is right, or normal where the
noise is known (theory 10.6). These are smooth in r: a few fits give them on a fine grid. The density f(T) is the
likelihood of r by the points, and its product with the prior is the law of both. A coordinate of the centre takes the
values ĉ(r) ± q' e √(1 - t²/q²), as in (10.3): t is the deviate of r in this law, e the root mean square of e(r) over
it, q the quantile for the radius and q' that for the centre. For τ → 0 this is the fit with the radius r₀, for τ → ∞
that with a free radius, to the second order of its error over r.

Points and statement agree if some radius is likely by both: the least sum of the squares of their normal deviates is
χ² with one degree of freedom.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from study.arrays import Bools, Floats, real_array
from study.fits.errors.intervals import AtRadius
from study.fits.errors.weighted import closed, corrected_equations, least_squares
from study.fits.points.noise import is_per_point, noise_covariance, point_noise
from study.fits.points.samples import Estimator, Given, GivenWay, StatedRadius

RADIUS, UNCERTAIN = "known radius", "uncertain radius"
NOISE, COVARIANCE, LAW = "noise for each point", "covariance for each point", "law = 'radial'"
RADIUS_AND_COVARIANCE = "known radius and a covariance for each point"
_ALL = frozenset([RADIUS, UNCERTAIN, NOISE, COVARIANCE, LAW, RADIUS_AND_COVARIANCE])
"""Knowledge that estimators may take, as messages name it."""
_CLOSED = frozenset([RADIUS, UNCERTAIN, NOISE])
MLE, CORRECTED = GivenWay(least_squares, _ALL), GivenWay(corrected_equations, _ALL)
ROBUST = GivenWay(least_squares, frozenset([RADIUS, UNCERTAIN]))
GDKE, UGDK = (GivenWay(form, _CLOSED | {COVARIANCE}) for form in (closed, partial(closed, subtract=True)))
ALS = GivenWay(partial(closed, find=True), _CLOSED)
"""What shipped estimators take, and their ways to fit it."""
_EXACT = 1e-9
"""Uncertainty of a radius, in radii, below which rounding leaves no less of it."""
_NODES, _GRID = 25, 151
"""Radii at which the points are fitted, and those between which nothing is curved any more."""
_ANGLES = 33
"""Radii over which the interval of a coordinate is the union."""
_WIDE = 6.0
"""Standard uncertainties about the stated radius, and standard errors about that of the points, to the end of the grid.
"""


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
    """The law of a radius by points and statement together, on a grid of radii, and the fits given each of them.

    Attributes:
        cumulative: its distribution function (b, g); NaN where nothing is known.
        fits: r and ĉ(r) (b, g, 1 + d).
        errors: root mean square of e(r) over this law (b, d).
        deviance: least sum of squares of T and (r - r₀)/τ as normal deviates (b,).
    """

    cumulative: Floats
    fits: Floats
    errors: Floats
    deviance: Floats

    @classmethod
    def of(
        cls, prior: StatedRadius, free: Floats, fits_at: Callable[[Floats, Floats], AtRadius], spare: Floats
    ) -> "Believed":
        """The product of the points' own distribution and the prior.

        Args:
            prior: r₀ and τ.
            free: the free radius less and plus a standard error (b, 2), 0 or infinite where it is open.
            fits_at: the fits at radii (b, g), from that at a radius among them (b,).
            spare: degrees of freedom of T (b,); infinite where the noise is known.
        """
        place, fine = np.linspace(0.0, 1.0, _NODES), np.linspace(0.0, 1.0, _GRID)
        with np.errstate(all="ignore"):
            own, low, high = _reach(prior, free)
            score, center, errors, _ = fits_at(own, low * (high / low) ** place)
            nodes = np.concatenate([score[..., None], center, errors**2], axis=2)
            lost = ~np.isfinite(nodes).all(axis=2, keepdims=True)
            nodes = np.concatenate([lost, np.where(lost, 0.0, nodes)], axis=2)
            found = scipy.interpolate.pchip_interpolate(place, nodes, fine, axis=1)
            radius, nu = low * (high / low) ** fine, spare[:, None]
            score = _falling(np.where(found[..., 0] > 0.0, np.nan, found[..., 1]), radius < own[:, None])
            away = (radius - prior.radius[:, None]) / prior.uncertainty[:, None]
            likely = np.where(np.isinf(nu), -0.5 * score**2, -0.5 * (nu + 1.0) * np.log1p(score**2 / nu))
            log = likely - 0.5 * away**2
            weight = np.nan_to_num(radius * np.exp(log - np.fmax.reduce(log, axis=1, keepdims=True)))
            weight /= weight.sum(axis=1, keepdims=True)
            deviate = scipy.special.ndtri(scipy.special.stdtr(nu, -np.abs(score)))
            deviance = np.fmin.reduce(deviate**2 + away**2, axis=1)
        d = center.shape[2]
        fits, errors = np.concatenate([radius[..., None], found[..., 2 : d + 2]], axis=2), found[..., d + 2 :]
        errors = np.sqrt(np.einsum("bg,bgd->bd", weight, errors))
        return cls(np.cumsum(weight, axis=1) - 0.5 * weight, fits, errors, deviance)

    def at(self, levels: Floats) -> tuple[Floats, Floats]:
        """Quantiles of the radius (b, k), and the centres given them (b, k, d); NaN where nothing is known.

        Args:
            levels: probabilities (b, k).
        """
        g = self.fits.shape[1]
        rows = zip(levels, self.cumulative, strict=True)
        place = np.array([np.interp(*row, np.arange(g)) for row in rows]).reshape(levels.shape)
        before = np.minimum(np.nan_to_num(place).astype(int), g - 2)
        one, two = (np.take_along_axis(self.fits, (before + i)[..., None], axis=1) for i in (0, 1))
        found = one + (two - one) * (place - before)[..., None]
        return found[..., 0], found[..., 1:]

    def ends(self, level: float, spare: Floats) -> tuple[Floats, Floats]:
        """Ends of intervals of the radius (b, 2) and of each coordinate of the centre (b, d, 2).

        Args:
            level: nominal coverage.
            spare: degrees of freedom of the noise where the radius is given (b,), of which T has one less.
        """
        angle, nu = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _ANGLES), spare[:, None]
        q, of_center = (scipy.special.stdtrit(free, 0.5 * (1.0 + level)) for free in (nu - 1.0, nu))
        radius, center = self.at(scipy.special.stdtr(nu - 1.0, q * np.sin(angle)))
        reach = self.errors[:, None] * (of_center * np.cos(angle))[..., None]
        return radius[:, [0, -1]], np.stack([(center - reach).min(axis=1), (center + reach).max(axis=1)], axis=2)

    def spread(self) -> tuple[Floats, Floats]:
        """Standard deviation of the radius (b,), and the slope of the centre in it (b, d), by ± one deviation."""
        radius, center = self.at(np.tile(scipy.special.ndtr([-1.0, 1.0]), (len(self.fits), 1)))
        length = np.diff(radius, axis=1)
        return 0.5 * length[:, 0], np.diff(center, axis=1)[:, 0] / length


def _reach(prior: StatedRadius, free: Floats) -> tuple[Floats, Floats, Floats]:
    """The points' own radius (b,), the stated one where it is open, and ends (b, 1) of radii that both may allow."""
    stated, wide = prior.radius[:, None], _WIDE * prior.uncertainty[:, None]
    flat, bent = np.split(1.0 / free[:, ::-1], 2, axis=1)
    middle, further = 0.5 * (flat + bent), 0.5 * _WIDE * (bent - flat)
    near = np.maximum(np.maximum(stated - wide, 1e-3 * stated), 1.0 / (middle + further))
    far = np.minimum(stated + wide, 1.0 / np.fmax(middle - further, 0.0))
    own = np.where((flat > 0.0) & (bent < np.inf), 1.0 / middle, stated)
    low, high = np.minimum(np.minimum(near, far), stated), np.maximum(np.maximum(near, far), stated)
    return np.clip(own, low, high)[:, 0], low, high


def _falling(score: Floats, below: Bools) -> Floats:
    """Scores (b, g) that do not rise with the radius, and are those next to the points' own radius; NaN stay.

    Far from there T may come back towards zero, as noise explains all; but no radius is likelier than those between.
    """
    inner = np.fmax.accumulate(np.where(below, score, np.nan)[:, ::-1], axis=1)[:, ::-1]
    outer = np.fmin.accumulate(np.where(below, np.nan, score), axis=1)
    return np.where(np.isnan(score), np.nan, np.where(below, inner, outer))
