"""From joints over time to a scene: principal directions of their errors, ends of limbs, bones, z up."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from study.mocap.io.recording import Recording, RecordingError
from study.mocap.markersets.marker_set import MarkerSet
from study.mocap.skeleton.bones import links, side
from study.mocap.skeleton.scene import Flag, Scene
from study.sphere.types import Bytes, Floats

_TIP = 0.7
"""A limb ends in the middle of those of its markers that are at least so far out, in parts of the farthest one."""
_LYING = 1.3
"""The recording's y points up if markers lie, on average, farther apart along it than along z, by this factor."""


@dataclass(frozen=True, eq=False)
class Shown:
    """A joint, as far as it is shown.

    Attributes:
        name: of the joint.
        parent: the segment in which it is fixed; ``child``: the one that hangs on it.
        center: (3, frames), metres; NaN where unknown.
        rotation: of the parent (3, 3, frames), NaN where unknown.
        covariance: of the centre in the parent's axes (3, 3), m²; NaN if it is not known.
        axis: direction in the parent's axes (3,) along which the centre is not known; None if there is none.
        flags: `Flag` in each frame (frames,); those where the centre is NaN become unknown by themselves.
        doubt: why not to rely on it, or "".
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


def stage(
    recording: Recording,
    markerset: MarkerSet,
    joints: Sequence[Shown],
    source: str,
    notes: Sequence[str] = (),
    tips: dict[str, Floats] | None = None,
) -> Scene:
    """Make a scene.

    Args:
        recording: markers over time.
        markerset: whose segments the joints are between; its markers are looked up in the recording.
        joints: those that were found; a joint that is known in no frame is left out, with a note.
        source: what the joints were made from, in words.
        notes: what a viewer should know.
        tips: ends of limbs (3, frames) by segment, if they are known better than from markers.

    Raises:
        RecordingError: if there is nothing to be seen.
    """
    known = [joint for joint in joints if not np.isnan(joint.center).all()]
    notes = [*notes, *(f"{j.name} is not shown: {j.doubt or 'known in no frame'}" for j in joints if j not in known)]
    if not known:
        raise RecordingError(f"{recording.name}: none of its joints is known in any frame; there is nothing to show")
    ends = _ends(recording, markerset, known) | (tips or {})
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
    shapes = [_principal(joint) for joint in known]
    upright, words = _upright(recording)
    return Scene(
        name=recording.name, source=source, rate=recording.rate, markers=recording.markers,
        places=upright @ recording.positions, joints=tuple(j.name for j in known), centers=upright @ centers,
        tips=tuple(ends), ends=upright @ points[len(known) :], bones=links(fixed, points, sides), flags=flags,
        doubts=tuple(joint.doubt for joint in known), errors=np.stack([errors for errors, _ in shapes]),
        turns=np.stack([_turns(upright, j.rotation, axes) for j, (_, axes) in zip(known, shapes, strict=True)]),
        notes=(*notes, *words),
    )  # fmt: skip


def _ends(recording: Recording, markerset: MarkerSet, joints: Sequence[Shown]) -> dict[str, Floats]:
    """Where limbs end (3, frames), by segment: those that hang on a joint, and on which none hangs."""
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


def _principal(joint: Shown) -> tuple[Floats, Floats]:
    """Standard errors along principal directions (3,), and these as columns (3, 3), right-handed; the axis last."""
    if np.isnan(joint.covariance).any():
        return np.full(3, np.nan), np.eye(3)
    axis = np.empty((0, 3)) if joint.axis is None else joint.axis[None] / np.linalg.norm(joint.axis)
    across = np.linalg.svd(axis)[2][len(axis) :] if len(axis) else np.eye(3)  # directions as rows
    values, vectors = np.linalg.eigh(across @ joint.covariance @ across.T)
    errors = np.concatenate([np.sqrt(np.maximum(values, 0.0))[::-1], np.full(len(axis), np.nan)])
    directions = np.concatenate([vectors.T[::-1] @ across, axis]).T
    directions[:, 1] *= np.sign(np.linalg.det(directions))
    return errors, directions


def _turns(upright: Floats, rotation: Floats, axes: Floats) -> Floats:
    """Quaternions of principal directions in the world (frames, 4), x, y, z, w, without jumps of sign."""
    frames = rotation.shape[2]
    turns = np.full((frames, 4), np.nan)
    known = ~np.isnan(rotation[0, 0])
    if known.any():
        matrices = np.einsum("ij,jkt,kl->til", upright, rotation[:, :, known], axes)
        found = Rotation.from_matrix(matrices).as_quat()
        flips = np.cumprod(np.concatenate([[1.0], np.sign((found[1:] * found[:-1]).sum(axis=1) + 1e-300)]))
        turns[known] = found * flips[:, None]
    return turns


def _upright(recording: Recording) -> tuple[Floats, list[str]]:
    """What turns the recording so that z points up (3, 3), and what is to be said of it.

    Files do not say which way is up; a body's parts are above one another most of the time.
    """
    middle = _mean(recording.positions, axis=0)
    # turning about the vertical takes out the mean extent to the sides, and leaves that from foot to head
    mean = _mean(recording.positions - middle, axis=2)
    _, y, z = np.nanstd(mean[~np.isnan(mean[:, 0])], axis=0)
    if y > _LYING * z:
        return np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), ["the recording's y is shown as up"]
    return np.eye(3), []


def _mean(x: Floats, axis: int) -> Floats:
    """Mean of what is known; NaN where nothing is."""
    known = ~np.isnan(x)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(known, x, 0.0).sum(axis=axis) / known.sum(axis=axis))
