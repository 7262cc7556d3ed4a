"""Least squares with small singular values cut: the flaw is there to be seen, where it should be and nowhere else."""

import numpy as np
import pytest

import study

CENTERS = [0.0, 1.0, 5.0]


@pytest.mark.parametrize("x", CENTERS)
@pytest.mark.parametrize("angle", [0.05, 0.01])
def test_centred_cut_puts_the_answer_on_the_sphere(rng, on_cap, angle, x):
    """On a tiny cap the centred design loses the axis: the centre is the centroid, one radius off (theory §4, 5)."""
    points = on_cap(rng, 40, angle, center=[x, 0.0, 0.0])[0]
    fit = study.fit(points, "lls_nr")
    np.testing.assert_allclose(fit.center, points.mean(axis=0), rtol=0, atol=1e-3)
    assert np.linalg.norm(study.fit(points, "lls").center - [x, 0.0, 0.0]) < 1e-5


@pytest.mark.parametrize("x", CENTERS)
@pytest.mark.parametrize("angle", [0.05, 0.01])
def test_uncentred_cut_takes_the_least_norm(rng, on_cap, angle, x):
    """All points nearly at p: of all solutions of β·p + β₀ = |p|² the shortest has the centre β/2 = ½p|p|²/(|p|² + 1).

    Half way to the sphere (theory §4, 5) where |p| is large against the unit of length, and not otherwise.
    """
    p = x + 1.0
    fit = study.fit(on_cap(rng, 40, angle, center=[x, 0.0, 0.0])[0], "lls_nr_raw")
    np.testing.assert_allclose(fit.center, [0.5 * p**3 / (p**2 + 1), 0.0, 0.0], rtol=0, atol=1e-3)


@pytest.mark.parametrize("name", ["lls_nr", "lls_nr_raw"])
@pytest.mark.parametrize("noise", [1e-9, 0.05])
def test_sound_sets_are_not_cut(rng, on_cap, noise, name):
    """On caps of 60° and more nothing is cut and the answer is that of `lls`."""
    points = on_cap(rng, 30, 60.0, noise=noise, center=1.0, sets=50)[0]
    np.testing.assert_allclose(study.fit(points, name).center, study.fit(points, "lls").center, rtol=0, atol=1e-11)
