import numpy as np
import pytest

from study.mocap.io.recording import Recording, RecordingError


def test_what_it_says_of_itself(small):
    """Frames, duration, shares and rows equal those counted by hand."""
    positions = np.zeros((2, 3, 5))
    positions[1, :, 1:3] = np.nan
    recording = Recording("walk", ("A", "B"), positions, 100.0)
    assert (recording.frames, recording.duration) == (5, 0.04)
    assert recording.missing().tolist() == pytest.approx([0.0, 0.4])
    assert recording.seen()[1].tolist() == [True, False, False, True, True]
    assert recording.row("B") == 1
    np.testing.assert_array_equal(recording.of("B"), positions[1])


def test_positions_are_contiguous_over_frames_and_kept_from_changes():
    """Positions have one memory layout and are read-only; the caller's own array stays writable."""
    positions = np.arange(24.0).reshape(4, 3, 2).transpose(2, 1, 0)
    recording = Recording("walk", ("A", "B"), positions, 100.0)
    assert recording.positions.flags.c_contiguous
    with pytest.raises(ValueError, match="read-only"):
        recording.positions[0, 0, 0] = 1.0
    own = np.zeros((1, 3, 2))
    Recording("walk", ("A",), own, 100.0)
    own[0, 0, 0] = 1.0


def test_select(small):
    """Markers come in the given order, with some frames; all else is the same."""
    recording = small()
    some = recording.select(["C7", "LFHD"], slice(2, 5))
    assert some.markers == ("C7", "LFHD")
    np.testing.assert_array_equal(some.of("C7"), recording.of("C7")[:, 2:5])
    every = recording.select(frames=np.array([3, 0]))
    np.testing.assert_array_equal(every.positions, recording.positions[:, :, [3, 0]])
    assert (every.name, every.rate) == (recording.name, recording.rate)


@pytest.mark.parametrize(
    ("markers", "shape", "rate", "words"),
    [
        (("A", "B"), (3, 3, 5), 100.0, r"shape \(3, 3, 5\); they must be \(2, 3, frames\)"),
        (("A", "B"), (2, 5, 3), 100.0, r"must be \(2, 3, frames\)"),
        (("A", "A"), (2, 3, 5), 100.0, "two markers have the label 'A'"),
        (("A", "B"), (2, 3, 5), 0.0, "rate is 0 frames per second"),
        (("A", "B"), (2, 3, 5), np.nan, "rate is nan"),
    ],
)
def test_what_does_not_fit_is_refused(markers, shape, rate, words):
    with pytest.raises(RecordingError, match=words):
        Recording("walk", markers, np.zeros(shape), rate)


def test_an_unknown_marker_is_told_with_the_known(small):
    with pytest.raises(RecordingError, match="no marker 'NOSE'; there are LFHD, RFHD, C7, LFIN"):
        small().of("NOSE")
