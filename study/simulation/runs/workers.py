"""Workers of a run: threads, processes of this machine or a Dask cluster, and the dispatch of work to them.

joblib dispatches. Three things are done here because it does not do them:

- Items of work are put together until they weigh enough to be sent (`cut`), and handed to joblib one call at a time as
  it asks for them. A round of joblib ends early, and another begins, when items are suspected, when results wait to be
  stored, or when the cluster has grown.
- Results are stored when they come, or a second later. joblib's results are fetched in a thread of their own, so that
  the main thread can write what waits while nothing comes, and Ctrl-C strikes no code of joblib's. Whatever ends the
  work, what was finished is stored.
- When a process dies, joblib gives up all tasks that it was sent. They become suspects: each of their items is tried
  once more while nothing else runs, and given up if a process dies of it again. A death that joblib does not notice is
  the backend's to find; it is asked every second in which no result comes.

Equal runs are equal to the byte only if the same code runs on the same machine instructions. So the parent sends its
own description with every task, and a worker compares itself with it before its first one (`enter`). Variables that
choose the instructions must be set before numba and NumPy are imported, which unpickling a task does; so the task comes
pickled by itself, as bytes. An exception comes back as a value: joblib would give up all tasks for one that raises, and
forget what was finished.

Threads start at once, and the compiled loops release the interpreter's lock. No task runs in the main thread, where
Ctrl-C could strike inside compiled code that cannot take it: numba 0.68 ends the process with a segmentation fault if
an exception rises while it unboxes a generator. (joblib computes in the calling thread where there is but one worker;
`Dispatch` calls it from a thread of its own.)

Processes are loky's. joblib keeps them for the next run of the same program, and ends them after five idle minutes or
with the program; if that is killed, they end themselves (`follow`). loky notices the death of a process, unless it dies
while it sends a result: then loky waits for the other half of the result for ever, and the other processes for the lock
that the dead one holds. `Processes.check` ends that.

A Dask cluster gets tasks through its scheduler, and writes nothing. It is joined to joblib by an interface of joblib's,
`ParallelBackendBase`. joblib's own Dask backend (1.6) does not serve: where a task has killed its workers more often
than the scheduler allows, its future fails, and that backend waits for it for ever; where the cluster has one thread,
or one yet, it computes in the parent instead; and it gives up after ten seconds without a worker. A batch system starts
its workers when it pleases.
"""

import contextlib
import gc
import heapq
import logging
import math
import os
import pickle
import re
import signal
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from itertools import count
from multiprocessing.connection import wait
from queue import Empty, SimpleQueue
from typing import Any, Generic, NamedTuple, TypeVar

from joblib import Parallel, delayed
from joblib.externals.loky.backend.utils import kill_process_tree
from joblib.parallel import ParallelBackendBase

from study import instruction_set
from study.files import RunError
from study.fits import registry
from study.simulation.runs import provenance
from study.simulation.runs.parts import Packet, Parts

R = TypeVar("R")


class DisagreementError(Exception):
    """A worker would compute other bytes than its parent; the message says where they differ."""


class Parent(NamedTuple):
    """Description of the process that gives out tasks.

    Attributes:
        environment: variables that choose the machine instructions.
        fingerprint: what determines the bytes of a run; see `study.simulation.runs.provenance.fingerprint`.
        plugins: paths and texts of the files of estimators that it has loaded.
    """

    environment: dict[str, str]
    fingerprint: dict[str, str | None]
    plugins: tuple[tuple[str, str], ...] = ()


NEEDS_LESS = "fewer workers (--jobs) or smaller units (fewer samples or cells) need less"
"""Remedy for too little memory."""


class Death(NamedTuple):
    """Result of a task whose worker died, or had too little memory."""

    message: str


_agreed: list[Parent] = []
_agreeing = threading.Lock()
"""A Dask worker with many threads gets as many first tasks at once."""
_SYNCHRONIZE, _FOREVER = 0x00100000, 0xFFFFFFFF
"""Windows: the right to wait for a process, and a wait without an end."""


