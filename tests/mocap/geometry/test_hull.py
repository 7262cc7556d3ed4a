"""Joints against the markers' hull: distances of a cube's, a body's true joints, and what cannot be said."""

import numpy as np
import pytest

from study.mocap.geometry.hull import outside
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


def still(points, frames=100):
    """Points (n, 3) that stay where they are."""
    return np.repeat(np.asarray(points, dtype=float)[:, :, None], frames, axis=2)


def test_distances_from_a_cube():
    """Inside, outside a face, and outside for 10 frames of 100: shares, and what 95 % do not exceed."""
    centers = still([[0.5, 0.5, 0.9], [0.5, 0.5, 1.03], [0.5, 0.5, 0.5]])
    centers[2, 0, :10] = 1.06
    inside, above, sometimes = outside(still(CORNERS), centers)
    assert (inside.share, inside.words) == (0.0, "")
    assert inside.far == pytest.approx(-0.1)
    assert (above.share, above.far, above.words) == (1.0, pytest.approx(0.03), "")
    assert (sometimes.share, sometimes.far) == (0.1, pytest.approx(0.06))
    assert sometimes.words == "outside the markers' hull in 10% of the frames, by up to 60 mm"


def test_missing_markers():
    """Frames without a corner are not looked at, a marker never seen is left out; too few frames say nothing."""
    places, centers = still([*CORNERS, [0.5, 0.5, 9.0]]), still([[0.9, 0.9, 0.9]])
    places[8] = np.nan
    places[7, :, 50:] = np.nan  # the corner next to the joint
    assert outside(places, centers)[0].far == pytest.approx(-0.1)
    places[7, :, 10:] = np.nan
    assert np.isnan(outside(places, centers)[0].share)
    assert outside(places, centers)[0].words == ""


@pytest.mark.parametrize("places", [still(CORNERS[:3]), still(CORNERS[:4]), still(np.empty((0, 3)))])
def test_no_hull(places):
    """Three markers, four in a plane, and none."""
    assert np.isnan(outside(places, still([[0.0, 0.0, 0.0]]))[0].far)


def test_a_joint_that_is_not_known():
    assert np.isnan(outside(still(CORNERS), np.full((1, 3, 100), np.nan))[0].far)


@pytest.mark.parametrize("seed", range(4))
def test_true_joints_are_not_doubted(seed):
    """Of a synthetic body: knees with one marker are outside by 1-4 cm, which no one can hold against them."""
    recording, truth = synthesize(Recipe(1500, noise=0.002, seed=seed))
    found = dict(zip(truth.joints, outside(recording.positions, truth.centers), strict=True))
    assert not any(each.words for each in found.values())
    assert 0.01 < found["left_knee"].far < 0.045
    assert found["neck"].share == 0.0
