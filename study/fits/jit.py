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

Layouts of point sets in memory, and the one way in which kernels read samples from each.

A batch of point sets is an array (b, d, n), which lies in memory coordinate by coordinate; the same sample by sample
(`BySample`); or the draws that its points are formed from (`Placed`). Kernels read samples chunk by chunk from a
:func:`window`, and so are written once for all three. Sets that are formed from the same draws are read side by side
(:func:`abreast`), a block of samples from each in turn, while the draws are in a cache: reading them from memory costs
more than forming the points.
"""

import functools
import hashlib
import logging
import re
import shutil
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol, TypeVar, cast

import numpy as np

from study import instruction_set
from study.arrays import Floats

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
    reached = [path for path, text in texts.items() if "study.fits.jit" in text]
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


BLOCK = 32 * CHUNK
"""Samples that are read from a set before it is the next one's turn: that many draws stay in a second-level cache."""

_FEW = 1 << 12
"""Smaller arrays are copied rather than wrapped."""

_NEAR = 32
"""Number of first samples whose mean serves as an origin near all."""


class Placed(NamedTuple):
    """Point sets x = c + r u + σ z: those of the first trial on every sphere, then those of the next.

    Attributes:
        directions: unit vectors u (t, d, n), with the height 1 - u₁ in place of u₁.
        noise: noise z of unit size (t, d, n).
        center: c (l, d).
        radius: r (l,).
        sigma: σ (l,).
    """

    directions: Floats
    noise: Floats
    center: Floats
    radius: Floats
    sigma: Floats


class BySample(NamedTuple):
    """Point sets that lie in memory sample by sample, as users have them.

    Attributes:
        points: coordinates last (b, n, d), contiguous.
    """

    points: Floats


PointSets = Floats | Placed | BySample


class Stored(NamedTuple):
    """View of samples in an array (b, d, n): those of set ``t`` from sample ``start`` on."""

    x: Floats
    t: np.uintp
    start: np.uintp


class Formed(NamedTuple):
    """View of samples that are formed when they are read: those of a trial from sample ``start`` on."""

    directions: Floats
    noise: Floats
    trial: np.uintp
    start: np.uintp
    center: Sums
    radius: float
    sigma: float


View = Stored | Formed


class SampleBlock(NamedTuple):
    """The ``size`` samples of set ``t`` of a batch from sample ``start`` on."""

    x: PointSets
    t: int
    start: int
    size: int


class Scratch(NamedTuple):
    """Working memory of kernels that read samples.

    Attributes:
        rows: place for one chunk of samples (1, d, CHUNK).
        zero: d sums at zero.
        square: d² sums at zero.
    """

    rows: Floats
    zero: Sums
    square: Sums


@compiled_as_written
def _coordinate(i: int, u: float, z: float, center: float, radius: float, sigma: float) -> float:
    """The i-th coordinate of a sample."""
    cosine = 1.0 - u if i == 0 else u
    return fma(sigma, z, fma(radius, cosine, center))


@compiled
def _form(placed: Placed, first: int, points: Floats) -> None:
    b, d, n = points.shape
    for t in range(b):
        trial, s = (first + t) // placed.radius.size, (first + t) % placed.radius.size
        for i in range(d):
            u, z, x = placed.directions[trial, i], placed.noise[trial, i], points[t, i]
            center, radius, sigma = placed.center[s, i], placed.radius[s], placed.sigma[s]
            for k in range(n):
                x[k] = _coordinate(i, u[k], z[k], center, radius, sigma)


def form(placed: Placed, points: Floats, first: int = 0) -> Floats:
    """Write point sets into an array (b, d, n), from set ``first`` on as many as it holds, and return it."""
    _form(placed, first, points)
    return points


def readable(x: Floats | Placed) -> PointSets:
    """Point sets (b, d, n) in a form that :func:`window` reads. Small or strided arrays are copied.

    Kernels would be compiled for each other layout, of which a batch of one set and a batch of many are two.
    """
    if isinstance(x, Placed) or x.flags.c_contiguous:
        return x
    points = x.swapaxes(1, 2)
    return BySample(points) if points.flags.c_contiguous and x.size > _FEW else np.ascontiguousarray(x)


