import numpy as np
import pytest

from study.mocap.joints.segment_poses import (
    PosePoint,
    SegmentPoses,
    fit_poses,
    marker_points,
    poses_from_markers,
    reference_frame,
)
from study.mocap.markersets.set_file import load_markerset
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize


@pytest.fixture(scope="module")
def figure():
    """A noisy figure and its marker set."""
    recording, truth = synthesize(Recipe(frames=600, noise=0.002, gaps=0.1))
    return load_markerset("cmu41"), recording, truth


def test_poses_from_markers(figure):
    """Segments with three markers have poses; those with two or one say how many they have."""
    markerset, recording, _ = figure
    poses = poses_from_markers(markerset, recording)
    assert {name for name, each in poses.items() if isinstance(each, SegmentPoses)} == {
        "pelvis", "thorax", "head", "left_forearm", "right_forearm", "left_foot", "right_foot",
    }  # fmt: skip
    assert poses["left_hand"] == "left_hand has 1 point (LFIN); its pose needs 3"
    assert "2 points (RTHI, RKNE)" in poses["right_thigh"]


def test_poses_follow_the_segment(figure):
    """Rotations differ from the true ones by a constant rotation, within the poses' noise; the reference has none.

    The largest of 600 angles about the mean is below five standard deviations of the worst axis.
    """
    markerset, recording, truth = figure
    poses = poses_from_markers(markerset, recording, reference=7)["pelvis"]
    true = truth.rotations[truth.segments.index("pelvis")]
    relative = np.einsum("tji,jkt->tik", true, poses.rotation)[poses.known]
    u, _, vt = np.linalg.svd(relative.mean(axis=0))
    off = np.einsum("ji,tjk->tik", u @ vt, relative)
    angle = np.arccos(np.clip((np.trace(off, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert angle.max() < 5 * poses.noise.worst_angle
    assert np.median(angle) > 0.2 * poses.noise.worst_angle
    np.testing.assert_allclose(poses.rotation[:, :, 7], np.eye(3), atol=1e-12)


def test_sigma_and_scatter(figure):
    """Sigma is the noise, 2 mm, to 6 %; a point's rms distance is below √3 of it, for the fit absorbs some."""
    markerset, recording, _ = figure
    for name in ("pelvis", "thorax", "left_foot"):
        poses = poses_from_markers(markerset, recording)[name]
        assert poses.sigma == pytest.approx(0.002, rel=0.06)
        assert (poses.scatter < np.sqrt(3) * 0.0022).all()
        assert (poses.scatter > 0.0005).all()


def test_joint_as_third_point(figure):
    """A thigh's poses follow from its two markers and the true hip; the markers' noise is separated from the hip's."""
    markerset, recording, truth = figure
    hip = truth.centers[truth.joints.index("left_hip")]
    tiny = np.repeat(1e-10 * np.eye(3)[:, :, None], recording.frames, axis=2)
    points = [PosePoint("left_hip", hip, tiny), *marker_points(markerset.segment("left_thigh"), recording)]
    poses = fit_poses("left_thigh", points)
    assert poses.points == ("left_hip", "LTHI", "LKNE")
    assert poses.sigma == pytest.approx(0.002, rel=0.1)
    knee = truth.centers[truth.joints.index("left_knee")]
    place = poses.mean_place(knee)
    error = poses.to_world(place)[:, poses.known] - knee[:, poses.known]
    expected = np.trace(poses.noise.covariance_at(place))
    assert (error**2).sum(axis=0).mean() == pytest.approx(expected, rel=0.2)


def test_points_on_a_line(rng):
    """Points on a line give a reason instead of poses; so do points that are never seen at once."""
    x = rng.standard_normal((3, 50))
    line = [PosePoint(name, x + 0.1 * k * np.array([[1.0], [0], [0]])) for k, name in enumerate("abc")]
    assert "lie on a line" in fit_poses("arm", line)
    one = rng.standard_normal((3, 50))
    one[:, :30] = np.nan
    two = rng.standard_normal((3, 50))
    two[:, 20:] = np.nan
    assert "never seen together" in fit_poses("arm", [PosePoint("a", one), PosePoint("b", two), PosePoint("c", x)])


def test_in_frames(figure):
    """Some of the frames have the rotations, noise and samples of the whole."""
    markerset, recording, _ = figure
    poses = poses_from_markers(markerset, recording)["thorax"]
    part = np.array([3, 70, 71, 400])
    few = poses.in_frames(part)
    np.testing.assert_array_equal(few.rotation, poses.rotation[:, :, part])
    np.testing.assert_array_equal(few.noise.pattern, poses.noise.pattern[part])
    x = recording.of("LELB")
    np.testing.assert_array_equal(few.to_local(x[:, part]), poses.to_local(x)[:, part])


def test_reference_frame(figure):
    """The reference frame has the most markers that are ever seen at once."""
    _, recording, _ = figure
    seen = recording.seen().sum(axis=0)
    assert seen[reference_frame(recording)] == seen.max()