def follow(parent: int) -> None:
    """Bind this process to its parent's life; the first thing that a process of this machine does.

    A terminal sends Ctrl-C to the workers, too; they ignore it, and the parent ends them. If it is killed, they end
    themselves, also while they wait for a first task.

    Args:
        parent: number of the parent process.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def seal(function: Callable[..., object], *arguments: object) -> bytes:
    """Pickle a call for `enter`."""
    return pickle.dumps((function, arguments))


def enter(number: int, parent: Parent, call: bytes) -> tuple[int, object]:
    """Make a call in a worker process.

    Args:
        number: of the task; it comes back with the result.
        parent: the process that gives out tasks.
        call: the call; see `seal`.

    Returns:
        The number, and the result as `attempt` has it, or a `DisagreementError` if this process would compute other
        bytes than its parent.
    """
    with _agreeing:
        if parent not in _agreed:
            try:
                _agree(parent)
            except DisagreementError as error:
                return number, error
            _agreed.append(parent)
    function, arguments = pickle.loads(call)
    result = attempt(number, function, *arguments)
    if isinstance(result[1], Exception):
        result[1].add_note("".join(traceback.format_exception(result[1])))  # pickling leaves the traceback out
    return result


def attempt(number: int, function: Callable[..., R], *arguments: object) -> tuple[int, R | Death | Exception]:
    """Call a function.

    Args:
        number: of the task.
        function: what to call.
        arguments: of the function.

    Returns:
        The number, and what the function returned, or the exception that it raised; a `Death` for want of memory.
    """
    try:
        return number, function(*arguments)
    except MemoryError as error:
        return number, Death(f"out of memory{f' ({error})' if str(error) else ''}: {NEEDS_LESS}")
    except Exception as error:
        return number, error


def _agree(parent: Parent) -> None:
    """Set up this process as its parent is; DisagreementError if that cannot be."""
    if "numba" not in sys.modules:
        os.environ.update(parent.environment)
    from threadpoolctl import threadpool_limits

    from study.simulation.runs.provenance import fingerprint

    mine, wanted = fingerprint(), parent.fingerprint
    differ = [
        f"{name} {mine.get(name)} instead of {wanted.get(name)}" for name in wanted if mine.get(name) != wanted[name]
    ]
    if differ:
        import socket

        raise DisagreementError(f"worker on {socket.gethostname()}: {', '.join(differ)}")
    threadpool_limits(limits=1)
    logging.getLogger("study").setLevel(logging.ERROR)  # the parent says once that loops are compiled
    if parent.plugins:
        from study.fits.registry import PluginFile, load_text

        for path, text in parent.plugins:
            load_text(PluginFile(path, text))


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


Call = tuple[Callable[..., object], tuple[object, ...], dict[str, object]]
"""A call as `joblib.delayed` has it."""

PER_SECOND = 1e8
"""Weight that one worker computes in about a second."""


class Backend:
    """Workers of one kind.

    Args:
        slots: number of tasks that are computed or wait for a worker at a time.
        options: arguments of `joblib.Parallel` that choose the workers.

    Attributes:
        alone: true if tasks share a fate: the death of one worker ends the others, or all share their memory. Then a
            task that may be fatal is tried while nothing else runs.
        enough: weight below which items are put together to a task.
        parallel: the dispatcher. It returns results as they come, and sends each task by itself.
        noticed: how a worker ended whose death the dispatcher does not notice; empty if there is none.
        stopped: set when no task is to be begun any more.
    """

    alone = True
    noticed = ""
    enough = 6e6  # some 80 ms, beside which sending a task costs little

    def __init__(self, slots: int | str, **options: object) -> None:
        self._options: dict[str, Any] = {
            "pre_dispatch": slots,
            "return_as": "generator_unordered",
            "batch_size": 1,
            **options,
        }
        self.stopped = threading.Event()
        self._open = contextlib.ExitStack()
        self.restart()

    def restart(self) -> None:
        """Begin with a new dispatcher, and new workers where some have died."""
        self._open.close()
        self.parallel = self._open.enter_context(Parallel(**self._options))

    def call(self, number: int, function: Callable[..., object], *arguments: object) -> Call:
        """Describe a call of a worker for the dispatcher; its result is that of `worker_entry.attempt`."""
        described: Call = delayed(attempt)(number, function, *arguments)
        return described

    @property
    def slots(self) -> int:
        """Number of tasks that are computed or wait for a worker at a time."""
        return int(self._options["pre_dispatch"])

    def outgrown(self) -> bool:
        """Tell whether there are many more workers than the dispatcher counted when its call began."""
        return False

    def check(self) -> None:
        """Look after the workers; called now and then while results are awaited."""

    def stop(self) -> None:
        """Begin no task any more, and end those that run, if they can be ended."""
        self.close()

    def close(self) -> None:
        """End the dispatcher, and with it what runs."""
        self.stopped.set()
        self._open.close()


def introduction() -> Parent:
    """Describe this process to worker processes."""
    return Parent(instruction_set.environment(), provenance.fingerprint(), registry.loaded())


def leave_interrupts() -> None:
    """Let this thread, and the processes that it starts, leave Ctrl-C to the main thread.

    A terminal sends it to all processes. One that just starts, and cannot yet ignore it, would print a traceback; but
    it has the signals blocked that its parent's thread had blocked.
    """
    if hasattr(signal, "pthread_sigmask"):  # not on Windows
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


_PATIENCE = 10.0
"""Seconds to wait for a scheduler to answer, and between two counts of its workers."""


class DaskCluster(Backend):
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
        distributed, failure = _imported(), ""
        try:
            self._client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError, ImportError) as error:
            failure = str(error).split("\n")[0] or type(error).__name__
        if failure:
            # a client that did not connect closes itself when it is collected; left to chance, that may happen in a
            # thread whose start another client waits for, which then waits for ever
            gc.collect()
            raise RunError(f"--scheduler {address}: no scheduler answers there: {failure}")
        self._parent = introduction()
        self._scheduler = _SchedulerBackend(self._client, distributed.KilledWorker)
        super().__init__("2 * n_jobs", backend=self._scheduler)

    def call(self, number: int, function: Callable[..., object], *arguments: object) -> Call:
        described: Call = delayed(enter)(number, self._parent, seal(function, *arguments))
        return described

    @property
    def slots(self) -> int:
        return 2 * self._scheduler.counted

    def outgrown(self) -> bool:
        return self._scheduler.threads() > 1.5 * self._scheduler.counted

    def close(self) -> None:
        super().close()
        self._client.close()


class _SchedulerBackend(ParallelBackendBase):  # type: ignore[misc]  # joblib has no types
    """A Dask scheduler as joblib sees it.

    Args:
        client: connected to the scheduler.
        killed: the exception of a task that killed its workers.

    Attributes:
        counted: threads of the workers when a call began, two at least: with one, joblib would compute by itself.
    """

    supports_retrieve_callback = True

    def __init__(self, client: Any, killed: type[Exception]) -> None:
        super().__init__(nesting_level=0)
        self._client, self._killed = client, killed
        self._numbers: dict[Any, int] = {}
        self._asked = -math.inf
        self._threads = 0
        self.counted = 2

    def threads(self) -> int:
        """Threads of the workers, counted now and then."""
        now = time.monotonic()
        if now > self._asked + _PATIENCE:
            self._asked, self._threads = now, sum(self._client.nthreads().values())
        return self._threads

    def effective_n_jobs(self, n_jobs: int) -> int:
        self.counted = max(2, self.threads())
        return self.counted

    def submit(self, func: Any, callback: Callable[[Any], None]) -> Any:
        # the call itself, not joblib's batch of one: loading joblib in a worker would load NumPy before `enter` can act
        ((function, arguments, _),) = func.items
        future = self._client.submit(function, *arguments, pure=False)
        self._numbers[future] = arguments[0]
        future.add_done_callback(callback)
        return future

    def retrieve_result_callback(self, future: Any) -> list[tuple[int, object]]:
        number = self._numbers.pop(future)
        try:
            return [future.result()]
        except self._killed as error:
            return [(number, Death(str(error)))]


def serve(address: str, options: list[str]) -> None:
    """Become a Dask worker, with the environment that the command line set for generated code.

    Args:
        address: the scheduler's.
        options: further words of the command ``dask worker``.

    Raises:
        RunError: if Dask is not installed.
    """
    _imported()
    os.execv(sys.executable, [sys.executable, "-m", "distributed.cli.dask_worker", address, *options])


def _imported() -> Any:
    try:
        return import_module("distributed")
    except ImportError:
        raise RunError("Dask is not installed; pip install 'sphere-fit-study[cluster]'") from None


_GRACE = 3.0
"""Seconds that loky has to notice that a process died. It is woken by that, and takes milliseconds."""


class Processes(Backend):
    """Processes of this machine.

    Args:
        jobs: number of processes that compute at a time. For one, tasks are sent one at a time to two, because
            joblib would compute in this very process if it were told to use one, and a task could kill it.
    """

    def __init__(self, jobs: int) -> None:
        slots = 2 * jobs if jobs > 1 else 1
        super().__init__(slots, backend="loky", n_jobs=max(2, jobs), initializer=follow, initargs=(os.getpid(),))
        self._parent = introduction()
        self._dead_since: float | None = None

    def call(self, number: int, function: Callable[..., object], *arguments: object) -> Call:
        described: Call = delayed(enter)(number, self._parent, seal(function, *arguments))
        return described

    def check(self) -> None:
        """Break loky's executor if a process has died and loky has not noticed: it waits for half a result."""
        if sys.platform == "win32":  # messages are whole there
            return
        executor = self.parallel._backend._workers
        if executor is None:  # loky noticed, and joblib is about to replace it
            return
        processes = list(executor._processes.values())  # a copy, since loky's thread changes it
        if executor._flags.broken is not None or not wait([process.sentinel for process in processes], timeout=0):
            self._dead_since = None
        elif self._dead_since is None:
            self._dead_since = time.monotonic()
        elif time.monotonic() - self._dead_since > _GRACE:
            codes = [code for process in processes if (code := process.exitcode) is not None]
            names = (signal.Signals(-code).name if code < 0 else f"exit code {code}" for code in codes)
            self.noticed = f"a process ended while it sent a result: {', '.join(names)}"
            for process in processes:
                kill_process_tree(process)
            with open(os.devnull, "wb") as null:  # in place of the last writer: loky reads the end
                os.dup2(null.fileno(), executor._result_queue._writer.fileno())

    def close(self) -> None:
        with _quiet("ExecutorManagerThread"):
            super().close()

    def restart(self) -> None:
        self._dead_since, self.noticed = None, ""
        with _quiet("ExecutorManagerThread"):
            super().restart()


