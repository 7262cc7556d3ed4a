"""Read a recording from a file of any known format, which its contents tell, not its name alone."""

from pathlib import Path

from study.files import regular
from study.recordings.formats import exports
from study.recordings.formats.text import find_axes, read_columns, read_table, read_trc, read_vicon
from study.recordings.recording import FileContents, Recording, RecordingError, assemble, frames_between, printable

_OPENINGS = ("PathFileType", exports.QUALISYS_KEY, exports.MOTIVE_KEY, "Trajectories")
"""Words with which files of a known format begin."""
_FIRST = 50
"""Lines in which a file says what it is."""


def read_text(path: Path) -> FileContents:
    """Read markers from a text file: TRC, Qualisys, Motive, Vicon Nexus, BTK, or a table.

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
    if opening.startswith(exports.MOTIVE_KEY):
        return exports.read_motive(lines)
    for number, line in enumerate(lines[:_FIRST]):
        if line.startswith(f"{exports.QUALISYS_KEY}\t"):
            return exports.read_qualisys(lines)
        if line.strip().strip(",;\t\"'").lower() == "trajectories":
            return read_vicon(lines, number)
    axes = find_axes(lines)
    return read_table(lines) if axes is None else read_columns(lines, axes)


def is_known_text(head: bytes) -> bool:
    """True for the first bytes of a file that says which format it has, whatever its name is."""
    text = head.decode("latin-1").removeprefix("\xef\xbb\xbf").lstrip().lstrip('"')
    return text.startswith(_OPENINGS)


FORMATS = (".c3d", ".csv", ".trc", ".tsv", ".txt")
"""Ends of names; files of other names are read if their contents say what they are."""
C3D_MAGIC = b"\x50"
"""The second byte of each C3D file."""
_PRINTABLE = 32
"""The first byte of a C3D file, the place of its parameters, is smaller; that of a text is not."""
_HEAD = 64
"""Bytes that tell a format."""


def read_recording(
    path: str | Path,
    *,
    unit: str | None = None,
    rate: float | None = None,
    subject: str | None = None,
    frames: str | None = None,
) -> Recording:
    """Read a recording.

    Args:
        path: ``.c3d``; ``.trc``; ``.csv``, ``.tsv`` or ``.txt`` with columns ``LFHD_X``, ``LFHD_Y``, ``LFHD_Z``, or as
            exported by Vicon, Qualisys, Motive or Cortex. C3D and these exports are recognised by what is in the file,
            under any name.
        unit: of the file's numbers, m, cm, mm, ...; overrides the file.
        rate: frames per second; overrides the file.
        subject: the subject whose markers to take, if the file has several.
        frames: a range such as ``1-499``, from 1, both ends included; all if None.

    Returns:
        The recording, in metres.

    Raises:
        RecordingError: one line with the file, the fault and the remedy.

    Example:
        >>> import study
        >>> with open("walk.csv", "w") as file:
        ...     for line in ("time,LASI_X,LASI_Y,LASI_Z", "0.00,412,680,966", "0.01,413,680,966"):
        ...         print(line, file=file)
        >>> recording = study.read_recording("walk.csv", unit="mm")
        >>> recording.markers, recording.frames, recording.rate
        (('LASI',), 2, 100.0)
        >>> recording.of("LASI")[:, 0]
        array([0.412, 0.68 , 0.966])
    """
    path = Path(path)
    name = printable(path.stem)
    try:
        if path.exists():
            regular(path)
        if _is_c3d(path):
            from study.recordings.formats.c3d import read_c3d  # its libraries come with the extra mocap

            # C3D files without a unit are usually in millimetres
            recording = assemble(read_c3d(path), name, unit=unit, rate=rate, subject=subject, usual_unit="mm")
        else:
            recording = assemble(read_text(path), name, unit=unit, rate=rate, subject=subject)
        return recording if frames is None else frames_between(recording, frames)
    except ModuleNotFoundError as error:
        raise RecordingError(f"{path}: reading it needs {error.name}: pip install '.[mocap]'") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None


def _is_c3d(path: Path) -> bool:
    """True for a C3D file by its contents, or by its name if the contents say nothing.

    Raises:
        RecordingError: if neither name nor contents are those of a recording.
        OSError: if the file cannot be read.
    """
    suffix = path.suffix.lower()
    head = b""
    if suffix in FORMATS or path.is_file():
        with open(path, "rb") as file:
            head = file.read(_HEAD)
    if head[1:2] == C3D_MAGIC and head[0] < _PRINTABLE:
        return True
    if is_known_text(head):
        return False
    if suffix not in FORMATS:
        raise RecordingError(f"a recording is a file whose name ends in {', '.join(FORMATS)}")
    return suffix == ".c3d"
