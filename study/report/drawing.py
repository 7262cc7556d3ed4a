"""Draw pictures in parallel with other work: in a second process if one is allowed, else at once."""

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class Artist:
    """Call functions, in another process if there is one, and return their results later.

    Args:
        executor: another process; None to call each function at once.
    """

    def __init__(self, executor: Executor | None) -> None:
        self._executor = executor

    def begin(self, function: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> Callable[[], T]:
        """Begin a call; the function that is returned waits for the result and returns it.

        For another process the function, its arguments and its result must be such that they can be pickled.
        """
        if self._executor is None:
            found = function(*arguments, **named)
            return lambda: found
        future = self._executor.submit(function, *arguments, **named)

        def wait() -> T:
            try:
                return future.result()
            except BrokenProcessPool:  # for want of memory, perhaps
                return function(*arguments, **named)

        return wait


@contextmanager
def artist(jobs: int) -> Iterator[Artist]:
    """An artist with a process of its own, if two are allowed; the process ends with the artist.

    The other process loads the libraries by itself; that takes as long as two figures.
    """
    if jobs < 2:
        yield Artist(None)
        return
    context = multiprocessing.get_context("spawn")  # a fork of a process with threads may wait for ever
    with ProcessPoolExecutor(1, context, _ignore_interrupt) as executor:
        try:
            yield Artist(executor)
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise


def _ignore_interrupt() -> None:
    """Leave Ctrl-C, which a terminal sends to both processes, to the other one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
