"""A recording: the position of each marker in each frame, in metres.

Readers of file formats return `FileContents`; `assemble` makes a recording of them. It settles for every format alike
units, missing samples, and the names of markers: without subjects' prefixes, and each name once. `describe` lays out
what a recording holds, and `with_origin` stamps a stored table with the recording that it comes from.
"""

import hashlib
import os
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from study.arrays import Bools, Floats, Ints
from study.files import InputError, replacing
from study.text import columns


class RecordingError(InputError):
    """A recording cannot be used; the message, one line, gives its name, the place and the reason."""


def written(path: Path, fill: Callable[[Path], object]) -> Path:
    """Write a file whole or not at all, into a folder that is made if there is none.

    Args:
        path: of the file.
        fill: writes it under a temporary name with the same end, in small letters (see `replacing`).

    Returns:
        The path.

    Raises:
        RecordingError: one line with the file's name: a library is missing, or the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            named = temporary.with_suffix(path.suffix.lower())  # ezc3d wants a name that ends in .c3d
            try:
                named.write_bytes(b"")  # ezc3d does not say why it cannot write
                fill(named)
                os.replace(named, temporary)
            finally:
                named.unlink(missing_ok=True)
    except ModuleNotFoundError as error:
        raise RecordingError(f"{path}: writing it needs {error.name}: pip install '.[mocap]'") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from None
    except RecordingError as error:
        raise RecordingError(str(error).replace(str(named), str(path))) from None
    return path


class GaitEvent(NamedTuple):
    """A foot that strikes or leaves the floor."""

    side: str
    """``left`` or ``right``."""
    kind: str
    """``strike`` or ``off``."""
    time: float
    """Seconds from the first frame."""
    source: str = "file"
    """``file``, ``plate`` or ``markers``."""


class Contact(NamedTuple):
    """A load on a force plate; nothing tells whose foot it is."""

    start: float
    """Seconds from the first frame; NaN if the recording begins later."""
    end: float
    """Likewise; NaN if the recording ends earlier."""
    corners: Floats
    """Of the plate (4, 3), metres, in the recording's axes."""


@dataclass(frozen=True, eq=False)
class Laboratory:
    """Contents of a laboratory's file beside its markers: events, loads on force plates, offsets of Plug-in Gait."""

    events: tuple[GaitEvent, ...] = ()
    contacts: tuple[Contact, ...] = ()
    offsets: Mapping[str, float] = field(default_factory=dict)
    """Radians, such as "left foot flexion", by which a foot's axis is tilted in the static trial."""

    def between(self, first: float, last: float) -> "Laboratory":
        """The same for a part of the recording, from a first to a last time, seconds, which counts from the first."""
        events = [event._replace(time=event.time - first) for event in self.events if first <= event.time <= last]

        def inside(time: float) -> float:
            return time - first if first < time < last else np.nan

        loads = [c._replace(start=inside(c.start), end=inside(c.end)) for c in self.contacts]
        known = tuple(c for c in loads if not np.isnan([c.start, c.end]).all())
        return replace(self, events=tuple(events), contacts=known)


