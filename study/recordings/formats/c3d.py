"""C3D files, read with ezc3d, or with c3d if ezc3d refuses a file, or would leave out frames or fill the memory.

The format is described at c3d.org (The C3D File Format: User Guide). A file begins with a block of 512 bytes that gives
the number of points and frames and the places of the parameters and of the data. Libraries reserve memory for what is
promised there, and a damaged header of a small file may promise terabytes: it is checked before a library reads it, and
so are the parameters, a chain of records, each with the distance to the next one. Where header, parameters and the
file's size do not agree, c3d is first, which reserves no more than it reads.

The header counts frames in 16 bits; longer recordings give their length in a parameter (``TRIAL:ACTUAL_END_FIELD``,
``POINT:LONG_FRAMES``), which c3d reads and ezc3d does not always.
"""

import contextlib
import math
import re
import struct
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import c3d
import ezc3d
import numpy as np

from study.arrays import Floats
from study.recordings.formats.text import missing_frames_note
from study.recordings.recording import (
    Contact,
    FileContents,
    GaitEvent,
    Laboratory,
    RecordingError,
    measured_widths,
    static_offsets,
)

_TEXT = -1
_SIZES = {_TEXT: "", 1: "b", 2: "H", 4: "f"}
"""Letters of `struct` for the numbers, by their size in bytes."""


def read_parameters(data: bytes, order: str) -> tuple[bool, dict[str, float]]:
    """Follow the chain of parameters.

    Args:
        data: the file's bytes from its block of parameters on.
        order: of bytes, as `struct` has it: ``<`` or ``>``.

    Returns:
        True if each record ends where the next one begins, and no text lacks its length; and the first number of each
        parameter that holds numbers, by ``GROUP:NAME``.
    """
    groups: dict[int, str] = {}
    numbers: dict[tuple[int, str], float] = {}
    sound = True
    try:
        for group, name, size, dimensions, start in _records(data, order):
            if group < 0:
                groups[-group] = name
            elif size == _TEXT:
                sound &= len(dimensions) > 0  # ezc3d ends the program on these
            elif 0 not in dimensions:
                (numbers[group, name],) = struct.unpack_from(f"{order}{_SIZES[size]}", data, start)
    except (struct.error, IndexError, ValueError):
        sound = False
    return sound, {f"{groups.get(group, '')}:{name}": float(number) for (group, name), number in numbers.items()}


def _records(data: bytes, order: str) -> Iterator[tuple[int, str, int, tuple[int, ...], int]]:
    """The records, groups and parameters, up to the last one.

    Each has the number of its group, negative in the record of the group itself; its name; the bytes of one value, -1
    for text and 0 for a group; the dimensions of its values; and the place of the first one.

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
        yield group, name, size, dimensions, values
        if not distance:
            return
        place = end


LONG = 65535
"""The largest number of frames in a header; longer recordings have this number there."""
_BLOCK = 512
_MAGIC = 0x50
_INTEL, _MIPS = 84, 86  # processors: Intel has the low byte first, MIPS the high byte; DEC, 85, swaps words of numbers
_MOST = 255 * _BLOCK  # bytes of parameters, at most
_MUCH = 2.0
"""Promised size, in units of the file's, above which a file is damaged, not just cut short."""
_FASTEST = 1e6
"""Frames per second that no camera reaches."""
_LITTLE = 1 << 20
"""Bytes that may be promised whatever the file's size."""


