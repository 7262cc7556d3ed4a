"""Radii that are stated with an uncertainty: points and statement together.

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

from typing import NamedTuple

import numpy as np
import scipy

from study.arrays import Bools, Floats
from study.fits.errors.intervals import Intervals, degrees, without_radius
from study.fits.errors.weighted import at_radii, least_squares
from study.fits.points.samples import FARTHEST, Samples, StatedRadius

_NODES, _GRID = 25, 151
"""Radii at which the points are fitted, and those between which nothing is curved any more."""
_ANGLES = 33
"""Radii over which the interval of a coordinate is the union."""
_WIDE = 6.0
"""Standard uncertainties about the stated radius, and standard errors about that of the points, to the end of the grid.
"""


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
    def of(cls, samples: Samples) -> "Believed":
        """The product of the points' own distribution and the prior, for sets without missing samples."""
        prior = samples.stated
        assert prior is not None
        (_, d, n), free = samples.shape, samples.with_radius(np.full(len(samples.x), np.nan))
        spare, ends = degrees(free, n), Intervals.unbounded(len(samples.x), d, 0.5)
        place, fine = np.linspace(0.0, 1.0, _NODES), np.linspace(0.0, 1.0, _GRID)
        with np.errstate(all="ignore"):
            without_radius(free, scipy.special.stdtrit(spare, scipy.special.ndtr(1.0)), ends)
            own, low, high = _reach(prior, ends.radius)
            least = least_squares(samples.with_radius(own))
            score, center, errors, _ = at_radii(samples, least, low * (high / low) ** place)
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


def believed(samples: Samples) -> Believed:
    """Join points and statement about radii that are stated with an uncertainty."""
    b, d, _ = samples.shape
    result = Believed(*(np.full((b, *shape), np.nan) for shape in ((_GRID,), (_GRID, d + 1), (d,), ())))
    for sets, part, power in samples.alike():
        if part.shape[2] > d + 1 and abs(power) <= FARTHEST:
            found = Believed.of(part)
            lengths = np.ldexp(found.fits, power), np.ldexp(found.errors, power)
            for whole, values in zip(result, (found.cumulative, *lengths, found.deviance), strict=True):
                whole[sets] = values
    return result


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
