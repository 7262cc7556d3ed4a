"""Skeletons as BVH files (Biovision hierarchy), which Blender and other animation programs open.

In BVH y points up, as importers expect: (x, y, z) of a skeleton is (x, z, -y) there. In a T-pose the body looks
along z. Units are metres and degrees, and rotations are in the order Z, X, Y.

Source: Meredith & Maddock 2001, Motion capture file formats explained.
"""

from pathlib import Path

import numpy as np

from study.mocap.export.joint_tree import JointNode, joint_tree
from study.mocap.export.motion import ExportedMotion
from study.mocap.geometry.euler_angles import zxy_angles
from study.sphere.types import Floats

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Rotation from axes with z up to those with y up."""
_ROTATIONS = "Zrotation Xrotation Yrotation"
_POSITIONS = "Xposition Yposition Zposition"


def write_bvh(motion: ExportedMotion, path: Path) -> None:
    """Write a skeleton as BVH.

    Raises:
        RecordingError: if the root is known in no frame.
        OSError: if the file cannot be written.
    """
    lines = ["HIERARCHY"]
    columns: list[Floats] = []
    _describe(joint_tree(motion), "", lines, columns)
    rows = np.concatenate(columns).T
    lines += ["MOTION", f"Frames: {motion.skeleton.frames}", f"Frame Time: {1.0 / motion.skeleton.rate:.12g}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in rows.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _describe(node: JointNode, indent: str, lines: list[str], columns: list[Floats]) -> None:
    """Add a node and all below it to the hierarchy, and its channels to the columns."""
    kind = "ROOT" if not indent else "JOINT"
    channels = f"CHANNELS 3 {_ROTATIONS}" if node.course is None else f"CHANNELS 6 {_POSITIONS} {_ROTATIONS}"
    inner = indent + "  "
    name = "_".join(node.name.split())
    lines += [f"{indent}{kind} {name}", indent + "{", f"{inner}OFFSET {_words(node.offset)}", inner + channels]
    if node.course is not None:
        columns.append(Y_UP @ node.course)
    columns.append(np.degrees(zxy_angles(np.einsum("ij,jkt,lk->ilt", Y_UP, node.rotation, Y_UP))))
    for child in node.children:
        _describe(child, inner, lines, columns)
    if not node.children:
        lines += [f"{inner}End Site", inner + "{", f"{inner}  OFFSET {_words(node.end)}", inner + "}"]
    lines.append(indent + "}")


def _words(offset: Floats) -> str:
    return " ".join(f"{value:.6f}" for value in Y_UP @ offset)
