"""Compiled code: one set of compiler options, a cache that cannot go stale, and loops over rows.

Every compiled function of the package is decorated with :func:`compiled`, so they all share these options:

* ``nogil``: threads can run kernels side by side;
* ``error_model="numpy"``: a division may yield inf or nan instead of raising (and so can be vectorised);
* ``fastmath`` without ``nnan``/``ninf``: sums may be reordered and contracted, but the logic of NaN stays intact.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

CHUNK = 512
"""Samples handled at a time: d + 3 rows of 512 doubles stay in a 32 KiB first-level cache up to d = 5."""

_PACKAGE = Path(__file__).parent.parent


def _discard_stale_code() -> None:
    """Remove compiled code that was made from other sources.

    Numba keys a cached function by its own file alone: after a change in a function that it calls, the
    caller would be served from the cache with the old callee inlined. A stamp of all sources prevents it.
    """
    rooms = [_PACKAGE / name for name in ("sphere", "estimators", "experiment")]
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
    options = {"reassoc", "contract", "arcp", "nsz"}
    return cast(F, njit(cache=True, nogil=True, error_model="numpy", fastmath=options)(function))


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
