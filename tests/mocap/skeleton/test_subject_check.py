import numpy as np
import pytest

from study.mocap.io.reading import read_recording
from study.mocap.io.recording import RecordingError
from study.mocap.markersets.match import choose, match
from study.mocap.markersets.set_file import load_markerset
from study.mocap.skeleton.calibrate import calibrate
from study.mocap.skeleton.draw_skeleton import draw_skeleton
from study.mocap.skeleton.skeleton_scene import skeleton_scene
from study.mocap.skeleton.subject_check import check_subject, overruled, require_same_subject
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize


def test_another_subject_is_refused(kata, kata_calibration, kata_halves, shared_file):
    """Two real people are refused with each other's calibration; halves of one recording fit each other's."""
    someone = choose(read_recording(shared_file("cmu_85_02.c3d")))
    theirs = calibrate(someone.recording, someone.markerset)
    for calibration, other in ((kata_calibration, someone.recording), (theirs, kata.recording)):
        with pytest.raises(RecordingError, match=r"does not show the subject calibrated in.*--force") as caught:
            require_same_subject(draw_skeleton(calibration, other))
        assert "\n" not in str(caught.value)
    (first, of_first), (second, of_second) = kata_halves
    for calibration, other in ((of_first, second), (of_second, first)):
        assert check_subject(draw_skeleton(calibration, other)).same


def test_the_same_session_is_accepted(shared_file):
    """A functional trial's calibration draws the walk of its session, and the hips are those of the trial.

    The pelvis moves little in itself, so the hips' places in it are the calibration's whatever the walk shows.
    """
    found = load_markerset(shared_file("functional_hips_markers.toml"))
    trial, walk = (
        match(found, read_recording(shared_file(f"{n}.c3d"))) for n in ("functional_hips", "gait_same_session")
    )
    calibration = calibrate(trial.recording, trial.markerset)
    drawn = require_same_subject(draw_skeleton(calibration, walk.recording))
    assert check_subject(drawn).misfits == {}
    assert overruled(drawn) == []
    apart = np.linalg.norm(drawn.center("left_hip") - drawn.center("right_hip"), axis=0)
    left, right = (place.in_parent for place in calibration.joints)
    assert np.nanmedian(apart) == pytest.approx(np.linalg.norm(left - right), abs=1e-6)
    for name, other in (("left_hip", "LHJC"), ("right_hip", "RHJC")):
        off = np.linalg.norm(drawn.center(name) - walk.source.of(other), axis=0)
        assert np.nanmedian(off) < 0.01  # another method's centres of the same trials


def test_what_force_overrules(figure_calibration):
    """The line names the segments and their misfits."""
    other, _ = synthesize(Recipe(frames=300, height=1.5, seed=2))
    (line,) = overruled(draw_skeleton(figure_calibration, other))
    assert line.startswith("--force overrules: ")
    assert "does not show the subject calibrated in" in line
    assert " mm off, " in line or "far from their places" in line


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
