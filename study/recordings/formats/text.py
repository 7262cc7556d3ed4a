"""Text files of markers: tables of two kinds, TRC, and the rows of numbers that all of them hold.

- A table with columns such as ``LFHD_X, LFHD_Y, LFHD_Z``, in any order. D-Flow, which records what Cortex streams,
  writes ``LASI.PosX`` and a column TimeStamp.
- A table with a line of axes: a marker's label above the first of its columns, ``X1, Y1, Z1, X2, …`` or ``X, Y, Z, X,
  …`` in the next line; lines with a key and a value, such as a rate, may stand above. Cortex exports trajectories in
  this form, and spreadsheets save it. Vicon Nexus has units in a line below the axes, under a line Trajectories and
  one with the rate; BTK and Mokka have them between labels and axes, with angles and forces beside the markers, and
  the rate as Point frequency. Source for the latter: BTK, ``btkASCIIFileWriter``.
- TRC: three lines about the file, one with labels, one with axes, then frame, time and coordinates. Motion Analysis
  (EVaRT, Cortex) defined the format and OpenSim uses it. The same with commas, as a spreadsheet saves it, is read, too.
  Source: OpenSim documentation, "Marker (.trc) Files".
"""

import io
import math
import re

import numpy as np
import pandas as pd

from study.arrays import Floats
from study.recordings.recording import FileContents, RecordingError, known_unit

_MISSING = [spelt for word in ("nan", "na", "n/a", "null", "none") for spelt in (word, word.upper(), word.title())]
_MISSING += ["NaN", "-"]
MOST_MISSING = 0.1
"""Share of a file's frames that may be missing; with more the file is a part of another one."""


def read_rows(
    lines: list[str], first: int, delimiter: str, columns: int, counted: bool, further: bool = False
) -> tuple[Floats, tuple[str, ...]]:
    """Read rows of numbers.

    Args:
        lines: the rows; empty ones at the end do not count.
        first: number of the first one in the file, from 1.
        delimiter: between cells.
        columns: number of cells that a row must have.
        counted: true if the first column counts the frames, of which some may be left out.
        further: true if rows may have further cells, which are left out; else these must be empty.

    Returns:
        The numbers (rows, columns), NaN for an empty cell, with a row for every frame; and a note if any was put in.

    Raises:
        RecordingError: with the line, if a row is cut short, a cell is no number, or too many frames are left out.
    """
    lines = lines[: max((i for i, line in enumerate(lines, start=1) if line.strip()), default=0)]
    if not lines:
        return np.empty((0, columns)), ()
    cells = np.array([line.count(delimiter) + 1 for line in lines], dtype=int)
    if (cells < columns).any():
        row = int((cells < columns).argmax())
        place = f"line {first + row} has {cells[row]} cells"
        raise RecordingError(f"{place}; {columns} are needed; the line may be cut short")
    for row in np.flatnonzero(cells > columns).tolist():  # a line may end in delimiters, in thousands of them, too
        *kept, rest = lines[row].replace('"', "").split(delimiter, columns)
        if not further and (more := [cell for cell in rest.split(delimiter) if cell.strip() not in ("", *_MISSING)]):
            column = columns + 1 + rest.split(delimiter).index(more[0])
            raise RecordingError(f"line {first + row}, column {column}: {more[0].strip()[:40]!r} has no header")
        lines[row] = delimiter.join(kept)
    text = "\n".join(lines).replace('"', "")
    table = pd.read_csv(
        io.StringIO(text),
        sep=delimiter,
        names=range(columns),
        decimal="," if delimiter != "," and "," in text and "." not in text else ".",
        na_values=_MISSING,
        skipinitialspace=True,
        skip_blank_lines=False,
        low_memory=False,
    )
    numbers, present = table.apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64), table.notna().to_numpy()
    wrong = present & np.isnan(numbers)
    if wrong.any():
        column = int(wrong.any(axis=0).argmax())
        row = int(wrong[:, column].argmax())
        cell = str(table.iloc[row, column])[:40]
        raise RecordingError(f"line {first + row}, column {column + 1}: {cell!r} is not a number")
    return _with_all_frames(numbers, first) if counted else (numbers, ())


