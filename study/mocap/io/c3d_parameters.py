"""The parameters of a C3D file, as far as they are checked before a library reads it.

They are a chain of records, each with the distance to the next one (c3d.org, The C3D File Format: User Guide).
"""

import math
import struct
from collections.abc import Iterator, Mapping
from typing import NamedTuple

_TEXT = -1
_SIZES = {_TEXT: "", 1: "b", 2: "H", 4: "f"}
"""Letters of `struct` for the numbers, by their size in bytes."""


class _Record(NamedTuple):
    """A group or a parameter."""

    group: int
    """Number of the group, negative in the record of the group itself."""
    name: str
    size: int
    """Bytes of one value; -1 for text; 0 for a group."""
    dimensions: tuple[int, ...]
    start: int
    """Place of the first value."""


class C3DParameters(NamedTuple):
    """The parameters of a file."""

    sound: bool
    """True if each record ends where the next one begins, and no text lacks its length."""
    numbers: Mapping[str, float]
    """The first number of each parameter that holds numbers, by ``GROUP:NAME``."""


def read_parameters(data: bytes, order: str) -> C3DParameters:
    """Follow the chain of parameters.

    Args:
        data: the file's bytes from its block of parameters on.
        order: of bytes, as `struct` has it: ``<`` or ``>``.
    """
    groups: dict[int, str] = {}
    found: list[_Record] = []
    sound = True
    try:
        for record in _records(data, order):
            if record.group < 0:
                groups[-record.group] = record.name
            else:
                found.append(record)
                sound &= record.size != _TEXT or len(record.dimensions) > 0  # ezc3d ends the program on these
    except (struct.error, IndexError, ValueError):
        sound = False
    numbers = {
        f"{groups.get(record.group, '')}:{record.name}": float(
            struct.unpack_from(f"{order}{_SIZES[record.size]}", data, record.start)[0]
        )
        for record in found
        if record.size > 0 and 0 not in record.dimensions
    }
    return C3DParameters(sound, numbers)


def _records(data: bytes, order: str) -> Iterator[_Record]:
    """The records, up to the last one.

    Raises:
        ValueError: where the chain breaks; `struct.error` and IndexError where it leaves the data.
    """
    place = 4
    dimensions: tuple[int, ...]
    while True:
        length, group = struct.unpack_from("bb", data, place)
        if length == 0 or group == 0:
            return
        start = place + 2 + abs(length)  # the length is negative if the parameter is locked
        name = data[place + 2 : start].decode("latin-1").strip().upper()
        (distance,) = struct.unpack_from(f"{order}H", data, start)
        end, size, dimensions = start + 2, 0, ()
        if group > 0:  # a parameter; a group has a negative number, and only a description
            size, count = struct.unpack_from("bB", data, end)
            if size not in _SIZES or count > 7:
                raise ValueError("not a parameter")
            end += 2 + count
            dimensions = tuple(data[end - count : end])
            values, end = end, end + abs(size) * math.prod(dimensions)
        else:
            values = end
        end += 1 + data[end]
        if (distance and start + distance != end) or end > len(data):
            raise ValueError("a record does not end where the next one begins")
        yield _Record(group, name, size, dimensions, values)
        if not distance:
            return
        place = end
