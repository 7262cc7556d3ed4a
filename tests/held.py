"""A `study` command whose workers stop at a gate, so that a test can act while nothing moves.

Not a test: tests start ``python held.py run …``, or send `execute` to a cluster. The folder ``GATE`` of the environment
is the gate. The first `FREE` calls of all workers pass. Each later call leaves a file ``held-NUMBER-PROCESS`` there. It
goes on when the folder has a file ``open``, or when a signal has come to its own process.
"""

import itertools
import logging
import os
import select
import signal
import time
from pathlib import Path

from study import instruction_set

logging.disable(logging.WARNING)  # whether loops are compiled or come from the cache
instruction_set.fix()  # before numba is imported, as the command does

from study import cli  # noqa: E402
from study.simulation.posterior import run  # noqa: E402
from study.simulation.runs import parts, runner  # noqa: E402

FREE = 3
_SIGNALS, _WAKE = os.pipe()
_chains = run._chains


def execute(study, some):
    """Compute units, once the gate is passed."""
    _pass()
    return parts.execute(study, some)


def chains(shared, items):
    """Sample posteriors, once the gate is passed."""
    _pass()
    return _chains(shared, items)


def _pass():
    gate = Path(os.environ["GATE"])
    number = next(number for number in itertools.count() if _is_first(gate / f"call-{number}"))
    if number < FREE:
        return
    (gate / f"held-{number}-{os.getpid()}").touch()
    while not (gate / "open").exists() and not select.select([_SIGNALS], [], [], 0)[0]:
        time.sleep(0.01)


def _is_first(path):
    """Create a file; false if another call was sooner."""
    try:
        path.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def main():
    """Run the command line, with a gate before what its workers compute."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have started the tests without Ctrl-C
    os.set_blocking(_WAKE, False)
    signal.set_wakeup_fd(_WAKE)
    runner.execute, run._chains = execute, chains
    cli.main()


if __name__ == "__main__":
    import held  # by its name, by which worker processes find it too

    held.main()
