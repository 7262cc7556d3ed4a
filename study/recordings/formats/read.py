"""Read a recording from a file of any known format, which its contents tell, not its name alone.

Exports of camera systems stand here. Motive (CSV): a line of keys and values, lines of headers, then rows. Above each
column stand its type (Marker, Rigid Body, Rigid Body Marker, Bone, Bone Marker), its name, its ID, in newer versions
its parent, then what it holds (Rotation, Position, Mean Marker Error, Marker Quality), then the axis. Source: OptiTrack
documentation, "Data Export: CSV", format versions 1.2 to 1.25.

Qualisys Track Manager (TSV): lines with a key and its values, then rows of coordinates. Source: Qualisys Track Manager
User Manual, "TSV file formats": keys NO_OF_FRAMES, NO_OF_MARKERS, FREQUENCY, DATA_INCLUDED, MARKER_NAMES and others;
optionally TRAJECTORY_TYPES, a line of column headers, and the columns Frame and Time; millimetres; a missing sample is
empty, NULL, or 0 in all three.
"""

import contextlib
import csv
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from study.files import named_path, regular
from study.recordings.formats import text as tables
from study.recordings.recording import (
    FileContents,
    Recording,
    RecordingError,
    assemble,
    frames_between,
    printable,
    subjects,
)

_MOTIVE = "Format Version"
_FIRST = 20
"""Lines in which the headers must be."""
_FEWEST = 4
"""Fewest lines above that of the axes: keys, types, names, contents."""
_MEASURED = ("marker",)
_SOLVED = ("rigid body marker", "bone marker", "marker constraint")
_UNLABELED = re.compile(r"unlabell?ed\b", re.I)
_NUMBERED = re.compile(r"(.*\S)\s*:\s*(marker\s*\d+)$", re.I)


def read_motive(lines: list[str]) -> FileContents:
    """Read the markers of an export of Motive.

    Measured markers are taken; where there are none, those of the solved rigid bodies and skeletons, with a note, for
    they keep their distances whatever the skin does. Markers without a label are left out. A marker that has no name
    of its own, as in ``Thigh:Marker 001``, keeps that of its asset: ``Thigh Marker 001``. Rigid bodies are segments of
    one subject: the name of one is dropped where the marker's own is unique, and belongs to it where it is not.

    Raises:
        RecordingError: one line, without the file's name: no markers, no line of axes.
    """
    table = list(csv.reader(lines[:_FIRST]))
    axes = next((i for i, row in enumerate(table) if row and row[0].strip().lower() == "frame"), 0)
    columns = _columns(table, axes)
    chosen = [column for column in columns if column[1] in _MEASURED and not _UNLABELED.match(column[2])]
    unlabelled = sum(kind in _MEASURED for _, kind, _ in columns) - len(chosen)
    notes = [f"{unlabelled} markers without a label are left out"] * (unlabelled > 0)
    if not chosen and (chosen := [column for column in columns if column[1] in _SOLVED]):
        notes.append("its markers are those of solved rigid bodies, not the measured ones: export Markers, too")
    if not chosen:
        kinds = ", ".join(sorted({kind for _, kind, _ in columns})) or "no positions"
        raise RecordingError(f"no labelled markers in it, but {kinds}; export it from Motive with Markers")
    bodies = {name.partition(":")[0].strip() for _, kind, name in columns if kind.startswith("rigid body")}
    labels = [f"{number[1]} {number[2]}" if (number := _NUMBERED.match(name)) else name for _, _, name in chosen]
    pairs = [(owner.strip(), own.strip()) for owner, _, own in (label.rpartition(":") for label in labels)]
    count = Counter(own for owner, own in pairs if owner in bodies)
    for i, (owner, own) in enumerate(pairs):
        if owner in bodies:  # a segment, not a subject: it belongs to a name that is not unique
            labels[i] = own if count[own] == 1 else f"{owner} {own}"
    numbers, lacking = tables.read_rows(lines[axes + 1 :], axes + 2, ",", len(table[axes]), counted=True)
    places = [place + axis for place, _, _ in chosen for axis in range(3)]
    keys = [cell.strip().lower() for cell in table[0]]
    given = dict(zip(keys[::2], table[0][1::2], strict=False))
    rates = (tables.number_or_none(given.get(f"{of} frame rate", "")) for of in ("export", "capture"))
    rate, unit = next((rate for rate in rates if rate is not None), None), given.get("length units") or None
    return FileContents(labels, tables.as_points(numbers[:, places]), rate, unit, notes=(*notes, *lacking))


