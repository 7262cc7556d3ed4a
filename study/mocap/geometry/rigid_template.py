"""The shape of the markers on one rigid segment, from a recording with missing, stray and swapped samples.

Classical scaling turns the median distances between markers into a shape. Generalised Procrustes analysis refines it
on the frames without outliers: fit the shape to each frame, take the mean of the markers in the shape's axes, repeat.

Source: Torgerson 1952 (scaling); Gower 1975 (Procrustes), without change of size.
"""

from dataclasses import dataclass

import numpy as np

from study.mocap.geometry.distance_outliers import distance_outliers, usual_distances
from study.mocap.geometry.kabsch import fit_rigid_motion
from study.mocap.geometry.moving_axes import to_local
from study.sphere.types import Bools, Floats, Ints

_ENOUGH = 500
"""Most frames that a shape is refined on, spread over the recording; more would not change it visibly."""
_ROUNDS = 30
_CONVERGED = 1e-7
"""Refinement ends after a round that changes the shape by less than this share of its size."""


@dataclass(frozen=True)
class RigidTemplate:
    """The shape of a segment's markers, and the samples that agree with it.

    Attributes:
        points: the shape (m, 3), metres, about its centroid; axes as in one frame of the recording. NaN for a marker
            that no frame shows together with the others.
        good: samples that are present and whose distances to the other markers are right (m, frames).
        outliers: samples that are present and whose distances are wrong, such as swapped markers (m, frames).
    """

    points: Floats
    good: Bools
    outliers: Bools


def fit_template(x: Floats) -> RigidTemplate:
    """Find the shape of the markers of one segment.

    Args:
        x: markers (m, 3, frames), metres; NaN where missing.
    """
    m = len(x)
    seen = ~np.isnan(x).any(axis=1)
    outliers = np.zeros_like(seen)
    if m > 1:
        middle, limit = usual_distances(x)
        outliers = distance_outliers(x, middle, limit)
    good = seen & ~outliers
    if m < 3:
        points = _line(m, middle[0, 1] if m == 2 else 0.0)
        return RigidTemplate(points, good, outliers)
    whole = _jointly_visible(np.isfinite(middle))
    points = np.full((m, 3), np.nan)
    if len(whole) >= 3:
        points[whole] = _refine(_classical_scaling(middle[np.ix_(whole, whole)]), x[whole], good[whole])
    return RigidTemplate(points, good, outliers)


def _jointly_visible(pairs: Bools) -> Ints:
    """Markers of which each two share a frame; those that lack the most partners are left out first."""
    chosen = list(range(len(pairs)))
    while not pairs[np.ix_(chosen, chosen)].all():
        del chosen[int(pairs[np.ix_(chosen, chosen)].sum(axis=1).argmin())]
    return np.array(chosen)


def _line(m: int, length: float) -> Floats:
    """Shape of one or two markers: along the first axis, about their middle."""
    points = np.zeros((m, 3))
    if m == 2:
        points[:, 0] = [-0.5 * length, 0.5 * length]
    return points


def _classical_scaling(distances: Floats) -> Floats:
    """Points (m, 3) with nearly these distances (m, m), or their mirror image."""
    m = len(distances)
    centring = np.eye(m) - 1.0 / m
    values, vectors = np.linalg.eigh(-0.5 * centring @ distances**2 @ centring)
    leading = np.sqrt(np.maximum(values[-3:], 0.0))
    return np.asarray(vectors[:, -3:] * leading)


def _refine(points: Floats, x: Floats, good: Bools) -> Floats:
    """Procrustes mean, started from the given shape or its mirror image, whichever is nearer to the frames."""
    enough = np.flatnonzero(good.sum(axis=0) >= 3)
    if not len(enough):
        return np.full_like(points, np.nan)
    chosen = enough[np.linspace(0, len(enough) - 1, min(len(enough), _ENOUGH)).astype(int)]
    part, used = np.ascontiguousarray(x[:, :, chosen]), np.ascontiguousarray(good[:, chosen])
    mirrored = points * np.array([1.0, 1.0, -1.0])
    points = min(points, mirrored, key=lambda shape: _mean_square_distance(shape, part, used))
    size = np.sqrt((points**2).sum())
    for _ in range(_ROUNDS):
        following = _mean_shape(points, part, used)
        change = np.abs(following - points).max()
        points = following if np.isfinite(change) else points  # points on a line fit no frame: keep the shape
        if not change > _CONVERGED * size:
            break
    return points


def _mean_shape(points: Floats, x: Floats, used: Bools) -> Floats:
    """Mean of the markers (m, 3) in the axes of a shape fitted to each frame, about its centroid."""
    rotations, origins, known = fit_rigid_motion(points, x, used)
    y = to_local(rotations, origins, x)
    count = (used & known).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where((used & known)[:, None], y, 0.0).sum(axis=2) / count[:, None]
    return np.asarray(mean - mean.mean(axis=0))


def _mean_square_distance(points: Floats, x: Floats, used: Bools) -> float:
    """Mean square distance of the markers from a shape fitted to each frame, m²; infinite if it fits none."""
    rotations, origins, known = fit_rigid_motion(points, x, used)
    y = to_local(rotations, origins, x) - points[:, :, None]
    counted = used & known
    return float((y**2).sum(axis=1)[counted].mean()) if counted.any() else np.inf
