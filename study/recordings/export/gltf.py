"""Skeletons as binary glTF 2.0 (.glb), which browsers, Blender, Unity, Unreal and Windows show.

The file has a node for each joint, a mesh of simple bones that is skinned to them, and an animation with all frames.
y points up and units are metres; in the rest pose the body looks along z. What else is known of a joint is in the
``extras`` of its node: ``error``, its largest standard error in metres, and ``doubt``, the reason not to rely on it.
A bone is an octahedron from its joint to the one below.

Source: Khronos Group, glTF 2.0 Specification.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pygltflib as gltf

from study.arrays import Bools, Floats, Ints
from study.recordings.export.tree import Y_UP, ExportedMotion, JointNode, joint_tree
from study.recordings.rigid import quaternions

Numbers = np.typing.NDArray[np.generic]
"""Numbers of the kinds that a file has: floats, and bytes or words without sign."""
_WIDTH = 0.08
"""Half the width of a bone, in units of its length..."""
_THICK = 0.02
"""...but at most this, metres."""
_WIDEST = 0.2
"""Share of its length at which a bone is widest."""
_FACES = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [5, 1, 2], [5, 2, 3], [5, 3, 4], [5, 4, 1]])


def rest_places(root: JointNode) -> Floats:
    """Places of all nodes in the rest pose (nodes, 3), metres, in the order of `JointNode.walk`."""
    places = {root: root.offset}
    for node in root.walk():
        places |= {child: places[node] + child.offset for child in node.children}
    return np.stack([places[node] for node in root.walk()])


def bone_mesh(root: JointNode) -> tuple[Floats, Ints, Ints]:
    """Make the bones of a hierarchy: to each joint that is fixed in the one above, and to the ends of limbs.

    Returns:
        Vertices (v, 3) in the rest pose, metres, z up; triangles as numbers of vertices (f, 3), counterclockwise as
        seen from outside; and the number of the node that each vertex moves with (v,).
    """
    vertices, owners = np.zeros((0, 3)), []
    for number, (node, start) in enumerate(zip(root.walk(), rest_places(root), strict=True)):
        bones = [child.offset for child in node.children if child.course is None] if node.children else [node.end]
        for bone in (bone for bone in bones if np.linalg.norm(bone) > 0.0):
            vertices = np.concatenate([vertices, start + _octahedron(bone)])
            owners.append(number)
    faces = (_FACES + 6 * np.arange(len(owners))[:, None, None]).reshape(-1, 3)
    return vertices, faces, np.repeat(np.array(owners, dtype=int), 6)


def _octahedron(bone: Floats) -> Floats:
    """Corners (6, 3) of a bone from the origin: its start, four around it, its end."""
    length = float(np.linalg.norm(bone))
    side = np.cross(bone, np.eye(3)[np.abs(bone).argmin()])
    side *= min(_WIDTH * length, _THICK) / np.linalg.norm(side)
    other = np.cross(bone / length, side)
    ring = [_WIDEST * bone + corner for corner in (side, other, -side, -other)]
    return np.stack([np.zeros(3), *ring, bone])


_PLAIN, _DOUBTED = [0.75, 0.72, 0.65, 1.0], [0.85, 0.1, 0.6, 1.0]
"""Colours of bones: of a joint that is reliable, and of one that is not."""
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_COMPONENTS = {"f": gltf.FLOAT, "B": gltf.UNSIGNED_BYTE, "H": gltf.UNSIGNED_SHORT}


def write_gltf(motion: ExportedMotion, path: Path) -> None:
    """Write a skeleton as binary glTF.

    Raises:
        RecordingError: if the root is known in no frame.
        OSError: if the file cannot be written.
    """
    root = joint_tree(motion)
    nodes, doubts = list(root.walk()), dict(zip(motion.scene.joints, motion.scene.doubts, strict=True))
    document = _Document()
    document.add_nodes(nodes, doubts, np.fmax.reduce(motion.scene.errors, axis=1))
    document.add_skin(rest_places(root) @ Y_UP.T)
    document.add_bones(*bone_mesh(root), np.array([bool(doubts.get(node.name)) for node in nodes]))
    document.add_animation(nodes, motion.skeleton.frames, motion.skeleton.rate, motion.skeleton.name)
    path.write_bytes(document.binary())


class _Document:
    """The parts of a file, and the bytes that they refer to."""

    def __init__(self) -> None:
        asset = gltf.Asset(version="2.0", generator="sphere-fit-study")
        self.gltf = gltf.GLTF2(asset=asset, scene=0, scenes=[gltf.Scene(nodes=[0])])
        self.bytes = bytearray()

    def add_nodes(self, nodes: list[JointNode], doubts: Mapping[str, str], errors: Floats) -> None:
        """Add the joints in their rest pose; ``doubts`` are of the scene's joints, ``errors`` their largest ones."""
        worst = dict(zip(doubts, errors, strict=True))
        for node in nodes:
            known = not np.isnan(worst.get(node.name, np.nan))
            extras: dict[str, object] = {"error": round(float(worst[node.name]), 6)} if known else {}
            extras |= {"doubt": doubt} if (doubt := doubts.get(node.name)) else {}
            place, below = [float(x) for x in Y_UP @ node.offset], [nodes.index(child) for child in node.children]
            rest = {"translation": place, "rotation": [0.0, 0.0, 0.0, 1.0]}
            self.gltf.nodes.append(gltf.Node(name=node.name, children=below, extras=extras, **rest))

    def add_skin(self, places: Floats) -> None:
        """Add the skin: all nodes, at their places in the rest pose (nodes, 3), y up."""
        inverse = np.tile(np.eye(4, dtype="f"), (len(places), 1, 1))
        inverse[:, 3, :3] = -places  # columns one after another
        matrices = self._accessor(inverse.reshape(-1, 16))
        skin = gltf.Skin(name="skeleton", skeleton=0, joints=list(range(len(places))), inverseBindMatrices=matrices)
        self.gltf.skins.append(skin)

    def add_bones(self, vertices: Floats, faces: Ints, owners: Ints, doubted: Bools) -> None:
        """Add the mesh of the bones, each moved by one node; those of doubted joints in a colour of their own."""
        if not len(vertices):
            return
        joints = np.zeros((len(owners), 4), dtype="B")
        joints[:, 0] = owners
        weights = np.tile(np.array([1, 0, 0, 0], dtype="f"), (len(joints), 1))
        place = self._accessor((vertices @ Y_UP.T).astype("f"), gltf.ARRAY_BUFFER, bounds=True)
        owner, weight = (self._accessor(values, gltf.ARRAY_BUFFER) for values in (joints, weights))
        attributes = gltf.Attributes(POSITION=place, JOINTS_0=owner, WEIGHTS_0=weight)
        primitives = []
        marked = doubted[owners[faces[:, 0]]]
        for colour, part in ((_PLAIN, faces[~marked]), (_DOUBTED, faces[marked])):
            if not len(part):
                continue
            name = "bone" if colour is _PLAIN else "bone of an unreliable joint"
            surface = gltf.PbrMetallicRoughness(baseColorFactor=colour, metallicFactor=0.0, roughnessFactor=0.9)
            indices = self._accessor(part.reshape(-1, 1).astype("H"), gltf.ELEMENT_ARRAY_BUFFER)
            number = len(self.gltf.materials)
            self.gltf.materials.append(gltf.Material(name=name, pbrMetallicRoughness=surface, alphaCutoff=None))
            primitives.append(gltf.Primitive(attributes=attributes, indices=indices, material=number))
        self.gltf.meshes.append(gltf.Mesh(name="bones", primitives=primitives))
        self.gltf.nodes.append(gltf.Node(name="bones", mesh=0, skin=0))
        self.gltf.scenes[0].nodes.append(len(self.gltf.nodes) - 1)

    def add_animation(self, nodes: list[JointNode], frames: int, rate: float, name: str) -> None:
        """Add the rotations of all nodes, and the places of those that are free."""
        times = self._accessor((np.arange(frames)[:, None] / rate).astype("f"), bounds=True)
        animation = gltf.Animation(name=name, samplers=[], channels=[])
        for number, node in enumerate(nodes):
            paths = {"rotation": quaternions(np.einsum("ij,jkt,lk->til", Y_UP, node.rotation, Y_UP)).astype("f")}
            if node.course is not None:
                paths["translation"] = (Y_UP @ node.course).T.astype("f")
            for path, values in paths.items():
                target = gltf.AnimationChannelTarget(node=number, path=path)
                animation.channels.append(gltf.AnimationChannel(sampler=len(animation.samplers), target=target))
                output = self._accessor(values)
                animation.samplers.append(gltf.AnimationSampler(input=times, output=output, interpolation="LINEAR"))
        self.gltf.animations.append(animation)

    def _accessor(self, values: Numbers, target: int | None = None, bounds: bool = False) -> int:
        """Append an array (count, components) to the bytes; returns the number of its accessor."""
        self.bytes += bytes(-len(self.bytes) % 4)
        data = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
        number = len(self.gltf.accessors)  # one view each
        view = gltf.BufferView(buffer=0, byteOffset=len(self.bytes), byteLength=len(data), target=target)
        kind = {"componentType": _COMPONENTS[values.dtype.char], "type": _TYPES[values.shape[1]]}
        low, high = ((f(values, axis=0).tolist() if bounds else None) for f in (np.min, np.max))
        self.bytes += data
        self.gltf.bufferViews.append(view)
        self.gltf.accessors.append(gltf.Accessor(bufferView=number, count=len(values), min=low, max=high, **kind))
        return number

    def binary(self) -> bytes:
        """The file."""
        self.bytes += bytes(-len(self.bytes) % 4)
        self.gltf.buffers.append(gltf.Buffer(byteLength=len(self.bytes)))
        self.gltf.set_binary_blob(bytes(self.bytes))
        return b"".join(self.gltf.save_to_bytes())