@dataclass(frozen=True, eq=False)
class Recording:
    """Marker positions over time.

    A missing sample is NaN in all three coordinates.

    Examples:
        >>> import numpy as np, study
        >>> positions = np.array([[[0.0, 0.1, np.nan], [0, 0, np.nan], [1, 1, np.nan]]])
        >>> recording = study.Recording("mine", ("LASI",), positions, rate=100.0)
        >>> recording.frames, recording.missing().round(2)
        (3, array([0.33]))
    """

    name: str
    """The stem of the file's name, without unprintable characters."""
    markers: tuple[str, ...]
    """Labels without the subject's prefix, each different."""
    positions: Floats
    """(markers, 3, frames), metres; contiguous over frames."""
    rate: float
    """Frames per second."""
    notes: tuple[str, ...] = ()
    """Messages to the user about the reading: markers left out, labels changed, a unit assumed."""
    widths: Mapping[str, float] = field(default_factory=dict)
    """Measured widths of joints, such as "left knee", and "marker", the diameter of the markers; metres."""
    laboratory: Laboratory = Laboratory()
    """Events, loads on force plates and offsets that the file holds."""

    def __post_init__(self) -> None:
        positions = np.ascontiguousarray(self.positions, dtype=np.float64).view()
        if positions.ndim != 3 or positions.shape[:2] != (len(self.markers), 3):
            wanted = f"({len(self.markers)}, 3, frames)"
            raise RecordingError(f"{self.name}: positions have shape {positions.shape}; they must be {wanted}")
        if len(set(self.markers)) < len(self.markers):
            twice = next(marker for marker in self.markers if self.markers.count(marker) > 1)
            raise RecordingError(f"{self.name}: two markers have the label {twice!r}; change one of them")
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise RecordingError(f"{self.name}: its rate is {self.rate:g} frames per second, but must be above 0")
        positions.flags.writeable = False
        object.__setattr__(self, "positions", positions)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.positions.shape[2])

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (self.frames - 1) / self.rate

    def of(self, marker: str) -> Floats:
        """Positions of one marker (3, frames), metres; a view."""
        return np.asarray(self.positions[self.row(marker)])

    def row(self, marker: str) -> int:
        """Row of a marker in `positions`.

        Raises:
            RecordingError: if there is no such marker.
        """
        try:
            return self.markers.index(marker)
        except ValueError:
            known = ", ".join(self.markers) or "none"
            raise RecordingError(f"{self.name}: no marker {marker!r}; there are {known}") from None

    def seen(self) -> Bools:
        """True where a marker has a sample (markers, frames)."""
        return ~np.isnan(self.positions[:, 0])

    def missing(self) -> Floats:
        """Share of the frames in which each marker is missing (markers,)."""
        return np.asarray(1.0 - self.seen().mean(axis=1))

    def select(self, markers: Sequence[str] | None = None, frames: slice | Ints | None = None) -> "Recording":
        """The recording with these markers, in this order, and these frames; all if None.

        Raises:
            RecordingError: if there is no such marker.
        """
        names = self.markers if markers is None else tuple(markers)
        positions = self.positions[[self.row(marker) for marker in names]]
        return replace(self, markers=names, positions=positions if frames is None else positions[:, :, frames])


def frames_between(recording: Recording, text: str) -> Recording:
    """The frames of a range such as ``1-499`` alone, from 1, both ends included, with a note.

    Raises:
        RecordingError: one line, without the file's name, if it is no range of at least two frames of the recording.
    """
    ends = re.fullmatch(r"\s*(\d{1,9})\s*-\s*(\d{1,9})\s*", text)
    first, last = (int(ends[1]), int(ends[2])) if ends else (0, 0)
    if not 1 <= first < last <= recording.frames:
        words = f"give the first and the last of its {recording.frames} frames, such as 1-{recording.frames}"
        raise RecordingError(f"--frames {text}: {words}")
    part = recording.select(frames=slice(first - 1, last))
    note = f"frames {first}-{last} of {recording.frames}: they count from 1 here"
    told = recording.laboratory.between((first - 1) / recording.rate, (last - 1) / recording.rate)
    return replace(part, laboratory=told, notes=(*part.notes, note))


def one_after_another(recordings: Sequence[Recording], name: str) -> Recording:
    """Recordings joined in time, with the markers that any of them has; the rate is the first one's.

    Args:
        recordings: at least one.
        name: of the result.
    """
    markers = tuple(dict.fromkeys(marker for recording in recordings for marker in recording.markers))
    parts, noted = [], defaultdict[str, list[str]](list)
    for recording in recordings:
        part = np.full((len(markers), 3, recording.frames), np.nan)
        part[[markers.index(marker) for marker in recording.markers]] = recording.positions
        parts.append(part)
        for note in dict.fromkeys(recording.notes):
            noted[note].append(recording.name)
    notes = tuple(f"{', '.join(names)}: {note}" for note, names in noted.items())
    widths = {part: width for recording in recordings for part, width in recording.widths.items()}
    offsets = {part: angle for recording in recordings for part, angle in recording.laboratory.offsets.items()}
    told = notes, widths, Laboratory(offsets=offsets)
    return Recording(name, markers, np.concatenate(parts, axis=2), recordings[0].rate, *told)


