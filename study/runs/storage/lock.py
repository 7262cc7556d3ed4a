"""The lock of a run's folder: one writer at a time, named in the file. The system releases it when the writer dies."""

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
"""Seconds to wait, because `holder` holds the lock for a moment."""
_NO_NAME: tuple[type[OSError], ...] = (PermissionError,) if os.name == "nt" else ()
"""Windows lets nobody write to a locked file, so that its writer stays without a name."""


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
        raise RunError(f"{folder}: {_writer(path)} is writing to it; wait for it to end, or stop it") from None
    except OSError as error:
        with explained(folder):
            raise error
    try:
        with explained(folder), contextlib.suppress(*_NO_NAME):
            path.write_text(json.dumps({"process": os.getpid(), "host": socket.gethostname()}), encoding="utf-8")
        yield
    finally:
        # removed while it is held: another process that opened it meanwhile finds another file under the name, or none
        with contextlib.suppress(OSError):
            path.unlink()
        lock.release()


def holder(folder: Path) -> str | None:
    """Name the process that writes to a run at this moment; None if there is none, or the disk is read-only."""
    path = folder / _NAME
    if not path.is_file():
        return None
    try:
        with FileLock(path, blocking=False):
            return None
    except Timeout:
        return _writer(path)
    except OSError:  # a read-only disk has no writers
        return None


def _writer(path: Path) -> str:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return f"process {found['process']} on {found['host']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"
