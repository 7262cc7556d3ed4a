import numpy as np
import pytest

from study.mocap.geometry.pose_noise import PoseNoise
from study.mocap.joints.marker_moments import marker_moments
from study.mocap.joints.marker_scores import add_scores
from study.sphere.moments import Moments


def frame_noise(rng, frames, tilt=0.0, shift=0.0, cross=False):
    """Noise of poses whose rotations and translations have these standard deviations, in two patterns."""
    a = rng.standard_normal((2, 3, 3))
    turn, move = tilt**2 * a @ a.swapaxes(1, 2) / 3, shift**2 * np.eye(3) * np.array([1.0, 2.0])[:, None, None]
    return PoseNoise(rng.integers(0, 2, frames), 0.05 * rng.standard_normal((2, 3)), move, turn, np.zeros((2, 3, 3)))


def test_without_pose_noise_they_are_plain_moments(rng):
    """For an exact pose they are those of `Moments`, divided by n, of the samples that are used."""
    y = rng.standard_normal((3, 300)) + 5.0
    used = rng.random(300) < 0.7
    found = marker_moments(y, used, frame_noise(rng, 300), 0.01, 1.0)
    plain = Moments.of(np.ascontiguousarray(y[:, used])[None])
    n = used.sum()
    assert found.count == n
    np.testing.assert_allclose(found.mean, plain.mean[0], rtol=1e-13)
    np.testing.assert_allclose(found.second, plain.second[0] / n, rtol=1e-12)
    np.testing.assert_allclose(found.third, plain.third[0] / n, rtol=1e-9, atol=1e-12)
    assert found.fourth == pytest.approx(plain.fourth[0] / n)
    np.testing.assert_allclose(found.noise, 0.01 * np.eye(3), atol=1e-17)
    np.testing.assert_allclose(found.noise_z, 0.0, atol=1e-15)
    assert found.z_noise_z == pytest.approx(0.01 * np.trace(plain.second[0]) / n)
    assert found.squared_noise(np.ones(3)) == pytest.approx(3 * 0.01**2)


def test_the_noise_is_that_of_the_formula(rng):
    """The means of F, F z, Tr(F) z and zᵀFz are those computed sample by sample from the matrices of (*)."""
    frames = 50
    pose = frame_noise(rng, frames, tilt=0.1, shift=0.01)
    pose = PoseNoise(pose.pattern, pose.centroid, pose.shift, pose.tilt, 1e-3 * rng.standard_normal((2, 3, 3)))
    y = rng.standard_normal((3, frames))
    found = marker_moments(y, np.ones(frames, bool), pose, 0.02, 0.5)
    total, pulled, traced, along = np.zeros((3, 3)), np.zeros(3), np.zeros(3), 0.0
    points = found.z + found.mean[:, None]
    for t in range(frames):
        p = pose.pattern[t]
        expected = pose.centroid[p] + pose.expansion(0.5)[p] @ (y[:, t] - pose.centroid[p]) - pose.mean_shift(0.5)[p]
        np.testing.assert_allclose(points[:, t], expected, atol=1e-12)
        v = points[:, t] - pose.centroid[p]
        k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
        mixed = k @ pose.cross[p]
        f = 0.02 * np.eye(3) + pose.shift[p] + k @ pose.tilt[p] @ k.T - mixed - mixed.T
        z = found.z[:, t]
        total, pulled, traced, along = total + f, pulled + f @ z, traced + np.trace(f) * z, along + z @ f @ z
    np.testing.assert_allclose(found.noise, total / frames, rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(found.noise_z, pulled / frames, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(found.trace_z, traced / frames, rtol=1e-9, atol=1e-14)
    assert found.z_noise_z == pytest.approx(along / frames)


def test_scores_add_up_to_the_equations(rng):
    """Their sum is b - A c, with A and b of the moments, which is zero at the centre."""
    frames, size = 200, 0.8
    pose = frame_noise(rng, frames, tilt=0.05, shift=0.01)
    y = rng.standard_normal((3, frames))
    used = rng.random(frames) < 0.9
    found = marker_moments(y, used, pose, 0.02, size)
    center = rng.standard_normal(3)
    scores = np.zeros((4, frames))
    add_scores(found, size, center, np.eye(3), 2.0, scores)
    offset = center - found.mean
    third = found.third - size * (2 * found.noise_z + found.trace_z)
    wanted = 0.5 * third - (found.second - size * found.noise) @ offset
    np.testing.assert_allclose(scores[:3].sum(axis=1), 2.0 * found.count * wanted, rtol=1e-9, atol=1e-9)
    assert (scores[:, ~used] == 0.0).all()
    f = ((found.z[:, used] - offset[:, None]) ** 2).sum(axis=0)
    strain = found.z_noise_z - 2 * offset @ found.noise_z + offset @ found.noise @ offset
    wanted = f.var() - 4 * size * strain + 2 * size**2 * found.squared_noise(center)
    assert scores[3].sum() == pytest.approx(2.0 * found.count * wanted)