_WIDTHS = {
    f"{word}{part}width": f"{side} {part}"
    for side in ("left", "right")
    for word in (side, side[0])
    for part in ("knee", "ankle")
} | {"markerdiameter": "marker"}
"""Plug-in Gait's names of widths, in small letters, and those that they have here."""
_PLAUSIBLE = dict.fromkeys(_WIDTHS.values(), (0.03, 0.25)) | {"marker": (0.002, 0.06)}
"""Least and greatest width, metres."""


def measured_widths(numbers: Mapping[str, float]) -> dict[str, float]:
    """The widths of knees and ankles, metres, among numbers in millimetres by Plug-in Gait's names, as LKneeWidth.

    Left out are other names, and numbers that are no width of a joint: a program writes 0 for one not measured.
    """
    named = {_WIDTHS[name.lower()]: 0.001 * number for name, number in numbers.items() if name.lower() in _WIDTHS}
    return {part: width for part, width in named.items() if _PLAUSIBLE[part][0] <= width <= _PLAUSIBLE[part][1]}


_OFFSETS = {"lstaticplantflex": "left foot flexion", "rstaticplantflex": "right foot flexion"}
"""Plug-in Gait's names of offsets, in small letters, and those that they have here."""
_LARGEST_OFFSET = 1.0
"""Radians."""


def static_offsets(numbers: Mapping[str, float]) -> dict[str, float]:
    """The offsets of a static trial, radians, among numbers by Plug-in Gait's names; 0 is an offset not measured."""
    named = {_OFFSETS[name.lower()]: number for name, number in numbers.items() if name.lower() in _OFFSETS}
    return {part: offset for part, offset in named.items() if 0.0 < abs(offset) < _LARGEST_OFFSET}


def with_widths(recording: Recording, text: str) -> Recording:
    """The recording with widths such as ``LKneeWidth=105,LAnkleWidth=72``, in millimetres.

    Raises:
        RecordingError: one line, without the file's name, if a part of the text is no such width.
    """
    widths: dict[str, float] = {}
    for part in text.split(","):
        name, _, number = part.partition("=")
        try:
            found = measured_widths({name.strip(): float(number)})
        except ValueError:
            found = {}
        if not found:
            names = "LKneeWidth, RKneeWidth, LAnkleWidth, RAnkleWidth or MarkerDiameter"
            words = f"give {names} and millimetres, such as LKneeWidth=105"
            raise RecordingError(f"--widths {part.strip()}: {words}")
        widths |= found
    return replace(recording, widths=dict(recording.widths) | widths)


def name_points(
    labels: Sequence[str], subject: str | None = None, prefixes: Sequence[str] = ()
) -> tuple[list[int], list[str], list[str]]:
    """Name the points of a file.

    A label is a marker's name, perhaps after a subject's name and a colon (``male:LFHD``). Two points with one label
    are both renamed (``LFHD#1``, ``LFHD#2``): nothing tells which of them is the marker, and a marker that is sometimes
    another one does more harm than a missing one.

    Args:
        labels: one per point, as in the file; empty for a point without a label.
        subject: the subject whose markers to take, if the file has several.
        prefixes: of the labels, if the file gives them, such as ``male:``.

    Returns:
        The numbers of the points that are markers, from 0; their names, each different; and messages about points that
        were left out or renamed.

    Raises:
        RecordingError: if there are several subjects and none is chosen, or the chosen one is missing.
    """
    parts = _parts(labels, prefixes)
    counts = Counter(owner for owner, _ in parts if owner)
    listed = ", ".join(f"{owner} ({count} markers)" for owner, count in counts.items())
    if subject is None and len(counts) > 1:
        raise RecordingError(f"it holds {len(counts)} subjects: {listed}; choose one with --subject, or --subject all")
    if subject is not None and subject not in counts:
        raise RecordingError(f"no subject {subject!r} in it; there are {listed or 'none, the labels have no prefix'}")
    # of one subject alone, points without a prefix are taken, too, such as a prop or an unlabelled reflection
    rows = [row for row, (owner, _) in enumerate(parts) if subject in (None, owner)]
    names = [parts[row][1] or f"point {row + 1}" for row in rows]
    left_out = len(labels) - len(rows)
    notes = [f"{left_out} points of other subjects are left out"] * (left_out > 0)
    for name in [name for name, count in Counter(names).items() if count > 1]:
        places = [i for i, other in enumerate(names) if other == name]
        points = ", ".join(str(rows[i] + 1) for i in places)
        words = "nothing tells which is the marker, so none of them is used"
        notes.append(f"the label {name} is on points {points}: {words}")
        for number, i in enumerate(places, start=1):
            names[i] = f"{name}#{number}"
    return rows, names, notes


