"""Joints of several markers: stored points are put together again as drawn, and fitted as the library does."""

import numpy as np
import pandas as pd
import pytest

from study.fits import Status, fit, mgdk
from study.simulation.claims.claim import joint_markers, point_sets
from study.simulation.claims.ugdk import fit_joints


@pytest.fixture
def tables():
    """Errors and points of cells (noise, radius), shuffled, with a centre that is not the origin."""

    def make(cells, samples=5, trials=(3, 3, 3, 3)):
        rng = np.random.default_rng(1)
        errors, points, truth = [], [], {}
        for k, ((noise, radius), count) in enumerate(zip(cells, trials, strict=False)):
            x = rng.standard_normal((count, samples, 2))
            truth[noise, radius] = x
            base = {"cell": f"c{k}", "trial": np.repeat(np.arange(count), samples)}
            base |= {"sample": np.tile(np.arange(samples), count), "radius": radius}
            axes = {"x_1": x[..., 0].ravel() + 2.0, "x_2": x[..., 1].ravel() - 1.0, "center_1": 2.0, "center_2": -1.0}
            points.append(pd.DataFrame(base | axes))
            conditions = {"noise": noise, "radius": radius, "samples": samples, "angle": 60.0, "center": 5**0.5}
            errors.append(pd.DataFrame({"cell": [f"c{k}"] * count} | conditions))
        shuffled = pd.concat(points).sample(frac=1.0, random_state=2)
        return pd.concat(errors).astype({"cell": "category"}), shuffled.astype({"cell": "category"}), truth

    return make


def test_joints(tables):
    """A joint per noise, ascending, its markers by ascending radius, points in the order of trial and sample."""
    errors, points, truth = tables([(0.2, 2.0), (0.1, 0.5), (0.2, 1.0), (0.1, 3.0)])
    found = list(joint_markers(errors, points))
    assert [joint.sigma for joint in found] == [0.1, 0.2]
    assert [list(joint.radii) for joint in found] == [[0.5, 3.0], [1.0, 2.0]]
    for joint in found:
        for radius, marker in zip(joint.radii, joint.markers, strict=True):
            np.testing.assert_allclose(marker, truth[joint.sigma, radius], atol=1e-14)


def test_markers_with_fewer_trials_bound_the_others(tables):
    """All markers of a joint have as many trials as the one with the fewest."""
    errors, points, _ = tables([(0.1, 1.0), (0.1, 2.0)], trials=(4, 2))
    (joint,) = joint_markers(errors, points)
    assert [len(marker) for marker in joint.markers] == [2, 2]


def test_a_cell_without_points(tables):
    """A cell of which no points are stored has no sets."""
    _, points, _ = tables([(0.1, 1.0)])
    assert point_sets(points, "other").size == 0


@pytest.mark.parametrize("noise", [0.01, 0.1, 0.6])
@pytest.mark.parametrize("weighted", [False, True])
def test_fits_are_those_of_the_library(on_cap, noise, weighted):
    """Centres, radii and statuses of `study.mgdk` but for the agreement, in noise that hides two of three, too."""
    rng = np.random.default_rng(4)
    markers = [on_cap(rng, n, 60.0, 3, noise, radius, sets=20)[0] for n, radius in ((40, 0.1), (60, 0.5), (50, 2.0))]
    center, squares, definite = fit_joints(markers, noise, weighted)
    each = [mgdk(sets, noise=noise, weighted=weighted) for sets in zip(*markers, strict=True)]
    np.testing.assert_allclose(center, [f.center for f in each], rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(definite, [f.status in (Status.OK, Status.MISFIT) for f in each])
    radii = np.sqrt(np.where(squares >= 0.0, squares, np.nan))
    np.testing.assert_allclose(radii.T, [f.radii for f in each], rtol=1e-7)


@pytest.mark.parametrize("noise", [0.05, 0.4])
def test_one_marker_is_fitted_by_ugdk(on_cap, noise):
    """Eq. 22 of one marker is eqs 15 to 21, and errors are those of UGDK, whatever it says of them."""
    points, _ = on_cap(np.random.default_rng(5), 50, 50.0, 3, noise, 1.0, sets=40)
    (center, _, definite), expected = fit_joints([points], noise), fit(points, "ugdk", noise=noise)
    np.testing.assert_allclose(center, expected.center, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(definite, expected.own_status == Status.OK)
