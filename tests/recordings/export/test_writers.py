"""Joint centres beside the markers of a recording: the rest of its C3D file stays, labels do not collide.

Every format of skeletons: read back with another program's reader, whole or not at all, refused in one line.

glTF: Khronos' validator where it is installed, another library's reader, and the specification's rules by hand.
"""

import csv
import json
import shutil
import struct
import subprocess
import sys
import warnings
from dataclasses import replace

import bvhtoolbox
import c3d
import ezc3d
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from trc import TRCData

from study.recordings.export import WRITERS, planned_files, write_file
from study.recordings.formats.read import read_recording
from study.recordings.formats.write import write_recording
from study.recordings.recording import Recording, RecordingError
from study.recordings.synthetic.make import Recipe, synthesize


@pytest.fixture
def rich(motion, tmp_path, write_rich):
    """A C3D file of the motion's markers with more than markers in it."""
    return write_rich(motion.recording, tmp_path / "rich.c3d")


def test_all_else_in_the_file_stays(motion, exported, figure_calibration, rich, tmp_path):
    """Markers, analog channels, events and parameters are the same to single precision."""
    recording = read_recording(rich)
    out = write_file(exported(recording, figure_calibration, source=rich), tmp_path / "out.c3d")
    before, after = ezc3d.c3d(str(rich)), ezc3d.c3d(str(out))
    count = len(recording.markers)
    np.testing.assert_allclose(after["data"]["points"][:, :count], before["data"]["points"], rtol=1e-6)
    np.testing.assert_allclose(after["data"]["analogs"], before["data"]["analogs"], rtol=1e-5, atol=1e-6)
    labels = after["parameters"]["POINT"]["LABELS"]["value"]
    assert labels == [*before["parameters"]["POINT"]["LABELS"]["value"], *motion.skeleton.joints]
    for group, name in (("EVENT", "LABELS"), ("EVENT", "TIMES"), ("ANALOG", "LABELS"), ("FORCE_PLATFORM", "TYPE")):
        one, other = (file["parameters"][group][name]["value"] for file in (before, after))
        np.testing.assert_array_equal(one, other)
    for name, center in zip(motion.skeleton.joints, motion.skeleton.centers, strict=True):
        np.testing.assert_allclose(after["data"]["points"][:3, labels.index(name)], 1000 * center, atol=1e-2)


def test_markers_read_in_another_unit(motion, exported, figure_calibration, rich, tmp_path):
    """If the file's own unit was overruled, its numbers cannot stand beside joints: the markers are written anew."""
    other = read_recording(rich)
    scaled = replace(other, positions=0.1 * other.positions)
    own = exported(other, figure_calibration, source=rich)
    assert ezc3d.c3d(str(write_file(own, tmp_path / "one.c3d")))["data"]["analogs"].size
    out = write_file(replace(own, recording=scaled), tmp_path / "two.c3d")
    assert not ezc3d.c3d(str(out))["data"]["analogs"].size
    np.testing.assert_allclose(read_recording(out).of("LFHD"), scaled.of("LFHD"), atol=1e-6)


@pytest.mark.parametrize("name", ["rich.trc", "none.c3d", "broken.c3d"])
def test_a_source_that_is_no_c3d_file(motion, exported, figure_calibration, tmp_path, name):
    """The markers are written from the recording."""
    source = tmp_path / name
    if name != "none.c3d":
        source.write_bytes(b"\x02\x50" + bytes(range(256)) * 20)
    out = write_file(exported(motion.recording, figure_calibration, source=source), tmp_path / "out.c3d")
    found = read_recording(out)
    np.testing.assert_allclose(found.of("LFHD"), motion.recording.of("LFHD"), atol=1e-6)
    np.testing.assert_allclose(found.of("neck"), motion.skeleton.center("neck"), atol=1e-6)


def test_a_marker_with_the_name_of_a_joint(motion, exported, figure_calibration):
    """Both are there, and the joint says that it is one."""
    recording = motion.recording
    markers = tuple("Left_Hip" if name == "RBAC" else name for name in recording.markers)
    other = exported(Recording("same", markers, recording.positions, recording.rate), figure_calibration)
    labels = other.with_joints().markers
    assert len(set(map(str.lower, labels))) == len(labels)
    assert "left_hip_joint" in labels
    np.testing.assert_array_equal(other.with_joints().of("left_hip_joint"), other.skeleton.center("left_hip"))


