"""Knees and ankles by their widths, for a body that wears Plug-in Gait's markers, whose centres and axes are known."""

from dataclasses import replace

import ezc3d
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.recordings import api
from study.recordings.export.tree import ExportedMotion, clinical_joints, joint_angles
from study.recordings.formats.read import read_recording
from study.recordings.formats.write import write_recording
from study.recordings.joints.estimate import JointStatus
from study.recordings.recording import RecordingError, describe, one_after_another, with_widths
from study.recordings.skeleton.anatomy import joint_by_chord
from study.recordings.skeleton.draw import draw_skeleton
from study.recordings.skeleton.scene import skeleton_scene
from study.recordings.synthetic.make import Recipe, body, synthesize

HEIGHT = 1.75
WIDTHS = {"left knee": 0.105, "right knee": 0.111, "left ankle": 0.07, "right ankle": 0.074, "marker": 0.016}
UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Anatomical axes x forward, y up, z to the right, as columns in axes x forward, y to the left, z up."""


def as_another_program(wand, above, lateral, far):
    """The centre as pyCGM's ``findJointC`` has it: the joint above, rotated about the middle by twice an angle."""
    middle, normal = (above + lateral) / 2, np.cross(wand - lateral, above - lateral)
    angle = 2 * np.arccos(far / np.linalg.norm(above - lateral))
    turn = Rotation.from_rotvec(angle * normal / np.linalg.norm(normal))
    return middle + turn.apply(above - middle)


@pytest.mark.parametrize("seed", range(5))
def test_the_chord_is_that_of_another_program(seed):
    """The centre of a limb that is built about it is found, as by pyCGM; in any pose of the limb."""
    rng = np.random.default_rng(seed)
    turn, far, length = Rotation.random(random_state=seed), rng.uniform(0.04, 0.08), rng.uniform(0.3, 0.5)
    limb = [[0, 0, length], [0, 0.12, 0.6 * length], [0, far, 0], [0, 0, 0]]
    above, wand, lateral, center = turn.apply(limb) + rng.normal(size=3)
    found = joint_by_chord(above, wand, lateral, far)
    np.testing.assert_allclose(found, center, atol=1e-12)
    np.testing.assert_allclose(found, as_another_program(wand, above, lateral, far), atol=1e-12)


def test_points_that_show_no_chord():
    """A joint above within the width, and a marker on the line of the other two, which shows no plane."""
    origin, up = np.zeros(3), np.array([0.0, 0.0, 0.4])
    assert joint_by_chord(0.1 * up, np.ones(3), origin, 0.05) is None
    assert joint_by_chord(up, 0.5 * up, origin, 0.05) is None


def place_of_joint(segment):
    """The joint below a segment of the body, in its axes, metres."""
    return HEIGHT * np.array(next(part for part in body() if part.parent == segment).at)


@pytest.fixture(scope="module")
def walk():
    """A walk with Plug-in Gait's markers and widths, and the truth about it.

    Markers at knees and ankles are level with the joints, and those of thigh and shank in the plane that Plug-in Gait
    wants. Feet have a heel and a toe.
    """
    recording, truth = synthesize(Recipe(900, 100.0, gait=True, noise=0.0005, seed=3))
    names = {"LFWT": "LASI", "RFWT": "RASI", "LBWT": "LPSI", "RBWT": "RPSI", "LSHN": "LTIB", "RSHN": "RTIB"}
    recording = replace(recording, markers=tuple(names.get(marker, marker) for marker in recording.markers))
    positions, rng = recording.positions.copy(), np.random.default_rng(1)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for segment, joint, wand, marker in (("thigh", "knee", "THI", "KNE"), ("shank", "ankle", "TIB", "ANK")):
            center, number = place_of_joint(f"{side}_{segment}"), truth.segments.index(f"{side}_{segment}")
            out = np.array([0.0, sign * (WIDTHS[f"{side} {joint}"] + WIDTHS["marker"]) / 2, 0.0])
            for label, at in ((marker, center + out), (wand, 0.6 * center + 1.6 * out)):
                world = np.einsum("tij,j->it", truth.rotations[number], at) + truth.origins[number]
                positions[recording.row(side[0].upper() + label)] = world + rng.normal(0, 0.0005, world.shape)
    whole = replace(recording, positions=positions, widths=WIDTHS)
    return whole.select([marker for marker in whole.markers if not marker.endswith("MT5")]), truth


def test_joints_by_their_widths(walk):
    """Ankles that motion leaves in doubt are at their true places; knees that it shows move along their axes alone."""
    recording, truth = walk
    joints, without = api.find_joints(recording), api.find_joints(replace(recording, widths={}))
    drawn = draw_skeleton(joints, recording)
    for side in ("left", "right"):
        ankle, knee, old = joints[f"{side}_ankle"], joints[f"{side}_knee"], without[f"{side}_knee"]
        assert ankle.status == JointStatus.LANDMARK
        assert ankle.reason.startswith("by the ankle's width (chord method); by motion: ")
        assert knee.status == old.status == JointStatus.HINGE
        step = knee.in_parent - old.in_parent
        assert np.linalg.norm(step) > 0.01
        assert np.linalg.norm(np.cross(step, knee.axis)) < 1e-6
        for name in ("knee", "ankle"):
            off = drawn.center(f"{side}_{name}") - truth.centers[truth.joints.index(f"{side}_{name}")]
            assert np.median(np.linalg.norm(off, axis=0)) < 0.007
    assert without["left_ankle"].status == JointStatus.UNSURE
    bare = clinical_joints(without)
    assert bare == []
    assert clinical_joints(joints) == [
        f"{side}_{name}" for side in ("left", "right") for name in ("hip", "knee", "ankle")
    ]


