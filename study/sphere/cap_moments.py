"""Moments of directions uniform by area on a spherical cap: their mean and variances, along the axis and across it."""

import math
from typing import NamedTuple

import numpy as np
import scipy


class CapMoments(NamedTuple):
    """Moments of directions uniform on a cap."""

    mean: float
    along: float
    across: float


def cap_moments(half_angle: float, dimension: int) -> CapMoments:
    """Mean m₁ and variances Kₐ along the axis, Kₚ across it.

    Args:
        half_angle: φ in radians.
        dimension: d ≥ 2.

    They follow from the moments of the height by quadrature, without cancellation at small angles.
    """
    nodes, weights = scipy.special.roots_legendre(64)
    theta = 0.5 * half_angle * (nodes + 1.0)
    widest = math.sin(min(half_angle, 0.5 * math.pi))  # in its power of two, high powers do not vanish
    share = weights * np.ldexp(np.sin(theta), -math.frexp(widest)[1]) ** (dimension - 2)
    share /= share.sum()
    height = 2.0 * np.sin(0.5 * theta) ** 2
    mean = float(share @ height)
    across = float(share @ np.sin(theta) ** 2) / (dimension - 1)
    return CapMoments(1.0 - mean, float(share @ (height - mean) ** 2), across)
