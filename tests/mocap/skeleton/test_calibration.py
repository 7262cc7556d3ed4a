import json

import numpy as np
import pytest

from study.mocap.io.reading import read_recording
from study.mocap.io.recording import RecordingError
from study.mocap.markersets.match import choose
from study.mocap.skeleton.calibration import load_calibration
from study.mocap.skeleton.phases import calibrate, check, draw_skeleton, require_same_subject, skeleton_scene
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize


def test_saved_and_read_it_is_the_same(figure, figure_calibration, tmp_path):
    """Every number as it was, so that the same skeleton comes of it to the last bit."""
    recording, made = figure[0], figure_calibration
    read = load_calibration(made.save(tmp_path / "of" / "calibration.json"))
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
def test_what_is_no_calibration_is_one_line(text, words, tmp_path):
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(RecordingError, match=words) as caught:
        load_calibration(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(RecordingError, match="cannot be read"):
        load_calibration(tmp_path / "none.json")


def test_damage_is_noticed(figure_calibration, tmp_path):
    """A matrix of the wrong size, a joint or status that is none."""
    path = figure_calibration.save(tmp_path / "c.json")
    for change in (("covariance", [[1.0]]), ("status", "FINE"), ("joint", "tail"), ("in_child", [1.0, 2.0])):
        document = json.loads(path.read_text())
        document["joints"][0][change[0]] = change[1]
        path.with_name("d.json").write_text(json.dumps(document))
        with pytest.raises(RecordingError, match="damaged"):
            load_calibration(path.with_name("d.json"))


def test_another_subject_is_refused(kata, kata_calibration, kata_halves, shared_file):
    """Two real people, each with the other's calibration; and each with one from the other half of the recording."""
    someone = choose(read_recording(shared_file("cmu_85_02.c3d")))
    theirs = calibrate(someone.recording, someone.markerset)
    for calibration, other in ((kata_calibration, someone.recording), (theirs, kata.recording)):
        with pytest.raises(RecordingError, match="does not show the subject calibrated in") as caught:
            require_same_subject(draw_skeleton(calibration, other))
        assert "\n" not in str(caught.value)
    (first, of_first), (second, of_second) = kata_halves
    for calibration, other in ((of_first, second), (of_second, first)):
        assert check(draw_skeleton(calibration, other)).fits


def test_a_scene_says_what_is_doubtful(figure, figure_calibration):
    """Another subject's calibration is on every joint and in the notes."""
    recording, calibration = figure[0], figure_calibration
    scene = skeleton_scene(draw_skeleton(calibration, recording), recording)
    assert len(scene.joints) == 14
    assert not any(scene.doubts)
    assert scene.source == "joints found in this recording"
    other, _ = synthesize(Recipe(frames=300, height=1.5, seed=2))
    scene = skeleton_scene(draw_skeleton(calibration, other), other)
    assert scene.source == "joints found in synthetic-1"
    assert all("another subject" in doubt for doubt in scene.doubts)
    assert any("does not show the subject" in note for note in scene.notes)
