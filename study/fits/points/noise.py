"""Noise as an argument: one standard deviation or covariance for all points, or one for each point."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from study.arrays import Bools, Floats


def unit_covariance(noise: ArrayLike, dimension: int) -> tuple[Floats, float]:
    """Covariance (d, d) of size 1 of a noise σ or Σ, and the power of two that times it gives the noise again."""
    covariance = noise_covariance(noise, dimension)
    unit = float(np.ldexp(1.0, np.frexp(np.trace(covariance))[1]))
    return covariance / unit, unit


def noise_covariance(noise: ArrayLike, dimension: int) -> Floats:
    """Covariance (d, d) of a noise that is given as σ or Σ.

    Raises:
        TypeError: if it is no real number.
        ValueError: if it is neither a standard deviation nor a covariance. The message says why.
    """
    value = np.asarray(noise)
    if value.dtype.kind not in "fiu":
        raise TypeError(f"noise has dtype {value.dtype}: give a standard deviation, or a covariance, in real numbers")
    value = value.astype(float, copy=False)
    if value.ndim == 0:
        sigma = float(value)
        return np.eye(dimension) * variance(sigma)
    if value.shape != (dimension, dimension):
        wanted = f"give a standard deviation, or a ({dimension}, {dimension}) covariance"
        raise ValueError(f"noise has shape {value.shape}: {wanted}")
    if not np.all(np.isfinite(value)) or not np.allclose(value, value.T, rtol=1e-12, atol=0.0):
        raise ValueError("noise: a covariance must be finite and symmetric")
    if not np.linalg.eigvalsh(value)[0] > 0.0:
        raise ValueError("noise: a covariance must be positive definite")
    return value


def variance(sigma: float) -> float:
    """The square of a standard deviation; ValueError unless both are positive and finite."""
    if not (sigma > 0.0 and 0.0 < sigma * sigma < math.inf):
        raise ValueError(f"noise = {sigma!r}: a standard deviation must be positive and finite, and so must its square")
    return sigma * sigma


def is_per_point(shape: tuple[int, ...], n: int, d: int) -> bool:
    """True for the shape of a noise of each of n points: σ (…, n), or of coordinates (…, n, d), or Σ (…, n, d, d)."""
    return shape[-1:] == (n,) or shape[-2:] == (n, d) or shape[-3:] == (n, d, d)


def point_noise(noise: Floats, shape: tuple[int, ...], of: str = "points") -> Floats:
    """Variances (b, n), or covariances (b, n, d, d), of a noise for each of n points in a batch (…, n, d); 0: none.

    Args:
        noise: σ of each point, or those of its coordinates, or its covariance; see `is_per_point`.
        shape: of the points.
        of: the points, for messages.

    Raises:
        ValueError: if the leading axes are not those of the points, or a value cannot be used.
    """
    *lead, n, d = shape
    own = noise.shape[-1:] if noise.shape[-1:] == (n,) else noise.shape[-2 - (noise.shape[-2:] != (n, d)) :]
    try:
        noise = np.broadcast_to(noise, (*lead, *own)).reshape(math.prod(lead), *own)
    except ValueError:
        words = f"its leading axes must be those of the {of}, {tuple(lead)}"
        raise ValueError(f"noise has shape {noise.shape}: {words}") from None
    missing: Bools = np.isnan(noise)
    if noise.ndim < 4:
        wrong = np.asarray(~missing & ~((noise > 1e-150) & (noise < 1e150)))
        if wrong.any():
            place = tuple(int(i) for i in np.argwhere(wrong)[0])
            value = f"noise[{', '.join(map(str, place[1:]))}] = {noise[place]:g}"
            words = "must be positive and finite, and so must its square; a point that is to be left out is NaN"
            raise ValueError(f"{value}: the standard deviation of a point {words}")
        square = np.where(missing, 0.0, noise) ** 2
        return square if noise.ndim == 2 else square[..., None] * np.eye(noise.shape[2])
    whole: Bools = np.asarray(~missing.any(axis=(2, 3)))
    safe = np.where(whole[..., None, None], noise, np.eye(noise.shape[3]))
    fine: Bools = np.asarray(np.isfinite(safe).all(axis=(2, 3)))
    fine &= np.isclose(safe, safe.swapaxes(2, 3), rtol=1e-9, atol=0.0).all(axis=(2, 3))
    fine[fine] = np.linalg.eigvalsh(safe[fine])[:, 0] > 0.0
    if not fine.all():
        where = ", ".join(str(i) for i in np.argwhere(~fine)[0][1:])
        raise ValueError(f"noise[{where}]: the covariance of a point must be finite, symmetric and positive definite")
    return np.where(whole[..., None, None], safe, 0.0)
