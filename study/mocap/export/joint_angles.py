"""Angles of joints: the rotation of each child segment relative to its parent, in anatomical axes.

Angles are zero in the standing pose (`rest_pose`): trunk upright, arms and legs straight down, toes forward. Their axes
are OpenSim's: x forward, y up, z to the right. A ball joint has three angles, about z, x and y in this order: flexion,
adduction and rotation of a limb (flexion forward; adduction and rotation to the inside on both sides), extension,
bending and rotation of the trunk and the head (backward, to the right, to the left). A hinge has the angle about its
own axis; the sign of the axis is such that the median angle is positive, as knees and elbows bend one way.

Rotations about the long axis of a limb are relative to its mean pose: markers alone do not show their zero.

Source: Rajagopal et al. 2016, Full-body musculoskeletal model; its coordinates have these signs.
"""

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from study.mocap.export.motion import ExportedMotion
from study.mocap.export.rest_pose import RestPose, rest_rotations
from study.mocap.geometry.euler_angles import zxy_angles
from study.mocap.geometry.moving_axes import relative_rotation
from study.mocap.skeleton.bones import side
from study.mocap.skeleton.calibration import JointPlace
from study.sphere.types import Floats

ANATOMICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Rotation from the axes of rest poses, x to the left and z up, to x forward, y up, z to the right."""
_LIMB, _TRUNK = ("flexion", "adduction", "rotation"), ("extension", "bending", "rotation")


def joint_angles(motion: ExportedMotion) -> pd.DataFrame:
    """Compute the angles of all joints.

    Returns:
        A row per frame. Columns: time, seconds; the root's place, ``<root>_tx``, ``_ty``, ``_tz``, metres, and its
        rotation in the world, ``_tilt`` about z, ``_list`` about x, ``_rotation`` about y, degrees; the angles of each
        joint, ``<joint>_flexion``, …, degrees. The world's axes are the recording's with y up. NaN where a segment is
        not known.
    """
    skeleton = motion.skeleton
    standing = rest_rotations(skeleton.calibration, motion.upright, RestPose.STANDING)
    turns = {name: _anatomical(motion, name, standing[name]) for name in skeleton.segments}
    root = skeleton.segments[0]
    columns: dict[str, Floats] = {"time": np.arange(skeleton.frames) / skeleton.rate}
    world = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]) @ motion.upright
    angles = _zxy(np.einsum("ij,jkt->ikt", world @ motion.upright.T, turns[root]))
    for name, values in zip(("tilt", "list", "rotation"), angles, strict=True):
        columns[f"{root}_{name}"] = values
    for axis, values in zip("xyz", world @ skeleton.origins[0], strict=True):
        columns[f"{root}_t{axis}"] = values
    for place in skeleton.calibration.joints:
        turn = relative_rotation(turns[place.joint.parent], turns[place.joint.child])
        columns |= _hinge(place, turn, standing) if _has_axis(place) else _ball(place.joint.name, turn)
    return pd.DataFrame(columns)


def _anatomical(motion: ExportedMotion, name: str, standing: Floats) -> Floats:
    """Rotation (3, 3, frames) of a segment's anatomical axes to the upright world."""
    axes = standing.T @ ANATOMICAL.T  # of the anatomical axes, in the segment's
    return np.asarray(np.einsum("ij,jkt,kl->ilt", motion.upright, motion.skeleton.rotation(name), axes))


def _has_axis(place: JointPlace) -> bool:
    return place.joint.kind == "hinge" and not np.isnan(place.axis_in_parent).any()


def _ball(name: str, turn: Floats) -> dict[str, Floats]:
    """The three angles of a joint, degrees."""
    names, signs = (_LIMB if side(name) else _TRUNK), np.array([1.0, 1.0, 1.0])
    if side(name) == "left":  # mirrored
        signs[1:] = -1.0
    return {f"{name}_{one}": sign * angle for one, sign, angle in zip(names, signs, _zxy(turn), strict=True)}


def _hinge(place: JointPlace, turn: Floats, standing: dict[str, Floats]) -> dict[str, Floats]:
    """The angle of a hinge about its own axis, degrees."""
    axis = ANATOMICAL @ standing[place.joint.parent] @ place.axis_in_parent
    axis = axis / np.linalg.norm(axis)
    known = ~np.isnan(turn[0, 0])
    angle = np.full(turn.shape[2], np.nan)
    if known.any():
        quaternions = Rotation.from_matrix(turn[:, :, known].transpose(2, 0, 1)).as_quat()
        about = 2.0 * np.arctan2(quaternions[:, :3] @ axis, quaternions[:, 3])
        about = (about + np.pi) % (2.0 * np.pi) - np.pi
        angle[known] = np.degrees(about if np.median(about) >= 0.0 else -about)
    return {f"{place.joint.name}_flexion": angle}


def _zxy(turn: Floats) -> Floats:
    """Angles about z, x and y (3, frames), degrees, without jumps; NaN where the rotation is not known."""
    known = ~np.isnan(turn[0, 0])
    angles = np.full((3, turn.shape[2]), np.nan)
    if known.any():
        angles[:, known] = np.degrees(zxy_angles(turn[:, :, known]))
    return angles
