"""Workers of a run: threads, processes of this machine or a Dask cluster, and the dispatch of work to them.

Each kind is an executor as in `concurrent.futures`: Python's for threads, loky's for processes, Dask's for a cluster.
What they do not do is done here:

- Items of work are put together until they weigh enough to be sent (`cut`); a few tasks a worker are sent ahead.
- Results are stored when they come, or a second later. Whatever ends the work, what was finished is stored.
- When a process dies, loky gives up all tasks that it was sent. They become suspects: each of their items is tried once
  more while nothing else runs, and given up if a process dies of it again.

Equal runs are equal to the byte only if the same code runs on the same machine instructions. So the parent sends its
own description with every task, and a worker compares itself with it before it unpickles its first one (`enter`).

No task runs in the main thread, where Ctrl-C could strike inside compiled code that cannot take it: numba 0.68 ends the
process with a segmentation fault if an exception rises while it unboxes a generator.

loky keeps its processes for the next run of the same program, and ends them after five idle minutes or with the
program; if that is killed, they end themselves (`follow`). loky notices the death of a process, unless it dies while it
sends a result: then loky waits for the other half of the result for ever, and the other processes for the lock that the
dead one holds. `Processes.check` ends that.

`joblib.Parallel` has loky's processes without their futures, which cancelling and retrying need, so the copy of loky in
joblib is used, here alone; the package `loky` has the same names. `Processes.check` reads three private fields of its
executor: without them a run whose process dies while it sends would wait for ever.
"""

import contextlib
import gc
import logging
import os
import pickle
import re
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.connection import wait
from queue import Empty, SimpleQueue
from types import ModuleType
from typing import Any, Generic, NamedTuple, TypeVar

from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.backend.utils import kill_process_tree
from threadpoolctl import threadpool_limits

from study.files import RunError
from study.fits import registry
from study.simulation.runs import provenance
from study.simulation.runs.parts import Packet, Parts

S = TypeVar("S")
T = TypeVar("T")


class DisagreementError(Exception):
    """A worker would compute other bytes than its parent; the message says where they differ."""


class Parent(NamedTuple):
    """Description of the process that gives out tasks.

    Attributes:
        fingerprint: what determines the bytes of a run; see `study.simulation.runs.provenance.fingerprint`.
        plugins: paths and texts of the files of estimators that it has loaded.
    """

    fingerprint: dict[str, str | None]
    plugins: tuple[tuple[str, str], ...] = ()


_agreed: list[Parent] = []
_agreeing = threading.Lock()
"""A Dask worker with many threads gets as many first tasks at once."""
_SYNCHRONIZE, _FOREVER = 0x00100000, 0xFFFFFFFF
"""Windows: the right to wait for a process, and a wait without an end."""


def introduction() -> Parent:
    """Describe this process to worker processes."""
    return Parent(provenance.fingerprint(), registry.loaded())


def follow(parent: int, plugins: tuple[tuple[str, str], ...] = ()) -> None:
    """Bind this process to its parent's life; the first thing that a process of this machine does.

    A terminal sends Ctrl-C to the workers, too; they ignore it, and the parent ends them. If it is killed, they end
    themselves, also while they wait for a first task.

    Args:
        parent: number of the parent process.
        plugins: that the parent has. Loky starts new processes where an argument is another, and so none has names
            that its parent has given up.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process when its parent was killed, since nobody would take its results."""
    if sys.platform == "win32":  # a process keeps its parent's number there
        import ctypes

        kernel = ctypes.windll.kernel32
        kernel.WaitForSingleObject(kernel.OpenProcess(_SYNCHRONIZE, False, parent), _FOREVER)
    else:
        while os.getppid() == parent:
            time.sleep(0.5)
    os._exit(1)


def seal(function: Callable[..., object], *arguments: object) -> bytes:
    """Pickle a call for `enter`."""
    return pickle.dumps((function, arguments))


def enter(parent: Parent, call: bytes) -> object:
    """Make a call in a worker process.

    Args:
        parent: the process that gives out tasks.
        call: the call; see `seal`.

    Raises:
        DisagreementError: if this process would compute other bytes than its parent.
    """
    with _agreeing:
        if parent not in _agreed:
            _agree(parent)
            _agreed.append(parent)
    function, arguments = pickle.loads(call)
    return function(*arguments)


def _agree(parent: Parent) -> None:
    """Set up this process as its parent is; DisagreementError if that cannot be."""
    if differ := provenance.differences(parent.fingerprint):
        raise DisagreementError(f"worker on {socket.gethostname()}: {', '.join(differ)}")
    threadpool_limits(limits=1)
    logging.getLogger("study").setLevel(logging.ERROR)  # the parent says once that loops are compiled
    for path, text in parent.plugins:
        registry.load_text(registry.PluginFile(path, text))