@contextlib.contextmanager
def _quiet(name: str) -> Iterator[None]:
    """Do not print what threads of a name raise: loky's can lose a race with the end of its own executor."""
    before = threading.excepthook
    threading.excepthook = lambda args: None if args.thread and args.thread.name == name else before(args)
    try:
        yield
    finally:
        threading.excepthook = before


class Threads(Backend):
    """Threads of this process.

    Args:
        jobs: number of threads.
    """

    def __init__(self, jobs: int) -> None:
        super().__init__(2 * jobs, backend="threading", n_jobs=jobs)

    def call(self, number: int, function: Callable[..., object], *arguments: object) -> Call:
        described: Call = delayed(self._unless_stopped)(number, function, *arguments)
        return described

    def _unless_stopped(self, number: int, function: Callable[..., object], *arguments: object) -> tuple[int, object]:
        return (number, None) if self.stopped.is_set() else attempt(number, function, *arguments)

    def stop(self) -> None:
        self.stopped.set()  # a thread cannot be ended: tasks that run are waited for, those that wait do nothing


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
    def open(self) -> Iterator[Backend]:
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
            backend: Backend = DaskCluster(self.scheduler, self.task)
        else:
            backend = Threads(self.jobs) if self.backend == "threads" else Processes(self.jobs)
        with contextlib.closing(backend):
            yield backend


