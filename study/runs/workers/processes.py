"""Processes of this machine as workers, by joblib's loky backend.

joblib keeps the processes for the next run of the same program, and ends them after five idle minutes or with the
program. If the program is killed, they end themselves (`worker_entry`).
"""

import contextlib
import os
import threading
from collections.abc import Callable, Iterator

from joblib import delayed

from study.runs.workers.backend import Backend, Call, introduction
from study.runs.workers.worker_entry import enter, seal


class Processes(Backend):
    """Processes of this machine.

    Args:
        jobs: number of processes that compute at a time. One is had by sending one task at a time to two, because
            joblib would compute in this very process if it were told to use one, and a task could kill it.
    """

    def __init__(self, jobs: int) -> None:
        super().__init__(2 * jobs if jobs > 1 else 1, backend="loky", n_jobs=max(2, jobs))
        self._parent = introduction(os.getpid())

    def call(self, number: int, function: Callable[..., object], *arguments: object) -> Call:
        described: Call = delayed(enter)(number, self._parent, seal(function, *arguments))
        return described

    def close(self) -> None:
        with _quiet("ExecutorManagerThread"):
            super().close()

    def restart(self) -> None:
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
