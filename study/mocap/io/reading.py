"""Read a recording from a file of any known format."""

from pathlib import Path

from study.mocap.io.assembly import assemble
from study.mocap.io.labels import printable
from study.mocap.io.recording import Recording, RecordingError
from study.mocap.io.text_file import is_known_text, read_text
from study.text.regular_file import regular

FORMATS = (".c3d", ".csv", ".trc", ".tsv", ".txt")
"""Ends of names; files of other names are read if their contents say what they are."""
C3D_MAGIC = b"\x50"
"""The second byte of each C3D file."""
_PRINTABLE = 32
"""The first byte of a C3D file, the place of its parameters, is smaller; that of a text is not."""
_HEAD = 64
"""Bytes that tell a format."""


def read_recording(
    path: str | Path, *, unit: str | None = None, rate: float | None = None, subject: str | None = None
) -> Recording:
    """Read a recording.

    Args:
        path: ``.c3d``; ``.trc``; ``.csv``, ``.tsv`` or ``.txt`` with columns ``LFHD_X``, ``LFHD_Y``, ``LFHD_Z``, or as
            exported by Vicon, Qualisys, Motive or Cortex. C3D and these exports are recognised by what is in the file,
            under any name.
        unit: of the file's numbers, m, cm, mm, ...; overrides the file.
        rate: frames per second; overrides the file.
        subject: the subject whose markers to take, if the file has several.

    Returns:
        The recording, in metres.

    Raises:
        RecordingError: one line with the file, the fault and the remedy.
    """
    path = Path(path)
    name = printable(path.stem)
    try:
        if _is_c3d(regular(path)):
            from study.mocap.io.c3d_file import read_c3d  # its libraries come with the extra mocap

            # C3D files without a unit are usually in millimetres
            return assemble(read_c3d(path), name, unit=unit, rate=rate, subject=subject, usual_unit="mm")
        return assemble(read_text(path), name, unit=unit, rate=rate, subject=subject)
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
