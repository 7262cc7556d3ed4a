"""A recording: where each marker was in each frame, in metres. What every other file of the room is given."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from study.sphere.types import Bools, Floats, Ints


class RecordingError(Exception):
    """A recording that cannot be used; the message, one line, says which, where and why."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Marker positions over time.

    A sample in which a marker was not seen is NaN in all three coordinates.
    """

    name: str
    """What to call it: the file's stem."""
    markers: tuple[str, ...]
    """Labels without the subject's prefix, each once."""
    positions: Floats
    """(markers, 3, frames), metres; contiguous over frames, so that a marker's coordinate is one run of memory."""
    rate: float
    """Frames per second."""
    notes: tuple[str, ...] = ()
    """What a user should know of how it was read: markers left out, labels changed, a unit assumed."""

    def __post_init__(self) -> None:
        positions = np.ascontiguousarray(self.positions, dtype=np.float64).view()
        if positions.ndim != 3 or positions.shape[:2] != (len(self.markers), 3):
            wanted = f"({len(self.markers)}, 3, frames)"
            raise RecordingError(f"{self.name}: positions have shape {positions.shape}; they must be {wanted}")
        if len(set(self.markers)) < len(self.markers):
            twice = next(marker for marker in self.markers if self.markers.count(marker) > 1)
            raise RecordingError(f"{self.name}: two markers are called {twice!r}; give one another label")
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise RecordingError(f"{self.name}: its rate is {self.rate:g} frames per second; it must be above 0")
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
        positions: Floats = self.positions[self.place(marker)]
        return positions

    def place(self, marker: str) -> int:
        """The marker's row in `positions`.

        Raises:
            RecordingError: if there is no such marker.
        """
        try:
            return self.markers.index(marker)
        except ValueError:
            known = ", ".join(self.markers) or "none"
            raise RecordingError(f"{self.name}: no marker {marker!r}; there are {known}") from None

    def seen(self) -> Bools:
        """Whether each marker was seen in each frame (markers, frames)."""
        seen: Bools = ~np.isnan(self.positions[:, 0])
        return seen

    def missing(self) -> Floats:
        """Share of the frames in which each marker was not seen (markers,)."""
        share: Floats = 1.0 - self.seen().mean(axis=1)
        return share

    def select(self, markers: Sequence[str] | None = None, frames: slice | Ints | None = None) -> "Recording":
        """The same recording with these markers, in this order, and these frames; all if None.

        Raises:
            RecordingError: if there is no such marker.
        """
        names = self.markers if markers is None else tuple(markers)
        positions = self.positions[[self.place(marker) for marker in names]]
        return replace(self, markers=names, positions=positions if frames is None else positions[:, :, frames])