@dataclass(frozen=True)
class C3DHeader:
    """The header of a C3D file, as far as it is checked."""

    frames: int
    """Number of frames; `LONG` for that many or more."""
    sound: bool
    """True if each parameter ends where the next one begins, none promises more than the file can hold, and those of
    analog samples are there."""
    rate: float
    """Frames per second by the header; 0 if it gives none."""
    plain: bool
    """True if header, parameters and the file's size agree on numbers of points, frames and analog samples."""
    whole: int
    """Number of frames that the file can hold."""
    widths: Mapping[str, float]
    """Of the subject's joints, metres, from the group PROCESSING, in which Vicon's programs keep them."""
    offsets: Mapping[str, float]
    """Of the static trial, radians, from the same group."""
    unused: tuple[str, ...]
    """Names of rotation offsets in that group that are not 0."""


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
    sound, numbers = read_parameters(data, order)
    points, analog, first, last, block = struct.unpack_from(f"{order}4H6xH", header, 2)
    sign = header[{_INTEL: 15, _MIPS: 12}.get(data[3], 13)] & 0x80  # a negative scale: the data are single precision
    frame_bytes = (4 * points + analog) * (4 if sign else 2)  # four numbers a point, one an analog sample
    known = data[3] in (_INTEL, _MIPS)
    (rate,) = struct.unpack_from(f"{order}f", header, 20) if known else (0.0,)
    frames = max(last - first + 1, 0) if last < LONG else LONG
    held = max(size - max(block - 1, 0) * _BLOCK, 0)
    parameter = int(numbers.get("POINT:FRAMES", 0.0))
    if 1 < parameter < frames and frames * frame_bytes > held >= parameter * frame_bytes:
        frames = parameter  # one of the two is damaged, and the file is as long as the parameter says
    promised = frames * frame_bytes
    if promised > _MUCH * size + _LITTLE:
        words = f"{frames} frames of {points} points and {analog} analog samples, {_size(promised)}, but the file has"
        raise RecordingError(f"its header promises {words} {_size(size)}: it is damaged; get a whole copy of it")
    rotations = frames * numbers.get("ROTATION:RATIO", 0.0) * 4
    sound = sound and rotations <= _MUCH * size + _LITTLE
    needed = ("ANALOG:SCALE", "ANALOG:OFFSET") if numbers.get("ANALOG:USED") else ()
    sound = sound and all(name in numbers for name in needed)  # without them ezc3d ends the program
    agree = numbers.get("POINT:USED", points) == points and numbers.get("POINT:FRAMES", 0.0) <= frames
    per_frame = numbers.get("ANALOG:RATE", 0.0) / max(numbers.get("POINT:RATE", rate), 1.0)
    agree = agree and abs(numbers.get("ANALOG:USED", 0.0) * per_frame - analog) < 0.5
    plain = sound and agree and held - promised < 2 * _BLOCK
    processing = {key.removeprefix("PROCESSING:"): x for key, x in numbers.items() if key.startswith("PROCESSING:")}
    processing, rate = processing if known else {}, rate if 0.0 < rate < _FASTEST else 0.0
    unused = tuple(name for name, angle in processing.items() if _ROTATION.fullmatch(name) and angle)
    told = measured_widths(processing), static_offsets(processing), unused
    return C3DHeader(frames, sound, rate, plain, held // max(frame_bytes, 1), *told)


_ROTATION = re.compile(r"[LR](THIGHROTATION|SHANKROTATION|TIBIALTORSION)")
"""Offsets of Plug-in Gait about the long axes of a leg. Programs differ in their signs: they are not applied."""


def _size(count: int) -> str:
    """A number of bytes in words."""
    for power, unit in ((4, "TB"), (3, "GB"), (2, "MB"), (1, "kB")):
        if count >= 1000**power:
            return f"{count / 1000**power:.3g} {unit}"
    return f"{count} bytes"


Texts = Mapping[str, Iterable[object]]
"""The texts of parameters by their names."""
_NOT_MARKERS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "MODELED_MARKERS")
_HIP = re.compile(r"[LR]_?HJC", re.I)
"""A hip's centre stays among the points although a model computed it: `--hips regression` takes it."""


def read_c3d(path: Path) -> FileContents:
    """Read the points of a C3D file, its gait events and the loads on its force plates.

    Samples with a negative residual are NaN. Points that the file lists as angles, forces, moments, powers, scalars or
    markers of a model are not markers and are left out; processed gait files have them.

    Raises:
        RecordingError: one line, without the file's name: not a C3D file, damaged, cut short.
        OSError: if the file cannot be opened.
    """
    header = read_header(path)
    # ezc3d leaves out the frames after the 65535th, and ends the whole program on some damaged files
    readers = [_by_ezc3d, _by_c3d] if header.plain and header.frames < LONG else [_by_c3d, _by_ezc3d]
    for reader in readers if header.sound else [_by_c3d]:
        try:
            contents = reader(path)
        except (OSError, RecordingError):
            raise
        except Exception:  # the libraries raise many types: IndexError, AssertionError, ...
            continue
        contents = replace(contents, points=contents.points[:, :, : header.whole])  # c3d reads a part of a frame, too
        count, _, frames = contents.points.shape
        notes = (*contents.notes, *(missing_frames_note(frames, header.frames) if count else ()))
        if header.unused:
            words = "so that rotations of hips, knees and ankles have another zero than Vicon's"
            notes += (f"its offsets {', '.join(header.unused)} of Plug-in Gait are not applied, {words}",)
        rate = contents.rate
        if header.rate and not (rate is not None and 0.0 < rate < _FASTEST):
            notes += (f"its parameter POINT:RATE is no rate: {header.rate:g} Hz of its header is used",)
            rate = header.rate
        laboratory = replace(contents.laboratory, offsets=header.offsets)
        return replace(contents, rate=rate, notes=notes, widths=header.widths, laboratory=laboratory)
    raise RecordingError("a damaged or incomplete C3D file, which no reader can read; get a whole copy of it")


