"""Generators side by side, and the normal numbers made of their words: both are NumPy's own, bit for bit."""

import numpy as np
import pytest
from numba import njit

from study.sphere.random.sfc64 import LANES, WORDS, fill_words, put_back, seeded, spare, to_uniform
from study.sphere.random.ziggurat import to_normals


def numpys(begin):
    """NumPy's SFC64 in the state that a column holds."""
    generator = np.random.SFC64(0)
    state = {"state": begin.copy()}
    generator.state = {"bit_generator": "SFC64", "state": state, "has_uint32": 0, "uinteger": 0}
    return generator


class Words(np.random.bit_generator.ISeedSequence):
    """Seed sequence that gives NumPy's SFC64 these words."""

    def __init__(self, words):
        self.words = words

    def generate_state(self, n_words, dtype=np.uint32):
        """The words."""
        assert n_words == len(self.words)
        assert dtype == np.uint64
        return np.ascontiguousarray(self.words)


@pytest.fixture
def words(rng):
    """Random words that seed a state."""
    return rng.integers(0, 2**64, WORDS, dtype=np.uint64)


def test_each_lane_is_seeded_as_numpy_seeds_its_own(words):
    """A lane has the state of NumPy's SFC64 that is seeded with the same three words."""
    state = seeded(words)
    for lane in range(LANES + 1):
        own = np.random.SFC64(Words(words.reshape(3, LANES + 1)[:, lane])).state["state"]["state"]
        np.testing.assert_array_equal(state[:, lane], own)


def test_words_are_those_of_numpys_generators_in_turn(words):
    """Word k is the next word of lane k modulo their number; the spare's state does not change."""
    state = seeded(words)
    before = state.copy()
    found = np.empty(7 * LANES, dtype=np.uint64)
    fill_words(state, found)
    expected = np.stack([numpys(before[:, lane]).random_raw(7) for lane in range(LANES)], axis=1)
    np.testing.assert_array_equal(found, expected.ravel())
    np.testing.assert_array_equal(state[:, LANES], before[:, LANES])


def test_uniform_numbers_are_the_upper_bits(words):
    """The upper 52 bits over 2⁵²: from 0 to below 1."""
    ends = np.concatenate([np.array([0, 2**64 - 1], dtype=np.uint64), words])
    found = np.empty(len(ends))
    to_uniform(ends, found)
    np.testing.assert_array_equal(found, (ends >> np.uint64(12)).astype(float) / 2**52)
    assert found[1] < 1.0


@njit
def one_by_one(state, row):
    """Normal numbers of which all words come from the spare generator, as NumPy's come from one."""
    word, outside = np.empty(1, np.uint64), np.empty(1, np.int64)
    lane = spare(state)
    for k in range(row.size):
        a, b, c, count = lane
        word[0] = a + b + count
        mixed = ((c << np.uint64(24)) | (c >> np.uint64(40))) + word[0]
        lane = b ^ (b >> np.uint64(11)), c + (c << np.uint64(3)), mixed, count + np.uint64(1)
        lane = to_normals(word, row[k : k + 1], lane, outside)
    put_back(state, lane)


@njit
def side_by_side(state, words, row):
    """Normal numbers of words that are given, and of the spare generator."""
    put_back(state, to_normals(words, row, spare(state), np.empty(row.size, np.int64)))


def test_numbers_do_not_depend_on_how_many_are_made_at_once(words):
    """A row at a time and a number at a time, bit for bit: those outside their rectangles are settled in order."""
    given = np.random.default_rng(3).integers(0, 2**64, 50_000, dtype=np.uint64)
    whole, single = np.empty((2, len(given)))
    state, other = seeded(words), seeded(words)
    side_by_side(state, given, whole)
    for k in range(len(given)):
        side_by_side(other, given[k : k + 1], single[k : k + 1])
    np.testing.assert_array_equal(whole, single)
    np.testing.assert_array_equal(state, other)


def test_normals_are_numpys(words):
    """`standard_normal`, bit for bit, and its generator's state afterwards.

    Of 120 000 numbers some 30 are from beyond the lowest layer, the rarest branch.
    """
    state, found = seeded(words), np.empty(120_000)
    own = np.random.Generator(numpys(state[:, LANES]))
    one_by_one(state, found)
    np.testing.assert_array_equal(found, own.standard_normal(120_000))
    np.testing.assert_array_equal(state[:, LANES], own.bit_generator.state["state"]["state"])
