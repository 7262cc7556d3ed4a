"""Coordinates along rays: there and back, their volumes, and for which data they are asked for."""

import math

import numpy as np
import pytest

from study.posterior.multimodal import Rays
from study.sphere import likelihood


@pytest.fixture(params=[(2, True), (2, False), (3, True), (3, False)], ids=str)
def rays(request, on_cap):
    """Rays of a flat cap, about a sphere that is not its best one."""
    d, known = request.param
    rng = np.random.default_rng(3)
    points, _ = on_cap(rng, 20, angle=40.0, d=d, noise=0.2, center=0.3)
    size = d + 2 - known
    root = np.tril(rng.uniform(0.1, 0.3, (size, size))) + 0.2 * np.eye(size)
    return Rays(points.T.copy(), np.append(np.full(d, 0.2), [1.0, -1.5])[:size], root)


def test_there_and_back(rays):
    """Each is the other's inverse, with the same volume, near and far (to roundings times e⁶)."""
    walkers = np.random.default_rng(4).standard_normal((50, len(rays.origin))) * np.geomspace(0.1, 100.0, 50)[:, None]
    places, volume = rays.coordinates(walkers)
    back, same = rays.walkers(places)
    np.testing.assert_allclose(back, walkers, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(same, volume, atol=1e-9)


def test_volumes(rays):
    """They are the Jacobian's determinants, by central differences, up to one constant."""
    places = np.random.default_rng(5).standard_normal((20, len(rays.origin)))
    _, volume = rays.walkers(places)
    step = 1e-5 * np.eye(len(rays.origin))
    columns = [(rays.walkers(places + s)[0] - rays.walkers(places - s)[0]) / 2e-5 for s in step]
    excess = np.linalg.slogdet(np.stack(columns, axis=2))[1] - volume
    np.testing.assert_allclose(excess, excess[0], atol=1e-5)


def test_spread_out(rays):
    """Every second walker stays; of the others as many are on either side, as near as far, and keep their line."""
    walkers = np.random.default_rng(6).standard_normal((4000, len(rays.origin)))
    moved = rays.spread_out(walkers, 5.0, np.random.RandomState(1))
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
def test_when_they_are_needed(on_cap, d, angle, noise, wanted):
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

    assert Rays(points.T.copy(), origin, spread).needed(3.0, log_probability) is wanted
