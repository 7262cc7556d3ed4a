"""Contents of a point file, a regular file or standard input, up to a size that memory can hold."""

import os
import stat
import sys
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

STDIN = "-"
_MOST_BYTES = 1_000_000_000
"""Most that is read from standard input, whose length cannot be known beforehand."""


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
