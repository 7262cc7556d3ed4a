"""From joints to a scene: errors and their directions, ends of limbs, and the upright orientation.

The scene: fewer frames, the floor.

What is printed and stored of joints and skeletons.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from study.recordings.joints.report import agreement_lines, joint_lines
from study.recordings.markersets import mirrored, side
from study.recordings.recording import Recording, RecordingError
from study.recordings.skeleton.draw import Flag
from study.recordings.skeleton.scene import bone_table, bones, make_scene, skeleton_lines, skeleton_table, up_of
from study.recordings.synthetic.make import Recipe, synthesize


@pytest.fixture(scope="module")
def body():
    """A recording and its truth."""
    return synthesize(Recipe(frames=40))


MILLIMETRE = 1e-6 * np.eye(3)


@pytest.fixture
def shown(body, of_truth):
    """Make the skeleton of one true joint, and its scene."""

    def make(joint, covariance=MILLIMETRE):
        skeleton = of_truth(*body, [joint], covariance=covariance)
        return skeleton, make_scene(skeleton, body[0], [""], "test")

    return make


def covariances(scene, joint, frame):
    """The covariance in the world that follows from a scene's errors and orientations."""
    axes = Rotation.from_quat(scene.orientations[joint, frame]).as_matrix()
    return axes @ np.diag(np.nan_to_num(scene.errors[joint]) ** 2) @ axes.T


def test_errors_are_the_covariance(shown):
    """Errors along their directions give the covariance back, rotated with the parent."""
    root = np.random.default_rng(1).normal(size=(3, 3)) * 1e-3
    skeleton, scene = shown("left_hip", root @ root.T)
    for frame in (0, 17, 39):
        r = skeleton.rotation("pelvis")[:, :, frame]
        assert np.allclose(covariances(scene, 0, frame), r @ root @ root.T @ r.T, atol=1e-12)
    assert np.all(np.diff(scene.errors[0]) <= 0)


@pytest.mark.parametrize("covariance", [np.diag([9e-6, 4e-6, 1e-6]), np.zeros((3, 3)), np.eye(3)])
def test_a_hinge_is_known_across_its_axis(body, shown, covariance):
    """For a hinge the last direction is the axis, with no error, and the others are the covariance across it."""
    axis = body[1].axes[body[1].joints.index("left_knee")]
    skeleton, scene = shown("left_knee", covariance)
    rotation = skeleton.rotation("left_thigh")[:, :, 5]
    assert np.isnan(scene.errors[0]).tolist() == [False, False, True]
    last = Rotation.from_quat(scene.orientations[0, 5]).as_matrix()[:, 2]
    assert abs(last @ rotation @ axis) == pytest.approx(1.0)
    across = rotation @ (np.eye(3) - np.outer(axis, axis))
    assert np.allclose(covariances(scene, 0, 5), across @ covariance @ across.T, atol=1e-12)


def test_quaternions_do_not_jump(shown):
    """Quaternions of consecutive frames are close, so that they could be interpolated."""
    turns = shown("left_hip", np.diag([3.0, 2.0, 1.0]))[1].orientations[0]
    assert ((turns[1:] * turns[:-1]).sum(axis=1) > 0.9).all()


def test_unknown_joints(body, of_truth):
    """A joint without a place is unknown in that frame; one that is never known is left out, with a note."""
    recording, truth = body
    skeleton = of_truth(recording, truth, ["left_hip", "neck"])
    skeleton.center("left_hip")[:, 3] = np.nan
    skeleton.center("neck")[:] = np.nan
    scene = make_scene(skeleton, recording, ["", "still"], "test")
    assert scene.joints == ("left_hip",)
    assert scene.flags[0].tolist() == [Flag.SEEN] * 3 + [Flag.UNKNOWN] + [Flag.SEEN] * 36
    assert scene.notes == ("neck is not shown: still",)
    places = [replace(place, covariance=0.06**2 * np.eye(3)) for place in skeleton.calibration.joints]
    wide = replace(skeleton, calibration=replace(skeleton.calibration, joints=tuple(places)))
    (note,) = make_scene(wide, recording, ["", "still"], "test").notes
    assert note == "neck is not shown: ± 60 mm (see --largest-error); still"
    skeleton.center("left_hip")[:] = np.nan
    with pytest.raises(RecordingError, match="nothing to show"):
        make_scene(skeleton, recording, ["", "still"], "test")


