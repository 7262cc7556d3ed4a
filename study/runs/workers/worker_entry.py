"""Worker entry point; it rejects a mismatched environment. It imports nothing heavy.

Equal runs are equal to the byte only if the same code runs on the same machine instructions. So the parent sends its
own description with every task, and a worker compares itself with it before its first one. Variables that choose the
instructions must be set before numba and NumPy are imported, which unpickling a task does; so the task comes pickled
by itself, as bytes.

An exception comes back as a value: joblib would give up all tasks for one that raises, and forget what was finished.
"""

import logging
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from typing import NamedTuple, TypeVar

R = TypeVar("R")


class DisagreementError(Exception):
    """A worker would compute other bytes than its parent; the message says where they differ."""


class Parent(NamedTuple):
    """Description of the process that gives out tasks.

    Attributes:
        environment: variables that choose the machine instructions.
        fingerprint: what determines the bytes of a run; see `study.runs.provenance.fingerprint`.
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
    found = attempt(number, function, *arguments)
    if isinstance(found[1], Exception):
        found[1].add_note("".join(traceback.format_exception(found[1])))  # pickling leaves the traceback out
    return found


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

    from study.runs.provenance import fingerprint

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
        from study.estimators.own.plugin_file import PluginFile, load_text

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
