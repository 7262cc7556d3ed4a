"""Compiled code: one set of compiler options, a cache that cannot go stale, and sums that stay in registers.

Every compiled function of the package is decorated with :func:`compiled`, so they all share these options:

* ``nogil``: threads can run kernels side by side;
* ``error_model="numpy"``: a division may yield inf or nan instead of raising (and so can be vectorised);
* ``fastmath`` without ``nnan``/``ninf``: sums may be reordered and contracted, but the logic of NaN stays intact;
* ``forceinline``: a function that two others call is compiled into each. Left to stand alone it has a version in each,
  and which of them runs depends on whether they were just compiled or come from the cache: bits differed.

A loop over samples keeps its sums in what :func:`zeros` gives: tuples in few dimensions, whose length the compiler
knows, so that it unrolls the loops over coordinates and vectorises the one over samples; arrays in many. :func:`put`
and :func:`fresh` serve both, so each sum is written once for every dimension.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit, types
from numba.cpython.unsafe.tuple import tuple_setitem
from numba.extending import intrinsic, overload

_set: Any = tuple_setitem
_OPTIONS: Any = {"cache": True, "nogil": True, "error_model": "numpy", "forceinline": True}
F = TypeVar("F", bound=Callable[..., Any])

CHUNK = 256
"""Samples handled at a time: d + 2 rows of 256 doubles, and the samples themselves, stay in a first-level cache."""
_UNROLLED = 4
"""Dimensions up to which sums are tuples; beyond, the compiler would take too long."""

_PACKAGE = Path(__file__).parent.parent


def _discard_stale_code() -> None:
    """Remove compiled code that was made from other sources.

    Numba keys a cached function by its own file alone: after a change in a function that it calls, the
    caller would be served from the cache with the old callee inlined. A stamp of all sources prevents it.
    """
    rooms = [_PACKAGE / name for name in ("sphere", "estimators", "experiment", "mocap")]
    sources = sorted(path for room in rooms for path in room.glob("*.py"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    stamp = Path(__file__).parent / "__pycache__" / f"compiled-{digest}"
    if stamp.exists():
        return
    try:
        stamp.parent.mkdir(exist_ok=True)
        for pattern in ("*.nbi", "*.nbc", "compiled-*"):
            for stale in (path for room in rooms for path in room.glob(f"__pycache__/{pattern}")):
                stale.unlink(missing_ok=True)
        stamp.touch()
    except OSError:  # a read-only installation: its sources do not change either
        return


_discard_stale_code()


def compiled(function: F) -> F:
    """Compile a function with the package's options; the result is cached on disk."""
    return cast(F, njit(fastmath={"reassoc", "contract", "arcp", "nsz"}, **_OPTIONS)(function))


def compiled_as_written(function: F) -> F:
    """The same without ``fastmath``: for numbers that are to have the same bits wherever the function is inlined."""
    return cast(F, njit(fastmath=False, **_OPTIONS)(function))


def zeros(dimension: int, per: int = 1) -> Any:
    """Sums at zero: d for each of ``per``; a tuple that the compiler can keep in registers, if d is small."""
    count = dimension * per
    return (0.0,) * count if dimension <= _UNROLLED else np.zeros(count)


def put(sums: Any, i: int, value: Any) -> Any:
    """Sums with the i-th replaced: assign the result, for arrays are changed in place and tuples are not."""
    return (*sums[:i], value, *sums[i + 1 :])


def fresh(sums: Any) -> Any:
    """The same sums, independent of the given ones from here on."""
    return sums


@overload(put, inline="always")
def _put(sums: Any, i: Any, value: Any) -> Any:
    def unrolled(sums: Any, i: Any, value: Any) -> Any:
        return _set(sums, i, value)

    def stored(sums: Any, i: Any, value: Any) -> Any:
        sums[i] = value
        return sums

    return unrolled if isinstance(sums, types.BaseTuple) else stored


@overload(fresh, inline="always")
def _fresh(sums: Any) -> Any:
    def same(sums: Any) -> Any:
        return sums

    def copied(sums: Any) -> Any:
        return sums.copy()

    return same if isinstance(sums, types.BaseTuple) else copied


@intrinsic
def fma(typing: Any, factor: Any, other: Any, term: Any) -> Any:
    """``factor * other + term``, rounded once: the same bits wherever it is compiled into."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


@compiled
def total(row: Any) -> float:
    """Sum of a row."""
    result = 0.0
    for k in range(row.size):
        result += row[k]
    return result


@compiled
def dot(left: Any, right: Any) -> float:
    """Scalar product of two rows of equal length."""
    result = 0.0
    for k in range(left.size):
        result += left[k] * right[k]
    return result


@compiled
def fill(row: Any, value: float) -> None:
    """Set a row to a value (a slice assignment costs ten times as much in compiled code)."""
    for k in range(row.size):
        row[k] = value
