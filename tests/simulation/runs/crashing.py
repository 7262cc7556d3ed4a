"""A process that makes runs which die: each request, a line of JSON, is served by a child that may be killed.

Not a test: `test_faults.py` starts it. What takes a second - imports, compiled code - is loaded once, then forked. A
request has ``config`` and ``folder``, perhaps ``backend``, and what happens to the run: ``kill_at``, the number of the
step before or after which it kills itself (steps: computing, syncing, renaming, removing), ``full_at``, the number of
the sync from which on the disk is full. The answer has ``signal``, ``code``, ``steps``, and the keys that were
``computed``.
"""

import errno
import functools
import json
import os
import signal
import sys
import threading
import traceback
from pathlib import Path

from study.files import RunError
from study.simulation.experiment import designs
from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import parse
from study.simulation.runs import parts, runner
from study.simulation.runs.workers import Threads, Workers

designs._SAMPLES_PER_UNIT = 500  # one block in a unit, and one unit in a part
Threads.enough = 0.0
parts._SECONDS = parts._SHARE = 0.0
FULL = 3


class Trap:
    """Counts steps, and kills the process at one of them."""

    def __init__(self, at):
        self.at, self.steps, self.lock = at, 0, threading.Lock()

    def step(self):
        """Count one."""
        with self.lock:
            self.steps += 1
            if self.steps == self.at:
                os.kill(os.getpid(), signal.SIGKILL)

    def around(self, function):
        """Let a function have a step before and one after it."""

        def stepping(*arguments, **named):
            self.step()
            answer = function(*arguments, **named)
            self.step()
            return answer

        return stepping


@functools.cache
def load(config):
    """Load the compiled code of a config, for all children that come."""
    study = parse(config)
    compute(study, next(study.units()))


def serve(request, log):
    """Make a run, and log the computed keys and the steps."""
    trap = Trap(request.get("kill_at"))
    real = parts.execute

    def execute(made, some):
        os.write(log, "".join(f"{task.key}\n" for task in some).encode())
        return real(made, some)

    os.fsync, os.replace = trap.around(os.fsync), trap.around(os.replace)
    os.unlink, os.rename = trap.around(os.unlink), trap.around(os.rename)
    if request.get("backend", "threads") == "threads":  # processes get the real one by its name
        runner.execute = trap.around(execute)
    if "full_at" in request:
        syncs, sync = iter(range(10**9)), os.fsync

        def full(handle):
            if next(syncs) >= request["full_at"]:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            sync(handle)

        os.fsync = full
    crew = Workers(request.get("backend", "threads"), 2)
    try:
        study, folder = parse(request["config"]), Path(request["folder"])
        runner.run(study, request["config"], folder, crew, warn=lambda line: 0)
    except RunError as error:
        return FULL if "No space left" in str(error) else 1
    finally:
        os.write(log, f"steps {trap.steps}\n".encode())
    return 0


def main():
    """Serve until the input ends."""
    for line in sys.stdin:
        request = json.loads(line)
        load(request["config"])
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reader)
            code = 1
            try:
                code = serve(request, writer)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(code)
        os.close(writer)
        with open(reader) as file:
            said = file.read().split("\n")
        status = os.waitpid(child, 0)[1]
        answer = {
            "signal": os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0,
            "code": os.WEXITSTATUS(status) if os.WIFEXITED(status) else None,
            "computed": [word for word in said if word and not word.startswith("steps")],
            "steps": sum(int(word.split()[1]) for word in said if word.startswith("steps")),
        }
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
