"""Subsets of a point set by a hash of counters: the same ones in each call, and for each set of a batch."""

from functools import lru_cache
from itertools import combinations
from math import ceil, comb, log, log1p

import numpy as np

from study.sphere.types import Floats, Ints, Words

_FEWEST, _MOST = 200, 3000
"""Number of elemental subsets: as many as contain a clean one almost surely, between these."""
_CONTAMINATED, _MISSED = 0.4, 1e-4
"""With this share of outliers, no subset is clean with this probability, as far as the most suffice."""
SUBSAMPLE = 500
"""Points of a set that the search begins with: Rousseeuw & Van Driessen's choice is 1500 in five parts of 300."""


def _hash(words: Words) -> Words:
    """Mix 64-bit words (the finaliser of SplitMix64, Steele, Lea & Flood 2014)."""
    mixed = words + np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(mixed ^ (mixed >> np.uint64(31)))


def uniform(count: int, name: int) -> Floats:
    """Numbers (count,) spread evenly over [0, 1), a hash of their place and of a number that names the sequence."""
    words = np.arange(count, dtype=np.uint64) + np.uint64(name << 40)
    return np.asarray((_hash(words) >> np.uint64(11)).astype(float) * 2.0**-53)


@lru_cache(maxsize=64)
def elemental(n: int, size: int) -> Ints:
    """Subsets (subsets, size) of n points, as indices: all of them if they are few, else hashed ones."""
    wanted = log(_MISSED) / log1p(-((1.0 - _CONTAMINATED) ** size))
    count = min(max(ceil(wanted), _FEWEST), _MOST)
    if comb(n, size) <= count:
        return np.array(list(combinations(range(n), size)), dtype=np.int64)
    chosen = np.empty((count, size), dtype=np.int64)
    for k in range(size):  # the draw-th of those that the subset does not hold yet
        draw = (uniform(count, k + 1) * (n - k)).astype(np.int64)
        held = np.sort(chosen[:, :k], axis=1)
        for i in range(k):
            draw += draw >= held[:, i]
        chosen[:, k] = draw
    return chosen


@lru_cache(maxsize=16)
def spread_out(n: int) -> Ints:
    """Places of the subsample among n points: one from each of as many equal parts."""
    if n <= SUBSAMPLE:
        return np.arange(n)
    edges = np.arange(SUBSAMPLE + 1) * n // SUBSAMPLE
    return np.asarray(edges[:-1] + (uniform(SUBSAMPLE, 0) * np.diff(edges)).astype(np.int64))
