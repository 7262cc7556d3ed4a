"""Read a table with columns such as ``LFHD_X, LFHD_Y, LFHD_Z``, in any order.

D-Flow, which records what Cortex streams, writes ``LASI.PosX`` and a column TimeStamp.
"""

import re

import numpy as np

from study.mocap.io.assembly import FileContents
from study.mocap.io.formats.rows import Rows, as_points, find_delimiter, with_all_frames
from study.mocap.io.recording import RecordingError
from study.sphere.types import Floats

_COORDINATE = re.compile(r"(?P<marker>.*\S)[\s_.:\-|]+(Pos)?(?P<axis>[xyzXYZ])(\s*[\[(]\s*(?P<unit>\w+)\s*[\])])?$")
_COUNTERS = {"frame", "frame#", "frames", "sub frame", "index", "field"}


def read_table(lines: list[str]) -> FileContents:
    """Read a table whose header gives the marker and axis of each column, in any order."""
    given: dict[str, str] = {}
    start = 0
    while start < len(lines) and (lines[start].startswith("#") or not lines[start].strip()):
        key, colon, value = lines[start].lstrip("# ").partition(":")
        if colon:
            given[key.strip().lower()] = value.strip()
        start += 1
    if start == len(lines):
        raise RecordingError("it holds only comments")
    delimiter = find_delimiter(lines[start])
    names = [name.strip().strip("\"'").strip() for name in lines[start].split(delimiter)]
    places: dict[str, dict[str, int]] = {}
    units, doubles = set(), []
    for place, name in enumerate(names):
        if found := _COORDINATE.match(name):
            axes = places.setdefault(found["marker"].strip(), {})
            doubles += [name] * (found["axis"].lower() in axes)
            axes[found["axis"].lower()] = place
            units.add(found["unit"] or "")
    if not places:
        found_names = ", ".join(names[:4])[:80]
        raise RecordingError(f"line {start + 1}: no columns such as LFHD_X, LFHD_Y, LFHD_Z; found {found_names}")
    if doubles:
        raise RecordingError(f"line {start + 1}: two columns have the name {doubles[0]!r}")
    for marker, axes in places.items():
        if len(axes) < 3:
            lacking = ", ".join(sorted({"x", "y", "z"} - set(axes)))
            raise RecordingError(f"line {start + 1}: marker {marker} has no column for {lacking}")
    end = max(i for i, line in enumerate(lines, start=1) if line.strip())
    numbers = Rows(lines[start + 1 : end], start + 2, delimiter).numbers(len(names))
    columns = [axes[axis] for axes in places.values() for axis in "xyz"]
    low = [name.lower() for name in names]
    notes: tuple[str, ...] = ()
    if low[0] in _COUNTERS:
        numbers, notes = with_all_frames(numbers[:, 0], numbers, start + 2)
    rate = _number(given["rate"], "rate") if "rate" in given else rate_of_times(low, numbers, start + 2)
    unit = given.get("unit") or (units.pop() if len(units) == 1 else "") or None
    return FileContents(list(places), as_points(numbers[:, columns]), rate, unit, notes=notes)


def rate_of_times(names: list[str], numbers: Floats, first: int) -> float | None:
    """Frames per second from a column of seconds; None if there is none."""
    place = next(
        (i for i, name in enumerate(names) if re.fullmatch(r"time(stamp)?(\s*[\[(]\s*s\w*\s*[\])])?|t|time_s", name)),
        None,
    )
    if place is None or len(numbers) < 2:
        return None
    steps = np.diff(numbers[:, place])
    step = float(np.nanmedian(steps)) if not np.isnan(steps).all() else np.nan
    present = np.asarray(~np.isnan(numbers).all(axis=1))  # a frame that the file leaves out has no time
    uneven = ~(np.abs(steps - step) < 0.5 * step) & present[1:] & present[:-1]
    if uneven.any():
        row = int(uneven.argmax())
        raise RecordingError(f"line {first + row + 1}: the step in time is {steps[row]:g} s, elsewhere {step:g} s")
    return float((len(numbers) - 1) / (numbers[-1, place] - numbers[0, place]))


def _number(text: str, what: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise RecordingError(f"its {what} {text!r} is not a number") from None