def _parts(labels: Sequence[str], prefixes: Sequence[str]) -> list[tuple[str, str]]:
    """The subject and the marker of each label; "" for no subject."""
    heads = [printable(prefix.strip()) for prefix in prefixes]
    return [_split(printable(label.strip()), heads) for label in labels]


def subjects(contents: "FileContents") -> list[str]:
    """Names of the subjects whose markers a file has, in its order; none if its labels have no prefix."""
    return list(dict.fromkeys(owner for owner, _ in _parts(contents.labels, contents.prefixes) if owner))


def printable(text: str) -> str:
    """A label, or the name of a file, without unprintable characters."""
    try:
        text.encode()
    except UnicodeEncodeError:  # surrogates stand for bytes that are not UTF-8, such as é or ü in an old file
        text = text.encode("utf-8", "surrogateescape").decode("latin-1")
    return "".join(c if c.isprintable() else "�" for c in text)


def _split(label: str, prefixes: Sequence[str]) -> tuple[str, str]:
    """A label's subject and marker."""
    for prefix in prefixes:
        if prefix and label.startswith(prefix) and len(label) > len(prefix):
            return prefix.rstrip(":"), label[len(prefix) :].strip()
    owner, colon, name = label.rpartition(":")
    return (owner.strip(), name.strip()) if colon and name.strip() else ("", label)


UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
"""Metres in one of each."""
_SPELLINGS = {"meter": "m", "metre": "m", "centimeter": "cm", "centimetre": "cm", "millimeter": "mm"}
_SPELLINGS |= {"millimetre": "mm", "inch": "in", "inche": "in", "feet": "ft", "foot": "ft", "µm": "um", "μm": "um"}
_BODY = 0.05, 20.0
"""Least and greatest plausible extent of the markers, metres: one hand, and two dancers."""
_PERSON = 0.3, 3.0
"""Least and greatest extent of the markers of a person, or of a leg, metres."""


@dataclass(frozen=True, eq=False)
class FileContents:
    """The contents of a file of markers, as they are written there."""

    labels: Sequence[str]
    """One per point."""
    points: Floats
    """(points, 3, frames) in the file's unit; a missing sample is NaN or zero in all three."""
    rate: float | None
    """Frames per second; None if the file does not give it."""
    unit: str | None
    """None if the file does not give it."""
    prefixes: Sequence[str] = ()
    """Prefixes of labels, if the file gives them."""
    notes: tuple[str, ...] = ()
    """Messages to the user about the reading."""
    widths: Mapping[str, float] = field(default_factory=dict)
    """As those of a `Recording`."""
    laboratory: Laboratory = Laboratory()
    """As that of a `Recording`, but with corners of force plates in the unit of the points."""
    usual_unit: str | None = None
    """The unit to assume, with a note, if neither the file nor a user gives one."""


