"""The compiled drawing loop: directions on a cap and normal numbers, trial after trial.

Generators side by side, and the normal numbers made of their words: both are NumPy's own, bit for bit.

Named streams: a name is its numbers. That no generator comes from anywhere else, the linter finds.

Directions on a cap: within the angle, uniform by area, exact at tiny angles.

Heights in four dimensions and more against mpmath: relative accuracy at any angle and any share of the area.
"""

import math
from itertools import combinations

import mpmath
import numpy as np
import pytest
from numba import njit
from scipy import stats

from study.fits.loops.jit import CHUNK
from study.fits.loops.random import (
    LANES,
    WORDS,
    fill_words,
    lanes,
    put_back,
    seeded,
    spare,
    stream,
    to_normals,
    to_uniform,
)
from study.fits.points.cap import cap_moments, draw, heights, sample_cap

EPS = np.finfo(float).eps


def drawn(name, b, n, d, angle=1.0):
    """Directions and normals of a block of trials."""
    directions, normals = np.full((2, b, d, n), np.nan)
    draw(lanes(1, name), angle, directions, normals)
    return directions, normals


@pytest.mark.parametrize("d", [2, 3, 5])
def test_first_trials_do_not_depend_on_how_many_follow(d):
    """A block of 3 trials is, bit for bit, the beginning of a block of 7."""
    u, z = drawn("block", 7, 333, d)
    v, w = drawn("block", 3, 333, d)
    np.testing.assert_array_equal(v, u[:3])
    np.testing.assert_array_equal(w, z[:3])


@pytest.mark.parametrize("angle", [1e-7, 0.3, math.pi])
@pytest.mark.parametrize("d", [2, 3, 4, 5])
def test_height_and_distance_from_the_axis_belong_together(d, angle):
    """Row 0 is the height t, and the others have the length √(t(2 - t)), at tiny angles too."""
    u, _ = drawn("rows", 2, 300, d, angle)
    t = u[:, 0]
    assert 0 <= t.min() < t.max() <= 2 * math.sin(angle / 2) ** 2
    np.testing.assert_allclose(np.sum(u[:, 1:] ** 2, axis=1), t * (2 - t), rtol=16 * EPS, atol=0)


@pytest.mark.parametrize("d", [2, 3, 4, 5])
def test_directions_across_the_axis_are_uniform(d):
    """First and second moments of the unit vectors across; the angle itself, where it is one. False alarm 1e-4."""
    u, _ = drawn("across", 40, 500, d)
    w = (u[:, 1:] / np.linalg.norm(u[:, 1:], axis=1, keepdims=True)).swapaxes(0, 1).reshape(d - 1, -1)
    count = w.shape[1]
    assert np.abs(w.mean(axis=1)).max() < 5 / math.sqrt(count)
    assert np.abs(w @ w.T / count - np.eye(d - 1) / (d - 1)).max() < 5 / math.sqrt(count)
    if d == 3:
        assert stats.kstest(np.arctan2(w[1], w[0]), stats.uniform(-math.pi, 2 * math.pi).cdf).pvalue > 1e-5


@pytest.mark.parametrize("angle", [1e-7, 1.0, math.pi])
def test_directions_are_accurate_to_the_last_bits(angle):
    """In three dimensions: t = 2 sin²(φ/2) v, and √(t(2 - t)) times a sine and a cosine, of 40 digits.

    v and the angle come from the upper 52 bits of two words, and the quadrant's half and the signs from the lowest
    three. 257 samples, so that the last one is in a chunk of its own.
    """
    n = 257
    u, z = np.empty((2, 1, 3, n))
    draw(lanes(1, "digits"), angle, u, z)
    state, words = lanes(1, "digits"), np.empty((2, 5 * CHUNK), dtype=np.uint64)
    for row in words:
        fill_words(state, row)
    chunks = ((words[0, :CHUNK], words[0, CHUNK : 2 * CHUNK]), (words[1, :1], words[1, 1:2]))
    pairs = [pair for chunk in chunks for pair in zip(*(row.tolist() for row in chunk), strict=True)]
    for (first, second), found in zip(pairs, u[0].T, strict=True):
        with mpmath.workdps(40):
            t = 2 * mpmath.sin(mpmath.mpf(angle) / 2) ** 2 * mpmath.mpf(first >> 12) / 2**52
            turn = mpmath.pi / 4 * mpmath.mpf(second >> 12) / 2**52
            across, along = mpmath.sin(turn), mpmath.cos(turn)
            if not second & 1:
                across, along = along, across
            length = mpmath.sqrt(t * (2 - t))
            expected = t, across * length * (1 if second & 2 else -1), along * length * (1 if second & 4 else -1)
            for one, other in zip(found.tolist(), expected, strict=True):
                assert abs(one - other) <= 4 * EPS * abs(other)


