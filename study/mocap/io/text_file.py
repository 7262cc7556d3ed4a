"""Read markers from text: TRC files, tables with columns ``LFHD_X, LFHD_Y, LFHD_Z``, and Vicon's CSV export."""

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from study.mocap.io.assembly import FileContents
from study.mocap.io.recording import RecordingError
from study.sphere.types import Floats

_COORDINATE = re.compile(r"(?P<marker>.*\S)[\s_.:\-|]+(?P<axis>[xyzXYZ])(\s*[\[(]\s*(?P<unit>\w+)\s*[\])])?$")
_COUNTERS = {"frame", "frame#", "frames", "sub frame", "index", "field", ""}
_MISSING = ["nan", "NaN", "NAN", "na", "NA", "N/A", "null", "none", "None", "-"]


def read_text(path: Path) -> FileContents:
    """Read markers from a text file.

    Rate and unit come from the header of a TRC or Vicon file; in other tables from lines ``# rate: 120`` and ``# unit:
    mm``, or from a column ``time`` in seconds. Empty cells are missing samples.

    Raises:
        RecordingError: one line, without the file's name.
        OSError: if the file cannot be read.
    """
    data = path.read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    lines = text.splitlines()
    if not any(line.strip() for line in lines):
        raise RecordingError("the file is empty")
    if "\0" in text:
        raise RecordingError("not a text file")
    if lines[0].startswith("PathFileType") or path.suffix.lower() == ".trc":
        return _trc(lines)
    for number, line in enumerate(lines[:50]):
        if line.strip().strip(",;\t\"'").lower() == "trajectories":
            return _vicon(lines, number)
    return _table(lines)


@dataclass(frozen=True)
class _Rows:
    """The rows of numbers in a file."""

    lines: list[str]
    first: int
    """Number of its first line in the file, from 1."""
    delimiter: str

    def numbers(self, columns: int) -> Floats:
        """The cells of the rows (rows, columns); empty ones are NaN."""
        if not self.lines:
            return np.empty((0, columns))
        text = "\n".join(self.lines).replace('"', "")
        cells = np.array([line.count(self.delimiter) + 1 for line in self.lines], dtype=int)
        if (cells < columns).any():
            row = int((cells < columns).argmax())
            raise RecordingError(
                f"line {self.first + row} has {cells[row]} cells; {columns} are needed; the line may be cut short"
            )
        decimal = "," if self.delimiter != "," and "," in text and "." not in text else "."
        table = pd.read_csv(
            io.StringIO(text),
            sep=self.delimiter,
            header=None,
            names=range(int(cells.max())),
            index_col=False,
            decimal=decimal,
            na_values=_MISSING,
            skipinitialspace=True,
            skip_blank_lines=False,
            quoting=csv.QUOTE_NONE,
            low_memory=False,
        )
        numbers = np.empty(table.shape)
        for column in range(table.shape[1]):
            values = table[column]
            numbers[:, column] = parsed = pd.to_numeric(values, errors="coerce").to_numpy(dtype=np.float64)
            wrong = np.isnan(parsed) & values.notna().to_numpy()
            if column >= columns:  # a line may end in delimiters, but not in further numbers
                wrong = values.notna().to_numpy()
            if wrong.any():
                row = int(wrong.argmax())
                words = "is not a number" if column < columns else "has no header"
                place = f"line {self.first + row}, column {column + 1}"
                raise RecordingError(f"{place}: {str(values.iloc[row])[:40]!r} {words}")
        return numbers[:, :columns]


def _trc(lines: list[str]) -> FileContents:
    """Read a TRC file: three lines about the file, one with labels, one with axes, then frame, time and coordinates."""
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise RecordingError(
            "not a TRC file: it must begin with PathFileType and have five lines of header before the rows"
        )
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    if "\t" not in lines[3]:  # some programs write spaces
        lines = [*lines[:3], *("\t".join(line.split()) for line in lines[3:])]
    cells = [cell.strip() for cell in lines[3].strip().split("\t")]
    labels = [cell for cell in cells[2:] if cell]
    start = next((i for i in range(4, len(lines)) if re.match(r"\s*-?\d+(\.0*)?[\s]", lines[i])), len(lines))
    rows = _until_blank(lines, start)
    try:
        frames, markers, rate = int(header["NumFrames"]), int(header["NumMarkers"]), float(header["DataRate"])
    except (KeyError, ValueError):
        raise RecordingError("line 2 and 3 must give DataRate, NumFrames and NumMarkers") from None
    if len(labels) != markers:
        raise RecordingError(f"line 4 has {len(labels)} labels, but line 3 gives {markers} markers")
    if len(rows) < frames:
        raise RecordingError(f"the file is cut short: {len(rows)} of {frames} frames are there; get a whole copy of it")
    numbers = _Rows(rows, start + 1, "\t").numbers(2 + 3 * markers)
    _consecutive(numbers[:, 0], start + 1)
    return FileContents(labels, _points(numbers[:, 2:]), rate, header.get("Units"))


