"""Make a recording of a file's contents: units, labels and missing samples, for every format."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from study.mocap.io.labels import name_points
from study.mocap.io.recording import Recording, RecordingError
from study.sphere.types import Bools, Floats

UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
"""Metres in one of each."""
_SPELLINGS = {"meter": "m", "metre": "m", "centimeter": "cm", "centimetre": "cm", "millimeter": "mm"}
_SPELLINGS |= {"millimetre": "mm", "inch": "in", "inche": "in", "feet": "ft", "foot": "ft", "µm": "um", "μm": "um"}
_BODY = 0.05, 20.0
"""Least and greatest plausible extent of the markers, metres: one hand, and two dancers."""


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


def assemble(
    contents: FileContents,
    name: str,
    *,
    unit: str | None = None,
    rate: float | None = None,
    subject: str | None = None,
    usual_unit: str | None = None,
) -> Recording:
    """Make a recording of a file's contents.

    Args:
        contents: as the reader of the format returns them.
        name: of the recording.
        unit: of the file's numbers; overrides the file.
        rate: frames per second; overrides the file.
        subject: the subject whose markers to take, if there are several.
        usual_unit: the unit to assume, with a note, if neither the file nor the caller gives one.

    Raises:
        RecordingError: one line, without the file's name: no markers, fewer than two frames, no samples, an unknown
            unit, no rate, several subjects.
    """
    count, _, frames = contents.points.shape
    if count == 0:
        raise RecordingError("no markers in it")
    if frames < 2:
        raise RecordingError(f"{'1 frame' if frames else 'no frames'} in it; motion needs at least 2")
    naming = name_points(contents.labels, subject, contents.prefixes)
    notes = [*contents.notes, *naming.notes]
    used = _unit(unit or contents.unit or usual_unit)
    if unit is None and not contents.unit:
        notes.append(f"the file does not give its unit: {used} assumed")
    rate = contents.rate if rate is None else rate
    if rate is None or not np.isfinite(rate) or rate <= 0:
        found = "is not given" if rate is None else f"is {rate:g}"
        raise RecordingError(f"its rate in frames per second {found}; give one above 0 with --rate")
    positions = np.array(contents.points[list(naming.rows)], dtype=np.float64, order="C")
    missing = ~np.isfinite(positions).all(axis=1) | (positions == 0).all(axis=1)
    if missing.all():
        raise RecordingError(f"none of its {len(naming.rows)} markers has a sample in any of its {frames} frames")
    positions *= UNITS[used]
    positions[np.broadcast_to(missing[:, None], positions.shape)] = np.nan
    extent = _extent(positions, ~missing)
    if not _BODY[0] <= extent <= _BODY[1]:
        notes.append(f"its markers are {extent:.3g} m apart: is its unit {used} right? Give another with --unit")
    return Recording(name, naming.markers, positions, float(rate), tuple(notes))


def _unit(text: str | None) -> str:
    """The unit, as a key of `UNITS`, from its name in a file or from a user."""
    if text is None:
        raise RecordingError(f"its unit is not given; give one of {', '.join(UNITS)} with --unit")
    word = text.strip().lower()
    word = word if word in UNITS else _SPELLINGS.get(word.rstrip("s."), word.rstrip("s."))
    if word not in UNITS:
        raise RecordingError(f"its unit {text!r} is not known; give one of {', '.join(UNITS)} with --unit")
    return word


def _extent(positions: Floats, seen: Bools) -> float:
    """Median over some frames of the diagonal of the markers' bounding box, metres; `_BODY[0]` for one marker."""
    some = np.unique(np.linspace(0, positions.shape[2] - 1, 200).astype(int))
    some = some[seen[:, some].sum(axis=0) > 1]
    if not len(some):
        return _BODY[0]
    chosen = positions[:, :, some]
    box = np.nanmax(chosen, axis=0) - np.nanmin(chosen, axis=0)
    return float(np.median(np.linalg.norm(box, axis=0)))
