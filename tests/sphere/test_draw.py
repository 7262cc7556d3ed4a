"""The compiled drawing loop: directions on a cap and normal numbers, trial after trial."""

import math

import mpmath
import numpy as np
import pytest
from scipy import stats

from study.experiment.streams import lanes
from study.sphere.cap import draw, sample_cap
from study.sphere.jit import CHUNK
from study.sphere.random.sfc64 import fill_words

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
@pytest.mark.parametrize("degrees", [1e-3, 40, 130, 180])
def test_heights_follow_their_law(d, degrees):
    """t/2 is Beta((d-1)/2, (d-1)/2), cut off. Sixteen Kolmogorov-Smirnov tests at 1e-5: false alarm 2e-4."""
    angle, k = math.radians(degrees), (d - 1) / 2
    u, _ = drawn("law", 40, 500, d, angle)
    law, top = stats.beta(k, k), math.sin(angle / 2) ** 2
    share = law.cdf(u[:, 0].ravel() / 2) / law.cdf(top)
    assert stats.kstest(share, "uniform").pvalue > 1e-5


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


def test_points_of_the_circle_are_sines_and_cosines():
    """In three dimensions the coordinates of each point are a sine and a cosine of one angle, to the last bits."""
    u, _ = drawn("circle", 1, 400, 3, math.pi)
    for t, x, y in u[0].T:
        with mpmath.workdps(40):
            length = mpmath.sqrt(mpmath.mpf(t) * (2 - mpmath.mpf(t)))
            angle = mpmath.atan2(y, x)
            assert abs(length * mpmath.cos(angle) - x) < 4 * EPS * length
            assert abs(length * mpmath.sin(angle) - y) < 4 * EPS * length


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


def test_same_seed_same_directions():
    """All randomness comes from the generator given."""
    one, two = (sample_cap(np.random.default_rng(4), 50, 0.3, 3, [1, 2, 3]) for _ in range(2))
    np.testing.assert_array_equal(one, two)
