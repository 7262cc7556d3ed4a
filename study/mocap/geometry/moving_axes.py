"""Points and directions between the world's axes and axes that move with a body."""

import numpy as np

from study.sphere.types import Floats


def to_local(rotations: Floats, origins: Floats, x: Floats) -> Floats:
    """Express points of the world in moving axes: y = Rᵀ(x - o).

    Args:
        rotations: R (3, 3, frames).
        origins: o (3, frames).
        x: points (…, 3, frames).

    Returns:
        y, of the shape of x.
    """
    away = x - origins
    columns = [
        rotations[0, i] * away[..., 0, :] + rotations[1, i] * away[..., 1, :] + rotations[2, i] * away[..., 2, :]
        for i in range(3)
    ]
    return np.stack(columns, axis=-2)


def to_world(rotations: Floats, origins: Floats, point: Floats) -> Floats:
    """Express a point of moving axes in the world: R p + o.

    Args:
        rotations: R (3, 3, frames).
        origins: o (3, frames).
        point: p (3,), fixed in the moving axes, or one for each frame (3, frames).

    Returns:
        Places in the world (3, frames).
    """
    p = np.asarray(point)
    return np.asarray(rotations[:, 0] * p[0] + rotations[:, 1] * p[1] + rotations[:, 2] * p[2] + origins)


def relative_rotation(parent: Floats, child: Floats) -> Floats:
    """Rotations of one body in another's axes, R_PᵀR_Q (3, 3, frames), from both in the world (3, 3, frames)."""
    return np.asarray(np.einsum("jit,jkt->ikt", parent, child))


def mean_rotated_covariance(rotation: Floats, covariance: Floats) -> Floats:
    """Mean of R Σ Rᵀ (3, 3) over rotations (3, 3, frames), for a covariance Σ (3, 3)."""
    frames = rotation.shape[2]
    return np.asarray(np.einsum("ijt,jk,lkt->il", rotation, covariance, rotation, optimize=True) / frames)


def nearest_rotation(matrix: Floats) -> Floats:
    """Rotation (3, 3) nearest to a matrix (3, 3); for a sum of rotations it is their mean."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt)
