import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.skeleton.full_pose import PivotPath, SegmentPath
from study.mocap.skeleton.partial_pose import ExpectedPoses, complete_poses

PLACES = np.array([[0.0, 0.1, -0.3]])


@pytest.mark.parametrize("pinned", [True, False])
def test_shortest_arc(rng, pinned):
    """With one marker the segment points at it, by the least rotation from the expected pose; the joint stays put.

    The least rotation that takes u to v is about u × v, by the angle between them.
    """
    joint, expected = np.array([0.02, -0.05, 0.1]), Rotation.random(rng=rng)
    u = expected.apply(PLACES[0] - joint)
    v = Rotation.from_rotvec([0.3, -0.5, 0.2]).apply(u)
    world = np.full((3, 1), np.nan)
    if pinned:
        world[:, 0] = [1.0, 2.0, 3.0]
    x = (np.array([1.0, 2.0, 3.0]) + v).reshape(1, 3, 1)
    path = SegmentPath(
        rotation=np.full((3, 3, 1), np.nan),
        origin=np.full((3, 1), np.nan),
        fitted=np.zeros(1, bool),
        used=np.ones((1, 1), bool),
        square=np.full(1, np.nan),
    )
    guess = ExpectedPoses(np.array([0]), expected.as_matrix()[:, :, None], np.zeros((3, 1)))
    complete_poses(PLACES, x, PivotPath(joint, world), guess, path)
    rotation, origin = path.rotation[:, :, 0], path.origin[:, 0]
    np.testing.assert_allclose(rotation @ PLACES[0] + origin, x[0, :, 0], atol=1e-12)
    if pinned:
        axis = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        angle = np.arccos(u @ v / (np.linalg.norm(u) * np.linalg.norm(v)))
        wanted = Rotation.from_rotvec(angle * axis) * expected
        np.testing.assert_allclose(rotation, wanted.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(rotation @ joint + origin, world[:, 0], atol=1e-12)
    else:  # a marker without a joint shows no direction
        np.testing.assert_allclose(rotation, expected.as_matrix(), atol=1e-12)
