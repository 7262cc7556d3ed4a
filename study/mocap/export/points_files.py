"""The skeleton's joints as text: points in a TRC file beside the markers, and the table of joints as CSV."""

from pathlib import Path

from study.mocap.export.motion import ExportedMotion
from study.mocap.io.writing import write_recording
from study.mocap.skeleton.skeleton_table import skeleton_table
from study.text.spreadsheet_cell import inert_frame


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