def test_without_a_covariance(shown):
    """A joint without a covariance has no errors in the scene."""
    assert np.isnan(shown("left_hip", np.full((3, 3), np.nan))[1].errors).all()


def test_limbs_end_at_markers(scene):
    """Ends of limbs are near the markers that are farthest out; inner segments have none."""
    known = {"head", "left_hand", "left_foot", "right_foot", "right_forearm"}
    assert set(scene.tips) == known  # as far as joints are known
    hand = scene.places[scene.markers.index("LFIN")]
    found = scene.ends[scene.tips.index("left_hand")]
    assert np.allclose(found, hand, equal_nan=True)
    # a toe and its neighbour, not the heel
    toes = np.stack([scene.places[scene.markers.index(name)] for name in ("LTOE", "LMT5")]).mean(axis=0)
    assert np.allclose(scene.ends[scene.tips.index("left_foot")], toes, equal_nan=True)


def test_y_up(body, shown):
    """A recording whose y points up is rotated as a whole, and the words say so."""
    recording, (skeleton, upright) = body[0], shown("left_hip")
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # z to y
    lying = Recording("lying", recording.markers, turn @ recording.positions, recording.rate)
    scene = make_scene(replace(skeleton, centers=turn @ skeleton.centers), lying, [""], "test")
    assert up_of(lying)[1].startswith("up is y of the recording, in which ")
    height = scene.places[scene.markers.index("LFHD"), 2] - scene.places[scene.markers.index("LTOE"), 2]
    assert height.min() > 0.5
    assert np.allclose(scene.centers[:, 2], upright.centers[:, 2])
    assert up_of(recording)[1].startswith("up is z of the recording, in which ")


@pytest.mark.parametrize(
    ("rate", "frames", "result"), [(90.0, 90, 90.0), (60.0, 45, 45.0), (30.0, 30, 30.0), (500, 90, 90)]
)
def test_at_most(scene, rate, frames, result):
    """A scene with a lower rate has every second, third, ... frame and the same duration."""
    thinned = scene.at_most(rate)
    assert (thinned.frames, thinned.rate) == (frames, result)
    step = 90 // frames
    assert np.array_equal(thinned.centers, scene.centers[:, :, ::step], equal_nan=True)
    assert thinned.frames / thinned.rate == scene.frames / scene.rate


def test_floor(scene):
    """The floor is just below the lowest marker of nearly all frames."""
    lowest = np.nanmin(scene.places[:, 2])
    assert lowest - 0.03 < scene.floor < np.nanquantile(np.nanmin(scene.places[:, 2], axis=0), 0.1)
    assert np.isfinite(replace(scene, markers=(), places=np.empty((0, 3, 90))).floor)


def test_sides_and_flags(scene):
    """Sides follow from names; each flag says what it means."""
    sides = dict(zip((*scene.joints, *scene.tips), scene.sides(), strict=True))
    assert [sides[name] for name in ("left_knee", "right_foot", "waist")] == ["left", "right", ""]
    assert [flag.text for flag in Flag] == ["from markers", "bridged: too few markers seen", "unknown"]


def test_bones():
    """Two points are a bone and three a triangle; of four the middle one has the others; no bone occurs twice."""
    rng = np.random.default_rng(5)
    points = rng.normal(size=(5, 3, 7))
    points[4] = np.nan
    assert bones([[0, 1]], points, [""] * 5) == ((0, 1),)
    assert bones([[0, 1], [0, 1]], points, [""] * 5) == ((0, 1),)
    assert set(bones([[0, 1, 2]], points, [""] * 5)) == {(0, 1), (0, 2), (1, 2)}
    assert set(bones([[0, 1, 2, 3]], points, ["left", "right", "", "left"])) == {(2, 0), (2, 1), (2, 3)}
    assert bones([[], [3]], points, [""] * 5) == ()
    assert len(bones([[0, 1, 2, 4]], points, [""] * 5)) == 3


@pytest.mark.parametrize(
    ("name", "word", "other"),
    [
        ("left_knee", "left", "right_knee"),
        ("Left_Knee", "left", "Right_Knee"),
        ("KNEE RIGHT", "right", "KNEE LEFT"),
        ("Left-Hip", "left", "Right-Hip"),
        ("leftover_hip", "", "leftover_hip"),
        ("cleft_chin", "", "cleft_chin"),
        ("right_cleft", "right", "left_cleft"),
        ("waist", "", "waist"),
    ],
)
def test_the_other_side(name, word, other):
    """A side is a whole word; the same words tell a side and are exchanged, of any case, and back again."""
    assert side(name) == word
    assert mirrored(name) == other
    assert mirrored(other) == name


