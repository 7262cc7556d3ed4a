"""A Dask cluster as workers: tasks go to its scheduler, results come back, and the cluster writes nothing.

joblib dispatches, through its interface for further backends, `ParallelBackendBase`. joblib's own Dask backend
(1.6) does not serve: where a task has killed its workers more often than the scheduler allows, its future fails, and
that backend waits for it for ever; where the cluster has one thread, or one yet, it computes in the parent instead; and
it gives up after ten seconds without a worker. A batch system starts its workers when it pleases.
"""

import gc
import math
import os
import sys
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

from joblib import delayed
from joblib.parallel import ParallelBackendBase

from study.runs.storage.atomic_write import RunError
from study.runs.workers.backend import PER_SECOND, Backend, Call, introduction
from study.runs.workers.worker_entry import Death, enter, seal

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
