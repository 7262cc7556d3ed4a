"""Every format of skeletons: read back with another program's reader, whole or not at all, refused in one line."""

import csv
import warnings

import bvhtoolbox
import c3d
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from trc import TRCData

from study.mocap.export.write_files import WRITERS, planned_files, write_file
from study.mocap.io.recording import RecordingError


def by_c3d(path, motion, glb):
    """Joints by the library c3d."""
    with open(path, "rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about analog data
        reader = c3d.Reader(file)
        points = np.array([points for _, points, _ in reader.read_frames()])
        labels = [label.strip() for label in reader.point_labels]
    places = np.where(points[:, :, 3:4] < 0, np.nan, points[:, :, :3]) / 1000
    return dict(zip(labels, places.transpose(1, 2, 0), strict=True))


def by_trc(path, motion, glb):
    """Joints by the package trc-data-reader."""
    data = TRCData()
    data.load(path)
    assert (data["NumFrames"], data["Units"]) == (motion.skeleton.frames, "mm")
    return {label: np.array(data[label]).T / 1000 for label in data["Markers"]}


def by_bvhtoolbox(path, motion, glb):
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


def by_specification(path, motion, glb):
    """Joints of the animation by the equations of glTF's specification; y up."""
    document, array = glb(path)
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


def by_csv(path, motion, glb):
    """Joints by Python's reader of CSV."""
    places = {name: np.full((3, motion.skeleton.frames), np.nan) for name in motion.skeleton.joints}
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            if row["known"] != "unknown":
                places[row["joint"]][:, int(row["frame"]) - 1] = [float(row[axis]) for axis in "xyz"]
    return places


READERS = {".c3d": by_c3d, ".trc": by_trc, ".bvh": by_bvhtoolbox, ".glb": by_specification, ".csv": by_csv}
"""Readers of joints' places (3, frames), metres, z up, by the end of a file's name."""
WITHOUT_PLACES = {".mot"}
"""Formats that hold no places; they have tests of their own."""


def test_every_format_has_a_reader():
    assert set(READERS) | WITHOUT_PLACES == set(WRITERS)


@pytest.mark.parametrize("suffix", READERS)
def test_another_reader_finds_the_joints_where_the_table_has_them(motion, tmp_path, glb, suffix):
    """Every joint of every frame within a hundredth of a millimetre."""
    places = READERS[suffix](write_file(motion, tmp_path / f"walk{suffix}"), motion, glb)
    for name, center in zip(motion.scene.joints, motion.scene.centers, strict=True):
        np.testing.assert_allclose(places[name], center, rtol=0, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("suffix", READERS)
def test_frames_without_markers(gappy, tmp_path, glb, suffix):
    """Where a joint is known it is right; where not, points are missing and hierarchies keep their pose."""
    places = READERS[suffix](write_file(gappy, tmp_path / f"walk{suffix}"), gappy, glb)
    held = suffix in (".bvh", ".glb")
    for name, center in zip(gappy.scene.joints, gappy.scene.centers, strict=True):
        known = ~np.isnan(center[0])
        np.testing.assert_allclose(places[name][:, known], center[:, known], rtol=0, atol=1e-5, err_msg=name)
        assert (~np.isnan(places[name][0, ~known]) == held).all()


@pytest.mark.parametrize("suffix", [".bvh", ".glb", ".csv"])
def test_a_recording_with_y_up(y_up, tmp_path, glb, suffix):
    """Formats that say which way is up have the body upright."""
    places = READERS[suffix](write_file(y_up, tmp_path / f"walk{suffix}"), y_up, glb)
    for name, center in zip(y_up.scene.joints, y_up.scene.centers, strict=True):
        np.testing.assert_allclose(places[name], center, rtol=0, atol=1e-5, err_msg=name)
    assert (places["neck"][2] > places["left_ankle"][2]).mean() > 0.9


@pytest.mark.parametrize("suffix", WRITERS)
def test_the_same_bytes_twice_and_nothing_else_in_the_folder(motion, tmp_path, suffix):
    once, twice = (write_file(motion, tmp_path / "new" / f"{name}{suffix}") for name in ("a", "b"))
    assert once.read_bytes() == twice.read_bytes()
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == [f"a{suffix}", f"b{suffix}"]


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_name_in_capitals(motion, tmp_path, suffix):
    assert write_file(motion, tmp_path / f"WALK{suffix.upper()}").stat().st_size > 1000


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_file_that_cannot_be_written(motion, tmp_path, suffix):
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match=rf"file/walk{suffix}: cannot be written: ") as caught:
        write_file(motion, tmp_path / "file" / f"walk{suffix}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".bvh", ".glb"])
def test_a_hierarchy_without_its_root(figure, figure_calibration, exported, tmp_path, suffix):
    """A recording without a pelvis is refused in one line, and an older file of the name stays."""
    recording = figure[0].select(frames=slice(0, 60))
    rest = recording.select([marker for marker in recording.markers if marker[1:] not in ("FWT", "BWT")])
    path = tmp_path / f"none{suffix}"
    path.write_text("older")
    with pytest.raises(RecordingError, match="its pelvis is known in no frame"):
        write_file(exported(rest, figure_calibration), path)
    assert path.read_text() == "older"
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_planned_files(tmp_path):
    """Names of files stay; ends alone are files in the folder of the results."""
    source = tmp_path / "walk.c3d"
    source.touch()
    plan = planned_files("a/b.trc, glb,MOT", tmp_path / "out", "walk", source)
    assert [str(path) for path in plan] == ["a/b.trc", f"{tmp_path}/out/walk.glb", f"{tmp_path}/out/walk.MOT"]
    assert planned_files("", tmp_path, "walk", source) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("walk.fbx", r"--write walk.fbx: the end .* known are .c3d \(markers and joint centres\), .*, .csv \("),
        ("walk", "--write walk: the end of a file's name decides its format"),
        ("c3d", "--write c3d: is the recording itself, which is not overwritten"),
        ("trc,trc", "--write trc: is given twice"),
        ("folder.csv", "folder.csv is a folder"),
    ],
)
def test_files_that_are_refused_before_any_work(tmp_path, monkeypatch, text, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk.c3d").touch()
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(RecordingError, match=words) as caught:
        planned_files(text, tmp_path, "walk", tmp_path / "walk.c3d")
    assert "\n" not in str(caught.value)


def test_a_link_to_the_recording_is_the_recording(tmp_path):
    source = tmp_path / "walk.c3d"
    source.touch()
    (tmp_path / "link.c3d").symlink_to(source)
    with pytest.raises(RecordingError, match="is the recording itself"):
        planned_files(str(tmp_path / "link.c3d"), tmp_path, "walk", source)