def test_angles_are_those_of_the_true_axes(walk):
    """Hips, knees and ankles are SciPy's Cardan angles of the true rotations, to 1° in the mean and 1.5° about it.

    The adduction of ankles is missing: an ankle known to 1 cm, 3 cm above the line of heel and toe, does not show it.
    """
    recording, truth = walk
    joints = api.find_joints(recording)
    drawn = draw_skeleton(joints, recording)
    table = joint_angles(ExportedMotion(drawn, recording, skeleton_scene(drawn, recording)))
    parts = {part.name: part for part in body()}
    ahead = {"pelvis": np.subtract(parts["pelvis"].markers["LFWT"], parts["pelvis"].markers["LBWT"]) * [1, 0, 1]}
    ahead |= {f"{side}_foot": [0.13, 0.0, -0.01] for side in ("left", "right")}
    axes = {}
    for name in truth.segments:
        pitch = np.arctan2(-ahead[name][2], ahead[name][0]) if name in ahead else 0.0
        axes[name] = Rotation.from_euler("y", pitch).as_matrix() @ UPRIGHT
    world = {name: truth.rotations[truth.segments.index(name)] @ axes[name] for name in axes}
    for side, sign in (("left", -1.0), ("right", 1.0)):
        for name, parent, child, bends in (
            ("hip", "pelvis", f"{side}_thigh", 1.0),
            ("knee", f"{side}_thigh", f"{side}_shank", -1.0),
            ("ankle", f"{side}_shank", f"{side}_foot", 1.0),
        ):
            turn = Rotation.from_matrix(np.swapaxes(world[parent], 1, 2) @ world[child])
            wanted = np.degrees(turn.as_euler("ZXY")) * [bends, sign, sign]
            found = table[[f"{side}_{name}_{angle}" for angle in ("flexion", "adduction", "rotation")]].to_numpy()
            off = (found - wanted + 180.0) % 360.0 - 180.0
            missing = np.isnan(off).mean(axis=0)
            if name == "ankle":
                assert missing[1] == 1.0
                off, missing = off[:, ::2], missing[::2]
            assert missing.max() < 0.02
            assert np.abs(np.nanmean(off, axis=0)).max() < 1.0, (side, name)
            assert np.nanstd(off, axis=0).max() < 1.5, (side, name)


def test_a_gait_report_of_plug_in_gait(walk):
    """Cycles of both sides, with all angles that the markers show, though the feet have no metatarsals but a toe."""
    gait = api.find_gait(walk[0])
    assert set(gait.cycles["side"]) == {"left", "right"}
    shown = gait.means().groupby(["side", "joint"])["angle"].nunique()
    assert shown.xs("left").to_dict() == shown.xs("right").to_dict()
    assert shown.xs("left").to_dict() == {"pelvis": 3, "hip": 3, "knee": 3, "ankle": 2, "foot": 1}
    words = "the error is above 10° in every frame, or a segment is unknown"
    assert gait.reasons == {(side, "ankle", "adduction"): words for side in ("left", "right")}
    assert api.find_gait(walk[0], largest_angle_error=90.0).reasons == {}


def test_widths_of_files(walk, tmp_path):
    """The group PROCESSING of a C3D is read; widths that are none are not; an option adds to them, and is checked."""
    path = write_recording(walk[0].select(frames=slice(0, 10)), tmp_path / "walk.c3d")
    file = ezc3d.c3d(str(path))
    for name, number in (("LKneeWidth", 105.0), ("RKneeWidth", 0.0), ("LAnkleWidth", 72.5), ("Bodymass", 71.0)):
        file.add_parameter("PROCESSING", name, [number])
    file.write(str(path))
    recording = read_recording(path)
    assert recording.widths == pytest.approx({"left knee": 0.105, "left ankle": 0.0725})
    assert "widths: left knee 105 mm, left ankle 72.5 mm" in describe(recording)
    more = with_widths(recording, "RKneeWidth=104, MarkerDiameter=14")
    assert more.widths["right knee"] == pytest.approx(0.104)
    assert more.widths["marker"] == pytest.approx(0.014)
    assert one_after_another([recording, more], "both").widths == more.widths
    words = "give LKneeWidth, RKneeWidth, LAnkleWidth, RAnkleWidth or MarkerDiameter and millimetres, such as"
    for text in ("KneeWidth=100", "LKneeWidth", "LKneeWidth=1.05", "LKneeWidth=x", ""):
        with pytest.raises(RecordingError, match=words):
            with_widths(recording, text)
