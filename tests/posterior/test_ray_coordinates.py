"""Coordinates along rays: there and back, and their volumes."""

import numpy as np


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
