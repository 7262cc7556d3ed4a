"""The hierarchy of joints that files are written from."""

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from bvhtoolbox import BvhTree
from scipy.spatial.transform import Rotation

from study.recordings.export import write_file
from study.recordings.export.tree import RestPose, joint_angles, joint_tree, rest_rotations
from study.recordings.joints.estimate import JointStatus
from study.recordings.joints.find import Calibration, JointPlace, SegmentShape
from study.recordings.markersets import Joint, MarkerSet, Segment, load_markerset
from study.recordings.skeleton.calibrate import calibrate, with_checks
from study.recordings.skeleton.draw import Flag

SIDES = {"left": 1.0, "right": -1.0}

LEFT, FORWARD, UP = np.array([1.0, 0, 0]), np.array([0, -1.0, 0]), np.array([0, 0, 1.0])


@pytest.fixture(scope="module")
def posed(motion):
    """A function for the angles of the standing body with one segment, and all that hang on it, rotated."""
    standing = rest_rotations(motion.skeleton.calibration, np.eye(3), RestPose.STANDING)
    parents = {s.name: s.parent for s in motion.skeleton.calibration.markerset.segments}

    def pose(segment, axis, degrees):
        rotations = np.empty_like(motion.skeleton.rotations[..., :1])
        for number, name in enumerate(motion.skeleton.segments):
            chain, above = [name], parents[name]
            while above:
                chain.append(above)
                above = parents[above]
            turn = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix() if segment in chain else np.eye(3)
            rotations[number, :, :, 0] = turn @ standing[name]
        parts = {"rotations": rotations, "origins": motion.skeleton.origins[..., :1], "centers": np.zeros((14, 3, 1))}
        parts |= {"turning": np.zeros((len(rotations), 1, 3, 3)), "segment_flags": motion.skeleton.segment_flags[:, :1]}
        return joint_angles(replace(motion, skeleton=replace(motion.skeleton, **parts))).iloc[0]

    return pose


def test_standing_is_zero(posed):
    """All joints of the standing pose have the angle zero, and the pelvis is upright."""
    row = posed("none", UP, 0.0).drop(["time", "pelvis_tx", "pelvis_ty", "pelvis_tz", "pelvis_rotation"])
    row = row[[not name.endswith(("_error", "_flag")) for name in row.index]]
    np.testing.assert_allclose(row.to_numpy(dtype=float), 0.0, atol=1e-9)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("segment", "joint"), [("thigh", "hip"), ("upper_arm", "shoulder")])
def test_signs_of_a_limb(posed, side, segment, joint):
    """Forward is flexion; towards the midline is adduction; the front turned to the midline is internal rotation."""
    sign = SIDES[side]
    for name, axis in {
        "flexion": -LEFT,  # takes what hangs down forward
        "adduction": sign * np.cross(UP, LEFT),  # takes what hangs down to the other side
        "rotation": -sign * UP,  # takes forward to the other side
    }.items():
        down, front = Rotation.from_rotvec(0.1 * axis).apply([-UP, FORWARD])
        shifts = {"flexion": down @ FORWARD, "adduction": -sign * (down @ LEFT), "rotation": -sign * (front @ LEFT)}
        assert shifts[name] == pytest.approx(np.sin(0.1))
        row = posed(f"{side}_{segment}", axis, 30.0)
        for each in ("flexion", "adduction", "rotation"):
            assert row[f"{side}_{joint}_{each}"] == pytest.approx(30.0 if each == name else 0.0, abs=1e-9)


def test_signs_of_the_trunk(posed):
    """Backward is extension, to the right is bending, to the left is rotation."""
    for name, axis in {"extension": -LEFT, "bending": FORWARD, "rotation": UP}.items():
        up, front = Rotation.from_rotvec(0.1 * axis).apply([UP, FORWARD])
        shift = {"extension": -up @ FORWARD, "bending": -up @ LEFT, "rotation": front @ LEFT}[name]
        assert shift == pytest.approx(np.sin(0.1))
        assert posed("thorax", axis, 20.0)[f"waist_{name}"] == pytest.approx(20.0)


