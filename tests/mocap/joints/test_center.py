import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

import study
from study.mocap.geometry.kabsch import fit_rigid_motion
from study.mocap.geometry.moving_axes import to_local
from study.mocap.geometry.pose_noise import PoseNoise
from study.mocap.joints.center import LocalMarker, fit_center

CENTER = np.array([0.02, 0.09, -0.1])
PELVIS = np.array([[0.09, 0.12, 0.05], [0.09, -0.12, 0.05], [-0.1, 0.06, 0.06], [-0.1, -0.06, 0.06]])
LEG = np.array([[0.02, 0.06, -0.25], [0.0, 0.05, -0.42]])


def still(frames):
    """Noise of an exact pose."""
    none = np.zeros((1, 3, 3))
    return PoseNoise(np.zeros(frames, dtype=np.int64), np.zeros((1, 3)), none, none, none)


def swings(rng, frames, about):
    """Random rotations: uniform within ± these degrees about y, x and z."""
    return Rotation.from_euler("yxz", rng.uniform(-1, 1, (frames, 3)) * about, degrees=True)


@pytest.fixture
def leg(rng):
    """Make two markers about a joint, in the axes of four noisy ones, and the noise of these axes."""

    def make(frames, sigma, about, scale=1.0):
        child = np.einsum("tij,mj->mit", swings(rng, frames, about).as_matrix(), scale * LEG) + CENTER[:, None]
        seen = np.repeat(PELVIS[:, :, None], frames, axis=2)
        seen = seen + sigma * rng.standard_normal(seen.shape)
        rotation, origin, known = fit_rigid_motion(PELVIS, seen)
        y = to_local(rotation, origin, child + sigma * rng.standard_normal(child.shape))
        noise = np.repeat(max(sigma, 1e-9) ** 2 * np.eye(3)[None], 4, axis=0)
        pose = PoseNoise.of(PELVIS, noise, np.ones((4, frames), bool), known)
        return [LocalMarker(each, known, max(sigma, 1e-9) ** 2) for each in y], pose

    return make


def test_with_isotropic_noise_it_is_mgdk(rng, on_cap):
    """Centre, radii and condition are those of `study.mgdk`; η times the assumed variance is its noise variance.

    (`mgdk` counts degrees of freedom in the noise it reports; η as such is the same.)
    """
    sets = [on_cap(rng, n, 40.0, noise=0.02, radius=r, center=CENTER)[0] for n, r in ((400, 1.0), (300, 0.5))]
    joint = study.mgdk(sets)
    markers = []
    for points in sets:
        y = np.full((3, 400), np.nan)
        y[:, : len(points)] = points.T
        markers.append(LocalMarker(y, ~np.isnan(y[0]), 1e-4))
    found = fit_center(markers, still(400))
    np.testing.assert_allclose(found.center, joint.center, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.radii, joint.radii, rtol=1e-6)
    assert found.condition == pytest.approx(joint.condition, rel=1e-4)
    spare = (700 - 3 - 2) / 700
    assert found.size * 1e-4 == pytest.approx(joint.noise_variance * spare, rel=1e-4)
    assert found.axis is None


def test_without_noise_it_is_exact(leg):
    """Without noise centre and radii are exact to rounding."""
    markers, pose = leg(200, 0.0, (30, 15, 15))
    found = fit_center(markers, pose)
    np.testing.assert_allclose(found.center, CENTER, atol=1e-9)
    np.testing.assert_allclose(found.radii, np.linalg.norm(LEG, axis=1), atol=1e-9)


def test_size_zero_is_gdke(rng, on_cap):
    """With size 0 nothing is taken off, which is the algebraic fit of one marker."""
    points, _ = on_cap(rng, 200, 50.0, noise=0.05)
    found = fit_center([LocalMarker(points.T.copy(), np.ones(200, bool), 1.0)], still(200), size=0.0)
    np.testing.assert_allclose(found.center, study.fit(points, "gdke").center, atol=1e-10)


