"""Compiled code: the compiler's options, a cache on disk that cannot go stale, and sums that stay in registers.

Every compiled function of the package is decorated with :func:`compiled` and so has the same options:

* ``nogil``: threads can run kernels side by side;
* ``error_model="numpy"``: a division may yield inf or nan instead of raising, and so can be vectorised;
* ``fastmath`` without ``nnan`` and ``ninf``: sums may be reordered and contracted, but NaN and inf keep their meaning;
* ``forceinline``: a function that two others call is compiled into each. On its own it would have a version in each,
  and which of them runs would depend on whether they were just compiled or come from the cache: bits would differ.

The compiler is loaded when a compiled function is first called: a program that calls none starts in half the time.
The first function of a process that is compiled, and not read from the cache, is a warning in the log ``study``, which
Python prints on standard error unless a program sets up its logs; each function is a message for debugging.

A loop over samples keeps its sums in the value that :func:`zeros` returns: tuples in few dimensions, whose length the
compiler knows, so that it unrolls the loops over coordinates and vectorises the one over samples; arrays in many.
:func:`put` and :func:`fresh` work on both, so that each sum is written once for every dimension.
"""

import functools
import hashlib
import logging
import re
import shutil
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, cast

import numpy as np

from study.sphere.types import Floats
from study.text import instruction_set

F = TypeVar("F", bound=Callable[..., object])
Inline = Literal["never", "always"]

CHUNK = 256
"""Samples that a kernel handles at a time: d + 2 rows of 256 doubles, and the samples, stay in a first-level cache."""
_LINE = 8
"""Doubles in a cache line."""
_UNROLLED = 4
"""Dimensions up to which sums are tuples; beyond, the compiler would take too long."""

SCALAR_CODE = Path(__file__).parent / "__pycache__" / "scalar"
"""Cache of code without vector instructions, which numba would take for the other: `study cost` times it."""

COMPILING = "study: compiling loops, once after an installation; it takes seconds, at most a minute"
"""Warning of a process that compiles a function, and does not read it from the cache."""

_PACKAGE = Path(__file__).parent.parent
_LOG = logging.getLogger(__name__)


class Sums(Protocol):
    """A few numbers that a kernel adds to: a tuple in few dimensions, an array in many."""

    def __len__(self) -> int: ...

    def __getitem__(self, i: int, /) -> float: ...


def _compiled_sources() -> dict[Path, str]:
    """Texts of the files that define kernels and of all that they import: a compiled constant may come from there."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(_PACKAGE.rglob("*.py"))}
    reached = [path for path, text in texts.items() if "study.sphere.jit" in text]
    for path in reached:  # grows while it is read
        for module, names in re.findall(r"^\s*from study\.([\w.]+) import \(?([\w\s,]*)", texts[path], re.MULTILINE):
            folder = _PACKAGE.joinpath(*module.split("."))
            files = [folder.with_suffix(".py"), *(folder / f"{name.strip()}.py" for name in names.split(","))]
            reached += [file for file in files if file in texts and file not in reached]
    return {path: texts[path] for path in sorted(reached)}


def _discard_stale_code() -> None:
    """Remove compiled code that was made from other sources.

    Numba keys a cached function by its own file alone: after a change in a function that it calls, the
    caller would be served from the cache with the old callee inlined. A stamp of all sources of compiled code
    prevents it.
    """
    texts = _compiled_sources()
    rooms = {path.relative_to(_PACKAGE).parts[0] for path in texts}
    digest = hashlib.sha256("".join(texts.values()).encode()).hexdigest()[:16]
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


_overloads: list[tuple[Callable[..., object], Callable[..., object], Inline]] = []
"""Overloads that Numba does not know yet: a function, the maker of what is compiled for it, and when to inline that."""
_lock = threading.RLock()


class Kernel:
    """A function that is compiled, or read from the cache on disk, when it is first called.

    Args:
        function: the function.
        fastmath: names of LLVM's flags for floating-point arithmetic, or False.
    """

    __name__: str
    __qualname__: str

    def __init__(self, function: Callable[..., object], fastmath: set[str] | bool) -> None:
        functools.update_wrapper(self, function)
        self.function = function
        self.fastmath = fastmath
        self._code: Callable[..., object] | None = None

    def __call__(self, *arguments: object) -> object:
        """Call the compiled function."""
        return (self._code or self.code)(*arguments)

    def __reduce__(self) -> str:
        """Pickle the function by its name, as any function."""
        return self.__qualname__

    @property
    def code(self) -> Any:
        """Numba's function."""
        if self._code is None:
            with _lock:
                self._code = self._code or _compiler()(
                    cache=True, nogil=True, error_model="numpy", forceinline=True, fastmath=self.fastmath
                )(self.function)
        return self._code


