"""Comparison of tables to the last bit, and the choice of the things that are computed again."""

import hashlib
import math
from collections.abc import Sequence
from heapq import nsmallest
from typing import TypeVar

import numpy as np
import pyarrow as pa

T = TypeVar("T")
_SHOWN = 40


def chosen(seed: str, things: Sequence[T], share: float) -> list[T]:
    """Choose a share of some things, at least one, in their order.

    The choice looks random, and follows from the seed alone: things are ranked by a digest of the seed and their place.

    Args:
        seed: any text.
        things: the things.
        share: in [0, 1]; 0 chooses none.
    """
    count = min(len(things), math.ceil(share * len(things)))
    rank = {i: hashlib.blake2b(f"{seed} {i}".encode(), digest_size=16).digest() for i in range(len(things))}
    return [things[i] for i in sorted(nsmallest(count, rank, key=rank.__getitem__))]


def difference(stored: pa.Table, computed: pa.Table) -> str | None:
    """The first difference between stored and computed rows, in words; None if they are equal to the bit.

    All values that are not a number count as equal. Columns that an older table lacks are not compared.
    """
    if stored.num_rows != computed.num_rows:
        return f"{stored.num_rows:,} rows are stored, and {computed.num_rows:,} computed"
    for name in (name for name in computed.schema.names if name in stored.schema.names):
        ours, theirs = _bits(stored[name]), _bits(computed[name])
        unequal = np.flatnonzero(ours != theirs)
        if len(unequal):
            at = int(unequal[0])
            where = " ".join(str(stored[key][at]) for key in _IDENTITY if key in stored.schema.names)
            values = [repr(table[name][at].as_py())[:_SHOWN] for table in (stored, computed)]
            return f"{where}: {name} is {values[0]}, and {values[1]} when computed again"
    return None


_IDENTITY = ("group", "cell", "trial", "estimator", "likelihood", "noise_is")
"""Columns that tell a reader which row it is."""


def _bits(column: pa.ChunkedArray) -> np.ndarray:
    """Values of a column that are equal where their bits are."""
    if pa.types.is_dictionary(column.type):
        column = column.cast(pa.string())
    values: np.ndarray = column.to_numpy()
    if not np.issubdtype(values.dtype, np.floating):
        return values
    whole = np.ascontiguousarray(values, dtype=np.float64)
    return np.where(np.isnan(whole), np.nan, whole).view(np.int64)
