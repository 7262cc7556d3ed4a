"""Where work is done: threads, processes of this machine (loky), or a Dask cluster, behind one loop.

Tasks are sent as workers become free, the heaviest of those in sight first, small ones together; results come back in
any order. A task that its worker does not survive costs nothing else: its items are tried once more, one by one, and
then given up. joblib's `Parallel` is not used, because it drops what was finished when one task fails.
"""

import contextlib
import heapq
import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

from study.runs import provenance
from study.runs.storage.atomic_write import RunError
from study.runs.storage.parts import Packet, Parts
from study.runs.workers import instruction_set, worker_entry

T = TypeVar("T")
_WINDOW = 1024
"""Items in sight, of which the heaviest goes first."""
_ENOUGH = 6e6
"""Weight of a task, some 80 ms: below it, what surrounds the work would count."""


@dataclass(frozen=True)
class Workers:
    """Who computes.

    Attributes:
        backend: threads, loky or dask.
        jobs: number of threads or processes; a cluster has as many as it has.
        scheduler: address of a cluster's scheduler.
    """

    backend: str = "threads"
    jobs: int = 2
    scheduler: str | None = None

    @contextlib.contextmanager
    def open(self) -> "Iterator[Pool]":
        """Start them, and end them.

        Raises:
            RunError: if there is no such backend, or its cluster cannot be reached.
        """
        if (self.backend == "dask") != (self.scheduler is not None):
            raise RunError("--scheduler: give the address of a scheduler with --backend dask, and only then")
        if self.backend == "dask":
            from study.runs.workers.dask_cluster import Cluster

            pool: Pool = Cluster(str(self.scheduler))
        elif self.backend in ("threads", "loky"):
            pool = Threads(self.jobs) if self.backend == "threads" else Processes(self.jobs)
        else:
            raise RunError(f"--backend {self.backend}: known are threads, loky and dask")
        try:
            yield pool
        finally:
            pool.close()


class Pool:
    """Runs calls somewhere.

    Attributes:
        alone: whether a worker's death takes the other tasks with it, so that a suspect must be tried alone.
        enough: weight that a task should have.
    """

    alone = True
    enough = _ENOUGH
    slots = 1

    def submit(self, function: Callable[..., Packet], *arguments: Any) -> "Future[Packet]":
        """Start a call."""
        raise NotImplementedError

    def died(self, error: BaseException) -> bool:
        """Whether an exception means that the worker did not survive."""
        return isinstance(error, BrokenExecutor | MemoryError)

    def restart(self) -> None:
        """Have workers again after some died."""

    def close(self) -> None:
        """End; what runs is not waited for, if it can be ended."""
        raise NotImplementedError


class Threads(Pool):
    """Threads of this process: the compiled loops release the interpreter's lock.

    None is the main thread, where Ctrl-C could strike inside compiled code that cannot take it.
    """

    def __init__(self, jobs: int) -> None:
        self.slots = 2 * jobs
        self._pool = ThreadPoolExecutor(jobs)

    def submit(self, function: Callable[..., Packet], *arguments: Any) -> "Future[Packet]":
        return self._pool.submit(function, *arguments)

    def close(self) -> None:
        self._pool.shutdown(cancel_futures=True)


class Processes(Pool):
    """Processes of this machine."""

    def __init__(self, jobs: int) -> None:
        self.slots = 2 * jobs
        self._jobs = jobs
        self._parent = introduction(os.getpid())
        self.restart()

    def submit(self, function: Callable[..., Packet], *arguments: Any) -> "Future[Packet]":
        call: Future[Packet] = self._pool.submit(
            worker_entry.enter, self._parent, worker_entry.seal(function, *arguments)
        )
        return call

    def restart(self) -> None:
        from joblib.externals.loky import ProcessPoolExecutor

        self._pool = ProcessPoolExecutor(self._jobs, env=instruction_set.environment())

    def close(self) -> None:
        with _quiet("ExecutorManagerThread"):
            self._pool.shutdown(kill_workers=True)


@contextlib.contextmanager
def _quiet(name: str) -> Iterator[None]:
    """Say nothing of what ends threads of a name: loky's can lose a race with the end of its own executor."""
    told = threading.excepthook
    threading.excepthook = lambda args: None if args.thread and args.thread.name == name else told(args)
    try:
        yield
    finally:
        threading.excepthook = told


def introduction(process: int | None) -> dict[str, Any]:
    """What a worker process is told of its parent.

    Args:
        process: the parent's number, if it is on the same machine and the worker is to end with it.
    """
    return {
        "environment": instruction_set.environment(),
        "fingerprint": provenance.fingerprint(),
        "process": process,
    }


