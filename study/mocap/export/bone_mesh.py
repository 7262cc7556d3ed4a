"""Triangles that show the bones of a hierarchy of joints: an octahedron from each joint to the ones below."""

from typing import NamedTuple

import numpy as np

from study.mocap.export.joint_tree import JointNode
from study.sphere.types import Floats, Ints

_WIDTH = 0.08
"""Half the width of a bone, in units of its length..."""
_THICK = 0.02
"""...but at most this, metres."""
_WIDEST = 0.2
"""Share of its length at which a bone is widest."""
_FACES = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [5, 1, 2], [5, 2, 3], [5, 3, 4], [5, 4, 1]])


class BoneMesh(NamedTuple):
    """Triangles in the rest pose, z up.

    Attributes:
        vertices: (v, 3), metres.
        faces: numbers of vertices (f, 3), counterclockwise as seen from outside.
        nodes: number of the node that each vertex moves with (v,).
    """

    vertices: Floats
    faces: Ints
    nodes: Ints


def rest_places(root: JointNode) -> Floats:
    """Places of all nodes in the rest pose (nodes, 3), metres, in the order of `JointNode.walk`."""
    places = {root: root.offset}
    for node in root.walk():
        places |= {child: places[node] + child.offset for child in node.children}
    return np.stack([places[node] for node in root.walk()])


def bone_mesh(root: JointNode) -> BoneMesh:
    """Make the bones of a hierarchy: to each joint that is fixed in the one above, and to the ends of limbs."""
    vertices: list[Floats] = []
    faces: list[Ints] = []
    owners: list[Ints] = []
    for number, (node, start) in enumerate(zip(root.walk(), rest_places(root), strict=True)):
        bones = [child.offset for child in node.children if child.course is None] if node.children else [node.end]
        for bone in bones:
            if not np.linalg.norm(bone) > 0.0:
                continue
            faces.append(_FACES + 6 * len(vertices))
            vertices.append(start + _octahedron(bone))
            owners.append(np.full(6, number))
    if not vertices:
        return BoneMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int), np.zeros(0, dtype=int))
    return BoneMesh(np.concatenate(vertices), np.concatenate(faces), np.concatenate(owners))


def _octahedron(bone: Floats) -> Floats:
    """Corners (6, 3) of a bone from the origin: its start, four around it, its end."""
    length = float(np.linalg.norm(bone))
    side = np.cross(bone, np.eye(3)[np.abs(bone).argmin()])
    side *= min(_WIDTH * length, _THICK) / np.linalg.norm(side)
    other = np.cross(bone / length, side)
    ring = [_WIDEST * bone + corner for corner in (side, other, -side, -other)]
    return np.stack([np.zeros(3), *ring, bone])
