import numpy as np
import pytest

from study.mocap.joints.marker_moments import scores, seen
from study.mocap.joints.pose_noise import CarriedNoise
from study.sphere.moments import Moments


def frame_noise(rng, frames, tilt=0.0, shift=0.0, cross=False):
    """A frame whose turns and shifts have these standard deviations, in two patterns."""
    a = rng.standard_normal((2, 3, 3))
    turn, move = tilt**2 * a @ a.swapaxes(1, 2) / 3, shift**2 * np.eye(3) * np.array([1.0, 2.0])[:, None, None]
    return CarriedNoise(rng.integers(0, 2, frames), 0.05 * rng.standard_normal((2, 3)), move, turn, np.zeros((2, 3, 3)))


def test_without_frame_noise_they_are_plain_moments(rng):
    """Then they are those of `Moments`, divided by n, of the samples that count."""
    y = rng.standard_normal((3, 300)) + 5.0
    used = rng.random(300) < 0.7
    found = seen(y, used, frame_noise(rng, 300), 0.01, 1.0)
    plain = Moments.of(np.ascontiguousarray(y[:, used])[None])
    n = used.sum()
    assert found.count == n
    np.testing.assert_allclose(found.mean, plain.mean[0], rtol=1e-13)
    np.testing.assert_allclose(found.second, plain.second[0] / n, rtol=1e-12)
    np.testing.assert_allclose(found.third, plain.third[0] / n, rtol=1e-9, atol=1e-12)
    assert found.fourth == pytest.approx(plain.fourth[0] / n)
    np.testing.assert_allclose(found.noise, 0.01 * np.eye(3), atol=1e-17)
    np.testing.assert_allclose(found.pulled, 0.0, atol=1e-15)
    assert found.along == pytest.approx(0.01 * np.trace(plain.second[0]) / n)
    assert found.squared(np.ones(3)) == pytest.approx(3 * 0.01**2)


def test_the_noise_is_that_of_the_formula(rng):
    """Mean F, F z and zᵀFz sample by sample, from the matrices themselves."""
    frames = 50
    carried = frame_noise(rng, frames, tilt=0.1, shift=0.01)
    carried = CarriedNoise(
        carried.pattern, carried.centroid, carried.shift, carried.tilt, 1e-3 * rng.standard_normal((2, 3, 3))
    )
    y = rng.standard_normal((3, frames))
    found = seen(y, np.ones(frames, bool), carried, 0.02, 0.5)
    total, pulled, traced, along = np.zeros((3, 3)), np.zeros(3), np.zeros(3), 0.0
    points = found.z + found.mean[:, None]
    for t in range(frames):
        p = carried.pattern[t]
        expected = carried.centroid[p] + carried.grown(0.5)[p] @ (y[:, t] - carried.centroid[p]) - carried.drift(0.5)[p]
        np.testing.assert_allclose(points[:, t], expected, atol=1e-12)
        v = points[:, t] - carried.centroid[p]
        k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
        mixed = k @ carried.cross[p]
        f = 0.02 * np.eye(3) + carried.shift[p] + k @ carried.tilt[p] @ k.T - mixed - mixed.T
        z = found.z[:, t]
        total, pulled, traced, along = total + f, pulled + f @ z, traced + np.trace(f) * z, along + z @ f @ z
    np.testing.assert_allclose(found.noise, total / frames, rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(found.pulled, pulled / frames, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(found.traced, traced / frames, rtol=1e-9, atol=1e-14)
    assert found.along == pytest.approx(along / frames)


def test_scores_of_the_centre_are_its_equations(rng):
    """Their sum is b - A c, with the moments' own A and b: what the centre makes zero."""
    frames, size = 200, 0.8
    carried = frame_noise(rng, frames, tilt=0.05, shift=0.01)
    y = rng.standard_normal((3, frames))
    used = rng.random(frames) < 0.9
    found = seen(y, used, carried, 0.02, size)
    center = rng.standard_normal(3)
    into = np.zeros((4, frames))
    scores(found, used, carried, 0.02, size, center, np.eye(3), 2.0, into)
    offset = center - found.mean
    third = found.third - size * (2 * found.pulled + found.traced)
    wanted = 0.5 * third - (found.second - size * found.noise) @ offset
    np.testing.assert_allclose(into[:3].sum(axis=1), 2.0 * found.count * wanted, rtol=1e-9, atol=1e-9)
    assert (into[:, ~used] == 0.0).all()
    f = ((found.z[:, used] - offset[:, None]) ** 2).sum(axis=0)
    strain = found.along - 2 * offset @ found.pulled + offset @ found.noise @ offset
    wanted = f.var() - 4 * size * strain + 2 * size**2 * found.squared(center)
    assert into[3].sum() == pytest.approx(2.0 * found.count * wanted)
