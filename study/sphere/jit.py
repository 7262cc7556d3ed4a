"""Compiled code: the compiler's options, a cache on disk that cannot go stale, and sums that stay in registers.

Every compiled function of the package is decorated with :func:`compiled` and so has the same options:

* ``nogil``: threads can run kernels side by side;
* ``error_model="numpy"``: a division may yield inf or nan instead of raising, and so can be vectorised;
* ``fastmath`` without ``nnan`` and ``ninf``: sums may be reordered and contracted, but NaN and inf keep their meaning;
* ``forceinline``: a function that two others call is compiled into each. On its own it would have a version in each,
  and which of them runs would depend on whether they were just compiled or come from the cache: bits would differ.

A loop over samples keeps its sums in the value that :func:`zeros` returns: tuples in few dimensions, whose length the
compiler knows, so that it unrolls the loops over coordinates and vectorises the one over samples; arrays in many.
:func:`put` and :func:`fresh` work on both, so that each sum is written once for every dimension.
"""

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from llvmlite.ir import IRBuilder, Value
from numba import njit, types
from numba.core.typing.templates import Signature
from numba.cpython.unsafe.tuple import tuple_setitem
from numba.extending import intrinsic, overload

from study.sphere.types import Floats

F = TypeVar("F", bound=Callable[..., object])

CHUNK = 256
"""Samples that a kernel handles at a time: d + 2 rows of 256 doubles, and the samples, stay in a first-level cache."""
_UNROLLED = 4
"""Dimensions up to which sums are tuples; beyond, the compiler would take too long."""

SCALAR_CODE = Path(__file__).parent / "__pycache__" / "scalar"
"""Cache of code without vector instructions, which numba would take for the other: `study cost` times it."""

_PACKAGE = Path(__file__).parent.parent


class Sums(Protocol):
    """A few numbers that a kernel adds to: a tuple in few dimensions, an array in many."""

    def __len__(self) -> int: ...

    def __getitem__(self, i: int, /) -> float: ...


def _discard_stale_code() -> None:
    """Remove compiled code that was made from other sources.

    Numba keys a cached function by its own file alone: after a change in a function that it calls, the
    caller would be served from the cache with the old callee inlined. A stamp of all sources prevents it: those of
    every folder of the package that holds compiled code.
    """
    texts = {path: path.read_bytes() for path in sorted(_PACKAGE.rglob("*.py"))}
    room = {path: path.relative_to(_PACKAGE).parts[0] for path in texts}
    rooms = {room[path] for path, text in texts.items() if b"study.sphere.jit" in text}
    digest = hashlib.sha256(b"".join(text for path, text in texts.items() if room[path] in rooms)).hexdigest()[:16]
    stamp = Path(__file__).parent / "__pycache__" / f"compiled-{digest}"
    if stamp.exists():
        return
    try:
        stamp.parent.mkdir(exist_ok=True)
        shutil.rmtree(SCALAR_CODE, ignore_errors=True)
        for pattern in ("*.nbi", "*.nbc", "compiled-*"):
            for stale in (path for name in rooms for path in (_PACKAGE / name).rglob(f"__pycache__/{pattern}")):
                stale.unlink(missing_ok=True)
        stamp.touch()
    except OSError:  # a read-only installation: its sources do not change either
        return


_discard_stale_code()


def compiled(function: F) -> F:
    """Compile a function with the package's options, and cache the code on disk."""
    return _njit(function, {"reassoc", "contract", "arcp", "nsz"})


def compiled_as_written(function: F) -> F:
    """Compile a function without ``fastmath``: its numbers have the same bits wherever it is inlined."""
    return _njit(function, False)


def _njit(function: F, fastmath: set[str] | bool) -> F:
    compiler = njit(cache=True, nogil=True, error_model="numpy", forceinline=True, fastmath=fastmath)
    return cast(F, compiler(function))


def zeros(dimension: int, per: int = 1) -> Sums:
    """Return ``dimension * per`` sums at zero: a tuple, which the compiler can keep in registers, if d is small."""
    count = dimension * per
    return (0.0,) * count if dimension <= _UNROLLED else np.zeros(count)


def put(sums: Sums, i: int, value: float) -> Sums:
    """Return sums with the i-th replaced. Assign the result: arrays are changed in place, tuples are not."""
    return tuple(value if k == i else sums[k] for k in range(len(sums)))


def fresh(sums: Sums) -> Sums:
    """Return the same sums, independent of the given ones."""
    return sums


_replaced = cast(Callable[[Sums, int, float], Sums], tuple_setitem)


# Numba calls an overload with types in place of values, and wants the same annotations in it and in what it returns.
@overload(put, inline="always")
def _put(sums: Any, i: int, value: float) -> Callable[[Any, int, float], Sums]:
    def unrolled(sums: Any, i: int, value: float) -> Sums:
        return _replaced(sums, i, value)

    def stored(sums: Any, i: int, value: float) -> Sums:
        sums[i] = value
        return sums  # type: ignore[no-any-return]

    return unrolled if isinstance(sums, types.BaseTuple) else stored


@overload(fresh, inline="always")
def _fresh(sums: Any) -> Callable[[Any], Sums]:
    def same(sums: Any) -> Sums:
        return sums  # type: ignore[no-any-return]

    def copied(sums: Any) -> Sums:
        return sums.copy()  # type: ignore[no-any-return]

    return same if isinstance(sums, types.BaseTuple) else copied


@intrinsic
def _fma(
    typing: object, factor: types.Type, other: types.Type, term: types.Type
) -> tuple[Signature, Callable[..., Value]]:
    def generate(context: object, builder: IRBuilder, signature: object, arguments: tuple[Value, ...]) -> Value:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


fma = cast(Callable[[float, float, float], float], _fma)
"""``factor * other + term``, rounded once: the same bits wherever it is inlined."""


@compiled
def total(row: Floats) -> float:
    """Sum of a row."""
    result = 0.0
    for k in range(row.size):
        result += row[k]
    return result


@compiled
def dot(left: Floats, right: Floats) -> float:
    """Scalar product of two rows of equal length."""
    result = 0.0
    for k in range(left.size):
        result += left[k] * right[k]
    return result


@compiled
def fill(row: Floats, value: float) -> None:
    """Set a row to a value (a slice assignment costs ten times as much in compiled code)."""
    for k in range(row.size):
        row[k] = value
