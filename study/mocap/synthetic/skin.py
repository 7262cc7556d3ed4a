"""Laws by which the skin moves the markers on their segments, for synthetic bodies.

What skin does to a joint's centre depends on what it moves with (theory §12): a displacement that is linear in the
joint's own angle moves the centre and leaves next to no residual, above all one that is common to a segment's markers.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from study.experiment.streams import stream
from study.mocap.geometry.moving_axes import nearest_rotation
from study.mocap.synthetic.artefacts import soft_tissue
from study.mocap.synthetic.body_model import PARTS
from study.mocap.synthetic.random_motion import Motion
from study.mocap.synthetic.recipe import Recipe
from study.sphere.types import Floats, Ints

_SIGNS = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], dtype=float).T


def skin_motion(recipe: Recipe, motion: Motion, segment_of: Ints) -> Floats:
    """Draw the displacement of each marker on its segment by the recipe's law, largest at its ``soft_tissue``.

    The laws are ``mixed`` (see `soft_tissue`); ``random``: smooth in time, independent of the motion; ``angle``: linear
    in the rotation vector of the segment's joint, each marker in its own way; ``velocity``: the same with its rate of
    change; ``cluster``: linear in the rotation vector, equal for all markers of a segment. The pelvis has no joint to a
    parent; its skin follows the waist.

    Args:
        recipe: its ``skin``, ``soft_tissue``, ``rate`` and ``seed``.
        motion: of the body.
        segment_of: number of each marker's segment (markers,).

    Returns:
        Displacements in the segments' axes (markers, 3, frames), metres.
    """
    joint_of = np.where(segment_of == 0, 1, segment_of)
    if recipe.skin == "mixed":
        return soft_tissue(motion.phases[joint_of], recipe.rate, recipe.soft_tissue, recipe.seed)
    if recipe.skin == "random":
        return recipe.soft_tissue * _random(len(segment_of), motion.phases.shape[1], recipe.rate, recipe.seed)
    clusters = segment_of if recipe.skin == "cluster" else np.arange(len(segment_of))
    tensors = _tensors(clusters, recipe.seed)
    drive = np.array([_DRIVES[recipe.skin](angles, recipe.rate) for angles in _rotation_vectors(motion)])
    return np.asarray(recipe.soft_tissue * np.einsum("mik,mkt->mit", tensors, drive[joint_of]))


def _random(markers: int, frames: int, rate: float, seed: int) -> Floats:
    """Displacements of at most 1 (markers, 3, frames): three oscillations of .2 to 2 hertz along random directions."""
    rng = stream(seed, "synthetic", "skin", "random")
    frequency = np.exp(rng.uniform(np.log(0.2), np.log(2.0), (3, markers, 1)))
    waves = np.sin(2 * np.pi * (frequency * np.arange(frames) / rate + rng.uniform(size=(3, markers, 1))))
    directions = rng.standard_normal((3, markers, 3))
    directions /= 3.0 * np.linalg.norm(directions, axis=2, keepdims=True)
    return np.asarray(np.einsum("kmi,kmt->mit", directions, waves))


def _tensors(clusters: Ints, seed: int) -> Floats:
    """Random tensors (markers, 3, 3), equal within a cluster, that take vectors in the cube of side 2 to at most 1."""
    drawn = stream(seed, "synthetic", "skin", "tensors").standard_normal((clusters.max() + 1, 3, 3))[clusters]
    return np.asarray(drawn / np.linalg.norm(drawn @ _SIGNS, axis=1).max(axis=1)[:, None, None])


def _rotation_vectors(motion: Motion) -> Floats:
    """Rotation vectors of each segment in its parent's axes, about the mean rotation (segments, 3, frames)."""
    rows = {part.name: i for i, part in enumerate(PARTS)}
    vectors = np.zeros((len(PARTS), 3, motion.phases.shape[1]))
    for i, part in enumerate(PARTS):
        if part.parent is not None:
            relative = np.swapaxes(motion.rotations[rows[part.parent]], 1, 2) @ motion.rotations[i]
            mean = nearest_rotation(relative.sum(axis=0))
            vectors[i] = Rotation.from_matrix(relative @ mean.T).as_rotvec().T
    return vectors


def _to_unit(vectors: Floats) -> Floats:
    """Vectors (3, frames), all divided by the largest component of any."""
    return vectors / max(float(np.abs(vectors).max()), 1e-300)


def _velocity(vectors: Floats, rate: float) -> Floats:
    return _to_unit(np.gradient(vectors, 1.0 / rate, axis=1))


_DRIVES: dict[str, Callable[[Floats, float], Floats]] = {
    "angle": lambda vectors, _: _to_unit(vectors),
    "cluster": lambda vectors, _: _to_unit(vectors),
    "velocity": _velocity,
}
