import pytest

from study.mocap.io.reading import read_recording
from study.mocap.io.recording import RecordingError
from study.mocap.markersets.match import choose
from study.mocap.skeleton.calibrate import calibrate
from study.mocap.skeleton.draw_skeleton import draw_skeleton
from study.mocap.skeleton.skeleton_scene import skeleton_scene
from study.mocap.skeleton.subject_check import check_subject, require_same_subject
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize


def test_another_subject_is_refused(kata, kata_calibration, kata_halves, shared_file):
    """Two real people are refused with each other's calibration; halves of one recording fit each other's."""
    someone = choose(read_recording(shared_file("cmu_85_02.c3d")))
    theirs = calibrate(someone.recording, someone.markerset)
    for calibration, other in ((kata_calibration, someone.recording), (theirs, kata.recording)):
        with pytest.raises(RecordingError, match="does not show the subject calibrated in") as caught:
            require_same_subject(draw_skeleton(calibration, other))
        assert "\n" not in str(caught.value)
    (first, of_first), (second, of_second) = kata_halves
    for calibration, other in ((of_first, second), (of_second, first)):
        assert check_subject(draw_skeleton(calibration, other)).same


def test_scene_of_another_subject(figure, figure_calibration):
    """A scene drawn with another subject's calibration says so on every joint and in the notes."""
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
