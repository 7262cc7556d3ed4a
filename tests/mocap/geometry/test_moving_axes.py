import numpy as np
from scipy.spatial.transform import Rotation

from study.mocap.geometry.moving_axes import (
    mean_rotated_covariance,
    nearest_rotation,
    relative_rotation,
    to_local,
    to_world,
)


def rotations(rng, frames=30):
    """Random rotations (3, 3, frames)."""
    return Rotation.random(frames, rng=rng).as_matrix().transpose(1, 2, 0)


def test_points_there_and_back(rng):
    """`to_local` undoes `to_world`, for points that are fixed in the axes or move."""
    axes, origins, x = rotations(rng), rng.normal(size=(3, 30)), rng.normal(size=(4, 3, 30))
    point = rng.standard_normal(3)
    repeated = np.repeat(point[:, None], 30, axis=1)
    np.testing.assert_allclose(to_local(axes, origins, to_world(axes, origins, point)), repeated, atol=1e-12)
    np.testing.assert_allclose(to_world(axes, origins, to_local(axes, origins, x[1])), x[1], atol=1e-12)
    assert to_local(axes, origins, x).shape == x.shape


def test_relative_rotation(rng):
    """The parent's rotation after the relative one is the child's."""
    parent, child = rotations(rng), rotations(rng)
    both = np.einsum("ijt,jkt->ikt", parent, relative_rotation(parent, child))
    np.testing.assert_allclose(both, child, atol=1e-12)


def test_mean_rotated_covariance(rng):
    """It is the mean over frames of R Σ Rᵀ, one by one."""
    axes, root = rotations(rng), rng.standard_normal((3, 3))
    covariance = root @ root.T
    wanted = np.mean([axes[:, :, t] @ covariance @ axes[:, :, t].T for t in range(30)], axis=0)
    np.testing.assert_allclose(mean_rotated_covariance(axes, covariance), wanted, atol=1e-12)


def test_nearest_rotation(rng):
    """For a sum of rotations it is the mean rotation that scipy has, and never a reflection."""
    axes = Rotation.from_rotvec(0.3 * rng.standard_normal((30, 3)))
    found = nearest_rotation(axes.as_matrix().sum(axis=0))
    np.testing.assert_allclose(found, axes.mean().as_matrix(), atol=1e-12)
    assert np.linalg.det(nearest_rotation(np.diag([1.0, 2.0, -3.0]))) > 0.0
