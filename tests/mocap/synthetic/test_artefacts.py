import itertools

import numpy as np
import pytest

from study.mocap.synthetic import artefacts


def test_noise():
    """The standard deviation of 60000 draws is right within 4.5 of its standard errors."""
    drawn = artefacts.marker_noise((5, 3, 4000), 0.002, 1)
    assert drawn.std() == pytest.approx(0.002, rel=4.5 / np.sqrt(2 * drawn.size))
    np.testing.assert_array_equal(artefacts.marker_noise((5, 3, 4000), 0.004, 1), 2 * drawn)
    assert not artefacts.marker_noise((5, 3, 4), 0.0, 1).any()


def test_soft_tissue():
    """The displacement is at most its amplitude, and half of it follows the joint."""
    phases = np.sin(np.linspace(0, 40, 3000))[None] * np.ones((6, 1))
    slid = artefacts.soft_tissue(phases, 120.0, 0.01, 1)
    size = np.linalg.norm(slid, axis=1)
    assert size.max() <= 0.01 + 1e-15
    assert (size.max(axis=1) > 0.005).all()
    # the rest is an oscillation of half the amplitude on one line
    for marker in slid:
        direction = marker @ phases[0] / (phases[0] @ phases[0])
        assert np.linalg.norm(direction) == pytest.approx(0.005, rel=0.1)
        rest = marker - direction[:, None] * phases[0]
        values = np.linalg.svd(rest, compute_uv=False)
        assert values[1] < 0.1 * values[0]
    assert not artefacts.soft_tissue(phases, 120.0, 0.0, 1).any()


@pytest.mark.parametrize("share", [0.0, 0.001, 0.2, 0.5, 0.99, 1.0])
@pytest.mark.parametrize("frames", [7, 1000])
def test_gaps_have_their_share(share, frames):
    """Each marker lacks its share of frames, rounded."""
    mask = artefacts.gaps(4, frames, 120.0, share, 1)
    assert (mask.sum(axis=1) == round(share * frames)).all()


def test_gaps_come_in_runs():
    """Gaps take 0.2 s on average and are anywhere, also at the ends."""
    mask = artefacts.gaps(3000, 1200, 120.0, 0.2, 1)
    starts = (np.diff(mask.astype(int), axis=1, prepend=0) == 1).sum(axis=1)
    assert (starts == 10).all()
    assert mask[:, 0].any()
    assert mask[:, -1].any()
    # except near the ends, all frames have the same probability. With runs of 24 frames on average, the autocorrelation
    # time is about 40 frames: over 100 frames of 3000 markers the standard error is √(.16 · 40 / 300,000) = .0046
    middle = mask[:, 100:-100].mean(axis=0).reshape(-1, 100).mean(axis=1)
    assert np.abs(middle - 0.2).max() < 4.5 * 0.0046


def test_swaps_take_turns():
    """One pair at a time is swapped, in the given share of frames."""
    pairs = [("A", "B"), ("C", "D"), ("E", "F")]
    found = artefacts.swaps(pairs, 5000, 120.0, 0.1, 1)
    assert sum(swap.end - swap.first for swap in found) == 500
    assert all(a.end < b.first for a, b in itertools.pairwise(found))
    assert found[0].first >= 0
    assert found[-1].end <= 5000
    assert {swap.markers for swap in found} == set(pairs)
    assert artefacts.swaps(pairs, 5000, 120.0, 0.0, 1) == []


def test_every_cut_is_equally_likely():
    """Seven frames of nine are missing in two runs: each of 6 x 3 ways, in 18000 draws within 4.5 standard errors."""
    counts: dict[tuple[int, ...], int] = {}
    for seed in range(3600):
        for row in artefacts.gaps(5, 9, 17.5, 7 / 9, seed):
            key = tuple(np.flatnonzero(row))
            counts[key] = counts.get(key, 0) + 1
    assert len(counts) == 18
    expected = 18000 / 18
    assert max(abs(count - expected) for count in counts.values()) < 4.5 * np.sqrt(expected)
