"""Dispatch of work to workers, whose results are stored as they come. joblib sends the tasks and brings the results.

Three things are done here because joblib does not do them:

- Tasks are cut (`tasks`) and handed to joblib one by one as it asks for them. A call of joblib ends early, and another
  begins, when a task is suspected, when results wait to be stored, or when the cluster has grown.
- Results are stored when they come, or a second later. joblib's results are fetched in a thread of their own, so that
  the main thread can write what waits while nothing comes, and Ctrl-C strikes no code of joblib's. Whatever ends the
  work, what was finished is stored.
- When a process dies, joblib gives up all tasks that it was sent. They become suspects: each of their items is tried
  once more while nothing else runs, and given up if a process dies of it again. A death that joblib does not notice is
  the backend's to find; it is asked every second in which no result comes.
"""

import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from study.runs.storage.atomic_write import RunError
from study.runs.storage.parts import Packet, Parts
from study.runs.workers.backend import Backend, Call, leave_interrupts
from study.runs.workers.tasks import WorkerTask, cut
from study.runs.workers.worker_entry import NEEDS_LESS, Death, DisagreementError

T = TypeVar("T")
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
        self._tasks: Iterator[WorkerTask[T]] = iter(())
        self._suspects: deque[WorkerTask[T]] = deque()
        self._sent: dict[int, WorkerTask[T]] = {}
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
        self._tasks = cut(items, weigh, self._backend.enough)
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
                self._suspect(self._sent.pop(number), message, ended)
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
            task = self._suspects.popleft() if self._suspects else next(self._tasks, None)
            if task is None:
                return
            self._count += 1
            self._sent[self._count] = task
            yield self._backend.call(self._count, self._function, self._shared, task.items)

    def _should_pause(self) -> bool:
        """Tell whether the tasks that were sent should end before others are sent."""
        suspicion = bool(self._suspects) and self._backend.alone  # to be tried when nothing else runs
        return suspicion or self._crowded() or self._backend.outgrown()

    def _crowded(self) -> bool:
        """Tell whether results come faster than they are stored, so that memory would fill up with them.

        joblib itself holds up to one and a half times as many tasks as there are slots.
        """
        return len(self._sent) > 2 * max(2, self._backend.slots)

    def _take(self, number: int, result: object, ended: Ended[T]) -> None:
        task = self._sent.pop(number)
        if isinstance(result, Packet):
            self._parts.add(result)
            ended(task.items, "")
        elif isinstance(result, Death):
            self._suspect(task, result.message, ended)
        elif isinstance(result, DisagreementError):
            raise RunError(f"{result}; start it as its parent was, with `study worker ADDRESS` for Dask")
        elif isinstance(result, Exception):
            raise result

    def _suspect(self, task: WorkerTask[T], message: str, ended: Ended[T]) -> None:
        """Try the items of a task alone, or give up the one item that a worker died of twice."""
        if task.tries > 1:
            ended(task.items, f"the worker died, twice: {_cause(message)}")
        else:
            self._suspects += task.alone()

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
