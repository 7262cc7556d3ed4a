"""Threads of this process as workers, by joblib's threading backend. They start at once.

The compiled loops release the interpreter's lock. No task runs in the main thread, where Ctrl-C could strike inside
compiled code that cannot take it: numba 0.68 ends the process with a segmentation fault if an exception rises while it
unboxes a generator. (joblib computes in the calling thread where there is but one worker; `dispatch` calls it from a
thread of its own.)
"""

from collections.abc import Callable

from joblib import delayed

from study.runs.workers.backend import Backend, Call
from study.runs.workers.worker_entry import attempt


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
