"""What is in a recording, in lines for people: markers, frames, rate, gaps, how far things move."""

from dataclasses import dataclass

import numpy as np

from study.mocap.io.recording import Recording
from study.sphere.types import Bools, Floats

STILL = 0.001
"""Metres: a marker that stays within a box of this diagonal does not move."""


@dataclass(frozen=True)
class Gaps:
    """Where a marker was not seen."""

    missing: int
    """Frames in which it was not seen."""
    gaps: int
    """Runs of such frames."""
    longest: int
    """Frames in the longest run."""


def gaps(seen: Bools) -> Gaps:
    """Count the runs of frames in which a marker was not seen.

    Args:
        seen: (frames,).
    """
    edges = np.diff(np.concatenate([[True], seen, [True]]).astype(np.int8))
    starts, ends = np.flatnonzero(edges == -1), np.flatnonzero(edges == 1)
    return Gaps(int((~seen).sum()), len(starts), int((ends - starts).max(initial=0)))


def reach(recording: Recording) -> Floats:
    """How far each marker moved: the diagonal of the box about its path (markers,), metres; NaN if never seen."""
    positions = recording.positions
    low = np.fmin.reduce(positions, axis=2)  # unlike nanmin silent about a marker that was never seen
    high = np.fmax.reduce(positions, axis=2)
    diagonal: Floats = np.linalg.norm(high - low, axis=1)
    return diagonal


def describe(recording: Recording) -> list[str]:
    """Say what is in a recording.

    Returns:
        Lines: a headline, notes of how it was read, what is wrong with it, then one line per marker with its gaps.
    """
    seen, moved = recording.seen(), reach(recording)
    count, frames = seen.shape
    lines = [
        f"{recording.name}: {count} markers, {frames:,} frames at {recording.rate:g} Hz, {recording.duration:.2f} s, "
        f"{1 - seen.mean():.1%} of the samples missing"
    ]
    lines += [f"note: {note}" for note in recording.notes]
    never = [recording.markers[row] for row in np.flatnonzero(~seen.any(axis=1))]
    if never:
        lines.append(f"never seen: {', '.join(never)}")
    still = [marker for marker, far in zip(recording.markers, moved, strict=True) if far < STILL]
    if len(still) == count - len(never):
        lines.append(f"nothing moves: no marker by more than {1000 * np.nanmax(moved):.2g} mm; joints cannot be found")
    elif still:
        lines.append(f"still, within {1000 * STILL:g} mm: {', '.join(still)}")
    width = max(map(len, recording.markers))
    lines.append(f"{'marker':{width}}  missing   gaps  longest  moves")
    for marker, row, far in zip(recording.markers, seen, moved, strict=True):
        found = gaps(row)
        longest = f"{found.longest / recording.rate:.2f} s" if found.longest else "-"
        moves = f"{far:.2f} m" if np.isfinite(far) else "-"
        lines.append(f"{marker:{width}}  {found.missing / frames:6.1%}  {found.gaps:5}  {longest:>7}  {moves:>6}")
    return lines