def test_a_row_per_frame_and_joint(scene):
    """Rows are the scene's, frame by frame."""
    table = skeleton_table(scene)
    assert len(table) == 90 * len(scene.joints)
    row = table[(table["frame"] == 46) & (table["joint"] == scene.joints[3])].iloc[0]
    assert row["time"] == 0.5
    assert row["known"] == "bridged"
    assert np.array_equal(row[["x", "y", "z"]].to_numpy(float), scene.centers[3, :, 45])


def test_bones_tables(scene):
    """Lengths are the distances between joints; the other side's are compared, and what has none is not."""
    table = bone_table(scene).set_index(["start", "end"])
    i, j = scene.joints.index("left_hip"), scene.joints.index("left_knee")
    length = np.linalg.norm(scene.centers[i] - scene.centers[j], axis=0)
    thigh = table.loc[("left_hip", "left_knee")]
    assert thigh["length"] == pytest.approx(length.mean())
    assert thigh["spread"] < 1e-9
    assert thigh["error"] == pytest.approx(np.hypot(np.nanmax(scene.errors[i]), np.nanmax(scene.errors[j])))
    assert thigh["uneven"] == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(table.loc[("left_hip", "right_hip"), "uneven"])
    assert np.isnan(table.loc[("left_elbow", "left_wrist"), "uneven"])  # the right wrist is not known


@pytest.fixture(scope="module")
def true_calibration(of_truth):
    """The calibration of a synthetic body's true joints."""
    return of_truth(*synthesize(Recipe(frames=2))).calibration


def test_uneven_bones_are_said(scene, true_calibration):
    """A shin that is a tenth longer than the other is marked, and the other too; each joint has one line."""
    centers = scene.centers.copy()
    knee, ankle = scene.joints.index("left_knee"), scene.joints.index("left_ankle")
    centers[ankle] = centers[knee] + 1.1 * (centers[ankle] - centers[knee])
    lines = list(skeleton_lines(replace(scene, centers=centers), true_calibration))
    marked = [line for line in lines if line.endswith("uneven")]
    assert [line.split("  ")[0] for line in marked] == ["left_knee - left_ankle", "right_knee - right_ankle"]
    assert "+9.5 %" in marked[0]
    assert any(line.startswith("neck: not reliable: moved too little") for line in lines)
    assert [line.split()[0] for line in lines[1 : 1 + len(scene.joints)]] == list(scene.joints)
    assert lines[4].split()[-2:] == ["11.1%", "-"]  # bridged, unknown
    assert lines[-1] == "note: right_wrist is not shown: known in no frame"


def test_one_joint_has_no_bones(scene, true_calibration):
    """Without bones between joints there is an empty table, and its head."""
    assert list(bone_table(replace(scene, bones=())).columns) == ["start", "end", "length", "spread", "error", "uneven"]
    assert any(line.startswith("bone") for line in skeleton_lines(replace(scene, bones=()), true_calibration))


def test_agreed():
    """Distances are in millimetres, and what is not known is a dash."""
    table = pd.DataFrame({"joint": ["neck"], "cap": [3.0], "from_gdke": [0.0123], "from_two_sided": [np.nan]})
    head, line = agreement_lines(table)
    assert head.split() == ["distance", "to", "/", "mm", "gdke", "two-sided"]
    assert line.split() == ["neck", "12.3", "-"]


def test_a_joint_without_a_place_in_its_parent(figure):
    """Where no frame shows both segments, dashes stand for the place, and a line says why."""
    found = figure[2]
    words = "left_ankle: no place in its parent: no frame has poses of both left_shank and left_foot"
    lost = [
        replace(each, in_parent=np.full(3, np.nan)) if each.joint.name == "left_ankle" else each
        for each in found.joints
    ]
    assert words not in joint_lines(found)
    assert words in joint_lines(replace(found, joints=tuple(lost)))


def test_an_error_of_any_size(figure, monkeypatch):
    """A joint that may lie anywhere along its axis has no digits of an error of kilometres."""
    found = figure[2]
    assert "> 10000" not in " ".join(joint_lines(found))
    monkeypatch.setattr(type(found.joints[0]), "standard_error", 5.6e6)
    lines = [line for line in joint_lines(found) if line.startswith("waist")]
    assert "> 10000" in lines[0]
    assert "5600000000.0" not in lines[0]
