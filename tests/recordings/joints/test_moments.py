"""Tests of moments."""

import numpy as np
import pytest

from study.recordings.joints.center import LocalMarker, PooledMoments
from study.recordings.joints.poses import PoseNoise, fit_poses, poses_from_markers, reference_frame
from study.recordings.markersets import load_markerset
from study.recordings.synthetic.make import Recipe, synthesize


def frame_noise(rng, frames, tilt=0.0, shift=0.0, cross=False):
    """Noise of poses whose rotations and translations have these standard deviations, in two patterns."""
    a = rng.standard_normal((2, 3, 3))
    turn, move = tilt**2 * a @ a.swapaxes(1, 2) / 3, shift**2 * np.eye(3) * np.array([1.0, 2.0])[:, None, None]
    return PoseNoise(rng.integers(0, 2, frames), 0.05 * rng.standard_normal((2, 3)), move, turn, np.zeros((2, 3, 3)))


def moments(y, used, pose, own, size):
    """Moments of one marker."""
    return PooledMoments([LocalMarker(y, used, own)], [0], pose, size)


def test_the_noise_is_that_of_the_formula(rng):
    """The means of F, F z, Tr(F) z and zᵀFz are those computed sample by sample from the matrices of (*)."""
    frames = 50
    pose = frame_noise(rng, frames, tilt=0.1, shift=0.01)
    pose = PoseNoise(pose.pattern, pose.centroid, pose.shift, pose.tilt, 1e-3 * rng.standard_normal((2, 3, 3)))
    y = rng.standard_normal((3, frames))
    found = moments(y, np.ones(frames, bool), pose, 0.02, 0.5)
    total, pulled, traced, along = np.zeros((3, 3)), np.zeros(3), np.zeros(3), 0.0
    points = found.z[0] + found.mean[0][:, None]
    for t in range(frames):
        p = pose.pattern[t]
        expected = pose.centroid[p] + pose.expansion(0.5)[p] @ (y[:, t] - pose.centroid[p]) - pose.mean_shift(0.5)[p]
        np.testing.assert_allclose(points[:, t], expected, atol=1e-12)
        v = points[:, t] - pose.centroid[p]
        k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
        mixed = k @ pose.cross[p]
        f = 0.02 * np.eye(3) + pose.shift[p] + k @ pose.tilt[p] @ k.T - mixed - mixed.T
        z = found.z[0][:, t]
        total, pulled, traced, along = total + f, pulled + f @ z, traced + np.trace(f) * z, along + z @ f @ z
    np.testing.assert_allclose(found.f[0], total / frames, rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(found.fz[0], pulled / frames, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(found.trace_z[0], traced / frames, rtol=1e-9, atol=1e-14)
    assert found.zfz == pytest.approx(along / frames)


def test_scores_add_up_to_the_equations(rng):
    """Their sum is b - A c, with A and b of the moments, which is zero at the centre."""
    frames, size = 200, 0.8
    pose = frame_noise(rng, frames, tilt=0.05, shift=0.01)
    y = rng.standard_normal((3, frames))
    used = rng.random(frames) < 0.9
    found = moments(y, used, pose, 0.02, size)
    center = rng.standard_normal(3)
    found.w = 2.0 * found.n
    scores = found.scores(size, center, np.eye(3))
    offset, noise = center - found.mean[0], found.f[0]
    third = found.s[0] - size * (2 * found.fz[0] + found.trace_z[0])
    wanted = 0.5 * third - (found.c[0] - size * noise) @ offset
    np.testing.assert_allclose(scores[:3].sum(axis=1), 2.0 * found.n * wanted, rtol=1e-9, atol=1e-9)
    assert (scores[:, ~used] == 0.0).all()
    f = ((found.z[0] - offset[:, None]) ** 2).sum(axis=0)
    strain = found.zfz[0] - 2 * offset @ found.fz[0] + offset @ noise @ offset
    wanted = f.var() - 4 * size * strain + 2 * size**2 * found.squared_noise(center)[0]
    assert scores[3].sum() == pytest.approx(2.0 * found.n[0] * wanted)


@pytest.fixture(scope="module")
def figure():
    """A noisy figure and its marker set."""
    recording, truth = synthesize(Recipe(frames=600, noise=0.002, gaps=0.1))
    return load_markerset("cmu41"), recording, truth


def test_sigma_and_scatter(figure):
    """Sigma is the noise, 2 mm, to 6 %; a point's rms distance is below √3 of it, for the fit absorbs some."""
    markerset, recording, _ = figure
    for name in ("pelvis", "thorax", "left_foot"):
        poses = poses_from_markers(markerset, recording)[name]
        assert poses.sigma == pytest.approx(0.002, rel=0.06)
        assert (poses.scatter < np.sqrt(3) * 0.0022).all()
        assert (poses.scatter > 0.0005).all()


def test_joint_as_third_point(figure):
    """A thigh's poses follow from its two markers and the true hip; the markers' noise is separated from the hip's."""
    markerset, recording, truth = figure
    hip = truth.centers[truth.joints.index("left_hip")]
    tiny = np.repeat(1e-10 * np.eye(3)[:, :, None], recording.frames, axis=2)
    markers = markerset.segment("left_thigh").markers
    names, x = ["left_hip", *markers], [hip, *map(recording.of, markers)]
    poses = fit_poses("left_thigh", names, x, tiny)
    assert poses.points == ("left_hip", "LTHI", "LKNE")
    assert poses.sigma == pytest.approx(0.002, rel=0.1)
    knee = truth.centers[truth.joints.index("left_knee")]
    place = poses.mean_place(knee)
    error = poses.to_world(place)[:, poses.known] - knee[:, poses.known]
    expected = np.trace(poses.noise.covariance_at(place))
    assert (error**2).sum(axis=0).mean() == pytest.approx(expected, rel=0.2)
    loose = fit_poses("left_thigh", names, x, 1e6 * tiny)  # a hip that is known to a centimetre
    assert 1.5e-4 < np.trace(loose.noise.covariance_at(loose.template[0])) < 3e-4


def test_points_on_a_line(rng):
    """Points on a line give a reason instead of poses; so do points that are never seen at once."""
    x = rng.standard_normal((3, 50))
    line = [x + 0.1 * k * np.array([[1.0], [0], [0]]) for k in range(3)]
    assert "lie on a line" in fit_poses("arm", "abc", line)
    one = rng.standard_normal((3, 50))
    one[:, :30] = np.nan
    two = rng.standard_normal((3, 50))
    two[:, 20:] = np.nan
    assert "never seen together" in fit_poses("arm", "abc", [one, two, x])


def test_reference(figure):
    """The frame of reference has the most markers."""
    seen = figure[1].seen().sum(axis=0)
    assert seen[reference_frame(figure[1])] == seen.max()