def assemble(
    contents: FileContents, name: str, *, unit: str | None = None, rate: float | None = None, subject: str | None = None
) -> Recording:
    """Make a recording of a file's contents.

    Args:
        contents: as the reader of the format returns them.
        name: of the recording.
        unit: of the file's numbers; overrides the file.
        rate: frames per second; overrides the file.
        subject: the subject whose markers to take, if there are several.

    Raises:
        RecordingError: one line, without the file's name: no markers, fewer than two frames, no samples, an unknown
            unit, no rate, several subjects.
    """
    count, _, frames = contents.points.shape
    if count == 0:
        raise RecordingError("no markers in it")
    if frames < 2:
        raise RecordingError(f"{'1 frame' if frames else 'no frames'} in it; motion needs at least 2")
    rows, markers, notes = name_points(contents.labels, subject, contents.prefixes)
    notes = [*contents.notes, *notes]
    wanted = unit or contents.unit or contents.usual_unit
    used = known_unit(wanted or "")
    if used is None:
        words = "is not given" if wanted is None else f"{wanted!r} is not known"
        raise RecordingError(f"its unit {words}; give one of {', '.join(UNITS)} with --unit")
    if unit is None and not contents.unit:
        notes.append(f"the file does not give its unit: {used} assumed")
    rate = contents.rate if rate is None else rate
    if rate is None or not 0.0 < rate <= sys.float_info.max:
        words = "is not given" if rate is None else f"is {str(rate).removesuffix('.0'):.40}"
        raise RecordingError(f"its rate in frames per second {words}; give one above 0 with --rate")
    positions = np.array(contents.points[rows], dtype=np.float64, order="C")
    missing = ~np.isfinite(positions).all(axis=1) | (positions == 0).all(axis=1)
    if missing.all():
        raise RecordingError(f"none of its {len(rows)} markers has a sample in any of its {frames} frames")
    positions *= UNITS[used]
    positions[np.broadcast_to(missing[:, None], positions.shape)] = np.nan
    # the median over some frames of the diagonal of the bounding box
    some = np.unique(np.linspace(0, frames - 1, 200).astype(int))
    some = some[(~missing[:, some]).sum(axis=0) > 1]
    if len(some):
        box = np.nanmax(positions[:, :, some], axis=0) - np.nanmin(positions[:, :, some], axis=0)
        notes += filter(None, [unit_doubt(float(np.median(np.linalg.norm(box, axis=0))), used)])
    contacts = (load._replace(corners=load.corners * UNITS[used]) for load in contents.laboratory.contacts)
    laboratory = replace(contents.laboratory, contacts=tuple(contacts))
    return Recording(name, tuple(markers), positions, float(rate), tuple(notes), contents.widths, laboratory)


def unit_doubt(extent: float, unit: str) -> str:
    """The sentence on markers that are as far apart as no body's, and the unit in which they would be; "" for a body's.

    Args:
        extent: of the markers in this unit, metres.
        unit: a key of `UNITS`.
    """
    if _BODY[0] <= extent <= _BODY[1]:
        return ""
    in_unit = {name: extent * UNITS[name] / UNITS[unit] for name in ("mm", "m", "cm", "in", "ft")}
    likely = next((name for name, far in in_unit.items() if _PERSON[0] <= far <= _PERSON[1]), None)
    remedy = f"with --unit {likely} they are {in_unit[likely]:.2g} m apart" if likely else "give another with --unit"
    return f"its markers are {extent:.3g} m apart, so its unit is hardly {unit}: {remedy}"


def known_unit(text: str) -> str | None:
    """The unit of length, as a key of `UNITS`, from its name in a file or from a user; None if it is none.

    Some programs fill the name in a C3D file with NUL characters, or cut it off: three letters are enough.
    """
    word = text.strip("\0 \t\r\n").split("\0")[0].strip().lower()
    word = word if word in UNITS else _SPELLINGS.get(word.rstrip("s."), word.rstrip("s."))
    if word in UNITS:
        return word
    begun = {unit for spelling, unit in _SPELLINGS.items() if len(word) > 2 and spelling.startswith(word)}
    return begun.pop() if len(begun) == 1 else None


STILL = 0.001
"""A marker whose bounding box has a smaller diagonal does not move; metres."""


def _stretches(flags: Bools) -> list[tuple[int, int]]:
    """The first place of each stretch of true values, and the first place after it."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def gaps(seen: Bools) -> tuple[int, int, int]:
    """Count the frames in which a marker is missing, the runs of such frames, and the frames of the longest run.

    Args:
        seen: True where it has a sample (frames,).
    """
    lengths = [end - start for start, end in _stretches(~seen)]
    return sum(lengths), len(lengths), max(lengths, default=0)


def extents(recording: Recording) -> Floats:
    """Diagonal of the bounding box of each marker's path (markers,), metres; NaN for a marker without samples."""
    # unlike nanmin, these do not warn about a marker without samples
    low, high = (reduce(recording.positions, axis=2) for reduce in (np.fmin.reduce, np.fmax.reduce))
    return np.asarray(np.linalg.norm(high - low, axis=1))


def whole_frames(seen: Bools) -> list[tuple[int, int]]:
    """First and last frame, from 1, of each stretch in which no marker is missing; one without any sample is left out.

    Args:
        seen: True where a marker has a sample (markers, frames).
    """
    return [(start + 1, end) for start, end in _stretches(np.all(seen[seen.any(axis=1)], axis=0))]