COMPONENTS = {5126: ("<f4", 4), 5121: ("u1", 1), 5123: ("<u2", 2)}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def read_glb(path):
    """Parse a binary glTF file by its specification: the document, and a function for the array of an accessor."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    document = json.loads(data[20 : 20 + size])
    rest, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert kind == b"BIN\0"
    assert 28 + size + rest == len(data)

    def array(number):
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        kind, _ = COMPONENTS[accessor["componentType"]]
        width = WIDTHS[accessor["type"]]
        start = 28 + size + view["byteOffset"] + accessor.get("byteOffset", 0)
        return np.frombuffer(data, kind, accessor["count"] * width, start).reshape(-1, width)

    return document, array


def by_c3d(path, motion):
    """Joints by the library c3d."""
    with open(path, "rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about analog data
        reader = c3d.Reader(file)
        points = np.array([points for _, points, _ in reader.read_frames()])
        labels = [label.strip() for label in reader.point_labels]
        assert (reader.point_rate, reader.get_string("POINT:UNITS").strip()) == (motion.skeleton.rate, "mm")
    places = np.where(points[:, :, 3:4] < 0, np.nan, points[:, :, :3]) / 1000
    return dict(zip(labels, places.transpose(1, 2, 0), strict=True))


def by_trc(path, motion):
    """Joints by the package trc-data-reader."""
    data = TRCData()
    data.load(path)
    assert (data["NumFrames"], data["DataRate"], data["Units"]) == (motion.skeleton.frames, motion.skeleton.rate, "mm")
    np.testing.assert_allclose(data["Time"], np.arange(motion.skeleton.frames) / motion.skeleton.rate, atol=1e-6)
    return {label: np.array(data[label]).T / 1000 for label in data["Markers"]}


def by_bvhtoolbox(path, motion):
    """Joints by bvhtoolbox, which has y up."""
    tree = bvhtoolbox.BvhTree(path.read_text())
    assert tree.nframes == motion.skeleton.frames
    assert tree.frame_time == pytest.approx(1.0 / motion.skeleton.rate, rel=1e-9)
    world, places = {}, {}
    for joint in tree.get_joints():
        axes = "".join(channel[0] for channel in tree.joint_channels(joint.name) if channel.endswith("rotation"))
        local = bvhtoolbox.get_affines(tree, joint.name, axes="r" + axes.lower())
        if len(tree.joint_channels(joint.name)) == 3:  # position channels stand in place of the offset
            local[:, :3, 3] = tree.joint_offset(joint.name)
        parent = tree.joint_parent(joint.name)
        world[joint.name] = local if parent is None else world[parent.name] @ local
        x, y, z = world[joint.name][:, :3, 3].T
        places[joint.name] = np.stack([x, -z, y])
    return places


def by_specification(path, motion):
    """Joints of the animation by the equations of glTF's specification; y up."""
    document, array = read_glb(path)
    nodes, (animation,) = document["nodes"], document["animations"]
    frames = motion.skeleton.frames
    turns = [np.tile(np.eye(3), (frames, 1, 1)) for _ in nodes]
    places = [np.tile(node.get("translation", [0.0] * 3), (frames, 1)) for node in nodes]
    for channel in animation["channels"]:
        sampler, target = animation["samplers"][channel["sampler"]], channel["target"]
        np.testing.assert_allclose(array(sampler["input"])[:, 0], np.arange(frames) / motion.skeleton.rate, rtol=1e-6)
        values = array(sampler["output"]).astype(float)
        if target["path"] == "rotation":
            turns[target["node"]] = Rotation.from_quat(values).as_matrix()
        else:
            places[target["node"]] = values
    for number, node in enumerate(nodes):  # parents come before their children
        for child in node.get("children", []):
            assert child > number
            places[child] = places[number] + np.einsum("tij,tj->ti", turns[number], places[child])
            turns[child] = turns[number] @ turns[child]
    return {node["name"]: (place[:, [0, 2, 1]] * [1, -1, 1]).T for node, place in zip(nodes, places, strict=True)}


def by_csv(path, motion):
    """Joints by Python's reader of CSV."""
    places = {name: np.full((3, motion.skeleton.frames), np.nan) for name in motion.skeleton.joints}
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            if row["known"] != "unknown":
                places[row["joint"]][:, int(row["frame"]) - 1] = [float(row[axis]) for axis in "xyz"]
    return places


READERS = {".c3d": by_c3d, ".trc": by_trc, ".bvh": by_bvhtoolbox, ".glb": by_specification, ".csv": by_csv}
"""Readers of joints' places (3, frames), metres, z up, by the end of a file's name."""

UPRIGHT, HELD = (".bvh", ".glb", ".csv"), (".bvh", ".glb")
"""Formats that say which way is up, and those that cannot mark a pose as unknown."""
WITHOUT_PLACES = {".mot"}
"""Formats that hold no places; they have tests of their own."""


def test_every_format_has_a_reader():
    assert set(READERS) | WITHOUT_PLACES == set(WRITERS)


@pytest.mark.parametrize(
    ("made", "suffix"),
    [
        (made, suffix)
        for made in ("motion", "gappy", "y_up")
        for suffix in READERS
        if made != "y_up" or suffix in UPRIGHT
    ],
)
def test_another_reader_finds_the_joints_where_the_table_has_them(request, tmp_path, chained, made, suffix):
    """Every joint of every frame within a hundredth of a millimetre; upright where the format says which way is up.

    Where a joint is not known, points are missing and hierarchies keep their pose. The bones of hierarchies are rigid:
    their joints are where the rotations and these bones put them, and off the table by no more than the gaps add up to.
    """
    motion = request.getfixturevalue(made)
    places, rigid = READERS[suffix](write_file(motion, tmp_path / f"walk{suffix}"), motion), chained(motion)
    for name, center in zip(motion.scene.joints, motion.scene.centers, strict=True):
        known = ~np.isnan(center[0])
        assert (~np.isnan(places[name][0, ~known]) == (suffix in HELD)).all()
        if suffix in HELD:
            off = np.linalg.norm(places[name] - center, axis=0)
            assert np.sqrt((off[known] ** 2).mean()) < np.nansum(motion.skeleton.gaps), name
            center, known = rigid[name], ~np.isnan(rigid[name][0])
        np.testing.assert_allclose(places[name][:, known], center[:, known], rtol=0, atol=1e-5, err_msg=name)
    assert (places["neck"][2] > places["left_ankle"][2]).mean() > 0.9 or made == "gappy"


