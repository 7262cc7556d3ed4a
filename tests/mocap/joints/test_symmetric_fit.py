import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from study.mocap.joints.segment_poses import PosePoint, fit_poses
from study.mocap.joints.symmetric_fit import symmetric_fit

PARENT = np.array([[0.1, 0.0, 0.0], [-0.1, 0.05, 0.0], [0.0, -0.1, 0.05], [0.0, 0.05, 0.1]])
CHILD = np.array([[0.0, 0.06, -0.1], [0.04, -0.02, -0.2], [-0.04, 0.0, -0.25]])
JOINT = np.array([0.03, 0.05, -0.2])
AXIS = np.array([0.2, 0.9, 0.3]) / np.linalg.norm([0.2, 0.9, 0.3])


@pytest.fixture
def limbs(rng):
    """Make two segments about a joint, with three or four noisy markers each, rotating about three axes, or one."""

    def make(frames, sigma, degrees):
        world = Rotation.random(frames, rng=rng)
        angles = np.radians(rng.uniform(-1, 1, (frames, 3)) * degrees)
        if degrees[1] or degrees[2]:
            bend = Rotation.from_euler("yxz", angles)
        else:
            bend = Rotation.from_rotvec(angles[:, :1] * AXIS)
        joint = world.apply(JOINT)
        sets = []
        for turn, shape, shift in ((world, PARENT, np.zeros(3)), (world * bend, CHILD, joint)):
            x = np.einsum("tij,mj->mit", turn.as_matrix(), shape) + np.broadcast_to(shift, (frames, 3)).T
            sets.append([PosePoint(str(k), row + sigma * rng.standard_normal(row.shape)) for k, row in enumerate(x)])
        parent, child = (fit_poses(name, points) for name, points in zip(("parent", "child"), sets, strict=True))
        return parent, child, joint.T, world.apply(AXIS).T

    return make


def test_without_noise_it_is_exact(limbs):
    """Without noise both places are exact and the gap is 0, to rounding."""
    parent, child, joint, _ = limbs(100, 0.0, (40, 20, 20))
    found = symmetric_fit(parent, child)
    np.testing.assert_allclose(parent.to_world(found.in_parent), joint, atol=1e-7)
    np.testing.assert_allclose(child.to_world(found.in_child), joint, atol=1e-7)
    assert found.gap < 1e-7
    assert not found.hinge


def test_unbiased_and_its_covariance_right(limbs):
    """Over 60 recordings of 500 frames the mean error is within 4.5 errors of 0 (3 in 10⁵), and 95 % sets cover.

    Binomial(60, .95) is below 50 in 3 of 10⁴. The noise is large here: it rotates the child's pose by 4°.
    """
    errors, level = [], 0
    for _ in range(60):
        parent, child, joint, _ = limbs(500, 0.004, (40, 20, 20))
        found = symmetric_fit(parent, child)
        error = found.in_parent - parent.mean_place(joint)
        errors.append(error)
        level += error @ np.linalg.solve(found.covariance, error) < stats.chi2.ppf(0.95, 3)
    errors = np.array(errors)
    assert np.abs(errors.mean(axis=0) / (errors.std(axis=0, ddof=1) / np.sqrt(60))).max() < 4.5
    assert level >= 50


def test_a_hinge_shows_its_axis(limbs):
    """A hinge's axis is right to 1° in both segments, and the centre is on it to 2 mm."""
    parent, child, joint, axis = limbs(1000, 0.002, (60, 0, 0))
    found = symmetric_fit(parent, child)
    assert found.hinge
    for poses, direction in zip((parent, child), found.axes, strict=True):
        true = poses.to_local(axis + poses.origin).mean(axis=1)
        assert np.degrees(np.arccos(abs(direction @ true) / np.linalg.norm(true))) < 1.0
    off = found.in_parent - parent.mean_place(joint)
    true = parent.to_local(axis + parent.origin).mean(axis=1)
    assert np.linalg.norm(np.cross(off, true / np.linalg.norm(true))) < 0.002
    assert np.degrees(found.rms_angles[0]) == pytest.approx(60 / np.sqrt(3), abs=3)
    assert np.degrees(found.rms_angles[1:]).max() < 3


def test_no_joint_without_rotation(limbs):
    """Segments that do not rotate have no joint, and neither have segments that share too few frames."""
    parent, child, _, _ = limbs(50, 0.0, (0.5, 0.3, 0.3))
    assert symmetric_fit(parent, child) is None
    assert symmetric_fit(parent.in_frames(np.arange(3)), child.in_frames(np.arange(3))) is None
