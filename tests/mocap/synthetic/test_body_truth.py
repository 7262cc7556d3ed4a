import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.io.recording import RecordingError
from study.mocap.synthetic.body_truth import write_truth
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize


def test_truth_beside_it(tmp_path):
    """There is a row per joint, and one per frame and joint; the segment poses give each joint its true place."""
    _, truth = synthesize(Recipe(frames=20))
    paths = write_truth(truth, tmp_path / "walk.c3d")
    assert [path.name for path in paths] == ["walk.joints.parquet", "walk.truth.parquet"]
    joints, poses = map(pd.read_parquet, paths)
    assert list(joints.joint) == list(truth.joints)
    assert (joints.kind == "hinge").sum() == 4
    knee = joints.set_index("joint").loc["left_knee"]
    assert (knee.parent, knee.child, knee.bone_from) == ("left_thigh", "left_shank", "left_hip")
    assert knee.bone_length == pytest.approx(0.245 * 1.75)
    assert joints.bone_length.isna().sum() == 3, "from the pelvis to what hangs on it there is no bone"
    assert len(poses) == 14 * 20
    hip, knee_path = (poses[poses.joint == name].sort_values("frame") for name in ("left_hip", "left_knee"))
    turn = Rotation.from_rotvec(hip[["turn_x", "turn_y", "turn_z"]].to_numpy().copy())
    there = hip[["center_x", "center_y", "center_z"]].to_numpy() + turn.apply(
        knee[["center_x", "center_y", "center_z"]].to_numpy(dtype=float)
    )
    np.testing.assert_allclose(knee_path[["center_x", "center_y", "center_z"]].to_numpy(), there, atol=1e-12)


def test_the_same_bytes_twice(tmp_path):
    _, truth = synthesize(Recipe(frames=30))
    once, twice = (tuple(path.read_bytes() for path in write_truth(truth, tmp_path / f"{i}.c3d")) for i in "ab")
    assert once == twice


def test_where_nothing_can_be_written(tmp_path):
    _, truth = synthesize(Recipe(frames=2))
    with pytest.raises(RecordingError, match="cannot be written"):
        write_truth(truth, tmp_path / "none" / "walk.c3d")
