"""Processes of this machine as workers, by joblib's loky backend.

joblib keeps the processes for the next run of the same program, and ends them after five idle minutes or with the
program. If the program is killed, they end themselves (`worker_entry.follow`).

loky notices the death of a process, unless it dies while it sends a result: then loky waits for the other half of the
result for ever, and the other processes for the lock that the dead one holds. `Processes.check` ends that.
"""

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import wait

from joblib import delayed
from joblib.externals.loky.backend.utils import kill_process_tree

from study.runs.workers.backend import Backend, Call, introduction
from study.runs.workers.worker_entry import enter, follow, seal

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
