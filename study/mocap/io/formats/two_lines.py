"""Read a table with two lines of headers: a marker's label above the first of its columns, the axes below.

Cortex exports trajectories as text in this form, and spreadsheets save it: labels in one line, ``X1, Y1, Z1, X2, …``
or ``X, Y, Z, X, …`` in the next; lines with a key and a value, such as a rate, may stand above.
"""

import re

import numpy as np

from study.mocap.io.assembly import FileContents
from study.mocap.io.formats.rows import Rows, as_points, cells_of, find_delimiter, with_all_frames
from study.mocap.io.formats.table import rate_of_times
from study.mocap.io.recording import RecordingError

_AXIS = re.compile(r"([XYZ])\s*\d*$", re.I)
_FIRST = 20
"""Lines in which the headers must be."""
_RATES = ("rate", "datarate", "frequency", "framerate", "camerarate", "samplerate")
_COUNTERS = ("frame", "frames", "item", "sample", "field")


def find_axes(lines: list[str]) -> int | None:
    """The number, from 0, of the line of axes below a line of labels; None if there is none."""
    for number, line in enumerate(lines[1:_FIRST], start=1):
        cells = cells_of(line, find_delimiter(line))
        axes = [found[1].upper() for cell in cells if (found := _AXIS.match(cell))]
        whole = len(axes) >= 3 and len(axes) % 3 == 0 and axes == list("XYZ") * (len(axes) // 3)
        others = [cell for cell in cells if cell and not _AXIS.match(cell)]
        above = lines[number - 1]
        if whole and len(others) <= 2 and not above.startswith("#") and any(cells_of(above, find_delimiter(line))):
            return number
    return None


def read_two_lines(lines: list[str], axes: int) -> FileContents:
    """Read a table whose line of axes is known (see `find_axes`).

    Raises:
        RecordingError: one line, without the file's name: a marker without a label, rows that do not fit.
    """
    delimiter = find_delimiter(lines[axes])
    low, heads = cells_of(lines[axes], delimiter), cells_of(lines[axes - 1], delimiter)
    heads += [""] * (len(low) - len(heads))
    places = [i for i, cell in enumerate(low) if (found := _AXIS.match(cell)) and found[1].upper() == "X"]
    if nameless := [i for i in places if not heads[i]]:
        raise RecordingError(f"line {axes}, column {nameless[0] + 1}: no label above the axes {low[nameless[0]]}")
    end = max(i for i, line in enumerate(lines, start=1) if line.strip())
    start = next((i for i in range(axes + 1, end) if lines[i].strip(" ,;\t")), end)
    numbers = Rows(lines[start:end], start + 1, delimiter).numbers(len(low))
    first = [(low[i] or heads[i]).lower().rstrip("#") for i in range(places[0])]
    notes: tuple[str, ...] = ()
    if first and first[0] in _COUNTERS:
        numbers, notes = with_all_frames(numbers[:, 0], numbers, start + 1)
    columns = [column for i in places for column in (i, i + 1, i + 2)]
    given = _keys(lines[: axes - 1], delimiter)
    rate = next((value for key in _RATES if (value := _number(given.get(key, ""))) is not None), None)
    return FileContents(
        labels=[heads[i] for i in places],
        points=as_points(np.ascontiguousarray(numbers[:, columns])),
        rate=rate_of_times(first, numbers, start + 1) if rate is None else rate,
        unit=given.get("unit") or given.get("units") or None,
        notes=notes,
    )


def _keys(lines: list[str], delimiter: str) -> dict[str, str]:
    """Values of keys above the headers: a key and its value in one line, or keys in one line and values below."""
    given: dict[str, str] = {}
    table = [cells_of(line.lstrip("# "), delimiter) for line in lines]
    for cells, below in zip(table, [*table[1:], []], strict=True):
        if len(cells) > 1 and _number(cells[0]) is None and (len(cells) == 2 or not any(cells[2:])):
            given.setdefault(_plain(cells[0]), cells[1])
        elif len(cells) == 1 and ":" in cells[0]:
            key, _, value = cells[0].partition(":")
            given.setdefault(_plain(key), value.strip())
        else:
            for key, value in zip(cells, below, strict=False):
                given.setdefault(_plain(key), value)
    return given


def _plain(key: str) -> str:
    return re.sub(r"[^a-z]", "", re.sub(r"[(\[].*", "", key.lower()))


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
