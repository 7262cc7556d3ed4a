"""Artefacts of real recordings, drawn for synthetic ones: noise, soft tissue, gaps and swapped markers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from study.experiment.streams import stream
from study.sphere.types import Bools, Floats, Ints

_GAP = 0.2  # mean duration of a gap, seconds
_SWAP = 0.15  # mean duration of a swap, seconds


@dataclass(frozen=True)
class Swap:
    """Two markers whose labels are exchanged for some frames."""

    first: int
    """First frame of the swap."""
    end: int
    """First frame after the swap."""
    markers: tuple[str, str]


def marker_noise(shape: tuple[int, ...], sigma: float, seed: int) -> Floats:
    """Draw isotropic normal noise with the standard deviation ``sigma`` of each coordinate, metres."""
    return sigma * stream(seed, "synthetic", "noise").standard_normal(shape)


def soft_tissue(phases: Floats, rate: float, amplitude: float, seed: int) -> Floats:
    """Draw the soft-tissue artefact of each marker: its displacement on its segment.

    Half of it follows the angle of the segment's joint, as skin does over a moving joint; half oscillates in time, as
    muscle and fat do. The directions of both are random and fixed for a marker.

    Args:
        phases: angle of the joint of each marker's segment, -1 to 1 over its range (markers, frames).
        rate: frames per second.
        amplitude: largest displacement, metres.
        seed: of directions and frequencies.

    Returns:
        Displacements in the segments' axes (markers, 3, frames), metres.
    """
    rng = stream(seed, "synthetic", "soft tissue")
    directions = rng.standard_normal((2, len(phases), 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    frequency, start = rng.uniform(0.5, 2.0, len(phases)), rng.uniform(0, 2 * np.pi, len(phases))
    time = np.arange(phases.shape[1]) / rate
    oscillation = np.sin(2 * np.pi * frequency[:, None] * time + start[:, None])
    courses = np.stack([phases, oscillation])
    displacement: Floats = 0.5 * amplitude * np.einsum("kmi,kmt->mit", directions, courses)
    return displacement


def gaps(markers: int, frames: int, rate: float, share: float, seed: int) -> Bools:
    """Draw the missing samples (markers, frames), in runs; each marker lacks the given share of frames, rounded."""
    rng = stream(seed, "synthetic", "gaps")
    mask = np.zeros((markers, frames), dtype=bool)
    for row in mask:
        for first, end in _runs(rng, frames, round(share * frames), _GAP * rate):
            row[first:end] = True
    return mask


def swaps(pairs: Sequence[tuple[str, str]], frames: int, rate: float, share: float, seed: int) -> list[Swap]:
    """Draw swaps: in the given share of the frames one of the pairs is exchanged."""
    rng = stream(seed, "synthetic", "swaps")
    runs = _runs(rng, frames, round(share * frames), _SWAP * rate)
    return [Swap(first, end, pairs[int(rng.integers(len(pairs)))]) for first, end in runs]


def _runs(rng: np.random.Generator, frames: int, count: int, mean: float) -> list[tuple[int, int]]:
    """Draw runs of frames: ``count`` frames in all, of the mean length ``mean``, at least one frame apart."""
    free = frames - count
    number = min(max(round(count / max(mean, 1.0)), 1), count, free + 1)
    if number == 0:
        return []
    inside = _lengths(rng, count, number)
    # the stretches before the first and after the last run may be empty, those between runs may not
    outside = _lengths(rng, free + 2, number + 1)
    firsts = np.cumsum(outside[:-1]) - 1 + np.concatenate([[0], np.cumsum(inside[:-1])])
    return [(int(first), int(first + length)) for first, length in zip(firsts, inside, strict=True)]


def _lengths(rng: np.random.Generator, total: int, parts: int) -> Ints:
    """Cut a whole number into parts of at least one, each way with the same probability."""
    cuts = np.sort(rng.choice(total - 1, parts - 1, replace=False)) + 1
    return np.diff(np.concatenate([[0], cuts, [total]]))