def _columns(table: list[list[str]], axes: int) -> list[tuple[int, str, str]]:
    """The positions in a file, by its lines of headers; ``axes`` is the number of the last of them.

    Each takes three columns: the number of the first, the type of what is there, and its name.
    """
    titles = {row[1].strip().lower(): row for row in table[1:axes] if len(row) > 1 and row[1].strip()}
    if axes < _FEWEST or not {"type", "name"} <= titles.keys():
        raise RecordingError("no lines Type, Name and Frame above the rows; export it from Motive with its header")
    width = len(table[axes])
    heads = titles["type"], titles["name"], table[axes - 1]
    kinds, names, holds = ([cell.strip() for cell in [*row, *[""] * width][:width]] for row in heads)
    axis = [cell.strip().lower() for cell in table[axes]]
    places = [i for i in range(2, width - 2) if axis[i : i + 3] == ["x", "y", "z"] and holds[i].lower() == "position"]
    return [(i, kinds[i].lower(), names[i]) for i in places]


_QUALISYS = "NO_OF_FRAMES"
_NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?$")
_ABSENT = ("", "null", "nan")


def read_qualisys(lines: list[str]) -> FileContents:
    """Read a TSV file of trajectories.

    Raises:
        RecordingError: one line, without the file's name: it holds rigid bodies (6D) and no trajectories, lacks its
            markers' names or its rate, or its rows do not fit the names.
    """
    header, start = _header(lines)
    kind = " ".join(header.get("DATA_INCLUDED", [])).strip().upper()
    if kind and not kind.startswith("3D"):
        raise RecordingError(f"it holds {kind} data; export the trajectories (3D) from Qualisys Track Manager")
    labels = [name for name in header.get("MARKER_NAMES", []) if name]
    if not labels:
        raise RecordingError("no line MARKER_NAMES with the markers' names")
    rate = tables.number_or_none("".join(header.get("FREQUENCY", [])[:1]).replace(",", "."))
    if rate is None:
        raise RecordingError("no line FREQUENCY with the frames per second")
    rows = lines[start:]
    wanted = 3 * len(labels)
    cells = max((len(row.rstrip("\r\n").split("\t")) for row in rows), default=wanted)
    extra = 2 if cells >= wanted + 2 else 0  # Frame and Time, if they were exported; a row may end in a tab
    numbers, notes = tables.read_rows(rows, start + 1, "\t", wanted + extra, counted=extra > 0)
    promised = "".join(header[_QUALISYS][:1])
    notes += tables.missing_frames_note(len(numbers), int(promised)) if promised.isdigit() else ()
    return FileContents(labels, tables.as_points(numbers[:, extra:]), rate, "mm", notes=notes)


def _header(lines: list[str]) -> tuple[dict[str, list[str]], int]:
    """The values of each key, and the number of the first line of rows, from 0."""
    header: dict[str, list[str]] = {}
    for number, line in enumerate(lines):
        cells = [cell.strip() for cell in line.split("\t")]
        numbers = any(cells) and all(cell.lower() in _ABSENT or _NUMBER.match(cell) for cell in cells)
        if "MARKER_NAMES" in header and numbers:
            return header, number
        if cells[0]:
            header[cells[0].rstrip(":").upper()] = cells[1:]
    return header, len(lines)


_OPENINGS = ("PathFileType", _QUALISYS, _MOTIVE, "Trajectories")
"""Words with which files of a known format begin."""
_OPENING_LINES = 50
"""Lines in which a file says what it is."""


