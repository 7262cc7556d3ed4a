"""Lines of frames: what is read, and what is not."""

import numpy as np
import pytest

from study.mocap.live.frame_lines import FrameError, read_frame


def test_a_frame():
    """Positions in metres; markers that are not seen are not there."""
    frame = read_frame('{"LASI": [1, 2.5, -3], "RASI": null}\n', 0.001)
    assert list(frame) == ["LASI"]
    np.testing.assert_allclose(frame["LASI"], [0.001, 0.0025, -0.003])
    assert read_frame("{}", 1.0) == {}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("LASI 1 2 3", "no JSON"),
        ('{"LASI": [1, 2, 3]', "no JSON"),
        ("[" * 100_000, "no JSON"),
        ("[1, 2, 3]", "not an object of labels and positions"),
        ("7", "not an object of labels and positions"),
        ('{"LASI": [1, 2]}', "the position of 'LASI' is not three finite numbers"),
        ('{"LASI": "here"}', "the position of 'LASI' is not three finite numbers"),
        ('{"LASI": [1, 2, NaN]}', "the position of 'LASI' is not three finite numbers"),
        ('{"LASI": [1, 2, 1e400]}', "the position of 'LASI' is not three finite numbers"),
        (f'{{"LASI": [1, 2, 1{"0" * 320}]}}', "the position of 'LASI' is not three finite numbers"),
        (f'{{"LASI": [1, 2, 1{"0" * 5000}]}}', "no JSON"),
        ('{"LASI": [1, 2, true]}', "the position of 'LASI' is not three finite numbers"),
        ('{"LASI": [1, 2, null]}', "the position of 'LASI' is not three finite numbers"),
    ],
)
def test_what_is_no_frame(line, words):
    with pytest.raises(FrameError, match=words):
        read_frame(line, 1.0)
