"""Skeletons as BVH files (Biovision hierarchy), which Blender and other animation programs open.

A node is a joint, rotated as the segment that moves about it; its offset is the bone to it. In BVH y points up, as
Blender's importer expects: (x, y, z) here is (x, z, -y) there. Units are metres and degrees, and rotations are in the
order Z, X, Y. The pose without rotations is that of the frame with the most markers of the calibrated recording.

Source: Meredith & Maddock 2001, Motion capture file formats explained.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from study.mocap.geometry.moving_axes import relative_rotation
from study.mocap.io.recording import RecordingError
from study.mocap.skeleton.draw_skeleton import Skeleton, pivot_joint
from study.runs.storage.atomic_write import write
from study.sphere.types import Floats, Ints

_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_ROTATIONS = "Zrotation Xrotation Yrotation"
_POSITIONS = "Xposition Yposition Zposition"


@dataclass(eq=False)
class _Node:
    """A joint and all below it.

    Attributes:
        name: of the joint.
        offset: its place relative to the parent's node (3,), metres.
        rotation: relative to the parent's (3, 3, frames).
        course: its place over time (3, frames), metres, if it is free; None if it is fixed in the parent.
        end: end of the segment (3,), metres, which is drawn if there is nothing below.
        children: nodes below.
    """

    name: str
    offset: Floats
    rotation: Floats
    course: Floats | None
    end: Floats
    children: list["_Node"] = field(default_factory=list)


def write_bvh(skeleton: Skeleton, path: str | Path) -> Path:
    """Write a skeleton as BVH.

    A segment that is known in no frame is left out, with all below it. BVH has no unknown: in frames in which a segment
    is unknown it stays as it was; the skeleton's flags show these frames.

    Args:
        skeleton: of phase 2.
        path: of the file.

    Raises:
        RecordingError: if the root is known in no frame, or the file cannot be written.
    """
    path = Path(path)
    root = _tree(skeleton)
    lines = ["HIERARCHY"]
    columns: list[Floats] = []
    _describe(root, "", lines, columns)
    rows = np.concatenate(columns).T
    lines += ["MOTION", f"Frames: {skeleton.frames}", f"Frame Time: {1.0 / skeleton.rate:.8f}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in rows.tolist()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, ("\n".join(lines) + "\n").encode())
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def _tree(skeleton: Skeleton) -> _Node:
    """Build the nodes; returns the root's."""
    calibration = skeleton.calibration
    above = {place.joint.child: place for place in calibration.joints}
    nodes: dict[str, _Node] = {}
    pivots: dict[str, Floats] = {}
    poses: dict[str, tuple[Floats, Floats]] = {}
    root = calibration.markerset.segments[0].name
    for number, segment in enumerate(calibration.markerset.segments):
        parent = segment.parent or (root if number else None)  # a file has one root: it carries the others, unattached
        rotation, origin = skeleton.rotations[number], skeleton.origins[number]
        if np.isnan(rotation[0, 0]).all() or (parent is not None and parent not in nodes):
            continue
        shape = calibration.shape(segment.name)
        frames = _last_known(rotation[0, 0])
        rotation, origin = rotation[:, :, frames], origin[:, frames]
        place = pivot_joint(above.get(segment.name), shape)
        pivot = np.zeros(3) if place is None else place.in_child
        local, course = rotation, np.einsum("ijt,j->it", rotation, pivot) + origin
        offset = np.zeros(3)
        if parent is not None:
            base, base_origin = poses[parent]
            local = relative_rotation(base, rotation)
            start = np.einsum("ijt,j->it", base, pivots[parent]) + base_origin
            course = np.einsum("jit,jt->it", base, course - start)
            offset = course[:, 0] if place is None else place.in_parent - pivots[parent]
        nodes[segment.name] = _Node(
            name=above[segment.name].joint.name if segment.name in above else segment.name,
            offset=offset,
            rotation=local,
            course=course if place is None else None,
            end=shape.places.mean(axis=0) - pivot if len(shape.markers) else np.zeros(3),
        )
        if parent is not None:
            nodes[parent].children.append(nodes[segment.name])
        pivots[segment.name], poses[segment.name] = pivot, (rotation, origin)
    if root not in nodes:
        raise RecordingError(f"{skeleton.name}: its {root} is known in no frame, and a BVH file starts from it")
    return nodes[root]


def _last_known(row: Floats) -> Ints:
    """For each frame the number of the last known one up to it, or of the first known one."""
    known = ~np.isnan(row)
    last = np.maximum.accumulate(np.where(known, np.arange(len(row)), -1))
    return np.where(last < 0, known.argmax(), last)


def _describe(node: _Node, indent: str, lines: list[str], columns: list[Floats]) -> None:
    """Add a node and all below it to the hierarchy, and its channels to the columns."""
    kind = "ROOT" if not indent else "JOINT"
    channels = f"CHANNELS 3 {_ROTATIONS}" if node.course is None else f"CHANNELS 6 {_POSITIONS} {_ROTATIONS}"
    inner = indent + "  "
    lines += [f"{indent}{kind} {node.name}", indent + "{", f"{inner}OFFSET {_words(node.offset)}", inner + channels]
    if node.course is not None:
        columns.append(_UP @ node.course)
    columns.append(_angles(np.einsum("ij,jkt,lk->ilt", _UP, node.rotation, _UP)))
    for child in node.children:
        _describe(child, inner, lines, columns)
    if not node.children:
        lines += [f"{inner}End Site", inner + "{", f"{inner}  OFFSET {_words(node.end)}", inner + "}"]
    lines.append(indent + "}")


def _words(offset: Floats) -> str:
    return " ".join(f"{value:.6f}" for value in _UP @ offset)


def _angles(r: Floats) -> Floats:
    """Angles about z, x and y (3, frames), degrees, of rotations Rz Rx Ry (3, 3, frames), without jumps."""
    tilt = np.arcsin(np.clip(r[2, 1], -1.0, 1.0))
    z, y = np.arctan2(-r[0, 1], r[1, 1]), np.arctan2(-r[2, 0], r[2, 2])
    locked = np.hypot(r[0, 1], r[1, 1]) < 1e-9  # z and y turn about one axis: y is taken as 0
    z, y = np.where(locked, np.arctan2(r[1, 0], r[0, 0]), z), np.where(locked, 0.0, y)
    return np.unwrap(np.degrees(np.stack([z, tilt, y])), period=360.0, axis=1)