@pytest.mark.parametrize("joint", ["left_knee", "right_knee", "left_elbow", "right_elbow"])
def test_hinges_of_a_body_without_noise(exact, exported, joint):
    """The angle about the true axis to a tenth of a degree, up to its zero, the straight limb, within two degrees.

    The place of a hinge along its axis is not known, so the direction of a bone that ends there is not exact.
    """
    recording, truth, joints = exact
    motion = exported(recording, with_checks(joints, recording))
    number = truth.joints.index(joint)
    parent, child = (truth.segments.index(names[number]) for names in (truth.parents, truth.children))
    turns = np.einsum("tji,tjk->tik", truth.rotations[parent], truth.rotations[child])
    true = np.degrees(Rotation.from_matrix(turns).as_rotvec() @ truth.axes[number])
    true *= np.sign(np.median(true))
    found = joint_angles(motion)[f"{joint}_flexion"].to_numpy()
    np.testing.assert_allclose(found - np.median(found - true), true, atol=0.1)
    assert abs(np.median(found - true)) < 2.0


def test_unknown_frames(gappy):
    """An angle is missing where a segment is not known, or its error is large, and is there again afterwards."""
    table = joint_angles(gappy)
    unknown = np.isnan(gappy.skeleton.rotation("head")[0, 0])
    missing, flag, error = np.isnan(table["neck_rotation"]), table["neck_flag"], table["neck_rotation_error"]
    assert unknown.any()
    assert missing[unknown].all()
    every = table[[f"neck_{angle}" for angle in ("extension", "bending", "rotation")]].isna()
    np.testing.assert_array_equal(every.all(axis=1), flag == Flag.UNKNOWN)
    np.testing.assert_array_equal(missing, np.isnan(error))
    assert error.max() <= 10.0
    numbers = [gappy.skeleton.segments.index(name) for name in ("thorax", "head")]
    both = gappy.skeleton.segment_flags[numbers].max(axis=0)
    np.testing.assert_array_equal(flag[~missing], both[~missing])
    assert (flag == Flag.BRIDGED).any()
    assert error[flag == Flag.BRIDGED].median() > 2 * error[flag == Flag.SEEN].median()
    np.testing.assert_allclose(table["time"], np.arange(300) / 60.0)


def test_another_limit_of_errors(gappy):
    """With a smaller limit the angles below it stay as they are, and those above are missing."""
    table, strict = joint_angles(gappy), joint_angles(replace(gappy, largest_angle_error=1.5))
    name = "neck_rotation"
    above = (table[f"{name}_error"] > 1.5).to_numpy()
    assert 0.0 < above.mean() < 1.0
    kept = table[name].where(~above)
    np.testing.assert_array_equal(strict[name], kept)
    assert strict[f"{name}_error"].max() <= 1.5


def test_a_motion_file(gappy, tmp_path):
    """Its header counts its rows and columns; its rows have a number everywhere, the last known one in a gap."""
    table = joint_angles(gappy).dropna(axis=1, how="all")
    path = write_file(gappy, tmp_path / "walk.mot")
    head, _, rows = path.read_text().partition("endheader\n")
    assert head.splitlines()[1:] == ["version=1", "nRows=300", f"nColumns={table.shape[1]}", "inDegrees=yes"]
    found = pd.read_csv(tmp_path / "walk.mot", sep="\t", skiprows=6)
    assert rows.count("\n") == 301
    assert list(found.columns) == list(table.columns)
    assert not found.isna().any().any()
    np.testing.assert_allclose(found, table.ffill().bfill(), atol=1e-6)


def test_opensim_reads_it(motion, tmp_path):
    """The same numbers and labels by OpenSim, where it is installed."""
    opensim = pytest.importorskip("opensim", reason="needs the package opensim")
    path = write_file(motion, tmp_path / "walk.mot")
    shutil.copy(write_file(motion, tmp_path / "walk.trc"), tmp_path / "points.trc")
    opensim.Logger.setLevelString("off")
    table, wanted = opensim.TimeSeriesTable(str(path)), joint_angles(motion)
    assert ["time", *table.getColumnLabels()] == list(wanted.columns)
    assert table.getTableMetaDataString("inDegrees") == "yes"
    np.testing.assert_allclose(table.getMatrix().to_numpy(), wanted.iloc[:, 1:], atol=1e-6)
    storage = opensim.Storage(str(path))
    assert (storage.getSize(), storage.isInDegrees()) == (motion.skeleton.frames, True)
    points = opensim.TimeSeriesTableVec3(str(tmp_path / "points.trc"))
    assert points.getNumRows() == motion.skeleton.frames


