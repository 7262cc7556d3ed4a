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
        ("[1, 2, 3]", "no object from labels to positions"),
        ("7", "no object from labels to positions"),
        ('{"LASI": [1, 2]}', "'LASI' is not at three finite numbers"),
        ('{"LASI": "here"}', "'LASI' is not at three finite numbers"),
        ('{"LASI": [1, 2, NaN]}', "'LASI' is not at three finite numbers"),
        ('{"LASI": [1, 2, 1e400]}', "'LASI' is not at three finite numbers"),
        (f'{{"LASI": [1, 2, 1{"0" * 320}]}}', "'LASI' is not at three finite numbers"),
        (f'{{"LASI": [1, 2, 1{"0" * 5000}]}}', "no JSON"),
        ('{"LASI": [1, 2, true]}', "'LASI' is not at three finite numbers"),
        ('{"LASI": [1, 2, null]}', "'LASI' is not at three finite numbers"),
    ],
)
def test_what_is_no_frame(line, words):
    with pytest.raises(FrameError, match=words):
        read_frame(line, 1.0)
