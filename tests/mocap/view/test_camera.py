"""Looking at a scene: axes of the view, outlines of ellipsoids, how long half axes are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from study.mocap.view.camera import Camera, outlines
from study.mocap.view.ellipsoids import exaggeration, half_axes, hinges, surface


@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 0), (30, 10), (200, -40), (-75, 89)])
def test_axes(azimuth, elevation):
    """The axes of the view are a rotation; the first is horizontal, the third points to the viewer."""
    axes = Camera(azimuth, elevation).axes
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[0, 2] == 0.0
    a, e = np.radians([azimuth, elevation])
    assert np.allclose(axes[2], [np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


@pytest.mark.parametrize("half", [(0.03, 0.02, 0.01), (0.03, 0.02, 0.0), (0.02, 0.02, 0.02), (0.0, 0.0, 0.0)])
def test_outlines(half):
    """An outline is as wide as the projected surface of the ellipsoid, in each direction."""
    camera, turn = Camera(40, 25), Rotation.random(rng=3).as_matrix()
    points = np.random.default_rng(1).normal(size=(20000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    seen = camera.project((points * half) @ turn.T)[:, :2]
    outline = outlines(np.array([half]), turn[None], camera, corners=400)[0]
    directions = np.array([[np.cos(t), np.sin(t)] for t in np.linspace(0, np.pi, 30)])
    widths = (seen @ directions.T).max(axis=0)
    assert np.allclose((outline @ directions.T).max(axis=0), widths, atol=2e-3 * max(half) + 1e-12)


def test_half_axes_hold_as_often_as_they_say():
    """A normal error lies within the ellipsoid 95 % of the time, in three directions and in two."""
    draws = np.random.default_rng(2).normal(size=(40000, 3))
    for known in (1, 2, 3):
        inside = ((draws[:, :known] / surface(known)) ** 2).sum(axis=1) < 1.0
        assert inside.mean() == pytest.approx(0.95, abs=0.005)  # four standard errors
    assert surface(3) == pytest.approx(np.sqrt(chi2.ppf(0.95, 3)))
    assert surface(0) == 0.0


def test_half_axes_of_a_scene(scene):
    """A hinge's ellipsoid is a disc, wider than its errors by the factor for two directions."""
    half, flat = half_axes(scene), hinges(scene)
    assert [scene.joints[i] for i in np.flatnonzero(flat)] == ["left_elbow", "left_knee", "right_elbow", "right_knee"]
    assert (half[flat, 2] == 0.0).all()
    assert np.allclose(half[flat, :2], surface(2) * scene.errors[flat, :2])
    assert np.allclose(half[~flat], surface(3) * scene.errors[~flat])


@pytest.mark.parametrize(("scale", "factor"), [(1.0, 5), (0.001, 100), (100.0, 1)])
def test_exaggeration(scene, scale, factor):
    """Ellipsoids are enlarged until the median one is visible, and never reduced."""
    assert exaggeration(replace(scene, errors=scale * scene.errors)) == factor
    long = scene.errors.copy()
    long[0] *= 0.06 / np.nanmax(long[0])  # one joint known to 6 cm, 17 cm with 95 %: no more than twice as large
    assert exaggeration(replace(scene, errors=long)) <= 2
    assert exaggeration(replace(scene, errors=np.full_like(scene.errors, np.nan))) == 1