PER_SECOND = 1e8
"""Weight that one worker computes in about a second."""
_AHEAD = 3
"""Tasks a worker that are sent before their results are awaited."""


class Threads:
    """Threads of this process; the parent of the other kinds of workers.

    Args:
        jobs: number of threads.

    Attributes:
        alone: true if tasks share a fate: the death of one worker ends the others, or all share their memory. Then a
            task that may be fatal is tried while nothing else runs.
        enough: weight below which items are put together to a task.
        fatal: exceptions of a task that ended its worker, or wanted more memory than there is.
        noticed: how a worker ended whose death the executor does not notice; empty if there is none.
    """

    alone = True
    enough = 6e6  # some 80 ms, beside which sending a task costs little
    fatal: tuple[type[BaseException], ...] = (MemoryError, BrokenExecutor)
    noticed = ""

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        self.restart()

    def restart(self) -> None:
        """Begin with a new executor, and new workers where some have died."""
        self.executor: Executor = ThreadPoolExecutor(self.jobs)

    @property
    def slots(self) -> int:
        """Number of tasks that are computed or wait for a worker at a time."""
        return _AHEAD * self.jobs

    def submit(self, function: Callable[..., object], *arguments: object) -> "Future[object]":
        """Send a call to the workers."""
        return self.executor.submit(function, *arguments)

    def check(self) -> None:
        """Look after the workers; called now and then while results are awaited."""

    def stop(self) -> None:
        """Begin no task any more, and end those that run, if they can be ended; threads end in `close`."""
        self.executor.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """End the workers, which have nothing more to do."""
        self.executor.shutdown()


_IDLE = 300
"""Seconds after which idle processes end."""
_GRACE = 3.0
"""Seconds that loky has to notice that a process died. It is woken by that, and takes milliseconds."""


class Processes(Threads):
    """Processes of this machine."""

    def __init__(self, jobs: int) -> None:
        self._parent = introduction()
        super().__init__(jobs)

    def restart(self) -> None:
        self.noticed, self._dead_since = "", -1.0
        mine = (os.getpid(), self._parent.plugins)
        with _quiet("ExecutorManagerThread"):
            self.executor = get_reusable_executor(self.jobs, timeout=_IDLE, initializer=follow, initargs=mine)

    def submit(self, function: Callable[..., object], *arguments: object) -> "Future[object]":
        with interrupts_later():
            return self.executor.submit(enter, self._parent, seal(function, *arguments))

    def check(self) -> None:
        """Break loky's executor if a process has died and loky has not noticed: it waits for half a result."""
        if sys.platform == "win32":  # messages are whole there
            return
        executor: Any = self.executor
        processes = list(executor._processes.values())  # a copy, since loky's thread changes it
        if executor._flags.broken is not None or not wait([process.sentinel for process in processes], timeout=0):
            self._dead_since = -1.0
        elif self._dead_since < 0.0:
            self._dead_since = time.monotonic()
        elif time.monotonic() - self._dead_since > _GRACE:
            codes = [code for process in processes if (code := process.exitcode) is not None]
            names = (signal.Signals(-code).name if code < 0 else f"exit code {code}" for code in codes)
            self.noticed = f"a process ended while it sent a result: {', '.join(names)}"
            for process in processes:
                kill_process_tree(process)
            with open(os.devnull, "wb") as null:  # in place of the last writer: loky reads the end
                os.dup2(null.fileno(), executor._result_queue._writer.fileno())

    def stop(self) -> None:
        executor: Any = self.executor
        with _quiet("ExecutorManagerThread"):
            executor.shutdown(kill_workers=True)

    def close(self) -> None:
        """Leave the processes to the next run of this program."""


@contextlib.contextmanager
def _quiet(name: str) -> Iterator[None]:
    """Do not print what threads of a name raise: loky's can lose a race with the end of its own executor."""
    before = threading.excepthook
    threading.excepthook = lambda args: None if args.thread and args.thread.name == name else before(args)
    try:
        yield
    finally:
        threading.excepthook = before


@contextlib.contextmanager
def interrupts_later() -> Iterator[None]:
    """Hold Ctrl-C back in this thread, and in the threads and processes that it starts meanwhile.

    A terminal sends it to all processes. One that just starts, and cannot yet ignore it, would print a traceback; but
    it has the signals blocked that its parent's thread had blocked.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_PATIENCE = 10.0
"""Seconds to wait for a scheduler to answer, and between two counts of its workers."""
_STARTING = 30.0
"""Seconds that a worker waits for a scheduler that may be starting, as Dask's own workers do."""


