import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.geometry.kabsch import fit_rigid_motion


@pytest.fixture
def moved(rng):
    """Make a template in random poses, with noise; rotations and translations come with it."""

    def make(template, frames=40, noise=0.0):
        turns = Rotation.random(frames, rng=rng).as_matrix().transpose(1, 2, 0)
        shifts = rng.normal(size=(3, frames))
        x = np.einsum("ijt,mj->mit", turns, template) + shifts
        return x + noise * rng.standard_normal(x.shape), turns, shifts

    return make


@pytest.mark.parametrize("m", [3, 4, 6])
def test_agrees_with_scipy(rng, moved, m):
    """Rotations are those of scipy's Kabsch algorithm, for three markers (in a plane), four and six, with noise."""
    template = 0.1 * rng.standard_normal((m, 3))
    x, _, _ = moved(template, noise=0.01)
    rotation, origin, known = fit_rigid_motion(template, x)
    assert known.all()
    for t in range(x.shape[2]):
        wanted, _ = Rotation.align_vectors(x[:, :, t] - x[:, :, t].mean(axis=0), template - template.mean(axis=0))
        np.testing.assert_allclose(rotation[:, :, t], wanted.as_matrix(), atol=1e-9)
        shift = x[:, :, t].mean(axis=0) - wanted.apply(template.mean(axis=0))
        np.testing.assert_allclose(origin[:, t], shift, atol=1e-9)


def test_without_noise_the_motion_is_exact(rng, moved):
    """The true rotations and translations come back to rounding."""
    template = rng.standard_normal((4, 3))
    x, turns, shifts = moved(template)
    rotation, origin, known = fit_rigid_motion(template, x)
    assert known.all()
    np.testing.assert_allclose(rotation, turns, atol=1e-12)
    np.testing.assert_allclose(origin, shifts, atol=1e-12)


def test_mirrored_points(rng, moved):
    """For mirrored points the fit is the best proper rotation, as in scipy."""
    template = rng.standard_normal((5, 3))
    x, _, _ = moved(template * [1.0, 1.0, -1.0])
    rotation, _, known = fit_rigid_motion(template, x)
    assert known.all()
    np.testing.assert_allclose(np.linalg.det(rotation.transpose(2, 0, 1)), 1.0, atol=1e-12)
    wanted, _ = Rotation.align_vectors(x[:, :, 0] - x[:, :, 0].mean(axis=0), template - template.mean(axis=0))
    np.testing.assert_allclose(rotation[:, :, 0], wanted.as_matrix(), atol=1e-9)


def test_missing_and_unused_points(rng, moved):
    """Only points that are used enter a frame's fit; a frame with fewer than three is unknown."""
    template = rng.standard_normal((4, 3))
    x, turns, _ = moved(template)
    x[3] += 1.0
    used = np.ones((4, x.shape[2]), dtype=bool)
    used[3] = False
    x[0, :, 5] = np.nan
    rotation, origin, known = fit_rigid_motion(template, x, used)
    assert list(np.flatnonzero(~known)) == [5]
    np.testing.assert_allclose(rotation[:, :, known], turns[:, :, known], atol=1e-12)
    assert np.isnan(rotation[:, :, 5]).all()
    assert np.isnan(origin[:, 5]).all()


def test_points_on_a_line(moved):
    """Points on a line leave the pose unknown, for the rotation about the line is open."""
    x, _, _ = moved(np.array([[0.0, 0, 0], [0.1, 0, 0], [0.3, 0.001, 0]]))
    assert not fit_rigid_motion(np.array([[0.0, 0, 0], [0.1, 0, 0], [0.3, 0.001, 0]]), x)[2].any()