@functools.cache
def _load_compiler() -> Any:
    """Load Numba, and register kernels as functions that other kernels can call."""
    _discard_stale_code()
    instruction_set.fix_compiler()
    from numba import njit, types
    from numba.core import event
    from numba.extending import typeof_impl

    class Report(event.Listener):
        """Log functions of this package when they are compiled, and the first of them so that a user reads it."""

        said = False

        def on_start(self, started: Any) -> None:
            function = started.data["dispatcher"].py_func
            if function.__module__.startswith("study."):
                if not self.said:
                    _LOG.warning(COMPILING)
                self.said = True
                _LOG.debug("%s.%s", function.__module__, function.__qualname__)

        def on_end(self, ended: Any) -> None:
            """Nothing is said."""

    cast(Any, event).register("numba:compile", Report())

    @typeof_impl.register(Kernel)
    def _type_of(kernel: Kernel, _: object) -> object:
        return types.Dispatcher(kernel.code)

    return njit


def _compiler() -> Any:
    """Numba's decorator, after all overloads are registered with Numba."""
    njit = _load_compiler()
    from numba.extending import overload

    while _overloads:
        function, make, inline = _overloads.pop()
        overload(function, inline=inline)(make)
    return njit


def overload(function: Callable[..., object], inline: Inline = "never") -> Callable[[F], F]:
    """Declare the code that kernels compile for a call of a function; it reaches `numba.extending.overload` later."""

    def note(make: F) -> F:
        with _lock:
            _overloads.append((function, make, inline))
        return make

    return note


def compiled(function: F) -> F:
    """Compile a function with the package's options, and cache the code on disk."""
    return cast(F, Kernel(function, {"reassoc", "contract", "arcp", "nsz"}))


def compiled_as_written(function: F) -> F:
    """Compile a function without ``fastmath``: its numbers have the same bits wherever it is inlined."""
    return cast(F, Kernel(function, False))


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


# Numba calls an overload with types in place of values, and wants the same annotations in it and in what it returns.
@overload(put, inline="always")
def _put(sums: Any, i: int, value: float) -> Callable[[Any, int, float], Sums]:
    from numba.cpython.unsafe.tuple import tuple_setitem

    replaced = cast(Callable[[Sums, int, float], Sums], tuple_setitem)

    def unrolled(sums: Any, i: int, value: float) -> Sums:
        return replaced(sums, i, value)

    def stored(sums: Any, i: int, value: float) -> Sums:
        sums[i] = value
        return sums  # type: ignore[no-any-return]

    return unrolled if _is_tuple(sums) else stored


def _is_tuple(kind: object) -> bool:
    from numba import types

    return isinstance(kind, types.BaseTuple)


@overload(fresh, inline="always")
def _fresh(sums: Any) -> Callable[[Any], Sums]:
    def same(sums: Any) -> Sums:
        return sums  # type: ignore[no-any-return]

    def copied(sums: Any) -> Sums:
        return sums.copy()  # type: ignore[no-any-return]

    return same if _is_tuple(sums) else copied


def fma(factor: float, other: float, term: float) -> float:
    """``factor * other + term``, rounded once: the same bits wherever it is inlined. For kernels alone."""
    raise NotImplementedError


def float_of(bits: np.uint64) -> float:
    """The floating-point number of these bits. For kernels alone."""
    raise NotImplementedError


@overload(fma, inline="always")
def _fma(factor: float, other: float, term: float) -> Callable[[float, float, float], float]:
    from numba import types
    from numba.extending import intrinsic

    @intrinsic
    def instruction(typing: object, factor: object, other: object, term: object) -> object:
        def generate(context: object, builder: Any, signature: object, arguments: Sequence[object]) -> object:
            return builder.fma(*arguments)

        return types.float64(types.float64, types.float64, types.float64), generate

    at_once = cast(Callable[[float, float, float], float], instruction)

    def once(factor: float, other: float, term: float) -> float:
        return at_once(factor, other, term)

    return once


@overload(float_of, inline="always")
def _float_of(bits: np.uint64) -> Callable[[np.uint64], float]:
    from numba import types
    from numba.extending import intrinsic

    @intrinsic
    def instruction(typing: object, bits: object) -> object:
        def generate(context: Any, builder: Any, signature: object, arguments: Sequence[object]) -> object:
            return builder.bitcast(arguments[0], context.get_value_type(types.float64))

        return types.float64(types.uint64), generate

    at_once = cast(Callable[[np.uint64], float], instruction)

    def same(bits: np.uint64) -> float:
        return at_once(bits)

    return same


@compiled
def aligned(count: int) -> Floats:
    """Memory for numbers that begins with a cache line: loops over rows that do not take up to a third more time."""
    memory = np.empty(count + _LINE)
    first = -(memory.ctypes.data // memory.itemsize) % _LINE
    return memory[first : first + count]


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
