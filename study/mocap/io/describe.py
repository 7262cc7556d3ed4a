"""Describe a recording in lines of text: markers, frames, rate, gaps, and the extent of each marker's motion."""

from dataclasses import dataclass

import numpy as np

from study.mocap.io.recording import Recording
from study.sphere.types import Bools, Floats
from study.text.columns import columns

STILL = 0.001
"""A marker whose bounding box has a smaller diagonal does not move; metres."""


@dataclass(frozen=True)
class Gaps:
    """Missing samples of a marker."""

    missing: int
    """Frames without a sample."""
    gaps: int
    """Runs of such frames."""
    longest: int
    """Frames in the longest run."""


def gaps(seen: Bools) -> Gaps:
    """Count the runs of frames in which a marker is missing.

    Args:
        seen: True where it has a sample (frames,).
    """
    edges = np.diff(np.concatenate([[True], seen, [True]]).astype(np.int8))
    starts, ends = np.flatnonzero(edges == -1), np.flatnonzero(edges == 1)
    return Gaps(int((~seen).sum()), len(starts), int((ends - starts).max(initial=0)))


def extents(recording: Recording) -> Floats:
    """Diagonal of the bounding box of each marker's path (markers,), metres; NaN for a marker without samples."""
    positions = recording.positions
    low = np.fmin.reduce(positions, axis=2)  # unlike nanmin, it does not warn about a marker without samples
    high = np.fmax.reduce(positions, axis=2)
    diagonal: Floats = np.linalg.norm(high - low, axis=1)
    return diagonal


def describe(recording: Recording) -> list[str]:
    """Describe a recording.

    Returns:
        Lines: a headline, notes about the reading, problems, then one line per marker with its gaps.
    """
    seen, moved = recording.seen(), extents(recording)
    count, frames = seen.shape
    lines = [
        f"{recording.name}: {count} markers, {frames:,} frames at {recording.rate:g} Hz, {recording.duration:.2f} s, "
        f"{1 - seen.mean():.1%} of the samples missing"
    ]
    lines += [f"note: {note}" for note in recording.notes]
    never = [recording.markers[row] for row in np.flatnonzero(~seen.any(axis=1))]
    if never:
        lines.append(f"without any sample: {', '.join(never)}")
    still = [marker for marker, far in zip(recording.markers, moved, strict=True) if far < STILL]
    if len(still) == count - len(never):
        lines.append(f"no marker moves by more than {1000 * np.nanmax(moved):.2g} mm; joints cannot be found")
    elif still:
        lines.append(f"move by less than {1000 * STILL:g} mm: {', '.join(still)}")
    rows = []
    for marker, row, far in zip(recording.markers, seen, moved, strict=True):
        found = gaps(row)
        longest = f"{found.longest / recording.rate:.2f} s" if found.longest else "-"
        extent = f"{far:.2f} m" if np.isfinite(far) else "-"
        rows.append([marker, f"{found.missing / frames:.1%}", str(found.gaps), longest, extent])
    return [*lines, *columns(rows, ["marker", "missing", "gaps", "longest", "extent"], "<>")]
