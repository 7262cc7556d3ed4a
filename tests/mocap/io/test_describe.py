import numpy as np

from study.mocap.io.describe import Gaps, describe, extents, gaps
from study.mocap.io.recording import Recording


def test_gaps_counted_by_hand():
    seen = np.array([0, 0, 1, 1, 0, 1, 0, 0, 0, 1, 0], dtype=bool)
    assert gaps(seen) == Gaps(missing=7, gaps=4, longest=3)
    assert gaps(np.ones(4, dtype=bool)) == Gaps(0, 0, 0)
    assert gaps(np.zeros(4, dtype=bool)) == Gaps(4, 1, 4)


def recording():
    positions = np.zeros((3, 3, 100))
    positions[0] = np.linspace(0, [3.0, 4.0, 0.0], 100).T
    positions[0, :, 40:60] = np.nan
    positions[1] = np.nan
    positions[2] = 1.0
    return Recording("walk", ("A", "LONGNAME", "C"), positions, 100.0, ("something was odd",))


def test_extent_is_the_diagonal_of_the_path():
    found = extents(recording())
    np.testing.assert_allclose(found[[0, 2]], [5.0, 0.0], atol=1e-12)
    assert np.isnan(found[1])


def test_lines():
    """The lines are a headline, notes, problems, then one per marker."""
    assert describe(recording()) == [
        "walk: 3 markers, 100 frames at 100 Hz, 0.99 s, 40.0% of the samples missing",
        "note: something was odd",
        "without any sample: LONGNAME",
        "move by less than 1 mm: C",
        "marker    missing  gaps  longest  extent",
        "A           20.0%     1   0.20 s  5.00 m",
        "LONGNAME   100.0%     1   1.00 s       -",
        "C            0.0%     0        -  0.00 m",
    ]


def test_nothing_moves():
    """If no marker moves, a line at the top says so."""
    still = Recording("chair", ("A", "B"), np.ones((2, 3, 9)), 100.0)
    assert describe(still)[1] == "no marker moves by more than 0 mm; joints cannot be found"
