"""Read a recording from a file of any known format."""

from pathlib import Path

from study.mocap.io.assembly import assemble
from study.mocap.io.recording import Recording, RecordingError

FORMATS = (".c3d", ".csv", ".trc", ".tsv", ".txt")


def read_recording(
    path: str | Path, *, unit: str | None = None, rate: float | None = None, subject: str | None = None
) -> Recording:
    """Read a recording.

    Args:
        path: ``.c3d``; ``.trc``; ``.csv``, ``.tsv`` or ``.txt`` with columns ``LFHD_X``, ``LFHD_Y``, ``LFHD_Z`` or as
            exported by Vicon.
        unit: of the file's numbers, m, cm, mm, ...; overrides the file.
        rate: frames per second; overrides the file.
        subject: the subject whose markers to take, if the file has several.

    Returns:
        The recording, in metres.

    Raises:
        RecordingError: one line with the file, the fault and the remedy.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise RecordingError(f"{path}: a recording is a file whose name ends in {', '.join(FORMATS)}")
    try:
        if suffix == ".c3d":
            from study.mocap.io.c3d_file import read_c3d  # its libraries come with the extra mocap

            # C3D files without a unit are usually in millimetres
            return assemble(read_c3d(path), path.stem, unit=unit, rate=rate, subject=subject, usual_unit="mm")
        from study.mocap.io.text_file import read_text

        return assemble(read_text(path), path.stem, unit=unit, rate=rate, subject=subject)
    except ModuleNotFoundError as error:
        raise RecordingError(f"{path}: reading it needs {error.name}: pip install '.[mocap]'") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