def extent(x: PointSets) -> tuple[int, int, int]:
    """Number of sets b, dimension d, samples n."""
    if isinstance(x, BySample):
        b, n, d = x.points.shape
        return b, d, n
    if isinstance(x, Placed):
        t, d, n = x.noise.shape
        return t * len(x.radius), d, n
    b, d, n = x.shape
    return b, d, n


def abreast(x: PointSets) -> int:
    """Number of consecutive sets built from the same draws.

    Kernels take it as an argument, and do not compute it: bits could differ where the compiler knows it to be 1.
    """
    return len(x.radius) if isinstance(x, Placed) else 1


def window(x: PointSets, t: int, start: int, count: int, rows: Floats, zero: Sums) -> View:
    """A view of ``count`` samples of set t of a batch, from sample ``start`` on, for :func:`at`.

    It shows the batch itself if that lies in memory coordinate by coordinate; ``rows`` (1, d, CHUNK), to which
    the samples are copied, if it lies there sample by sample; or the draws that the points are formed from. ``zero``
    holds d sums at zero. No sum depends on the layout, not in a bit.
    """
    return Stored(cast(Floats, x), np.uintp(t), np.uintp(start))


def at(view: View, i: int, k: int) -> float:
    """The i-th coordinate of the k-th sample of a view."""
    x, t, start = cast(Stored, view)
    return x[t, i, start + np.uintp(k)]  # type: ignore[no-any-return]


def _is(x: object, kind: type) -> bool:
    return getattr(x, "instance_class", None) is kind


@overload(extent)
def _extent(x: Any) -> Callable[..., tuple[int, ...]]:
    def stored(x: Any) -> tuple[int, ...]:
        return x.shape  # type: ignore[no-any-return]

    def placed(x: Any) -> tuple[int, ...]:
        t, d, n = x.noise.shape
        return t * x.radius.size, d, n

    def by_sample(x: Any) -> tuple[int, ...]:
        b, n, d = x.points.shape
        return b, d, n

    return placed if _is(x, Placed) else by_sample if _is(x, BySample) else stored


@overload(window)
def _window(x: Any, t: int, start: int, count: int, rows: Floats, zero: Sums) -> Callable[..., View]:
    def itself(x: Any, t: int, start: int, count: int, rows: Floats, zero: Sums) -> Stored:
        return Stored(x, np.uintp(t), np.uintp(start))

    def copied(x: Any, t: int, start: int, count: int, rows: Floats, zero: Sums) -> Stored:
        for k in range(count):
            for i in range(len(zero)):
                rows[0, i, k] = x.points[t, np.uintp(start) + np.uintp(k), i]
        return Stored(rows, np.uintp(0), np.uintp(0))

    def formed(x: Any, t: int, start: int, count: int, rows: Floats, zero: Sums) -> Formed:
        trial, s, center = np.uintp(t // x.radius.size), t % x.radius.size, fresh(zero)
        for i in range(len(zero)):
            center = put(center, i, x.center[s, i])
        return Formed(x.directions, x.noise, trial, np.uintp(start), center, x.radius[s], x.sigma[s])

    return formed if _is(x, Placed) else copied if _is(x, BySample) else itself


@overload(at)
def _at(view: Any, i: int, k: int) -> Callable[..., float]:
    def stored(view: Any, i: int, k: int) -> float:
        x, t, start = view
        return x[t, i, start + np.uintp(k)]  # type: ignore[no-any-return]

    def formed(view: Any, i: int, k: int) -> float:
        u, z, t, start, center, radius, sigma = view
        place = start + np.uintp(k)
        return _coordinate(i, u[t, i, place], z[t, i, place], center[i], radius, sigma)

    return formed if _is(view, Formed) else stored


@compiled_as_written
def near(x: PointSets, t: int, n: int, rows: Floats, zero: Sums) -> Sums:
    """A point near the n samples of a set: the mean of the first of them, by its bits the same in every layout."""
    m, mean = min(n, _NEAR), fresh(zero)
    view = window(x, t, 0, m, rows, zero)
    for k in range(m):
        for i in range(len(zero)):
            mean = put(mean, i, mean[i] + at(view, i, k))
    for i in range(len(zero)):
        mean = put(mean, i, mean[i] / m)
    return mean