def _by_ezc3d(path: Path) -> FileContents:
    try:
        file = ezc3d.c3d(str(path))
        if np.any(file["parameters"].get("FORCE_PLATFORM", {}).get("USED", {}).get("value", 0)):
            with contextlib.suppress(Exception):  # plates of a type that it does not know, or without their channels
                file = ezc3d.c3d(str(path), extract_forceplat_data=True)
    except OSError as error:  # it raises this for wrong contents, too; the file itself could be opened
        raise ValueError from error
    group = file["parameters"]["POINT"]
    parameters = {key: entry["value"] for key, entry in group.items() if key != "__METADATA__"}
    subjects = file["parameters"].get("SUBJECTS", {})
    prefixes = subjects.get("LABEL_PREFIXES", {}).get("value", ())
    points = file["data"]["points"][:3].transpose(1, 0, 2)
    residuals = file["data"]["meta_points"]["residuals"][0]
    rate, first = float(file["header"]["points"]["frame_rate"]), file["header"]["points"]["first_frame"]
    contents = _contents(points, residuals, parameters, rate, prefixes)
    group, stretch = file["parameters"].get("EVENT", {}), (0.0, 0.0)
    contexts, labels, times = (group.get(key, {}).get("value", ()) for key in ("CONTEXTS", "LABELS", "TIMES"))
    plates, analog = file["data"].get("platform", ()), file["header"]["analogs"]["frame_rate"]
    contacts = tuple(load for plate in plates for load in _contacts(plate["force"], plate["corners"].T, analog))
    if rate > 0:
        stretch = first / rate, points.shape[2] / rate
    events = _events(contexts, labels, np.ravel(times, order="F"), stretch)
    return replace(contents, laboratory=Laboratory(events, contacts))


class _PointReader(c3d.Reader):  # type: ignore[misc]  # c3d has no types
    """A reader of points: analog samples stay as they are, since c3d refuses the offsets that ezc3d writes for them."""

    def get_analog_transform(self) -> tuple[float, float]:
        """Factors and offsets of the analog samples."""
        return 1.0, 0.0


def _by_c3d(path: Path) -> FileContents:
    with warnings.catch_warnings(), open(path, "rb") as file:
        warnings.simplefilter("ignore")  # about missing parameters; missing frames are counted below
        reader = _PointReader(file)
        data = np.array([points for _, points, _ in reader.read_frames()], dtype=np.float64)
        missing_frames_note(len(data), reader.frame_count)
        group = reader.get("POINT")
        parameters = {key: _strings(reader, f"POINT:{key}") for key in group.param_keys()} if group else {}
        prefixes = _strings(reader, "SUBJECTS:LABEL_PREFIXES")
        rate = float(reader.point_rate)
        contexts, labels = (_strings(reader, f"EVENT:{key}") for key in ("CONTEXTS", "LABELS"))
        times = reader.get("EVENT:TIMES")
        stretch = ((reader.first_frame - 1) / rate, len(data) / rate) if rate > 0 else (0.0, 0.0)
        events = _events(contexts, labels, np.ravel(times.float_array) if times is not None else np.empty(0), stretch)
    data = data.reshape(len(data), -1, 5)
    points = data[:, :, :3].transpose(1, 2, 0)
    contents = _contents(points, data[:, :, 3].T, parameters, rate, prefixes)
    return replace(contents, laboratory=Laboratory(events))


_STRIKE, _OFF = (
    re.compile(r"(foot|heel)strike|(initial|foot)contact|hs|ic|fs|on"),
    re.compile(r"(foot|toe)off|to|fo|off"),
)