@dataclass(frozen=True)
class Task(Generic[T]):
    """Items that are sent together, and how often they were."""

    items: tuple[T, ...]
    tries: int = 1


@dataclass(frozen=True)
class Done(Generic[T]):
    """What became of a task: its packet, or why there is none."""

    items: tuple[T, ...]
    packet: Packet | None
    message: str = ""


class Crew(Generic[T]):
    """A pool at work on the items of one call.

    Args:
        pool: the workers.
        function: called with the shared argument and a tuple of items.
        shared: what every call is given.
    """

    def __init__(self, pool: Pool, function: Callable[[Any, tuple[T, ...]], Packet], shared: Any) -> None:
        self._pool = pool
        self._call = function, shared
        self._running: dict[Any, Task[T]] = {}
        self._ended: SimpleQueue[Any] = SimpleQueue()
        self._suspects: deque[Task[T]] = deque()
        self._broken = False

    def results(
        self,
        items: Iterable[T],
        weigh: Callable[[T], float],
        patience: Callable[[], float | None],
        over: Callable[[], bool] = lambda: False,
    ) -> Generator[Done[T] | None]:
        """Compute items.

        Args:
            items: what to compute; taken as needed.
            weigh: the work that an item is.
            patience: seconds to wait for a result.
            over: whether no more is to be begun; what runs is waited for.

        Yields:
            What becomes of each task; None when patience ends before.
        """
        tasks = _tasks(items, weigh, self._pool.enough)
        while True:
            if not over():
                self._send(tasks)
            if not self._running:
                return
            try:
                ended = self._ended.get(timeout=patience())
            except Empty:
                yield None
                continue
            task = self._running.pop(ended)
            error = ended.exception()
            if error is None:
                yield Done(task.items, ended.result())
            elif isinstance(error, worker_entry.DisagreementError):
                raise RunError(f"{error}; start it as its parent was, with `study worker ADDRESS` for Dask") from None
            elif not self._pool.died(error):
                raise error
            else:
                self._broken = True
                yield from self._suspect(task, error)

    def _suspect(self, task: Task[T], error: BaseException) -> Iterator[Done[T]]:
        """Give up a task that its worker did not survive alone, twice; else try its items once more, one by one."""
        if task.tries > 1 and len(task.items) == 1:
            yield Done(task.items, None, f"the worker died, twice: {error}".split("\n")[0])
        else:
            self._suspects += [Task((item,), task.tries + 1) for item in task.items]

    def rest(self) -> Iterator[Done[T]]:
        """End early: what has not begun is left out, what was finished comes back, what runs only if it must."""
        yield from self._finished()
        self._pool.close()
        yield from self._finished()  # threads cannot be ended

    def _finished(self) -> Iterator[Done[T]]:
        for future in [future for future in self._running if future.done()]:
            task = self._running.pop(future)
            if not future.cancelled() and future.exception() is None:
                yield Done(task.items, future.result())

    def _send(self, tasks: Iterator[Task[T]]) -> None:
        if self._suspects and self._pool.alone:
            if not self._running:  # a death now has one possible cause
                if self._broken:
                    self._pool.restart()
                    self._broken = False
                self._start(self._suspects.popleft())
            return
        while len(self._running) < self._pool.slots:
            task = self._suspects.popleft() if self._suspects else next(tasks, None)
            if task is None or not self._start(task):
                return

    def _start(self, task: Task[T]) -> bool:
        """Start a task; False if that must wait, because a worker has died meanwhile, and others run that will fail."""
        function, shared = self._call
        try:
            future = self._pool.submit(function, shared, task.items)
        except BrokenExecutor:
            if self._running:
                self._suspects.appendleft(task)
                return False
            self._pool.restart()
            future = self._pool.submit(function, shared, task.items)
        self._running[future] = task
        future.add_done_callback(self._ended.put)
        return True


@contextlib.contextmanager
def kept(crew: Crew[Any], parts: Parts) -> Iterator[None]:
    """Store what a crew has finished, however its work ends."""
    try:
        yield
    except RunError:  # the disk takes no more, or the workers are not what they should be
        raise
    except BaseException:
        for done in crew.rest():
            if done.packet is not None:
                parts.add(done.packet)
        parts.commit()
        raise
    parts.commit()


def _tasks(items: Iterable[T], weigh: Callable[[T], float], enough: float) -> Iterator[Task[T]]:
    """Items as tasks, the heaviest of those in sight first."""
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
            yield Task(tuple(together))
            together, load = [], 0.0
    if together:
        yield Task(tuple(together))