def describe(recording: Recording) -> list[str]:
    """Describe a recording.

    Returns:
        Lines: a headline, notes about the reading, problems, then one line per marker with its gaps.
    """
    seen, moved = recording.seen(), extents(recording)
    count, frames = seen.shape
    size = f"{count} markers, {frames:,} frames at {recording.rate:g} Hz, {recording.duration:.2f} s"
    lines = [f"{recording.name}: {size}, {1 - seen.mean():.1%} of the samples missing"]
    lines += [f"note: {note}" for note in recording.notes]
    if recording.widths:
        lines.append(
            "widths: " + ", ".join(f"{part} {1000 * width:.4g} mm" for part, width in recording.widths.items())
        )
    if never := [recording.markers[row] for row in np.flatnonzero(~seen.any(axis=1))]:
        lines.append(f"without any sample: {', '.join(never)}")
    stretches = whole_frames(seen)
    longest = sorted(stretches, key=lambda ends: ends[0] - ends[1])[:3]
    if not stretches:
        lines.append("in every frame a marker is missing")
    elif stretches != [(1, frames)]:
        listed = ", ".join(f"{first}-{last}" for first, last in sorted(longest))
        whole = sum(last - first + 1 for first, last in stretches)
        more = f" and {len(stretches) - 3} shorter stretches" if len(stretches) > 3 else ""
        first, last = longest[0]
        option = f"; --frames {first}-{last} reads the longest" if last > first else ""
        lines.append(f"no marker is missing in {whole:,} frames: {listed}{more}{option}")
    still = [marker for marker, far in zip(recording.markers, moved, strict=True) if far < STILL]
    if len(still) == count - len(never):
        lines.append(f"no marker moves by more than {1000 * np.nanmax(moved):.2g} mm; joints cannot be found")
    elif still:
        lines.append(f"move by less than {1000 * STILL:g} mm: {', '.join(still)}")
    rows = []
    for marker, row, far in zip(recording.markers, seen, moved, strict=True):
        missing, runs, longest_gap = gaps(row)
        seconds = f"{longest_gap / recording.rate:.2f} s" if longest_gap else "-"
        extent = f"{far:.2f} m" if np.isfinite(far) else "-"
        rows.append([marker, f"{missing / frames:.1%}", str(runs), seconds, extent])
    return [*lines, *columns(rows, ["marker", "missing", "gaps", "longest", "extent"], "<>")]


def recording_data(recording: Recording) -> dict[str, object]:
    """Describe a recording for other programs.

    Returns:
        ``recording``, ``rate``, ``frames``, ``duration`` (seconds), ``missing`` (share of all samples), ``notes``;
        ``markers``, each with ``marker``, the numbers of ``missing`` frames, of ``gaps`` and of frames in the
        ``longest`` one, and ``extent`` (metres); ``whole``, first and last frame of each stretch in which none is
        missing.
    """
    seen = recording.seen()
    counts = [dict(zip(("missing", "gaps", "longest"), gaps(row), strict=True)) for row in seen]
    rows = zip(recording.markers, counts, extents(recording), strict=True)
    markers = [{"marker": marker, **count, "extent": float(far)} for marker, count, far in rows]
    names = "rate", "frames", "duration"
    data = {"recording": recording.name} | {name: getattr(recording, name) for name in names}
    data |= {"missing": float(1.0 - np.mean(seen)), "notes": recording.notes, "markers": markers}
    return data | {"whole": whole_frames(seen)}


ORIGIN = ("recording", "digest")
"""The columns: the file's stem, and the first `DIGITS` hexadecimal digits of its SHA-256.

The digest decides: a renamed or copied file is the same recording, another file of the same name is not.
"""
DIGITS = 12


def digest_of(file: Path) -> str:
    """The first `DIGITS` hexadecimal digits of a file's SHA-256.

    Raises:
        RecordingError: if the file cannot be read.
    """
    try:
        with file.open("rb") as content:
            return hashlib.file_digest(content, "sha256").hexdigest()[:DIGITS]
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {error.strerror or error}") from None


def with_origin(table: pd.DataFrame, recording: str, digest: str) -> pd.DataFrame:
    """The table with the columns `ORIGIN` before its own, the same in every row."""
    return pd.DataFrame(dict(zip(ORIGIN, (recording, digest), strict=True)), index=table.index).join(table)
