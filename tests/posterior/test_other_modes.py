"""Modes apart from the best sphere: the data for which they are possible, and walkers that start there."""

import math

import numpy as np
import pytest

from study.posterior.other_modes import other_modes_possible, spread_out
from study.posterior.ray_coordinates import RayCoordinates
from study.sphere import likelihood


def test_spread_out(rays):
    """Every second walker stays; of the others as many are on either side, as near as far, and keep their line."""
    walkers = np.random.default_rng(6).standard_normal((4000, len(rays.origin)))
    moved = spread_out(rays, walkers, 5.0, np.random.RandomState(1))
    np.testing.assert_array_equal(moved[::2], walkers[::2])
    d = len(rays.points)
    before, after = (rays.coordinates(w[1::2])[0] for w in (walkers, moved))
    lengths = (before[:, :d] * after[:, :d]).sum(axis=1) / np.linalg.norm(before[:, :d], axis=1)
    np.testing.assert_allclose(np.abs(lengths), np.linalg.norm(after[:, :d], axis=1), rtol=1e-6)
    far = math.log1p(5.0 / (0.5 * rays.extent))
    # uniform on ±far: 5 standard errors of the mean and of the mean length, false in 1 of 10⁶
    assert abs(lengths.mean()) < 5.0 * far / math.sqrt(3.0 * 2000)
    assert abs(np.abs(lengths).mean() - 0.5 * far) < 5.0 * far / math.sqrt(12.0 * 2000)


@pytest.mark.parametrize(
    ("angle", "noise", "wanted"),
    [(180.0, 0.02, False), (90.0, 0.02, False), (60.0, 0.02, False), (90.0, 1e-9, False), (20.0, 0.1, True)],
)
@pytest.mark.parametrize("d", [2, 3])
def test_where_they_are_possible(on_cap, d, angle, noise, wanted):
    """On a cap whose noise is above its height, not where one sphere explains the points (fixed seed)."""
    points, directions = on_cap(np.random.default_rng(7), 40, angle=angle, d=d, noise=noise)
    rows = np.column_stack([directions, np.ones(40)])
    spread = np.linalg.cholesky(np.linalg.inv(rows.T @ rows)) * noise
    origin = np.append(np.zeros(d), 1.0)
    reference = likelihood.Reference.of(points.T, origin[:d], 1.0)

    def log_probability(scaled):
        offsets = scaled @ spread.T
        value = likelihood.geometric(reference, offsets, np.full(len(offsets), math.log(noise)))
        return np.where((np.abs(offsets[:, :d]) < 3.0).all(axis=1), value, -np.inf)

    rays = RayCoordinates(points.T.copy(), origin, spread)
    assert other_modes_possible(rays, 3.0, log_probability) is wanted
