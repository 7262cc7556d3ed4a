"""Read TRC files: three lines about the file, one with labels, one with axes, then frame, time and coordinates.

Motion Analysis (EVaRT, Cortex) defined the format and OpenSim uses it. The same with commas, as a spreadsheet saves it,
is read, too. Source: OpenSim documentation, "Marker (.trc) Files".
"""

import re

import numpy as np

from study.mocap.io.assembly import FileContents
from study.mocap.io.formats.rows import Rows, as_points, missing_frames_note, until_blank, with_all_frames
from study.mocap.io.recording import RecordingError
from study.sphere.types import Floats

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
        raise RecordingError(
            "not a TRC file: it must begin with PathFileType and have five lines of header before the rows"
        )
    if "\t" not in lines[3] and "," in lines[3]:
        lines = [line.replace(",", "\t").replace('"', "") for line in lines]
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    if "\t" not in lines[3]:  # some programs write spaces
        lines = [*lines[:3], *("\t".join(line.split()) for line in lines[3:])]
    cells = [cell.strip() for cell in lines[3].strip().split("\t")]
    labels = [cell for cell in cells[2:] if cell]
    start = next((i for i in range(4, len(lines)) if re.match(r"\s*-?\d+(\.0*)?[\s]", lines[i])), len(lines))
    rows = until_blank(lines, start)
    try:
        frames, markers, rate = int(header["NumFrames"]), int(header["NumMarkers"]), float(header["DataRate"])
    except (KeyError, ValueError):
        raise RecordingError("line 2 and 3 must give DataRate, NumFrames and NumMarkers") from None
    if len(labels) != markers:
        raise RecordingError(f"line 4 has {len(labels)} labels, but line 3 gives {markers} markers")
    numbers = Rows(rows, start + 1, "\t").numbers(2 + 3 * markers)
    numbers, notes = with_all_frames(numbers[:, 0], numbers, start + 1)
    notes += missing_frames_note(len(numbers), frames)
    used, words = _rate(rate, numbers[:, 1])
    return FileContents(labels, as_points(numbers[:, 2:]), used, header.get("Units"), notes=notes + words)


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
    return rounded, (
        f"its header gives {header:g} Hz, but its column Time {rounded:g} Hz: the column is believed; "
        "give another rate with --rate",
    )


def _resolution(times: Floats) -> float:
    """The power of ten to which times are rounded, seconds."""
    for digits in range(7):
        if (np.abs(times - np.round(times, digits)) < 1e-9).all():
            return float(10.0**-digits)
    return 0.0