def test_several_roots(figure, exported, chained):
    """A set of two roots, legs and trunk, is one tree: the second moves freely below the first, and is where it is."""
    cmu41, recording = load_markerset("cmu41"), figure[0].select(frames=slice(0, 300))
    parts = [s.model_copy(update={"parent": None}) if s.name == "thorax" else s for s in cmu41.segments]
    two = MarkerSet(name="two", segments=tuple(parts), joints=tuple(j for j in cmu41.joints if j.name != "waist"))
    motion = exported(recording, calibrate(recording, two))
    places = {}

    def place(node, turn, start):
        step = node.offset[:, None] if node.course is None else node.course
        places[node.name] = here = start + np.einsum("ijt,jt->it", turn, np.broadcast_to(step, start.shape))
        for child in node.children:
            place(child, np.einsum("ijt,jkt->ikt", turn, node.rotation), here)

    frames = recording.positions.shape[-1]
    place(joint_tree(motion), np.repeat(np.eye(3)[:, :, None], frames, axis=2), np.zeros((3, frames)))
    for joint in ("neck", "left_elbow", "right_knee"):
        np.testing.assert_allclose(places[joint], chained(motion)[joint], atol=1e-6, err_msg=joint)


def resting(path):
    """Places of a BVH file's joints and ends without rotations (3,), by bvhtoolbox; y up."""
    tree = BvhTree(path.read_text())
    places = {}
    for joint in tree.get_joints():
        parent = tree.joint_parent(joint.name)
        places[joint.name] = np.array(tree.joint_offset(joint.name))
        if parent is not None:
            places[joint.name] += places[parent.name]
        for end in joint.filter("End"):
            places[f"{joint.name} end"] = places[joint.name] + np.array([float(x) for x in end["OFFSET"]])
    return places


def direction(places, start, end):
    away = places[end] - places[start]
    return away / np.linalg.norm(away)


