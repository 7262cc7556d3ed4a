"""Recordings from Python: public functions find joints and draw skeletons as the commands do."""

import json

import numpy as np
import pytest

import study
from study.recordings.formats.write import write_recording
from study.recordings.joints.find import save_calibration
from study.recordings.recording import RecordingError
from study.recordings.synthetic.make import Recipe, synthesize


@pytest.fixture(scope="module")
def joints(body):
    """Its joints."""
    return study.find_joints(body)


def test_joints_are_those_of_the_command(works, body, joints, tmp_path):
    """The calibration is the command's, byte by byte, from the file, its name or the recording."""
    works("joints", body, "--out", tmp_path)
    expected = (tmp_path / "calibration.json").read_bytes()
    for result in (joints, study.find_joints(str(body), "cmu41"), study.find_joints([study.read_recording(body)])):
        assert save_calibration(result, tmp_path / "mine.json").read_bytes() == expected


def test_trials_of_a_session(works, body, tmp_path):
    """Several trials, one of which gives the shapes, are merged as by the command."""
    whole = synthesize(Recipe(300, seed=2))[0]
    other = write_recording(whole, tmp_path / "other.c3d")
    still = write_recording(whole.select(frames=slice(0, 60)), tmp_path / "still.c3d")
    works("joints", body, other, "--static", still, "--out", tmp_path)
    result = study.find_joints([body, other], static=still)
    assert save_calibration(result, tmp_path / "mine.json").read_bytes() == (tmp_path / "calibration.json").read_bytes()


def test_skeleton(body, joints, tmp_path):
    """Joints found in the recording, given, or read from a file or its folder give the same skeleton."""
    save_calibration(joints, tmp_path / "calibration.json")
    own = study.draw_skeleton(body)
    for given in (joints, tmp_path, tmp_path / "calibration.json", str(tmp_path)):
        skeleton = study.draw_skeleton(study.read_recording(body), given)
        np.testing.assert_array_equal(skeleton.centers, own.centers)


def test_one_joint(works, body):
    """One joint is the command's."""
    parent, child = ["C7", "CLAV", "STRN", "T10"], ["LFHD", "RFHD", "LBHD", "RBHD"]
    joint = study.find_joint(body, parent, child)
    said = works("joint", body, "--parent", ",".join(parent), "--child", ",".join(child), "--json")
    assert json.loads(said)["center_in_recording"] == pytest.approx(joint.in_recording, rel=1e-12)
    assert joint.ok


def test_refusals(body, joints):
    """Faults are named: a set beside given joints, no recording. Files and sets are refused as by the commands."""
    with pytest.raises(RecordingError, match="markerset = 'cmu41': joints have their own marker set"):
        study.draw_skeleton(body, joints, markerset="cmu41")
    with pytest.raises(RecordingError, match="no recording is given"):
        study.find_joints([])