def test_normals_are_normal_and_do_not_follow_one_another():
    """Their law (Kolmogorov-Smirnov at 1e-5), their tails, and pairs of them, rows and neighbours: false alarm 5e-5."""
    _, z = drawn("normal", 10, 30_000, 3)
    assert stats.kstest(z.ravel(), "norm").pvalue > 1e-5
    beyond = np.sum(np.abs(z) > 3.6541528853610088)  # the edge of the lowest layer, where another method begins
    expected = z.size * 2 * stats.norm.sf(3.6541528853610088)
    assert abs(beyond - expected) < 5 * math.sqrt(expected)
    pairs = [(z[:, 0], z[:, 1]), (z[:, 1], z[:, 2]), *((z[..., :-lag], z[..., lag:]) for lag in (1, 16, 32, 256))]
    for one, other in pairs:
        assert abs(np.mean(one * other)) < 5 / math.sqrt(one.size)
        assert abs(np.mean((one**2 - 1) * (other**2 - 1))) < 5 * 2 / math.sqrt(one.size)


def test_directions_and_normals_are_independent():
    """No normal number depends on a direction: rank correlations of all pairs of rows. False alarm 1e-5."""
    u, z = drawn("apart", 1, 50_000, 3)
    ranks = stats.spearmanr(np.vstack([u[0], z[0], np.abs(z[0])]), axis=1).statistic
    assert np.abs(ranks[:3, 3:]).max() < 5 / math.sqrt(50_000)


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


NAMES = [
    (1, "draw", 1),
    (2, "draw", 1),
    (1, "draw", 1.0),
    (1, "draw", "1"),
    (1, "draw", 1, 0),
    (1, 1, "draw"),
    (1, "draw1"),
    (1, "draw", np.nextafter(1.0, 2.0).item()),
    (1,),
    (2**64 + 1, "draw", 1),
]


@pytest.mark.parametrize("name", NAMES, ids=str)
def test_same_name_same_numbers(name):
    """A stream, or generators side by side, are made again, bit for bit, from their name."""
    np.testing.assert_array_equal(stream(*name).random(100), stream(*name).random(100))
    np.testing.assert_array_equal(lanes(*name), lanes(*name))


@pytest.mark.parametrize(("left", "right"), list(combinations(NAMES, 2)), ids=str)
def test_different_names_share_no_number(left, right):
    """Names that differ in a type, an order, the last bit or the seed give streams without a common number.

    Two of 2 × 1000 uniform numbers of 53 bits are equal in 1 of 10¹⁰ cases. So do generators side by side: no word of
    64 bits that one begins with is among the other's.
    """
    assert not set(stream(*left).random(1000)) & set(stream(*right).random(1000))
    assert not np.intersect1d(lanes(*left)[:3], lanes(*right)[:3]).size


def test_siblings_are_uncorrelated():
    """The first numbers of 10 000 siblings are uniform and do not follow the number in their names.

    Both statistics are normal; 4.5 standard errors are passed in 7 of 10⁶ cases.
    """
    first = np.array([stream(1, "draw", i).random() for i in range(10_000)])
    assert abs(first.mean() - 0.5) < 4.5 / np.sqrt(12 * len(first))
    assert abs(np.corrcoef(first[:-1], first[1:])[0, 1]) < 4.5 / np.sqrt(len(first))


DIMENSIONS = [2, 3, 4, 7]


@pytest.mark.parametrize("d", [*DIMENSIONS, 12])
@pytest.mark.parametrize("angle", [1e-7, 1e-3, 20.0, 90.0, 150.0, 180.0])
def test_unit_vectors_within_the_angle(rng, angle, d):
    """Every direction has norm 1 to rounding and lies within the angle of the first axis."""
    phi = math.radians(angle)
    u = sample_cap(rng, 2000, phi, d)
    assert u.shape == (2000, d)
    assert np.abs(np.linalg.norm(u, axis=1) - 1).max() < 8 * EPS
    across = np.linalg.norm(u[:, 1:], axis=1)
    assert np.all(np.arctan2(across, u[:, 0]) <= phi * (1 + 8 * EPS))