def test_t_pose(motion, tmp_path):
    """Arms sideways, legs down, hips level, head above the neck, toes in front of ankles; the body looks along z."""
    places = resting(write_file(motion, tmp_path / "walk.bvh"))
    x, y, _ = np.eye(3)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for bone in (("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "wrist end")):
            np.testing.assert_allclose(direction(places, *(f"{side}_{end}" for end in bone)), sign * x, atol=1e-4)
        for bone in (("hip", "knee"), ("knee", "ankle")):
            np.testing.assert_allclose(direction(places, *(f"{side}_{end}" for end in bone)), -y, atol=1e-4)
        toes = direction(places, f"{side}_ankle", f"{side}_ankle end")
        assert abs(toes[0]) < 1e-4
        assert toes[2] > 0.7
        assert sign * (places[f"{side}_hip"] - places["pelvis"])[0] > 0.05
    np.testing.assert_allclose(direction(places, "right_hip", "left_hip"), x, atol=1e-4)
    np.testing.assert_allclose(direction(places, "neck", "neck end"), y, atol=1e-4)
    assert direction(places, "waist", "neck")[1] > 0.99
    assert direction(places, "right_shoulder", "left_shoulder")[0] > 0.999


def test_t_pose_of_a_recording_with_y_up(motion, y_up, tmp_path):
    """The pose does not depend on the recording's axes."""
    places, others = (resting(write_file(each, tmp_path / "walk.bvh")) for each in (motion, y_up))
    for name in ("left_wrist end", "right_ankle end", "neck end"):
        np.testing.assert_allclose(places[name], others[name], atol=0.02)  # joints fitted to other frames


def test_rest_poses_differ_by_rotations_alone(motion, exported, figure_calibration):
    """Bones keep their lengths; in the recorded pose all segments have the axes of the recording."""
    made = {rest: exported(motion.recording, figure_calibration, rest=rest) for rest in RestPose}
    lengths = [[float(np.linalg.norm(node.offset)) for node in joint_tree(one).walk()] for one in made.values()]
    np.testing.assert_allclose(lengths, [lengths[0]] * len(lengths), atol=1e-12)
    recorded = made[RestPose.RECORDED]
    np.testing.assert_allclose(joint_tree(recorded).rotation, recorded.skeleton.rotations[0], atol=1e-12)
    assert all((rotation == np.eye(3)).all() for rotation in recorded.rest_rotations.values())


def test_standing_pose(figure_calibration):
    """Arms and legs of the standing pose hang."""
    standing = rest_rotations(figure_calibration, np.eye(3), RestPose.STANDING)
    joints = {place.joint.name: place for place in figure_calibration.joints}
    for side in ("left", "right"):
        for first, second in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle")):
            start, end = joints[f"{side}_{first}"], joints[f"{side}_{second}"]
            bone = standing[start.joint.child] @ (end.in_parent - start.in_child)
            np.testing.assert_allclose(bone / np.linalg.norm(bone), -UP, atol=1e-9)


def test_a_trunk_with_arms_and_legs_stands_between_all_of_them():
    """A root with hips, shoulders and a neck: both sides' mean joints are level, the neck is above the mean of all."""
    joints = {
        "neck": ("head", (5, 0, 50)),
        "left_hip": ("left_thigh", (-8, 10, 3)),
        "right_hip": ("right_thigh", (0, -9, 0)),
    }
    joints |= {"left_shoulder": ("left_arm", (4, 22, 46)), "right_shoulder": ("right_arm", (2, -20, 44))}
    parts = [Segment(name="trunk", markers=("A", "B", "C"))]
    parts += [Segment(name=child, markers=(f"{child} marker",), parent="trunk") for child, _ in joints.values()]
    made = [Joint(name=name, parent="trunk", child=child) for name, (child, _) in joints.items()]
    markerset = MarkerSet(name="trunk", segments=tuple(parts), joints=tuple(made))
    places = [JointPlace(joint, JointStatus.OK, "", in_parent=np.array(joints[joint.name][1]) / 100) for joint in made]
    shapes = [SegmentShape(part.name, (), np.zeros((0, 3)), np.zeros(0), False, "") for part in parts]
    calibration = Calibration("trunk", 10, markerset, tuple(shapes), tuple(places))
    turned = rest_rotations(calibration, np.eye(3), RestPose.STANDING)["trunk"]
    left, right, middle = np.array([[-2, 16, 24.5], [1, -14.5, 22], [-0.5, 0.75, 23.25]])
    np.testing.assert_allclose(turned @ (left - right), np.linalg.norm(left - right) * LEFT, atol=1e-12)
    up = turned @ (np.array([5, 0, 50]) - middle)
    assert up @ FORWARD == pytest.approx(0.0, abs=1e-12)
    assert up @ UP > 20.0


def test_twist_is_that_of_the_mean_pose(exact):
    """On a body whose joints are known exactly, knees of the T-pose bend backward: their axes point to the left."""
    recording, _, joints = exact
    calibration = with_checks(joints, recording)
    rest = rest_rotations(calibration, np.eye(3), RestPose.T_POSE)
    for place in calibration.joints:
        if place.joint.name in ("left_knee", "right_knee"):
            axis = rest[place.joint.parent] @ place.axis_in_parent
            assert abs(axis @ LEFT) > np.cos(np.radians(20.0))  # hips rotate about the thigh, by 35° at most


def test_a_segment_that_no_word_describes_keeps_its_mean_pose(figure_calibration):
    """Marker sets of users may call their segments as they like."""
    renamed = figure_calibration.markerset.model_dump_json().replace("left_hand", "left_racket")
    markerset = type(figure_calibration.markerset).model_validate_json(renamed)
    pairs = zip(figure_calibration.joints, markerset.joints, strict=True)
    places = tuple(replace(place, joint=joint) for place, joint in pairs)
    shapes = (replace(s, segment=s.segment.replace("left_hand", "left_racket")) for s in figure_calibration.shapes)
    calibration = replace(figure_calibration, markerset=markerset, joints=places, shapes=tuple(shapes))
    rest = rest_rotations(calibration, np.eye(3), RestPose.T_POSE)
    mean = next(place.mean_rotation for place in places if place.joint.child == "left_racket")
    np.testing.assert_allclose(rest["left_racket"], rest["left_forearm"] @ mean, atol=1e-12)
    usual = rest_rotations(figure_calibration, np.eye(3), RestPose.T_POSE)
    turned = Rotation.from_matrix(usual["left_hand"] @ rest["left_racket"].T).magnitude()
    assert 0.01 < turned < 2.0
