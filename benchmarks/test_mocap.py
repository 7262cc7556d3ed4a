"""Joints and skeletons from 41 markers: phase 1, phase 2, and biobuddy's SCoRE beside ours.

The aims: phase 1 of 5202 frames in under 1 s; phase 2 at 50 000 frames per second; SCoRE 50 times as fast as
biobuddy's. Both SCoRE fits start from known poses. Ours also corrects the rotations for noise and returns a covariance
and the axis. biobuddy is timed where it is installed.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from study.recordings.formats.read import read_recording
from study.recordings.joints.estimate import symmetric_fit
from study.recordings.joints.find import find_joints
from study.recordings.markersets import choose
from study.recordings.skeleton.calibrate import calibrate
from study.recordings.skeleton.draw import draw_skeleton
from study.recordings.synthetic.make import Recipe, synthesize

FRAMES = 5202


@pytest.fixture(scope="module")
def matched():
    """The karate kata of CMU's library if it is there, else a synthetic figure of as many frames and markers."""
    for folder in Path(__file__).resolve().parents:
        if (folder / "shared" / "data" / "cmu_135_02.c3d").is_file():
            return choose(read_recording(folder / "shared" / "data" / "cmu_135_02.c3d"))
    return choose(synthesize(Recipe(frames=FRAMES))[0])


def test_phase_one(timed, matched):
    """Fourteen joints with their errors."""
    group = f"phase 1, {FRAMES} frames of 41 markers (aim: below 1e9 ns)"
    joints = timed(group, "frames, joints and errors", find_joints, matched.markerset, matched.recording, rounds=5)
    assert len(joints.joints) == 14


def test_phase_two(timed, matched):
    """Fifteen segments in every frame."""
    calibration = calibrate(matched.recording, matched.markerset)
    group = "phase 2, per frame of 15 segments (aim: 20,000 ns)"
    skeleton = timed(group, "all joints", draw_skeleton, calibration, matched.recording, items=FRAMES)
    assert skeleton.frames == FRAMES


@pytest.mark.parametrize("whose", ["ours", "biobuddy"])
def test_score(timed, matched, whose):
    """The waist from pelvis and chest, whose poses are known: two centres, ours with its covariance."""
    joints, group = find_joints(matched.markerset, matched.recording), f"SCoRE of one joint, {FRAMES} frames"
    pelvis, thorax = joints.poses["pelvis"], joints.poses["thorax"]
    if whose == "ours":
        timed(group, "symmetric fit, with covariance and axis", symmetric_fit, pelvis, thorax, unit=True)
        return
    biobuddy = pytest.importorskip("biobuddy", reason="pip install biobuddy to see it beside ours")
    score = pytest.importorskip("biobuddy.model_modifiers.joint_center_tool").Score.perform_algorithm
    matrices = np.zeros((2, 4, 4, pelvis.rotation.shape[2]))
    for matrix, frames in zip(matrices, (pelvis, thorax), strict=True):
        matrix[:3, :3], matrix[:3, 3], matrix[3, 3] = frames.rotation, frames.origin, 1.0
    poses = [biobuddy.RotoTransMatrixTimeSeries.from_rt_matrix(matrix) for matrix in matrices]
    center = timed(group, "biobuddy", partial(score, recursive_outlier_removal=False), *poses, aim="≥ 50", rounds=5)
    # they leave the noise in the turns: some centimetres, where these are small against it
    assert np.linalg.norm(center[1] - symmetric_fit(pelvis, thorax).in_parent) < 0.1
