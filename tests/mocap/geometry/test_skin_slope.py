import numpy as np
import pytest

from study.mocap.geometry.pose_noise import rigid_residual_operator
from study.mocap.geometry.skin_slope import skin_slope

POINTS = np.array([[0.1, 0, 0], [-0.1, 0.02, 0], [0, 0.12, 0.03], [0.02, -0.03, 0.1]])


def drawn(beta, noise, rng, frames=600):
    """Departures that a rigid fit leaves of skin of slope β and of noise, and the joint's angles."""
    t = np.arange(frames) / frames * 2 * np.pi
    angles = 0.3 * np.stack([np.sin(3 * t), np.sin(5 * t + 1), np.sin(7 * t + 2)])
    moved = beta * np.einsum("mij,jt->mit", rng.standard_normal((4, 3, 3)), angles)
    moved += noise * rng.standard_normal(moved.shape)
    left = rigid_residual_operator(POINTS) @ moved.reshape(12, -1)
    return left.reshape(moved.shape), angles


def test_slope_is_right_on_average():
    """Over 60 bodies the mean square slope is that which was drawn; each is from 6 x 3 normal numbers.

    Its relative standard error is √(2/18/60) = .043; the quadratics take up none of it. Four of these are allowed.
    """
    rng = np.random.default_rng(1)
    found = [skin_slope(*drawn(0.01, 0.001, rng)) for _ in range(60)]
    assert np.mean(found) == pytest.approx(1e-4, rel=4 * 0.043)


def test_noise_alone_has_no_slope():
    """What noise of 2 mm explains by chance, a slope of .7 mm/rad, is taken off: less than half is left."""
    rng = np.random.default_rng(2)
    found = [skin_slope(*drawn(0.0, 0.002, rng)) for _ in range(40)]
    by_chance = 9 * 0.002**2 / 600 / (3 * 0.3**2 / 2)
    assert np.mean(found) < 0.5 * by_chance


def test_too_little_to_measure():
    """Two markers, or frames that are too few, show no slope."""
    departures, angles = drawn(0.01, 0.001, np.random.default_rng(3))
    assert np.isnan(skin_slope(departures[:2], angles))
    assert np.isnan(skin_slope(departures[:, :, :50], angles[:, :50]))
    departures[0, :, 60:] = np.nan
    assert skin_slope(departures, angles) > 0.0
    departures[0, :, 30:] = np.nan
    assert np.isnan(skin_slope(departures, angles))
