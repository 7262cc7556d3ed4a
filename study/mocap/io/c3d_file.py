"""Read C3D files with ezc3d, or with c3d if ezc3d refuses a file or would leave out frames.

The format is described at c3d.org. Its header counts frames in 16 bits; longer recordings give their length in a
parameter (``TRIAL:ACTUAL_END_FIELD``, ``POINT:LONG_FRAMES``), which c3d reads and ezc3d does not always.
"""

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import c3d
import ezc3d
import numpy as np

from study.mocap.io.assembly import FileContents
from study.mocap.io.c3d_header import LONG, read_header
from study.mocap.io.formats.rows import missing_frames_note
from study.mocap.io.recording import RecordingError
from study.sphere.types import Floats

_FASTEST = 1e6
"""Frames per second that no camera reaches."""
_NOT_MARKERS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")


def read_c3d(path: Path) -> FileContents:
    """Read the points of a C3D file.

    Samples with a negative residual are NaN. Points that the file lists as angles, forces, moments, powers or scalars
    are not markers and are left out; processed gait files have them.

    Raises:
        RecordingError: one line, without the file's name: not a C3D file, damaged, cut short.
        OSError: if the file cannot be opened.
    """
    header = read_header(path)
    # ezc3d leaves out the frames after the 65535th, and ends the whole program on some damaged files
    readers = [_by_ezc3d, _by_c3d] if header.frames < LONG else [_by_c3d, _by_ezc3d]
    refusals = []
    for reader in readers if header.sound else [_by_c3d]:
        try:
            contents = reader(path)
        except (OSError, RecordingError):
            raise
        except Exception as error:  # the libraries raise many types: IndexError, AssertionError, ...
            refusals.append(f"{reader.__name__.removeprefix('_by_')}: {_first_line(error)}")
            continue
        count, _, frames = contents.points.shape
        notes = (*contents.notes, *(missing_frames_note(frames, header.frames) if count else ()))
        rate = contents.rate
        if header.rate and not (rate is not None and 0.0 < rate < _FASTEST):
            notes += (f"its parameter POINT:RATE is no rate: {header.rate:g} Hz of its header is used",)
            rate = header.rate
        return replace(contents, rate=rate, notes=notes)
    raise RecordingError(f"a damaged or incomplete C3D file; {refusals[0]}")


def _by_ezc3d(path: Path) -> FileContents:
    try:
        file = ezc3d.c3d(str(path))
    except OSError as error:  # it raises this for wrong contents, too; the file itself could be opened
        raise ValueError(str(error).removesuffix(": iostream error")) from None
    group = file["parameters"]["POINT"]
    parameters = {key: entry["value"] for key, entry in group.items() if key != "__METADATA__"}
    subjects = file["parameters"].get("SUBJECTS", {})
    prefixes = subjects.get("LABEL_PREFIXES", {}).get("value", ())
    points = file["data"]["points"][:3].transpose(1, 0, 2)
    residuals = file["data"]["meta_points"]["residuals"][0]
    return _contents(points, residuals, parameters, float(file["header"]["points"]["frame_rate"]), prefixes)


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
    data = data.reshape(len(data), -1, 5)
    points = data[:, :, :3].transpose(1, 2, 0)
    return _contents(points, data[:, :, 3].T, parameters, rate, prefixes)


def _strings(reader: c3d.Reader, name: str) -> list[str]:
    """The texts of a parameter, read with c3d; none if it is missing or holds numbers."""
    parameter = reader.get(name)
    if parameter is None or parameter.bytes_per_element != -1:
        return []
    if len(parameter.dimensions) < 2:
        return [parameter.string_value] if parameter.dimensions else []
    return [str(text) for text in np.ravel(parameter.string_array)]


def _contents(
    points: Floats,
    residuals: Floats,
    parameters: Mapping[str, Iterable[object]],
    rate: float,
    prefixes: Iterable[object],
) -> FileContents:
    """The contents in one form, whichever library read them.

    Args:
        points: (points, 3, frames).
        residuals: (points, frames).
        parameters: those of the group POINT.
        rate: frames per second; 0 if the file does not give it.
        prefixes: of labels.
    """
    labels = _numbered(parameters, "LABELS")[: len(points)]
    labels += [""] * (len(points) - len(labels))
    points = np.where(residuals[:, None] < 0, np.nan, points)
    derived = {label for kind in _NOT_MARKERS for label in _numbered(parameters, kind) if label}
    rows = [row for row, label in enumerate(labels) if label not in derived]
    notes = (f"{len(labels) - len(rows)} points hold angles, forces and the like, not markers: left out",)
    units = [unit.strip() for unit in parameters.get("UNITS", ()) if isinstance(unit, str)]
    return FileContents(
        labels=[labels[row] for row in rows],
        points=points[rows],
        rate=rate if rate > 0 else None,
        unit=next((unit for unit in units if unit), None),
        prefixes=[str(prefix).strip() for prefix in prefixes],
        notes=notes if len(rows) < len(labels) else (),
    )


def _numbered(parameters: Mapping[str, Iterable[object]], name: str) -> list[str]:
    """Texts of a parameter and of its continuations, 255 texts in each: LABELS, LABELS2, LABELS3, ..."""
    texts: list[str] = []
    keys = [name, *(f"{name}{number}" for number in range(2, 260))]
    for key in keys:
        texts += [str(text).strip() for text in parameters.get(key, ())]
    return texts


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
