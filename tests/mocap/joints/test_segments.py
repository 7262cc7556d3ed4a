import numpy as np
import pytest

from study.mocap.joints.segments import Frames, Point, fixed_by, own_frames, own_points, reference_frame
from study.mocap.markersets.set_file import load_markerset
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize


@pytest.fixture(scope="module")
def figure():
    """A noisy figure and its marker set."""
    recording, truth = synthesize(Recipe(frames=600, noise=0.002, gaps=0.1))
    return load_markerset("cmu41"), recording, truth


def test_own_markers_make_a_frame_or_say_why_not(figure):
    """Segments with three markers have one; those with two or one say how many they have."""
    markerset, recording, _ = figure
    frames = own_frames(markerset, recording)
    assert {name for name, each in frames.items() if isinstance(each, Frames)} == {
        "pelvis", "thorax", "head", "left_forearm", "right_forearm", "left_foot", "right_foot",
    }  # fmt: skip
    assert frames["left_hand"] == "left_hand has 1 points (LFIN); its frame needs 3"
    assert "2 points (RTHI, RKNE)" in frames["right_thigh"]


def test_a_frame_moves_as_the_segment_does(figure):
    """Rotations differ from the true ones by one constant turn, within the frame's own noise; so does the reference.

    The largest of 600 turns' angles about their mean is below five standard deviations of the worst axis.
    """
    markerset, recording, truth = figure
    frames = own_frames(markerset, recording, reference=7)["pelvis"]
    true = truth.rotations[truth.segments.index("pelvis")]
    relative = np.einsum("tji,jkt->tik", true, frames.rotation)[frames.known]
    u, _, vt = np.linalg.svd(relative.mean(axis=0))
    off = np.einsum("ji,tjk->tik", u @ vt, relative)
    angle = np.arccos(np.clip((np.trace(off, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert angle.max() < 5 * frames.carried.tilt_angle
    assert np.median(angle) > 0.2 * frames.carried.tilt_angle
    np.testing.assert_allclose(frames.rotation[:, :, 7], np.eye(3), atol=1e-12)


def test_the_spread_is_the_noise_and_the_scatter_what_is_left_of_it(figure):
    """2 mm per coordinate to 5 %, of 600 frames; a point's rms distance is below √3 of it, as the fit takes some."""
    markerset, recording, _ = figure
    for name in ("pelvis", "thorax", "left_foot"):
        frames = own_frames(markerset, recording)[name]
        assert frames.spread == pytest.approx(0.002, rel=0.06)
        assert (frames.scatter < np.sqrt(3) * 0.0022).all()
        assert (frames.scatter > 0.0005).all()


def test_a_joint_is_the_third_point(figure):
    """A thigh's frame from its two markers and the true hip; the markers' noise is told apart from the hip's."""
    markerset, recording, truth = figure
    hip = truth.centers[truth.joints.index("left_hip")]
    tiny = np.repeat(1e-10 * np.eye(3)[:, :, None], recording.frames, axis=2)
    points = [Point("left_hip", hip, tiny), *own_points(markerset.segment("left_thigh"), recording)]
    frames = fixed_by("left_thigh", points)
    assert frames.points == ("left_hip", "LTHI", "LKNE")
    assert frames.spread == pytest.approx(0.002, rel=0.1)
    knee = truth.centers[truth.joints.index("left_knee")]
    place = frames.place(knee)
    error = frames.show(place)[:, frames.known] - knee[:, frames.known]
    carried = np.trace(frames.carried.at(place))
    assert (error**2).sum(axis=0).mean() == pytest.approx(carried, rel=0.2)


def test_points_on_a_line_do_not_fix_a_frame(rng):
    """The words say so; so do they for points that are never seen at once."""
    x = rng.standard_normal((3, 50))
    line = [Point(name, x + 0.1 * k * np.array([[1.0], [0], [0]])) for k, name in enumerate("abc")]
    assert "lie on a line" in fixed_by("arm", line)
    one = rng.standard_normal((3, 50))
    one[:, :30] = np.nan
    two = rng.standard_normal((3, 50))
    two[:, 20:] = np.nan
    assert "never seen together" in fixed_by("arm", [Point("a", one), Point("b", two), Point("c", x)])


def test_a_part_of_the_frames(figure):
    """The same rotations, noise and samples, of these frames."""
    markerset, recording, _ = figure
    frames = own_frames(markerset, recording)["thorax"]
    part = np.array([3, 70, 71, 400])
    few = frames.at(part)
    np.testing.assert_array_equal(few.rotation, frames.rotation[:, :, part])
    np.testing.assert_array_equal(few.carried.pattern, frames.carried.pattern[part])
    x = recording.of("LELB")
    np.testing.assert_array_equal(few.see(x[:, part]), frames.see(x)[:, part])


def test_the_reference_is_a_frame_with_all_markers(figure):
    """As many as are ever seen at once."""
    _, recording, _ = figure
    seen = recording.seen().sum(axis=0)
    assert seen[reference_frame(recording)] == seen.max()
