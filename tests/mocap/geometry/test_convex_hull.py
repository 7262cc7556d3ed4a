"""Distances of joints from the markers' hull: of a cube, of a body's true joints, and where there is no hull."""

import numpy as np
import pytest

from study.mocap.geometry.convex_hull import hull_distances
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


def still(points, frames=100):
    """Points (n, 3) that do not move."""
    return np.repeat(np.asarray(points, dtype=float)[:, :, None], frames, axis=2)


def test_distances_from_a_cube():
    """Shares and 95 % quantiles are right inside, outside a face, and outside in 10 frames of 100."""
    centers = still([[0.5, 0.5, 0.9], [0.5, 0.5, 1.03], [0.5, 0.5, 0.5]])
    centers[2, 0, :10] = 1.06
    inside, above, sometimes = hull_distances(still(CORNERS), centers)
    assert (inside.share_outside, inside.doubt) == (0.0, "")
    assert inside.distance == pytest.approx(-0.1)
    assert (above.share_outside, above.distance, above.doubt) == (1.0, pytest.approx(0.03), "")
    assert (sometimes.share_outside, sometimes.distance) == (0.1, pytest.approx(0.06))
    assert sometimes.doubt == "outside the markers' hull in 10% of the frames, by up to 60 mm"


def test_missing_markers():
    """Frames without a corner are left out, and so is a marker that is always missing; too few frames give NaN."""
    places, centers = still([*CORNERS, [0.5, 0.5, 9.0]]), still([[0.9, 0.9, 0.9]])
    places[8] = np.nan
    places[7, :, 50:] = np.nan  # the corner next to the joint
    assert hull_distances(places, centers)[0].distance == pytest.approx(-0.1)
    places[7, :, 10:] = np.nan
    assert np.isnan(hull_distances(places, centers)[0].share_outside)
    assert hull_distances(places, centers)[0].doubt == ""


@pytest.mark.parametrize("places", [still(CORNERS[:3]), still(CORNERS[:4]), still(np.empty((0, 3)))])
def test_no_hull(places):
    """Three markers, four in a plane, and none have no hull, so the distance is NaN."""
    assert np.isnan(hull_distances(places, still([[0.0, 0.0, 0.0]]))[0].distance)


def test_unknown_joint():
    """A joint that is never known has no distance."""
    assert np.isnan(hull_distances(still(CORNERS), np.full((1, 3, 100), np.nan))[0].distance)


@pytest.mark.parametrize("seed", range(4))
def test_true_joints_are_not_doubted(seed):
    """True joints of a synthetic body are not doubted, though knees with one marker are outside by 1-4 cm."""
    recording, truth = synthesize(Recipe(1500, noise=0.002, seed=seed))
    found = dict(zip(truth.joints, hull_distances(recording.positions, truth.centers), strict=True))
    assert not any(each.doubt for each in found.values())
    assert 0.01 < found["left_knee"].distance < 0.045
    assert found["neck"].share_outside == 0.0