@pytest.mark.parametrize("d", DIMENSIONS)
def test_isotropic_across_the_axis(rng, assert_mean, d):
    """Across the axis the mean is zero and the covariance a multiple of 1, whatever the height.

    4.5 standard errors in at most 34 components: false alarms below 3e-4.
    """
    u = sample_cap(rng, 20_000, 1.2, d)
    across = u[:, 1:] / np.linalg.norm(u[:, 1:], axis=1, keepdims=True)
    assert_mean(across, 0.0)
    assert_mean(across * (u[:, :1] - u[:, :1].mean()), 0.0)
    if d > 2:
        i, j = np.tril_indices(d - 1, -1)
        assert_mean(across[:, i] * across[:, j], 0.0)
        assert_mean(across[:, :-1] ** 2, 1 / (d - 1))
    if d == 3:
        assert stats.kstest(np.arctan2(across[:, 1], across[:, 0]) / (2 * np.pi) + 0.5, "uniform").pvalue > 1e-6


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("phi", [1e-6, 1e-3, 1.0, math.pi])
def test_heights_against_mpmath(rng, d, phi):
    """Heights keep their relative accuracy at any angle: 4 rounding errors in two and three dimensions."""
    uniform = rng.random(20)
    t = heights(uniform.copy(), phi, d)
    with mpmath.workdps(60):
        angle = mpmath.mpf(phi)
        top = mpmath.sin(angle / 2) ** 2
        for value, share in zip(t.tolist(), uniform.tolist(), strict=True):
            exact = 1 - mpmath.cos(angle * share) if d == 2 else 2 * top * share
            assert abs(value - exact) <= 4 * EPS * exact


@pytest.mark.parametrize("d", DIMENSIONS)
def test_heights_at_the_ends(d):
    """The ends of the unit interval give finite heights from 0 to 2 on the whole sphere."""
    t = heights(np.array([0.0, 0.5, np.nextafter(1.0, 0.0)]), math.pi, d)
    assert t[0] == 0.0
    assert t[1] == pytest.approx(1.0, abs=1e-14)
    assert 2.0 - 1e-3 < t[2] <= 2.0


@pytest.mark.parametrize("axis", [[1, 0, 0], [-1, 0, 0], [0, 0, 1], [1e-9, 1, 0], [-3e5, 2e5, 1e5], [1e-5, -1e-6, 0]])
def test_axis(axis):
    """An axis of any direction and length rotates the cap as a whole: heights and mutual angles stay."""
    plain = sample_cap(np.random.default_rng(7), 200, 0.7, 3)
    rotated = sample_cap(np.random.default_rng(7), 200, 0.7, 3, axis)
    pole = np.array(axis, dtype=float) / np.linalg.norm(axis)
    np.testing.assert_allclose(rotated @ pole, plain[:, 0], rtol=0, atol=8 * EPS)
    np.testing.assert_allclose(rotated @ rotated.T, plain @ plain.T, rtol=0, atol=16 * EPS)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        *(([angle], "half_angle") for angle in (0.0, -1.0, np.nan, np.inf, 3.2)),
        ([1.0, 1], "dimension"),
        *(([1.0, 3, axis], "axis") for axis in ([1.0, 0.0], [0.0] * 3, [np.nan, 0.0, 1.0], [np.inf, 0.0, 1.0], 1.0)),
    ],
)
def test_bad_input(rng, arguments, name):
    """An angle outside (0, π], one dimension, an axis of the wrong shape, zero or not finite are named in the error."""
    with pytest.raises(ValueError, match=name):
        sample_cap(rng, 5, *arguments)


@pytest.mark.parametrize("dimension", [2, 3, 5])
@pytest.mark.parametrize("degrees", [20.0, 60.0, 180.0])
def test_cap_moments_agree_with_drawn_directions(dimension, degrees):
    """Quadrature agrees with the mean and variance of a sample of directions."""
    u = sample_cap(np.random.default_rng(4), 200_000, math.radians(degrees), dimension)
    moments = cap_moments(math.radians(degrees), dimension)
    assert abs(u[:, 0].mean() - moments.mean) < 5 * math.sqrt(moments.along / len(u))
    np.testing.assert_allclose(u[:, 0].var(), moments.along, rtol=0.02)
    np.testing.assert_allclose(u[:, 1].var(), moments.across, rtol=0.02)


