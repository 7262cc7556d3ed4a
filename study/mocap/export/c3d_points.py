"""Joint centres as points in a C3D file, beside the markers and all else that the recording's own file holds."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from study.mocap.export.motion import ExportedMotion
from study.mocap.io.assembly import UNITS
from study.mocap.io.c3d_header import LONG, read_header
from study.mocap.io.writing import write_recording
from study.sphere.types import Floats

if TYPE_CHECKING:
    import ezc3d

_LABELS_EACH = 255
"""Most texts in one parameter."""


def write_c3d(motion: ExportedMotion, path: Path) -> None:
    """Write the recording with joint centres as further points.

    If the recording is a C3D file that ezc3d reads, its points, analog channels, events and parameters are kept as they
    are; else the file has the markers alone. A joint that is not known in a frame has the residual -1 there.

    Raises:
        RecordingError: if the file cannot be written.
        OSError: likewise.
    """
    whole = motion.with_joints()
    first = len(motion.recording.markers)
    file = _own_file(motion)
    if file is None:
        write_recording(whole, path)
    else:
        _append(file, whole.markers[first:], whole.positions[first:])
        file.write(str(path))


def _own_file(motion: ExportedMotion) -> "ezc3d.c3d | None":
    """The recording's C3D file as ezc3d reads it, if its frames and its unit are those of the recording; else None."""
    import ezc3d

    if motion.source is None or motion.recording.frames >= LONG:
        return None
    try:
        if not read_header(motion.source).sound:  # ezc3d ends the whole program on some of these
            return None
        file = ezc3d.c3d(str(motion.source))
        points, parameters = file["data"]["points"], file["parameters"]["POINT"]
        unit = UNITS.get(str(parameters["UNITS"]["value"][0]).strip())
    except Exception:  # not a C3D file; ezc3d raises many types for odd contents
        return None
    labels = parameters["LABELS"]["value"]
    room = _LABELS_EACH - len(motion.skeleton.joints)
    same = points.shape[2] == motion.recording.frames and len(labels) == points.shape[1] <= room
    if not same or unit is None or not _same_scale(points, unit, motion.recording.positions):
        return None
    return file


def _same_scale(points: Floats, unit: float, positions: Floats) -> bool:
    """True if the file's numbers, in its unit, have the size of the recording's, so that no option changed them."""
    sizes = [float(np.nanmedian(np.abs(x))) for x in (unit * points[:3], positions)]
    return 0.2 < sizes[0] / sizes[1] < 5.0 if min(sizes) > 0.0 else False


def _append(file: "ezc3d.c3d", labels: tuple[str, ...], centers: Floats) -> None:
    """Append points to a file of ezc3d: places (points, 3, frames) in metres."""
    parameters = file["parameters"]["POINT"]
    unit = UNITS[str(parameters["UNITS"]["value"][0]).strip()]
    unknown = np.isnan(centers).any(axis=1)
    points = np.ones((4, len(centers), centers.shape[2]))
    points[:3] = centers.transpose(1, 0, 2) / unit
    points[:3, unknown] = np.nan
    meta = file["data"]["meta_points"]
    residuals = np.where(unknown, -1.0, 0.0)[None]
    masks = np.zeros((meta["camera_masks"].shape[0], len(centers), centers.shape[2]), dtype=bool)
    meta["residuals"] = np.concatenate([meta["residuals"], residuals], axis=1)
    meta["camera_masks"] = np.concatenate([meta["camera_masks"], masks], axis=1)
    file["data"]["points"] = np.concatenate([file["data"]["points"], points], axis=1)
    parameters["LABELS"]["value"] = [*parameters["LABELS"]["value"], *labels]
    descriptions = parameters.get("DESCRIPTIONS")
    if descriptions is not None and len(descriptions["value"]) == len(parameters["LABELS"]["value"]) - len(labels):
        descriptions["value"] = [*descriptions["value"], *["joint centre"] * len(labels)]
