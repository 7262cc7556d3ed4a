"""glTF: Khronos' validator where it is installed, another library's reader, and the specification's rules by hand."""

import json
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from study.mocap.export.write_files import write_file

VALIDATE = """
const validator = require("gltf-validator"), fs = require("fs");
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1]))).then(
  report => console.log(JSON.stringify(report)));
"""


def validated(path):
    """The report of Khronos' validator; the test is skipped without it."""
    node = shutil.which("node")
    here = path.parent
    found = node and subprocess.run([node, "-e", "require('gltf-validator')"], cwd=here, capture_output=True)
    if not node or found.returncode:
        pytest.skip("needs node and its package gltf-validator where NODE_PATH finds it")
    done = subprocess.run([node, "-e", VALIDATE, str(path)], cwd=here, capture_output=True, check=True)
    return json.loads(done.stdout)


@pytest.fixture
def doubted(motion):
    """The motion with a doubtful elbow, and a head that moves freely."""
    doubts = ["moved too little" if name == "left_elbow" else "" for name in motion.scene.joints]
    return replace(motion, scene=replace(motion.scene, doubts=tuple(doubts)))


def test_the_validator_finds_nothing(motion, gappy, doubted, tmp_path):
    for number, each in enumerate((motion, gappy, doubted)):
        report = validated(write_file(each, tmp_path / f"{number}.glb"))
        assert report["issues"]["messages"] == []
        assert report["info"]["hasSkins"]
        assert report["info"]["animationCount"] == 1


def test_another_library_reads_the_bones_in_a_t_pose(motion, tmp_path):
    """trimesh, which knows no skins: the mesh is as wide as the arms, along x."""
    scene = trimesh.load(write_file(motion, tmp_path / "walk.glb"))
    (mesh,) = scene.geometry.values()
    low, high = mesh.bounds
    widths = {name: np.median(length) for name, length in _arms(motion).items()}
    assert high[0] > sum(widths.values())  # from the pelvis, with half the shoulders and a hand
    assert -low[0] > sum(widths.values())
    assert 0.9 < high[1] - low[1] < 1.9
    assert len(mesh.faces) == 8 * 19  # bones to 14 joints, and to the ends of the head, two hands and two feet
    assert mesh.is_watertight
    assert mesh.volume > 0  # triangles face outward


def _arms(motion):
    pairs = {"upper": ("left_shoulder", "left_elbow"), "fore": ("left_elbow", "left_wrist")}
    return {
        name: np.linalg.norm(motion.skeleton.center(a) - motion.skeleton.center(b), axis=0)
        for name, (a, b) in pairs.items()
    }


def test_rules_of_the_specification(gappy, tmp_path, glb):
    """The skin's matrices undo the rest pose, each vertex has one bone, times rise, quaternions have length 1."""
    document, array = glb(write_file(gappy, tmp_path / "walk.glb"))
    (skin,), (mesh,), (animation,) = document["skins"], document["meshes"], document["animations"]
    nodes = document["nodes"]
    places = {0: np.array(nodes[0]["translation"])}
    for number, node in enumerate(nodes):
        places |= {child: places[number] + nodes[child]["translation"] for child in node.get("children", [])}
    inverse = array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    for joint, matrix in zip(skin["joints"], inverse, strict=True):
        wanted = np.eye(4)
        wanted[:3, 3] = -places[joint]
        np.testing.assert_allclose(matrix, wanted, atol=1e-6)
    for primitive in mesh["primitives"]:
        joints, weights = (array(primitive["attributes"][name]) for name in ("JOINTS_0", "WEIGHTS_0"))
        assert (weights == [1, 0, 0, 0]).all()
        assert joints.max() < len(skin["joints"])
        corners = array(primitive["attributes"]["POSITION"])
        assert array(primitive["indices"]).max() < len(corners)
        start = corners[np.flatnonzero(joints[:, 0] == 1)[0]]  # a bone starts at its joint
        np.testing.assert_allclose(start, places[1], atol=1e-6)
    for sampler in animation["samplers"]:
        assert (np.diff(array(sampler["input"])[:, 0]) > 0).all()
    for channel in animation["channels"]:
        if channel["target"]["path"] == "rotation":
            values = array(animation["samplers"][channel["sampler"]]["output"])
            np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1.0, atol=1e-6)
            assert ((values[1:] * values[:-1]).sum(axis=1) > 0).all()
    assert document["scenes"][document["scene"]]["nodes"] == [0, len(nodes) - 1]


def test_errors_and_doubts(doubted, tmp_path, glb):
    """A node has its joint's error and doubt; bones of a doubted joint have a colour of their own."""
    document, array = glb(write_file(doubted, tmp_path / "walk.glb"))
    nodes = {node["name"]: node for node in document["nodes"]}
    for name, errors in zip(doubted.scene.joints, doubted.scene.errors, strict=True):
        assert nodes[name]["extras"]["error"] == pytest.approx(np.nanmax(errors), abs=1e-6)
    assert nodes["left_elbow"]["extras"]["doubt"] == "moved too little"
    assert "doubt" not in nodes["right_elbow"]["extras"]
    plain, marked = document["meshes"][0]["primitives"]
    assert document["materials"][marked["material"]]["name"] == "bone of an unreliable joint"
    moved_by = array(marked["attributes"]["JOINTS_0"])[array(marked["indices"])[:, 0], 0]
    assert {document["nodes"][number]["name"] for number in moved_by} == {"left_elbow"}
    assert document["materials"][plain["material"]]["name"] == "bone"
