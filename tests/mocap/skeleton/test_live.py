import time

import numpy as np
import pytest

import study
from study.mocap.geometry.rigid import into, motion
from study.mocap.markersets.set_file import load_markerset
from study.mocap.skeleton.live import LiveJoints
from study.mocap.skeleton.phases import calibrate
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize

CMU41 = load_markerset("cmu41")


@pytest.fixture(scope="module")
def figure():
    recording, truth = synthesize(Recipe(frames=1500, noise=0.001, gaps=0.05))
    return recording, truth, calibrate(recording, CMU41)


def run(live, recording):
    for frame in np.ascontiguousarray(recording.positions.transpose(2, 0, 1)):
        live.update(frame)
    return live


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_frame_by_frame_is_all_at_once(figure, noise):
    """The library's MGDK of all samples, put into frames by the library's Kabsch: to a nanometre."""
    recording, _, calibration = figure
    live = run(LiveJoints(calibration, recording.markers, noise), recording)
    assert {"left_hip", "right_shoulder", "neck", "left_wrist"} <= set(live.joints)
    for name, center in zip(live.joints, live.centers, strict=True):
        joint = calibration[name].joint
        shape = calibration.shape(joint.parent)
        x = np.stack([recording.of(marker) for marker in shape.markers])
        rotation, origin, _ = motion(shape.places, x)
        points = [into(rotation, origin, recording.of(marker)).T for marker in calibration.markerset.seeing(joint)]
        wanted = study.mgdk(points, noise=noise or 1e-9, weighted=False).center
        np.testing.assert_allclose(center, wanted, atol=1e-9, err_msg=name)


def test_it_finds_the_joints(figure):
    """Hips and shoulders to 5 mm of the truth, as seen from the parent's markers."""
    recording, truth, calibration = figure
    live = run(LiveJoints(calibration, recording.markers, 0.001), recording)
    for name in ("left_hip", "right_hip", "left_shoulder", "right_shoulder"):
        k = truth.joints.index(name)
        shape = calibration.shape(truth.parents[k])
        x = np.stack([recording.of(marker) for marker in shape.markers])
        rotation, origin, known = motion(shape.places, x)
        there = into(rotation, origin, truth.centers[k])[:, known].mean(axis=1)
        assert np.linalg.norm(live.centers[live.joints.index(name)] - there) < 0.005


def test_memory_is_constant_and_few_frames_say_nothing(figure):
    """Before there is a sphere there is no number; nothing grows."""
    recording, _, calibration = figure
    live = LiveJoints(calibration, recording.markers)
    sizes = [argument.nbytes for argument in live._arguments]
    assert np.isnan(live.update(recording.positions[:, :, 0].copy())).all()
    run(live, recording)
    assert np.isfinite(live.centers).all()
    assert [argument.nbytes for argument in live._arguments] == sizes


def test_a_frame_takes_microseconds(figure):
    """Fifty per joint is what was promised; a machine at rest takes about one."""
    recording, _, calibration = figure
    live = LiveJoints(calibration, recording.markers)
    frame = recording.positions[:, :, 0].copy()
    live.update(frame)
    start = time.perf_counter()
    for _ in range(200):
        live.update(frame)
    assert (time.perf_counter() - start) / 200 / len(live.joints) < 50e-6


def test_negative_noise(figure):
    with pytest.raises(ValueError, match="0 or more"):
        LiveJoints(figure[2], figure[0].markers, -1.0)
