"""From joints over time to a scene: principal directions of their errors, ends of limbs, bones, z up."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from study.mocap.io.recording import Recording, RecordingError
from study.mocap.markersets.marker_set import MarkerSet
from study.mocap.skeleton.bones import bones, side
from study.mocap.skeleton.scene import Flag, Scene
from study.mocap.skeleton.upright import upright_rotation
from study.sphere.types import Bytes, Floats

_TIP = 0.7
"""A limb ends in the middle of its markers that are at least this share of the farthest one's distance away."""


@dataclass(frozen=True, eq=False)
class SceneJoint:
    """A joint as a scene shows it.

    Attributes:
        name: of the joint.
        parent: name of the segment in which it is fixed.
        child: name of the segment that rotates about it.
        center: (3, frames), metres; NaN where unknown.
        rotation: of the parent (3, 3, frames), NaN where unknown.
        covariance: of the centre in the parent's axes (3, 3), m²; NaN if it is not known.
        axis: direction in the parent's axes (3,) along which the centre is not known; None if there is none.
        flags: `Flag` in each frame (frames,); frames without a centre become unknown by themselves.
        doubt: reason to doubt it, or "".
    """

    name: str
    parent: str
    child: str
    center: Floats
    rotation: Floats
    covariance: Floats
    axis: Floats | None = None
    flags: Bytes | None = None
    doubt: str = ""


def make_scene(
    recording: Recording, markerset: MarkerSet, joints: Sequence[SceneJoint], source: str, notes: Sequence[str] = ()
) -> Scene:
    """Make a scene.

    Args:
        recording: markers over time.
        markerset: whose segments the joints are between; its markers are looked up in the recording.
        joints: those that were found; a joint that is known in no frame is left out, with a note.
        source: origin of the joints, in words.
        notes: remarks for the viewer.

    Raises:
        RecordingError: if no joint is known in any frame.
    """
    known = [joint for joint in joints if not np.isnan(joint.center).all()]
    notes = [*notes, *(f"{j.name} is not shown: {j.doubt or 'known in no frame'}" for j in joints if j not in known)]
    if not known:
        raise RecordingError(f"{recording.name}: none of its joints is known in any frame; there is nothing to show")
    ends = _ends(recording, markerset, known)
    centers = np.stack([joint.center for joint in known])
    points = np.concatenate([centers, *(end[None] for end in ends.values())])
    fixed = [
        [i for i, joint in enumerate(known) if segment.name in (joint.parent, joint.child)]
        + [len(known) + i for i, name in enumerate(ends) if name == segment.name]
        for segment in markerset.segments
    ]
    flags = np.stack([np.zeros(recording.frames) if j.flags is None else j.flags for j in known]).astype(np.uint8)
    flags[np.isnan(centers[:, 0])] = Flag.UNKNOWN
    sides = [*(side(joint.name) for joint in known), *map(side, ends)]
    principal = [_principal_directions(joint) for joint in known]
    upright = upright_rotation(recording)
    remarks = ["the recording's y is shown as up"] if upright[2, 1] else []
    directions = zip(known, principal, strict=True)
    orientations = [_orientations(upright, joint.rotation, axes) for joint, (_, axes) in directions]
    return Scene(
        name=recording.name,
        source=source,
        rate=recording.rate,
        markers=recording.markers,
        places=upright @ recording.positions,
        joints=tuple(joint.name for joint in known),
        centers=upright @ centers,
        tips=tuple(ends),
        ends=upright @ points[len(known) :],
        bones=bones(fixed, points, sides),
        flags=flags,
        doubts=tuple(joint.doubt for joint in known),
        errors=np.stack([errors for errors, _ in principal]),
        orientations=np.stack(orientations),
        notes=(*notes, *remarks),
    )


def _ends(recording: Recording, markerset: MarkerSet, joints: Sequence[SceneJoint]) -> dict[str, Floats]:
    """Ends of limbs (3, frames), by segment: of segments that rotate about a joint and carry none."""
    inner = {joint.parent for joint in joints}
    found = {}
    for joint in joints:
        names = [marker for marker in markerset.segment(joint.child).markers if marker in recording.markers]
        if joint.child in inner or not names:
            continue
        places = np.stack([recording.of(name) for name in names])
        away = np.linalg.norm(places - joint.center, axis=1)
        far = np.array([np.nanmedian(row) if not np.isnan(row).all() else 0.0 for row in away])
        found[joint.child] = np.asarray(places[far >= _TIP * far.max()].mean(axis=0))
    return found


def _principal_directions(joint: SceneJoint) -> tuple[Floats, Floats]:
    """Standard errors (3,) along principal directions, and these as columns (3, 3), right-handed; the axis last."""
    if np.isnan(joint.covariance).any():
        return np.full(3, np.nan), np.eye(3)
    axis = np.empty((0, 3)) if joint.axis is None else joint.axis[None] / np.linalg.norm(joint.axis)
    across = np.linalg.svd(axis)[2][len(axis) :] if len(axis) else np.eye(3)  # directions as rows
    values, vectors = np.linalg.eigh(across @ joint.covariance @ across.T)
    errors = np.concatenate([np.sqrt(np.maximum(values, 0.0))[::-1], np.full(len(axis), np.nan)])
    directions = np.concatenate([vectors.T[::-1] @ across, axis]).T
    directions[:, 1] *= np.sign(np.linalg.det(directions))
    return errors, directions


def _orientations(upright: Floats, rotation: Floats, axes: Floats) -> Floats:
    """Quaternions x, y, z, w (frames, 4) of axes fixed in a segment, in the upright world, without jumps of sign."""
    frames = rotation.shape[2]
    result = np.full((frames, 4), np.nan)
    known = ~np.isnan(rotation[0, 0])
    if known.any():
        matrices = np.einsum("ij,jkt,kl->til", upright, rotation[:, :, known], axes)
        found = Rotation.from_matrix(matrices).as_quat()
        flips = np.cumprod(np.concatenate([[1.0], np.sign((found[1:] * found[:-1]).sum(axis=1) + 1e-300)]))
        result[known] = found * flips[:, None]
    return result
