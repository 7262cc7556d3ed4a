"""Points that kernels form when they read them: the same points, and the same sums to the bit, as stored ones."""

from fractions import Fraction

import numpy as np
import pytest

from study.estimators import ESTIMATORS, Estimates, Samples
from study.sphere.layouts import BLOCK, Placed, abreast, extent, form
from study.sphere.moments import Moments


@pytest.fixture
def place(rng, on_cap):
    """Draws of two trials on three spheres, in d dimensions with n samples."""

    def make(d, n):
        directions = np.ascontiguousarray(on_cap(rng, n, 70.0, sets=2, d=d)[0].swapaxes(1, 2))
        directions[:, 0] = 1.0 - directions[:, 0]
        center = rng.uniform(-3, 3, (3, d))
        return Placed(
            directions, rng.standard_normal((2, d, n)), center, np.array([1.0, 2.0, 7.0]), np.array([0.01, 0.5, 3.0])
        )

    return make


def test_points_are_those_of_their_sphere_and_trial(place):
    """Each coordinate is c + r u + σ z of exact arithmetic, to three roundings; sets come trial by trial."""
    placed = place(3, 20)
    points = form(placed, np.empty((6, 3, 20)))
    assert extent(placed) == points.shape
    assert abreast(placed) == 3
    for t in range(6):
        trial, sphere = divmod(t, 3)
        for i in range(3):
            for k in range(20):
                u, z = (Fraction(float(a[trial, i, k])) for a in (placed.directions, placed.noise))
                c, r, s = (
                    Fraction(float(v)) for v in (placed.center[sphere, i], placed.radius[sphere], placed.sigma[sphere])
                )
                terms = (c, r * ((1 - u) if i == 0 else u), s * z)
                assert abs(Fraction(float(points[t, i, k])) - sum(terms)) <= 3 * 2.0**-53 * float(sum(map(abs, terms)))
    np.testing.assert_array_equal(form(placed, np.empty((2, 3, 20)), first=3), points[3:5])


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("n", [6, 31, 33, 700, BLOCK, 2 * BLOCK + 300])
def test_sums_do_not_depend_on_where_points_are(place, d, n):
    """Moments and fits of formed points are, bit for bit, those of stored points, in any layout."""
    placed = place(d, n)
    points = form(placed, np.empty((6, d, n)))
    noise = np.tile(placed.sigma, 2)
    for other in (points, np.ascontiguousarray(points.swapaxes(1, 2)).swapaxes(1, 2), np.asfortranarray(points)):
        stored, formed = Moments.of(other), Moments.of(placed)
        for one, two in zip(formed, stored, strict=True):
            np.testing.assert_array_equal(one, two)
        for estimator in ("mle", "mle_mirror", "lls", "ugdk"):
            fits = [ESTIMATORS[estimator](Samples(x, noise)) for x in (placed, other)]
            for name, one, two in zip(Estimates._fields, *fits, strict=True):
                np.testing.assert_array_equal(one, two, err_msg=name)


def test_one_set_of_formed_points(place):
    """One set of a batch has its own points and noise; the points of a batch are formed when they are needed."""
    placed = place(3, 40)
    batch = Samples(placed, np.tile(placed.sigma, 2))
    points = form(placed, np.empty((6, 3, 40)))
    np.testing.assert_array_equal(batch.x, points)
    for t in range(6):
        one = batch.only(t)
        np.testing.assert_array_equal(one.x, points[t : t + 1])
        assert one.noise == placed.sigma[t % 3]
