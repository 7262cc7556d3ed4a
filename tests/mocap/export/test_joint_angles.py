import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.export.joint_angles import joint_angles
from study.mocap.export.rest_pose import RestPose, rest_rotations
from study.mocap.export.write_files import write_file
from study.mocap.skeleton.calibrate import calibration_from

SIDES = {"left": 1.0, "right": -1.0}
LEFT, FORWARD, UP = np.array([1.0, 0, 0]), np.array([0, -1.0, 0]), np.array([0, 0, 1.0])


@pytest.fixture(scope="module")
def known(exact, exported):
    """A body without noise, and the truth about it."""
    recording, truth, joints = exact
    return exported(recording, calibration_from(joints, recording)), truth


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
        still = replace(
            motion.skeleton, rotations=rotations, origins=motion.skeleton.origins[..., :1], centers=np.zeros((14, 3, 1))
        )
        return joint_angles(replace(motion, skeleton=still)).iloc[0]

    return pose


def test_standing_is_zero(posed):
    """All joints of the standing pose have the angle zero, and the pelvis is upright."""
    row = posed("none", UP, 0.0).drop(["time", "pelvis_tx", "pelvis_ty", "pelvis_tz", "pelvis_rotation"])
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
        shift = {"flexion": down @ FORWARD, "adduction": -sign * (down @ LEFT), "rotation": -sign * (front @ LEFT)}[
            name
        ]
        assert shift == pytest.approx(np.sin(0.1))
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
def test_hinges_of_a_body_without_noise(known, joint):
    """The angle about the true axis to a tenth of a degree, up to its zero, the straight limb, within two degrees.

    The place of a hinge along its axis is not known, so the direction of a bone that ends there is not exact.
    """
    motion, truth = known
    number = truth.joints.index(joint)
    parent, child = (truth.segments.index(names[number]) for names in (truth.parents, truth.children))
    turns = np.einsum("tji,tjk->tik", truth.rotations[parent], truth.rotations[child])
    true = np.degrees(Rotation.from_matrix(turns).as_rotvec() @ truth.axes[number])
    true *= np.sign(np.median(true))
    found = joint_angles(motion)[f"{joint}_flexion"].to_numpy()
    np.testing.assert_allclose(found - np.median(found - true), true, atol=0.1)
    assert abs(np.median(found - true)) < 2.0


def test_unknown_frames(gappy):
    """An angle is missing where one of its segments is not known, and is there again afterwards."""
    table = joint_angles(gappy)
    unknown = np.isnan(gappy.skeleton.rotation("head")[0, 0])
    assert unknown.any()
    np.testing.assert_array_equal(np.isnan(table["neck_rotation"]), unknown)
    np.testing.assert_allclose(table["time"], np.arange(300) / 60.0)


def test_a_motion_file(gappy, tmp_path):
    """Its header counts its rows and columns; its rows have a number everywhere, the last known one in a gap."""
    table = joint_angles(gappy)
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
