"""Read markers from text: the format is recognised by the file's contents, not by its name alone."""

from pathlib import Path

from study.mocap.io.assembly import FileContents
from study.mocap.io.formats import motive, qualisys
from study.mocap.io.formats.table import read_table
from study.mocap.io.formats.trc import read_trc
from study.mocap.io.formats.two_lines import find_axes, read_two_lines
from study.mocap.io.formats.vicon import read_vicon
from study.mocap.io.recording import RecordingError

_OPENINGS = ("PathFileType", qualisys.KEY, motive.KEY, "Trajectories")
"""Words with which files of a known format begin."""
_FIRST = 50
"""Lines in which a file says what it is."""


def read_text(path: Path) -> FileContents:
    """Read markers from a text file: TRC, Qualisys, Motive, Vicon Nexus, or a table.

    Rate and unit come from the header of the format; in other tables from lines ``# rate: 120`` and ``# unit: mm``, or
    from a column ``time`` in seconds. Empty cells are missing samples.

    Raises:
        RecordingError: one line, without the file's name.
        OSError: if the file cannot be read.
    """
    data = path.read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    lines = text.splitlines()
    if not any(line.strip() for line in lines):
        raise RecordingError("the file is empty")
    if "\0" in text:
        raise RecordingError("not a text file")
    opening = lines[0].lstrip().lstrip('"')
    if opening.startswith("PathFileType") or path.suffix.lower() == ".trc":
        return read_trc(lines)
    if opening.startswith(motive.KEY):
        return motive.read_motive(lines)
    for number, line in enumerate(lines[:_FIRST]):
        if line.startswith(f"{qualisys.KEY}\t"):
            return qualisys.read_qualisys(lines)
        if line.strip().strip(",;\t\"'").lower() == "trajectories":
            return read_vicon(lines, number)
    axes = find_axes(lines)
    return read_table(lines) if axes is None else read_two_lines(lines, axes)


def is_known_text(head: bytes) -> bool:
    """True for the first bytes of a file that says which format it has, whatever its name is."""
    text = head.decode("latin-1").removeprefix("\xef\xbb\xbf").lstrip().lstrip('"')
    return text.startswith(_OPENINGS)
