"""From what a file holds to a recording: units, labels and missing samples are settled here, for every format."""

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
"""Metres between which the markers of a body, or of two that dance, are apart."""


@dataclass(frozen=True, eq=False)
class Contents:
    """What a file of markers holds, in its own words."""

    labels: Sequence[str]
    """One per point, as written."""
    points: Floats
    """(points, 3, frames) in the file's unit; what was not seen is NaN or zero in all three."""
    rate: float | None
    """Frames per second, None where the file does not say."""
    unit: str | None
    """None where the file does not say."""
    prefixes: Sequence[str] = ()
    """What labels begin with, where the file says so."""
    notes: tuple[str, ...] = ()


def assemble(
    contents: Contents,
    name: str,
    *,
    unit: str | None = None,
    rate: float | None = None,
    subject: str | None = None,
    usual_unit: str | None = None,
) -> Recording:
    """Make a recording of a file's contents.

    Args:
        contents: what the reader of the format found.
        name: what to call the recording.
        unit: of the file's numbers; goes before what the file says.
        rate: frames per second; goes before what the file says.
        subject: whose markers to take, where there are several subjects.
        usual_unit: what to take, with a note, where neither the file nor the caller says it.

    Raises:
        RecordingError: one line, without the file's name: no markers, fewer than two frames, nothing ever seen, an
            unknown unit, no rate, several subjects.
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
        notes.append(f"the file does not say its unit: {used} assumed")
    rate = contents.rate if rate is None else rate
    if rate is None or not np.isfinite(rate) or rate <= 0:
        found = "is not said" if rate is None else f"is {rate:g}"
        raise RecordingError(f"its rate in frames per second {found}; give one above 0 (rate)")
    positions = np.array(contents.points[list(naming.rows)], dtype=np.float64, order="C")
    missing = ~np.isfinite(positions).all(axis=1) | (positions == 0).all(axis=1)
    if missing.all():
        raise RecordingError(f"none of its {len(naming.rows)} markers is seen in any of its {frames} frames")
    positions *= UNITS[used]
    positions[np.broadcast_to(missing[:, None], positions.shape)] = np.nan
    extent = _extent(positions, ~missing)
    if not _BODY[0] <= extent <= _BODY[1]:
        notes.append(f"its markers are {extent:.3g} m apart: is its unit {used} right? (unit)")
    return Recording(name, naming.markers, positions, float(rate), tuple(notes))


def _unit(text: str | None) -> str:
    """The unit meant by what a file or a user calls it."""
    if text is None:
        raise RecordingError(f"its unit is not said; give one of {', '.join(UNITS)} (unit)")
    word = text.strip().lower()
    word = word if word in UNITS else _SPELLINGS.get(word.rstrip("s."), word.rstrip("s."))
    if word not in UNITS:
        raise RecordingError(f"its unit {text!r} is not known; give one of {', '.join(UNITS)} (unit)")
    return word


def _extent(positions: Floats, seen: Bools) -> float:
    """Median over some frames of the diagonal of the box about the markers, metres; `_BODY[0]` for one marker."""
    some = np.unique(np.linspace(0, positions.shape[2] - 1, 200).astype(int))
    some = some[seen[:, some].sum(axis=0) > 1]
    if not len(some):
        return _BODY[0]
    chosen = positions[:, :, some]
    box = np.nanmax(chosen, axis=0) - np.nanmin(chosen, axis=0)
    return float(np.median(np.linalg.norm(box, axis=0)))
