"""The truth about a synthetic body - segments, joints and missing samples - and its tables beside the recording."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.spatial.transform import Rotation

from study.mocap.io.recording import RecordingError
from study.mocap.synthetic.artefacts import Swap
from study.sphere.types import Bools, Floats


@dataclass(frozen=True, eq=False)
class BodyTruth:
    """True segment poses, joints and markers of a synthetic body.

    Lengths are in metres. The origin of a segment is the joint to its parent.
    """

    segments: tuple[str, ...]
    rotations: Floats
    """(segments, frames, 3, 3), from a segment's axes to the world's."""
    origins: Floats
    """(segments, 3, frames), in the world."""
    markers: tuple[str, ...]
    offsets: Floats
    """(markers, 3): each marker in its segment's axes, without soft-tissue artefact."""
    joints: tuple[str, ...]
    parents: tuple[str, ...]
    """Parent segment of each joint; the joint is fixed in it."""
    children: tuple[str, ...]
    """Child segment of each joint."""
    centers: Floats
    """(joints, 3, frames), in the world."""
    in_parent: Floats
    """(joints, 3): each joint in its parent's axes; in its child's axes it is the origin."""
    axes: Floats
    """(joints, 3): unit vectors along hinge axes, equal in the parent's and the child's axes; NaN for ball joints."""
    bones: dict[tuple[str, str], float]
    """Length of each bone: two joints of one segment, the one to its parent first."""
    swaps: tuple[Swap, ...]
    missing: Bools
    """(markers, frames)."""


def write_truth(truth: BodyTruth, path: str | Path) -> tuple[Path, Path]:
    """Write the truth about a synthetic body beside its recording.

    Args:
        truth: of the body.
        path: of the recording; its suffix is replaced.

    Returns:
        ``….joints.parquet``, a row per joint: names, kind, centre and axis in the parent's axes, and the bone that ends
        there; ``….truth.parquet``, a row per frame and joint: the centre in the world and the rotation vector of the
        child segment. Metres and radians.

    Raises:
        RecordingError: if they cannot be written.
    """
    path = Path(path)
    out = path.with_suffix(".joints.parquet"), path.with_suffix(".truth.parquet")
    try:
        for columns, target in zip((_joint_columns(truth), _frame_columns(truth)), out, strict=True):
            pq.write_table(pa.table(columns), target, compression="zstd")
    except OSError as error:
        raise RecordingError(f"{path.parent}: cannot be written: {error.strerror or error}") from None
    return out


def _joint_columns(truth: BodyTruth) -> dict[str, object]:
    """Columns of the table with a row per joint."""
    bones = dict.fromkeys(truth.joints, ("", np.nan)) | {end: (start, d) for (start, end), d in truth.bones.items()}
    return {
        "joint": truth.joints,
        "parent": truth.parents,
        "child": truth.children,
        "kind": ["ball" if np.isnan(axis[0]) else "hinge" for axis in truth.axes],
        **{f"center_{axis}": truth.in_parent[:, i] for i, axis in enumerate("xyz")},
        **{f"axis_{axis}": truth.axes[:, i] for i, axis in enumerate("xyz")},
        "bone_from": [bones[joint][0] for joint in truth.joints],
        "bone_length": [bones[joint][1] for joint in truth.joints],
    }


def _frame_columns(truth: BodyTruth) -> dict[str, object]:
    """Columns of the table with a row per frame and joint."""
    count, _, frames = truth.centers.shape
    children = [truth.segments.index(child) for child in truth.children]
    vectors = Rotation.from_matrix(truth.rotations[children].reshape(-1, 3, 3)).as_rotvec()
    return {
        "frame": np.tile(np.arange(1, frames + 1), count),
        "joint": np.repeat(truth.joints, frames),
        **{f"center_{axis}": truth.centers[:, i].ravel() for i, axis in enumerate("xyz")},
        **{f"turn_{axis}": vectors[:, i] for i, axis in enumerate("xyz")},
    }
