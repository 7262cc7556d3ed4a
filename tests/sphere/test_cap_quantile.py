"""Heights in four dimensions and more against mpmath: relative accuracy at any angle and any share of the area."""

import math

import mpmath
import numpy as np
import pytest

from study.experiment.streams import lanes
from study.sphere.cap import draw, heights

EPS = np.finfo(float).eps
ANGLES = [1e-6, 1e-3, 0.7, math.pi / 2, 1.8, 2.6, 3.0, 3.13, math.pi - 1e-6, math.pi]
SMALL = 10.0 ** -np.arange(1.0, 13.0)
SHARES = np.concatenate([SMALL, [0.3, 0.5, 0.77], 1.0 - SMALL, [1.0 - EPS / 2, 1.0]])


def area(height, d):
    """The area of a cap of a height 0 ≤ t ≤ 2, up to a factor: the incomplete beta function of t/2."""
    a = mpmath.mpf(d - 1) / 2
    return mpmath.betainc(a, a, 0, min(height / 2, mpmath.mpf(1)))


@pytest.mark.parametrize("d", [4, 5, 6, 7, 8, 9, 10, 20, 50])
def test_relative_accuracy(d):
    """A height is right to 1e-14: the area below one that is less by that is too small, below one more too large.

    Near the edge of a cap beyond 3 rad a sum in the wrong order would spoil it by up to 1e-7.
    """
    for angle in ANGLES:
        found = heights(SHARES.copy(), angle, d)
        with mpmath.workdps(60):
            whole = area(2 * mpmath.sin(mpmath.mpf(angle) / 2) ** 2, d)
            for t, share in zip(found.tolist(), SHARES.tolist(), strict=True):
                below, above = (area(mpmath.mpf(t) * (1 + side * mpmath.mpf("1e-14")), d) for side in (-1, 1))
                assert below <= share * whole <= above, (angle, share)


@pytest.mark.parametrize("d", [4, 11])
def test_smallest_shares(d):
    """A share of zero has height zero, and the smallest shares follow t ∝ w^(2/(d-1))."""
    t = heights(np.array([0.0, 1e-300, 1e-290]), 2.0, d)
    assert t[0] == 0.0
    np.testing.assert_allclose(t[2] / t[1], 10.0 ** (20 / (d - 1)), rtol=16 * EPS)


def test_in_place_in_any_layout(rng):
    """Strided numbers become the same heights as contiguous ones."""
    uniform = rng.random((3, 4, 700))
    flat, strided = uniform[:, 1].flatten(), uniform[:, 1]
    assert heights(strided, 2.0, 4) is strided
    np.testing.assert_allclose(uniform[:, 1].ravel(), heights(flat, 2.0, 4), rtol=4 * EPS)


@pytest.mark.parametrize("d", [4, 7])
@pytest.mark.parametrize("angle", [1e-6, 1.0, 3.0])
def test_draws_have_the_heights_of_their_uniform_numbers(angle, d):
    """In three dimensions, on the whole sphere, the first row of a draw is twice its uniform numbers."""
    (plain, z), (directions, y) = np.empty((2, 1, 3, 200)), np.empty((2, 1, d, 200))
    draw(lanes(1, "heights"), math.pi, plain, z)
    draw(lanes(1, "heights"), angle, directions, y)
    np.testing.assert_allclose(directions[0, 0], heights(plain[0, 0] / 2, angle, d), rtol=8 * EPS)
