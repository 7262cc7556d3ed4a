import numpy as np
import pytest
from bvhtoolbox import BvhTree
from scipy.spatial.transform import Rotation

from study.mocap.export.joint_tree import joint_tree
from study.mocap.export.rest_pose import RestPose, rest_rotations
from study.mocap.export.write_files import write_file

LEFT, FORWARD, UP = np.array([1.0, 0, 0]), np.array([0, -1.0, 0]), np.array([0, 0, 1.0])


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


def test_bones_keep_their_lengths(motion, exported, figure_calibration):
    """Rest poses differ by rotations alone."""
    lengths = {}
    for rest in RestPose:
        nodes = list(joint_tree(exported(motion.recording, figure_calibration, rest=rest)).walk())
        lengths[rest] = [float(np.linalg.norm(node.offset)) for node in nodes]
    np.testing.assert_allclose(lengths[RestPose.T_POSE], lengths[RestPose.STANDING], atol=1e-12)
    np.testing.assert_allclose(lengths[RestPose.T_POSE], lengths[RestPose.RECORDED], atol=1e-12)


def test_recorded_pose(motion, exported, figure_calibration):
    """All segments have the axes of the recording: rotations are those of the segments."""
    recorded = exported(motion.recording, figure_calibration, rest=RestPose.RECORDED)
    root = joint_tree(recorded)
    np.testing.assert_allclose(root.rotation, recorded.skeleton.rotations[0], atol=1e-12)
    assert all((rotation == np.eye(3)).all() for rotation in recorded.rest_rotations.values())


def test_standing_pose(figure_calibration):
    """Arms and legs of the standing pose hang; the segments' rotations are rotations."""
    standing = rest_rotations(figure_calibration, np.eye(3), RestPose.STANDING)
    for rotation in standing.values():
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
    joints = {place.joint.name: place for place in figure_calibration.joints}
    for side in ("left", "right"):
        for first, second in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle")):
            start, end = joints[f"{side}_{first}"], joints[f"{side}_{second}"]
            bone = standing[start.joint.child] @ (end.in_parent - start.in_child)
            np.testing.assert_allclose(bone / np.linalg.norm(bone), -UP, atol=1e-9)


def test_twist_is_that_of_the_mean_pose(exact):
    """On a body whose joints are known exactly, knees of the T-pose bend backward: their axes point to the left."""
    from study.mocap.skeleton.calibrate import calibration_from

    recording, _, joints = exact
    calibration = calibration_from(joints, recording)
    rest = rest_rotations(calibration, np.eye(3), RestPose.T_POSE)
    for place in calibration.joints:
        if place.joint.name in ("left_knee", "right_knee"):
            axis = rest[place.joint.parent] @ place.axis_in_parent
            assert abs(axis @ LEFT) > np.cos(np.radians(20.0))  # hips rotate about the thigh, by 35° at most


def test_a_segment_that_no_word_describes_keeps_its_mean_pose(figure_calibration):
    """Marker sets of users may call their segments as they like."""
    from dataclasses import replace

    renamed = figure_calibration.markerset.model_dump_json().replace("left_hand", "left_racket")
    markerset = type(figure_calibration.markerset).model_validate_json(renamed)
    places = tuple(
        replace(place, joint=joint) for place, joint in zip(figure_calibration.joints, markerset.joints, strict=True)
    )
    shapes = tuple(
        replace(shape, segment=shape.segment.replace("left_hand", "left_racket")) for shape in figure_calibration.shapes
    )
    calibration = replace(figure_calibration, markerset=markerset, joints=places, shapes=shapes)
    rest = rest_rotations(calibration, np.eye(3), RestPose.T_POSE)
    mean = next(place.mean_rotation for place in places if place.joint.child == "left_racket")
    np.testing.assert_allclose(rest["left_racket"], rest["left_forearm"] @ mean, atol=1e-12)
    usual = rest_rotations(figure_calibration, np.eye(3), RestPose.T_POSE)
    turned = Rotation.from_matrix(usual["left_hand"] @ rest["left_racket"].T).magnitude()
    assert 0.01 < turned < 2.0
