"""Write a skeleton to files for other programs; the end of a file's name decides its format."""

from collections.abc import Callable
from pathlib import Path

from study.recordings.export.files import write_bvh, write_csv, write_mot, write_trc
from study.recordings.export.tree import ExportedMotion
from study.recordings.formats.write import replacing_named
from study.recordings.recording import RecordingError

Writer = Callable[[ExportedMotion, Path], None]


def _write_c3d(motion: ExportedMotion, path: Path) -> None:
    from study.recordings.export.files import write_c3d  # its library comes with the extra mocap

    write_c3d(motion, path)


def _write_gltf(motion: ExportedMotion, path: Path) -> None:
    from study.recordings.export.gltf import write_gltf  # its library comes with the extra mocap

    write_gltf(motion, path)


WRITERS: dict[str, tuple[Writer, str]] = {
    ".c3d": (_write_c3d, "markers and joint centres"),
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
        folder: for files that are given by the ends of their names...
        name: ...and the first part of these names.
        source: the recording, which is never overwritten.

    Raises:
        RecordingError: if a name has another end, is given twice, or is that of the recording.
    """
    paths: list[Path] = []
    for text in filter(None, (part.strip() for part in texts.split(","))):
        path = folder / f"{name}.{text}" if f".{text.lower()}" in WRITERS else Path(text)
        if path.suffix.lower() not in WRITERS:
            known = ", ".join(f"{suffix} ({contents})" for suffix, (_, contents) in WRITERS.items())
            raise RecordingError(f"--write {text}: the end of a file's name decides its format; known are {known}")
        if path.exists() and source.exists() and path.samefile(source):
            raise RecordingError(
                f"--write {text}: is the recording itself, which is not overwritten; choose another name"
            )
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
    writer, _ = WRITERS[path.suffix.lower()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing_named(path) as temporary:
            writer(motion, temporary)
    except ModuleNotFoundError as error:
        raise RecordingError(f"{path}: writing it needs {error.name}: pip install '.[mocap]'") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from None
    except RecordingError as error:
        raise RecordingError(str(error).replace(str(temporary), str(path))) from None
    return path
