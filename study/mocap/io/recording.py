"""A recording: the position of each marker in each frame, in metres."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from study.sphere.types import Bools, Floats, Ints


class RecordingError(Exception):
    """A recording cannot be used; the message, one line, gives its name, the place and the reason."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Marker positions over time.

    A missing sample is NaN in all three coordinates.
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
        positions: Floats = self.positions[self.row(marker)]
        return positions

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
        seen: Bools = ~np.isnan(self.positions[:, 0])
        return seen

    def missing(self) -> Floats:
        """Share of the frames in which each marker is missing (markers,)."""
        share: Floats = 1.0 - self.seen().mean(axis=1)
        return share

    def select(self, markers: Sequence[str] | None = None, frames: slice | Ints | None = None) -> "Recording":
        """The recording with these markers, in this order, and these frames; all if None.

        Raises:
            RecordingError: if there is no such marker.
        """
        names = self.markers if markers is None else tuple(markers)
        positions = self.positions[[self.row(marker) for marker in names]]
        return replace(self, markers=names, positions=positions if frames is None else positions[:, :, frames])


def one_after_another(recordings: Sequence[Recording], name: str) -> Recording:
    """Recordings joined in time, with the markers that any of them has; the rate is the first one's.

    Args:
        recordings: at least one.
        name: of the result.
    """
    markers = tuple(dict.fromkeys(marker for recording in recordings for marker in recording.markers))
    parts = []
    for recording in recordings:
        part = np.full((len(markers), 3, recording.frames), np.nan)
        part[[markers.index(marker) for marker in recording.markers]] = recording.positions
        parts.append(part)
    notes = tuple(f"{recording.name}: {note}" for recording in recordings for note in recording.notes)
    return Recording(name, markers, np.concatenate(parts, axis=2), recordings[0].rate, notes)
