"""Work that ends its worker. Not a test: worker processes import it by its name.

`kill`, `kill_while_sending` and `starve` stand in for `study.simulation.runs.parts.execute`. They leave a file in a
folder each time that a worker ends.
"""

import os
import signal
import struct
import sys
import uuid

from study.simulation.runs import parts


def kill(folder, cells, most, study, some):
    """Compute jobs, but kill this process if one of the cells is among them, at most so many times."""
    if _deadly(folder, cells, most, some):
        os.kill(os.getpid(), signal.SIGKILL)
    return parts.execute(study, some)


def kill_while_sending(folder, cells, most, study, some):
    """Do as `kill`, but with half a result in the pipe, and with the lock that others need to send theirs."""
    if _deadly(folder, cells, most, some):
        frame = sys._getframe()
        while "result_queue" not in frame.f_locals:  # loky's loop, which called this
            frame = frame.f_back
        queue = frame.f_locals["result_queue"]
        queue._wlock.acquire()
        os.write(queue._writer.fileno(), struct.pack("!i", 1000) + b"half")  # a message of 1000 bytes
        os.kill(os.getpid(), signal.SIGKILL)
    return parts.execute(study, some)


def starve(folder, cells, most, study, some):
    """Compute jobs, but raise MemoryError if one of the cells is among them, at most so many times."""
    if _deadly(folder, cells, most, some):
        raise MemoryError("cannot allocate")
    return parts.execute(study, some)


def _deadly(folder, cells, most, some):
    found = cells & {cell.name for task in some for cell in task.batch.cells}
    if not found or len(list(folder.iterdir())) >= most:
        return False
    (folder / uuid.uuid4().hex).touch()
    return True
