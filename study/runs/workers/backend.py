"""The base of the backends: workers of one kind, and the joblib dispatcher that feeds them."""

import contextlib
import signal
import threading
from collections.abc import Callable
from typing import Any

from joblib import Parallel, delayed

from study.estimators.own import plugin_file
from study.runs import provenance
from study.runs.workers.worker_entry import Parent, attempt
from study.text import instruction_set

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
    return Parent(instruction_set.environment(), provenance.fingerprint(), plugin_file.loaded())


def leave_interrupts() -> None:
    """Let this thread, and the processes that it starts, leave Ctrl-C to the main thread.

    A terminal sends it to all processes. One that just starts, and cannot yet ignore it, would print a traceback; but
    it has the signals blocked that its parent's thread had blocked.
    """
    if hasattr(signal, "pthread_sigmask"):  # not on Windows
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
