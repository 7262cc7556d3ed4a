"""What is printed and stored of joints and skeletons."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from study.mocap.joints.joint_report import agreement_lines, joint_lines
from study.mocap.skeleton.skeleton_table import bone_table, skeleton_lines, skeleton_table


def test_a_row_per_frame_and_joint(scene):
    """Rows are the scene's, frame by frame."""
    table = skeleton_table(scene)
    assert len(table) == 90 * len(scene.joints)
    row = table[(table["frame"] == 46) & (table["joint"] == scene.joints[3])].iloc[0]
    assert row["time"] == 0.5
    assert row["known"] == "bridged"
    assert np.array_equal(row[["x", "y", "z"]].to_numpy(float), scene.centers[3, :, 45])


def test_bones(scene):
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


def test_uneven_bones_are_said(scene):
    """A shin that is a tenth longer than the other is marked, and the other too."""
    centers = scene.centers.copy()
    knee, ankle = scene.joints.index("left_knee"), scene.joints.index("left_ankle")
    centers[ankle] = centers[knee] + 1.1 * (centers[ankle] - centers[knee])
    lines = list(skeleton_lines(replace(scene, centers=centers)))
    marked = [line for line in lines if line.endswith("uneven")]
    assert [line.split("  ")[0] for line in marked] == ["left_knee - left_ankle", "right_knee - right_ankle"]
    assert "+9.5 %" in marked[0]
    assert any(line.startswith("neck: not reliable: moved too little") for line in lines)
    assert any(line == f"{scene.joints[3]}: bridged in 11.1% of the frames" for line in lines)
    assert lines[-1] == "note: right_wrist is not shown: known in no frame"


def test_one_joint_has_no_bones(scene):
    """Without bones between joints there is an empty table, and its head."""
    assert list(bone_table(replace(scene, bones=())).columns) == ["start", "end", "length", "spread", "error", "uneven"]
    assert next(skeleton_lines(replace(scene, bones=()))).startswith("bone")


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
