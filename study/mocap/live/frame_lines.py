"""Lines of a stream: each is a frame, a JSON object of labels and positions, ``{"LASI": [412.1, 680.3, 966.2], ...}``.

A marker that is not seen is left out, or null. Blank lines are skipped.
"""

import json
import socket
import sys
from collections.abc import Callable, Iterator

import numpy as np

from study.mocap.io.recording import RecordingError
from study.sphere.types import Floats

_LARGEST = 65536
"""Bytes of the largest datagram."""


class FrameError(Exception):
    """A line that is not a frame; the message, one line, says why."""


def read_frame(line: str, unit: float) -> dict[str, Floats]:
    """Read a frame from its line.

    Args:
        line: JSON.
        unit: metres per unit of its numbers.

    Returns:
        The place of each marker that is seen (3,), metres.

    Raises:
        FrameError: if the line is no JSON object, or a position is not three finite numbers.
    """
    try:
        values = json.loads(line)
    except (ValueError, RecursionError):
        raise FrameError("no JSON") from None
    if not isinstance(values, dict):
        raise FrameError('not an object of labels and positions, such as {"LASI": [412, 680, 966]}')
    return {label: _place(label, value) * unit for label, value in values.items() if value is not None}


def _place(label: str, value: object) -> Floats:
    numbers = value if isinstance(value, list) and len(value) == 3 else []
    if len(numbers) != 3 or not all(type(x) in (int, float) and abs(x) < 1e12 for x in numbers):
        raise FrameError(f"the position of {label!r} is not three finite numbers")
    return np.array(numbers, dtype=np.float64)


def lines_of_input() -> Iterator[str]:
    """Lines of the standard input, until its end."""
    for line in sys.stdin.buffer:
        yield line.decode("utf-8", "replace")


def lines_of_port(port: int, announce: Callable[[str], None]) -> Iterator[str]:
    """Lines of datagrams (UDP) that this machine sends to a port of its own, until an empty datagram.

    Args:
        port: its number; 0 for any free one.
        announce: receives the address, as soon as datagrams can be received.

    Raises:
        RecordingError: if the port cannot be used.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        try:
            receiver.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            reason = error.strerror if isinstance(error, OSError) else "a port is a number from 0 to 65535"
            raise RecordingError(f"--udp {port}: cannot be used: {reason}") from None
        announce(f"listening on 127.0.0.1:{receiver.getsockname()[1]}")
        while datagram := receiver.recv(_LARGEST):
            yield from datagram.decode("utf-8", "replace").splitlines()
