"""Tests of pose noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from study.recordings.joints.poses import PoseNoise, autocorrelation_time, long_run_covariance, rigid_residual_operator
from study.recordings.rigid import fit_rigid_motion, skew, to_local


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_autocorrelation_time_of_an_autoregression(rng, phi):
    """For x' = φx + ε it is (1 + φ)/(1 - φ), to 10 % with 2·10⁵ frames (its error τ√(2·5τ/n) is 3 % at worst)."""
    series = lfilter([1.0], [1.0, -phi], rng.standard_normal((3, 200_000)), axis=1)
    np.testing.assert_allclose(autocorrelation_time(series), (1 + phi) / (1 - phi), rtol=0.1)


def test_short_and_empty_series():
    """Series of one frame, or of zeros, have an autocorrelation time of 1."""
    np.testing.assert_array_equal(autocorrelation_time(np.ones((2, 1))), 1.0)
    np.testing.assert_array_equal(autocorrelation_time(np.zeros((2, 50))), 1.0)


def test_covariance_of_a_sum_over_correlated_frames(rng):
    """It is the covariance over many independent pairs of correlated series, of unequal size and memory.

    300 sums fix a variance to 8 %, the estimate has about 10 %; 50 % is four of both together: 1 in 10⁴.
    """
    mix = np.array([[1.0, 0.0], [30.0, 40.0]])

    def draw(count):
        noise = rng.standard_normal((count, 2, 4000))
        series = np.stack([lfilter([1.0], [1.0, -0.9], noise[:, 0], axis=1), noise[:, 1]], axis=1)
        return np.einsum("ij,njt->nit", mix, series)

    sums = draw(300).sum(axis=2)
    wanted = np.cov(sums.T)
    one = draw(1)[0]
    found, independent = long_run_covariance(one - one.mean(axis=1)[:, None])
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    assert np.abs((found - wanted) / scale).max() < 0.5
    np.testing.assert_allclose(independent, (one - one.mean(axis=1)[:, None]) @ one.T, rtol=1e-10)
    assert found[0, 0] > 10 * independent[0, 0]


TRIANGLE = np.array([[0.12, 0.0, 0.02], [-0.1, 0.03, 0.0], [-0.02, -0.03, -0.02]])

SHAPE = np.array([[0.1, 0.12, 0.02], [0.1, -0.11, 0.0], [-0.12, 0.06, 0.01], [-0.1, -0.05, 0.06]])

POINTS = np.array([[0.3, 0.1, -0.2], [0.0, 0.05, 0.4]])


@pytest.fixture
def pose_noise():
    """Make the pose noise of a template whose points are all used in all frames."""

    def make(template, noise, frames=1):
        return PoseNoise.of(template, noise, np.ones((len(template), frames), bool), np.ones(frames, bool))

    return make


@pytest.mark.parametrize(("template", "shows"), [(SHAPE - SHAPE.mean(axis=0), 0), (TRIANGLE, 10)])
def test_noise_of_a_point_in_noisy_axes(rng, pose_noise, template, shows):
    """Fixed points scatter by (*) and move in by B, in the axes of Kabsch's fits to 40,000 noisy copies of a template.

    One point of the template has another noise than the rest, not isotropic. Variances of 40,000 have an error of 0.7 %
    and second order adds (σ/extent)² = 1 % here: 5 % of the trace is beyond 5 errors of both. The means are compared to
    within 4.5 standard errors of each component: 12 of them fail by chance in 1 of 12,000. In the axes of the
    thin triangle points are displaced by more than 10 standard errors.
    """
    sigma, frames = 0.003, 40_000
    noise = np.repeat(sigma**2 * np.eye(3)[None], len(template), axis=0)
    noise[0] = np.diag([4.0, 1.0, 0.25]) * sigma**2
    epsilon = np.einsum("mij,mjt->mit", np.linalg.cholesky(noise), rng.standard_normal((len(template), 3, frames)))
    rotation, origin, known = fit_rigid_motion(template, template[:, :, None] + epsilon)
    assert known.all()
    found = pose_noise(template, noise)
    for point in POINTS:
        y = to_local(rotation, origin, np.repeat(point[:, None], frames, axis=1))
        wanted = found.covariance_at(point)
        assert np.abs(np.cov(y) - wanted).max() < 0.05 * np.trace(wanted)
        away = point - found.centroid[0]
        drawn = found.centroid[0] + (2 * np.eye(3) - found.expansion()[0]) @ away + found.mean_shift()[0]
        assert np.abs((y.mean(axis=1) - drawn) / (y.std(axis=1) / np.sqrt(frames))).max() < 4.5
        assert np.abs((y.mean(axis=1) - point) / (y.std(axis=1) / np.sqrt(frames))).max() > shows


def test_patterns(pose_noise):
    """Frames with the same points share a pattern, whose noise is that of its points alone."""
    used = np.ones((4, 6), dtype=bool)
    used[0, 2:4] = False
    known = np.array([True, True, True, True, True, False])
    noise = np.repeat(1e-6 * np.eye(3)[None], 4, axis=0)
    found = PoseNoise.of(SHAPE, noise, used, known)
    assert found.pattern[5] == -1
    assert len(set(found.pattern[[0, 1, 4]])) == len(set(found.pattern[[2, 3]])) == 1
    part = pose_noise(SHAPE[1:], noise[1:])
    np.testing.assert_allclose(found.tilt[found.pattern[2]], part.tilt[0], rtol=1e-12)
    np.testing.assert_allclose(found.centroid[found.pattern[2]], SHAPE[1:].mean(axis=0), rtol=1e-12)
    mean = (3 * pose_noise(SHAPE, noise).covariance_at(POINTS[0]) + 2 * part.covariance_at(POINTS[0])) / 5
    np.testing.assert_allclose(found.covariance_at(POINTS[0]), mean, rtol=1e-10)
    assert found.worst_angle == pytest.approx(np.sqrt(np.linalg.eigvalsh(part.tilt[0])[-1]))
    assert found.patterns_beyond(found.worst_angle * 0.99).sum() == 1
    assert (found.removed.covariance_at(POINTS[0]) == 0.0).all()


def test_cross_products_as_matrices(rng):
    """The matrix [v] gives [v] w = v × w."""
    v, w = rng.standard_normal((2, 5, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", skew(v), w), np.cross(v, w), atol=1e-15)


def test_rigid_residual_operator(rng):
    """It is a projection of rank 3m - 6 that removes rigid motion."""
    left = rigid_residual_operator(SHAPE)
    np.testing.assert_allclose(left @ left, left, atol=1e-12)
    assert np.trace(left) == pytest.approx(6.0)
    turn, shift = rng.standard_normal((2, 3))
    np.testing.assert_allclose(left @ (np.cross(turn, SHAPE) + shift).ravel(), 0.0, atol=1e-12)
