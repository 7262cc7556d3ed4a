"""A look at a C3D file before a library reads it: is it one, how many frames it promises, does its header hold.

A file begins with a block of 512 bytes that says where the parameters are; these are a chain of records, each with the
distance to the next one (c3d.org, The C3D File Format: User Guide).
"""

import math
import struct
from dataclasses import dataclass
from pathlib import Path

from study.mocap.io.recording import RecordingError

LONG = 65535
"""The most frames that the header can say; longer recordings say this."""
_BLOCK = 512
_MAGIC = 0x50
_MIPS = 86  # the processor whose words begin with the high byte; Intel is 84, DEC 85
_MOST = 255 * _BLOCK  # bytes of parameters


@dataclass(frozen=True)
class Header:
    """What is needed of it."""

    frames: int
    """That it promises; `LONG` for that or more."""
    sound: bool
    """Whether the chain of parameters holds together."""


def read_header(path: Path) -> Header:
    """Read the header of a C3D file.

    Raises:
        RecordingError: if it is no C3D file, or not even its header is complete.
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
    return Header(max(last - first + 1, 0) if last < LONG else LONG, _sound(parameters, order))


def _sound(parameters: bytes, order: str) -> bool:
    """Whether each record ends where the next one begins, up to the last."""
    place = 4
    try:
        while True:
            length, group = struct.unpack_from("bb", parameters, place)
            if length == 0 or group == 0:
                return True
            start = place + 2 + abs(length)  # a negative length is that of a locked one
            (distance,) = struct.unpack_from(f"{order}H", parameters, start)
            end = start + 2
            if group > 0:  # a parameter; groups have negative numbers, and nothing but a description
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