@pytest.mark.parametrize("suffix", WRITERS)
def test_the_same_bytes_twice_and_nothing_else_in_the_folder(motion, one_line, tmp_path, suffix):
    """The name may be in capitals; a file in the folder's place is refused in one line."""
    names = [f"a{suffix}", f"b{suffix.upper()}"]
    once, twice = (write_file(motion, tmp_path / "new" / name).read_bytes() for name in names)
    assert once == twice
    assert len(once) > 1000
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == names
    (tmp_path / "file").touch()
    with one_line(RecordingError, rf"file/walk{suffix}: cannot be written: "):
        write_file(motion, tmp_path / "file" / f"walk{suffix}")


def test_the_residual_of_an_unknown_joint(gappy, rich, exported, figure_calibration, tmp_path):
    """Beside the points of a C3D file it is -1 where the joint is unknown, and 0 elsewhere."""
    recording = read_recording(rich)
    positions = recording.positions.copy()
    positions[:, :, 20:30] = np.nan
    own = exported(replace(recording, positions=positions), figure_calibration, source=rich)
    file = ezc3d.c3d(str(write_file(own, tmp_path / "out.c3d")))
    assert file["data"]["analogs"].size
    count = len(recording.markers)
    wanted = np.where(np.isnan(own.skeleton.centers[:, 0]), -1.0, 0.0)
    assert (wanted == -1.0).any()
    np.testing.assert_array_equal(file["data"]["meta_points"]["residuals"][0, count:], wanted)


WITHOUT_EZC3D = """
import sys
sys.modules["ezc3d"] = None
sys.argv = ["study", *sys.argv[1:]]
from study.cli import main
main()
"""


def test_other_formats_need_no_library_of_c3d(motion, one_line, tmp_path, monkeypatch):
    """Where ezc3d cannot be imported, a recording and all formats but C3D are written; C3D names what it needs."""
    recording, _ = synthesize(Recipe(300, 100.0))
    write_recording(recording, tmp_path / "walk.csv")
    formats = ",".join(suffix[1:] for suffix in WRITERS if suffix != ".c3d")
    command = [sys.executable, "-c", WITHOUT_EZC3D, "skeleton", "walk.csv", "--out", "out", "--write", formats]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with one_line(RecordingError, r"out/walk\.c3d: writing it needs ezc3d: pip install '\.\[mocap\]'"):
        write_file(motion, tmp_path / "out" / "walk.c3d")
    assert {path.suffix for path in (tmp_path / "out").glob("walk.*")} == set(WRITERS) - {".c3d"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("walk.fbx", r"--write walk.fbx: the end .* known are .c3d \(markers and joint centres\), .*, .csv \("),
        ("walk", "--write walk: the end of a file's name decides its format"),
        ("c3d", "--write c3d: is the recording itself, which is not overwritten"),
        ("link.c3d", "is the recording itself"),
        ("trc,trc", "--write trc: is given twice"),
        ("folder.csv", "folder.csv is a folder"),
    ],
)
def test_files_that_are_refused_before_any_work(tmp_path, monkeypatch, one_line, text, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk.c3d").touch()
    (tmp_path / "link.c3d").symlink_to(tmp_path / "walk.c3d")
    (tmp_path / "folder.csv").mkdir()
    with one_line(RecordingError, words):
        planned_files(text, tmp_path, "walk", tmp_path / "walk.c3d")


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
    bones = (("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"))
    arms = [np.linalg.norm(motion.skeleton.center(a) - motion.skeleton.center(b), axis=0) for a, b in bones]
    assert min(high[0], -low[0]) > np.median(arms, axis=1).sum()  # from the pelvis, with half the shoulders and a hand
    assert 0.9 < high[1] - low[1] < 1.9
    assert len(mesh.faces) == 8 * 19  # bones to 14 joints, and to the ends of the head, two hands and two feet
    assert mesh.is_watertight
    assert mesh.volume > 0  # triangles face outward


def test_rules_of_the_specification(gappy, tmp_path):
    """The skin's matrices undo the rest pose, each vertex has one bone, times rise, quaternions have length 1."""
    document, array = read_glb(write_file(gappy, tmp_path / "walk.glb"))
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


def test_errors_and_doubts(doubted, tmp_path):
    """A node has its joint's error and doubt; bones of a doubted joint have a colour of their own."""
    document, array = read_glb(write_file(doubted, tmp_path / "walk.glb"))
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