def read_text(path: Path) -> FileContents:
    """Read markers from a text file: TRC, Qualisys, Motive, Vicon Nexus, BTK, or a table.

    Rate and unit come from the header of the format; in other tables from lines ``# rate: 120`` and ``# unit: mm``, or
    from a column ``time`` in seconds. Empty cells are missing samples.

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
    opening = lines[0].lstrip().lstrip('"')
    if opening.startswith("PathFileType") or path.suffix.lower() == ".trc":
        return tables.read_trc(lines)
    if opening.startswith(_MOTIVE):
        return read_motive(lines)
    for number, line in enumerate(lines[:_OPENING_LINES]):
        if line.startswith(f"{_QUALISYS}\t"):
            return read_qualisys(lines)
        if line.strip().strip(",;\t\"'").lower() == "trajectories":
            return tables.read_vicon(lines, number)
    axes = tables.find_axes(lines)
    return tables.read_table(lines) if axes is None else tables.read_columns(lines, axes)


FORMATS = (".c3d", ".csv", ".trc", ".tsv", ".txt")
"""Ends of names; files of other names are read if their contents say what they are."""
_HEAD = 64
"""Bytes that tell a format."""


def read_recording(
    path: str | Path,
    *,
    unit: str | None = None,
    rate: float | None = None,
    subject: str | None = None,
    frames: str | None = None,
) -> Recording:
    """Read a recording.

    Args:
        path: ``.c3d``; ``.trc``; ``.csv``, ``.tsv`` or ``.txt`` with columns ``LFHD_X``, ``LFHD_Y``, ``LFHD_Z``, or as
            exported by Vicon, Qualisys, Motive or Cortex. C3D and these exports are recognised by what is in the file,
            under any name.
        unit: of the file's numbers, m, cm, mm, ...; overrides the file.
        rate: frames per second; overrides the file.
        subject: the subject whose markers to take, if the file has several.
        frames: a range such as ``1-499``, from 1, both ends included; all if None.

    Returns:
        The recording, in metres.

    Raises:
        RecordingError: one line with the file, the fault and the remedy.

    Examples:
        >>> import study
        >>> with open("walk.csv", "w") as file:
        ...     for line in ("time,LASI_X,LASI_Y,LASI_Z", "0.00,412,680,966", "0.01,413,680,966"):
        ...         print(line, file=file)
        >>> recording = study.read_recording("walk.csv", unit="mm")
        >>> recording.markers, recording.frames, recording.rate
        (('LASI',), 2, 100.0)
        >>> recording.of("LASI")[:, 0]
        array([0.412, 0.68 , 0.966])
    """
    path = named_path(path, "recording")
    with _named(path):
        recording = assemble(_contents(path), printable(path.stem), unit=unit, rate=rate, subject=subject)
        return recording if frames is None else frames_between(recording, frames)


def subjects_of(path: Path) -> list[str]:
    """Names of the subjects in a file, in its order; none if its labels have no prefix.

    Raises:
        RecordingError: one line with the file, the fault and the remedy.
    """
    with _named(path):
        return subjects(_contents(path))


@contextlib.contextmanager
def _named(path: Path) -> Iterator[None]:
    """Faults of reading a file, as one line with its name."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise RecordingError(f"{path}: reading it needs {error.name}: pip install '.[mocap]'") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None


def _contents(path: Path) -> FileContents:
    """The contents of a file of any known format."""
    if path.exists():
        regular(path)
    if not _is_c3d(path):
        return read_text(path)
    from study.recordings.formats.c3d import read_c3d  # its libraries come with the extra mocap

    return read_c3d(path)


def _is_c3d(path: Path) -> bool:
    """True for a C3D file by its contents, or by its name if the contents say nothing.

    Raises:
        RecordingError: if neither name nor contents are those of a recording.
        OSError: if the file cannot be read.
    """
    suffix = path.suffix.lower()
    head = b""
    if suffix in FORMATS or path.is_file():
        with open(path, "rb") as file:
            head = file.read(_HEAD)
    if head[1:2] == b"\x50" and head[0] < ord(" "):  # the first byte, the place of the parameters, is small
        return True
    if head.decode("latin-1").removeprefix("\xef\xbb\xbf").lstrip().lstrip('"').startswith(_OPENINGS):
        return False
    if suffix not in FORMATS:
        raise RecordingError(f"a recording is a file whose name ends in {', '.join(FORMATS)}")
    return suffix == ".c3d"