def _with_all_frames(numbers: Floats, first: int) -> tuple[Floats, tuple[str, ...]]:
    """Put in rows without samples for the frames that a table leaves out, so that the times of all others are right.

    Args:
        numbers: the table (rows, columns), with the number of the frame in the first one.
        first: number of the first row's line in the file, from 1.

    Returns:
        The table with a row for every frame, and a note if any was put in.

    Raises:
        RecordingError: if the frames do not follow each other, or more than `MOST_MISSING` of them are left out.
    """
    counter = numbers[:, 0]
    steps = np.diff(counter)
    if (steps == 1).all():
        return numbers, ()
    whole = int(counter[-1] - counter[0]) + 1 if np.isfinite(counter).all() else 0
    lacking = whole - len(counter)
    if (steps < 1).any() or (steps % 1 != 0).any() or lacking > MOST_MISSING * whole:
        row = int((steps != 1).argmax())
        raise RecordingError(f"line {first + row + 1}: frame {counter[row + 1]:g} follows frame {counter[row]:g}")
    complete = np.full((whole, numbers.shape[1]), np.nan)
    complete[(counter - counter[0]).astype(int)] = numbers
    place = int((steps > 1).argmax())
    words = f"{lacking} of {whole} frames are not in it, the first after frame {counter[place]:g}"
    return complete, (f"{words}: they count as missing",)


def missing_frames_note(held: int, promised: int) -> tuple[str, ...]:
    """The note on a file that holds fewer frames than its header promises; none if it holds as many, or more.

    Raises:
        RecordingError: if more than `MOST_MISSING` of the frames are missing.
    """
    if held >= promised:
        return ()
    if held < (1 - MOST_MISSING) * promised:
        raise RecordingError(f"the file is cut short: {held} of {promised} frames are there; get a whole copy of it")
    return (f"its header promises {promised} frames, but {held} are there: the end may be cut off",)


