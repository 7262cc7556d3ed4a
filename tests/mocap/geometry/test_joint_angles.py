import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.geometry.joint_angles import angles_about_center, rotation_vectors, turning_ways


def course(size, frames=400):
    """Rotation vectors (3, frames) of a smooth motion of mean zero."""
    t = np.arange(frames) / frames * 2 * np.pi
    return size * np.stack([np.sin(t), 0.5 * np.cos(2 * t), 0.2 * np.sin(3 * t)])


def test_rotation_vectors():
    """Vectors about the mean, in the parent's axes; NaN where unknown."""
    angles, rest = course(0.02), Rotation.from_rotvec([0.3, -0.8, 0.4])
    rotation = np.moveaxis((Rotation.from_rotvec(angles.T) * rest).as_matrix(), 0, 2)
    rotation[:, :, 7] = np.nan
    found = rotation_vectors(rotation)
    assert np.isnan(found[:, 7]).all()
    np.testing.assert_allclose(np.delete(found, 7, axis=1), np.delete(angles, 7, axis=1), atol=2e-4)


def test_angles_about_a_centre():
    """To first order, for two markers of which one is missing at times; one marker alone shows none along its arm."""
    angles, center = course(0.01), np.array([0.1, -0.2, 0.3])
    arms = np.array([[0.1, 0.02, 0.0], [0.0, 0.2, 0.1]])
    y = center[:, None] + np.einsum("tij,mj->mit", Rotation.from_rotvec(angles.T).as_matrix(), arms)
    used = np.ones((2, 400), dtype=bool)
    used[1, :5] = False
    found = angles_about_center(y, used, center)
    np.testing.assert_allclose(found[:, 5:], angles[:, 5:], atol=2e-4)
    alone = angles_about_center(y[:1], used[:1], center)
    along = arms[0] / np.linalg.norm(arms[0])
    np.testing.assert_allclose(alone, angles - np.outer(along, along @ angles), atol=2e-4)
    assert np.isnan(angles_about_center(y, np.zeros_like(used), center)).all()


@pytest.mark.parametrize("most", [1, 2])
def test_turning_ways(most):
    """About its greatest axis the joint turns one way in the rising half of a sine."""
    angles = course(0.3)
    ways = turning_ways(angles, 2, most)
    assert len(ways) == most
    rising = np.gradient(angles[0]) > 0
    one, two = ways[0]
    agree = (one == rising)[5:-5].mean()
    assert max(agree, 1 - agree) > 0.95
    assert not (one & two).any()
    assert (one | two)[2:-2].mean() > 0.98
    assert turning_ways(np.full((3, 9), np.nan), 1, 2) == []
