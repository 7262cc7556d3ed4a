"""Check the header of a C3D file before a library reads it: its number of frames, and its chain of parameters.

A file begins with a block of 512 bytes that gives the place of the parameters. These are a chain of records, each with
the distance to the next one (c3d.org, The C3D File Format: User Guide).
"""

import math
import struct
from dataclasses import dataclass
from pathlib import Path

from study.mocap.io.recording import RecordingError

LONG = 65535
"""The largest number of frames in a header; longer recordings have this number there."""
_BLOCK = 512
_MAGIC = 0x50
_MIPS = 86  # a processor with the high byte first; Intel is 84, DEC 85
_MOST = 255 * _BLOCK  # bytes of parameters, at most


@dataclass(frozen=True)
class C3DHeader:
    """The header of a C3D file, as far as it is checked."""

    frames: int
    """Number of frames; `LONG` for that many or more."""
    sound: bool
    """True if each parameter ends where the next one begins."""


def read_header(path: Path) -> C3DHeader:
    """Read the header of a C3D file.

    Raises:
        RecordingError: if it is not a C3D file, or its header is not complete.
        OSError: if the file cannot be opened.
    """
    with open(path, "rb") as file:
        header = file.read(_BLOCK)
        if len(header) < 2 or header[1] != _MAGIC:
            raise RecordingError("not a C3D file" if header else "the file is empty")
        file.seek(max(header[0] - 1, 0) * _BLOCK)
        parameters = file.read(_MOST)
    if len(header) < _BLOCK or len(parameters) < 4:
        raise RecordingError("the file is cut short: its header is not complete; get a whole copy of it")
    order = ">" if parameters[3] == _MIPS else "<"
    first, last = struct.unpack_from(f"{order}HH", header, 6)
    return C3DHeader(max(last - first + 1, 0) if last < LONG else LONG, _sound(parameters, order))


def _sound(parameters: bytes, order: str) -> bool:
    """True if each record ends where the next one begins, up to the last."""
    place = 4
    try:
        while True:
            length, group = struct.unpack_from("bb", parameters, place)
            if length == 0 or group == 0:
                return True
            start = place + 2 + abs(length)  # the length is negative if the parameter is locked
            (distance,) = struct.unpack_from(f"{order}H", parameters, start)
            end = start + 2
            if group > 0:  # a parameter; a group has a negative number, and only a description
                size, dimensions = struct.unpack_from("bB", parameters, end)
                if size not in (-1, 1, 2, 4) or dimensions > 7:
                    return False
                end += 2 + dimensions
                end += abs(size) * math.prod(parameters[end - dimensions : end])
            end += 1 + parameters[end]
            if distance == 0:
                return bool(end <= len(parameters))
            place = start + distance
            if end != place:
                return False
    except (struct.error, IndexError):
        return False
