"""Stored points are put together again as they were drawn."""

import numpy as np
import pandas as pd
import pytest

from study.analysis.joint_markers import joint_markers, point_sets


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


def test_one_radius_is_no_joint(tables):
    """Noises with one marker alone are passed over."""
    errors, points, _ = tables([(0.1, 1.0), (0.2, 1.0), (0.2, 2.0)])
    assert [joint.sigma for joint in joint_markers(errors, points)] == [0.2]


def test_markers_with_fewer_trials_bound_the_others(tables):
    """All markers of a joint have as many trials as the one with the fewest."""
    errors, points, _ = tables([(0.1, 1.0), (0.1, 2.0)], trials=(4, 2))
    (joint,) = joint_markers(errors, points)
    assert [len(marker) for marker in joint.markers] == [2, 2]


def test_a_cell_without_points(tables):
    """A cell of which no points are stored has no sets."""
    _, points, _ = tables([(0.1, 1.0)])
    assert point_sets(points, "other").size == 0
