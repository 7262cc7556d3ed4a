"""The door to a worker process: it makes the worker compute as its parent does, or refuses. It imports nothing heavy.

Equal runs are equal to the byte only if the same code runs on the same machine instructions. So the parent sends what
it is with every task, and a worker looks at itself before its first one. What the environment says of instructions must
be set before numba and NumPy are imported, which unpickling a task does; hence the sealed envelope.
"""

import os
import pickle
import signal
import sys
import threading
import time
from typing import Any


class DisagreementError(Exception):
    """A worker would compute other bytes than its parent; the message says where they differ."""


_agreed: dict[str, Any] = {}


def seal(function: Any, *arguments: Any) -> bytes:
    """A call for `enter`."""
    return pickle.dumps((function, arguments))


def enter(parent: dict[str, Any], call: bytes) -> Any:
    """Make a call in a worker process.

    Args:
        parent: what it is; see `study.runs.workers.dispatch.introduction`.
        call: what to call; see `seal`.

    Raises:
        DisagreementError: if this process would compute other bytes.
    """
    if _agreed != parent:
        _agree(parent)
        _agreed.clear()
        _agreed.update(parent)
    function, arguments = pickle.loads(call)
    return function(*arguments)


def _agree(parent: dict[str, Any]) -> None:
    if "numba" not in sys.modules:
        os.environ.update(parent["environment"])
    if parent["process"] is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to the workers too; the parent ends them
        threading.Thread(target=_end_with, args=(parent["process"],), daemon=True).start()
    from threadpoolctl import threadpool_limits

    from study.runs.provenance import fingerprint

    mine, asked = fingerprint(), parent["fingerprint"]
    differ = [
        f"{name} {mine.get(name)} instead of {asked.get(name)}" for name in asked if mine.get(name) != asked[name]
    ]
    if differ:
        import socket

        raise DisagreementError(f"worker on {socket.gethostname()}: {', '.join(differ)}")
    threadpool_limits(limits=1)


def _end_with(parent: int) -> None:
    """End this process when its parent was killed; what it computes has nowhere to go."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