def _events(
    contexts: Iterable[object], labels: Iterable[object], times: Floats, stretch: tuple[float, float]
) -> tuple[GaitEvent, ...]:
    """The strikes and offs of feet among a file's events, in their order; those outside of its frames are left out.

    Vicon counts times from the trial's first frame, of which a file may hold a part; other programs count them from the
    file's first frame.

    Args:
        contexts: of each event, such as Left.
        labels: of each event, such as Foot Strike, or RHS with a side of its own.
        times: minutes and seconds of each event, one after another.
        stretch: seconds from the trial's first frame to the file's first frame, and from there to the end.
    """
    found = []
    for context, label, minutes, seconds in zip(contexts, labels, times[::2], times[1::2], strict=False):
        side, word = (re.sub(r"[^a-z]", "", str(text).lower()) for text in (context, label))
        if side not in ("left", "right"):
            named = re.match(r"left|right|[lr]", word)
            side = {"l": "left", "r": "right"}[word[0]] if named else ""
            word = word[named.end() :] if named else word
        kind = "strike" if _STRIKE.fullmatch(word) else "off" if _OFF.fullmatch(word) else ""
        if side and kind:
            found.append(GaitEvent(side, kind, 60.0 * float(minutes) + float(seconds)))
    shifted = [[event._replace(time=event.time - first) for event in found] for first in (stretch[0], 0.0)]
    inside = [[event for event in events if -1e-3 < event.time < stretch[1]] for events in shifted]
    return tuple(sorted(inside[len(inside[1]) > len(inside[0])], key=lambda event: event.time))


_LOADED = 20.0
"""Newton: force from which a foot is on a plate, as usual in gait laboratories."""
_BRIEF = 0.1
"""Seconds: loads that last less are not steps."""


def _contacts(force: Floats, corners: Floats, rate: float) -> Iterator[Contact]:
    """The stretches in which a plate is loaded; an end at the start or the end of the file is not known.

    Args:
        force: on the plate (3, samples), newton; an offset that lasts for most of the file is taken away.
        corners: of the plate (4, 3).
        rate: samples per second.
    """
    size = np.linalg.norm(np.nan_to_num(force), axis=0)
    if not (rate > 0 and len(size)):
        return
    loaded = np.concatenate([[False], size - np.quantile(size, 0.1) > _LOADED, [False]])
    edges = np.flatnonzero(np.diff(loaded.astype(np.int8))).reshape(-1, 2)
    for start, end in edges.tolist():
        times = start / rate if start else np.nan, end / rate if end < len(size) else np.nan
        if not np.isnan(times).all() and end - start >= _BRIEF * rate:
            yield Contact(*times, corners)


def _strings(reader: c3d.Reader, name: str) -> list[str]:
    """The texts of a parameter, read with c3d; none if it is missing or holds numbers."""
    parameter = reader.get(name)
    if parameter is None or parameter.bytes_per_element != -1:
        return []
    if len(parameter.dimensions) < 2:
        return [parameter.string_value] if parameter.dimensions else []
    return [str(text) for text in np.ravel(parameter.string_array)]


def _contents(points: Floats, residuals: Floats, texts: Texts, rate: float, prefixes: Iterable[object]) -> FileContents:
    """The contents in one form, whichever library read them.

    Args:
        points: (points, 3, frames).
        residuals: (points, frames).
        texts: of the group POINT.
        rate: frames per second; 0 if the file does not give it.
        prefixes: of labels.
    """
    labels = _numbered(texts, "LABELS")[: len(points)]
    labels += [""] * (len(points) - len(labels))
    points = np.where(residuals[:, None] < 0, np.nan, points)
    derived = {label for kind in _NOT_MARKERS for label in _numbered(texts, kind) if label and not _HIP.match(label)}
    rows = [row for row, label in enumerate(labels) if label not in derived]
    notes = (f"{len(labels) - len(rows)} points hold angles, forces and the like, not markers: left out",)
    units = [unit.strip("\0 ") for unit in texts.get("UNITS", ()) if isinstance(unit, str)]
    named, unit = [labels[row] for row in rows], next((unit for unit in units if unit), None)
    heads, told = [str(prefix).strip() for prefix in prefixes], notes if len(rows) < len(labels) else ()
    # C3D files without a unit are usually in millimetres
    return FileContents(named, points[rows], rate if rate > 0 else None, unit, heads, told, usual_unit="mm")


def _numbered(parameters: Texts, name: str) -> list[str]:
    """Texts of a parameter and of its continuations, 255 texts in each: LABELS, LABELS2, LABELS3, ..."""
    keys = (name, *(f"{name}{number}" for number in range(2, 260)))
    return [str(text).strip() for key in keys for text in parameters.get(key, ())]
