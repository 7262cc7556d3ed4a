"""Copies among the points of a set: rows that repeat an earlier one exactly."""

import numpy as np

from study.sphere.types import Bools, Floats, Words

_FACTOR = np.uint64(0x9E3779B97F4A7C15)


def repeated(x: Floats) -> Bools:
    """True for each point of the sets (b, d, n) that repeats an earlier one: (b, n). Missing samples repeat none.

    Points of a continuous law never do: copies mean that a file holds the same measurement several times, or rounds,
    and then the standard errors, which take the points to be independent, may be too small.
    """
    b, _, n = x.shape
    found = np.zeros((b, n), dtype=np.bool_)
    words = _words(x)
    ordered = np.sort(words, axis=1)
    for t in np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1)):
        present = np.flatnonzero(~np.isnan(x[t]).any(axis=0))
        _, first = np.unique(x[t][:, present], axis=1, return_index=True)
        again = np.ones(len(present), dtype=np.bool_)
        again[first] = False
        found[t, present[again]] = True
    return found


def _words(x: Floats) -> Words:
    """A number for each point (b, n), equal for equal points and almost surely for no others."""
    words = np.zeros((x.shape[0], x.shape[2]), dtype=np.uint64)
    for i in range(x.shape[1]):
        words ^= np.ascontiguousarray(x[:, i] + 0.0).view(np.uint64)  # + 0.0: -0.0 equals 0.0
        words *= _FACTOR
        words ^= words >> np.uint64(29)
    return words
