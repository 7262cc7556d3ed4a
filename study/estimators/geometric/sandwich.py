"""Standard errors of corrected fits: the covariance J⁻¹ Ω J⁻ᵀ/N of the root of estimating equations.

J is the mean derivative of the equations (theory 9.2) and Ω the covariance of their terms. Given its direction u, a
sample's terms have means E[f e | u] = A u and E[f e eᵀ | u] = a uuᵀ + b (I - uuᵀ), with numbers A, a and b that are
integrals over the noise. Hence J and Ω depend on the law of directions through m = E u and M = E uuᵀ alone, which
follow from the mean and the covariance of the points: there is no further pass over them (theory §9.4).
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss

from study.estimators.algebraic import root
from study.estimators.estimates import Estimates
from study.estimators.geometric.corrected import share_of_pair
from study.estimators.samples import Samples
from study.sphere.radial import RadialMeans, angle_means, radial_means
from study.sphere.types import Floats

_NODES = 64
"""Nodes of the rule over R; with twice as many the covariances agree to 1e-8."""
_REACH = 8.5
"""Range of the rule, in standard deviations of the noise."""
_LEAST = 1e-40
"""Least noise variance, as a share of r²."""


class Terms(NamedTuple):
    """Terms of the equations at the nodes of a rule over R (b, k), for spheres of radius 1.

    Attributes:
        weights: weights of the rule, with the density of R.
        distance: R.
        cosine: E[e·u | R].
        across: E[1 - (e·u)² | R].
        pull: ψ, of the equations for the centre.
        excess: R - E R.
        square: (R - E R)² - Var R.
    """

    weights: Floats
    distance: Floats
    cosine: Floats
    across: Floats
    pull: Floats
    excess: Floats
    square: Floats

    def mean(self, values: Floats) -> Floats:
        """Expectation (b, 1) of values at the nodes."""
        return np.asarray((self.weights * values).sum(axis=1, keepdims=True))

    def outer(self, factor: Floats, second: Floats) -> Floats:
        """E[f e eᵀ] (b, d, d) for a factor f at the nodes, given M = E uuᵀ."""
        d = second.shape[1]
        across = self.mean(factor * self.across)[..., None]
        along = self.mean(factor)[..., None] - across
        return np.asarray(along * second + across / (d - 1) * (np.eye(d) - second))


def corrected_covariance(samples: Samples, estimates: Estimates) -> Floats:
    """Covariance of (ĉ, r̂) (b, d+1, d+1) of the answers of `corrected`, unit squared.

    Args:
        samples: the points, without missing ones.
        estimates: the answers.

    Returns:
        The asymptotic covariance with the estimates plugged in; NaN where there is no sphere or no noise variance.

    Source: theory §9.4.
    """
    eta = root(samples, 2.0 * samples.shape[1])
    return sandwich(samples, estimates, share_of_pair(eta, samples.spectrum.values[:, 0]))


def sandwich(samples: Samples, estimates: Estimates, pair: float | Floats) -> Floats:
    """Covariance of (ĉ, r̂) (b, d+1, d+1) for a ν, or for one of each set (b,); see `corrected_covariance`."""
    b, d, _ = samples.shape
    result = np.full((b, d + 1, d + 1), np.nan)
    with np.errstate(all="ignore"):
        good = np.isfinite(estimates.noise_variance) & (estimates.radius > 0.0) & (estimates.noise_variance >= 0.0)
        good &= np.isfinite(estimates.center).all(axis=1) & np.isfinite(estimates.radius)
        if not good.any():
            return result
        r, regression = estimates.radius[good, None], samples.regression
        variance, pair = (
            np.maximum(estimates.noise_variance[good, None] / r**2, _LEAST),
            np.broadcast_to(pair, b)[good, None],
        )
        means = RadialMeans._make(np.transpose([radial_means(1.0, s, d) for s in variance[:, 0]])[..., None])
        mean = (regression.origin[good] + regression.mean[good] - estimates.center[good]) / r
        scatter = regression.covariance[good] / r[..., None] ** 2 - variance[..., None] * np.eye(d)
        second = scatter + mean[:, :, None] * mean[:, None, :]
        terms = _terms(means, variance, pair, d)
        slopes, spread = _slopes(terms, means, pair, mean, second), _spread(terms, mean, second)
        solvable = (np.linalg.slogdet(slopes)[0] != 0.0) & np.isfinite(spread).all(axis=(1, 2))
        inverse = np.full(slopes.shape, np.nan)
        inverse[solvable] = np.linalg.inv(slopes[solvable])
        whole = inverse @ spread @ inverse.swapaxes(1, 2) / regression.n[good, None, None]
        result[good] = whole[:, : d + 1, : d + 1] * r[..., None] ** 2
    return result


def _terms(means: RadialMeans, variance: Floats, pair: Floats, d: int) -> Terms:
    """Terms of the equations at the nodes. Given R, the angle to u has a von Mises-Fisher law, concentrated by R/s."""
    node, weight = leggauss(_NODES)
    sigma = np.sqrt(variance)
    low, high = np.maximum(-1.0 / sigma, -_REACH), _REACH + np.sqrt(d)
    beyond = sigma * (low + 0.5 * (high - low) * (node + 1.0))
    distance = 1.0 + beyond
    narrow = distance / variance
    cosine, bessel = np.empty(narrow.shape), np.empty(narrow.shape)
    angle_means(narrow, d, bessel, cosine)
    density = distance ** (0.5 * (d - 1)) * bessel * np.exp(-0.5 * (beyond / sigma) ** 2)
    excess = beyond - means.lengthening
    pull = (1.0 - pair) * (beyond - means.excess01) + pair * distance * (beyond - means.excess12)
    weights = weight * density
    weights /= weights.sum(axis=1, keepdims=True)
    across = (d - 1) * cosine / narrow
    return Terms(weights, distance, cosine, across, pull, excess, excess**2 - means.variance)


def _slopes(terms: Terms, means: RadialMeans, pair: Floats, mean: Floats, second: Floats) -> Floats:
    """J (b, d+2, d+2) by (c, r, s)."""
    b, d = mean.shape
    rest, direction = 1.0 - pair, np.asarray(1.0 + means.shortening)
    even = rest * (1.0 + means.excess01)
    straight = rest + pair * (means.lengthening - means.excess12) - even * terms.mean(1.0 / terms.distance)
    slopes = np.zeros((b, d + 2, d + 2))
    slopes[:, :d, :d] = -terms.outer(pair * terms.distance + even / terms.distance, second)
    slopes[:, :d, :d] -= straight[..., None] * np.eye(d)
    by_r = rest * (1.0 + means.excess01_by_r) * direction + pair * (1.0 + means.excess12_by_r)
    by_s = rest * means.excess01_by_s * direction + pair * means.excess12_by_s
    slopes[:, :d, d], slopes[:, :d, d + 1] = -by_r * mean, -by_s * mean
    slopes[:, d, :d] = -direction * mean
    slopes[:, d + 1, :d] = -2.0 * (1.0 - (1.0 + means.lengthening) * direction) * mean
    slopes[:, d, d], slopes[:, d, d + 1] = np.ravel(-direction), np.ravel(-means.mean_by_s)
    slopes[:, d + 1, d], slopes[:, d + 1, d + 1] = np.ravel(-means.variance_by_r), np.ravel(-means.variance_by_s)
    return slopes


def _spread(terms: Terms, mean: Floats, second: Floats) -> Floats:
    """Ω (b, d+2, d+2): the covariance of the terms."""
    b, d = mean.shape
    spread = np.empty((b, d + 2, d + 2))
    spread[:, :d, :d] = terms.outer(terms.pull**2, second)
    others = (terms.excess, terms.square)
    for i, one in enumerate(others):
        cross = terms.mean(terms.pull * one * terms.cosine) * mean
        spread[:, :d, d + i] = spread[:, d + i, :d] = cross
        for j, other in enumerate(others):
            spread[:, d + i, d + j] = terms.mean(one * other)[:, 0]
    return spread
