"""The slope of a segment's skin: how far its markers leave their rigid template as a joint rotates, in m/rad."""

import itertools

import numpy as np

from study.sphere.types import Floats

_BLOCKS = 16
"""Stretches of time from which the share of the noise is found, long enough to be independent of each other."""
_FEWEST = 6
"""Fewest frames for each regressor."""


def skin_slope(departures: Floats, angles: Floats) -> float:
    """Measure the mean square slope of the skin of a segment against the angles of a joint.

    The departures from the rigid template are regressed on the rotation vector and its six quadratics. What these
    explain, less what noise alone would explain, belongs to the skin. The rigid fit takes six of the 3m coordinates.

    Args:
        departures: of the markers from their places in the template (m, 3, frames), metres; NaN where one is missing.
        angles: rotation vectors of the joint (3, frames), radians; NaN where unknown.

    Returns:
        Mean square of an entry of the tensor (3, 3) that takes the rotation vector to a marker's displacement,
        (m/rad)²; NaN if the frames are too few, or m < 3.
    """
    m = len(departures)
    d = departures.reshape(3 * m, -1)
    known = ~(np.isnan(d).any(axis=0) | np.isnan(angles[0]))
    n = int(known.sum())
    if m < 3 or n < 9 * _FEWEST:
        return float("nan")
    d, x = d[:, known], angles[:, known]
    x = x - x.mean(axis=1, keepdims=True)
    quadratics = [x[i] * x[j] for i in range(3) for j in range(i, 3)]
    regressors = np.concatenate([x, quadratics])
    regressors -= regressors.mean(axis=1, keepdims=True)
    d = d - d.mean(axis=1, keepdims=True)
    rows = np.linalg.svd(regressors, full_matrices=False)[2]  # orthonormal
    coefficients = rows @ d.T
    rest = d - coefficients.T @ rows
    edges = np.linspace(0, n, _BLOCKS + 1).astype(int)
    blocks = [rows[:, a:b] @ rest[:, a:b].T for a, b in itertools.pairwise(edges)]
    noise = sum(float((block**2).sum()) for block in blocks) * _BLOCKS / (_BLOCKS - 1)
    explained = max(float((coefficients**2).sum()) - noise, 0.0) / (3 * m * n)
    return explained * 3 * m / (3 * m - 6) / max(float((x**2).sum()) / n, 1e-300)
