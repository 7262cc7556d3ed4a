"""Write a skeleton to files for other programs; the end of a file's name decides its format.

- BVH (Biovision hierarchy), which Blender and other animation programs open: y points up, as importers expect, so that
  (x, y, z) of a skeleton is (x, z, -y) there. In a T-pose the body looks along z. Units are metres and degrees, and
  rotations are in the order Z, X, Y. Source: Meredith & Maddock 2001, Motion capture file formats explained.
- C3D: joint centres as points beside the markers and all else that the recording's own file holds.
- GLB: see `export.gltf`.
- MOT: joint angles. Source: OpenSim documentation, "Motion (.mot) Files".
- TRC: joint centres as points beside the markers; CSV: the table of joints.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from study.arrays import Floats
from study.recordings.export.tree import Y_UP, ExportedMotion, JointNode, angle_lines, joint_angles, joint_tree
from study.recordings.formats.write import write_recording
from study.recordings.recording import UNITS, GaitEvent, RecordingError, written
from study.recordings.rigid import zxy_angles
from study.recordings.skeleton.scene import skeleton_table
from study.text import inert_frame

if TYPE_CHECKING:
    import ezc3d

_ROTATIONS = "Zrotation Xrotation Yrotation"
_POSITIONS = "Xposition Yposition Zposition"


def write_bvh(motion: ExportedMotion, path: Path) -> None:
    """Write a skeleton as BVH.

    Raises:
        RecordingError: if the root is known in no frame.
        OSError: if the file cannot be written.
    """
    lines = ["HIERARCHY"]
    columns: list[Floats] = []
    _describe(joint_tree(motion), "", lines, columns)
    rows = np.concatenate(columns).T
    lines += ["MOTION", f"Frames: {motion.skeleton.frames}", f"Frame Time: {1.0 / motion.skeleton.rate:.12g}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in rows.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _describe(node: JointNode, indent: str, lines: list[str], columns: list[Floats]) -> None:
    """Add a node and all below it to the hierarchy, and its channels to the columns."""
    channels = f"CHANNELS 3 {_ROTATIONS}" if node.course is None else f"CHANNELS 6 {_POSITIONS} {_ROTATIONS}"
    inner = indent + "  "
    name = "_".join(node.name.split())
    start, end = (" ".join(f"{value:.6f}" for value in Y_UP @ place) for place in (node.offset, node.end))
    lines += [
        f"{indent}{'JOINT' if indent else 'ROOT'} {name}",
        indent + "{",
        f"{inner}OFFSET {start}",
        inner + channels,
    ]
    if node.course is not None:
        columns.append(Y_UP @ node.course)
    columns.append(np.degrees(zxy_angles(np.einsum("ij,jkt,lk->ilt", Y_UP, node.rotation, Y_UP))))
    for child in node.children:
        _describe(child, inner, lines, columns)
    if not node.children:
        lines += [f"{inner}End Site", inner + "{", f"{inner}  OFFSET {end}", inner + "}"]
    lines.append(indent + "}")


_LABELS_EACH = 255
"""Most texts in one parameter."""


def write_c3d(motion: ExportedMotion, path: Path, events: Sequence[GaitEvent] = ()) -> None:
    """Write the recording with joint centres as further points, and with further gait events.

    If the recording is a C3D file that ezc3d reads, its points, analog channels, events and parameters are kept as they
    are; else the file has the markers alone. A joint that is not known in a frame has the residual -1 there. Of the
    events those that come from the file are in it already.

    Raises:
        RecordingError: if the file cannot be written.
        OSError: likewise.
    """
    whole, first, file = motion.with_joints(), len(motion.recording.markers), _own_file(motion)
    if file is None:
        write_recording(whole, path)
        if events:
            import ezc3d

            file = ezc3d.c3d(str(path))
            _add_events(file, [event._replace(source="markers") for event in events])
            file.write(str(path))
        return
    labels, centers, parameters = list(whole.markers[first:]), whole.positions[first:], file["parameters"]["POINT"]
    unknown, data, meta = np.isnan(centers).any(axis=1), file["data"], file["data"]["meta_points"]
    points = np.ones((4, len(centers), centers.shape[2]))
    points[:3] = centers.transpose(1, 0, 2) / UNITS[str(parameters["UNITS"]["value"][0]).strip()]
    points[:3, unknown] = np.nan
    residuals = np.where(unknown, -1.0, 0.0)[None]
    masks = np.zeros((meta["camera_masks"].shape[0], *residuals.shape[1:]), dtype=bool)
    meta["residuals"] = np.concatenate([meta["residuals"], residuals], axis=1)
    meta["camera_masks"] = np.concatenate([meta["camera_masks"], masks], axis=1)
    data["points"] = np.concatenate([data["points"], points], axis=1)
    own, descriptions = parameters["LABELS"]["value"], parameters.get("DESCRIPTIONS")
    if descriptions is not None and len(descriptions["value"]) == len(own):
        descriptions["value"] = [*descriptions["value"], *["joint centre"] * len(labels)]
    parameters["LABELS"]["value"] = [*own, *labels]
    _add_events(file, [event for event in events if event.source != "file"])
    file.write(str(path))


def _add_events(file: "ezc3d.c3d", events: Sequence[GaitEvent]) -> None:
    """Add events to those of a C3D file, under the names and with the times that Vicon's programs give them."""
    if not events:
        return
    points, group = file["header"]["points"], file["parameters"].get("EVENT", {})
    started, words = points["first_frame"] / points["frame_rate"], {"strike": "Foot Strike", "off": "Foot Off"}
    new: dict[str, list[object]] = {
        "CONTEXTS": [event.side.capitalize() for event in events],
        "LABELS": [words[event.kind] for event in events],
        "DESCRIPTIONS": [f"by {event.source}" for event in events],
        "SUBJECTS": [""] * len(events),
        "ICON_IDS": [1 if event.kind == "strike" else 2 for event in events],
        "GENERIC_FLAGS": [0] * len(events),
    }
    there = len(group["LABELS"]["value"]) if "LABELS" in group else 0
    for name, values in new.items():
        old = list(group[name]["value"]) if name in group else []
        file.add_parameter("EVENT", name, [*(old if len(old) == there else [values[0]] * there), *values])
    old_times = np.reshape(group["TIMES"]["value"], (2, -1)) if there else np.empty((2, 0))
    minutes, seconds = np.divmod([started + event.time for event in events], 60.0)
    file.add_parameter("EVENT", "TIMES", np.hstack([old_times, [minutes, seconds]]))
    file.add_parameter("EVENT", "USED", [there + len(events)])