def test_cap_moments_in_closed_form():
    """Archimedes: on a sphere u₁ is uniform; and the small angle keeps its digits (Kₐ → φ⁴/48)."""
    phi = math.radians(60.0)
    m1, m2 = (1 + math.cos(phi)) / 2, (1 + math.cos(phi) + math.cos(phi) ** 2) / 3
    np.testing.assert_allclose(cap_moments(phi, 3), [m1, m2 - m1**2, (1 - m2) / 2], rtol=1e-12)
    np.testing.assert_allclose(cap_moments(1e-6, 3).along, 1e-24 / 48, rtol=1e-9)
    # on a small cap θ²/φ² has the mean (d - 1)/(d + 1), d - 1 of it across; sin θ to the power 148 is below float64
    np.testing.assert_allclose(cap_moments(1e-3, 150).across, 1e-6 / 151, rtol=1e-5)


ANGLES_CAP_QUANTILE = [1e-6, 1e-3, 0.7, math.pi / 2, 1.8, 2.6, 3.0, 3.13, math.pi - 1e-6, math.pi]

SMALL = 10.0 ** -np.arange(1.0, 13.0)

SHARES = np.concatenate([SMALL, [0.3, 0.5, 0.77], 1.0 - SMALL, [1.0 - EPS / 2, 1.0]])


def area(height, d):
    """The area of a cap of a height 0 ≤ t ≤ 2, up to a factor: the incomplete beta function of t/2."""
    a = mpmath.mpf(d - 1) / 2
    return mpmath.betainc(a, a, 0, min(height / 2, mpmath.mpf(1)))


@pytest.mark.parametrize(
    ("d", "error"), [*((d, "2e-13") for d in (4, 5, 6, 7, 8, 9, 10)), (20, "3e-12"), (50, "1e-10")]
)
def test_relative_accuracy(d, error):
    """A height is right to 2e-13, in many dimensions to less: the area below one smaller by that is too small.

    The area below one that is larger by that is too large.
    """
    for angle in ANGLES_CAP_QUANTILE:
        found = heights(SHARES.copy(), angle, d)
        with mpmath.workdps(60):
            whole = area(2 * mpmath.sin(mpmath.mpf(angle) / 2) ** 2, d)
            for t, share in zip(found.tolist(), SHARES.tolist(), strict=True):
                below, above = (area(mpmath.mpf(t) * (1 + side * mpmath.mpf(error)), d) for side in (-1, 1))
                assert below <= share * whole <= above, (angle, share)


@pytest.mark.parametrize("d", [4, 5, 8])
@pytest.mark.parametrize("angle", [1e-3, 1.0, 2.5, math.pi])
def test_heights_follow_scipys_beta_law(d, angle):
    """t/2 is the quantile of Beta((d-1)/2, (d-1)/2) cut off at sin²(φ/2), to 2e-13, and draws have its distribution.

    Kolmogorov-Smirnov at 1e-6 in twelve cases: false alarms 1.2e-5.
    """
    law, top = stats.beta(0.5 * (d - 1), 0.5 * (d - 1)), math.sin(angle / 2) ** 2
    share = np.random.default_rng(9).random(20_000)
    t = heights(share.copy(), angle, d)
    np.testing.assert_allclose(t / 2, law.ppf(share * law.cdf(top)), rtol=2e-13, atol=0)
    directions, normals = np.empty((2, 5, d, 4000))
    draw(lanes(1, "beta"), angle, directions, normals)
    assert stats.kstest(directions[:, 0].ravel() / 2, lambda x: law.cdf(x) / law.cdf(top)).pvalue > 1e-6


def test_the_smallest_caps_are_flat():
    """In 50 dimensions, where the area of a cap of 1e-7 rad is no number, heights go like w^(2/49) up to its edge."""
    t = heights(np.array([0.0, 1e-3, 0.5, 1.0]), 1e-7, 50)
    np.testing.assert_allclose(t, 0.5e-14 * np.array([0.0, 1e-3, 0.5, 1.0]) ** (2 / 49), rtol=1e-12)


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


@pytest.mark.parametrize("d", [2, 4, 5, 7])
@pytest.mark.parametrize("angle", [1e-6, 1.0, 3.0])
def test_draws_have_the_heights_of_their_uniform_numbers(angle, d):
    """In three dimensions, on the whole sphere, the first row of a draw is twice its uniform numbers."""
    (plain, z), (directions, y) = np.empty((2, 1, 3, 200)), np.empty((2, 1, d, 200))
    draw(lanes(1, "heights"), math.pi, plain, z)
    draw(lanes(1, "heights"), angle, directions, y)
    np.testing.assert_allclose(directions[0, 0], heights(plain[0, 0] / 2, angle, d), rtol=8 * EPS)