def as_points(numbers: Floats) -> Floats:
    """Rows of coordinates (frames, 3 markers) as (markers, 3, frames)."""
    return numbers.T.reshape(numbers.shape[1] // 3, 3, len(numbers))


def until_blank(lines: list[str], start: int) -> list[str]:
    """Lines from a place up to the first empty one."""
    end = next((i for i in range(start, len(lines)) if not lines[i].strip(" ,;\t")), len(lines))
    return lines[start:end]


def find_delimiter(line: str) -> str:
    """The comma, semicolon or tab, whichever is most frequent in a line."""
    return max(",;\t", key=line.count)


def cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of a line of a header, without spaces and quotes around them."""
    return [cell.strip().strip("\"'").strip() for cell in line.split(delimiter)]


_COORDINATE = re.compile(r"(?P<marker>.*\S)[\s_.:\-|]+(Pos)?(?P<axis>[xyzXYZ])(\s*[\[(]\s*(?P<unit>\w+)\s*[\])])?$")
_SECONDS = re.compile(r"time(stamp)?(\s*[\[(]\s*s\w*\s*[\])])?|t|time_s")
_COUNTERS = {"frame", "frame#", "frames", "sub frame", "index", "field"}


def read_table(lines: list[str]) -> FileContents:
    """Read a table whose header gives the marker and axis of each column, in any order."""
    start = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), len(lines))
    if start == len(lines):
        raise RecordingError("it holds only comments")
    entries = (line.lstrip("# ").partition(":") for line in lines[:start])
    given = {key.strip().lower(): value.strip() for key, colon, value in entries if colon}
    delimiter = find_delimiter(lines[start])
    names = cells_of(lines[start], delimiter)
    places: dict[str, dict[str, int]] = {}
    units, doubles = set(), []
    for place, name in enumerate(names):
        if parts := _COORDINATE.match(name):
            axes = places.setdefault(parts["marker"].strip(), {})
            doubles += [name] * (parts["axis"].lower() in axes)
            axes[parts["axis"].lower()] = place
            units.add(parts["unit"] or "")
    if not places:
        first = ", ".join(names[:4])[:80]
        raise RecordingError(f"line {start + 1}: no columns such as LFHD_X, LFHD_Y, LFHD_Z; found {first}")
    if doubles:
        raise RecordingError(f"line {start + 1}: two columns have the name {doubles[0]!r}")
    for marker, axes in places.items():
        if len(axes) < 3:
            lacking = ", ".join(sorted({"x", "y", "z"} - set(axes)))
            raise RecordingError(f"line {start + 1}: marker {marker} has no column for {lacking}")
    low = [name.lower() for name in names]
    numbers, notes = read_rows(lines[start + 1 :], start + 2, delimiter, len(names), low[0] in _COUNTERS)
    columns = [axes[axis] for axes in places.values() for axis in "xyz"]
    rate = number_or_none(given["rate"]) if "rate" in given else rate_of_times(low, numbers, start + 2)
    if rate is None and "rate" in given:
        raise RecordingError(f"its rate {given['rate']!r} is not a number")
    unit = given.get("unit") or (units.pop() if len(units) == 1 else "") or None
    return FileContents(list(places), as_points(numbers[:, columns]), rate, unit, notes=notes)


def rate_of_times(names: list[str], numbers: Floats, first: int) -> float | None:
    """Frames per second from a column of seconds; None if there is none."""
    place = next((i for i, name in enumerate(names) if _SECONDS.fullmatch(name)), None)
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


_SAME = 0.01
"""Relative difference of two rates that is rounding."""
_UNEVEN = 0.5
"""Steps of time by which a step may differ from the median one."""


def read_trc(lines: list[str]) -> FileContents:
    """Read a TRC file.

    Where the rate of the header contradicts the column Time, the column is believed, with a note: programs that
    resample a recording often leave the header as it was.

    Raises:
        RecordingError: one line, without the file's name.
    """
    if len(lines) < 6 or not lines[0].lstrip('"').startswith("PathFileType"):
        wanted = "it must begin with PathFileType and have five lines of header before the rows"
        raise RecordingError(f"not a TRC file: {wanted}")
    if "\t" not in lines[3] and "," in lines[3]:
        lines = [line.replace(",", "\t").replace('"', "") for line in lines]
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    if "\t" not in lines[3]:  # some programs write spaces
        lines = [*lines[:3], *("\t".join(line.split()) for line in lines[3:])]
    start = next((i for i in range(4, len(lines)) if re.match(r"\s*-?\d+(\.0*)?[\s]", lines[i])), len(lines))
    rows = until_blank(lines, start)
    try:
        frames, markers, rate = int(header["NumFrames"]), int(header["NumMarkers"]), float(header["DataRate"])
    except (KeyError, ValueError):
        raise RecordingError("line 2 and 3 must give DataRate, NumFrames and NumMarkers") from None
    places = _trc_labels(lines[3].split("\t"), markers)
    numbers, notes = read_rows(rows, start + 1, "\t", 3 + max(places), counted=True, further=True)
    steps = np.diff(numbers[:, 1])
    even = len(steps) > 1 and bool((np.abs(steps - np.median(steps)) <= _UNEVEN * np.median(steps)).all())
    if len(numbers) < (1 - MOST_MISSING) * frames and even:
        # programs that cut a piece out of a recording often leave the header as it was
        run_on = f"{len(numbers)} are there, and their numbers and times run on"
        notes += (f"its header promises {frames} frames, but {run_on}: the header is wrong, or the end is cut off",)
    else:
        notes += missing_frames_note(len(numbers), frames)
    held = max((row.rstrip().count("\t") + 1 for row in rows), default=0)
    if (unnamed := math.ceil((held - 2) / 3) - len(places)) > 0 or markers != len(places):
        count = f"its header gives {markers} markers, and {len(places)} have a label"
        notes += (count + f": {unnamed} groups of columns without a label are left out" * (unnamed > 0),)
    columns = [column for place in places for column in (place, place + 1, place + 2)]
    points = as_points(numbers[:, columns])
    used, words = _rate(rate, numbers[:, 1])
    return FileContents(list(places.values()), points, used, header.get("Units"), notes=notes + words)


def _trc_labels(cells: list[str], markers: int) -> dict[int, str]:
    """The labels of a TRC file by the numbers of their first columns.

    Labels stand above the first of three columns. Some programs write them one after another; then there must be as
    many as the header gives, since nothing else tells which columns have none.
    """
    labels = {place: cell.strip() for place, cell in enumerate(cells) if place > 1 and cell.strip()}
    if not labels:
        raise RecordingError("line 4 has no labels")
    if all(place % 3 == 2 for place in labels):
        return labels
    if len(labels) != markers:
        raise RecordingError(f"line 4 has {len(labels)} labels, but line 3 gives {markers} markers")
    return {2 + 3 * number: label for number, label in enumerate(labels.values())}


def _rate(header: float, times: Floats) -> tuple[float, tuple[str, ...]]:
    """The rate by the header or by the column Time (frames,), and a note if they contradict each other."""
    frames = np.flatnonzero(np.isfinite(times))
    if len(frames) < 2:
        return header, ()
    steps = np.diff(times[frames]) / np.diff(frames)
    step = float(np.median(steps))
    if not step > 0.0:  # some programs leave the column at zero
        return header, ()
    rounding = _resolution(times[frames])
    if (np.abs(steps - step) > max(_UNEVEN * step, 1.5 * rounding)).any():
        return header, (f"its column Time has uneven steps: the header's rate of {header:g} Hz is used",)
    duration = float(times[frames[-1]] - times[frames[0]])
    rate = float(frames[-1] - frames[0]) / duration
    if header > 0.0 and abs(header / rate - 1.0) < _SAME + rounding / duration:
        return header, ()
    if header > 0.0 and abs(header / rate / 1000.0 - 1.0) < _SAME:
        return header, (f"its column Time is in milliseconds: the header's rate of {header:g} Hz is used",)
    rounded = round(rate, 3)
    words = f"its header gives {header:g} Hz, but its column Time {rounded:g} Hz: the column is believed"
    return rounded, (f"{words}; give another rate with --rate",)


def _resolution(times: Floats) -> float:
    """The power of ten to which times are rounded, seconds."""
    steps = (10.0**-digits for digits in range(7) if (np.abs(times - np.round(times, digits)) < 1e-9).all())
    return next(steps, 0.0)


_AXIS = re.compile(r"([XYZ])\s*\d*$", re.I)
_FIRST = 60
"""Lines in which the headers must be."""
_RATES = ("rate", "datarate", "frequency", "framerate", "camerarate", "samplerate", "pointfrequency")
_NO_LENGTHS = ("", "deg", "rad", "°", "n", "nm", "nmm", "n.m", "n.mm", "w", "n/kg", "nm/kg", "nmm/kg", "w/kg")
"""Units of points that are no markers."""
_COUNTED = ("frame", "frames", "item", "sample", "field")


def find_axes(lines: list[str]) -> int | None:
    """The number, from 0, of the line of axes below a line of labels; None if there is none."""
    for number, line in enumerate(lines[1:_FIRST], start=1):
        cells = cells_of(line, find_delimiter(line))
        axes = [axis for cell in cells if (axis := _axis(cell))]
        whole = len(axes) >= 3 and len(axes) % 3 == 0 and axes == list("XYZ") * (len(axes) // 3)
        others = [cell for cell in cells if cell and not _axis(cell) and not cell.endswith("'")]
        above = lines[number - 1]
        if whole and len(others) <= 2 and not above.startswith("#") and any(cells_of(above, find_delimiter(line))):
            return number
    return None


def read_columns(lines: list[str], axes: int, rate: float | None = None) -> FileContents:
    """Read a table whose line of axes is known (see `find_axes`).

    Args:
        lines: of the file.
        axes: number of the line of axes, from 0.
        rate: frames per second; if None, that of a key above, or of a column of times.

    Raises:
        RecordingError: one line, without the file's name: a marker without a label, rows that do not fit.
    """
    delimiter = find_delimiter(lines[axes])
    low, heads = cells_of(lines[axes], delimiter), cells_of(lines[axes - 1], delimiter)
    below = cells_of(lines[axes + 1], delimiter) if axes + 1 < len(lines) else []
    places = [i for i in range(len(low) - 2) if [_axis(cell) for cell in low[i : i + 3]] == ["X", "Y", "Z"]]
    top, start = axes - 1, axes + 1
    higher = cells_of(lines[axes - 2], delimiter) if axes > 1 else []
    if units := _units(heads, places, labelled=all(any(higher[i : i + 1]) for i in places)):
        top, heads = axes - 2, higher
    elif units := _units(below, places, labelled=True):
        start += 1
    heads += [""] * (len(low) - len(heads))
    if nameless := [i for i in places if not heads[i]]:
        raise RecordingError(f"line {top + 1}, column {nameless[0] + 1}: no label above the axes {low[nameless[0]]}")
    lengths = {i: known_unit(units[i]) if units.get(i) else "" for i in places}
    markers = [i for i in places if lengths[i] is not None]
    if len(words := sorted({str(lengths[i]) for i in markers})) > 1:
        raise RecordingError(f"its markers are in several units, {' and '.join(words)}; export them in one")
    rows, start = _rows(lines, start, delimiter, len(low) if places[0] else 0)
    first = [(low[i] or heads[i]).lower().rstrip("#") for i in range(places[0])]
    numbers, notes = read_rows(rows, start + 1, delimiter, len(low), bool(first) and first[0] in _COUNTED)
    given = _keys(lines[:top], delimiter)
    if (promised := given.get("framenumber", "")).isdigit():
        notes += missing_frames_note(len(numbers), int(promised))
    if others := len(places) - len(markers):
        notes += (f"{others} points hold angles, forces and the like, not markers: left out",)
    if rate is None:
        rates = (number_or_none(given.get(key, "")) for key in _RATES)
        rate = next((rate for rate in rates if rate and rate > 0.0), None) or rate_of_times(first, numbers, start + 1)
    unit = (words[0] if words else None) or given.get("unit") or given.get("units") or None
    columns = [column for i in markers for column in (i, i + 1, i + 2)]
    return FileContents([heads[i] for i in markers], as_points(numbers[:, columns]), rate, unit, notes=notes)


def _axis(cell: str) -> str:
    """X, Y or Z of a cell such as ``x`` or ``X12``; empty for another cell, such as that of a velocity, ``X'``."""
    axis = _AXIS.match(cell)
    return axis[1].upper() if axis else ""


def _units(cells: list[str], places: list[int], labelled: bool) -> dict[int, str]:
    """The unit of each point, if a line is one of units: one word in the columns of every point, in several of them.

    Args:
        cells: of the line.
        places: the first column of each point.
        labelled: true if the labels stand in another line; else the words must be known, for spreadsheets repeat a
            label in all three columns.
    """
    groups = {i: [cell for cell in cells[i : i + 3] if cell] for i in places}
    words = {i: (group or [""])[0] for i, group in groups.items()}
    several = any(len(group) > 1 for group in groups.values()) and all(len(set(group)) < 2 for group in groups.values())
    named = labelled or all(known_unit(word) or word.lower() in _NO_LENGTHS for word in words.values())
    return words if several and named and all(number_or_none(word) is None for word in words.values()) else {}


def _rows(lines: list[str], start: int, delimiter: str, cells: int) -> tuple[list[str], int]:
    """The rows from the first one that is not empty up to an empty one, and the number of their first line, from 0.

    Args:
        lines: of the file.
        start: where they begin at the earliest.
        delimiter: between cells.
        cells: of a row, whose first one, a time or a frame, is never empty; 0 if all of them may be.

    Raises:
        RecordingError: if rows follow below the empty line: frames would be lost.
    """
    start = next((i for i in range(start, len(lines)) if lines[i].strip(" ,;\t")), len(lines))
    if not cells:
        return lines[start:], start
    rows = until_blank(lines, start)
    end = start + len(rows)
    after = next((cells_of(line, delimiter) for line in lines[end:] if line.strip(" ,;\t")), [])
    if len(after) == cells and number_or_none(after[0]) is not None:
        raise RecordingError(f"line {end + 1} is empty, and further rows follow; remove the line")
    return rows, start


def read_vicon(lines: list[str], start: int) -> FileContents:
    """Read an export of Vicon Nexus: Trajectories, rate, labels, axes, units, then rows up to an empty line."""
    if len(lines) < start + 6:
        raise RecordingError(f"the file is cut short: no rows after the line Trajectories (line {start + 1})")
    rate = number_or_none(lines[start + 1].strip(" ,;\t"))
    if rate is None:
        raise RecordingError(f"line {start + 2}: {lines[start + 1][:40]!r} should be the rate")
    if find_axes(lines[start : start + 4]) != 3:
        raise RecordingError(f"line {start + 4} should give the axes of each label: Frame, Sub Frame, X, Y, Z, X, ...")
    return read_columns(lines, start + 3, rate)


def _keys(lines: list[str], delimiter: str) -> dict[str, str]:
    """Values of keys above the headers: a key and its value in one line, or keys in one line and values below."""
    given: dict[str, str] = {}
    table = [cells_of(line.lstrip("# "), delimiter) for line in lines]
    for cells, below in zip(table, [*table[1:], *[[]] * bool(table)], strict=True):
        pairs = list(zip(cells, below, strict=False))
        if len(cells) > 1 and number_or_none(cells[0]) is None and (len(cells) == 2 or not any(cells[2:])):
            pairs = [(cells[0], cells[1])]
        elif len(cells) == 1 and ":" in cells[0]:
            pairs = [(cells[0].partition(":")[0], cells[0].partition(":")[2].strip())]
        for key, value in pairs:
            given.setdefault(re.sub(r"[^a-z]", "", re.sub(r"[(\[].*", "", key.lower())), value)
    return given


def number_or_none(text: str) -> float | None:
    """The number that a cell holds, if it holds one."""
    try:
        return float(text)
    except ValueError:
        return None