class DaskCluster(Threads):
    """Workers of a Dask scheduler.

    Args:
        address: the scheduler's, such as ``tcp://login-node:8786``.
        task: seconds of work from which a task takes no more items. The scheduler and the parent take milliseconds
            for each task, so many workers need long ones.

    Raises:
        RunError: if Dask is not installed, or nothing answers there.
    """

    alone = False  # a dead worker ends its own tasks, and the scheduler gives them to others
    enough = 2e7

    def __init__(self, address: str, task: float | None = None) -> None:
        if task is not None:
            self.enough = task * PER_SECOND
        self._client = _client(address, _PATIENCE, "--scheduler ")
        self.fatal = (MemoryError, _imported().KilledWorker)
        self._parent, self._counted = introduction(), -_PATIENCE
        super().__init__(1)

    def restart(self) -> None:
        self.executor = self._client.get_executor(pure=False)

    @property
    def slots(self) -> int:
        if time.monotonic() - self._counted >= _PATIENCE:  # a batch system starts its workers when it pleases
            self._counted, self.jobs = time.monotonic(), max(1, sum(self._client.nthreads().values()))
        return super().slots

    def submit(self, function: Callable[..., object], *arguments: object) -> "Future[object]":
        return self.executor.submit(enter, self._parent, seal(function, *arguments))

    def close(self) -> None:
        self._client.close()

    stop = close


def serve(address: str, options: list[str]) -> None:
    """Become a Dask worker, with the environment that the command line set for generated code.

    Args:
        address: the scheduler's.
        options: further words of the command ``dask worker``.

    Raises:
        RunError: if Dask is not installed, or nothing answers there.
    """
    if not any(word.startswith("--tls") for word in options):  # with certificates that only Dask's worker is given
        _client(address, _STARTING).close()
    os.execv(sys.executable, [sys.executable, "-m", "distributed.cli.dask_worker", address, *options])


