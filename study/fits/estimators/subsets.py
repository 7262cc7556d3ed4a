"""Subsets of points that a search begins with, chosen by a hash: the same ones in each call, and for each set."""

import math
from functools import lru_cache
from itertools import combinations

import numpy as np

from study.arrays import Floats, Ints

_FEWEST, _MOST = 200, 3000
"""Number of elemental subsets: as many as contain a clean one almost surely, between these."""
_CONTAMINATED, _MISSED = 0.4, 1e-4
"""With this share of outliers, no subset is clean with this probability, as far as the most suffice."""
SUBSAMPLE = 500
"""Points of a set that the search begins with: Rousseeuw & Van Driessen's choice is 1500 in five parts of 300."""


def uniform(count: int, name: int) -> Floats:
    """Numbers (count,) spread evenly over [0, 1), a hash of their place and of a number that names the sequence.

    The hash is the finaliser of SplitMix64 (Steele, Lea & Flood 2014).
    """
    mixed = np.arange(count, dtype=np.uint64) + np.uint64((name << 40) + 0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed ^= mixed >> np.uint64(31)
    return np.asarray((mixed >> np.uint64(11)).astype(float) * 2.0**-53)


@lru_cache(maxsize=64)
def elemental(n: int, size: int) -> Ints:
    """Subsets (subsets, size) of n points, as indices: all of them if they are few, else hashed ones."""
    wanted = math.log(_MISSED) / math.log1p(-((1.0 - _CONTAMINATED) ** size))
    count = min(max(math.ceil(wanted), _FEWEST), _MOST)
    if math.comb(n, size) <= count:
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
