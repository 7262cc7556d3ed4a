"""Check the header of a C3D file before a library reads it: its frames, its parameters, and what it promises.

A file begins with a block of 512 bytes that gives the number of points and frames and the places of the parameters and
of the data (c3d.org, The C3D File Format: User Guide). Libraries reserve memory for what is promised there: a damaged
header of a small file may promise terabytes.
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from study.mocap.io.c3d_parameters import read_parameters
from study.mocap.io.recording import RecordingError

LONG = 65535
"""The largest number of frames in a header; longer recordings have this number there."""
_BLOCK = 512
_MAGIC = 0x50
_INTEL, _MIPS = 84, 86  # processors: Intel has the low byte first, MIPS the high byte; DEC, 85, swaps words of numbers
_MOST = 255 * _BLOCK  # bytes of parameters, at most
_MUCH = 2.0
"""Promised size, in units of the file's, above which a file is damaged, not just cut short."""
_LITTLE = 1 << 20
"""Bytes that may be promised whatever the file's size."""


@dataclass(frozen=True)
class C3DHeader:
    """The header of a C3D file, as far as it is checked."""

    frames: int
    """Number of frames; `LONG` for that many or more."""
    sound: bool
    """True if each parameter ends where the next one begins, and none promises more than the file can hold."""
    rate: float
    """Frames per second by the header; 0 if it gives none."""


class _Fields(NamedTuple):
    """Numbers of the header's first block."""

    points: int
    analog: int
    first: int
    last: int
    data_block: int
    width: int
    """Bytes of a number in the data."""
    rate: float

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame: four numbers a point, one an analog sample."""
        return (4 * self.points + self.analog) * self.width


def read_header(path: Path) -> C3DHeader:
    """Read the header of a C3D file.

    Raises:
        RecordingError: if it is not a C3D file, its header is not complete, or promises far more than the file holds.
        OSError: if the file cannot be opened.
    """
    with open(path, "rb") as file:
        header = file.read(_BLOCK)
        if len(header) < 2 or header[1] != _MAGIC:
            raise RecordingError("not a C3D file" if header else "the file is empty")
        file.seek(max(header[0] - 1, 0) * _BLOCK)
        data = file.read(_MOST)
        size = file.seek(0, 2)
    if len(header) < _BLOCK or len(data) < 4:
        raise RecordingError("the file is cut short: its header is not complete; get a whole copy of it")
    order = ">" if data[3] == _MIPS else "<"
    parameters = read_parameters(data, order)
    fields = _fields(header, order, data[3])
    frames = max(fields.last - fields.first + 1, 0) if fields.last < LONG else LONG
    room = max(size - max(fields.data_block - 1, 0) * _BLOCK, 0)
    told = int(parameters.numbers.get("POINT:FRAMES", 0.0))
    if 1 < told < frames and frames * fields.frame_bytes > room >= told * fields.frame_bytes:
        frames = told  # one of the two is damaged, and the file is as long as the parameter says
    promised = frames * fields.frame_bytes
    if promised > _MUCH * size + _LITTLE:
        raise RecordingError(
            f"its header promises {frames} frames of {fields.points} points and {fields.analog} analog samples, "
            f"{_size(promised)}, but the file has {_size(size)}: it is damaged; get a whole copy of it"
        )
    rotations = frames * parameters.numbers.get("ROTATION:RATIO", 0.0) * 4
    return C3DHeader(frames, parameters.sound and rotations <= _MUCH * size + _LITTLE, fields.rate)


def _fields(header: bytes, order: str, processor: int) -> _Fields:
    points, analog, first, last = struct.unpack_from(f"{order}HHHH", header, 2)
    (block,) = struct.unpack_from(f"{order}H", header, 16)
    sign = header[{_INTEL: 15, _MIPS: 12}.get(processor, 13)] & 0x80  # a negative scale: the data are single precision
    rate = 0.0
    if processor in (_INTEL, _MIPS):
        (rate,) = struct.unpack_from(f"{order}f", header, 20)
    return _Fields(points, analog, first, last, block, 4 if sign else 2, rate if 0.0 < rate < 1e6 else 0.0)


def _size(count: int) -> str:
    """A number of bytes in words."""
    for power, unit in ((4, "TB"), (3, "GB"), (2, "MB"), (1, "kB")):
        if count >= 1000**power:
            return f"{count / 1000**power:.3g} {unit}"
    return f"{count} bytes"