def test_unbiased_in_noisy_axes_where_mgdk_is_not(leg):
    """Over 80 recordings the mean error is within 4.5 standard errors of 0, covariances are right, 95 % sets cover.

    False alarms: 3 means 2·10⁻⁵; χ²(3) of 80 means, within 4 standard errors, 6·10⁻⁵; binomial(80, .95) below 69 or
    above 80, 2·10⁻³ one-sided below. `mgdk`, which takes the noise for isotropic, is biased by 10 standard errors.
    """
    errors, plain, squares, level = [], [], [], 0
    for _ in range(80):
        markers, pose = leg(800, 0.005, (35, 15, 15))
        found = fit_center(markers, pose)
        error = found.center - CENTER
        errors.append(error)
        plain.append(study.mgdk([m.y.T for m in markers]).center - CENTER)
        squares.append(error @ np.linalg.solve(found.covariance, error))
        level += squares[-1] < stats.chi2.ppf(0.95, 3)
        assert found.size == pytest.approx(1.0, abs=0.25)
        assert found.effective_frames > 400
    errors, plain = np.array(errors), np.array(plain)

    def pull(sample):
        return np.abs(sample.mean(axis=0) / (sample.std(axis=0, ddof=1) / np.sqrt(len(sample)))).max()

    assert pull(errors) < 4.5
    assert pull(plain) > 10
    assert abs(np.mean(squares) - 3.0) < 4 * np.sqrt(6.0 / 80) + 0.3  # 0.3: the covariances are estimates, too
    assert level >= 69


def test_hinge(leg):
    """About one axis the centre is right to 3 mm across it, the axis to 2°, and the error along it is 0."""
    markers, pose = leg(1000, 0.002, (60, 0, 0))
    found = fit_center(markers, pose)
    assert found.axis is not None
    assert np.degrees(np.arccos(abs(found.axis[1]))) < 2.0
    across = found.center - CENTER
    assert np.hypot(across[0], across[2]) < 0.003
    assert found.covariance @ found.axis == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(found.radii, np.hypot(LEG[:, 0], LEG[:, 2]), atol=0.003)
    assert not found.clear


@pytest.mark.parametrize("hinge", [None, False])
def test_a_small_cap_is_no_hinge(leg, hinge):
    """A small cap has a short extent, too, but it curves: with little noise no direction is dropped."""
    markers, pose = leg(2000, 0.0005, (8, 8, 8))
    found = fit_center(markers, pose, hinge)
    assert found.axis is None
    assert np.linalg.norm(found.center - CENTER) < 0.02


def test_repeated_frames(leg):
    """Frames that are repeated forty times change neither the covariance nor the effective number of frames.

    It is found from a spectrum's lowest frequencies, some twenty, and to a third; a factor of 2.5 is three of these.
    """
    markers, pose = leg(200, 0.004, (35, 20, 20))
    once = fit_center(markers, pose)
    stretched = PoseNoise(np.repeat(pose.pattern, 40), pose.centroid, pose.shift, pose.tilt, pose.cross)
    again = [LocalMarker(np.repeat(m.y, 40, axis=1), np.repeat(m.used, 40), m.own) for m in markers]
    found = fit_center(again, stretched)
    np.testing.assert_allclose(found.center, once.center, atol=2e-4)
    assert once.effective_frames > 100
    assert 200 / 2.5 < found.effective_frames < 2.5 * 200
    assert found.frames == 8000
    assert 1 / 2.5 < np.trace(found.covariance) / np.trace(once.covariance) < 2.5


def test_too_few_or_in_a_line():
    """Too few samples, or samples on a line, give no centre and no warning."""
    y = np.zeros((3, 10))
    y[0] = np.arange(10)
    assert fit_center([LocalMarker(y, np.ones(10, bool), 1e-6)], still(10)) is None
    assert fit_center([LocalMarker(np.eye(3), np.ones(3, bool), 1e-6)], still(3)) is None
    assert fit_center([LocalMarker(np.full((3, 5), np.nan), np.zeros(5, bool), 1e-6)], still(5)) is None
