"""Angles of a joint over time, as rotation vectors about its mean position, and the frames of rotation each way.

They come from the rotations of one segment in the other's axes; or, where only one segment has a pose, from the markers
of the other about the joint's centre, to first order.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from study.mocap.geometry.moving_axes import nearest_rotation
from study.mocap.geometry.pose_noise import skew
from study.sphere.types import Bools, Floats

_THIN = 1e-6
"""Share of markers' greatest moment of inertia below which they show no rotation about an axis."""


def rotation_vectors(rotation: Floats) -> Floats:
    """Rotation vectors about the mean rotation.

    Args:
        rotation: of one segment in another's axes (3, 3, frames); NaN where unknown.

    Returns:
        Vectors in the other's axes (3, frames), radians; NaN where unknown.
    """
    known = ~np.isnan(rotation[0, 0])
    vectors = np.full((3, rotation.shape[2]), np.nan)
    if known.any():
        matrices = np.moveaxis(rotation[:, :, known], 2, 0)
        mean = nearest_rotation(matrices.sum(axis=0))
        vectors[:, known] = Rotation.from_matrix(matrices @ mean.T).as_rotvec().T
    return vectors


def angles_about_center(y: Floats, used: Bools, center: Floats) -> Floats:
    """Rotation vectors of markers about a centre, to first order, from their mean places.

    About an axis along which all markers lie nothing shows, and the vector has no component.

    Args:
        y: markers in a segment's axes (M, 3, frames), metres.
        used: samples to use (M, frames).
        center: of the joint (3,), metres.

    Returns:
        Vectors (3, frames), radians, of mean zero; NaN where no marker is seen.
    """
    vectors = np.full((3, y.shape[2]), np.nan)
    seen = np.flatnonzero(used.any(axis=1))
    if not len(seen):
        return vectors
    y, used = y[seen], used[seen]
    shown = np.where(used[:, None], y, 0.0)
    mean = shown.sum(axis=2) / used.sum(axis=1)[:, None]
    arm = mean - center
    weight = 1.0 / np.maximum((arm**2).sum(axis=1), 1e-300)
    moment = np.cross(arm[:, :, None], np.where(used[:, None], y - mean[:, :, None], 0.0), axis=1)
    moment = np.einsum("m,mit->it", weight, moment)
    inertia = weight[:, None, None] * np.einsum("mij,mkj->mik", skew(arm), skew(arm))
    bits = (np.where(used, 1, 0) << np.arange(len(seen))[:, None]).sum(axis=0)
    for pattern in np.unique(bits[bits > 0]):
        frames = bits == pattern
        total = inertia[(pattern >> np.arange(len(seen))) & 1 == 1].sum(axis=0)
        vectors[:, frames] = np.linalg.pinv(total, rcond=_THIN, hermitian=True) @ moment[:, frames]
    vectors -= np.nanmean(vectors, axis=1)[:, None]
    return vectors


def turning_ways(angles: Floats, lag: int, most: int) -> list[tuple[Bools, Bools]]:
    """Frames in which a joint rotates one way and the other, about each of the axes about which it rotates most.

    Args:
        angles: rotation vectors (3, frames), NaN where unknown.
        lag: the angles so many frames before and after decide the way, so that a frame's own noise does not.
        most: number of axes, one or two.

    Returns:
        The frames of each way (frames,), for each axis about which it rotates.
    """
    known = ~np.isnan(angles[0])
    if known.sum() < 2:
        return []
    values, axes = np.linalg.eigh(np.cov(angles[:, known]))
    difference = np.full(angles.shape, np.nan)
    difference[:, lag:-lag] = angles[:, 2 * lag :] - angles[:, : -2 * lag]
    turning = axes.T @ difference
    kept = [k for k in (2, 1)[:most] if values[k] > 0.0]
    with np.errstate(invalid="ignore"):
        return [(turning[k] > 0.0, turning[k] < 0.0) for k in kept]
