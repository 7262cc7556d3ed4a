"""Contents of a point file, a regular file or standard input, up to a size that memory can hold."""

import os
import stat
import sys
import zipfile
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

STDIN = "-"
_MOST_BYTES = 1_000_000_000
"""Most that is read from standard input or unpacked, whose length cannot be known beforehand."""


class PointFileError(Exception):
    """A point file that cannot be read; the message says where and why."""


def opened(path: Path) -> BinaryIO:
    """Open a regular file, or standard input for ``-``, of which all is read.

    Raises:
        PointFileError: if it is something else, such as a pipe, which may never end, or too long.
        OSError: if it cannot be opened.
    """
    if str(path) == STDIN:
        contents = sys.stdin.buffer.read(_MOST_BYTES + 1)
        if len(contents) > _MOST_BYTES:
            raise PointFileError(f"standard input: more than {_MOST_BYTES:,} bytes; store it in a file")
        return BytesIO(contents)
    kind = os.stat(path).st_mode
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):  # to open a folder fails by itself, with the system's words
        raise PointFileError(f"{path}: not a regular file; for a pipe, give - and let it be standard input")
    return open(path, "rb")


def size(file: BinaryIO) -> int:
    """Number of bytes of an open file, which is then at its beginning."""
    length = file.seek(0, os.SEEK_END)
    file.seek(0)
    return length


def unpacked_names(path: Path, file: BinaryIO) -> list[str]:
    """Names of the files in a ZIP archive, which is then at its beginning.

    Raises:
        PointFileError: if it is damaged, or unpacks to more than memory should hold.
    """
    try:
        members = zipfile.ZipFile(file).infolist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError):
        raise PointFileError(f"{path}: a ZIP archive that cannot be read") from None
    if sum(member.file_size for member in members) > _MOST_BYTES:
        raise PointFileError(f"{path}: unpacks to more than {_MOST_BYTES:,} bytes; save its points as .npy or text")
    file.seek(0)
    return [member.filename for member in members]


def optional(module: str, path: Path, what: str, way_out: str) -> Any:
    """Import a library that reads a format and is not among those always installed.

    Raises:
        PointFileError: if it is not there, with the command that installs it, and another way.
    """
    try:
        return import_module(module)
    except ImportError:
        raise PointFileError(
            f"{path}: {what}, for which {module} is not installed: pip install 'sphere-fit-study[points]', or {way_out}"
        ) from None
