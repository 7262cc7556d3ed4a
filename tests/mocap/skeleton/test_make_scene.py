"""From joints to a scene: errors and their directions, ends of limbs, and the upright orientation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.io.recording import Recording, RecordingError
from study.mocap.markersets.set_file import load_markerset
from study.mocap.skeleton.make_scene import SceneJoint, make_scene
from study.mocap.skeleton.scene import Flag
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize


@pytest.fixture(scope="module")
def body():
    """A recording and its truth."""
    return synthesize(Recipe(frames=40))


def shown(truth, name="left_hip", **changes):
    """A joint at its true place."""
    number = truth.joints.index(name)
    rotation = truth.rotations[truth.segments.index(truth.parents[number])].transpose(1, 2, 0)
    parts = {"name": name, "parent": truth.parents[number], "child": truth.children[number]}
    parts |= {"center": truth.centers[number], "rotation": rotation, "covariance": np.eye(3) * 1e-6}
    return SceneJoint(**(parts | changes))


def covariances(scene, joint, frame):
    """The covariance in the world that follows from a scene's errors and orientations."""
    axes = Rotation.from_quat(scene.orientations[joint, frame]).as_matrix()
    return axes @ np.diag(np.nan_to_num(scene.errors[joint]) ** 2) @ axes.T


def test_errors_are_the_covariance(body):
    """Errors along their directions give the covariance back, rotated with the parent."""
    recording, truth = body
    root = np.random.default_rng(1).normal(size=(3, 3)) * 1e-3
    joint = shown(truth, covariance=root @ root.T)
    scene = make_scene(recording, load_markerset("cmu41"), [joint], "test")
    for frame in (0, 17, 39):
        r = joint.rotation[:, :, frame]
        assert np.allclose(covariances(scene, 0, frame), r @ root @ root.T @ r.T, atol=1e-12)
    assert np.all(np.diff(scene.errors[0]) <= 0)


@pytest.mark.parametrize("covariance", [np.diag([9e-6, 4e-6, 1e-6]), np.zeros((3, 3)), np.eye(3)])
def test_a_hinge_is_known_across_its_axis(body, covariance):
    """For a hinge the last direction is the axis, with no error, and the others are the covariance across it."""
    recording, truth = body
    axis = truth.axes[truth.joints.index("left_knee")]
    joint = shown(truth, "left_knee", covariance=covariance, axis=axis)
    scene = make_scene(recording, load_markerset("cmu41"), [joint], "test")
    assert np.isnan(scene.errors[0]).tolist() == [False, False, True]
    last = Rotation.from_quat(scene.orientations[0, 5]).as_matrix()[:, 2]
    assert abs(last @ joint.rotation[:, :, 5] @ axis) == pytest.approx(1.0)
    across = joint.rotation[:, :, 5] @ (np.eye(3) - np.outer(axis, axis))
    assert np.allclose(covariances(scene, 0, 5), across @ covariance @ across.T, atol=1e-12)


def test_quaternions_do_not_jump(body):
    """Quaternions of consecutive frames are close, so that they could be interpolated."""
    recording, truth = body
    scene = make_scene(recording, load_markerset("cmu41"), [shown(truth, covariance=np.diag([3.0, 2.0, 1.0]))], "test")
    assert ((scene.orientations[0, 1:] * scene.orientations[0, :-1]).sum(axis=1) > 0.9).all()


def test_unknown_joints(body):
    """A joint without a place is unknown in that frame; one that is never known is left out, with a note."""
    recording, truth = body
    center = truth.centers[truth.joints.index("left_hip")].copy()
    center[:, 3] = np.nan
    nowhere = shown(truth, "neck", center=np.full((3, 40), np.nan), doubt="still")
    scene = make_scene(recording, load_markerset("cmu41"), [shown(truth, center=center), nowhere], "test")
    assert scene.joints == ("left_hip",)
    assert scene.flags[0].tolist() == [Flag.SEEN] * 3 + [Flag.UNKNOWN] + [Flag.SEEN] * 36
    assert scene.notes == ("neck is not shown: still",)
    with pytest.raises(RecordingError, match="nothing to show"):
        make_scene(recording, load_markerset("cmu41"), [nowhere], "test")


def test_without_a_covariance(body):
    """A joint without a covariance has no errors in the scene."""
    recording, truth = body
    scene = make_scene(recording, load_markerset("cmu41"), [shown(truth, covariance=np.full((3, 3), np.nan))], "test")
    assert np.isnan(scene.errors).all()


def test_limbs_end_at_markers(scene):
    """Ends of limbs are near the markers that are farthest out; inner segments have none."""
    assert set(scene.tips) == {
        "head",
        "left_hand",
        "left_foot",
        "right_foot",
        "right_forearm",
    }  # as far as joints are known
    hand = scene.places[scene.markers.index("LFIN")]
    found = scene.ends[scene.tips.index("left_hand")]
    assert np.allclose(found, hand, equal_nan=True)
    # a toe and its neighbour, not the heel
    toes = np.stack([scene.places[scene.markers.index(name)] for name in ("LTOE", "LMT5")]).mean(axis=0)
    assert np.allclose(scene.ends[scene.tips.index("left_foot")], toes, equal_nan=True)


def test_y_up(body):
    """A recording whose y points up is rotated as a whole, and a note says so."""
    recording, truth = body
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # z to y
    lying = Recording("lying", recording.markers, turn @ recording.positions, recording.rate)
    joint = shown(truth)
    joint = shown(truth, center=turn @ joint.center, rotation=np.einsum("ij,jkt->ikt", turn, joint.rotation))
    scene = make_scene(lying, load_markerset("cmu41"), [joint], "test")
    assert scene.notes == ("the recording's y is shown as up",)
    height = scene.places[scene.markers.index("LFHD"), 2] - scene.places[scene.markers.index("LTOE"), 2]
    assert height.min() > 0.5
    upright = make_scene(recording, load_markerset("cmu41"), [shown(truth)], "test")
    assert np.allclose(scene.centers[:, 2], upright.centers[:, 2])
    assert upright.notes == ()
