"""Read the TSV export of Qualisys Track Manager: lines with a key and its values, then rows of coordinates.

Source: Qualisys Track Manager User Manual, "TSV file formats": keys NO_OF_FRAMES, NO_OF_MARKERS, FREQUENCY,
DATA_INCLUDED, MARKER_NAMES and others; optionally TRAJECTORY_TYPES, a line of column headers, and the columns Frame and
Time; millimetres; a missing sample is empty, NULL, or 0 in all three.
"""

import re

import numpy as np

from study.mocap.io.assembly import FileContents
from study.mocap.io.formats.rows import Rows, as_points, missing_frames_note, with_all_frames
from study.mocap.io.recording import RecordingError

KEY = "NO_OF_FRAMES"
_NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?$")
_ABSENT = ("", "null", "nan")


def read_qualisys(lines: list[str]) -> FileContents:
    """Read a TSV file of trajectories.

    Raises:
        RecordingError: one line, without the file's name: it holds rigid bodies (6D) and no trajectories, lacks its
            markers' names or its rate, or its rows do not fit the names.
    """
    header, start = _header(lines)
    kind = " ".join(header.get("DATA_INCLUDED", [])).strip().upper()
    if kind and not kind.startswith("3D"):
        raise RecordingError(f"it holds {kind} data; export the trajectories (3D) from Qualisys Track Manager")
    labels = [name for name in header.get("MARKER_NAMES", []) if name]
    if not labels:
        raise RecordingError("no line MARKER_NAMES with the markers' names")
    try:
        rate = float(header["FREQUENCY"][0].replace(",", "."))
    except (KeyError, ValueError, IndexError):
        raise RecordingError("no line FREQUENCY with the frames per second") from None
    end = max((i for i, line in enumerate(lines, start=1) if line.strip()), default=0)
    rows = lines[start:end]
    wanted = 3 * len(labels)
    cells = max((len(row.rstrip("\r\n").split("\t")) for row in rows), default=wanted)
    extra = 2 if cells >= wanted + 2 else 0  # Frame and Time, if they were exported; a row may end in a tab
    numbers = Rows(rows, start + 1, "\t").numbers(wanted + extra)
    notes: tuple[str, ...] = ()
    if extra:
        numbers, notes = with_all_frames(numbers[:, 0], numbers, start + 1)
    promised = "".join(header[KEY][:1])
    notes += missing_frames_note(len(numbers), int(promised)) if promised.isdigit() else ()
    points = as_points(np.ascontiguousarray(numbers[:, extra:]))
    return FileContents(labels, points, rate, "mm", notes=notes)


def _header(lines: list[str]) -> tuple[dict[str, list[str]], int]:
    """The values of each key, and the number of the first line of rows, from 0."""
    header: dict[str, list[str]] = {}
    for number, line in enumerate(lines):
        cells = [cell.strip() for cell in line.split("\t")]
        if "MARKER_NAMES" in header and _is_row(cells):
            return header, number
        if cells[0]:
            header[cells[0].rstrip(":").upper()] = cells[1:]
    return header, len(lines)


def _is_row(cells: list[str]) -> bool:
    """True for cells that are numbers or missing samples."""
    return any(cells) and all(cell.lower() in _ABSENT or _NUMBER.match(cell) for cell in cells)
