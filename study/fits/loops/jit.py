"""Loops: compiled, or plain Python where little is to be done; and sums that stay in registers.

Every compiled function of the package is decorated with :func:`compiled` and so has the same options:

* ``nogil``: threads can run kernels side by side;
* ``error_model="numpy"``: a division may yield inf or nan instead of raising, and so can be vectorised;
* ``fastmath`` without ``nnan`` and ``ninf``: sums may be reordered and contracted, but NaN and inf keep their meaning;
* ``forceinline``: a function that two others call is compiled into each. On its own it would have a version in each,
  and which of them runs would depend on whether they were just compiled or come from the cache: bits would differ.

A function (`Loop`) whose compiled code is not in the cache runs as plain Python until it has been given some ten
thousand numbers, and is compiled then; within `always_compiled` at once. The first function of a process that is
compiled is a warning in the log ``study``, which Python prints on standard error unless a program sets up its logs;
each function is a message for debugging. Numba keeps compiled code on disk; its folder names the sources of a function,
those that it imports included, so that code of other sources is never read.

A loop must not both store to an array and carry a sum where sums may be reordered. The compiler makes two versions of
such a loop, with vector instructions and without, and chooses by the distance of two arrays in memory: where small
arrays happen to lie would decide the last bit of the sum. Store in one loop and add in another; ``tests/near.py`` finds
such loops.

Numba has no public name for four things that are used here alone: the cache of a function, which is to be keyed by all
of its sources and written by one process at a time; the moment before it compiles; its events; and a tuple with one
item replaced. A version of numba that lacks them fails when this file is imported.

A compiled function must not raise to a whole power: numba compiles x ** 2 once in a process, with the options of the
first function that has it, which may be a user's own, and all others would lose theirs. They call :func:`squared`.

A loop over samples keeps its sums in the value that :func:`zeros` returns: tuples in few dimensions, whose length the
compiler knows, so that it unrolls the loops over coordinates and vectorises the one over samples; arrays in many.
:func:`put` and :func:`fresh` work on both, so that each sum is written once for every dimension.

Layouts of point sets in memory, and the one way in which kernels read samples.

A batch of point sets is an array (b, d, n), which lies in memory coordinate by coordinate, or the same sample by sample
(`BySample`). Kernels that read samples once read them chunk by chunk from a :func:`window`, and so are written once for
both.
"""

import contextlib
import glob
import hashlib
import inspect
import logging
import re
import shutil
import threading
from collections.abc import Callable, Iterator
from functools import cache, partial, update_wrapper
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar, cast

import numpy as np
from filelock import FileLock

from study import instruction_set
from study.arrays import Floats

instruction_set.fix_compiler()

from numba import float64, njit, types, uint64  # noqa: E402  after its settings are made
from numba.core import event  # noqa: E402
from numba.core.caching import IndexDataCacheFile  # noqa: E402
from numba.cpython.unsafe.tuple import tuple_setitem  # noqa: E402
from numba.extending import intrinsic, overload, register_jitable  # noqa: E402

F = TypeVar("F", bound=Callable[..., object])

CHUNK = 256
"""Samples that a kernel handles at a time: d + 2 rows of 256 doubles, and the samples, stay in a first-level cache."""
_LINE = 8
"""Doubles in a cache line."""
_UNROLLED = 4
"""Dimensions up to which sums are tuples; beyond, the compiler would take too long."""

SCALAR_CODE = Path(__file__).parent / "__pycache__" / "scalar"
"""Cache of code without vector instructions, which numba would take for the other: `study cost` times it."""

_PLAIN = 1 << 16
"""Numbers that a loop may be given in all before it is compiled, which then has taken it about as long as compiling."""

LOCK = "compiled.lock"
"""File beside the compiled code whose lock a process holds while it stores some."""

_PATIENCE = 5.0
"""Seconds to wait for it; storing takes some milliseconds."""

_TURN = 60.0
"""Seconds to wait for another process that compiles the same version of a function, which takes some seconds."""

COMPILING = "study: compiling loops, once after an installation; it takes seconds, at most a minute"
"""Warning of a process that compiles a function, and does not read it from the cache."""

_KEPT = 3
"""Sets of sources of a file, its own included, whose code is kept."""

