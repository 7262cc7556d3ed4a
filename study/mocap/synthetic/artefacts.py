"""What real recordings suffer from, put on perfect ones: noise, skin that slides, gaps, markers that are swapped."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from study.experiment.streams import stream
from study.sphere.types import Bools, Floats, Ints

_GAP = 0.2  # seconds that a marker is out of sight, on average
_SWAP = 0.15  # seconds that two markers are taken for one another, on average


@dataclass(frozen=True)
class Swap:
    """Two markers that are exchanged for a while."""

    first: int
    """First frame."""
    end: int
    """First frame after it."""
    markers: tuple[str, str]


def noise(shape: tuple[int, ...], sigma: float, seed: int) -> Floats:
    """Isotropic normal noise, standard deviation `sigma` metres per coordinate."""
    return sigma * stream(seed, "synthetic", "noise").standard_normal(shape)


def soft_tissue(phases: Floats, rate: float, amplitude: float, seed: int) -> Floats:
    """Sliding of the skin under each marker (markers, 3, frames), metres, in its segment's frame; at most `amplitude`.

    Half of it follows the angle of the segment's joint, as skin does over a moving joint; half swings in time, as
    muscle and fat do. The directions of both are random, fixed for a marker.

    Args:
        phases: of the joint of each marker's segment, -1 to 1 (markers, frames).
        rate: frames per second.
        amplitude: metres.
        seed: of directions and frequencies.
    """
    rng = stream(seed, "synthetic", "soft tissue")
    directions = rng.standard_normal((2, len(phases), 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    frequency, start = rng.uniform(0.5, 2.0, len(phases)), rng.uniform(0, 2 * np.pi, len(phases))
    time = np.arange(phases.shape[1]) / rate
    swing = np.sin(2 * np.pi * frequency[:, None] * time + start[:, None])
    courses = np.stack([phases, swing])
    slid: Floats = 0.5 * amplitude * np.einsum("kmi,kmt->mit", directions, courses)
    return slid


def hidden(markers: int, frames: int, rate: float, share: float, seed: int) -> Bools:
    """Which samples are missing (markers, frames), in runs; for each marker the share of frames, to a whole number."""
    rng = stream(seed, "synthetic", "gaps")
    mask = np.zeros((markers, frames), dtype=bool)
    for row in mask:
        for first, end in _runs(rng, frames, round(share * frames), _GAP * rate):
            row[first:end] = True
    return mask


def swaps(pairs: Sequence[tuple[str, str]], frames: int, rate: float, share: float, seed: int) -> list[Swap]:
    """When which markers are taken for one another: in this share of the frames one pair is."""
    rng = stream(seed, "synthetic", "swaps")
    runs = _runs(rng, frames, round(share * frames), _SWAP * rate)
    return [Swap(first, end, pairs[int(rng.integers(len(pairs)))]) for first, end in runs]


def _runs(rng: np.random.Generator, frames: int, count: int, mean: float) -> list[tuple[int, int]]:
    """Runs of frames, `count` in all, of random lengths about `mean`, at random distances of at least one frame."""
    free = frames - count
    number = min(max(round(count / max(mean, 1.0)), 1), count, free + 1)
    if number == 0:
        return []
    inside = _lengths(rng, count, number)
    # the outer two stretches between runs may be empty, the inner ones not
    outside = _lengths(rng, free + 2, number + 1)
    firsts = np.cumsum(outside[:-1]) - 1 + np.concatenate([[0], np.cumsum(inside[:-1])])
    return [(int(first), int(first + length)) for first, length in zip(firsts, inside, strict=True)]


def _lengths(rng: np.random.Generator, total: int, parts: int) -> Ints:
    """A whole number cut into parts of at least one, every way equally likely."""
    cuts = np.sort(rng.choice(total - 1, parts - 1, replace=False)) + 1
    return np.diff(np.concatenate([[0], cuts, [total]]))
