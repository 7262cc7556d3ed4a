"""What every command on a recording begins with: the file, the marker set on it, and a folder for what comes out."""

import re
from pathlib import Path

from study.mocap.io.reading import read_recording
from study.mocap.io.recording import RecordingError
from study.mocap.markersets.match import Match, choose, match
from study.mocap.markersets.set_file import MarkerSetError, load_markerset

RESULTS = Path("results") / "recordings"
"""Where a recording's folder is made, if no other is named."""


def opened(
    file: str | Path,
    markerset: str | None = None,
    unit: str | None = None,
    rate: float | None = None,
    subject: str | None = None,
) -> Match:
    """A recording with the marker set that fits it best, or with the one that is named.

    Args:
        file: of the recording.
        markerset: name or path of one; that with the most joints if None.
        unit: of the file's numbers; see `read_recording`.
        rate: frames per second.
        subject: whose markers to take.

    Raises:
        RecordingError: if the recording cannot be read.
        MarkerSetError: if the marker set cannot be read, or gives no joint.
    """
    recording = read_recording(file, unit=unit, rate=rate, subject=subject)
    if markerset is None:
        return choose(recording)
    found = match(load_markerset(markerset), recording)
    if not found.joints:
        why = "; ".join(f"{joint}: {reason}" for joint, reason in list(found.lost.items())[:3])
        raise MarkerSetError(f"{file}: none of the joints of marker set {markerset} can be found ({why}, ...)")
    return found


def folder_for(name: str, out: Path | None = None) -> Path:
    """The folder for what comes out of a recording: the one that is asked for, or one of the recording's name.

    A recording may be called anything, such as ``..``; its folder is always one below `RESULTS`.

    Raises:
        RecordingError: if there is a file in its place.
    """
    plain = re.sub(r"[^\w.-]+", "-", name).strip(".-") or "recording"
    folder = RESULTS / plain[:100] if out is None else out
    if folder.exists() and not folder.is_dir():
        raise RecordingError(f"{folder}: is a file, not a folder; choose another with --out")
    return folder