def _client(address: str, patience: float, option: str = "") -> Any:
    """A client of the scheduler at an address, which has some seconds to answer.

    Raises:
        RunError: if Dask is not installed, or nothing answers there; the message names the option and the address.
    """
    distributed, failure = _imported(), ""
    try:
        return distributed.Client(address, timeout=patience, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        failure = str(error).split("\n")[0] or type(error).__name__
    # a client that did not connect closes itself when it is collected; left to chance, that may happen in a thread
    # whose start another client waits for, which then waits for ever
    gc.collect()
    raise RunError(f"{option}{address}: no scheduler answers there: {failure}; start one with `dask scheduler`")


def _imported() -> ModuleType:
    try:
        return import_module("distributed")
    except ImportError:
        raise RunError("Dask is not installed; pip install 'sphere-fit-study[cluster]'") from None


@dataclass(frozen=True)
class Workers:
    """The workers that compute a run.

    Attributes:
        backend: threads, loky (processes) or dask.
        jobs: number of threads or processes; a cluster has as many as it has.
        scheduler: address of a cluster's scheduler.
        task: seconds of work from which a cluster's task takes no more units; None for a fifth of a second.
    """

    backend: str = "threads"
    jobs: int = 2
    scheduler: str | None = None
    task: float | None = None

    @contextlib.contextmanager
    def open(self) -> Iterator[Threads]:
        """Start the workers, and end them.

        Raises:
            RunError: if there is no such backend, or its cluster cannot be reached.
        """
        if (self.backend == "dask") != (self.scheduler is not None):
            raise RunError("--scheduler: give the address of a scheduler with --backend dask, and only then")
        if self.task is not None and self.scheduler is None:
            raise RunError("--task: goes with --backend dask, and only with it")
        if self.backend not in ("threads", "loky", "dask"):
            raise RunError(f"--backend {self.backend}: known are threads, loky and dask")
        if self.scheduler is not None:
            backend: Threads = DaskCluster(self.scheduler, self.task)
        else:
            backend = Threads(self.jobs) if self.backend == "threads" else Processes(self.jobs)
        with contextlib.closing(backend):
            yield backend


def cut(items: Iterable[T], weigh: Callable[[T], float], enough: float) -> Iterator[tuple[T, ...]]:
    """Put items together that are sent to a worker at once.

    Args:
        items: the work.
        weigh: gives the weight of an item.
        enough: weight from which no more items are taken.

    Yields:
        The items, the heaviest first.
    """
    together: list[T] = []
    load = 0.0
    for item in sorted(items, key=weigh, reverse=True):
        together.append(item)
        load += weigh(item)
        if load >= enough:
            yield tuple(together)
            together, load = [], 0.0
    if together:
        yield tuple(together)


_WATCH = 1.0
"""Seconds after which the backend looks after its workers, if no result came."""
_NEEDS_LESS = "fewer workers (--jobs) or smaller units (fewer samples or cells) need less"
"""Remedy for too little memory."""
Ended = Callable[[tuple[T, ...], str], None]
"""Called with the items of a task that ended, and the reason why they were given up, or "" if they are stored."""


class Dispatch(Generic[S, T]):
    """Workers at work on items of one kind.

    Args:
        backend: the workers.
        function: called by a worker with the shared argument and a tuple of items.
        shared: the argument that all calls have in common.
        parts: where the results are stored.
    """

    def __init__(self, backend: Threads, function: Callable[[S, tuple[T, ...]], Packet], shared: S, parts: Parts):
        self._backend, self._parts, self._function, self._shared = backend, parts, function, shared
        self._suspects: deque[T] = deque()
        self._sent: dict[Future[object], tuple[tuple[T, ...], bool]] = {}  # the items, and true if they are suspects
        self._done: SimpleQueue[Future[object]] = SimpleQueue()
        self._broken = False

    def compute(
        self, items: Iterable[T], weigh: Callable[[T], float], ended: Ended[T], over: Callable[[], bool] = lambda: False
    ) -> None:
        """Compute items and store their results.

        Args:
            items: what to compute.
            weigh: gives the weight of an item.
            ended: called when a task ended.
            over: tells that no task is to be begun any more. What runs is waited for.

        Raises:
            RunError: if results cannot be written, or workers would compute other bytes than this process.
            Exception: what the function raised. What was finished is stored.
        """
        waiting = cut(items, weigh, self._backend.enough)
        try:
            while self._send(waiting, over):
                patience = self._parts.patience()
                try:
                    self._take(self._done.get(timeout=_WATCH if patience is None else min(patience, _WATCH)), ended)
                except Empty:
                    self._backend.check()
                    if self._parts.patience() == 0:
                        self._parts.commit()
        except BaseException as error:
            self._backend.stop()
            self._backend.close()
            if not isinstance(error, RunError):  # then the disk is full, or the results cannot be fetched
                self._store_rest()
            raise
        self._parts.commit()

    def _send(self, waiting: Iterator[tuple[T, ...]], over: Callable[[], bool]) -> bool:
        """Send tasks while there is work and the workers have room; false if none is computed."""
        while len(self._sent) < self._backend.slots and not over():
            if self._sent and (self._broken or (self._suspects and self._backend.alone)):
                break  # to be tried when nothing else runs
            if self._broken:
                self._backend.restart()
                self._broken = False
            again = bool(self._suspects)
            items = (self._suspects.popleft(),) if again else next(waiting, ())
            if not items:
                break
            try:
                future = self._backend.submit(self._function, self._shared, items)
            except BrokenExecutor:  # a process died just now; these items were not sent
                self._suspects.extendleft(reversed(items))
                self._broken = True
                continue
            self._sent[future] = items, again
            future.add_done_callback(self._done.put)
            if again and self._backend.alone:
                break
        return bool(self._sent)

    def _take(self, future: "Future[object]", ended: Ended[T]) -> None:
        """Store the result of a task, or look into its failure."""
        items, again = self._sent.pop(future)
        error = future.exception()
        if error is None:
            packet = future.result()
            assert isinstance(packet, Packet)
            self._parts.add(packet)
            ended(items, "")
        elif isinstance(error, self._backend.fatal):
            self._broken = self._broken or isinstance(error, BrokenExecutor)
            if again:
                ended(items, f"the worker died, twice: {_cause(error, self._backend.noticed)}")
            else:
                self._suspects += items
        elif isinstance(error, DisagreementError):
            raise RunError(f"{error}; start it as its parent was, with `study worker ADDRESS` for Dask")
        else:
            raise error

    def _store_rest(self) -> None:
        """Store the results that came and were not taken."""
        while not self._done.empty():
            future = self._done.get()
            if not future.cancelled() and future.exception() is None and isinstance(packet := future.result(), Packet):
                self._parts.add(packet)
        self._parts.commit()


def _cause(error: BaseException, noticed: str) -> str:
    """The cause of a worker's death in one line; a message may name the signals that ended workers."""
    message = noticed or str(error)
    if isinstance(error, MemoryError):
        return f"out of memory{f' ({message})' if message else ''}: {_NEEDS_LESS}"
    if set(re.findall(r"\bSIG[A-Z]+", message)) == {"SIGKILL"}:  # as the system does where memory runs out
        return f"killed (SIGKILL), perhaps for lack of memory: {_NEEDS_LESS}"
    return message.split("\n")[0]
