"""The compiled drawing loop: NumPy's own stream, trial after trial."""

import numpy as np
import pytest

from study.sphere.cap import draw, sample_cap
from study.sphere.normals import state_of

EPS = np.finfo(float).eps


def drawn(seed, height, d):
    """State afterwards, directions and normals of a block of trials with the given heights."""
    state = state_of(numpys(seed))
    b, n = height.shape
    directions, normals = np.full((2, b, d, n), np.nan)
    draw(state, height, directions, normals)
    return state, directions, normals


def numpys(seed):
    """NumPy's generator of the kind that the loop draws from."""
    return np.random.Generator(np.random.SFC64(seed))


@pytest.mark.parametrize("d", [2, 3, 5])
def test_stream_is_numpys(d):
    """The compiled loop yields the bits of Generator.standard_normal and leaves the generator in the same state.

    2d - 1 rows of 60 000 normals hold some 50 from the ziggurat's tail, its rarest branch.
    """
    height = np.full((2, 30_000), 0.25)
    state, directions, normals = drawn(11, height, d)
    own = numpys(11)
    for trial in range(2):
        across = own.standard_normal((d - 1, 30_000))
        np.testing.assert_array_equal(normals[trial], own.standard_normal((d, 30_000)))
        unit = across / np.linalg.norm(across, axis=0)
        np.testing.assert_allclose(directions[trial, 1:], np.sqrt(0.25 * 1.75) * unit, rtol=16 * EPS, atol=0)
    np.testing.assert_array_equal(state, state_of(own))


@pytest.mark.parametrize("d", [2, 3, 5])
def test_first_trials_do_not_depend_on_how_many_follow(rng, d):
    """A block of 3 trials is, bit for bit, the beginning of a block of 7."""
    height = rng.random((7, 13))
    _, u, z = drawn(3, height, d)
    _, v, w = drawn(3, height[:3], d)
    np.testing.assert_array_equal(v, u[:3])
    np.testing.assert_array_equal(w, z[:3])


def test_row_zero_holds_the_height(rng):
    """The first row is the height itself, untouched, so tiny angles lose nothing."""
    height = 1e-15 * rng.random((2, 9))
    _, u, _ = drawn(3, height, 3)
    np.testing.assert_array_equal(u[:, 0], height)
    np.testing.assert_allclose(np.sum(u[:, 1:] ** 2, axis=1), height * (2 - height), rtol=8 * EPS)


def test_poles(rng):
    """Heights 0 and 2, where the circle across the axis is a point, give no NaN."""
    _, u, _ = drawn(3, np.array([[0.0, 2.0]]), 3)
    np.testing.assert_array_equal(u[0, 1:], 0.0)


def test_same_seed_same_directions():
    """All randomness comes from the generator given."""
    one, two = (sample_cap(np.random.default_rng(4), 50, 0.3, 3, [1, 2, 3]) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_other_bits_are_refused():
    """Another bit generator is told apart by name, instead of its state being misread."""
    with pytest.raises(TypeError, match="PCG64: its bits must come from SFC64"):
        state_of(np.random.default_rng(1))
