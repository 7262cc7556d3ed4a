"""Recordings out: C3D, a table of markers, and what is known of a synthetic figure as parquet beside it."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from study.mocap.io.recording import Recording, RecordingError
from study.mocap.synthetic.synthesize import Truth

_LONG = 65535


def write_recording(recording: Recording, path: str | Path) -> Path:
    """Write a recording as C3D or CSV, as the path's ending says.

    Raises:
        RecordingError: for another ending, or if the file cannot be written.
    """
    path = Path(path)
    writers = {".c3d": _c3d, ".csv": _csv}
    if path.suffix.lower() not in writers:
        raise RecordingError(f"{path}: a recording is written to a file whose name ends in {', '.join(writers)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, "wb"):  # ezc3d does not say what is wrong
            pass
        writers[path.suffix.lower()](recording, path)
    except ModuleNotFoundError as error:
        path.unlink()
        raise RecordingError(f"{path}: writing it needs {error.name}: pip install '.[mocap]'") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def _c3d(recording: Recording, path: Path) -> None:
    """Millimetres in single precision, as C3D files are; a missing sample has the residual -1."""
    import ezc3d

    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["LABELS"]["value"] = list(recording.markers)
    point["UNITS"]["value"] = ["mm"]
    point["RATE"]["value"] = [recording.rate]
    if recording.frames >= _LONG:  # more than the header can say
        file.add_parameter("POINT", "LONG_FRAMES", [float(recording.frames)])
    points = np.ones((4, *recording.positions.shape[::2]))
    points[:3] = 1000 * recording.positions.transpose(1, 0, 2)
    file["data"]["points"] = points
    file.write(str(path))


def _csv(recording: Recording, path: Path) -> None:
    """Millimetres to a thousandth; empty cells are missing samples."""
    columns = [f"{marker}_{axis}" for marker in recording.markers for axis in "XYZ"]
    rows = recording.positions.reshape(-1, recording.frames).T
    table = pd.DataFrame(1000 * rows, columns=columns)
    table.insert(0, "frame", np.arange(1, recording.frames + 1))
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(f"# rate: {recording.rate!r}\n# unit: mm\n")
        table.to_csv(file, index=False, float_format="%.3f", lineterminator="\n")


def write_truth(truth: Truth, path: str | Path) -> tuple[Path, Path]:
    """Write what is known of a synthetic figure, beside its recording.

    Args:
        truth: of the figure.
        path: of the recording; its ending is replaced.

    Returns:
        ``….joints.parquet``, one row per joint: names, kind, centre and axis in the parent's frame, and
        ``….truth.parquet``, one row per frame and joint: the centre in the world and the rotation vector of the
        segment that hangs on it. Metres and radians.

    Raises:
        RecordingError: if they cannot be written.
    """
    from scipy.spatial.transform import Rotation

    path = Path(path)
    bones = dict.fromkeys(truth.joints, ("", np.nan)) | {end: (start, d) for (start, end), d in truth.bones.items()}
    joints: dict[str, object] = {
        "joint": truth.joints,
        "parent": truth.parents,
        "child": truth.children,
        "kind": ["ball" if np.isnan(axis[0]) else "hinge" for axis in truth.axes],
        **{f"center_{axis}": truth.in_parent[:, i] for i, axis in enumerate("xyz")},
        **{f"axis_{axis}": truth.axes[:, i] for i, axis in enumerate("xyz")},
        "bone_from": [bones[joint][0] for joint in truth.joints],
        "bone_length": [bones[joint][1] for joint in truth.joints],
    }
    count, _, frames = truth.centers.shape
    turned = [truth.segments.index(child) for child in truth.children]
    vectors = Rotation.from_matrix(truth.rotations[turned].reshape(-1, 3, 3)).as_rotvec()
    poses: dict[str, object] = {
        "frame": np.tile(np.arange(1, frames + 1), count),
        "joint": np.repeat(truth.joints, frames),
        **{f"center_{axis}": truth.centers[:, i].ravel() for i, axis in enumerate("xyz")},
        **{f"turn_{axis}": vectors[:, i] for i, axis in enumerate("xyz")},
    }
    out = path.with_suffix(".joints.parquet"), path.with_suffix(".truth.parquet")
    try:
        for columns, target in zip((joints, poses), out, strict=True):
            pq.write_table(pa.table(columns), target, compression="zstd")
    except OSError as error:
        raise RecordingError(f"{path.parent}: cannot be written: {error.strerror or error}") from None
    return out
