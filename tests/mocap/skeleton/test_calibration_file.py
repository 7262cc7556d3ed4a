import json

import numpy as np
import pytest

from study.mocap.io.recording import RecordingError
from study.mocap.skeleton.calibration_file import load_calibration, save_calibration
from study.mocap.skeleton.draw_skeleton import draw_skeleton


def test_saved_and_read_it_is_the_same(figure, figure_calibration, tmp_path):
    """A calibration that is read back draws the same skeleton to the last bit."""
    recording, made = figure[0], figure_calibration
    read = load_calibration(save_calibration(made, tmp_path / "of" / "calibration.json"))
    assert read.markerset == made.markerset
    assert (read.source, read.frames) == (made.source, made.frames)
    for one, other in zip(made.joints, read.joints, strict=True):
        assert (one.joint, one.status, one.reason) == (other.joint, other.status, other.reason)
    np.testing.assert_array_equal(draw_skeleton(read, recording).centers, draw_skeleton(made, recording).centers)
    np.testing.assert_array_equal([s.misfit for s in read.shapes], [s.misfit for s in made.shapes])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("not json", "not a calibration: not JSON"),
        ("[]", "not a calibration"),
        ('{"format": "else"}', "not a calibration"),
        ('{"format": "sphere-fit-study calibration", "version": 9}', "version 9"),
        ('{"format": "sphere-fit-study calibration", "version": 1}', "a damaged calibration"),
    ],
)
def test_other_files_are_refused(text, words, tmp_path):
    """A file that is no calibration is refused in one line."""
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(RecordingError, match=words) as caught:
        load_calibration(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(RecordingError, match="cannot be read"):
        load_calibration(tmp_path / "none.json")


def test_damage_is_noticed(figure_calibration, tmp_path):
    """A matrix of the wrong size, and an unknown joint or status, are refused."""
    path = save_calibration(figure_calibration, tmp_path / "c.json")
    changes = {"covariance": [[1.0]], "status": "FINE", "joint": "tail", "in_child": [1.0, 2.0], "in_parent": []}
    for change in changes.items():
        document = json.loads(path.read_text())
        document["joints"][0][change[0]] = change[1]
        path.with_name("d.json").write_text(json.dumps(document))
        with pytest.raises(RecordingError, match="damaged"):
            load_calibration(path.with_name("d.json"))
