"""Between the frames that show a segment: its interpolated rotation, gaps of joints, and leaps of what is drawn."""

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from study.arrays import Bools, Floats, Ints
from study.recordings.joints.poses import times
from study.recordings.rigid import relative_rotation

_FEWEST, _ENOUGH = 20, 300
"""Fewest and most gaps of one length from which an interpolation's error is known."""


class InterpolatedRotation:
    """A segment's rotation between the frames that show it, in its parent or in the world, and its error.

    Args:
        rotation: of the segment (3, 3, frames).
        parent: of its parent; None for the world.
        known: frames in which both are seen (frames,).
        rest: mean rotation in the parent (3, 3), for a segment that is never seen together with it.
    """

    def __init__(self, rotation: Floats, parent: Floats | None, known: Bools, rest: Floats | None = None) -> None:
        self.known, self.fitted, self.parent, self.rest = known, np.flatnonzero(known), parent, rest
        part = rotation.take(self.fitted, axis=2)  # an index would put frames first in memory, where sums take longer
        inside = part if parent is None else relative_rotation(parent.take(self.fitted, axis=2), part)
        self.inside = np.ascontiguousarray(np.moveaxis(inside, 2, 0))  # (fitted, 3, 3)

    def ends(self, wanted: Ints) -> tuple[Ints, Ints]:
        """Places in ``fitted`` of the frames before and after those wanted (w,), the nearest one where one is missing.

        None may be fitted.
        """
        place = np.searchsorted(self.fitted, wanted)
        return np.maximum(place - 1, 0), np.minimum(place, len(self.fitted) - 1)

    def distance(self, wanted: Ints) -> Ints:
        """Number of frames to the nearest one that is seen (w,)."""
        if not len(self.fitted):
            return np.full(len(wanted), np.iinfo(np.int64).max)
        before, after = (self.fitted[end] for end in self.ends(wanted))
        return np.asarray(np.minimum(np.abs(wanted - before), np.abs(after - wanted)))

    def at(self, wanted: Ints) -> Floats:
        """Rotations in the world (3, 3, w); the nearest one before the first and after the last fit, NaN if unknown."""
        if not len(self.fitted):
            if self.parent is None or self.rest is None:
                return np.full((3, 3, len(wanted)), np.nan)
            return np.asarray(np.einsum("ijw,jk->ikw", self.parent[:, :, wanted], self.rest))
        before, after = self.ends(wanted)
        span = np.maximum(self.fitted[after] - self.fitted[before], 1)
        share = np.clip((wanted - self.fitted[before]) / span, 0.0, 1.0)
        between = _between(self.inside[before], self.inside[after], share)
        world = between if self.parent is None else np.moveaxis(self.parent[:, :, wanted], 2, 0) @ between
        return np.ascontiguousarray(np.moveaxis(world, 0, 2))

    def covariance(self, wanted: Ints) -> Floats:
        """Covariance of the rotation's error in the world (w, 3, 3), rad²; NaN if it is not known.

        Between two ends it is that of the middle of a gap as long, less towards the ends as for a random walk.
        """
        if not len(self.fitted):
            return np.full((len(wanted), 3, 3), np.nan)
        before, after = (self.fitted[end] for end in self.ends(wanted))
        inner = (wanted > before) & (wanted < after)
        half = 0.5 * np.maximum(after - before, 1)
        near = self.distance(wanted)
        result = np.empty((len(wanted), 3, 3))
        for kind, distances in ((True, half), (False, near.astype(float))):
            result[inner == kind] = self._table(kind, distances[inner == kind])
        result *= np.where(inner, near * (2.0 * half - near) / half**2, 1.0)[:, None, None]
        if self.parent is None:
            return result
        frame = np.moveaxis(self.parent[:, :, wanted], 2, 0)
        return frame @ result @ frame.swapaxes(1, 2)

    def _table(self, inner: bool, distances: Floats) -> Floats:
        """Covariance (w, 3, 3) of errors over these numbers of frames, between two ends or beyond one."""
        steps, squares = [0.0], [np.zeros((3, 3))]
        for lag in (4**k for k in range(int(np.log2(max(len(self.fitted), 2))) // 2 + 1)):
            if steps[-1] >= distances.max(initial=0.0):
                break
            length = 2 * lag if inner else lag
            starts = max(len(self.known) - length, 0)
            seen = self.known[:starts] & self.known[lag : lag + starts] & self.known[length : length + starts]
            first = np.flatnonzero(seen)
            if len(first) < _FEWEST:
                break
            first = first[:: max(len(first) // _ENOUGH, 1)]
            guess, between, last = (self.inside[self.fitted.searchsorted(first + k)] for k in (0, lag, length))
            if inner:
                guess = _between(guess, last, np.full(len(first), 0.5))
            off = Rotation.from_matrix(between @ guess.swapaxes(1, 2), assume_valid=True).as_rotvec()
            steps.append(float(lag))
            squares.append(off.T @ off / len(off))
        if len(steps) < 2:
            return np.full((len(distances), 3, 3), np.nan)
        entries = [np.interp(distances, steps, entry) for entry in np.array(squares).reshape(-1, 9).T]
        beyond = np.maximum(distances / steps[-1], 1.0) ** 2  # as if it went on in one direction
        return np.asarray(np.stack(entries, axis=1).reshape(-1, 3, 3) * beyond[:, None, None])


def _between(first: Floats, last: Floats, share: Floats) -> Floats:
    """Rotations (n, 3, 3) at shares (n,) of the way from the first ones to the last ones."""
    step = Rotation.from_matrix(first.swapaxes(1, 2) @ last, assume_valid=True).as_rotvec()
    return np.asarray(first @ Rotation.from_rotvec(share[:, None] * step).as_matrix())


class Gap:
    """The vector from a joint as its parent shows it to where its child shows it, over time.

    Args:
        vectors: in the world (3, n), metres, in the frames that show both.
        frames: these (n,).
        rotations: of the parent and of the child in these frames, (3, 3, n) each.

    Attributes:
        size: its root mean square length, metres; NaN if no frame shows both.
        variance: of a coordinate about the mean, m².
    """

    def __init__(self, vectors: Floats, frames: Ints, rotations: Sequence[Floats]) -> None:
        self.frames = frames
        self._inside = [np.einsum("jit,jt->it", rotation, vectors) for rotation in rotations]
        self.size, self.variance = float("nan"), 0.0
        if len(frames):
            self.size = float(np.sqrt((vectors**2).sum(axis=0).mean()))
            self.variance = float(self._inside[0].var(axis=1).mean())

    def at(self, frames: Ints, side: int, rotations: Floats) -> Floats:
        """The vector in the world (3, w), metres: linear between frames that show it, from there on constant.

        Args:
            frames: wanted (w,).
            side: 0 to hold it fixed in the parent, 1 in the child.
            rotations: of that segment in these frames (3, 3, w).
        """
        if not len(self.frames):
            return np.zeros((3, len(frames)))
        inside = np.array([np.interp(frames, self.frames, row) for row in self._inside[side]])
        return times(rotations, inside)


def remove_leaps(center: Floats, variance: Floats, source: Ints) -> None:
    """Spread the leaps of a joint (3, n), in place, over the frames around them in which it is uncertain.

    Where other segments begin to show it, its place leaps by the error of what showed it before. Each side of a leap
    takes a part of it in proportion to its variance, linearly less to the other end of its stretch.

    Args:
        center: its places, metres; NaN where unknown.
        variance: of these in each frame (n,), m²; 0 where it is seen.
        source: number that tells which segments show it (n,).
    """
    known = ~np.isnan(center[0])
    starts = np.flatnonzero(np.diff(source) | (np.diff(known.astype(np.int8)) != 0)) + 1
    edges = np.concatenate([[0], starts, [len(known)]])
    shifts = np.zeros((len(edges) - 1, 2, 3))  # of the first and the last frame of each stretch
    for k, t in enumerate(starts, start=1):
        total = variance[t - 1] + variance[t]
        if known[t - 1] and known[t] and total > 0.0:
            steps = [center[:, j + 1] - center[:, j] for j in (t - 2, t) if 0 <= j < len(known) - 1]
            usual = [step for step in steps if not np.isnan(step).any()]
            leap = center[:, t] - center[:, t - 1] - (np.mean(usual, axis=0) if usual else 0.0)
            shifts[k - 1, 1] += leap * variance[t - 1] / total
            shifts[k, 0] -= leap * variance[t] / total
    for (first, last), (start, end) in zip(itertools.pairwise(edges), shifts, strict=True):
        if start.any() or end.any():
            share = np.linspace(0.0, 1.0, last - first) if last - first > 1 else np.array([0.5])
            center[:, first:last] += np.outer(start, 1.0 - share) + np.outer(end, share)
