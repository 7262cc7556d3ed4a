"""What theory expects of a cap: where GDKE ends up, and how the median error relates to the bound.

Directions u uniform on a cap have mean (m₁, 0, …) and covariance diag(Kₐ, Kₚ, …): `study.sphere.cap.cap_moments`.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special, stats

from study.sphere.cap import CapMoments


def gdke_bias(noise: float, moments: CapMoments, noise_shape: NDArray[np.float64]) -> float:
    """Length of GDKE's bias for many samples, (C₀ + Σ)⁻¹ Σ (c₀ - μ̄): a shrink towards the points.

    Args:
        noise: σ over the radius.
        moments: of the cap.
        noise_shape: covariance of a sample in units of σ² (d, d).

    Returns:
        The length over the radius.
    """
    d = len(noise_shape)
    extent = np.diag([moments.along] + [moments.across] * (d - 1))
    sigma = noise**2 * noise_shape
    to_center = np.zeros(d)
    to_center[0] = -moments.mean
    return float(np.linalg.norm(np.linalg.solve(extent + sigma, sigma @ to_center)))


def median_at_bound(moments: CapMoments, dimension: int) -> float:
    """Median error over √tr CRLB of an estimator whose errors are Gaussian at the bound, for isotropic noise.

    The variances are as 1/Kₐ along the axis and 1/Kₚ across it; the distribution function of the length is that of
    the d - 1 coordinates across, averaged over the one along.
    """
    total = 1.0 / moments.along + (dimension - 1) / moments.across
    along, across = 1.0 / moments.along / total, 1.0 / moments.across / total
    nodes, weights = special.roots_legendre(200)

    def excess(length: float) -> float:
        limit = length / math.sqrt(along)
        z = limit * nodes
        inside = stats.chi2.cdf((length**2 - along * z**2) / across, dimension - 1)
        return float(limit * np.sum(weights * stats.norm.pdf(z) * inside)) - 0.5

    return float(optimize.brentq(excess, 1e-3, 3.0))
