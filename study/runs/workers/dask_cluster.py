"""A Dask cluster as workers: tasks go to its scheduler, packets come back, and the cluster writes nothing."""

import math
import os
import sys
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

from study.runs.storage.atomic_write import RunError
from study.runs.storage.parts import Packet
from study.runs.workers import worker_entry
from study.runs.workers.dispatch import Pool, introduction

_PATIENCE = 10.0
"""Seconds to wait for a scheduler to answer."""


class Cluster(Pool):
    """Workers of a scheduler.

    Args:
        address: the scheduler's, such as ``tcp://login-node:8786``.

    Raises:
        RunError: if Dask is not installed, or nothing answers there.
    """

    alone = False  # the scheduler gives what else a dead worker had to others
    enough = 2e7

    def __init__(self, address: str) -> None:
        distributed = _imported()
        self._killed: type[BaseException] = distributed.KilledWorker
        self._parent = introduction(None)
        self._asked = -math.inf
        self._threads = 0
        try:
            self._client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError, ImportError) as error:
            words = str(error).split("\n")[0] or type(error).__name__
            raise RunError(f"--scheduler {address}: no scheduler answers there: {words}") from None

    @property
    def slots(self) -> int:  # type: ignore[override]
        """Two tasks for each thread of the workers that are there, asked for now and then."""
        now = time.monotonic()
        if now > self._asked + _PATIENCE:
            self._asked, self._threads = now, sum(self._client.nthreads().values())
        return max(2, 2 * self._threads)

    def submit(self, function: Callable[..., Packet], *arguments: Any) -> Any:
        call = worker_entry.seal(function, *arguments)
        return self._client.submit(worker_entry.enter, self._parent, call, pure=False)

    def died(self, error: BaseException) -> bool:
        return isinstance(error, self._killed | MemoryError)

    def close(self) -> None:
        self._client.close()


def serve(address: str, options: list[str]) -> None:
    """Be a Dask worker, with the environment that the command line made for generated code.

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