_PACKAGE = Path(__file__).parents[2]
_IMPORT = re.compile(r"^ *from (study[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)
_LOG = logging.getLogger(__name__)


class Sums(Protocol):
    """A few numbers that a kernel adds to: a tuple in few dimensions, an array in many."""

    def __len__(self) -> int: ...

    def __getitem__(self, i: int, /) -> float: ...


@cache
def _read(source: Path) -> tuple[bytes, list[Path]]:
    """Text of a source, and the sources of this package that it imports."""
    text, imported = source.read_bytes(), list[Path]()
    for module, names in _IMPORT.findall(text.decode()):
        place = _PACKAGE.parent.joinpath(*module.split("."))
        parts = [place / f"{name}.py" for name in re.findall(r"\w+", names)]
        whole = [] if all(part.exists() for part in parts) else [place / "__init__.py"]
        imported += [path for path in (place.with_suffix(".py"), *parts, *whole) if path.exists()]
    return text, imported


@cache
def _stamp(source: Path) -> str:
    """Digest of a source and of all sources of this package that it imports, directly or not."""
    todo, done = {source} if source.exists() else set(), set[Path]()
    while todo:
        done.add(path := todo.pop())
        todo |= set(_read(path)[1]) - done
    return hashlib.sha256(b"".join(_read(path)[0] for path in sorted(done))).hexdigest()[:16]


def _keep_by_sources(kept: Any, function: Callable[..., object]) -> Path:
    """Have numba keep the code of a function in a folder that is named after its sources, and return that folder.

    Numba keys a cached function by its own file alone: after a change in a function that it calls, the caller would be
    served from the cache with the old callee inlined.
    """
    source, numba = Path(inspect.getfile(function)), kept._impl
    folder = Path(kept.cache_path) / f"{source.stem}-{_stamp(source)}"
    index: Any = IndexDataCacheFile  # numba has no types
    kept._cache_file = index(str(folder), numba.filename_base, numba.locator.get_source_stamp())
    return folder


class _Report(event.Listener):
    """Log functions of this package when they are compiled, and the first of them so that a user reads it."""

    warned = False

    def on_start(self, started: Any) -> None:
        """Log a function."""
        function = started.data["dispatcher"].py_func
        if function.__module__.startswith("study."):
            if not self.warned:
                _LOG.warning(COMPILING)
            self.warned = True
            _LOG.debug("%s.%s", function.__module__, function.__qualname__)

    def on_end(self, ended: Any) -> None:
        """Say nothing."""


event.register("numba:compile", _Report())  # type: ignore[no-untyped-call]


class _Way(threading.local):
    """The way in which loops run in this thread.

    Attributes:
        plain: true within a loop that runs as plain Python, whose own loops do too.
        compile: true where numbers have to be the same to the bit on every machine.
        called: the loop that was called, and its arguments, while its code is sought.
    """

    plain = False
    compile = False
    called: "tuple[Loop, tuple[object, ...]] | None" = None


_WAY = _Way()


class _NotStoredError(Exception):
    """A loop is not compiled, and its work is small."""


@contextlib.contextmanager
def always_compiled() -> Iterator[None]:
    """Compile loops in this thread however small their work is: studies store numbers that are the same to the bit."""
    before, _WAY.compile = _WAY.compile, True
    try:
        yield
    finally:
        _WAY.compile = before


class Loop:
    """A function with loops, which runs compiled; as plain Python while it is not compiled and its work is small.

    A user's first fit would wait half a minute for the compiler, and takes a tenth of a second in plain Python. The two
    ways differ by rounding. The rule counts numbers, and not seconds, so that it is the same on every machine.

    Args:
        function: the function.
        dispatcher: the function as numba compiles it.
    """

    def __init__(self, function: Callable[..., object], dispatcher: Any) -> None:
        update_wrapper(self, function)
        self.function, self.dispatcher = function, dispatcher
        self._numba_type_ = types.Dispatcher(dispatcher)  # loops that call this one have its code compiled in
        self._done = 0
        with contextlib.suppress(RuntimeError):  # no folder can be written: the code lasts as long as the process
            dispatcher.enable_caching()
        self._compile_for, dispatcher._compile_for_args = dispatcher._compile_for_args, self._compile
        kept = dispatcher._cache
        self._load = kept.load_overload
        kept.load_overload = self._stored
        self._turn_files: Path | None = None
        self._turn: FileLock | None = None  # made when it is taken: a process that is a fork must not have its parent's
        if kept.cache_path:
            folder = _keep_by_sources(kept, function)
            self._turn_files = folder.parent / f"{folder.name.rpartition('-')[0]}.{function.__qualname__}"
            kept.save_overload = partial(self._store, kept.save_overload, folder)

    def __call__(self, *arguments: object) -> object:
        """Run the function."""
        if _WAY.plain:
            return self.function(*arguments)
        try:
            return self.dispatcher(*arguments)
        except _NotStoredError:
            return self._run_plain(arguments)

    def _compile(self, *arguments: object) -> object:
        """Find or make the code for arguments of types that are new; numba calls this, and then runs the code."""
        before, _WAY.called = _WAY.called, (self, arguments)
        try:
            return self._compile_for(*arguments)
        finally:
            _WAY.called = before

    def _stored(self, signature: object, context: object) -> object:
        """The compiled code from the cache; None has numba compile it."""
        code = self._load(signature, context)
        if code is None and not _WAY.compile and _WAY.called is not None:
            loop, arguments = _WAY.called
            if loop is self and loop._done + _size(arguments) <= _PLAIN:
                raise _NotStoredError
        if code is None and self._turn_files is not None:  # another process may be compiling it: to wait costs less
            with contextlib.suppress(OSError, NotImplementedError):
                self._turn_files.parent.mkdir(parents=True, exist_ok=True)
                version = hashlib.sha256(str(signature).encode()).hexdigest()[:8]
                self._turn = FileLock(f"{self._turn_files}.{version}.lock", timeout=_TURN)
                self._turn.acquire()
                code = self._load(signature, context)
                if code is not None:
                    self._turn.release()
        return code

    def _store(self, save: Callable[..., None], folder: Path, signature: object, code: object) -> None:
        """Store a version of the function, and let another process have its turn."""
        try:
            _store(save, folder, signature, code)
        finally:
            if self._turn is not None and self._turn.is_locked:
                self._turn.release()

    def _run_plain(self, arguments: tuple[object, ...]) -> object:
        """Run the function as plain Python."""
        self._done += _size(arguments)
        _WAY.plain = True
        try:
            with np.errstate(all="ignore"):  # compiled code does not warn
                return self.function(*arguments)
        finally:
            _WAY.plain = False


def _size(argument: object) -> int:
    """Size of the largest array of an argument, at least 1."""
    if isinstance(argument, tuple):
        return max(map(_size, argument), default=1)
    return argument.size if isinstance(argument, np.ndarray) else 1


def compiled(function: F, fastmath: bool = True) -> F:
    """Compile a function with the package's options when its work is large, and cache the code on disk."""
    flags = {"reassoc", "contract", "arcp", "nsz"} if fastmath else False
    options = njit(nogil=True, error_model="numpy", forceinline=True, fastmath=flags)
    dispatcher = options(function)
    return cast(F, Loop(function, dispatcher) if hasattr(dispatcher, "_cache") else dispatcher)


def _store(save: Callable[..., None], folder: Path, signature: object, code: object) -> None:
    """Store a version of a function while no other process stores one.

    Numba numbers the files of a function's versions by an index. Of two processes that store versions at the same time,
    both may take the same number, and one version would be read as the other from then on. A version that cannot be
    stored, as where a file system has no locks, is compiled again by the next process. The code of older sources goes;
    that of the last ones stays for whoever goes back to them.
    """
    with contextlib.suppress(OSError, NotImplementedError), FileLock(folder.parent / LOCK, timeout=_PATIENCE):
        if not folder.exists():
            folder.mkdir(parents=True)
            name = glob.escape(folder.name.rpartition("-")[0]) + "-" + 16 * "[0-9a-f]"
            for old in sorted(folder.parent.glob(name), key=lambda path: path.stat().st_mtime)[:-_KEPT]:
                shutil.rmtree(old, ignore_errors=True)
        save(signature, code)


def compiled_as_written(function: F) -> F:
    """Compile a function without ``fastmath``: its numbers have the same bits wherever it is inlined."""
    return compiled(function, fastmath=False)


def zeros(dimension: int, per: int = 1) -> Sums:
    """Return ``dimension * per`` sums at zero: a tuple, which the compiler can keep in registers, if d is small."""
    count = dimension * per
    return (0.0,) * count if dimension <= _UNROLLED else np.zeros(count)


def put(sums: Sums, i: int, value: float) -> Sums:
    """Return sums with the i-th replaced. Assign the result: arrays are changed in place, tuples are not."""
    if isinstance(sums, tuple):
        return (*sums[:i], value, *sums[i + 1 :])
    sums[i] = value  # type: ignore[index]
    return sums


def fresh(sums: Sums) -> Sums:
    """Return the same sums, independent of the given ones; in plain Python a list, which `put` changes in place."""
    return list(sums)  # type: ignore[call-overload, no-any-return]


@overload(put, inline="always", strict=False)
def _put(sums: Any, i: Any, value: Any) -> Callable[..., Any]:
    def stored(sums: Any, i: Any, value: Any) -> Any:
        sums[i] = value
        return sums

    is_tuple = isinstance(sums, types.BaseTuple)
    return (lambda sums, i, value: tuple_setitem(sums, i, value)) if is_tuple else stored  # type: ignore[call-arg]


@overload(fresh, inline="always", strict=False)
def _fresh(sums: Any) -> Callable[..., Any]:
    return (lambda sums: sums) if isinstance(sums, types.BaseTuple) else (lambda sums: sums.copy())


def fma(factor: float, other: float, term: float) -> float:
    """``factor * other + term``; rounded once in compiled code: the same bits wherever it is inlined."""
    return factor * other + term


@register_jitable(inline="always")
def squared(x: float) -> float:
    """``x * x``, compiled into its caller."""
    return x * x


def float_of(bits: np.uint64) -> float:
    """The floating-point number of these bits."""
    return float(bits.view(np.float64))


@intrinsic
def _fma(typing: object, factor: object, other: object, term: object) -> object:
    return float64(float64, float64, float64), lambda _, builder, signature, numbers: builder.fma(*numbers)


@intrinsic
def _float_of(typing: object, bits: object) -> object:
    def cast_bits(context: Any, builder: Any, signature: Any, words: Any) -> Any:
        return builder.bitcast(words[0], context.get_value_type(float64))

    return float64(uint64), cast_bits


@overload(fma, inline="always", strict=False)
def _fma_once(factor: object, other: object, term: object) -> Callable[..., float]:
    return lambda factor, other, term: _fma(factor, other, term)  # type: ignore[call-arg]


@overload(float_of, inline="always", strict=False)
def _float_of_bits(bits: object) -> Callable[..., float]:
    return lambda bits: _float_of(bits)  # type: ignore[call-arg]


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
"""Samples whose sums are formed apart, before they are added to those of the whole set."""

_FEW = 1 << 12
"""Smaller arrays are copied rather than wrapped."""

_NEAR = 32
"""Number of first samples whose mean serves as an origin near all."""


class BySample(NamedTuple):
    """Point sets that lie in memory sample by sample, as users have them.

    To read them so saves a user's batch a copy: a quarter to a half of the time of GDKE and LLS. Studies' points lie
    coordinate by coordinate.

    Attributes:
        points: coordinates last (b, n, d), contiguous.
    """

    points: Floats


PointSets = Floats | BySample


class View(NamedTuple):
    """View of samples in an array (b, d, n): those of set ``t`` from sample ``start`` on."""

    x: Floats
    t: np.uintp
    start: np.uintp


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


def readable(x: Floats) -> PointSets:
    """Point sets (b, d, n) in a form that :func:`window` reads. Small or strided arrays are copied.

    Kernels would be compiled for each other layout, of which a batch of one set and a batch of many are two.
    """
    if x.flags.c_contiguous:
        return x
    points = x.swapaxes(1, 2)
    return BySample(points) if points.flags.c_contiguous and x.size > _FEW else np.ascontiguousarray(x)


def extent(x: PointSets) -> tuple[int, ...]:
    """Number of sets b, dimension d, samples n. For kernels."""
    return (x.points.swapaxes(1, 2) if isinstance(x, BySample) else x).shape


def window(x: PointSets, t: int, start: int, count: int, rows: Floats, zero: Sums) -> View:
    """A view of ``count`` samples of set t of a batch, from sample ``start`` on, for :func:`at`.

    It shows the batch itself if that lies in memory coordinate by coordinate, and ``rows`` (1, d, CHUNK), to which the
    samples are copied, if it lies there sample by sample. ``zero`` holds d sums at zero. No sum depends on the layout,
    not in a bit.
    """
    return View(x.points.swapaxes(1, 2) if isinstance(x, BySample) else x, np.uintp(t), np.uintp(start))


@compiled
def at(view: View, i: int, k: int) -> float:
    """The i-th coordinate of the k-th sample of a view."""
    return view.x[view.t, i, view.start + np.uintp(k)]  # type: ignore[no-any-return]


def _is_by_sample(x: object) -> bool:
    return getattr(x, "instance_class", None) is BySample


@overload(extent, strict=False)
def _extent(x: Any) -> Callable[..., tuple[int, ...]]:
    def by_sample(x: Any) -> tuple[int, ...]:
        b, n, d = x.points.shape
        return b, d, n

    return by_sample if _is_by_sample(x) else lambda x: x.shape


@overload(window, strict=False)
def _window(x: Any, t: Any, start: Any, count: Any, rows: Any, zero: Any) -> Callable[..., View]:
    def itself(x: Any, t: int, start: int, count: int, rows: Floats, zero: Sums) -> View:
        return View(x, np.uintp(t), np.uintp(start))

    def copied(x: Any, t: int, start: int, count: int, rows: Floats, zero: Sums) -> View:
        for k in range(count):
            for i in range(len(zero)):
                rows[0, i, k] = x.points[t, np.uintp(start) + np.uintp(k), i]
        return View(rows, np.uintp(0), np.uintp(0))

    return copied if _is_by_sample(x) else itself


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
