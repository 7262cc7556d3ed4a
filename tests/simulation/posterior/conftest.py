"""Coordinates along rays, which several tests try."""

import numpy as np
import pytest

from study.simulation.posterior.sampler import RayCoordinates


@pytest.fixture(params=[(2, True), (2, False), (3, True), (3, False)], ids=str)
def rays(request, on_cap):
    """Rays of a flat cap, about a sphere that is not its best one."""
    d, known = request.param
    rng = np.random.default_rng(3)
    points, _ = on_cap(rng, 20, angle=40.0, d=d, noise=0.2, center=0.3)
    size = d + 2 - known
    root = np.tril(rng.uniform(0.1, 0.3, (size, size))) + 0.2 * np.eye(size)
    return RayCoordinates(points.T.copy(), np.append(np.full(d, 0.2), [1.0, -1.5])[:size], root)
