"""Skeletons out: BVH (Biovision hierarchy), which Blender and every other animation program opens.

A node is a joint, turned as the segment that hangs on it; its offset is the bone to it. BVH's y points up and so does
Blender's importer expect it: (x, y, z) here is (x, z, -y) there. Metres, degrees, rotations in the order Z, X, Y.
The pose without rotations is that of the frame in which the most markers were seen when the skeleton was calibrated.

Source: Meredith & Maddock 2001, Motion capture file formats explained.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from study.mocap.io.recording import RecordingError
from study.mocap.skeleton.draw_skeleton import Skeleton, hung
from study.runs.storage.atomic_write import write
from study.sphere.types import Floats, Ints

_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_TURNS = "Zrotation Xrotation Yrotation"
_PLACES = "Xposition Yposition Zposition"


@dataclass(eq=False)
class _Node:
    """A joint: where it is in its parent (3,), over time (3, frames) if it is free; its turn; its children."""

    name: str
    segment: str
    offset: Floats
    turns: Floats
    course: Floats | None
    end: Floats
    children: list["_Node"] = field(default_factory=list)


def write_bvh(skeleton: Skeleton, path: str | Path) -> Path:
    """Write a skeleton as BVH.

    A segment that is known in no frame is left out, with all that hangs on it. In frames in which one is unknown it
    stays as it was: BVH cannot say that; the skeleton's flags do.

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
    kept = skeleton.calibration
    above = {place.joint.child: place for place in kept.joints}
    nodes: dict[str, _Node] = {}
    pivots: dict[str, Floats] = {}
    poses: dict[str, tuple[Floats, Floats]] = {}
    first = None
    for number, segment in enumerate(kept.markerset.segments):
        rotation, origin = skeleton.rotations[number], skeleton.origins[number]
        if np.isnan(rotation[0, 0]).all() or (segment.parent is not None and segment.parent not in nodes):
            continue
        shape = kept.shape(segment.name)
        held = _held(rotation[0, 0])
        rotation, origin = rotation[:, :, held], origin[:, held]
        place = hung(above.get(segment.name), shape)
        pivot = np.zeros(3) if place is None else place.in_child
        name = above[segment.name].joint.name if segment.name in above else segment.name
        turns, course = rotation, np.einsum("ijt,j->it", rotation, pivot) + origin
        if segment.parent is not None:
            base, base_origin = poses[segment.parent]
            turns = np.einsum("jit,jkt->ikt", base, rotation)
            start = np.einsum("ijt,j->it", base, pivots[segment.parent]) + base_origin
            course = np.einsum("jit,jt->it", base, course - start)
        offset = course[:, 0] if place is None else place.in_parent - pivots.get(str(segment.parent), 0.0)
        if segment.parent is None:
            offset = np.zeros(3)
        end = shape.places.mean(axis=0) - pivot if len(shape.markers) else np.zeros(3)
        node = _Node(name, segment.name, offset, turns, course if place is None else None, end)
        if segment.parent is None:
            first = node
        else:
            nodes[segment.parent].children.append(node)
        nodes[segment.name], pivots[segment.name], poses[segment.name] = node, pivot, (rotation, origin)
    if first is None:
        root = kept.markerset.segments[0].name
        raise RecordingError(f"{skeleton.name}: its {root} is known in no frame; a BVH file hangs on that")
    return first


def _held(row: Floats) -> Ints:
    """For each frame the nearest known one before it, or the first."""
    known = ~np.isnan(row)
    last = np.maximum.accumulate(np.where(known, np.arange(len(row)), -1))
    return np.where(last < 0, known.argmax(), last)


def _describe(node: _Node, indent: str, lines: list[str], columns: list[Floats]) -> None:
    """Add a node and all below it to the hierarchy, and its channels to the columns."""
    kind = "ROOT" if not indent else "JOINT"
    channels = f"CHANNELS 3 {_TURNS}" if node.course is None else f"CHANNELS 6 {_PLACES} {_TURNS}"
    inner = indent + "  "
    lines += [f"{indent}{kind} {node.name}", indent + "{", f"{inner}OFFSET {_words(node.offset)}", inner + channels]
    if node.course is not None:
        columns.append(_UP @ node.course)
    columns.append(_angles(np.einsum("ij,jkt,lk->ilt", _UP, node.turns, _UP)))
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