T = TypeVar("T")
_WINDOW = 1024
"""Items in sight, of which the heaviest goes first."""


def cut(items: Iterable[T], weigh: Callable[[T], float], enough: float) -> Iterator[tuple[T, ...]]:
    """Put items together that are sent to a worker at once.

    Args:
        items: the work; taken as needed.
        weigh: gives the weight of an item.
        enough: weight from which no more items are taken.

    Yields:
        The items, the heaviest in sight first.
    """
    number = count()
    source = ((-weigh(item), next(number), item) for item in items)
    sight: list[tuple[float, int, T]] = []
    together: list[T] = []
    load = 0.0
    while True:
        while len(sight) < _WINDOW and (entry := next(source, None)) is not None:
            heapq.heappush(sight, entry)
        if not sight:
            break
        lightness, _, item = heapq.heappop(sight)
        together.append(item)
        load -= lightness
        if load >= enough:
            yield tuple(together)
            together, load = [], 0.0
    if together:
        yield tuple(together)


S = TypeVar("S")
_WATCH = 1.0
"""Seconds after which the backend looks after its workers, if no result came."""
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

    def __init__(
        self, backend: Backend, function: Callable[[S, tuple[T, ...]], Packet], shared: S, parts: Parts
    ) -> None:
        self._backend, self._parts = backend, parts
        self._function, self._shared = function, shared
        self._waiting: Iterator[tuple[T, ...]] = iter(())
        self._suspects: deque[T] = deque()
        self._sent: dict[int, tuple[tuple[T, ...], bool]] = {}  # the items of a call, and true if they are suspects
        self._count = 0
        self._results: SimpleQueue[tuple[int, object] | Future[None]] = SimpleQueue()

    def compute(
        self,
        items: Iterable[T],
        weigh: Callable[[T], float],
        ended: Ended[T],
        over: Callable[[], bool] = lambda: False,
    ) -> None:
        """Compute items and store their results.

        Args:
            items: what to compute; taken as needed.
            weigh: gives the weight of an item.
            ended: called when a task ended.
            over: tells that no task is to be begun any more. What runs is waited for.

        Raises:
            RunError: if results cannot be written, or workers would compute other bytes than this process.
            Exception: what the function raised. What was finished is stored.
        """
        self._waiting = cut(items, weigh, self._backend.enough)
        with ThreadPoolExecutor(1, initializer=leave_interrupts) as fetcher:
            try:
                while self._call(fetcher, ended, over):
                    pass
            except BaseException as error:
                self._backend.stop()
                fetcher.shutdown()
                if not isinstance(error, RunError):  # then the disk is full, or the results cannot be fetched
                    self._store_rest()
                raise
        self._parts.commit()

    def _call(self, fetcher: ThreadPoolExecutor, ended: Ended[T], over: Callable[[], bool]) -> bool:
        """Let joblib compute until it runs out of tasks; False if there was none."""
        before = self._count
        call = fetcher.submit(self._fetch, self._next_tasks(over))
        call.add_done_callback(self._results.put)
        while True:
            patience = self._parts.patience()
            try:
                result = self._results.get(timeout=_WATCH if patience is None else min(patience, _WATCH))
            except Empty:
                self._backend.check()
                if self._parts.patience() == 0:
                    self._parts.commit()
                continue
            if isinstance(result, Future):
                break
            self._take(*result, ended)
        error = call.exception()
        if isinstance(error, BrokenExecutor):
            message = self._backend.noticed or str(error)
            self._backend.restart()
            for number in list(self._sent):
                self._suspect(number, message, ended)
        elif error is not None:
            raise error
        return self._count > before

    def _fetch(self, tasks: Iterator[Call]) -> None:
        for result in self._backend.parallel(tasks):
            self._results.put(result)

    def _next_tasks(self, over: Callable[[], bool]) -> Iterator[Call]:
        """Tasks for one call of joblib, which asks for them from threads of its own, one at a time."""
        alone, before = bool(self._suspects) and self._backend.alone, self._count
        while not (over() or self._backend.stopped.is_set()):
            if self._count > before and (alone or self._should_pause()):
                return
            again = bool(self._suspects)
            items = (self._suspects.popleft(),) if again else next(self._waiting, ())
            if not items:
                return
            self._count += 1
            self._sent[self._count] = items, again
            yield self._backend.call(self._count, self._function, self._shared, items)

    def _should_pause(self) -> bool:
        """Tell whether the tasks that were sent should end before others are sent.

        Memory would fill up with results if they came faster than they are stored; joblib itself holds up to one and a
        half times as many tasks as there are slots.
        """
        suspicion = bool(self._suspects) and self._backend.alone  # to be tried when nothing else runs
        crowded = len(self._sent) > 2 * max(2, self._backend.slots)
        return suspicion or crowded or self._backend.outgrown()

    def _take(self, number: int, result: object, ended: Ended[T]) -> None:
        if isinstance(result, Packet):
            items, _ = self._sent.pop(number)
            self._parts.add(result)
            ended(items, "")
        elif isinstance(result, Death):
            self._suspect(number, result.message, ended)
        elif isinstance(result, DisagreementError):
            raise RunError(f"{result}; start it as its parent was, with `study worker ADDRESS` for Dask")
        elif isinstance(result, Exception):
            raise result

    def _suspect(self, number: int, message: str, ended: Ended[T]) -> None:
        """Try the items of a call one by one, or give up the one item that a worker died of twice."""
        items, again = self._sent.pop(number)
        if again:
            ended(items, f"the worker died, twice: {_cause(message)}")
        else:
            self._suspects += items

    def _store_rest(self) -> None:
        """Store the results that came and were not taken."""
        while not self._results.empty():
            result = self._results.get()
            if not isinstance(result, Future) and isinstance(result[1], Packet):
                self._parts.add(result[1])
        self._parts.commit()


def _cause(message: str) -> str:
    """The cause of a worker's death in one line, from a message that may name the signals that ended workers."""
    if set(re.findall(r"\bSIG[A-Z]+", message)) == {"SIGKILL"}:  # as the system does where memory runs out
        return f"killed (SIGKILL), perhaps for lack of memory: {NEEDS_LESS}"
    return message.split("\n")[0]