def _vicon(lines: list[str], start: int) -> FileContents:
    """Read an export of Vicon Nexus: Trajectories, rate, labels, axes, units, then rows up to an empty line."""
    if len(lines) < start + 6:
        raise RecordingError(f"the file is cut short: no rows after the line Trajectories (line {start + 1})")
    delimiter = _delimiter(lines[start + 3])
    try:
        rate = float(lines[start + 1].strip().strip(delimiter))
    except ValueError:
        raise RecordingError(f"line {start + 2}: {lines[start + 1][:40]!r} should be the rate") from None
    axes = [cell.strip().lower() for cell in lines[start + 3].split(delimiter)]
    heads = [cell.strip().strip('"') for cell in lines[start + 2].split(delimiter)]
    heads += [""] * (len(axes) - len(heads))
    # velocities and accelerations (X', X'') may follow the coordinates
    places = [i for i in range(len(axes) - 2) if axes[i : i + 3] == ["x", "y", "z"]]
    units = [cell.strip() for cell in lines[start + 4].split(delimiter)]
    rows = _until_blank(lines, start + 5)
    numbers = _Rows(rows, start + 6, delimiter).numbers(len(axes))
    _consecutive(numbers[:, 0], start + 6)
    unit = next((units[i] for i in places if i < len(units) and units[i]), None)
    columns = [column for i in places for column in (i, i + 1, i + 2)]
    return FileContents([heads[i] for i in places], _points(numbers[:, columns]), rate, unit)


def _table(lines: list[str]) -> FileContents:
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
    delimiter = _delimiter(lines[start])
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
    numbers = _Rows(lines[start + 1 : end], start + 2, delimiter).numbers(len(names))
    columns = [axes[axis] for axes in places.values() for axis in "xyz"]
    low = [name.lower() for name in names]
    if low[0] in _COUNTERS - {""}:
        _consecutive(numbers[:, 0], start + 2)
    rate = _number(given["rate"], "rate") if "rate" in given else _rate(low, numbers, start + 2)
    unit = given.get("unit") or (units.pop() if len(units) == 1 else "") or None
    return FileContents(list(places), _points(numbers[:, columns]), rate, unit)


def _rate(names: list[str], numbers: Floats, first: int) -> float | None:
    """Frames per second from a column of seconds; None if there is none."""
    place = next(
        (i for i, name in enumerate(names) if re.fullmatch(r"time(\s*[\[(]\s*s\w*\s*[\])])?|t|time_s", name)), None
    )
    if place is None or len(numbers) < 2:
        return None
    steps = np.diff(numbers[:, place])
    step = float(np.median(steps))
    uneven = ~(np.abs(steps - step) < 0.5 * step)
    if uneven.any():
        row = int(uneven.argmax())
        raise RecordingError(f"line {first + row + 1}: the step in time is {steps[row]:g} s, elsewhere {step:g} s")
    return float((len(numbers) - 1) / (numbers[-1, place] - numbers[0, place]))


def _consecutive(counter: Floats, first: int) -> None:
    """Refuse a table that leaves out frames: the times of all later ones would be wrong."""
    wrong = np.diff(counter) != 1
    if wrong.any():
        row = int(wrong.argmax())
        raise RecordingError(f"line {first + row + 1}: frame {counter[row + 1]:g} follows frame {counter[row]:g}")


def _points(numbers: Floats) -> Floats:
    """Rows of coordinates (frames, 3 markers) as (markers, 3, frames)."""
    points: Floats = numbers.T.reshape(numbers.shape[1] // 3, 3, len(numbers))
    return points


def _until_blank(lines: list[str], start: int) -> list[str]:
    """Lines from a place up to the first empty one."""
    end = next((i for i in range(start, len(lines)) if not lines[i].strip(" ,;\t")), len(lines))
    return lines[start:end]


def _delimiter(line: str) -> str:
    return max(",;\t", key=line.count)


def _number(text: str, what: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise RecordingError(f"its {what} {text!r} is not a number") from None
