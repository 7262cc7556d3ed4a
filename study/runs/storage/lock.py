"""One writer at a time: a lock that the system lets go of when its holder dies, and that names who holds it."""

import contextlib
import json
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from study.runs.storage.atomic_write import RunError, explained

_NAME = ".lock"
_PATIENCE = 0.5
"""Seconds: who only asks whether it is held, holds it for a moment."""


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Hold the lock of a run's folder, which must be there.

    Raises:
        RunError: if another process holds it; the message names the process and its host.
    """
    path = folder / _NAME
    lock = FileLock(path, thread_local=False)
    try:
        lock.acquire(timeout=_PATIENCE)
    except Timeout:  # which is an OSError, too
        raise RunError(f"{folder}: {_said(path)} is writing to it; wait for it to end, or stop it") from None
    except OSError as error:
        with explained(folder):
            raise error
    try:
        with explained(folder):
            path.write_text(json.dumps({"process": os.getpid(), "host": socket.gethostname()}), encoding="utf-8")
        yield
    finally:
        # removed while it is held: who opened it meanwhile finds that it is not the file of this name any more
        with contextlib.suppress(OSError):
            path.unlink()
        lock.release()


def holder(folder: Path) -> str | None:
    """Who writes to a run at this moment, in words; None if nobody does, or it cannot be told without writing."""
    path = folder / _NAME
    if not path.is_file():
        return None
    try:
        with FileLock(path, blocking=False):
            return None
    except Timeout:
        return _said(path)
    except OSError:  # a read-only disk has no writers
        return None


def _said(path: Path) -> str:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return f"process {found['process']} on {found['host']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"