def _own_file(motion: ExportedMotion) -> "ezc3d.c3d | None":
    """The recording's C3D file as ezc3d reads it, if its frames and its unit are those of the recording; else None."""
    import ezc3d

    from study.recordings.formats.c3d import LONG, read_header

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
    most = _LABELS_EACH - len(motion.skeleton.joints)
    whole = points.shape[2] == motion.recording.frames and len(labels) == points.shape[1] <= most
    if not whole or unit is None:
        return None
    sizes = [float(np.nanmedian(np.abs(x))) for x in (unit * points[:3], motion.recording.positions)]
    # its numbers, in its unit, must have the size of the recording's, so that no option changed them
    return file if min(sizes) > 0.0 and 0.2 < sizes[0] / sizes[1] < 5.0 else None


def write_mot(motion: ExportedMotion, path: Path) -> None:
    """Write joint angles in degrees, and the root's place in metres.

    OpenSim's readers cannot read a missing number, nor the numbers after it. So angles that are known in no frame are
    left out, and an angle that is unknown in a frame keeps its last value; the table of angles shows these frames.

    Raises:
        OSError: if the file cannot be written.
    """
    table = joint_angles(motion).dropna(axis=1, how="all").ffill().bfill()
    header = ["; ".join([motion.skeleton.name, *angle_lines(motion.skeleton.calibration)]), "version=1"]
    header += [f"nRows={len(table)}", f"nColumns={len(table.columns)}", "inDegrees=yes", "endheader"]
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(header) + "\n")
        table.to_csv(file, sep="\t", index=False, float_format="%.6f", lineterminator="\n")


def write_trc(motion: ExportedMotion, path: Path) -> None:
    """Write the recording with joint centres as further markers, in the recording's axes, millimetres.

    Raises:
        RecordingError: if the file cannot be written.
    """
    write_recording(motion.with_joints(), path)


def write_csv(motion: ExportedMotion, path: Path) -> None:
    """Write the table of joints (see `skeleton_table`): a row per frame and joint, metres, z up.

    Raises:
        OSError: if the file cannot be written.
    """
    inert_frame(skeleton_table(motion.scene)).to_csv(path, index=False, float_format="%.6f", lineterminator="\n")


def _write_gltf(motion: ExportedMotion, path: Path) -> None:
    from study.recordings.export.gltf import write_gltf  # its library comes with the extra mocap

    write_gltf(motion, path)


WRITERS: dict[str, tuple[Callable[[ExportedMotion, Path], None], str]] = {
    ".c3d": (write_c3d, "markers and joint centres"),
    ".trc": (write_trc, "markers and joint centres"),
    ".glb": (_write_gltf, "animated bones"),
    ".bvh": (write_bvh, "animated bones"),
    ".mot": (write_mot, "joint angles"),
    ".csv": (write_csv, "table of joints"),
}
"""The writer of each end of a name, and the contents of its files."""


def planned_files(texts: str, folder: Path, name: str, source: Path) -> list[Path]:
    """Find the files that a user asks for, before any work is done.

    Args:
        texts: names of files, or ends of names, with commas between them: ``walk.trc,walk.glb`` or ``trc,glb``.
        folder: for files that are given by names without a folder, or by the ends of their names...
        name: ...and the first part of these names.
        source: the recording, which is never overwritten.

    Raises:
        RecordingError: if a name has another end, is given twice, or is that of the recording.
    """
    paths: list[Path] = []
    for part in filter(None, (part.strip() for part in texts.split(","))):
        text = part.removeprefix(".") if part.lower() in WRITERS else part
        given = Path(f"{name}.{text}" if f".{text.lower()}" in WRITERS else text)
        path = folder / given if given.name in (text, f"{name}.{text}") else given
        if path.suffix.lower() not in WRITERS:
            known = ", ".join(f"{suffix} ({contents})" for suffix, (_, contents) in WRITERS.items())
            raise RecordingError(f"--write {text}: the end of a file's name decides its format; known are {known}")
        if path.exists() and source.exists() and path.samefile(source):
            words = "is the recording itself, which is not overwritten; choose another name"
            raise RecordingError(f"--write {text}: {words}")
        if path.is_dir():
            raise RecordingError(f"--write {text}: {path} is a folder; give the name of a file")
        if path.absolute() in [other.absolute() for other in paths]:
            raise RecordingError(f"--write {text}: is given twice")
        paths.append(path)
    return paths


def write_file(motion: ExportedMotion, path: Path) -> Path:
    """Write a skeleton to a file, which is there whole, or not at all.

    Args:
        motion: the skeleton.
        path: of a name with a known end.

    Returns:
        The path.

    Raises:
        RecordingError: one line with the file's name, if it cannot be written.
    """
    return written(path, lambda temporary: WRITERS[path.suffix.lower()][0](motion, temporary))
